"""Tables of loads: programs with nothing in them, arguments that do not go together."""

import numpy as np
import pytest

from pipeline.cutting.force_law import ForceLaw
from pipeline.cutting.load_table import load_table
from pipeline.cutting.tool import Tool
from tests.cutting.stations import arc, stations

LAW = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
MILL = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=30.0)
MOST = 1e-4
NAMES = ("peak", "mean", "rms", "axial", "torque", "peak_torque")


def test_a_program_that_cuts_nothing() -> None:
    none = stations([], [], 3)
    for tools, laws in (([], []), ([MILL], [LAW])):
        table = load_table(none, tools, laws, MOST)
        for feeds in (np.full(3, MOST), np.full((2, 3), MOST)):
            loads = table.loads(feeds)
            assert not any(getattr(loads, name).any() for name in NAMES)


def test_a_program_without_blocks() -> None:
    table = load_table(stations([], [], 0), [MILL], [LAW], MOST)
    assert table.loads([]).peak.shape == (0,)
    assert table.loads(np.empty((4, 0))).peak.shape == (4, 0)
    assert table.peaks([]).shape == table.station_loads([]).peak.shape == (0,)


@pytest.mark.parametrize("tools", [(0, 1), (0, 2), (2, 0), (1, 2), (1, 3)])
def test_a_block_has_one_tool(tools) -> None:
    """Whatever the bits of their numbers, and with another block's stations between them or not."""
    profile = arc(0.2, 2.0, 2e-3)
    for block, tool in (([0, 1, 1], [0, *tools]), ([1, 0, 1], [tools[0], 0, tools[1]])):
        engagement = stations([profile] * 3, block, 2, tool=tool)
        with pytest.raises(ValueError, match="block 1 cuts with two tools"):
            load_table(engagement, [MILL] * 4, [LAW] * 4, MOST)
    same = stations([profile] * 3, [0, 1, 1], 2, tool=[tools[0], tools[1], tools[1]])
    assert load_table(same, [MILL] * 4, [LAW] * 4, MOST).peaks([MOST, MOST]).all()


def test_what_does_not_go_together_is_named() -> None:
    engagement = stations([arc(0.2, 2.0, 2e-3)], [0], 1)
    two = stations([arc(0.2, 2.0, 2e-3)] * 2, [0, 0], 1, tool=[0, 1])
    for arguments, words in [
        ((engagement, [MILL], [], MOST), "1 tools have 0 laws"),
        ((engagement, [], [], MOST), "has tool 0, but there are 0 tools"),
        (
            (stations([arc(0.2, 2.0, 2e-3)], [0], 1, tool=[-1]), [MILL], [LAW], MOST),
            "has tool -1, but",
        ),
        ((engagement, [MILL], [LAW], 0.0), r"f_z_max = 0\.0 must be finite and positive"),
        ((engagement, [MILL], [LAW], [MOST, MOST]), r"f_z_max has shape \(2,\)"),
        ((two, [MILL, MILL], [LAW, LAW], MOST), "block 0 cuts with two tools"),
    ]:
        with pytest.raises(ValueError, match=words):
            load_table(*arguments)
    with pytest.raises(ValueError, match="nodes = 2"):
        load_table(engagement, [MILL], [LAW], MOST, nodes=2)
    table = load_table(engagement, [MILL], [LAW], MOST)
    with pytest.raises(ValueError, match=r"f_z has shape \(2,\): give one feed for each of the 1"):
        table.loads([1e-5, 1e-5])
    with pytest.raises(ValueError, match=r"out has shape \(2,\), f_z has \(1,\)"):
        table.peaks([1e-5], np.empty(2))
