"""Modes and measured responses of tool tips, and their files."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.stability.tip_dynamics import (
    FrequencyResponse,
    Mode,
    joined_responses,
    modal_receptance,
    read_frf,
)
from tests.cutting.chatter import X, Y


def test_receptance_solves_the_equation_of_motion() -> None:
    """(k - m w^2 + i c w) of the answer is the force."""
    f = np.geomspace(10.0, 5000.0, 50)
    w, c = 2 * np.pi * f, 2 * Y.damping * Y.mass * Y.omega
    force = (Y.stiffness - Y.mass * w**2 + 1j * c * w) * modal_receptance([X, Y], f)[:, 1, 1]
    np.testing.assert_allclose(force, 1.0, rtol=1e-12)
    assert not modal_receptance([X], f)[:, 1].any()


def test_stiffness_and_mass_say_each_other() -> None:
    other = Mode(
        direction="x", natural_frequency_Hz=922.0, damping=0.011, stiffness_N_m=X.stiffness
    )
    assert other.mass == pytest.approx(0.03993, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"direction": "z"}, "mode.direction = 'z'"),
        ({"damping": 0.0}, "mode.damping = 0.0 must lie above 0 and below 1"),
        ({"damping": 1.0}, "mode.damping = 1.0 must lie above 0 and below 1"),
        (
            {"natural_frequency_Hz": float("nan")},
            "natural_frequency_Hz = nan must be finite",
        ),
        ({"mass_kg": None}, "exactly one"),
        ({"stiffness_N_m": 1e6}, "exactly one"),
        ({"mass_kg": -1.0}, "mode.mass_kg = -1.0 must be finite and positive"),
    ],
)
def test_a_mode_that_cannot_be(change: dict, message: str) -> None:
    good = {"direction": "x", "natural_frequency_Hz": 922.0, "damping": 0.011, "mass_kg": 0.04}
    with pytest.raises(ValueError, match=message):
        Mode(**(good | change))


FREQUENCY = np.arange(50.0, 4000.0, 1.0)
MEASURED = FrequencyResponse(frequency_Hz=FREQUENCY, receptance=modal_receptance([X, Y], FREQUENCY))
HEADER = "frequency [Hz],real [um/N],imaginary [um/N]\n"


def written(path: Path, **units: object) -> Path:
    """The measured response as a universal file: displacement as text, acceleration as binary."""
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(path))
    omega = 2 * np.pi * FREQUENCY
    for axis, sign in ((0, 1), (1, -1)):
        file.write_sets(pyuff.prepare_58(
            binary=axis, func_type=4, rsp_node=1, rsp_dir=sign * (axis + 1), ref_node=1,
            ref_dir=axis + 1, x=FREQUENCY, abscissa_spacing=1, abscissa_spec_data_type=18,
            data=sign * MEASURED.receptance[:, axis, axis] * (-(omega**2) if axis else 1.0),
            ordinate_spec_data_type=12 if axis else 8, orddenom_spec_data_type=13,
            id1="tip", rsp_ent_name="NONE", ref_ent_name="NONE", **units,
        ), "add")  # fmt: skip
    return path


def test_what_a_csv_says_is_read(tmp_path: Path) -> None:
    for name in ("x", "y"):
        receptance = MEASURED.receptance[:, "xy".index(name), "xy".index(name)]
        rows = zip(MEASURED.frequency_Hz, receptance.real, receptance.imag, strict=True)
        lines = [",".join(repr(float(number)) for number in row) for row in rows]
        head = "frequency [Hz],real [m/N],imaginary [m/N]"
        (tmp_path / f"{name}.csv").write_text("\n".join([head, *lines]) + "\n")
    parts = [read_frf(tmp_path / f"{name}.csv", direction=name) for name in ("x", "y")]
    tip = joined_responses(parts)
    np.testing.assert_array_equal(tip.receptance, MEASURED.receptance)


def test_what_a_universal_file_says_is_read(tmp_path: Path) -> None:
    """Text with 12 digits and binary, displacement and acceleration, a sensor that looks back."""
    tip = read_frf(written(tmp_path / "tip.uff"))
    np.testing.assert_allclose(tip.receptance, MEASURED.receptance, rtol=1e-9, atol=1e-18)


def test_units_of_a_universal_file_are_factors_from_si(tmp_path: Path) -> None:
    """Data set 164: times its factors SI comes to the file's units, here mm and kN."""
    pyuff = pytest.importorskip("pyuff")
    file = pyuff.UFF(str(tmp_path / "mm.uff"))
    file.write_sets(pyuff.prepare_164(
        units_code=9, units_description="mm, kN", temp_mode=1, length=1e3, force=1e-3, temp=1.0,
        temp_offset=273.15,
    ), "overwrite")  # fmt: skip
    found = read_frf(written(tmp_path / "mm.uff")).receptance
    # a value in mm/kN is 1e-3 m over 1e3 N
    np.testing.assert_allclose(found, MEASURED.receptance * 1e-6, rtol=1e-9, atol=1e-24)


