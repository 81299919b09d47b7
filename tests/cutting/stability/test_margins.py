"""Margins of a population: never above the lobes, and what is not known is not promised."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.cutting.engagement.engagement import Engagement, Immersions, ToolPath, immersions
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.margins import MOST, ROUNDED, margin, stability_table
from pipeline.cutting.stability.semi_discretisation import least_depth
from pipeline.cutting.tool import Tool
from tests.cutting.chatter import X, Y, depth_limits, regenerative_cut

LAW = ForceLaw.linear(K_tc=600.0, K_rc=200.0, K_te=20.0, K_re=20.0)
TWO = Tool(kind="flat", diameter_mm=10.0, flutes=2)
FOUR = replace(TWO, flutes=4)
RANGE = (4000.0, 20_000.0)
NODES = np.array([4000.0, 5000.0, 9000.0, 11_000.0, 17_000.0, 20_000.0])


def stations(rows: list[tuple], blocks: int, unjudged: tuple[int, ...] = ()) -> Immersions:
    """Rows of block, tool, depth [mm], entry, exit, feed [deg], spindle."""
    block, tool, depth, entry, exit, feed, direction = np.array(rows, float).reshape(-1, 7).T
    flags = np.zeros(blocks, dtype=np.bool_)
    flags[list(unjudged)] = True
    return Immersions(
        block=block.astype(np.int32), tool=tool.astype(np.int32), depth=depth * 1e-3,
        entry=np.deg2rad(entry), exit=np.deg2rad(exit), feed_direction=np.deg2rad(feed),
        direction=direction.astype(np.int8), blocks=blocks, unjudged=flags,
    )  # fmt: skip


PROGRAM = stations(
    [(0, 0, 1.0, 0, 180, 0, 1), (2, 0, 0.5, 90, 180, 90, 1), (2, 0, 0.2, 0, 180, 45, 1),
     (3, 1, 2.0, 0, 60, 215, -1)],
    blocks=6, unjudged=(4,),
)  # fmt: skip
TIP = [X, Y]


def table(program: Immersions = PROGRAM, nodes_rpm=NODES, **options):
    return stability_table(
        program, [TIP, TIP], [LAW, LAW], [TWO, FOUR], nodes_rpm=nodes_rpm, **options
    )


def limit_of(row: tuple, rpm: np.ndarray) -> np.ndarray:
    """Depth limit of a row's own cut, without classes."""
    _, tool, depth, entry, exit, feed, direction = row
    cut = regenerative_cut(
        LAW, (TWO, FOUR)[tool], entry=np.deg2rad(entry), exit=np.deg2rad(exit),
        feed_direction=np.deg2rad(feed), direction=direction,
    )  # fmt: skip
    return depth_limits(TIP, cut, rpm / 60, highest=4 * depth * 1e-3).depth_limit


@pytest.mark.parametrize("many", [10, pytest.param(200, marks=pytest.mark.proof)])
def test_a_class_allows_what_its_own_cut_does(many: int) -> None:
    """Arcs and feeds off all marks: never more than 0.5 % above, and within 5 %."""
    rng = np.random.default_rng(1)
    width = np.arccos(1 - 2 * rng.uniform(0.02, 0.98, many))
    up = rng.random(many) < 0.5
    entry, exit = np.where(up, 0.0, pi - width), np.where(up, width, pi)
    arcs = np.rad2deg(np.column_stack([entry, exit]))
    rows = [
        (k, int(rng.integers(2)), 2.0, *arc, float(rng.uniform(0, 360)), int(rng.choice([1, -1])))
        for k, arc in enumerate(arcs.tolist())
    ]
    rpm = rng.uniform(4500, 20_000, many)
    nodes = np.sort(rpm)
    margins = table(stations(rows, many), nodes).margins(rpm)
    own = np.array([limit_of(row, rpm[k : k + 1])[0] / 2e-3 for k, row in enumerate(rows)])
    seen = own < 3.9
    ratio = (margins[seen] + 1) / own[seen]
    assert seen.sum() > many / 3
    assert ratio.max() < 1.005 and ratio.min() > 0.95
    assert (margins[~seen] > 2.5).all()


