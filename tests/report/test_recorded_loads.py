"""Predicted loads beside those of a log: the word follows from the two intervals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from report_folders import empty_machine
from test_cut_page import BLOCK, made

from pipeline.charts.sources import SourceRegistry
from pipeline.report.cut.recorded import recorded_section
from pipeline.report.programs.simulated import Program
from pipeline.report.work import Cycle, Work
from pipeline.schema.program_cut import ForceInterval
from pipeline.schema.store import write_json
from pipeline.schema.twin_state import MANIFEST, StateDay, TwinState, day_path, write_day

DAY = "2026-01-05"
START = pd.Timestamp(f"{DAY}T10:00:00Z")
FORCE = ForceInterval(
    tool=4, name="mill", source="", peak_load_N=1.0, peak_load_low_N=1.0, peak_load_high_N=1.0,
    mean_load_N=300.0, mean_load_low_N=267.0, mean_load_high_N=333.0,
)  # fmt: skip


def program(**changes) -> Program:
    """A cut whose two blocks take 2 and 1 kW for 3 s and 1 s: 1.75 kW within 11 %."""
    one = made()
    blocks = (replace_block(power_kW=2.0, in_material_s=3.0),
              replace_block(power_kW=1.0, in_material_s=1.0))  # fmt: skip
    cut = replace(one.cut, blocks=blocks, forces=(FORCE,), **changes)
    return replace(one, cut=cut, summary=replace(one.summary, program="O7", file="parts/O7.nc"))


def replace_block(**changes):
    from pipeline.schema.program_cut import CutBlock

    values = {name: getattr(BLOCK, name) for name in CutBlock.__dataclass_fields__}
    return CutBlock(**(values | changes))


def section(root: Path, *, watts: float | None, one: Program, name: str = "o7", tool: str = "T4"):
    """Section of a machine whose log ran a program for 20 s, half of it in the cut."""
    folders = empty_machine(root, "m", twin_state=root / "state")
    time = pd.date_range(START, periods=20, freq="1s", unit="ns")
    power = np.full(20, np.nan if watts is None else watts)
    write_day(time, {
        "program": [name] * 20, "tool_number": [tool] * 20, "mode": ["cut", "air"] * 10,
        "cutting_power_estimated": np.where(np.arange(20) % 2, 9e9, power),
        "cutting_power_low": 0.95 * power, "cutting_power_high": 1.05 * power,
    }, day_path(folders.twin_state, DAY))  # fmt: skip
    reason = {"cutting_power": "the machine logs no spindle load"} if watts is None else {}
    day = StateDay(role="training", seconds=20.0, known_s={}, unknown=reason)
    write_json(TwinState(bundle="", submodels={}, period_s=1.0, days={DAY: day}),
               folders.twin_state / MANIFEST)  # fmt: skip
    cycle = Cycle(program=name, part="", start=START.value, end=START.value + 20 * 10**9,
                  active=20.0, stopped=0.0, running=1.0, complete=True)  # fmt: skip
    work = Work(folders=folders, shelf=None, days=[], cycles=[cycle], state_files=[])
    found = recorded_section(one, folders, work, SourceRegistry())
    return found.blocks[0].rows[0]


@pytest.mark.parametrize(
    ("watts", "word", "status"),
    [(1750.0, "within", "passed"), (2000.0, "within", "passed"),
     (2100.0, "higher than predicted", "attention"), (1400.0, "lower than predicted", "attention")],
)  # fmt: skip
def test_a_word_says_where_the_log_differs_by_more_than_the_interval(tmp_path, watts, word, status):
    row = section(tmp_path, watts=watts, one=program())
    assert (row[-1].text, row[-1].status) == (word, status)
    texts = [cell.text for cell in row]
    assert texts[1] == "1.75" and float(texts[3]) == pytest.approx(watts / 1000, rel=1e-3)
    assert texts[2].split(" to ") == ["1.56", "1.94"] and "10" in texts[5]  # 10 s of the cut


@pytest.mark.parametrize(
    ("changes", "why"),
    [({"name": "O8"}, "has not cut a program of this name"),
     ({"watts": None}, "the machine logs no spindle load"),
     ({"tool": "T5"}, "its load was steady nowhere in the cut")],
)  # fmt: skip
def test_what_cannot_be_compared_says_why(tmp_path, changes, why):
    row = section(tmp_path, **({"watts": 1750.0, "one": program()} | changes))
    assert row[-1].text.startswith("not comparable because") and why in row[-1].text
    assert row[3].text == "–"


def test_without_an_interval_there_is_no_word(tmp_path):
    bare = program()
    bare = replace(bare, cut=replace(bare.cut, forces=()))
    assert "has no interval" in section(tmp_path, watts=1750.0, one=bare)[-1].text


def test_a_program_without_a_cut_has_no_such_section(tmp_path):
    work = Work(folders=None, shelf=None, days=[], cycles=None, state_files=[])
    folders, shelf = empty_machine(tmp_path, "m"), SourceRegistry()
    assert recorded_section(replace(program(), cut=None), folders, work, shelf) is None
    one = recorded_section(program(), folders, work, shelf)
    assert "has not cut a program of this name" in one.blocks[0].rows[0][-1].text
