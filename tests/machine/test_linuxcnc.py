"""Blended corners against LinuxCNC's own trajectory planner.

The times stored here are its own: `python -m tests.machine.linuxcnc`, where Debian's package
linuxcnc-uspace (2.9.0) is installed.  `make proof` runs it again.
"""

import numpy as np
import pytest

from pipeline.gcode.moves import METRE, METRE_PER_SECOND
from pipeline.machine.control.interpolate import trace
from pipeline.machine.control.parameters import AxisParameters, BlendParameters, ControlParameters
from pipeline.machine.control.planner import limited_path, plan
from tests.gcode.following import follow
from tests.machine.linuxcnc import (
    CYCLE,
    MILLTASK,
    OVERRIDDEN,
    PARABOLIC,
    PROGRAMS,
    UNLIKE,
    planned_times,
    programs_of,
)
from tests.machine.programs import Writer, row_times

CLOSE = 0.006
"""Greatest share by which a time may differ [1]: two to four cycles of a short program."""
RUNS = 3
"""Tries of a program: where other work holds up the interpreter, the planner waits for it."""
TIMES = {
    "lines": 0.773, "rapids": 2.36, "circle 0.5": 0.698, "circle 1": 0.986, "circle 5": 2.2,
    "circle 20": 5.497, "zigzag 90": 1.576, "zigzag sharp": 2.097, "zigzag flat": 0.935,
    "zigzag P0.01": 2.461, "zigzag P0.1": 2.416, "zigzag slow": 3.461, "zigzag G61": 1.501,
    "spiral": 6.139,
    "spiral P0.02": 6.148, "helix": 3.974, "pocket P0.05": 4.237, "slots": 5.041,
    "lines and arcs": 2.89, "zigzag in space": 1.19, "pecks": 9.57,
}  # fmt: skip
TIMES_BY_PARABOLAS = {
    "zigzag 90": 1.777, "zigzag flat": 2.102, "circle 5": 3.204, "helix": 5.235,
    "lines and arcs": 4.6, "zigzag P0.1": 2.855, "spiral": 15.099, "pecks": 10.513,
}  # fmt: skip
TIMES_WITH_OVERRIDE = {"zigzag slow": 3.438, "pocket P0.05": 3.404, "lines and arcs": 2.07}
"""Times of the planner itself on ``UNLIKE``, ``PARABOLIC`` and ``OVERRIDDEN`` [s]."""


def control(machine=UNLIKE, **changes):
    axes = {
        letter: AxisParameters(
            rapid_speed=60 * v, cutting_speed=60 * v, rapid_acceleration=a, cutting_acceleration=a,
            arc_acceleration=a, corner_jump=0.0,
        )
        for letter, v, a in zip("XYZ", machine.speed, machine.acceleration, strict=True)
    }  # fmt: skip
    settings = {
        "corner": "blend",
        "blend": BlendParameters(arcs=machine.arcs, feed_scale=machine.feed_scale),
        "rapid_stop": "change",
        "path_speed": 60.0 * machine.path_speed,
        "interpolation_period": CYCLE,
    }
    return ControlParameters(axes=axes, **settings | changes)


def planned(text, machine=UNLIKE, **changes):
    return plan(limited_path(follow(text, dialect="linuxcnc"), control(machine, **changes)))


@pytest.mark.parametrize(
    ("machine", "times"),
    [(UNLIKE, TIMES), (PARABOLIC, TIMES_BY_PARABOLAS), (OVERRIDDEN, TIMES_WITH_OVERRIDE)],
)
def test_times_are_those_of_the_planner(machine, times):
    found = {name: planned(text, machine).total for name, text in programs_of(machine).items()}
    assert found == pytest.approx(times, rel=CLOSE)


@pytest.mark.proof
@pytest.mark.skipif(not MILLTASK.exists(), reason=f"{MILLTASK} is not installed")
@pytest.mark.parametrize("machine", [UNLIKE, PARABOLIC, OVERRIDDEN])
def test_the_planner_itself_takes_that_time(machine):
    programs = late = programs_of(machine)
    times = {name: planned(text, machine).total for name, text in programs.items()}
    found: dict[str, float] = {}
    for _ in range(RUNS):
        again = planned_times(machine, late)
        found |= {name: min(time, found.get(name, time)) for name, time in again.items()}
        late = {n: programs[n] for n in times if times[n] != pytest.approx(found[n], rel=0.03)}
        if not late:
            break
    assert times == pytest.approx(found, rel=0.03)


def test_a_circle_takes_its_share_of_the_acceleration_towards_the_centre():
    circles = "G21 G17 G61\nG0 X1\nF6000\n" + "G2 I-1\n" * 3
    times = planned(circles).time
    inward = 0.75**0.5 * min(UNLIKE.acceleration[:2])
    assert times[2] == pytest.approx(2 * np.pi / inward**0.5, rel=1e-3)  # r = 1 mm
    half = planned(circles, blend=BlendParameters(arc_share=0.25)).time
    assert half[2] == pytest.approx(
        2 * np.pi / (0.25 * min(UNLIKE.acceleration[:2])) ** 0.5, rel=1e-3
    )