def test_between_two_nodes_the_lesser_limit_counts() -> None:
    row = (0, 0, 1.0, 0, 180, 0, 1)
    at = table(stations([row], 1))
    of = at.margins(NODES[:, None])[:, 0]
    middles = (NODES[1:] + NODES[:-1])[:, None] / 2
    np.testing.assert_array_equal(at.margins(middles)[:, 0], np.minimum(of[1:], of[:-1]))
    np.testing.assert_allclose(of + 1, ROUNDED * limit_of(row, NODES) / 1e-3, rtol=2e-3)


def test_no_margin_is_above_the_greatest_told_apart() -> None:
    """Nothing in the air, at most 300 % in the cut; what is computed is kept."""
    shallow = table(stations([(0, 0, 0.01, 0, 180, 0, 1)], 1))
    assert np.isnan(shallow.limit).all()
    np.testing.assert_allclose(shallow.margins(NODES[:, None]), MOST)
    assert np.isfinite(shallow.limit).all()


def test_a_block_is_as_good_as_its_worst_station() -> None:
    """Blocks 1 and 5 are in the air, 4 is a plunge, 2 has two stations."""
    found = table()
    margins = found.margins(np.full((3, 6), [[5000.0], [9000.0], [17_000.0]]))
    assert np.isinf(margins[:, [1, 5]]).all() and np.isnan(margins[:, 4]).all()
    np.testing.assert_array_equal(found.judged, [True, True, True, True, False, True])
    single = [
        table(stations([row], 1)).margins(np.array([[5000.0], [9000.0], [17_000.0]]))[:, 0]
        for row in [(0, 0, 0.5, 90, 180, 90, 1), (0, 0, 0.2, 0, 180, 45, 1)]
    ]
    np.testing.assert_array_equal(margins[:, 2], np.minimum(*single))


@settings(max_examples=20, deadline=None)
@given(speeds=st.lists(st.floats(*RANGE), min_size=6, max_size=6))
def test_a_population_is_its_individuals(speeds: list[float]) -> None:
    found = table()
    both = found.margins(np.array([speeds, speeds[::-1]]))
    np.testing.assert_array_equal(both[0], found.margins(speeds))
    np.testing.assert_array_equal(both[1], found.margins(speeds[::-1]))


def test_classes_are_of_near_arcs_and_forget_the_sense_of_the_feed() -> None:
    rows = [(0, 0, 1, 90.2, 180, 31, 1), (1, 0, 1, 89.9, 180, 31.1, 1), (2, 0, 1, 90, 180, 211, 1),
            (3, 0, 1, 90, 180, 60, 1), (4, 0, 1, 92, 180, 31, 1),
            (5, 0, 1, 90, 180, 31, -1)]  # fmt: skip
    found = table(stations(rows, 6))
    kind = found.kind
    assert len(found.limit) == 4 and kind[0] == kind[1] == kind[2]
    assert len({*kind[[0, 3, 4, 5]].tolist()}) == 4


@pytest.mark.parametrize("K_ac", [0.0, 150.0])
def test_a_ball_is_judged_by_the_part_of_its_edge_that_cuts(K_ac: float) -> None:
    """In a slot, and at a wall above the tip, against the cut of just these heights.

    Where forces cancel in part, marks of the radial coefficient may cost up to 10 %.
    """
    ball = Tool(kind="ball", diameter_mm=8.0, flutes=2)
    law = ForceLaw.linear(K_tc=600.0, K_rc=200.0, K_ac=K_ac)
    rng = np.random.default_rng(2)
    low = np.where(rng.random(24) < 0.5, 0.0, rng.uniform(0.0, 3e-3, 24))
    deep = rng.uniform(0.1e-3, 1.5e-3, 24)
    entry = rng.uniform(0.0, 2.0, 24)
    rows = [(k, 0, 1e3 * d, np.rad2deg(e), 180, 20, 1) for k, (d, e) in
            enumerate(zip(deep, entry, strict=True))]  # fmt: skip
    program = replace(stations(rows, 24), lowest=low, highest=low + deep)
    nodes = np.array([5000.0, 9000.0])
    found = stability_table(program, [TIP], [law], [ball], nodes_rpm=nodes).margins(
        np.repeat(nodes[:, None], 24, axis=1)
    )
    cuts = [
        regenerative_cut(law, ball, entry=e, exit=pi, feed_direction=np.deg2rad(20),
                           heights=(a, a + d))
        for a, d, e in zip(low, deep, entry, strict=True)
    ]  # fmt: skip
    true = np.array([
        depth_limits(TIP, cut, nodes / 60, highest=4 * d).depth_limit / d
        for cut, d in zip(cuts, deep, strict=True)
    ]).T  # fmt: skip
    seen = true < 3.9
    ratio = (found + 1)[seen] / true[seen]
    assert seen.sum() > 4 and ratio.max() <= 1.01 and ratio.min() > 0.9


