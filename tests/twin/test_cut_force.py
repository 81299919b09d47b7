"""Force of the cut by the path's position, in the machine's axes, and the axes under it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.waveform import profile_waveform
from pipeline.machine.control.interpolate import trace
from pipeline.schema.store import unstructured
from pipeline.twin.cut.axes import axes_in_cut, cut_force, follow_cut
from tests.twin.cut_parts import DEPTH, K_E, K_T, SLOT, cut_of
from tests.twin.test_program_axes import drive

F_Z = 600 / 6000 / 2 * 1e-3


def slot_force() -> tuple[float, float]:
    """Mean of a slot along the feed and to its left by Altintas' eq. 2.44: -+ N a_p f_z K / 4."""
    each = 2 * DEPTH * 1e-3 * F_Z * K_T / 4
    return -K_E * each, each


def at_middle(text: str, **more):
    """Force while the tool is fully in a cut: (force, cut, the whole)."""
    cut = cut_of(text, **more)
    path = trace(cut.plan)
    found = cut_force(cut, path)
    inside = found.cutting & (np.abs(found.f_z - F_Z) < 1e-9)
    assert inside.sum() > 500
    return np.median(found.force[inside], axis=0), cut, found


@pytest.mark.parametrize(("begin", "end", "feed", "left"), [
    ("X-10 Y25", "X70", (1, 0), (0, 1)),
    ("X70 Y25", "X-10", (-1, 0), (0, -1)),
    ("X30 Y-10", "Y60", (0, 1), (-1, 0)),
    ("X-10 Y-10", "X60 Y60", (0.5**0.5, 0.5**0.5), (-(0.5**0.5), 0.5**0.5)),
])  # fmt: skip
def test_a_slot_pushes_the_tool_back_and_to_its_left(begin, end, feed, left) -> None:
    """The closed form, whichever way the slot goes; bins of 5 degrees blur 1 %."""
    text = f"T1 M6\nG0 {begin} S6000 M3\nZ5\nG1 Z-{DEPTH} F300\n{end} F600\nG0 Z5\nM30\n"
    force, _, _ = at_middle(text)
    along, across = slot_force()
    expected = along * np.array(feed) + across * np.array(left)
    assert force[:2] == pytest.approx(expected, abs=0.015 * across)


def test_the_other_hand_of_the_spindle_mirrors_the_slot() -> None:
    force, _, _ = at_middle(SLOT.replace("M3", "M4"))
    along, across = slot_force()
    assert force[:2] == pytest.approx([along, -across], abs=0.015 * across)


def test_a_rotated_work_offset_turns_the_force_with_the_feed() -> None:
    """G68 turns what the machine does; forces are the machine's."""
    text = SLOT.replace("T1 M6\n", "T1 M6\nG68 X30 Y25 R90\n")
    force, _, _ = at_middle(text)
    along, across = slot_force()
    assert force[:2] == pytest.approx([-across, along], abs=0.015 * across)


def test_mean_and_ripple_are_those_of_the_waveform() -> None:
    """At a station of half immersion: mean, and the standard deviation of the whole waveform."""
    text = SLOT.replace("Y25", "Y0")
    _, cut, found = at_middle(text)
    inside = found.cutting & (np.abs(found.f_z - F_Z) < 1e-9)
    own = np.flatnonzero(cut.engagement.feed & (cut.engagement.slope == 0))
    station = int(own[np.argmax(cut.engagement.length[own])])
    forces = profile_waveform(
        cut.force_laws[0], cut.tools[0], f_z=F_Z, lower=cut.engagement.lower[station],
        upper=cut.engagement.upper[station], angles=np.arange(720) * np.pi / 720,
        slope=float(cut.engagement.slope[station]),
    )  # fmt: skip
    got = cut.table.mean_forces(np.array([station]), np.array([F_Z]))[0]
    assert got[:2] == pytest.approx(forces[:, :2].mean(axis=0), rel=0.01)
    assert got[3:5] == pytest.approx(forces[:, :2].std(axis=0), rel=0.01)
    inside = found.cutting & (np.abs(found.f_z - F_Z) < 1e-9)
    assert np.median(found.ripple[inside], axis=0)[:2] == pytest.approx(
        np.sqrt(2) * got[3:5], rel=0.02
    )
    assert np.unique(found.tooth_frequency[inside]).tolist() == [200.0]


