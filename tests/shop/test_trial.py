"""Trial cuts: programs read from their text, ways of the axes, forces, parts that differ."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.cutting.force import Motion, pass_forces, wear
from pipeline.shop.cutting.parameters import Conditions, Dynamometer, EndMill, Workpiece
from pipeline.shop.parameters import Cutting, ShopParameters
from pipeline.shop.trial.cutting import BATCH, LENGTH, TOP, Chance, Steps, _chip, chance, cut
from pipeline.shop.trial.job import TrialJob, shop_part
from pipeline.shop.trial.motion import Track, control_of, program_steps, track
from pipeline.shop.trial.trials import Trial, prepare, trial, trials

from .conftest import shop_parameters

MILL = EndMill(number=1, diameter=6.0, flutes=2, helix=0.0, sharpness=(1.0, 1.0))
JOB = TrialJob(blank=(0.0, 40.0, 0.0, 30.0, -10.0, 0.0), limit_load_N=60.0, tools={1: MILL})
MACHINE = ShopParameters(machine="trial")
HEAD = "G21 G90 G54\nG0 X-5 Y15 S5000 M3\nG43 Z5 H1\n"
SLOT = f"{HEAD}G1 Z-1 F200\nX30 F300\nG0 Z5\nM30\n"


def way_of(text: str, job: TrialJob = JOB, machine: ShopParameters = MACHINE) -> Track:
    program = program_steps(text, "P", job, machine.control)
    control = control_of(program, job, machine, np.random.default_rng(0))
    return track(control.run(program), job, machine.control)


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
@pytest.mark.parametrize("each", [3, pytest.param(1, marks=pytest.mark.proof)])
def test_a_program_read_from_its_text_takes_the_time_of_the_steps_it_was_written_with(
    machine, each
):
    """Facing, contours, pockets, chords, drilling with and without pecks; 1 us of rounding.

    Of each third program, or of all.
    """
    parameters = shop_parameters(machine)
    programs, _ = part_programs(parameters.control, parameters.generator("part programs"))
    for program in [*programs[::each], shop_part(parameters).program]:
        lengths = {t.number: t.length for t in program.tools}
        job = replace(JOB, lengths=lengths, tools={n: replace(MILL, number=n) for n in lengths})
        read = program_steps(program.text, program.name, job, parameters.control)
        took = [
            control_of(read, job, parameters, np.random.default_rng(1)).run(one).duration
            for one in (program, read)
        ]
        assert took[1] == pytest.approx(took[0], abs=1e-6 * len(program.steps)), program.name


def test_axes_lag_by_feed_over_gain_and_round_corners():
    """A ramp's lag behind a first-order lag is v / k; sampled at 2 ms it is v (1/k - dt/2)."""
    way = way_of(f"{HEAD}G1 Z-1 F3000\nX35\nY40\nG0 Z5\nM30\n")
    k, dt, v = MACHINE.control.position_gain, MACHINE.control.cycle, 50.0
    along = way.tip[(way.line == 5) & (way.tip[:, 0] > 10) & (way.tip[:, 0] < 25)]
    assert np.diff(along[:, 0]) == pytest.approx(np.full(len(along) - 1, v * dt), rel=1e-4)
    turning = way.tip[way.line == 6][0]  # the command is at the corner, the tool is not yet
    assert 35 - turning[0] == pytest.approx(v * (1 / k - dt / 2), rel=0.6)
    near = np.hypot(way.tip[:, 0] - 35, way.tip[:, 1] - 15)[way.tip[:, 2] < 0].min()
    assert 0.02 < near < v / k