def test_a_tolerance_costs_time_without_filters():
    tight, wide, none, exact = (
        planned(PROGRAMS["zigzag P0.1"].replace("G64 P0.1", mode)).total
        for mode in ("G64 P0.001", "G64 P0.1", "G64", "G61")
    )
    assert none < wide < tight < exact


def test_exact_path_stands_only_where_the_direction_changes():
    text = "G21 G90 {}\nG1 X10 F6000\nX20\nX30\nY5\nM2\n"
    through, stops = (planned(text.format(mode)).v_out for mode in ("G61", "G61.1"))
    assert through[:4] / METRE == pytest.approx([100, 100, 0, 0])
    assert stops == pytest.approx(0)


def test_lines_within_the_tolerance_of_their_chord_are_one():
    writer = Writer().set(tolerance=0.01, feed=6000.0)
    for k in range(40):
        writer.to(X=k + 1.0, Y=0.008 * (k % 2))
    wavy = limited_path(writer.moves, control())
    assert wavy.segments.first.tolist() == [0]
    straight = plan(limited_path(Writer().set(feed=6000.0).to(X=40.0).moves, control()))
    assert plan(wavy).total == pytest.approx(straight.total, rel=1e-3)
    assert plan(wavy).time == pytest.approx(straight.total / 40, rel=1e-2)


def test_rapids_of_several_axes_keep_the_limit_of_the_path():
    rapid = planned("G21 G90\nG0 X300 Y400\nM2\n", path_speed=3000.0)
    assert rapid.v_peak.max() == pytest.approx(3000 * METRE_PER_SECOND)
    slow = planned("G21 G90 G61\nG0 X3 Y4\nM2\n", path_acceleration=100.0)
    assert slow.total == pytest.approx(2 * (5 / 100) ** 0.5, abs=CYCLE)
    fanuc = control(corner="jump", path_speed=3000.0)
    other = plan(limited_path(follow("G21\nG0 X300 Y400\n"), fanuc))
    assert other.v_peak.max() == pytest.approx(3000 * METRE_PER_SECOND)


@pytest.mark.parametrize("name", ["zigzag flat", "helix", "pocket P0.05", "spiral P0.02"])
@pytest.mark.parametrize("machine", [UNLIKE, PARABOLIC])
def test_positions_go_on_along_the_programmed_path(name, machine):
    drawn = planned(PROGRAMS[name], machine)
    track = trace(drawn)
    fastest = np.abs(np.diff(track.position, axis=0)).max() / CYCLE
    assert fastest < 1.5 * drawn.v_peak.max()  # corners that are cut are not left out
    ends = np.searchsorted(track.time, np.cumsum(drawn.time)[drawn.path.moving])
    reached = track.position[np.minimum(ends, len(track) - 1), :3]
    wanted = drawn.path.moves.end[drawn.path.moving, :3] * METRE
    assert np.abs(reached - wanted).max() <= 1.5 * drawn.v_peak.max() * CYCLE


def test_a_population_takes_the_times_of_its_individuals():
    path = limited_path(follow(PROGRAMS["pocket P0.05"], dialect="linuxcnc"), control())
    feeds = path.moves.feed * np.array([[1.0], [0.5], [3.0]])
    times = row_times(path, feeds, np.atleast_2d(path.moves.speed))
    for one, time in zip(feeds, times, strict=True):
        assert plan(path, feeds=one).time == pytest.approx(time)
    assert times.sum(axis=1)[1] > times.sum(axis=1)[0] >= times.sum(axis=1)[2]


def test_segments_of_any_size_have_a_time_and_a_speed():
    rng = np.random.default_rng(3)
    for arcs in (True, False):
        writer = Writer()
        for _ in range(400):
            writer.set(tolerance=float(rng.choice([0.0, 0.02])), feed=float(rng.choice([9, 9e4])))
            size = float(rng.choice([1e-4, 0.01, 1.0, 50.0]))
            if rng.random() < 0.5:
                writer.by(size * rng.normal(size=3))
            else:
                centre = writer.at[:2] + size * rng.normal(size=2)
                writer.arc(centre, rng.uniform(0.1, 9) * rng.choice([-1, 1]), rise=size / 3)
        drawn = plan(limited_path(writer.moves, control(blend=BlendParameters(arcs=arcs))))
        moving = drawn.path.moving
        assert (drawn.time[moving] > 0).all()
        assert (drawn.v_peak[moving] > 0).all()
        assert (drawn.v_out <= 0.2).all()  # of the fastest axis


def test_programs_that_hardly_move():
    assert planned("G21\nM2\n").total == 0
    assert planned("G21\nG1 X1 F60\n").total == pytest.approx(1.0, abs=0.01)
