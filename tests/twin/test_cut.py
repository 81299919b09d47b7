"""A program's cut: engagement, loads, power and rates of its blocks."""

from itertools import pairwise

import numpy as np
import pytest

from pipeline.cutting.engagement.stock import Box
from pipeline.twin.cut.blocks import cut_blocks, station_arcs
from pipeline.twin.cut.loads import recut
from pipeline.twin.cut.tables import cut_trace
from tests.twin.cut_parts import DEPTH, K_E, K_T, SLOT, cut_of, pocket


@pytest.fixture(scope="module")
def slot():
    return cut_of(SLOT)


def test_a_pocket_takes_out_what_it_holds():
    """40 x 30 mm with round corners, 2 mm deep; a height map errs by less than 1 % of it."""
    cut = cut_of(pocket(), resolution=0.25)
    exact = DEPTH * (40 * 30 - (4 - np.pi) * 25) * 1e-9
    assert cut.blank.volume - cut.left.volume == pytest.approx(exact, rel=0.004)
    assert cut.engagement.volume.sum() == pytest.approx(cut.blank.volume - cut.left.volume)


def test_the_load_in_a_slot_is_the_closed_form(slot):
    """K_t a_p f_z sqrt(1 + K_e^2), when a tooth stands across the feed (Sim2023)."""
    f_z = 600 / 6000 / 2 * 1e-3
    blocks = cut_blocks(slot)
    exact = K_T * DEPTH * 1e-3 * f_z * np.sqrt(1 + K_E**2)
    # heights are known in 72 angles, and teeth stand 2.5 degrees apart: both miss cos(2.5 deg)
    assert blocks.peak == pytest.approx([exact], rel=2e-3)
    assert blocks.feed_per_tooth == pytest.approx([f_z])
    assert blocks.thickness == pytest.approx([f_z], rel=2e-3)
    assert blocks.axial_depth * 1e3 == pytest.approx([DEPTH])
    assert blocks.radial_depth * 1e3 == pytest.approx([10.0], rel=0.02)


def test_power_is_torque_times_speed_and_work_over_volume(slot):
    """Mean power over the rate of removal is the specific force, whatever the engagement."""
    blocks = cut_blocks(slot)
    assert blocks.power == pytest.approx(blocks.torque * 2 * np.pi * 6000 / 60)
    energy = (blocks.mean_power * blocks.seconds).sum()
    assert energy == pytest.approx(K_T * blocks.volume.sum(), rel=0.01)


def test_rate_and_time_in_the_material(slot):
    blocks = cut_blocks(slot)
    assert blocks.rate * 60e6 == pytest.approx([10 * DEPTH * 600 / 1000], rel=0.02)
    # from where the tool first touches, 5 mm before the edge, to where it leaves
    assert blocks.seconds == pytest.approx([(60 + 5) / 10], rel=0.03)
    assert blocks.seconds + blocks.air == pytest.approx([80 / 10], rel=0.01)


def test_faster_feeds_load_more_and_a_population_is_its_members(slot):
    moves = slot.plan.path.moves
    feeds = np.stack([moves.feed * f for f in (0.5, 1.0, 1.7)])
    speeds = np.stack([moves.speed * s for s in (1.0, 1.2, 0.9)])
    many = slot.loads(feeds, speeds)
    for p in range(3):
        one = slot.loads(feeds[p], speeds[p])
        assert np.array_equal(one.peak, many.peak[p])
        assert np.array_equal(one.torque, many.torque[p])
    row = cut_blocks(slot).row[0]
    expected = np.array([0.5, 1.0, 1.7]) / np.array([1.0, 1.2, 0.9])
    # a law without edge forces is a line through the origin
    assert many.peak[:, row] / many.peak[1, row] == pytest.approx(expected / expected[1], rel=1e-6)


def test_commanded_feeds_bound_what_is_reached():
    """Short blocks do not reach their feed; the look-up for other feeds must not say less."""
    zigzag = "".join(f"X{10 + 0.2 * k:.1f} Y{10 + k % 2}\n" for k in range(60))
    cut = cut_of("T1 M6\nG0 X10 Y10 S6000 M3\nZ2\nG1 Z-2 F200\nG61 F9000\n" + zigzag + "M30")
    reached, commanded = cut.block_loads.peak, cut.loads().peak
    assert (commanded >= reached - 1e-9).all()
    assert commanded.max() > 1.2 * reached.max()


def test_a_rapid_into_the_blank_is_no_cut_but_is_there():
    cut = cut_of(
        "T1 M6\nG0 X10 Y25 S6000 M3\nZ-2\nX50\nZ5\nM30\n".replace("M30", "G1 X60 F90\nM30")
    )
    found = cut.engagement
    rapid = np.unique(cut.plan.path.moves.line[found.block[~found.feed]])
    assert set(rapid) >= {3, 4}
    # 2 mm straight down, which has no axial depth but its way, then 2 mm deep across
    depth = dict(zip(cut.plan.path.moves.line.tolist(), found.rapid_depth.tolist(), strict=True))
    assert depth[3] == pytest.approx(2e-3, abs=1e-6) and depth[4] == pytest.approx(2e-3, rel=0.01)
    assert sum(one > 0 for one in depth.values()) == 2
    assert (cut.tool[found.block[~found.feed]] == -1).all()
    assert cut.block_loads.peak[cut.tool < 0].max() == 0


