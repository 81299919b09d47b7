"""Programs that are no mill's: lathes, other controls, other files; and mills' that look alike."""

import gzip

import pytest

from pipeline.gcode.errors import GcodeError, refuse_foreign

LATHES = [
    ("fanuc", "G21 G99\nT0101\nG97 S800 M3\nG0 X50 Z2\nG1 Z-30 F.3\nM30"),
    ("fanuc", "N1 G28U0W0\nT0202\nG0X40.Z5.\nG1Z-20.F0.2"),
    ("fanuc", "G50S2000\nT101\nG96S180M3\nG0X30.\nG1Z-10.F.1"),
    ("fanuc", "G40 G97 G99 S500 M03 T0303\nG0 X20 Z5\nG92 X19.5 Z-20 F1.5\nX19\nM30"),
    ("fanuc", "G21\nG71 U2. R1.\nG71 P10 Q20 U.4 W.1 F.25\nN10 G0 X10\nN20 G1 Z-5"),
    ("fanuc", "G54\nG97 S500 M3\nG32 Z-20. F1.5"),
    ("fanuc", "G76 P020060 Q100 R.05\nG76 X28.16 Z-25. P920 Q300 F1.5"),
    ("fanuc", "G95\nG92 S2500\nG96 S200 M4\nG0 X60 Z0\nG1 X-1 F.2\n"),
    ("fanuc", "O1(TURN)\nN10 T0101 (ROUGH)\nG0 X100 Z50\nN20 G96 S200 M04\nG01 X20 Z-30 F0.2"),
    ("siemens", "DIAMON\nG95 G96 S200 LIMS=3000 M4\nG0 X50 Z2\nG1 Z-30 F0.3"),
    ("siemens", "G18 G96 S200 LIMS=2500 M4\nT1 D1\nG0 X50 Z2\nG1 Z-30 F.3\nM30"),
    ("siemens", 'CYCLE95("KONTUR",2,0.1,0.2,0.1,0.3,0.2,0.1,9)'),
]
MILLS = [
    ("fanuc", "G17 G40 G49 G50 G69 G80 G98\nT101 M6\nG0 X1 Y1\nG81 Z-5 R2 F100"),
    ("fanuc", "G73 X1 Y1 Z-10 R2 P100 Q1 F100"),
    ("fanuc", "G76 X10 Y0 Z-5 R1 Q0.2 P500 F50\n"),
    ("fanuc", "G92 X0 Y0 Z0\nS1000 M3\nG1 X10 F0.5"),
    ("fanuc", "G95 G1 X10 F0.2\n G96 S100"),
    ("fanuc", "G99 G83 X1 Z-5 R1 Q1 F50\n"),
    ("fanuc", "G4 U2\nG1 X1 F.5\n"),
    ("fanuc", "G65 P9 U1 W2 F.2\nG1 X10"),
    ("fanuc", "G51 X0 Y0 P2000\nG50 S500\nG0 X1"),
    ("fanuc", "G90 G54 G0 X0\nG1 X10 F0.5\nG97 S300"),
    ("fanuc", "G20 G1 X1 F.5 (slow)\nG1 Z-.1 F.2"),
    ("fanuc", "T1212\nM06\nG0 X1"),
    ("fanuc", "G15"),
    ("fanuc", "G16 G15 X1 Y2\nG43 H1 Z2 G15\n"),
    ("fanuc", "G70 I10. J30. L8\nG71 I2 J30 K30 L3"),
    ("fanuc", "G1 X10 W5"),
    ("siemens", "T1 M6\nG96 S100\nG1 X1 Y2 F100"),
    ("siemens", "G33 A1"),
]


def named(text: bytes, dialect: str = "fanuc") -> str:
    """What is said of a file; empty where it may be a mill's program."""
    try:
        refuse_foreign(text, "P", dialect)
    except GcodeError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(("dialect", "text"), LATHES)
def test_a_lathe_s_program_is_called_so(dialect, text):
    said = named(text.encode(), dialect)
    assert "this is a lathe's program" in said
    assert "delete" not in said


@pytest.mark.parametrize(("dialect", "text"), MILLS)
def test_words_that_a_mill_has_too_tell_no_lathe(dialect, text):
    assert named(text.encode(), dialect) == ""


def test_the_signs_of_a_lathe_are_named_at_the_first_one():
    said = named(b"G21 G18 G99\nG50 S1600\nT0101\nG96 S250 M3\nG0 X50. Z2.\nG1 Z-30. F0.3\nM30")
    assert said.startswith("P:1:9: G99: this is a lathe's program")
    assert "(G50 S or G92 S)" in said
    assert "(T0101)" in said


@pytest.mark.parametrize(("data", "name"), [
    ("G90\nG1 X10".encode("utf-16"), "text in UTF-16, no part program: save it as UTF-8"),
    ("G90".encode("utf-32"), "text in UTF-32"),
    (gzip.compress(b"G90 G1 X10", mtime=0), "packed by gzip, no part program: unpack it"),
    (b"PK\x03\x04" + bytes(30), "a ZIP archive"),
    (b"%PDF-1.7\n", "a PDF"),
    (b"  0\r\nSECTION\r\n  2\r\nHEADER\r\n", "a DXF drawing"),
    (b"ISO-10303-21;\nHEADER;", "a STEP file"),
    (b"<?xml version='1.0'?>", "XML or HTML"),
    *(
        (b"O100\nG00 G90 G40 G80 G17\n" * (mark[:1] != b"$") + mark, "an Okuma OSP program")
        for mark in (
            b"$T1.MIN%\nG0 X1",
            b"N1 G15 H2",
            b"CALL O200 Q2",
            b"CALL OBOLT PX=1 PY=2",
            b"VC1=5\nG0 X=VC1",
            b"NOEX VC1=VC1+1",
            b"VZOFZ[3]=5",
            b"MODIN O3",
            b"G1 X5 F100\nMODOUT",
        )
    ),
    (b"%PM\nN9001\nN1 G17 T1 M6\n", "a Philips or Maho program"),
    (b"%PRG1,MX,\nN10 G0 X10\n", "a Fagor program"),
    (b"MAZATROL M-32\nUNo. MAT INITIAL-Z\n", "a Mazatrol program"),
    (b"0 BEGIN PGM A MM\n", "a Heidenhain conversational program"),
    (b"%A G71 *\nN10 G00 X+10 *\n", "a Heidenhain ISO program"),
    (bytes(range(128, 256)) * 8, "binary data"),
])  # fmt: skip
def test_a_foreign_file_is_named_by_its_whole_form(data, name):
    assert name in named(data)
