"""`kerf chatter` on files as recorders write them."""

import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import pipeline.app.program_commands  # noqa: F401, its commands
from pipeline.app.chatter import JudgedFile, Stretch, document, said
from pipeline.app.kerf import app
from pipeline.cutting.stability.recorded_chatter import RecordedChatter

RATE = 5120.0
SPEED_RPM, TEETH = 6000, 3


def recorded(path: Path, head: str, unit_s: float, chatter_Hz: float) -> Path:
    """Three seconds of a cut with a chatter line as loud as the teeth."""
    t = np.arange(round(3 * RATE)) / RATE
    noise = np.random.default_rng(1).standard_normal(len(t))
    signal = np.sin(2 * np.pi * SPEED_RPM / 60 * TEETH * t) + 0.05 * noise
    signal += np.sin(2 * np.pi * chatter_Hz * t)
    np.savetxt(path, np.column_stack([t / unit_s, signal]), delimiter=",", header=f"{head},acc",
               comments="", fmt="%.9g")  # fmt: skip
    return path


@pytest.mark.parametrize(
    ("head", "unit_s"),
    [("time", 1.0), ("t", 1.0), ("Time", 1.0), ("time_s", 1.0), ("time_ms", 1e-3)],
)
def test_a_column_of_time_is_known_by_its_usual_names(
    head: str, unit_s: float, tmp_path: Path
) -> None:
    file, out = recorded(tmp_path / "cut.csv", head, unit_s, 743.0), tmp_path / "chatter.json"
    done = CliRunner().invoke(app, ["chatter", str(file), "--teeth", str(TEETH), "--speed",
                                    str(SPEED_RPM), "--json", str(out)])  # fmt: skip
    assert done.exit_code == 3, done.output
    found = json.loads(out.read_text())
    assert found["verdict"] == "chatter"
    assert found["frequency_Hz"] == pytest.approx(743.0, rel=0.01)


def judged(file: Path, *options: str) -> tuple[dict[str, Any], str]:
    """JSON and text of the command on a file."""
    out = file.with_suffix(".json")
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        done = CliRunner().invoke(app, ["chatter", str(file), "--teeth", str(TEETH), "--json",
                                        str(out), *options])  # fmt: skip
    found = json.loads(out.read_text())
    statuses = {"stable": 0, "not decided": 1, "chatter": 3}
    assert done.exit_code == statuses[found["verdict"]], (done.output, done.exception)
    return found, " ".join(done.output.split())


def test_no_column_of_time_is_a_channel_though_the_rate_is_given(tmp_path: Path) -> None:
    file = recorded(tmp_path / "cut.csv", "time_s", 1.0, 743.0)
    lines = file.read_text().splitlines()
    ticks = ["timestamp", *(f"{k * 1e6 / RATE:.3f}" for k in range(len(lines) - 1))]
    file.write_text("".join(f"{a},{b}\n" for a, b in zip(lines, ticks, strict=True)))
    both, _ = judged(file, "--speed", str(SPEED_RPM), "--rate", str(RATE))
    alone, _ = judged(file, "--speed", str(SPEED_RPM), "--rate", str(RATE), "--channel", "acc")
    assert both == alone


def test_gaps_and_zeros_of_the_speed_leave_the_verdict(tmp_path: Path) -> None:
    file = recorded(tmp_path / "cut.csv", "time", 1.0, 743.0)
    head, *rows = file.read_text().splitlines()
    speeds = [str(SPEED_RPM)] * len(rows)
    speeds[4000], speeds[:500] = "", ["0"] * 500
    text = "".join(f"{a},{b},0\n" for a, b in zip(rows, speeds, strict=True))
    file.write_text(f"{head},rpm,dead\n{text}")
    found, _ = judged(file, "--speed", "rpm")
    assert found["verdict"] == "chatter"
    assert found["speed_rpm"] == pytest.approx(SPEED_RPM, rel=0.001)


@pytest.mark.parametrize(
    "begins", [0.5, np.linspace(1, SPEED_RPM, 20480)], ids=["creeps", "runs up"]
)
def test_a_spindle_that_creeps_or_runs_up_leaves_the_verdict(begins: Any, tmp_path: Path) -> None:
    cut = recorded(tmp_path / "cut.csv", "time", 1.0, 743.0)
    signal = np.r_[np.zeros(20480), np.loadtxt(cut, delimiter=",", skiprows=1)[:, 1]]
    speed = np.full(len(signal), SPEED_RPM, float)
    speed[:20480], speed[30000] = begins, 1e9  # and one value that is none
    np.savetxt(cut, np.column_stack([np.arange(len(signal)) / RATE, signal, speed]),
               delimiter=",", header="time,acc,rpm", comments="", fmt="%.9g")  # fmt: skip
    found, text = judged(cut, "--speed", "rpm")
    assert found["verdict"] == "chatter"
    assert found["begins_s"] == pytest.approx(4.0, abs=0.1)
    assert found["speed_rpm"] == pytest.approx(SPEED_RPM, rel=0.0005)
    assert "of 7.0 s: the rest has gaps, or a spindle that stands" in text


