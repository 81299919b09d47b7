"""From logs and a program to no-load power and specific force: a known truth comes back."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.identification.cutting.spindle_load import spindle_load
from pipeline.identification.cutting.spindle_load_records import SpindleLoadRecords
from pipeline.parameters import ParametersError, structure
from tests.identification.cutting.spindle_load_logs import (
    CUT_LOG,
    FREE_LOG,
    K_TC,
    K_TE,
    NO_LOAD,
    PROGRAM,
    SLOTS,
    Bench,
    Slot,
    free_trace,
    load_records,
    program_and_trace,
    said,
    stock,
    write_bench,
)
from tests.submodels.control.polled_logs import Said

BENCH = Bench()


def found(folder: Path, bench: Bench, logs: dict[str, Said] | None = None, **changes: Any) -> Any:
    signals, raw = write_bench(folder, bench, **(logs or {}))
    return spindle_load(signals, raw, load_records(bench, **changes), 0.5)


def work() -> float:
    """Power of the slots over what they remove [N/mm^2], K_tc + K_te pi / (2 f_z) of each."""
    rows = [(s.depth * s.feed * s.override, s.feed * s.override / s.speed / 3) for s in SLOTS]
    power = sum(rate * (K_TC / 1e6 + K_TE / 1e3 * np.pi / 2 / f_z) for rate, f_z in rows)
    return power / sum(rate for rate, _ in rows)


def holds(p: dict[str, Any], truth: float) -> bool:
    low, high = p["interval_95"]
    return bool(low <= truth <= high)


def true_power(speed_rpm: float) -> float:
    return float(np.polynomial.polynomial.polyval(speed_rpm / 60, NO_LOAD))


@pytest.mark.parametrize(
    "bench",
    [
        BENCH,
        replace(BENCH, hold=(3, 4.0)),
        replace(BENCH, slots=[replace(s, override=0.7) for s in SLOTS]),
        replace(BENCH, poll=0.5, slots=[replace(s, feed=s.feed * 0.6) for s in SLOTS]),
    ],
    ids=["as programmed", "feed held in a cut", "override of 70 %", "polled twice a second"],
)
def test_a_fine_meter_gives_the_truth(tmp_path: Path, bench: Bench) -> None:
    """A meter that settles within exp(-1.2 / 0.2) = 0.25 % of its step: half a percent."""
    spindle = found(tmp_path, bench)
    assert spindle["reason"] == ""
    assert spindle["K_tc"]["value"] == pytest.approx(K_TC / 1e6, rel=0.005)
    assert spindle["K_te"]["value"] == pytest.approx(K_TE / 1e3, rel=0.005)
    assert len(spindle["cuts"]) == len(SLOTS)
    for row in spindle["no_load"]["curve"]:
        assert row["power_W"] == pytest.approx(true_power(row["speed_rpm"]), rel=0.02)


def test_specific_force_is_the_power_of_all_cuts_over_what_they_remove(tmp_path: Path) -> None:
    spindle = found(tmp_path, BENCH)
    assert spindle["specific_force"]["value"] == pytest.approx(work(), rel=0.002)
    assert spindle["recordings"] == [FREE_LOG, CUT_LOG]
    assert spindle["found_from"] == {FREE_LOG: "of no-load-run1", CUT_LOG: "of O1-run1"}


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.4])
def test_a_meter_of_whole_percents_has_intervals_that_hold_the_truth(
    tmp_path: Path, noise: float
) -> None:
    """Or says that it does not know.

    Four logs, eight figures each: all but three of 32 may be outside 95 % with a chance of 5 %.
    """
    outside = many = 0
    for seed in range(4):
        bench = Bench(step=1.0, noise=noise, seed=seed, begin=seed / 4)
        spindle = found(tmp_path / str(seed), bench)
        truths = (("specific_force", work()), ("K_tc", K_TC / 1e6), ("K_te", K_TE / 1e3))
        told = [holds(spindle[name], true) for name, true in truths if spindle[name]["determined"]]
        told += [
            abs(row["power_W"] - true_power(row["speed_rpm"])) <= row["half_width_95_W"]
            for row in spindle["no_load"]["curve"]
        ]
        assert "interval_95" in spindle["specific_force"]
        outside, many = outside + told.count(False), many + len(told)
    assert many >= 24 and outside <= 3, f"{outside} of {many}"


def test_a_display_that_stands_still_is_no_more_sure_for_many_readings(tmp_path: Path) -> None:
    """Whole percents without noise: the interval is that of a step, not of its many readings.

    A step is 108 W or so; of some 2 kW of cutting that is a few percent.
    """
    coarse = found(tmp_path / "coarse", Bench(step=1.0))["specific_force"]["interval_95"]
    fine = found(tmp_path / "fine", Bench(step=0.01))["specific_force"]["interval_95"]
    assert coarse[1] - coarse[0] > 20 * (fine[1] - fine[0])


def test_what_a_percent_is_worth_widens_every_interval(tmp_path: Path) -> None:
    signals, raw = write_bench(tmp_path, BENCH)
    known, unsure = (
        spindle_load(signals, raw, load_records(BENCH, scale_error=error), 0.5)
        for error in (0.0, 0.1)
    )
    for name in ("specific_force", "K_tc", "K_te"):
        value, (low, high) = unsure[name]["value"], unsure[name]["interval_95"]
        assert value == known[name]["value"]
        half = (known[name]["interval_95"][1] - known[name]["interval_95"][0]) / 2
        assert (high - low) / 2 == pytest.approx(np.hypot(half, 0.1 * value), rel=1e-3)
    row = unsure["no_load"]["curve"][-1]
    assert row["half_width_95_W"] >= 0.1 * row["power_W"]


def test_without_a_no_load_log_the_ways_through_air_do(tmp_path: Path) -> None:
    """Six seconds of rest between slots: P_0 at their speeds, wide and true."""
    spindle = found(tmp_path, Bench(free=(), rest=6.0), no_load=())
    assert spindle["no_load"]["range_rpm"] == [4500.0, 7500.0]
    assert holds(spindle["specific_force"], work())
    assert holds(spindle["K_te"], K_TE / 1e3)


def test_without_air_enough_nothing_is_determined_and_the_reason_is_said(tmp_path: Path) -> None:
    spindle = found(tmp_path, Bench(free=(), rest=0.1), no_load=(), settle_s=3.0)
    assert len(spindle["recordings"]) == 1
    assert "no_load" not in spindle and "specific_force" not in spindle
    assert "the spindle turns free at 0 settled speed(s)" in spindle["reason"]


def test_without_cuts_the_no_load_power_is_what_there_is(tmp_path: Path) -> None:
    spindle = found(tmp_path, BENCH, cuts=())
    assert spindle["no_load"]["coefficients"]["p2"]["value"] == pytest.approx(NO_LOAD[2], rel=0.02)
    assert "specific_force" not in spindle
    assert "cutting_records.spindle.cuts names no program that cuts" in spindle["reason"]


def test_a_log_without_the_load_is_left_out(tmp_path: Path) -> None:
    told = said(program_and_trace(BENCH)[1], BENCH)
    spindle = found(tmp_path, BENCH, {"O1-run1": {k: v for k, v in told.items() if k != "load"}})
    (left,) = spindle["left_out"]
    assert left["recording"] == CUT_LOG
    assert "has no data item 'load'" in left["reason"] and "feed, line, speed" in left["reason"]
    assert "specific_force" not in spindle and "no_load" in spindle
    assert "has no data item 'load'" in spindle["reason"]


def test_a_log_of_another_program_is_left_out(tmp_path: Path) -> None:
    """Each X as long again, on the same lines."""
    signals, raw = write_bench(tmp_path, BENCH)
    text = (raw / PROGRAM).read_text()
    (raw / PROGRAM).write_text(text.replace("X161.0", "X333.0"))
    (left,) = spindle_load(signals, raw, load_records(BENCH), 0.5)["left_out"]
    assert "O1-run1.txt is not of cutting/O1.nc: in line " in left["reason"]
    assert "mm, the program 344 mm; name the program that ran" in left["reason"]


def test_a_log_with_more_lines_than_the_program_is_left_out(tmp_path: Path) -> None:
    signals, raw = write_bench(tmp_path, BENCH)
    lines = (raw / PROGRAM).read_text().splitlines()[:22]
    (raw / PROGRAM).write_text("\n".join([*lines, "M30", "%"]) + "\n")
    (left,) = spindle_load(signals, raw, load_records(BENCH), 0.5)["left_out"]
    assert "was in line 40, the program's last is 23" in left["reason"]


def test_lines_too_short_to_settle_are_named(tmp_path: Path) -> None:
    """A slot at 75 mm/s lasts 1.9 s; of 1.2 s and 5 readings nothing is left."""
    spindle = found(tmp_path, Bench(slots=[*SLOTS, Slot(7500.0, 4500.0, 1.0)]))
    (note,) = spindle["notes"]
    assert "1 of 7 lines that cut are not used (line 46)" in note
    assert len(spindle["cuts"]) == 6


def test_a_load_that_was_unavailable_does_not_count(tmp_path: Path) -> None:
    """Lost in the middle of the first slot for three seconds: the value before does not go on."""
    told = said(program_and_trace(BENCH)[1], BENCH)
    begin = next(t for t, line in told["line"] if line == 10) + 5.0
    lost: list[tuple[float, float | str]] = [
        (t, v) for t, v in told["load"] if not begin < t < begin + 3.0
    ]
    held = [v for t, v in told["load"] if t <= begin + 3.0][-1]
    told["load"] = sorted(
        [*lost, (begin, "UNAVAILABLE"), (begin + 3.0, held)], key=lambda one: one[0]
    )
    spindle = found(tmp_path / "lost", BENCH, {"O1-run1": told})
    whole = found(tmp_path / "whole", BENCH)
    before, after = (
        min(s["cuts"], key=lambda c: c["speed_rpm"])["samples"] for s in (whole, spindle)
    )
    assert 3.0 / 0.2 < before - after < 3.0 / 0.1
    assert spindle["K_tc"]["value"] == pytest.approx(K_TC / 1e6, rel=0.005)


def test_a_program_that_jumps_is_refused(tmp_path: Path) -> None:
    signals, raw = write_bench(tmp_path, BENCH)
    text = (raw / PROGRAM).read_text().replace("M5\nM30\n", "M98 P77\nM5\nM30\nO77\nG4 P10\nM99\n")
    (raw / PROGRAM).write_text(text)
    (left,) = spindle_load(signals, raw, load_records(BENCH), 0.5)["left_out"]
    assert "O1.nc jumps (subprograms or loops)" in left["reason"]


def test_a_missing_program_a_copy_and_a_log_asked_for_twice_are_said(tmp_path: Path) -> None:
    free = said(free_trace(BENCH), BENCH)
    signals, raw = write_bench(tmp_path, BENCH, **{"no-load-run2": free})
    manifest = signals / "manifest.json"
    manifest.write_text(manifest.read_text().replace("of no-load-run2", "of no-load-run1"))
    (raw / PROGRAM).unlink()
    both = load_records(BENCH, no_load=("cutting/no-load-*",))
    reasons = {
        one["recording"]: one["reason"] for one in spindle_load(signals, raw, both, 0.5)["left_out"]
    }
    assert "cutting/O1.nc does not exist: put the program that ran there" in reasons[CUT_LOG]
    assert reasons["cutting/no-load-run2.txt"].endswith(f"is a copy of {FREE_LOG}: record another")
    with pytest.raises(ValueError, match=r"O1-run1\.txt fits two patterns"):
        spindle_load(signals, raw, load_records(BENCH, no_load=("cutting/*",)), 0.5)
    with pytest.raises(ValueError, match=r"fits cutting_records\.spindle\.no_load, 'idle/\*'"):
        spindle_load(signals, raw, load_records(BENCH, no_load=("idle/*",)), 0.5)


def test_no_records_say_nothing(tmp_path: Path) -> None:
    assert spindle_load(tmp_path, tmp_path, None, 0.5) == {}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cuts": [], "no_load": []}, "names no log"),
        ({"settle_s": 0.0}, "settle_s = 0.0 is out of its range, 0.1 to 60"),
        ({"scale_error": 1.5}, "scale_error = 1.5 is out of its range"),
        ({"items": {"line": "a", "speed": "b", "load": "a", "feed": "c"}}, "are a, b, a, c"),
    ],
)
def test_sections_that_cannot_be_are_refused(change: dict[str, Any], words: str) -> None:
    section = {
        "items": {"line": "ln", "speed": "S1n", "load": "S1load", "feed": "vpath"},
        "drive": {"rated_power_kW": 12, "base_speed_rpm": 3000, "top_speed_rpm": 12000},
        "no_load": ["free.txt"],
    }
    assert structure({"it": section}, "it", SpindleLoadRecords).settle_s == 1.5
    with pytest.raises(ParametersError, match=words):
        structure({"it": section | change}, "it", SpindleLoadRecords)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"stock": "box:0,1"}, "has not the 6 numbers"),
        (
            {"tools": {1: {"kind": "ball", "diameter_mm": 6, "flutes": 2}}},
            "tool 1 of a.nc is a ball",
        ),
        ({"resolution_mm": 0.0}, "resolution_mm = 0.0 is out of its range"),
    ],
)
def test_cuts_that_cannot_be_are_refused(change: dict[str, Any], words: str) -> None:
    cut = {"log": "a", "program": "a.nc", "stock": stock(BENCH),
           "tools": {1: {"kind": "flat", "diameter_mm": 6, "flutes": 2}}} | change  # fmt: skip
    section = {
        "items": {"line": "ln", "speed": "S1n", "load": "S1load", "feed": "vpath"},
        "drive": {"rated_power_kW": 12, "base_speed_rpm": 3000, "top_speed_rpm": 12000},
        "cuts": [cut],
    }
    with pytest.raises(ParametersError, match=words):
        structure({"it": section}, "it", SpindleLoadRecords)
