"""The page of a cut: every figure and table of its document, nothing else, all text escaped."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.report.cut.page import write_cut_page
from pipeline.report.cut.tables import share, spans_of
from pipeline.report.programs.panels import Panel
from pipeline.report.programs.simulated import Program
from pipeline.schema.program_cut import (
    BasisRow,
    Blank,
    CutCost,
    CutWarning,
    DriveCurve,
    DrivePoint,
    EngagementTrace,
    LeftOutMoves,
    LoadLimit,
    LobePoint,
    Lobes,
    MaterialName,
    NotKnown,
    PartTotals,
    ProgramCut,
    SimulatedProgram,
    ToolTotals,
    WorstBlock,
)
from pipeline.schema.store import json_text, structured
from tests.report.page_reader import outline, words

NAME = 'MILL <script>"&'
COST = CutCost(time=86.5, tools=85.6, energy=4.39, sum=176.0)
TOTALS = {
    "blocks": 22, "time_s": 34.0, "at_feed_s": 21.2, "in_material_s": 20.2, "air_share": 0.049,
    "feed_per_tooth_mm": 0.0854, "chip_thickness_mm": 0.0853, "cutting_speed_m_min": 188.5,
    "axial_depth_mm": 6.0,
    "radial_depth_mm": 12.0, "peak_load_N": 665.4, "mean_load_N": 300.0, "axial_force_N": 38.8,
    "torque_Nm": 2.84, "peak_torque_Nm": 3.0, "power_kW": 2.38, "drive_share": 1.246,
    "deflection_um": 32.4, "stability_margin": -0.263, "volume_cm3": 8.31,
    "removal_rate_cm3_min": 24.7, "highest_removal_rate_cm3_min": 30.0,
    "tool_life_share": 0.0042, "energy_kWh": 0.0418, "cost": COST,
}  # fmt: skip
TOOL = ToolTotals(tool=4, name=NAME, **TOTALS)
BLOCK = WorstBlock(
    line=33, row=20, tool=4, binds="load limit", used=1.664, alike=2, speed_rpm=8000.0,
    reached_feed_mm_min=2050.0, feed_per_tooth_mm=0.0854, chip_thickness_mm=0.0853,
    cutting_speed_m_min=188.5,
    axial_depth_mm=6.0, radial_depth_mm=9.45, entry_deg=0.0, exit_deg=180.0, peak_load_N=665.4,
    mean_load_N=300.0, axial_force_N=38.8, torque_Nm=2.84, peak_torque_Nm=3.0, power_kW=2.38,
    drive_share=1.246, deflection_um=32.4, stability_margin=-0.263, in_material_s=2.0,
    volume_cm3=0.3, removal_rate_cm3_min=24.7, tool_life_share=0.0004, energy_kWh=0.004, cost=8.0,
)  # fmt: skip


def trace(columns=40):
    cut = tuple(None if k % 7 == 0 else float(k) for k in range(columns))
    return EngagementTrace(
        total_s=84.6, load_N_low=cut, load_N_high=cut, axial_depth_mm_low=cut,
        axial_depth_mm_high=cut, radial_depth_mm_low=cut, radial_depth_mm_high=cut,
        entry_deg=tuple(None if v is None else 0.0 for v in cut),
        exit_deg=tuple(None if v is None else 180.0 for v in cut),
        tools=((4, 0.0, 0.4), (9, 0.4, 1.0)),
    )  # fmt: skip


def made(origin="simulated", **changes):
    lobes = Lobes(
        tool=4, label=f"T4 {NAME}", line=33, entry_deg=0.0, exit_deg=180.0,
        speeds_rpm=(4000.0, 6000.0, 8000.0), depth_limit_mm=(2.0, None, 4.0),
        points=(LobePoint(line=33, speed_rpm=7000.0, axial_depth_mm=6.0, margin=-0.2),
                LobePoint(line=34, speed_rpm=5000.0, axial_depth_mm=1.0, margin=2.0)),
    )  # fmt: skip
    point = DrivePoint(line=33, tool=4, speed_rpm=8000.0, power_kW=2.38, drive_share=1.246)
    warning = CutWarning(
        what="the load passes its limit", do="Lower the feed.", lines=(33, 34, 35, 40), blocks=4,
        grave=True,
    )  # fmt: skip
    cut = ProgramCut(
        stock=Blank(text="box:0,1,0,1,0,1", work_offset="G54", resolution_mm=0.2),
        material=MaterialName(name=f"A6061{NAME}"), currency="KRW", limits=LoadLimit(load_N=400.0),
        dynamics="usual values, not measured", dynamics_measured=False, feeds="",
        summary=PartTotals(peak_line=33, blank_cm3=1.0, left_cm3=0.5, **TOTALS),
        by_tool=(TOOL,), worst=(BLOCK,), warnings=(warning,),
        not_known=(NotKnown(what="deflection", why="no stickout_mm"),),
        left_out=(LeftOutMoves(reason="threads are not computed", rows=3, first="a.nc:9"),),
        basis=(BasisRow(what="blank", value="box", source="in mm"),),
        notes=("Peaks are those of the highest feed.",), trace=trace(), lobes=(lobes,),
        drive=DriveCurve(speeds_rpm=(0.0, 5000.0, 10000.0), power_kW=(0.0, 10.0, 9.0),
                         points=(point,)),
        blocks=(),
    )  # fmt: skip
    summary = SimulatedProgram(program=f"CAM{NAME}", machine="mill01", origin=origin)
    return Program(summary=summary, moves=None, cut=replace(cut, **changes))


def page(tmp_path: Path, shown) -> Path:
    out = tmp_path / "cut.html"
    write_cut_page(shown, out)
    return out


def test_the_page_has_every_figure_and_table(tmp_path):
    found = outline(page(tmp_path, made()))
    labels = [a["aria-label"] for tag, a in found.tags if tag == "svg" and "aria-label" in a]
    for word in ("Peak load over", "Axial and radial depth", "Stability lobes", "Cutting power"):
        assert any(label.startswith(word) for label in labels)
    said = words(page(tmp_path, made()))
    for word in ("By tool: the worst", "what the part costs", "nearest to what binds them",
                 "What these numbers rest on", "limit 400 N", "threads are not computed",
                 "3 moves, the first in a.nc:9", "Lines 33–35, 40", "not measured",
                 "Deflection: not known"):  # fmt: skip
        assert word in said


def test_numbers_stand_with_their_units(tmp_path):
    said = words(page(tmp_path, made())).replace("\u202f", " ").replace("\xa0", " ")
    for word in ("665 N", "166 %", "125 %", "−26 %", "32.4", "176", "0.42 %", "2.38"):
        assert word in said


def test_it_runs_no_script_loads_nothing_and_escapes_names(tmp_path):
    out = page(tmp_path, made())
    text = out.read_text()
    assert "<script" not in text and NAME in words(out)
    assert "default-src 'none'" in text
    tags = outline(out).tags
    assert not any("src" in a or a.get("href", "").startswith("http") for _, a in tags)
    assert "simulated" in words(out).lower()


def test_a_recorded_machine_is_not_labelled_simulated(tmp_path):
    tags = outline(page(tmp_path, made("recorded"))).tags
    assert not any(a.get("class") == "label simulated" for _, a in tags)


@pytest.mark.parametrize(
    ("warnings", "limit", "word"),
    [
        ((), 400.0, "within its limits"),
        ((), None, "no limit given"),
        ((CutWarning(what="x", do="y"),), 4.0, "look first"),
        ((CutWarning(what="x", do="y", lines=(1,), blocks=1, grave=True),), 4.0, "beyond"),
    ],
)
def test_the_verdict_is_that_of_its_warnings(tmp_path, warnings, limit, word):
    shown = made(warnings=warnings, limits=LoadLimit(load_N=limit))
    assert word in words(page(tmp_path, shown))


def test_the_verdict_names_the_largest_share_of_a_limit_first(tmp_path):
    unstable = replace(BLOCK, line=7, binds="stability", used=3.0)
    said = words(page(tmp_path, made(worst=(BLOCK, unstable)))).replace("\u202f", " ")
    first = "Furthest beyond its limit is stability: 300 % in line 7"
    assert said.index(first) < said.index("The load passes its limit in 4 blocks.")


def test_forces_of_rounding_are_nothing(tmp_path):
    shown = made(by_tool=(replace(TOOL, axial_force_N=2.22e-13),))
    assert "2.22" not in words(page(tmp_path, shown))


@pytest.mark.parametrize(
    "changes",
    [
        {"currency": None, "summary": replace(made().cut.summary, cost=None)},
        {"dynamics": None, "lobes": (), "drive": None, "not_known": ()},
        {"by_tool": (), "worst": (), "warnings": (), "blocks": ()},
        {"trace": replace(trace(), entry_deg=(None,) * 40, exit_deg=(None,) * 40)},
        {"left_out": (), "basis": (), "notes": ()},
        {"by_tool": (ToolTotals(tool=4, name="", **dict.fromkeys(TOTALS) | {"blocks": 1}),)},
    ],
    ids=["prices", "dynamics", "cut", "trace", "premises", "values"],
)
def test_a_cut_of_which_a_part_is_not_known_still_makes_a_page(tmp_path, changes):
    assert outline(page(tmp_path, made(**changes))).tags


def test_a_stored_cut_is_read_back():
    cut = made().cut
    assert structured(json.loads(json_text(cut)), ProgramCut, "$") == cut


@given(
    low=st.lists(st.floats(0, 100), min_size=1, max_size=30),
    more=st.floats(0, 50),
    height=st.floats(40, 300),
)
def test_columns_reach_from_the_lowest_to_the_highest(low, more, height):
    """Heights in the path are those of the values to a unit, at least a line thick."""
    low_, most = np.array(low), 160.0
    panel = Panel(head="", top=0, height=height, most=most)
    data = re.findall(r"M(\d+) (-?\d+)h10v(\d+)h-10z", str(panel.columns(low_, low_ + more, "k")))
    assert [int(x) for x, *_ in data] == [10 * k for k in range(len(low))]
    for (_, top, thick), value in zip(data, low, strict=True):
        line = 1000 / height + 1  # a pixel, in units, rounded up
        assert abs(int(top) + int(thick) - 1000 * (1 - value / most)) <= 0.5 + 1e-9
        exact = 1000 * more / most
        assert exact - 1 <= int(thick) <= max(exact + 1, line)


def test_columns_without_a_value_are_not_drawn():
    panel = Panel(head="", top=0, height=100, most=10.0)
    assert str(panel.columns(np.array([np.nan]), np.array([np.nan]), "k")).count("M") == 0


@given(st.lists(st.integers(1, 60)))
def test_spans_hold_the_lines_and_no_others(lines):
    found = set()
    for span in spans_of(lines):
        first, _, last = span.partition("–")
        found |= set(range(int(first), int(last or first) + 1))
    assert found == set(lines)


def test_shares_say_how_far_beyond():
    assert share(1.664) == "166\u202f%" and share(0.0042) == "0.42\u202f%" and share(None) == "–"