def test_a_speed_that_is_never_above_0_is_said_in_a_sentence(tmp_path: Path) -> None:
    file = recorded(tmp_path / "cut.csv", "time", 1.0, 743.0)
    head, *rows = file.read_text().splitlines()
    file.write_text("\n".join([f"{head},rpm", *(f"{row},0" for row in rows)]))
    done = CliRunner().invoke(app, ["chatter", str(file), "--teeth", "3", "--speed", "rpm"])
    assert done.exit_code == 2
    assert "no value above 0" in " ".join(done.output.split())


def of_a_file(verdict: RecordedChatter) -> JudgedFile:
    part = Stretch(verdict=verdict, begins_s=0.0, seconds=3.0)
    return JudgedFile(stretches=[part], channels=["acc"], file_seconds=3.0)


def test_the_json_has_none_for_a_number_that_is_not_finite() -> None:
    unknown = RecordedChatter(
        verdict="not decided", why="", speed_rpm=np.nan, tooth_passing_Hz=np.nan,
        frequency=np.zeros(0), spectrum=np.zeros(0),
    )  # fmt: skip
    assert document(of_a_file(unknown))["speed_rpm"] is None


def test_the_begin_counts_from_the_recording_not_from_its_longest_stretch(tmp_path: Path) -> None:
    t = np.arange(round(6 * RATE)) / RATE
    noise = np.random.default_rng(1).standard_normal(len(t))
    signal = np.sin(2 * np.pi * SPEED_RPM / 60 * TEETH * t) + 0.05 * noise
    signal += np.where(t > 4.0, np.sin(2 * np.pi * 743.0 * t), 0.0)
    kept = (t < 1.0) | (t > 2.0)  # the recorder paused for a second
    file = tmp_path / "cut.csv"
    np.savetxt(file, np.column_stack([100.0 + t, signal])[kept], delimiter=",", comments="",
               header="time,acc", fmt="%.9g")  # fmt: skip
    found, text = judged(file, "--speed", str(SPEED_RPM))
    assert found["begins_s"] == pytest.approx(4.0, abs=0.05)
    assert f"from {found['begins_s']:.2f} s on, loudest in acc" in text
    assert found["seconds_in_cut"] == pytest.approx(4.0, abs=0.1)
    assert "judged 5.0 of 6.0 s" in text and "of 2 stretches that of 2.00 to 6.00 s" in text
    assert [one["verdict"] for one in found["stretches"]] == ["stable", "chatter"]
    assert "of the cut or more agree with it" in text


def test_no_begin_is_printed_where_none_is_known() -> None:
    locked = RecordedChatter(
        verdict="chatter", why="", kind="quasi-periodic", frequency_Hz=743.0, speed_rpm=6000.0,
        tooth_passing_Hz=300.0, frequency=np.zeros(0), spectrum=np.zeros(0),
    )  # fmt: skip
    assert not any("from" in line for line in said(of_a_file(locked)))


def test_the_unit_in_a_name_says_that_a_channel_is_an_acceleration(tmp_path: Path) -> None:
    t = np.arange(round(3 * RATE)) / RATE
    noise = np.random.default_rng(1).standard_normal(len(t))
    signal = np.sin(2 * np.pi * SPEED_RPM / 60 * TEETH * t) + 0.05 * noise
    signal += 0.3 * np.sin(2 * np.pi * 443.0 * t) + np.sin(2 * np.pi * 1343.0 * t)
    found = {}
    for name in ("acc", "acc [m/s^2]"):
        file = tmp_path / "cut.csv"
        np.savetxt(file, np.column_stack([t, signal]), delimiter=",", header=f"time,{name}",
                   comments="", fmt="%.9g")  # fmt: skip
        found[name] = judged(file, "--speed", str(SPEED_RPM))[0]["frequency_Hz"]
    assert found["acc"] == pytest.approx(1343.0, rel=0.01)
    assert found["acc [m/s^2]"] == pytest.approx(443.0, rel=0.01)  # there the tool moves most


def test_a_rate_that_contradicts_the_files_own_time_is_refused(tmp_path: Path) -> None:
    file = recorded(tmp_path / "cut.csv", "time", 1.0, 743.0)
    words = ["chatter", str(file), "--teeth", "3", "--speed", "6000", "--rate"]
    done = CliRunner().invoke(app, [*words, str(RATE / 2)])
    assert done.exit_code == 2
    assert "by its own time" in " ".join(done.output.split())
    assert CliRunner().invoke(app, [*words, str(RATE)]).exit_code == 3