def test_a_law_that_is_not_linear_is_taken_at_the_chip() -> None:
    """K_c (1 - m_c) h^(-m_c): the table of the line with this slope; at another h another one."""
    law = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.4, axial=0.1)

    def limit(law: ForceLaw, thickness: float | None) -> np.ndarray:
        return stability_table(
            PROGRAM, [TIP, TIP], [law, law], [TWO, FOUR], nodes_rpm=NODES, thickness=thickness
        ).margins(np.full(6, 9000.0))

    for h in (2e-5, 1e-4):
        slope = 0.75 * (h * 1e3) ** -0.25 * 1500.0
        line = ForceLaw.linear(K_tc=slope, K_rc=0.4 * slope, K_ac=0.1 * slope)
        np.testing.assert_allclose(limit(law, h), limit(line, None), rtol=1e-9)
    with pytest.raises(ValueError, match=r"m_c = 0\.25.*give the mean thickness"):
        limit(law, None)


def test_what_the_stations_name_must_be_there() -> None:
    rubs = ForceLaw(K_tc=0.0, K_rc=0.0, K_te=1e3)
    with pytest.raises(ValueError, match=r"force_laws\[0\]\.K_tc = 0\.0 must be positive"):
        stability_table(PROGRAM, [TIP, TIP], [rubs, LAW], [TWO, FOUR], nodes_rpm=NODES)


def test_a_tool_whose_dynamics_are_not_known_is_not_judged() -> None:
    found = stability_table(PROGRAM, [TIP, None], [LAW, LAW], [TWO, FOUR], nodes_rpm=NODES)
    margins = found.margins(np.full(6, 9000.0))
    assert np.isnan(margins[3]) and not found.judged[3]
    assert np.isfinite(margins[[0, 2]]).all()


def test_speeds_too_slow_for_cells_have_the_least_depth() -> None:
    """At 2 rpm some 14 000 waves lie within a cut."""
    row = (0, 0, 1.0, 0, 180, 0, 1)
    found = table(stations([row], 1), [2.0]).margins([2.0])[0]
    cut = regenerative_cut(LAW, TWO, entry=0.0, exit=pi)
    assert found == pytest.approx(ROUNDED * least_depth(TIP, cut) / 1e-3 - 1, rel=1e-9)


def test_margin_is_zero_at_the_limit() -> None:
    assert margin(2e-3, 2e-3) == 0.0
    np.testing.assert_array_equal(margin([1e-3, 4e-3], 2e-3), [1.0, -0.5])
    # not known is not air
    np.testing.assert_array_equal(
        margin([np.nan, 1.0, 0.0, 1.0], [1.0, np.nan, 1.0, np.inf]),
        [np.nan, np.nan, np.inf, np.inf],
    )


@pytest.mark.parametrize("rpm", [3999.0, 20_001.0, np.nan])
def test_a_speed_outside_of_the_table_is_named(rpm: float) -> None:
    speeds = np.full((2, 6), 9000.0)
    speeds[1, 3] = rpm
    with pytest.raises(ValueError, match=r"speed_rpm\[1, 3\] = .*4000 to 20000 rev/min"):
        table().margins(speeds)


@pytest.mark.parametrize("nodes", [[], [0.0], [9000.0, 9000.0], [9000.0, np.inf]])
def test_what_a_table_cannot_be(nodes: list[float]) -> None:
    with pytest.raises(ValueError, match="speeds, which must be above 0 and grow"):
        table(nodes_rpm=nodes)