@pytest.mark.parametrize(
    ("header", "derivative", "factor"),
    [
        ("frequency [Hz];real [m/N];imaginary [m/N]", 0, 1.0),
        ("F (Hz);Re (µm/N);Im (µm/N)", 0, 1e6),
        ('"freq";"real [(mm/s)/N]";"imag [(mm/s)/N]"', 1, 1e3),
        ("frequency [Hz];real [m/s²/N];imaginary [m/s^2/N]", 2, 1.0),
        ("frequency [Hz];real [mm/s²/N];imaginary [mm/s^2/N]", 2, 1e3),
        ("frequency [Hz];real [mm/N];imaginary [mm/N]", 0, 1e3),
        ("frequency [Hz];real [m/s/N];imaginary [m/s/N]", 1, 1.0),
        ("frequency [Hz];real [g/N];imaginary [g/N]", 2, 1 / 9.80665),
    ],
)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "latin-1"])
def test_units(tmp_path: Path, header: str, derivative: int, factor: float, encoding: str) -> None:
    values = MEASURED.receptance[:, 0, 0] * (2j * np.pi * FREQUENCY) ** derivative * factor
    rows = [f"{f};{v.real!r};{v.imag!r}" for f, v in zip(FREQUENCY, values.tolist(), strict=True)]
    file = tmp_path / "x.csv"
    file.write_bytes("\n".join(["# a hammer", header, *rows]).replace(".", ",").encode(encoding))
    np.testing.assert_allclose(
        read_frf(file, direction="x").receptance[:, 0, 0], MEASURED.receptance[:, 0, 0], rtol=1e-12
    )


@pytest.mark.parametrize(("unit", "factor"), [("[deg]", 180 / np.pi), ("[rad]", 1.0)])
def test_magnitude_and_phase(tmp_path: Path, unit: str, factor: float) -> None:
    values = MEASURED.receptance[:, 1, 1]
    rows = [
        f"{np.angle(v) * factor!r},1.0,{f},{abs(v) * 1e6!r}".replace("np.float64", "")
        for f, v in zip(FREQUENCY, values, strict=True)
    ]
    file = tmp_path / "y.txt"
    text = "\n".join([f"phase {unit},coherence,frequency,magnitude [um/N]", *rows])
    file.write_text(text.replace("(", "").replace(")", ""))
    read = read_frf(file, direction="y").receptance[:, 1, 1]
    np.testing.assert_allclose(read, values, rtol=1e-12)