def test_the_rate_of_a_sound_is_its_own(tmp_path: Path) -> None:
    from scipy.io import wavfile

    t = np.arange(round(3 * 8000.0)) / 8000.0
    signal = np.sin(2 * np.pi * 300.0 * t) + np.sin(2 * np.pi * 743.0 * t)
    signal += 0.05 * np.random.default_rng(1).standard_normal(len(t))
    file = tmp_path / "cut.wav"
    wavfile.write(file, 8000, (8000 * signal).astype(np.int16))
    found, _ = judged(file, "--speed", str(SPEED_RPM))
    assert found["frequency_Hz"] == pytest.approx(743.0, rel=0.01)
    done = CliRunner().invoke(app, ["chatter", str(file), "--teeth", "3", "--speed", "6000",
                                    "--rate", "4000"])  # fmt: skip
    assert done.exit_code == 2 and "by its own time" in " ".join(done.output.split())


def test_a_speed_without_lines_is_the_stated_one(tmp_path: Path) -> None:
    file = recorded(tmp_path / "cut.csv", "time", 1.0, 743.0)
    found, text = judged(file, "--speed", "5371")
    assert found["verdict"] == "not decided" and "speed 5371 rev/min as stated" in text


def test_each_steady_stretch_is_judged_and_the_gravest_verdict_is_that_of_the_file(
    tmp_path: Path,
) -> None:
    """A long stable cut, a pause, and a short one with chatter at half of the speed."""
    t = np.arange(round(12 * RATE)) / RATE
    slow, air = t > 9.0, (t > 7.0) & (t <= 9.0)
    rpm = np.where(slow, SPEED_RPM / 2, np.where(air, 0.0, SPEED_RPM))
    signal = np.where(air, 0.0, np.sin(2 * np.pi * rpm / 60 * TEETH * t))
    signal += np.where(slow, np.sin(2 * np.pi * 770.0 * t), 0.0)
    signal += 0.05 * np.random.default_rng(1).standard_normal(len(t))
    file = tmp_path / "cut.csv"
    np.savetxt(file, np.column_stack([t, signal, rpm]), delimiter=",", comments="",
               header="time,acc,rpm", fmt="%.9g")  # fmt: skip
    found, text = judged(file, "--speed", "rpm")
    assert found["verdict"] == "chatter" and found["frequency_Hz"] == pytest.approx(770.0, rel=0.01)
    assert [(one["verdict"], round(one["speed_rpm"] / 100)) for one in found["stretches"]] == [
        ("stable", 60), ("chatter", 30),
    ]  # fmt: skip
    assert found["stretches"][1]["begins_s"] == pytest.approx(9.0, abs=0.01)
    assert "0.00 to 7.00 s, 6000 rev/min: stable" in text and "quasi-periodic" in text
    assert "Hopf" not in text


@pytest.mark.parametrize("off", [-0.012, -0.002, 0.0013, 0.009])
def test_the_speed_by_its_lines_is_that_of_the_teeth(off: float, tmp_path: Path) -> None:
    t = np.arange(round(3 * RATE)) / RATE
    actual = SPEED_RPM * (1 + off)
    noise = np.random.default_rng(2).standard_normal(len(t))
    signal = np.sin(2 * np.pi * actual / 60 * TEETH * t) + 0.1 * noise
    file = tmp_path / "cut.csv"
    np.savetxt(file, np.column_stack([t, signal]), delimiter=",", header="time,acc", comments="",
               fmt="%.9g")  # fmt: skip
    found, _ = judged(file, "--speed", str(SPEED_RPM))
    assert found["verdict"] == "stable"
    assert found["speed_rpm"] == pytest.approx(actual, rel=3e-4)


def test_the_page_shows_the_spectrum_with_its_lines_and_every_stretch(tmp_path: Path) -> None:
    file, page = recorded(tmp_path / "cut.csv", "time", 1.0, 743.0), tmp_path / "cut.html"
    judged(file, "--speed", str(SPEED_RPM), "--page", str(page))
    text = page.read_text()
    assert "chatter, 743.0" in text and "1 × tooth passing" in text and "17 × tooth" not in text
    assert "Every steady stretch" in text and "6000 rev/min" in text.replace("\u202f", "")
    done = CliRunner().invoke(app, ["chatter", str(file), "--teeth", "3", "--speed", "6000",
                                    "--page", str(file)])  # fmt: skip
    assert done.exit_code == 2 and "is read: name another file" in " ".join(done.output.split())


def test_a_file_without_a_row_is_refused_in_a_sentence(tmp_path: Path) -> None:
    file = tmp_path / "x.csv"
    file.write_text("time,acc\n")
    done = CliRunner().invoke(app, ["chatter", str(file), "--teeth", "3", "--speed", "6000"])
    assert done.exit_code == 2 and "Traceback" not in done.output
    assert str(file) in "".join(done.output.split()) and "zero-size" not in done.output
