"""``kerf check``: what it prints, and how it ends."""

from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from pipeline.app.program_commands import app
from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof.prove import prove, with_proof_comment

BEFORE = b"%\nG21 G90\nS3000 M3\nG1 X10 F100\nY5\nM30\n%\n"
AFTER = BEFORE.replace(b"S3000", b"S2500").replace(b"F100", b"F80").replace(b"Y5", b"Y5 F120")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "before.nc").write_bytes(BEFORE)
    return tmp_path


def check(folder: Path, after: bytes | None, *words: str) -> Result:
    if after is not None:
        (folder / "after.nc").write_bytes(after)
    done = CliRunner().invoke(
        app, ["check", str(folder / "before.nc"), str(folder / "after.nc"), *words]
    )
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    return done


def test_a_table_of_what_differs_and_the_hash(folder: Path) -> None:
    proof = prove(BEFORE, AFTER, "", "", Setup())  # first: compiled loops are announced on stderr
    done = check(folder, AFTER)
    assert done.exit_code == 0 and done.stderr == ""
    assert [" ".join(line.split()) for line in done.stdout.splitlines()] == [
        "line before.nc -> after.nc",
        "3 S3000 -> S2500",
        "4 F100 -> F80",
        "5 - -> F120",
        "1 F changed, 1 F added, 1 S changed, 0 S added",
        "4 moves are the same to the last bit, but for feed and speed",
        f"proof sha256 {proof.sha256}",
    ]


def test_the_first_block_that_differs(folder: Path) -> None:
    done = check(folder, AFTER.replace(b"X10", b"X11"))
    assert done.exit_code == 1
    assert done.stdout.splitlines()[-3:] == [
        "not the same, first in line 4: X10 became X11",
        "  before.nc: G1 X10 F100",
        "  after.nc: G1 X11 F80",
    ]


def test_a_proof_comment_is_looked_at(folder: Path) -> None:
    signed = with_proof_comment(AFTER, prove(BEFORE, AFTER, "", "", Setup()))
    assert check(folder, signed).exit_code == 0
    at = signed.index(b"SHA256 ") + 7
    false = signed[:at] + (b"0" if signed[at : at + 1] != b"0" else b"1") + signed[at + 1 :]
    done = check(folder, false)
    assert done.exit_code == 1 and "its proof comment has another hash" in done.stdout


def test_points_on_the_way_only_when_asked_for(folder: Path) -> None:
    after = AFTER.replace(b"G1 X10", b"G1 X4.5 F90\nG1 X10")
    assert check(folder, after).exit_code == 1
    done = check(folder, after, "--splits")
    assert done.exit_code == 0 and "1 points put in" in done.stdout


@pytest.mark.parametrize(
    ("after", "words", "said"),
    [
        (None, (), "after.nc does not exist: name a part program"),
        (b"", (), "after.nc is empty: name a part program"),
        (BEFORE, ("--machine", "no_such"), "no_such"),
    ],
)
def test_what_cannot_be_read_is_one_sentence(folder: Path, after, words, said: str) -> None:
    done = check(folder, after, *words)
    assert done.exit_code == 2 and done.stdout == ""
    assert done.stderr.startswith("kerf: ") and done.stderr.count("\n") == 1
    assert said in done.stderr


def test_a_folder_is_no_program(folder: Path) -> None:
    (folder / "after.nc").mkdir()
    assert "after.nc is no file" in check(folder, None).stderr


def test_a_line_that_differs_is_shown_as_a_terminal_may_show_it(folder: Path) -> None:
    (folder / "before.nc").write_bytes(b"(\x1b[31m" + b"x" * 999 + b")\n")
    done = check(folder, b"(\x00\xe4)\n")
    *_, first, second = done.stdout.splitlines()
    assert (done.exit_code, second) == (1, "  after.nc: (\\x00\xe4)")
    assert first.startswith("  before.nc: (\\x1b[31mxx") and len(first) < 200