def test_directions_and_static_line(tmp_path: Path) -> None:
    file = tmp_path / "xy.csv"
    file.write_text(HEADER + "0,9,9\n10,1,-2\n20,3,-4\n")
    tip = read_frf(file, direction="xy")
    np.testing.assert_allclose(tip.receptance[:, 0, 1], [(1 - 2j) * 1e-6, (3 - 4j) * 1e-6])
    assert tip.receptance[:, 1, 0].any() == False  # noqa: E712
    np.testing.assert_allclose(tip.at(np.array([15.0]))[0, 0, 1], (2 - 3j) * 1e-6)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.csv", "", "a.csv: the file is empty"),
        ("a.csv", HEADER, "no line of numbers"),
        ("a.csv", "1,2,3\n4,5,6\n", "must name frequency and either"),
        ("a.csv", HEADER + "1,2\n", "line 2: imaginary is ''"),
        ("a.csv", HEADER + "1,2,-1\n2,two,3\n", "line 3: real is 'two'"),
        ("a.csv", HEADER + "1,2,-1\n2,nan,3\n", "line 3: real is 'nan', which is not finite"),
        ("a.csv", HEADER + "2,2,-1\n1,1,-1\n", "frequency 2, 1 Hz, is not above"),
        ("a.csv", HEADER + "1,2,-1\n", "1 frequencies"),
        ("a.csv", HEADER.replace("um/N", "lbf", 1) + "1,2,-1\n2,2,-1\n", "unit is 'lbf'"),
        ("a.csv", HEADER.replace("um/N", "m/N", 1) + "1,2,-1\n2,2,-1\n", "real is in m/N"),
        ("a.csv", HEADER.replace("Hz", "rad/s") + "1,2,-1\n2,2,-1\n", "frequency is in 'rad/s'"),
        ("a.csv", HEADER + "1,2,1\n2,2,1\n", "imaginary part along x is positive at its peak"),
        ("a.csv", HEADER.strip() + ",real [m/N]\n1,2,-1,3\n", "names real twice"),
        ("a.xyz", "", "its ending '.xyz'"),
        ("a.uff", "", "holds 0 data sets 58"),
        ("a.unv", "    -1\n    58\nnothing\n    -1\n", "no whole universal file"),
        ("gone/a.csv", None, "a.csv: cannot be read: No such file"),
        ("gone/a.uff", None, "a.uff: cannot be read: No such file"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path, name: str, text: str | None, message: str) -> None:
    file = tmp_path / name
    if text is not None:
        file.write_text(text)
    with pytest.raises(ValueError, match=message) as caught:
        read_frf(file, direction=None if file.suffix in (".uff", ".unv") else "x")
    assert "\n" not in str(caught.value)


def test_a_csv_file_needs_its_direction(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="say x, y, xy or yx"):
        read_frf(tmp_path / "a.csv")


def test_universal_files_say_what_they_are(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="its unit is 'm/s': one of them is wrong"):
        read_frf(written(tmp_path / "unit.uff", ordinate_axis_units_lab="m/s"))
    half = written(tmp_path / "half.uff").read_bytes()
    (tmp_path / "half.uff").write_bytes(half[:20_000] + b"\n    -1\n")
    with pytest.raises(ValueError, match=r"half\.uff: "):
        read_frf(tmp_path / "half.uff")


@settings(deadline=None, max_examples=40)
@given(place=st.integers(0, 3000), junk=st.binary(max_size=40))
def test_no_damage_to_a_universal_file_is_another_error(tmp_path_factory, place, junk) -> None:
    folder = tmp_path_factory.mktemp("damaged")
    whole = written(folder / "whole.uff").read_bytes()[:40_000] + b"\n    -1\n"
    (folder / "damaged.uff").write_bytes(whole[:place] + junk + whole[place + len(junk) :])
    try:
        read_frf(folder / "damaged.uff")
    except ValueError as error:
        assert "damaged.uff: " in str(error)


@settings(deadline=None, max_examples=40)
@given(text=st.text(alphabet='01.,;-e \n[]HzfreqalimgpsudN/mµ#"', max_size=80))
def test_no_text_is_another_error(tmp_path_factory, text: str) -> None:
    file = tmp_path_factory.mktemp("text") / "a.csv"
    file.write_text(HEADER + text)
    try:
        read_frf(file, direction="y")
    except ValueError as error:
        assert "a.csv: " in str(error)


def test_joining_names_what_does_not_fit() -> None:
    with pytest.raises(ValueError, match="x over x is measured more than once"):
        joined_responses([MEASURED, MEASURED])
    later = FrequencyResponse(
        frequency_Hz=FREQUENCY + 1e4, receptance=np.flip(MEASURED.receptance, (1, 2))
    )
    only_x = MEASURED.receptance.copy()
    only_x[:, 1, 1] = 0
    first = FrequencyResponse(frequency_Hz=FREQUENCY, receptance=only_x)
    later.receptance[:, 1, 1] = only_x[:, 0, 0]
    later.receptance[:, 0, 0] = 0
    with pytest.raises(ValueError, match="share no frequencies"):
        joined_responses([first, later])
    with pytest.raises(ValueError, match="there is none to join"):
        joined_responses([])
