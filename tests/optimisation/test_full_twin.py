"""The whole twin on a cut: waveforms beside the table, and what the axes are behind."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.load_table import load_table
from pipeline.cutting.force.waveform import profile_waveform
from pipeline.cutting.tool import Tool
from pipeline.optimisation.full_twin import station_peak, verify
from tests.twin.cut_parts import DEPTH, K_E, K_T, SLOT, TEN, cut_of, pocket
from tests.twin.test_program_axes import GAIN, drive


@pytest.fixture(scope="module")
def slot():
    return cut_of(SLOT)


@pytest.fixture(scope="module")
def thrown():
    """A pocket with a tool whose runout is near to its feed for each tooth."""
    tool = Tool(kind="flat", diameter_mm=10.0, flutes=3, helix_deg=30.0, runout_um=20.0,
                runout_deg=33.0)  # fmt: skip
    return cut_of(pocket(), tools={1: tool})


def test_the_peak_of_a_slot_is_the_closed_form(slot):
    """The table's teeth stand 0.6 degrees beside where the chip is thickest, those here do not."""
    found = verify(slot)
    exact = K_T * DEPTH * 1e-3 * 600 / 6000 / 2 * 1e-3 * np.sqrt(1 + K_E**2)
    # the middle of a bin of 5 degrees stands for it
    assert found.peak_N == pytest.approx(exact, rel=1e-3)
    assert found.peak_row == int(np.argmax(slot.block_loads.peak))
    assert found.f_z[found.peak_row] == pytest.approx(5e-5)


def test_with_runout_the_waveform_is_that_of_every_tooth(thrown):
    """The greatest of all stations at 2880 angles, next to jumps of the table too."""
    found = verify(thrown)
    engagement, f_z = thrown.engagement, thrown.feed_per_tooth
    angles = np.arange(2880) * np.pi / 1440
    for row in np.flatnonzero(found.computed)[:4]:
        here = np.flatnonzero((engagement.block == row) & engagement.feed)
        peaks = []
        for station in here[:: max(len(here) // 12, 1)]:
            forces = profile_waveform(
                thrown.force_laws[0], thrown.tools[0], f_z=f_z[row], angles=angles,
                lower=engagement.lower[station], upper=engagement.upper[station],
                slope=engagement.slope[station],
            )  # fmt: skip
            peaks.append(np.hypot(forces[:, 0], forces[:, 1]).max())
        # stations whose table is below 0.9 of the row's greatest are not looked at
        assert found.row_peak[row] >= max(peaks) * (1 - 5e-3)
        assert found.ratio[row] * thrown.block_loads.peak[row] == pytest.approx(found.row_peak[row])
    # chords of a table with runout err by -11 to +9 % next to a jump
    ratio = found.ratio[found.computed]
    assert (ratio > 0.85).all() and (ratio < 1.15).all() and np.ptp(ratio) > 1e-3


def test_few_rows_are_the_worst_ones(thrown):
    found = verify(thrown, rows=2)
    order = np.argsort(-thrown.block_loads.peak, kind="stable")
    assert set(np.flatnonzero(found.computed)) == set(order[:2])
    rest = ~found.computed
    assert (found.ratio[rest] == 1.0).all()
    assert np.array_equal(found.row_peak[rest], thrown.block_loads.peak[rest])


def test_a_table_that_promises_too_little_is_found(slot):
    """Loads tabulated for a tool without runout, cut by one that has it."""
    tools = tuple(replace(tool, runout_um=15.0) for tool in slot.tools)
    found = verify(replace(slot, tools=tools))
    # the tooth that stands out takes 50 um and what the other leaves, along the feed 2 x 15 um
    assert found.ratio[found.peak_row] == pytest.approx(1 + 30 / 50, rel=0.02)
    table = load_table(slot.engagement, tools, slot.force_laws, 1e-4)
    again = verify(replace(slot, tools=tools, table=table))
    assert again.ratio[again.peak_row] == pytest.approx(1.0, abs=0.1)


def test_angles_next_to_the_peak_are_finer(slot):
    """A tooth without helix leaves at its greatest chip: an angle may miss it by 1 / 8 degree."""
    down = cut_of("T1 M6\nG0 X-10 Y52.5 S6000 M3\nG1 Z-2 F300\nX70 F600\nM30", resolution=0.2)
    row = int(np.argmax(down.block_loads.peak))
    station = int(np.flatnonzero(down.engagement.block == row)[5])
    f_z = float(down.feed_per_tooth[row])
    forces = profile_waveform(
        down.force_laws[0], TEN, f_z=f_z, lower=down.engagement.lower[station],
        upper=down.engagement.upper[station], angles=np.arange(28800) * np.pi / 14400,
    )  # fmt: skip
    exact = np.hypot(forces[:, 0], forces[:, 1]).max()
    assert station_peak(down, station, f_z) == pytest.approx(exact, rel=3e-3)


class TestFollowing:
    """Axes whose drives were identified."""

    def test_an_axis_is_behind_by_speed_over_loop_gain(self, slot):
        found = verify(slot, drives={"X": drive(), "Y": drive()})
        # 600 mm/min along X; Y stands, and gives way by little to the force across the feed
        assert found.following_um is not None
        assert found.following_um["X"] == pytest.approx(600 / 60e3 / GAIN * 1e6, rel=0.1)
        assert found.following_um["Y"] < 5.0

    def test_without_drives_nothing_is_said(self, slot):
        found = verify(slot)
        assert found.following_um is None and "no drives" in found.axes.reason
        found = verify(slot, drives={"B": drive()})
        assert found.following_um is None and "no axis" in found.axes.reason

    def test_an_unstable_drive_is_a_reason(self, slot):
        found = verify(slot, drives={"X": drive(), "Y": replace(
            drive(), servo=replace(drive().servo, position_gain=1e9))})  # fmt: skip
        assert found.following_um is None and "axis Y is unstable" in found.axes.reason


def test_a_cut_of_air_has_no_peak():
    found = verify(cut_of(SLOT.replace("Z-2.0", "Z3")))
    assert found.peak_N == 0.0 and found.peak_row == -1
    assert (found.ratio == 1.0).all() and not found.computed.any()