def test_junk_is_one_sentence(folder: Path) -> None:
    (folder / "before.nc").write_bytes(bytes(range(256)))
    done = check(folder, bytes(range(256)))
    assert done.exit_code == 2 and done.stderr.count("\n") == 1


TOOLS = """description: mine
tools:
  1: {kind: flat, diameter_mm: 10, flutes: 2, feed_per_tooth_mm: [0.01, 0.05],
      cutting_speed_m_min: [50, 120]}
  2: {kind: flat, diameter_mm: 6, flutes: 2}
"""
CUTTING = """T1 M6
S3000 M3
G1 X10 F120
Y5
G95 X12 F0.05
G94
G84 Z-5 R1 F300
G80
T2 M6
S3000 M3
G1 X20 F900
T3 M6
M3
X30
M30
"""


STEEL = ("--material", "steel_medium_carbon")


def ranges_checked(
    folder: Path, before: str, change: tuple[str, str], tools: str, *words: str
) -> tuple[list[str], list[str]]:
    """Warnings of the ranges of tools in a changed program, and what is not judged."""
    (folder / "tools.yaml").write_text(tools)
    (folder / "before.nc").write_text(before)
    assert change[0] in before
    after = before.replace(*change, 1)
    done = check(folder, after.encode(), "--tool-table", str(folder / "tools.yaml"), *words)
    assert done.exit_code == 0, done.output
    lines = [line.partition(": ")[::2] for line in done.stdout.splitlines()]
    warnings = [said for kind, said in lines if kind == "warning" and "became" not in said]
    return warnings, [said for kind, said in lines if kind == "not judged"]


def test_feeds_and_speeds_that_leave_the_range_of_the_tool_are_warned_of(folder: Path) -> None:
    """0.05 mm/tooth of two at 3000 rev/min is F300, 120 m/min of 10 mm is 3820 rev/min."""

    def warned(*change: str, tools: str = TOOLS) -> list[str]:
        return ranges_checked(folder, CUTTING, change, tools)[0]

    assert warned("F120", "F300") == []
    assert warned("F120", "F360") == [
        "line 3, T1: F360 at S3000 is 0.06 mm/tooth, outside of 0.01 to 0.05 of the tool table",
        "line 4, T1: F360 at S3000 is 0.06 mm/tooth, outside of 0.01 to 0.05 of the tool table",
    ]
    assert warned("Y5", "Y5 F30")[0].startswith("line 4, T1: F30 at S3000 is 0.005 mm")
    assert warned("F0.05", "F0.2")[0].startswith("line 5, T1: F0.2 at S3000 is 0.1 mm")
    # what was outside before is not warned of again
    (alone,) = warned("Y5", "Y5 F130", tools=TOOLS.replace("0.05]", "0.015]"))
    assert "line 4, T1: F130" in alone
    _, silent = ranges_checked(folder, CUTTING, ("F120", "F300"), TOOLS)
    assert silent == ["T2 has no range in the tool table", "T3 is not in the tool table"]


def test_points_put_in_shift_no_warning(folder: Path) -> None:
    """F360 and F380 are outside before and, a line lower, after: the new F370 alone is said."""
    before = "G0 X0 Y0 Z0\nT1 M6\nS3000 M3\nG1 X10 F360\nX20 F380\nM30\n"
    change = "G1 X10 F360", "G1 X4.5 F370\nG1 X10 F360"
    ((said,), _) = ranges_checked(folder, before, change, TOOLS, "--splits")
    assert "line 4, T1: F370" in said


def test_a_speed_that_leaves_the_range_of_the_tool(folder: Path) -> None:
    before = "T1 M6\nS3000 M3\nG1 X10 F120\nM30\n"
    warnings, _ = ranges_checked(folder, before, ("S3000", "S4000"), TOOLS)
    assert warnings == ["line 3, T1: S4000 is 126 m/min, outside of 50 to 120 of the tool table"]
    done = check(folder, before.encode(), "--tool-table", str(folder / "none.yaml"))
    assert done.exit_code == 2 and "none.yaml" in done.stderr and done.stderr.count("\n") == 1