def test_arcs_are_circles_and_helices_go_down_with_the_angle():
    """At a feed so slow that the lag (v / k = 30 um) shrinks the radius by less than 0.1 um."""
    way = way_of(f"{HEAD}G0 X25\nG1 Z0 F60\nG3 X25 Y15 Z-2 I-5 J0 F60\nG0 Z5\nM30\n")
    arc = way.tip[way.line == 6][1:]
    radius = np.hypot(arc[:, 0] - 20, arc[:, 1] - 15)
    assert radius == pytest.approx(np.full(len(arc), 5.0), abs=1e-3)
    angle = np.unwrap(np.arctan2(arc[:, 1] - 15, arc[:, 0] - 20))
    slope = np.polyfit(angle[200:-200], arc[200:-200, 2], 1)[0]
    assert slope == pytest.approx(-2 / (2 * np.pi), rel=1e-4)


def test_a_slot_takes_its_own_area_and_each_cell_when_the_tool_reaches_it():
    """Area of half a disc and a strip to a cell's width along its edge; ways to two cells."""
    its = prepare(SLOT, "P", JOB, MACHINE).swept
    r, cell, reach = 3.0, its.cell, 30.0
    taken = np.isfinite(its.first[0])
    area = 2 * r * reach + np.pi * r**2 / 2
    assert taken.sum() * cell**2 == pytest.approx(area, abs=cell * (2 * reach + np.pi * r))
    middle = int((15.0 - its.corner[1]) / cell)
    columns = np.arange(200, 1400)
    ahead = its.corner[0] + (columns + 0.5) * cell
    begins = its.path[np.flatnonzero(its.cuts)[0]]  # the front is at X0
    assert its.first[0, middle, columns] - begins == pytest.approx(ahead, abs=2 * cell)


def slot_cut(job: TrialJob, seed: int) -> Trial:
    """The slot read and cut anew."""
    return trial(prepare(SLOT, "P", job, MACHINE), job, MACHINE, seed)


def test_the_same_seed_is_the_same_part_and_another_one_is_not():
    one, again = (slot_cut(JOB, 7) for _ in range(2))
    assert one == again
    its = prepare(SLOT, "P", JOB, MACHINE)
    assert trial(its, JOB, MACHINE, 7) == one
    other = trial(its, JOB, MACHINE, 8)
    assert other.peak_load_N != one.peak_load_N and other.time_s != one.time_s


def test_parts_scatter_as_they_are_said_to():
    """2000 draws: standard errors are 1.6 % of a deviation, 2 % of Rayleigh's mean."""
    random = np.random.default_rng(5)
    parts = [chance(JOB, MACHINE, random) for _ in range(2000)]
    batch = np.array([p.workpiece.tangential for p in parts]) / Workpiece().tangential
    assert batch.mean() == pytest.approx(1, abs=4 * BATCH / 2000**0.5)
    assert batch.std() == pytest.approx(BATCH, rel=0.07)
    runout = np.array([p.tools[1].runout for p in parts])
    assert runout.mean() == pytest.approx(MILL.runout, rel=0.05)
    assert (runout > 2 * MILL.runout).mean() == pytest.approx(np.exp(-np.pi), abs=0.02)
    deeper = np.array([p.deeper[1] for p in parts])
    assert deeper.std() == pytest.approx(np.hypot(LENGTH, TOP), rel=0.07)
    assert all(0 <= p.used[1] <= 15 for p in parts)


def test_a_trial_has_the_time_and_the_peak_of_each_line():
    found = slot_cut(JOB, 1)
    assert found.peak_line == 5 and found.peak_load_N == found.peaks_N[5] > 30
    assert min(found.peaks_N.values()) == 0 and list(found.peaks_N) == sorted(found.peaks_N)
    assert slot_cut(replace(JOB, limit_load_N=500.0), 1).peaks_N == found.peaks_N


