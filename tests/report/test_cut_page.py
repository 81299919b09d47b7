"""The page of a cut: every figure and table of its document, nothing else, all text escaped."""

import copy
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.report.cut.figures import Panel
from pipeline.report.cut.page import write_cut_page
from pipeline.report.cut.tables import share, spans_of
from tests.report.page_reader import outline, words

NAME = 'MILL <script>"&'
TOOL = {
    "tool": 4, "name": NAME, "blocks": 22, "time_s": 34.0, "in_material_s": 20.2,
    "air_share": 0.049, "feed_per_tooth_mm": 0.0854, "chip_thickness_mm": 0.0853,
    "axial_depth_mm": 6.0, "radial_depth_mm": 12.0, "peak_load_N": 665.4, "axial_force_N": 38.8,
    "torque_Nm": 2.84, "power_kW": 2.38, "drive_share": 1.246, "deflection_um": 32.4,
    "stability_margin": -0.263, "volume_cm3": 8.31, "removal_rate_cm3_min": 24.7,
    "tool_life_share": 0.0042, "energy_kWh": 0.0418,
    "cost": {"time": 86.5, "tools": 85.6, "energy": 4.39, "sum": 176.0},
}  # fmt: skip
BLOCK = {
    "line": 33, "tool": 4, "binds": "load limit", "used": 1.664, "alike": 2, "peak_load_N": 665.4,
    "reached_feed_mm_min": 2050.0, "speed_rpm": 8000.0, "feed_per_tooth_mm": 0.0854,
    "axial_depth_mm": 6.0, "radial_depth_mm": 9.45, "power_kW": 2.38, "deflection_um": 32.4,
    "drive_share": 1.246,
}  # fmt: skip


def trace(columns=40):
    cut = [None if k % 7 == 0 else float(k) for k in range(columns)]
    bands = {f"{name}_{end}": list(cut) for name in ("load_N", "axial_depth_mm", "radial_depth_mm")
             for end in ("low", "high")}  # fmt: skip
    angles = [None if v is None else 0.0 for v in cut]
    leave = [None if v is None else 180.0 for v in cut]
    return {"total_s": 84.6, **bands, "entry_deg": angles, "exit_deg": leave,
            "tools": [[4, 0.0, 0.4], [9, 0.4, 1.0]]}  # fmt: skip


def made():
    lobes = {
        "tool": 4, "label": f"T4 {NAME}", "line": 33, "entry_deg": 0.0, "exit_deg": 180.0,
        "speeds_rpm": [4000.0, 6000.0, 8000.0], "depth_limit_mm": [2.0, None, 4.0],
        "points": [{"line": 33, "speed_rpm": 7000.0, "axial_depth_mm": 6.0, "margin": -0.2},
                   {"line": 34, "speed_rpm": 5000.0, "axial_depth_mm": 1.0, "margin": 2.0}],
    }  # fmt: skip
    return {
        "program": f"CAM{NAME}", "machine": "mill01", "origin": "simulated",
        "cut": {
            "stock": {"text": "box:0,1,0,1,0,1"}, "material": {"name": f"A6061{NAME}"},
            "currency": "KRW", "limits": {"load_N": 400.0},
            "dynamics": "usual values, not measured",
            "summary": {**TOOL, "peak_line": 33}, "by_tool": [TOOL], "worst": [BLOCK],
            "warnings": [{"what": "the load passes its limit", "do": "Lower the feed.",
                          "lines": [33, 34, 35, 40], "blocks": 4, "grave": True}],
            "not_known": [{"what": "deflection", "why": "no stickout_mm"}],
            "left_out": [{"reason": "threads are not computed", "rows": 3, "first": "a.nc:9"}],
            "basis": [{"what": "blank", "value": "box", "source": "in mm"}],
            "notes": ["Peaks are those of the highest feed."], "trace": trace(), "lobes": [lobes],
            "drive": {"speeds_rpm": [0.0, 5000.0, 10000.0], "power_kW": [0.0, 10.0, 9.0],
                      "points": [BLOCK]},
            "blocks": [BLOCK],
        },
    }  # fmt: skip


def page(tmp_path: Path, document) -> Path:
    out = tmp_path / "cut.html"
    write_cut_page(document, out)
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
    document = made() | {"origin": "recorded"}
    tags = outline(page(tmp_path, document)).tags
    assert not any(a.get("class") == "label simulated" for _, a in tags)


@pytest.mark.parametrize(
    ("warnings", "limit", "word"),
    [
        ([], 400.0, "within its limits"),
        ([], None, "no limit given"),
        (
            [{"what": "x", "do": "y", "lines": [], "blocks": None, "grave": False}],
            4.0,
            "look first",
        ),
        ([{"what": "x", "do": "y", "lines": [1], "blocks": 1, "grave": True}], 4.0, "beyond"),
    ],
)
def test_the_verdict_is_that_of_its_warnings(tmp_path, warnings, limit, word):
    document = made()
    document["cut"] |= {"warnings": warnings, "limits": {"load_N": limit}}
    assert word in words(page(tmp_path, document))


def test_the_verdict_names_the_largest_share_of_a_limit_first(tmp_path):
    document = made()
    document["cut"]["worst"] = [BLOCK, BLOCK | {"line": 7, "binds": "stability", "used": 3.0}]
    said = words(page(tmp_path, document)).replace("\u202f", " ")
    first = "Furthest beyond its limit is stability: 300 % in line 7"
    assert said.index(first) < said.index("The load passes its limit in 4 blocks.")


def test_forces_of_rounding_are_nothing(tmp_path):
    document = made()
    document["cut"]["by_tool"] = [TOOL | {"axial_force_N": 2.22e-13}]
    assert "2.22" not in words(page(tmp_path, document))


@pytest.mark.parametrize("key", sorted(made()["cut"]))
@pytest.mark.parametrize("value", ["absent", None, [], {}, "text"])
def test_a_document_that_lacks_a_part_still_makes_a_page(tmp_path, key, value):
    document = copy.deepcopy(made())
    if value == "absent":
        del document["cut"][key]
    else:
        document["cut"][key] = value
    assert outline(page(tmp_path, document)).tags


def test_a_document_without_a_cut_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"holds no cut, give --stock"):
        write_cut_page({"program": "x"}, tmp_path / "p.html")


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