OPERATIONS = """T1 M6
S5000 M3
G1 X10 F1200
(FINISH WALL)
Y5
T2 M6
S2000 M3
G81 Z-9 R1 F250
G83 Z-30 R1 Q3 F200
G80
T3 M6
S2500 M3
G81 X30 Z-2 R1 F200
G80
T4 M6
S3000 M3
G1 X40 F600
T5 M6
S600 M3
G85 Z-9 R1 F40
G80
T6 M6
S2500 M3
G1 X50 F100
M30
"""
PLAIN_TOOLS = """description: without ranges of their own
tools:
  1: {kind: flat, diameter_mm: 10, flutes: 4}
  2: {kind: drill, diameter_mm: 8.5, flutes: 2}
  3: {kind: drill, role: spot_drill, diameter_mm: 10, flutes: 2, cutting_speed_m_min: [50, 90]}
  4: {kind: flat, role: chamfer_mill, diameter_mm: 10, flutes: 4}
  5: {kind: flat, role: boring_bar, diameter_mm: 20, flutes: 1}
  6: {kind: flat, diameter_mm: 40, flutes: 4, material: hss}
"""


@pytest.mark.parametrize(
    ("change", "said", "whose"),
    [
        # without the cut a mill may slot or finish: 0.035 mm of slots to 0.12 mm of finishing
        (("F1200", "F2200"), "", ""),
        (("F1200", "F3000"), "line 3, T1: F3000 at S5000 is 0.15 mm/tooth, outside of 0.035 to "
         "0.12", "Tungaloy"),
        # slots from 140 m/min on, finishing up to 280
        (("S5000", "S9500"), "line 3, T1: S9500 is 298 m/min, outside of 140 to 280", "Tungaloy"),
        # the feed of drills is shared by two lips; deep holes have 0.8 of it
        (("F250", "F320"), "line 8, T2: F320 at S2000 is 0.08 mm/tooth, outside of 0.051 to "
         "0.076", ""),
        (("F200\nG80\nT3", "F260\nG80\nT3"), "line 9, T2: F260 at S2000 is 0.065 mm/tooth, "
         "outside of 0.04065 to 0.061", "Metal Drilling"),
        # a spot drill with a speed of its own has the feed of the catalogue
        (("X30 Z-2 R1 F200", "X30 Z-2 R1 F300"), "line 13, T3: F300 at S2500 is 0.06 mm/tooth, "
         "outside of 0.025 to 0.05", "Nine9"),
        (("S2500 M3\nG81", "S3500 M3\nG81"), "line 13, T3: S3500 is 110 m/min, outside of 50 to "
         "90 of the tool table", ""),
        (("F40", "F150"), "line 20, T5: F150 at S600 is 0.25 mm/tooth, outside of "
         "0.0127 to 0.178", "SCT"),
    ],
)  # fmt: skip
def test_without_a_range_in_the_table_that_of_the_catalogue_counts(
    folder: Path, change: tuple[str, str], said: str, whose: str
) -> None:
    warnings, silent = ranges_checked(folder, OPERATIONS, change, PLAIN_TOOLS, *STEEL)
    assert bool(warnings) == bool(said), warnings
    if said:
        line = next(line for line in warnings if line.startswith(said))
        assert ("of the catalogue (" in line) == ("tool table" not in said)
        assert whose in line
    where = "ISO P, group 2 of VDI 3323"
    assert silent == [
        "T4 has no range in the tool table, and the catalogue has no row for a carbide chamfer "
        f"mill of 10 mm in {where}, chamfering",
        "T6 has no range in the tool table, and the catalogue has no row for a high-speed steel "
        f"end mill of 40 mm in {where}, roughing: the catalogue has 6.35 to 32 mm",
    ]


@pytest.mark.parametrize(("comment", "outside"), [("(WALL)", False), ("(FINISH WALL)", True)])
def test_a_comment_tells_finishing_where_there_is_no_cut(
    folder: Path, comment: str, outside: bool
) -> None:
    """0.065 mm is inside of what slots have, and below finishing and what leads to it."""
    before = f"T1 M6\nS5000 M3\n{comment}\nG1 X10 F1600\nM30\n"
    warnings, _ = ranges_checked(folder, before, ("F1600", "F1300"), PLAIN_TOOLS, *STEEL)
    assert any("F1300 at S5000 is 0.065 mm/tooth" in one for one in warnings) == outside