def test_trials_cut_the_same_parts_before_and_after():
    slower = SLOT.replace("F300", "F150")
    found = trials(SLOT, slower, replace(JOB, limit_load_N=60.0), MACHINE, range(3))
    assert found["seeds"] == 3 and found["before"]["above"] == 3
    assert found["after"]["time_s"]["mean"] - found["before"]["time_s"]["mean"] == pytest.approx(
        35 / 2.5 - 35 / 5, abs=0.05
    )
    assert found["after"]["peak_load_N"]["mean"] < found["before"]["peak_load_N"]["mean"] - 10
    same = trials(SLOT, SLOT, JOB, MACHINE, [4])
    assert same["before"] == same["after"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{HEAD}G18 G2 X5 Z5 I5 K0 F100\nM30\n", "P:4 is an arc outside the plane XY"),
        (f"{HEAD}G1 A5 F100\nM30\n", "P:4 moves a rotary axis"),
        ("%\n(NOTHING)\n%\n", "P does nothing"),
        ("G0 X0 S500 M4\nM30\n", "P:1 turns the spindle to the left"),
        (f"{HEAD}G33 Z-5 K1\nM30\n", "P:4 probes or cuts a thread"),
        (SLOT.replace("S5000 M3", ""), "cuts while the spindle stands"),
        (f"T7 M6\n{SLOT}", "P:6 goes into the blank with tool 7, which the job does not have"),
    ],
)
def test_what_the_mill_cannot_do_is_said_with_its_line(text, message):
    with pytest.raises(ValueError, match=message):
        prepare(text, "P", JOB, MACHINE)


def test_what_is_no_job_is_refused():
    for changes, message in (
        ({"blank": (0.0, 0.0, 0.0, 1.0, 0.0, 1.0)}, "TrialJob.blank"),
        ({"limit_load_N": 0.0}, "TrialJob.limit_load_N = 0.0 N must be finite and positive"),
        ({"tools": {}}, "TrialJob.tools"),
    ):
        with pytest.raises(ValueError, match=message):
            replace(JOB, **changes)
    with pytest.raises(ValueError, match="one seed or more"):
        trials(SLOT, SLOT, JOB, MACHINE, [])


STEADY = ShopParameters(
    machine="trial", cutting=Cutting(dynamometer=Dynamometer(speed_error=0.0, speed_wander=0.0))
)
PLAIN = EndMill(
    number=1, diameter=6.0, flutes=2, helix=0.0, runout=0.0, tilt=0.0, sharpness=(1.0, 1.0)
)
EVEN = replace(PLAIN, break_in=0.0, wear_rate=0.0)
OFFSET = replace(EVEN, runout=6.0, runout_angle=40.0, tilt=0.5, tilt_angle=100.0)
HELIX = EndMill(
    number=1, runout=6.5, tilt=0.6, break_in=0.0, wear_rate=0.0
)  # of 12 mm, three teeth, 30 degrees
"""Wears as aluminium wears it; its tests leave that out, as a pass has the wear of its middle."""
BLANK = (0.0, 40.0, 0.0, 30.0, -10.0, 0.0)
USED = 5.0
"""What a tooth has cut before [m]."""


def loads(lines: str, tool: EndMill, blank=BLANK, speed: int = 5000) -> dict[int, float]:
    """Of a program that begins at X-20 Y-20 Z5, without any chance."""
    text = f"G21 G90 G54\nG0 X-20 Y-20 S{speed} M3\nG43 Z5 H1\n{lines}\nG0 Z5\nM30\n"
    job = TrialJob(blank=blank, limit_load_N=60.0, tools={1: tool})
    its = prepare(text, "P", job, STEADY)
    part = Chance(
        workpiece=job.workpiece, tools={1: tool}, used={1: USED}, deeper={1: 0.0},
        speed_error=0.0, angle=0.3,
    )  # fmt: skip
    return cut(its.track, its.swept, part, STEADY, np.random.default_rng(0))


def straight(tool: EndMill, immersion: str, width: float, feed: float, speed: float, depth: float):
    """Peak load of a straight pass in the middle of its block [N]."""
    c = Conditions(immersion=immersion, depth=depth, width=width, feed=feed, speed=speed)
    angle = np.arange(6 * 720) * 2 * pi / 720
    x = 0.02 + angle / (2 * pi) * feed / speed * 1e-3
    force = pass_forces(
        c,
        tool,
        Workpiece(),
        Motion(angle=angle, x=x),
        flank=Workpiece().flank(wear(tool, USED)),
        length=40.0,
        slice_height=0.0625,
    )
    return float(np.hypot(force[:, 0], force[:, 1]).max())