def test_air_has_no_force_and_a_delay_moves_the_cut_later() -> None:
    cut = cut_of(SLOT)
    path = trace(cut.plan)
    now, late = cut_force(cut, path), cut_force(cut, path, 0.05)
    assert (now.force[~now.cutting] == 0).all() and (now.tooth_frequency[~now.cutting] == 0).all()
    first, second = (path.time[np.argmax(one.cutting)] for one in (now, late))
    assert second - first == pytest.approx(0.05, abs=2e-3)
    # in at X = -5, 5 mm after the start of the move at feed
    assert path.position[np.argmax(now.cutting), 0] == pytest.approx(-5e-3, abs=0.6e-3)


def test_the_motor_draws_the_force_and_integral_action_keeps_the_error() -> None:
    """A steady force F along the feed costs F / k more current and, in the end, no error."""
    cut = cut_of(SLOT)
    found = follow_cut(cut, {"X": drive(), "Y": drive()})
    steady = found.load.cutting & (np.abs(found.load.f_z - F_Z) < 1e-9)
    along, _ = slot_force()
    extra = found.cut["X"].command[steady] - found.air["X"].command[steady]
    assert np.median(extra) == pytest.approx(-along / 400, rel=0.02)
    behind = found.cut["X"].error[steady] - found.air["X"].error[steady]
    assert np.abs(np.median(behind)) < 1e-7
    (x, y) = axes_in_cut(found, cut.plan.path.moves.line)
    assert x.axis == "X" and x.command > x.command_air and x.following_line == 5
    assert x.force_N == pytest.approx(-along, rel=0.02) and y.force_N > x.force_N


def test_an_axis_whose_force_constant_is_not_listed_is_left_out() -> None:
    cut = cut_of(SLOT)
    found = follow_cut(cut, {"X": replace(drive(), force_unit="A"), "Y": drive()})
    assert list(found.cut) == ["Y"]


def test_a_program_in_air_has_no_axes_in_the_cut() -> None:
    cut = cut_of(SLOT.replace("Z-2.0", "Z3"))
    found = follow_cut(cut, {"X": drive()})
    assert axes_in_cut(found, cut.plan.path.moves.line) == ()
    np.testing.assert_array_equal(found.cut["X"].command, found.air["X"].command)


def test_a_residual_is_asked_in_air_and_added_under_the_force() -> None:
    """It was learnt beside a model without a load: the force must not reach its inputs."""
    cut, seen = cut_of(SLOT), []

    def residual(letter, reference, modelled_error, modelled_command, period):
        seen.append(modelled_command)
        return np.full(len(reference), 7e-6), np.full(len(reference), 3e-6)

    bare = follow_cut(cut, {"X": drive()})
    found = follow_cut(cut, {"X": drive()}, residual=residual)
    assert len(seen) == 1
    np.testing.assert_array_equal(seen[0], bare.air["X"].command)
    np.testing.assert_allclose(found.air["X"].error, bare.air["X"].error + 7e-6, atol=1e-15)
    steady = found.load.cutting & (np.abs(found.load.f_z - F_Z) < 1e-9)
    steady &= np.abs(bare.load.f_z - F_Z) < 1e-9
    gained = found.cut["X"].error - bare.cut["X"].error
    assert np.median(gained[steady]) == pytest.approx(7e-6, rel=1e-3)
    (x,) = axes_in_cut(found, cut.plan.path.moves.line)
    assert x.half_width_um == 3.0
    assert "half_width_um" not in unstructured(axes_in_cut(bare, cut.plan.path.moves.line)[0])