def test_a_speed_that_stays_is_not_warned_of(folder: Path) -> None:
    """16 m/min is below all milling, in the program already."""
    before = "T1 M6\nS500 M3\nG1 X10 F100\nM30\n"
    assert ranges_checked(folder, before, ("F100", "F120"), PLAIN_TOOLS, *STEEL)[0] == []
    (said,), _ = ranges_checked(folder, before, ("S500", "S450"), PLAIN_TOOLS, *STEEL)
    assert "S450 is 14.1 m/min" in said


def test_a_material_without_a_table_or_a_file_is_refused(folder: Path) -> None:
    done = check(folder, AFTER, "--material", "steel_medium_carbon")
    assert done.exit_code == 2
    assert done.stderr == (
        "kerf: --material is given without --tool-table: name a table of conf/tool/ or a YAML "
        "file\n"
    )
    (folder / "tools.yaml").write_text(TOOLS)
    done = check(folder, AFTER, "--tool-table", str(folder / "tools.yaml"), "--material", "cheese")
    assert done.exit_code == 2 and "cheese is no material of conf/material/" in done.stderr


FAST = "T1 M6\nS3000 M3\nG1 X15 F120\nX20 F100\nG95 X30 F0.05\nM30\n"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("S3000", "S3200"), []),
        (("S3000", "S13000"), ["line 2: S 13000 rev/min is above 12000 rev/min",
                               "after.nc leaves the limits of mill01 1 time",
                               "line 3, T1 and 2 more lines: S3000 became S13000, ×4.33"]),
        (("F120", "F181"), ["line 3, T1: F120 became F181, ×1.51"]),
        (("F100", "F49"), ["line 4, T1: F100 became F49, ×0.49"]),
        (("F120", "F16000"), ["line 3: F 16000 mm/min is above 15000 mm/min",
                              "after.nc leaves the limits of mill01 1 time",
                              "line 3, T1: F120 became F16000, ×133"]),
        (("F0.05", "F5.5"), ["line 5: F 16500 mm/min is above 15000 mm/min",
                             "after.nc leaves the limits of mill01 1 time",
                             "line 5, T1: F0.05 became F5.5, ×110"]),
    ],
)  # fmt: skip
def test_what_the_machine_does_not_have_and_what_changed_much(
    folder: Path, change: tuple[str, str], said: list[str]
) -> None:
    (folder / "before.nc").write_text(FAST)
    done = check(folder, FAST.replace(*change).encode(), "--machine", "mill01")
    assert done.exit_code == 0
    lines = [line for line in done.stdout.splitlines() if line.startswith("warning: ")]
    assert len(lines) == len(said)
    for line, begin in zip(lines, said, strict=True):
        assert line.startswith(f"warning: {begin}")


def test_feeds_in_inches_are_said_in_inches(folder: Path) -> None:
    before = b"G20\nT1 M6\nS3000 M3\nG1 X1. F10.\nM30\n"
    (folder / "before.nc").write_bytes(before)
    done = check(folder, before.replace(b"F10.", b"F20."), "--machine", "mill01")
    assert "line 4, T1: F10 became F20, ×2, outside of ×0.5 to ×1.5" in done.stdout


def test_each_program_is_followed_once(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Proof, preflight, ranges and warnings share what was followed."""
    followed, plain = [], Interpreter.__init__

    def counted(self, program, *args, **kwargs):
        followed.append(program.name)
        plain(self, program, *args, **kwargs)

    monkeypatch.setattr(Interpreter, "__init__", counted)
    (folder / "tools.yaml").write_text(TOOLS)
    table = ("--tool-table", str(folder / "tools.yaml"))
    assert check(folder, AFTER, "--machine", "mill01", *table).exit_code == 0
    assert followed == ["before.nc", "after.nc"]