@pytest.mark.parametrize("tool", [EVEN, OFFSET, HELIX], ids=["plain", "offset", "helix"])
@pytest.mark.parametrize(("immersion", "share"), [("slot", 1), ("up", 0.5), ("down", 0.5),
                                                  ("up", 0.1), ("down", 0.1)])  # fmt: skip
def test_a_straight_cut_is_a_straight_pass(tool, immersion, share):
    """1 % of the peak: steps of 3 degrees, slices of 0.25 mm, walls known to half a cell."""
    width, feed, r = share * tool.diameter, 300.0, tool.diameter / 2
    y = {"slot": 15.0, "up": 30.0 - width + r, "down": width - r}[immersion]
    found = loads(f"G0 Y{y}\nG1 Z-1 F200\nX30 F{feed}", tool)
    expected = straight(tool, immersion, width, feed, 5000.0, 1.0)
    assert found[6] == pytest.approx(expected, rel=0.01)


def test_an_inside_corner_loads_the_tool_more_than_the_walls_beside_it():
    """0.3 mm along two walls of a frame that was slotted before; the corner has its own lines."""
    frame = "G0 X8 Y8\nG1 Z-1 F200\nX32 F300\nY22\nG0 Z5\n"
    walls = "G0 X8 Y7.7\nG1 Z-1 F200\nX26 F300\nX32.3\nY14\nY18\nG0 Z5"
    found = loads(frame + walls, EVEN)
    wall = straight(EVEN, "down", 0.3, 300.0, 5000.0, 1.0)
    slot = straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0)
    assert [found[11], found[14]] == pytest.approx([wall, wall], rel=0.02)
    assert wall < 0.85 * slot and found[12] == pytest.approx(slot, rel=0.02)


def test_what_was_cut_before_is_cut_no_more():
    """A second pass along the first, with teeth that are alike, finds nothing."""
    way = "G0 Y15\nG1 Z-1 F200\nX45 F300\nG0 Z5\nX-20\n"
    found = loads(2 * way, EVEN)
    assert found[6] > 50 and found.get(11, 0.0) == 0
    deeper = loads(way + way.replace("Z-1", "Z-1.5"), EVEN)
    assert deeper[11] == pytest.approx(found[6] / 2, rel=0.02)


def test_an_open_arc_is_cut_like_the_line_that_it_nearly_is():
    """On a radius of 12 mm the chip is that of the slot: the tool's centre moves at the feed."""
    found = loads("G0 X5 Y15\nG1 Z-1 F300\nX8\nG2 X32 Y15 I12 J0\nG0 Z5", EVEN)
    expected = straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0)
    assert found[7] == pytest.approx(expected, rel=0.02)


def test_the_load_goes_with_the_depth_and_the_chip():
    way = "G0 Y15\nG1 Z-1 F200\nX45 F300\nG0 Z5"
    one = loads(way, EVEN)[6]
    assert loads(way.replace("Z-1", "Z-2"), EVEN)[6] == pytest.approx(2 * one, rel=1e-3)
    fast = straight(EVEN, "slot", 6.0, 500.0, 5000.0, 1.0)
    assert loads(way.replace("F300", "F500"), EVEN)[6] == pytest.approx(fast, rel=0.01)


def test_a_ramp_reaches_the_load_of_its_depth_little_by_little():
    """Layers of a quarter of a millimetre, each cut from where the tip stands in it."""
    found = loads("G0 X0 Y15\nG1 Z0 F300\nX40 Z-1\nG0 Z5", EVEN, blank=(-30.0, 80.0, 0, 30, -5, 0))
    whole = straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0)
    half = loads("G0 X0 Y15\nG1 Z0 F300\nX20 Z-0.5\nG0 Z5", EVEN, blank=(-30.0, 80.0, 0, 30, -5, 0))
    assert found[6] == pytest.approx(whole, rel=0.03)
    assert half[6] == pytest.approx(whole / 2, rel=0.04)


