"""Logs of a load against the cut of a program, and the specific force that they recover."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.tool import Tool
from pipeline.gcode.setup import Setup
from pipeline.parameters import ParametersError, structure
from pipeline.schema.model import Parameter
from pipeline.submodels.cutting.settings import LoadCut, SpindleLoadRecords
from pipeline.submodels.cutting.spindle_load.identify import (
    SpindleLoadResult,
    identify_spindle_load,
    load_logs,
)
from pipeline.submodels.cutting.spindle_load.readings import Lines, cut_log, program_lines, read_log
from tests.submodels.control.polled_logs import Said
from tests.submodels.cutting.spindle_load_logs import (
    CLEAR,
    CUT_LOG,
    DT,
    FREE_LOG,
    K_TC,
    K_TE,
    LENGTH,
    NO_LOAD,
    PROGRAM,
    RADIUS,
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
from tests.submodels.cutting.test_spindle_power import cut_rates

TOOL = Tool(kind="flat", diameter_mm=12.0, flutes=3)
HEAD = "G21 G17 G40 G80 G90 G54\nT1 M6\nS6000 M3\n"
CELL = 0.5e-3


def lines_of(folder: Path, body: str, tool: Tool = TOOL) -> Lines:
    (folder / "p.nc").write_text("%\nO1\n" + HEAD + body + "M30\n%\n")
    cut = LoadCut(log="", program="p.nc", stock="box:0,100,0,60,-20,0", tools={1: tool})
    return program_lines(folder, cut, Setup())


@pytest.mark.parametrize(
    ("y", "x", "entry", "leave"),
    [(30.0, 130.0, 0.0, np.pi), (-3.0, 130.0, 0.0, np.pi / 3), (-3.0, -30.0, 2 * np.pi / 3, np.pi)],
    ids=["slot", "up", "down"],
)
def test_the_engagement_of_a_line_is_that_of_the_closed_form(
    tmp_path: Path, y: float, x: float, entry: float, leave: float
) -> None:
    """3 mm of a tool of 12 mm wide, or all of it; the map's 0.5 mm make up to 1 % of the arc.

    The whole of it is met from the tool's centre over the edge (the slot's from there on, a
    shoulder's corner before), a cell of the map and its neighbour early or late.
    """
    lines = lines_of(tmp_path, f"G0 X{100 - x} Y{y}\nG0 Z-4\nG1 X{x} F1440\nG0 Z25\n")
    stretch = max(lines.stretches[8], key=lambda one: one.end - one.begin)
    removal, edge = cut_rates(
        flutes=3, diameter=12e-3, n=100.0, f_z=24e-3 / 300, a_p=4e-3, phi_st=entry, phi_ex=leave
    )
    assert stretch.area * 24e-3 == pytest.approx(removal, rel=0.01)
    assert stretch.edge * 100.0 == pytest.approx(edge, rel=0.01)
    assert 0.024 - 2 * CELL < stretch.begin < 0.030 + 6 * CELL
    assert 0.124 - 6 * CELL < stretch.end < 0.130 + 2 * CELL
    assert lines.length[8] == pytest.approx(0.160, abs=1e-9)
    assert lines.cuts.tolist() == [i == 8 for i in range(len(lines.cuts))]


def test_a_line_with_two_depths_has_two_stretches_and_a_ramp_none(tmp_path: Path) -> None:
    """A step milled before halves the depth from X50 on; plunges and ramps are no stretches."""
    body = (
        "G0 X130 Y30\nG0 Z-2\nG1 X50 F1000\nG0 Z25\n"  # the step, lines 6 to 9
        "G0 X-20\nG0 Z-4\nG1 X130 F1000\nG0 Z25\n"  # over both, line 12
        "G0 X20 Y8\nG0 Z1\nG1 X80 Z-3 F500\nG0 Z25\n"  # a ramp, line 16
    )
    lines = lines_of(tmp_path, body)
    deep, shallow = sorted(
        sorted(lines.stretches[12], key=lambda one: one.begin - one.end)[:2],
        key=lambda one: one.begin,
    )
    assert deep.area == pytest.approx(12e-3 * 4e-3, rel=0.01)
    assert shallow.area == pytest.approx(12e-3 * 2e-3, rel=0.01)
    assert deep.end < 0.020 + 0.050 + 2 * CELL < 0.020 + 0.056 - 6 * CELL < shallow.begin + 0.006
    assert 16 not in lines.stretches and lines.cuts[16]


@settings(max_examples=15, deadline=None)
@given(
    poll=st.floats(0.06, 0.4),
    begin=st.floats(0.0, 1.0),
    feed=st.floats(400.0, 2500.0),
    override=st.floats(0.5, 1.2),
    seed=st.integers(0, 99),
)
def test_no_reading_in_a_cut_was_taken_at_its_entry_or_exit(
    tmp_path_factory: pytest.TempPathFactory, poll: float, begin: float, feed: float,
    override: float, seed: int,
) -> None:  # fmt: skip
    """The place of the tool is known: wholly engaged from X0 to the last radius of the blank.

    The engine takes engagements whose limits lie within a cell of 0.5 mm for the same: that is from
    2.4 mm before a slot's arc is whole.  What polls and sums leave unsure is left out by itself.
    """
    bench = Bench(slots=[Slot(6000.0, feed, 3.0, override)], poll=poll, begin=begin, seed=seed)
    signals, raw = write_bench(tmp_path_factory.mktemp("log"), bench)
    records = load_records(bench)
    lines = program_lines(raw, records.cuts[0], Setup())
    log = read_log(signals / "observations/O1-run1.parquet", records.items, "O1-run1", cuts=True)
    labelled = cut_log(log, lines, settle_s=1.0, name="O1-run1", program=PROGRAM)
    assert labelled.cut is not None and labelled.removal is not None
    cut = (labelled.cut >= 0) & (labelled.removal > 0)
    _, trace = program_and_trace(bench)
    moved = np.cumsum(trace.column("feed") * (trace.column("line") == 10)) * DT - RADIUS - CLEAR
    first = said(trace, bench)["exec"][0][0]
    assert isinstance(first, float)
    polled = log.times[cut] + first  # the log's time begins at its first poll
    at = np.clip((polled / DT).astype(int), 0, len(moved) - 1)
    assert cut.sum() > 0.8 * ((LENGTH - RADIUS) / (feed * override / 60) / log.period) - 12
    same = np.sqrt(2 * RADIUS * 0.5 - 0.5**2)
    assert moved[at].min() > -same and moved[at].max() < LENGTH - RADIUS + same
    np.testing.assert_allclose(
        labelled.removal[cut], 12e-3 * 3e-3 * feed * override / 60e3, rtol=0.02
    )


BENCH = Bench()


def identified(signals: Path, raw: Path, records: SpindleLoadRecords) -> SpindleLoadResult:
    files = json.loads((signals / "manifest.json").read_text())["files"]
    return identify_spindle_load(load_logs(files, records, signals, raw), records, 0.5)


def found(
    folder: Path, bench: Bench, logs: dict[str, Said] | None = None, **changes: Any
) -> SpindleLoadResult:
    signals, raw = write_bench(folder, bench, **(logs or {}))
    return identified(signals, raw, load_records(bench, **changes))


def work() -> float:
    """Power of the slots over what they remove [N/mm^2], K_tc + K_te pi / (2 f_z) of each."""
    rows = [(s.depth * s.feed * s.override, s.feed * s.override / s.speed / 3) for s in SLOTS]
    power = sum(rate * (K_TC / 1e6 + K_TE / 1e3 * np.pi / 2 / f_z) for rate, f_z in rows)
    return power / sum(rate for rate, _ in rows)


def holds(p: Parameter, truth: float) -> bool:
    assert p.interval_95 is not None
    low, high = p.interval_95
    return low <= truth <= high


def true_power(speed_rpm: float) -> float:
    return float(np.polynomial.polynomial.polyval(speed_rpm / 60, NO_LOAD))


@pytest.mark.parametrize(
    "bench",
    [
        replace(BENCH, hold=(3, 4.0), slots=[replace(s, override=0.7) for s in SLOTS]),
        pytest.param(
            replace(BENCH, poll=0.5, slots=[replace(s, feed=s.feed * 0.6) for s in SLOTS]),
            marks=pytest.mark.proof,
        ),
    ],
    ids=["feed held in a cut, override of 70 %", "polled twice a second"],
)
def test_a_fine_meter_gives_the_truth(tmp_path: Path, bench: Bench) -> None:
    """A meter that settles within exp(-1.2 / 0.2) = 0.25 % of its step: half a percent."""
    spindle = found(tmp_path, bench)
    assert spindle.facts.reason == ""
    assert spindle.parameters["K_tc"].value == pytest.approx(K_TC / 1e6, rel=0.005)
    assert spindle.parameters["K_te"].value == pytest.approx(K_TE / 1e3, rel=0.005)
    assert len(spindle.facts.cuts) == len(SLOTS)
    for row in spindle.facts.curve:
        assert row.power_W == pytest.approx(true_power(row.speed_rpm), rel=0.02)


def test_specific_force_is_the_power_of_all_cuts_over_what_they_remove(tmp_path: Path) -> None:
    spindle = found(tmp_path, BENCH)
    assert spindle.parameters["specific_force"].value == pytest.approx(work(), rel=0.002)
    assert spindle.parameters["K_tc"].value == pytest.approx(K_TC / 1e6, rel=0.005)
    assert spindle.facts.recordings == (FREE_LOG, CUT_LOG)


def test_what_a_percent_is_worth_widens_every_interval(tmp_path: Path) -> None:
    signals, raw = write_bench(tmp_path, BENCH)
    known, unsure = (
        identified(signals, raw, load_records(BENCH, scale_error=error)) for error in (0.0, 0.1)
    )
    for name in ("specific_force", "K_tc", "K_te"):
        value, (low, high) = unsure.parameters[name].value, unsure.parameters[name].interval_95
        assert value == known.parameters[name].value
        half = (known.parameters[name].interval_95[1] - known.parameters[name].interval_95[0]) / 2
        assert (high - low) / 2 == pytest.approx(np.hypot(half, 0.1 * value), rel=1e-3)
    row = unsure.facts.curve[-1]
    assert row.half_width_95_W >= 0.1 * row.power_W


def test_without_a_no_load_log_the_ways_through_air_do(tmp_path: Path) -> None:
    """Six seconds of rest between slots: P_0 at their speeds, wide and true."""
    spindle = found(tmp_path, Bench(free=(), rest=6.0), no_load=())
    assert spindle.facts.range_rpm == (4500.0, 7500.0)
    assert holds(spindle.parameters["specific_force"], work())
    assert holds(spindle.parameters["K_te"], K_TE / 1e3)


def test_without_air_enough_nothing_is_determined_and_the_reason_is_said(tmp_path: Path) -> None:
    spindle = found(tmp_path, Bench(free=(), rest=0.1), no_load=(), settle_s=3.0)
    assert len(spindle.facts.recordings) == 1
    assert not spindle.parameters
    assert "the spindle turns free at 0 settled speed(s)" in spindle.facts.reason


def test_without_cuts_the_no_load_power_is_what_there_is(tmp_path: Path) -> None:
    spindle = found(tmp_path, BENCH, cuts=())
    assert spindle.parameters["p2"].value == pytest.approx(NO_LOAD[2], rel=0.02)
    assert "specific_force" not in spindle.parameters
    assert "cutting_records.spindle.cuts names no program that cuts" in spindle.facts.reason


def test_a_log_without_the_load_is_left_out(tmp_path: Path) -> None:
    told = said(program_and_trace(BENCH)[1], BENCH)
    spindle = found(tmp_path, BENCH, {"O1-run1": {k: v for k, v in told.items() if k != "load"}})
    (left,) = spindle.facts.left_out
    assert left.case == CUT_LOG
    assert "has no data item 'load'" in left.reason and "feed, line, speed" in left.reason
    assert "specific_force" not in spindle.parameters and "p0" in spindle.parameters
    assert "has no data item 'load'" in spindle.facts.reason


def test_a_log_of_another_program_is_left_out(tmp_path: Path) -> None:
    """Each X as long again, on the same lines."""
    signals, raw = write_bench(tmp_path, BENCH)
    text = (raw / PROGRAM).read_text()
    (raw / PROGRAM).write_text(text.replace("X161.0", "X333.0"))
    (left,) = identified(signals, raw, load_records(BENCH)).facts.left_out
    assert "O1-run1.txt is not of cutting/O1.nc: in line " in left.reason
    assert "mm, the program 344 mm; name the program that ran" in left.reason


def test_a_log_with_more_lines_than_the_program_is_left_out(tmp_path: Path) -> None:
    signals, raw = write_bench(tmp_path, BENCH)
    lines = (raw / PROGRAM).read_text().splitlines()[:22]
    (raw / PROGRAM).write_text("\n".join([*lines, "M30", "%"]) + "\n")
    (left,) = identified(signals, raw, load_records(BENCH)).facts.left_out
    assert "was in line 40, the program's last is 23" in left.reason


def test_lines_too_short_to_settle_are_named(tmp_path: Path) -> None:
    """A slot at 75 mm/s lasts 1.9 s; of 1.2 s and 5 readings nothing is left."""
    spindle = found(tmp_path, Bench(slots=[*SLOTS, Slot(7500.0, 4500.0, 1.0)]))
    (note,) = spindle.facts.notes
    assert "1 of 7 lines that cut are not used (line 46)" in note
    assert len(spindle.facts.cuts) == 6


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
    before, after = (min(s.facts.cuts, key=lambda c: c.speed_rpm).samples for s in (whole, spindle))
    assert 3.0 / 0.2 < before - after < 3.0 / 0.1
    assert spindle.parameters["K_tc"].value == pytest.approx(K_TC / 1e6, rel=0.005)


def test_a_program_that_jumps_is_refused(tmp_path: Path) -> None:
    signals, raw = write_bench(tmp_path, BENCH)
    text = (raw / PROGRAM).read_text().replace("M5\nM30\n", "M98 P77\nM5\nM30\nO77\nG4 P10\nM99\n")
    (raw / PROGRAM).write_text(text)
    (left,) = identified(signals, raw, load_records(BENCH)).facts.left_out
    assert "O1.nc jumps (subprograms or loops)" in left.reason


def test_a_missing_program_a_copy_and_a_log_asked_for_twice_are_said(tmp_path: Path) -> None:
    free = said(free_trace(BENCH), BENCH)
    signals, raw = write_bench(tmp_path, BENCH, **{"no-load-run2": free})
    manifest = signals / "manifest.json"
    manifest.write_text(manifest.read_text().replace("of no-load-run2", "of no-load-run1"))
    (raw / PROGRAM).unlink()
    both = load_records(BENCH, no_load=("cutting/no-load-*",))
    reasons = {one.case: one.reason for one in identified(signals, raw, both).facts.left_out}
    assert "cutting/O1.nc does not exist: put the program that ran there" in reasons[CUT_LOG]
    assert reasons["cutting/no-load-run2.txt"].endswith(f"is a copy of {FREE_LOG}: record another")
    with pytest.raises(ValueError, match=r"O1-run1\.txt fits two patterns"):
        identified(signals, raw, load_records(BENCH, no_load=("cutting/*",)))
    with pytest.raises(ValueError, match=r"fits cutting_records\.spindle\.no_load, 'idle/\*'"):
        identified(signals, raw, load_records(BENCH, no_load=("idle/*",)))


LOG_SECTION: dict[str, Any] = {
    "items": {"line": "ln", "speed": "S1n", "load": "S1load", "feed": "vpath"},
    "drive": {"rated_power_kW": 12, "base_speed_rpm": 3000, "top_speed_rpm": 12000},
    "no_load": ["free.txt"],
}
CUT_SECTION: dict[str, Any] = {
    "log": "a", "program": "a.nc", "stock": stock(BENCH),
    "tools": {1: {"kind": "flat", "diameter_mm": 6, "flutes": 2}},
}  # fmt: skip
A_BALL = {"tools": {1: {"kind": "ball", "diameter_mm": 6, "flutes": 2}}}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"cuts": [], "no_load": []}, "names no log"),
        ({"items": {"line": "a", "speed": "b", "load": "a", "feed": "c"}}, "are a, b, a, c"),
        ({"cuts": [CUT_SECTION | {"stock": "box:0,1"}]}, "has not the 6 numbers"),
        ({"cuts": [CUT_SECTION | A_BALL]}, "tool 1 of a.nc is a ball"),
    ],
)
def test_sections_that_cannot_be_are_refused(change: dict[str, Any], words: str) -> None:
    assert structure({"it": LOG_SECTION}, "it", SpindleLoadRecords).settle_s == 1.5
    with pytest.raises(ParametersError, match=words):
        structure({"it": LOG_SECTION | change}, "it", SpindleLoadRecords)