def test_a_standing_spindle_gives_no_chip():
    cut = cut_of(SLOT.replace(" M3", ""))
    blocks = cut_blocks(cut)
    assert blocks.spindle_speed.tolist() == [0] and blocks.peak.tolist() == [0]
    assert blocks.volume.sum() > 0


def test_tools_are_those_of_the_program():
    text = SLOT.replace("M30", "T2 M6\nG0 X-10 Y10 S8000 M3\nG1 Z-2 F300\nX70\nM30")
    blocks = cut_blocks(cut_of(text))
    assert blocks.tool.tolist() == [0, 1]
    assert blocks.radial_depth * 1e3 == pytest.approx([10, 6], rel=0.03)


def test_down_milling_leaves_at_half_a_turn():
    """A quarter of the diameter beside the blank, feed along +x with the blank on the right."""
    text = "T1 M6\nG0 X-10 Y52.5 S6000 M3\nG1 Z-2 F300\nX70 F600\nM30"
    cut = cut_of(text, resolution=0.2)
    blocks = cut_blocks(cut)
    swept = np.degrees(np.arccos(1 - 2 * 2.5 / 10))
    assert np.degrees(blocks.exit) == pytest.approx([180], abs=1)
    assert np.degrees(blocks.entry) == pytest.approx([180 - swept], abs=5)  # an angle of 72
    assert blocks.radial_depth * 1e3 == pytest.approx([2.5], abs=0.3)


class TestTrace:
    """Columns of time keep what is highest and lowest."""

    @pytest.mark.parametrize("columns", [3, 50, 900])
    def test_no_peak_is_lost(self, slot, columns):
        arcs = station_arcs(slot.engagement, slot.tools)
        trace = cut_trace(slot, arcs, columns)
        high = [v for v in trace.load_N_high if v is not None]
        low = [v for v in trace.load_N_low if v is not None]
        assert max(high) == pytest.approx(slot.station_loads.peak.max(), rel=1e-3)
        assert min(low) == pytest.approx(slot.station_loads.peak.min(), rel=1e-3)
        assert len(trace.load_N_high) == columns

    def test_cutting_columns_are_the_time_in_the_material(self, slot):
        trace = cut_trace(slot, station_arcs(slot.engagement, slot.tools), 900)
        cut = sum(v is not None for v in trace.entry_deg) / 900 * slot.plan.total
        # each of the two ends may fall into a column that is air for the rest
        assert cut == pytest.approx(slot.in_material.sum(), abs=3 * slot.plan.total / 900)

    def test_spans_of_tools_cover_the_program(self, slot):
        spans = cut_trace(slot, station_arcs(slot.engagement, slot.tools)).tools
        assert spans[-1][0] == 1 and spans[-1][2] == 1.0
        assert all(a[2] == pytest.approx(b[1], abs=1e-4) for a, b in pairwise(spans))


def test_a_blank_beside_the_path_is_not_cut():
    cut = cut_of(SLOT, stock=Box(x_mm=(0, 60), y_mm=(100, 150), z_mm=(-10, 0)))
    assert len(cut_blocks(cut)) == 0 and len(cut.engagement) == 0


@pytest.fixture(scope="module")
def cut():
    return cut_of(pocket())


class TestRecut:
    """The same way and blank under other feeds, speeds and rows."""

    def test_it_is_the_cut_of_the_other_program(self, cut):
        """An S word on a line of its own is a row more; the rest is cut anew for comparison."""
        text = pocket().replace("F600", "F450\nS7000")
        anew = cut_of(text)
        before, after = cut.plan.path.moves, anew.plan.path.moves
        assert len(after) == len(before) + 1
        rows = np.arange(len(before))
        rows[before.line >= before.line[np.argmax(before.feed == 600)]] += 1
        found = recut(cut, anew.plan, rows)
        # both tables have chords below 0.6 % of what they stand for, at other feeds
        for name in ("peak", "mean", "torque", "axial"):
            here, there = (getattr(one.block_loads, name) for one in (found, anew))
            assert here == pytest.approx(there, rel=0.012, abs=1e-9)
        assert found.in_material == pytest.approx(anew.in_material)
        assert np.array_equal(found.tool, anew.tool)
        assert np.array_equal(found.station_loads.peak > 0, anew.station_loads.peak > 0)
        assert len(cut_blocks(found)) == len(cut_blocks(cut))

    def test_the_same_plan_is_the_same_cut(self, cut):
        again = recut(cut, cut.plan, np.arange(len(cut.plan.path)))
        assert np.array_equal(again.block_loads.peak, cut.block_loads.peak)
        assert np.array_equal(again.table.values, cut.table.values)

    def test_rows_without_a_place_and_other_moves_are_named(self, cut):
        many = len(cut.plan.path)
        for rows in (np.arange(many - 1), np.arange(many)[::-1], np.arange(many) + 1):
            with pytest.raises(ValueError, match=rf"{many} rows in a plan of {many}"):
                recut(cut, cut.plan, rows)
        other = cut_of(pocket().replace("X45", "X44"))
        with pytest.raises(ValueError, match=r"line 7 moves 30 mm with T1 in the cut"):
            recut(cut, other.plan, np.arange(many))