def test_a_table_has_one_speed_for_each_block() -> None:
    with pytest.raises(ValueError, match="speed_rpm has shape"):
        table().margins(np.full(5, 9000.0))


def engagement(lower: np.ndarray, upper: np.ndarray, path: ToolPath, piece, slope) -> Engagement:
    many = len(upper)
    return Engagement(
        piece=np.array(piece, np.int32), block=np.array(piece, np.int32),
        tool=np.zeros(many, np.int32), along=np.zeros(many), length=np.ones(many), lower=lower,
        upper=upper, volume=np.ones(many), slope=np.array(slope), feed=path.feed[piece], blocks=5,
        resolution=1e-4,
    )  # fmt: skip


def pieces() -> ToolPath:
    points = np.array([[0, 0, 0], [0, -1, 0], [0, -1, -1], [1, -1, -1], [2, -1, -1]], float)
    return ToolPath(
        start=points[:-1], end=points[1:], block=np.arange(4, dtype=np.int32),
        tool=np.zeros(4, np.int32), feed=np.array([True, True, False, True]),
        direction=np.array([1, 1, 1, -1], np.int8),
    )  # fmt: skip


def test_stations_of_an_engagement() -> None:
    """72 bins of 5 deg: a half-immersion cut along -y, a plunge, a rapid, a trailing edge."""
    upper = np.zeros((5, 72), np.float32)
    lower = np.zeros_like(upper)
    upper[0, 18:36], lower[0, 18:36] = 3e-3, 1e-3  # 90 to 180 deg, 2 mm of edge
    upper[1, :] = 1e-3
    upper[2, :36] = 1e-3
    upper[3, 40:50] = 1e-3  # behind the tool: no chip
    upper[4, 4:6], upper[4, 10:12] = 1e-3, 4e-3  # two arcs
    path = pieces()
    found = immersions(
        path, engagement(lower, upper, path, [0, 1, 2, 3, 3], [0.0, -1.0, 0.0, 0.0, 0.0])
    )
    np.testing.assert_array_equal(found.block, [0, 3])
    np.testing.assert_allclose(np.rad2deg(found.entry), [90, 20], atol=1e-9)
    np.testing.assert_allclose(np.rad2deg(found.exit), [180, 60], atol=1e-9)
    np.testing.assert_allclose(found.depth, [2e-3, 4e-3], rtol=1e-6)
    np.testing.assert_allclose(found.lowest, [1e-3, 0.0], atol=1e-9)
    np.testing.assert_allclose(found.highest, [3e-3, 4e-3], rtol=1e-6)
    np.testing.assert_allclose(found.feed_direction, [-pi / 2, 0.0], atol=1e-12)
    np.testing.assert_array_equal(found.direction, [1, -1])
    np.testing.assert_array_equal(found.unjudged, [False, True, True, True, False])


def test_an_arc_ends_within_a_bin() -> None:
    """Seen along the feed, as the first and the last angle are engaged in part."""
    path = pieces()
    upper = np.zeros((1, 72), np.float32)
    upper[0, 28], upper[0, 29:36] = 0.4e-3, 1e-3
    found = immersions(path, engagement(np.zeros_like(upper), upper, path, [3], [0.0]))
    begin, end = np.cos(np.deg2rad([140, 145]))
    np.testing.assert_allclose(np.cos(found.entry), end + 0.4 * (begin - end), rtol=1e-6)
    np.testing.assert_allclose(found.exit, pi, rtol=1e-9)


def test_ramps_are_milling_up_to_a_steepness() -> None:
    """Up to dz / ds = 0.7, some 45 deg; what is steeper drills and is not judged."""
    path = pieces()
    upper = np.zeros((4, 72), np.float32)
    upper[:, :36] = 1e-3
    steep = engagement(np.zeros_like(upper), upper, path, [0, 0, 3, 3], [-0.65, 0.65, -0.75, 0.75])
    found = immersions(path, steep)
    np.testing.assert_array_equal(found.block, [0, 0])
    np.testing.assert_array_equal(found.unjudged, [False, False, False, True, False])
