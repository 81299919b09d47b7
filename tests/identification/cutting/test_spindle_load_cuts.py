"""Which readings count as which cut: against where the tool was, and the engagement's geometry."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.tool import Tool
from pipeline.gcode.setup import Setup
from pipeline.identification.cutting.spindle_load_cuts import cut_log
from pipeline.identification.cutting.spindle_load_lines import Lines, program_lines
from pipeline.identification.cutting.spindle_load_log import read_log
from pipeline.identification.cutting.spindle_load_records import LoadCut
from pipeline.identification.cutting.spindle_power import cut_rates
from tests.identification.cutting.spindle_load_logs import (
    CLEAR,
    DT,
    LENGTH,
    PROGRAM,
    RADIUS,
    Bench,
    Slot,
    load_records,
    program_and_trace,
    said,
    write_bench,
)

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