def test_where_the_blank_ends_the_cut_ends():
    found = loads("G0 Y15\nG1 Z-1 F200\nX-4 F300\nG0 Z5\nX46\nG1 Z-1\nX50\nG0 Z5", EVEN)
    assert not any(found.values())


@settings(max_examples=12, deadline=None)
@given(turned=st.floats(0, 2 * pi))
def test_the_load_does_not_ask_where_the_way_points(turned):
    """A slot and a shoulder of a quarter beside it, up and back down, 12 mm through a wide blank.

    1.5 %: cells are squares, and the shoulder's wall is known to a cell.
    """
    along, left = (
        np.array([np.cos(turned), np.sin(turned)]),
        np.array([-np.sin(turned), np.cos(turned)]),
    )
    places = [-6 * along, 6 * along, 6 * along + 1.5 * left, -2 * along + 1.5 * left]
    a, b, c, d = (f"X{20 + x:.4f} Y{15 + y:.4f}" for x, y in places)
    way = f"G0 {a}\nG1 Z-1 F300\n{b} F300\nG0 Z5\n{c}\nG1 Z-1\n{d}\nG0 Z5"
    found = loads(way, EVEN, blank=(0.0, 40.0, 0.0, 30.0, -5.0, 0.0))
    assert found[6] == pytest.approx(straight(EVEN, "slot", 6.0, 300.0, 5000.0, 1.0), rel=0.015)
    assert found[10] == pytest.approx(straight(EVEN, "down", 1.5, 300.0, 5000.0, 1.0), rel=0.015)


def test_chips_on_a_bent_way_are_those_of_true_paths():
    """Against a root finder on the ways of all earlier teeth about a centre that turns.

    The centre goes 0.25 mm a turn on a radius of 2 mm; 0.1 um of chips of 20 um and more: between
    two pitches the centre's way counts as straight.
    """
    turn, feed, bend = 360, 0.25, 2.0
    angle = 2 * pi + np.arange(3 * turn) * 2 * pi / turn
    at = feed * angle / (2 * pi) / bend
    steps = Steps(angle=angle, x=bend * np.sin(at), y=-bend * np.cos(at), z=0 * at, path=bend * at)
    radii = np.array([[3.004], [2.997], [3.0]])
    found, expected = [], []
    for k in range(2 * turn, 3 * turn, 7):
        phi = angle[k]
        found.append(_chip(radii, 0, 0, np.sin(phi), np.cos(phi), steps, k, turn))
        reached = [_reached(phi, back, radii[-back % 3, 0], feed, bend) for back in (1, 2, 3)]
        expected.append(max(radii[0, 0] - max(reached), 0.0))
    assert found == pytest.approx(expected, abs=1e-4)
    assert sum(h > 0.02 for h in found) > 20


def _reached(phi: float, back: int, radius: float, feed: float, bend: float) -> float:
    """How far out on today's radius at ``phi`` the tooth ``back`` teeth earlier came (of three)."""

    def centre(angle: float) -> np.ndarray:
        at = feed * angle / (2 * pi) / bend
        return bend * np.array([np.sin(at), -np.cos(at)])

    def place(gone: float) -> np.ndarray:
        own = phi + back * 2 * pi / 3 - gone
        return centre(phi - gone) + radius * np.array([np.sin(own), np.cos(own)]) - centre(phi)

    middle, across = back * 2 * pi / 3, np.array([np.cos(phi), -np.sin(phi)])
    crossed = brentq(lambda gone: float(place(gone) @ across), middle - 0.4, middle + 0.4)
    return float(place(crossed) @ [np.sin(phi), np.cos(phi)])
