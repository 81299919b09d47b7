"""The planner: other planners, monotony, populations, overrides, binding limits, refused input."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.gcode.moves import FeedMode, Kind
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.path import Binding
from pipeline.machine.control.planner import limited_path, plan
from tests.machine.programs import Writer, axis, control, row_times
from tests.machine.random_programs import Bounds, bounds, random_control, random_moves


def polyline_time(points: np.ndarray, feed: float, bounds: Bounds, arc: np.ndarray) -> float:
    """Time along a polyline, shape (N, 3) [m], at ``feed`` [m/s]; standstill at both ends.

    Another planner, slow and simple, that shares no code with the one tested: limits are put on the
    cells and corners of a fine grid of the path, the acceleration is kept from point to point
    backwards and forwards, and time is the sum of ds / v.

    Parameters
    ----------
    bounds : Bounds
        Its ``acceleration`` is that along the path [m/s^2].
    arc : (3,) array
        What the jumps at the corners may come to [m/s^2].
    """
    steps = np.diff(points, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    unit = steps / sizes[:, None]
    with np.errstate(divide="ignore"):
        cap = np.minimum(feed, (bounds.speed / np.abs(unit)).min(axis=1))
        acceleration = (bounds.acceleration / np.abs(unit)).min(axis=1)
    corner = np.full(len(points), np.inf)
    for k in range(1, len(unit)):
        change = np.abs(unit[k] - unit[k - 1])
        for i in np.flatnonzero(change > 1e-9):
            corner[k] = min(corner[k], bounds.jump[i] / change[i])
            for block in (k - 1, k):
                by_speed = np.sqrt(arc[i] * sizes[block] / change[i])
                by_time = arc[i] * sizes[block] / bounds.jump[i]
                cap[block] = min(cap[block], max(by_speed, by_time))
    corner[[0, -1]] = 0
    speed, fall, ds = _grid(sizes, cap, corner, acceleration)
    for k in range(len(speed) - 2, -1, -1):
        speed[k] = min(speed[k], np.sqrt(speed[k + 1] ** 2 + 2 * fall[k] * ds[k]))
    for k in range(len(speed) - 1):
        speed[k + 1] = min(speed[k + 1], np.sqrt(speed[k] ** 2 + 2 * fall[k] * ds[k]))
    return float((2 * ds / (speed[1:] + speed[:-1])).sum())


def _grid(sizes, cap, corner, acceleration, cells=400):
    """Speeds at the points of a grid, acceleration and size of its cells."""
    ds = np.repeat(sizes / cells, cells)
    speed = np.empty(len(ds) + 1)
    speed[:-1] = np.repeat(cap, cells)
    speed[-1] = cap[-1]
    joints = np.arange(len(sizes) + 1) * cells
    padded = np.concatenate([[np.inf], cap, [np.inf]])
    speed[joints] = np.minimum(corner, np.minimum(padded[:-1], padded[1:]))
    return speed, np.repeat(acceleration, cells), ds


def polyline(rng, many=12):
    return np.cumsum(rng.normal(0, 1, (many, 3)) * np.exp(rng.uniform(-3, 1, (many, 1))), axis=0)


def program(points, feed=3000.0):
    writer = Writer().set(feed=feed)
    for x, y, z in points:
        writer.to(X=x, Y=y, Z=z)
    return writer.moves


@pytest.mark.parametrize("seed", range(8))
def test_times_are_those_of_a_simple_simulator(seed):
    rng = np.random.default_rng(seed)
    points = polyline(rng)
    parameters = dataclasses.replace(
        random_control(rng, corner="jump", filters=False), rapid_mode="linear"
    )
    limits = bounds(parameters, rapid=False)
    arc = np.array([parameters.axes[i].arc_acceleration for i in "XYZ"]) * 1e-3
    along = dataclasses.replace(limits, acceleration=limits.acceleration - arc)
    whole = np.vstack([np.zeros(3), points]) * 1e-3
    expected = polyline_time(whole, 0.05, along, arc)
    # ds / mean v is exact for constant acceleration; peaks lie between points of the grid
    assert plan(limited_path(program(points), parameters)).total == pytest.approx(
        expected, rel=1e-3
    )


@given(seed=st.integers(0, 10**6), share=st.floats(1.0, 3.0))
@settings(max_examples=60, deadline=None)
def test_more_feed_never_takes_longer(seed, share):
    rng = np.random.default_rng(seed)
    path = limited_path(random_moves(rng), random_control(rng, corner="tolerance"))
    feeds = path.moves.feed
    slow, fast = plan(path, feeds=feeds), plan(path, feeds=feeds * share)
    assert fast.total <= slow.total * (1 + 1e-12)
    assert (fast.v_out >= slow.v_out * (1 - 1e-12)).all()


@pytest.mark.parametrize(
    "name", ["cutting_speed", "rapid_speed", "cutting_acceleration", "rapid_acceleration",
             "arc_acceleration"],
)  # fmt: skip
def test_a_higher_limit_never_takes_longer(name):
    for seed in range(15):
        rng = np.random.default_rng(seed)
        parameters = random_control(rng, corner="jump")
        axes = {
            letter: dataclasses.replace(a, **{name: 1.5 * getattr(a, name)})
            for letter, a in parameters.axes.items()
        }
        moves = random_moves(rng)
        before = plan(limited_path(moves, parameters)).total
        after = plan(limited_path(moves, dataclasses.replace(parameters, axes=axes))).total
        assert after <= before * (1 + 1e-12)


def test_jerk_makes_slower_and_vanishes_with_no_bound():
    moves = program(polyline(np.random.default_rng(6)))
    plain = plan(limited_path(moves, control())).total
    times = [
        plan(limited_path(moves, control(profile="s_curve", limits={"jerk": jerk}))).total
        for jerk in (1e4, 1e5, 1e9)
    ]
    assert times[0] > times[1] > plain
    assert times[2] == pytest.approx(plain, rel=1e-3)


@pytest.mark.parametrize("profile", ["trapezoid", "s_curve"])
def test_population_is_its_individuals(profile):
    rng = np.random.default_rng(7)
    writer = Writer().set(feed=500, speed=2000, direction=1).row(Kind.SPINDLE)
    for x, y, z in polyline(rng, 20):
        writer.to(X=x, Y=y, Z=z)
    writer.set(feed=0.1, feed_mode=FeedMode.PER_REVOLUTION).to(X=0).row(Kind.DWELL, value=5, code=1)
    path = limited_path(writer.moves, control(profile=profile, limits={"jerk": 30000}))
    many = 5
    feeds = path.moves.feed * rng.uniform(0.5, 2, (many, len(path)))
    speeds = rng.uniform(1000, 5000, (many, len(path)))
    each = [plan(path, feeds=f, speeds=s).time for f, s in zip(feeds, speeds, strict=True)]
    assert row_times(path, feeds, speeds) == pytest.approx(np.array(each), rel=1e-12)


def test_overrides_scale_what_they_are_for():
    writer = Writer().set(feed=3000).rapid(X=100).to(X=200)
    path = limited_path(writer.moves, control())
    half_feed = plan(path, feed_override=50).time
    half_rapid = plan(path, rapid_override=50).time
    plain = plan(path).time
    v, a = 0.025, 2.0
    assert half_feed == pytest.approx([plain[0], 0.1 / v + v / a], rel=1e-9)
    assert half_rapid == pytest.approx([0.1 / 0.25 + 0.25 / 5, plain[1]], rel=1e-9)
    each = plan(path, feed_override=[1, 50], rapid_override=[50, 1]).time
    assert each.tolist() == [half_rapid[0], half_feed[1]]


def test_what_binds_each_row():
    writer = Writer().set(feed=1000).rapid(X=50).to(X=60).set(feed=15000).arc((60, 2), np.pi)
    writer.to(X=30).to(Y=30).by((0.01, 0)).to(Y=50).rapid(Z=0.001)
    limit = plan(limited_path(writer.moves, control())).limit
    assert [Binding(b).name for b in limit] == [
        "RAPID", "FEED", "ARC", "CORNER", "CORNER", "CURVE", "EXACT_STOP", "EXACT_STOP",
    ]  # fmt: skip


def test_chords_are_bound_as_a_curve_and_by_a_tolerance():
    angle = np.linspace(0, 3, 60)[1:]
    points = np.stack([np.cos(angle) - 1, np.sin(angle), 0 * angle], axis=1)
    moves = program(points, feed=15000)
    assert plan(limited_path(moves, control())).limit[30] == Binding.CURVE
    tight = control(corner="tolerance", tolerance=0.002, cutting_filter=(0.02, 0.0))
    assert plan(limited_path(moves, tight)).limit[30] == Binding.TOLERANCE


def test_tolerance_of_the_program_counts_for_every_control():
    moves = Writer().set(feed=3000, tolerance=0.005).to(X=50).to(Y=50).moves
    parameters = control(cutting_filter=(0.004, 0.0), limits={"corner_jump": 1000})
    tight = plan(limited_path(moves, parameters))
    without = dataclasses.replace(moves, tolerance=np.zeros(2))
    loose = plan(limited_path(without, parameters))
    # E|S| = T / 4, r = T / 6: v = 2 tol / (E|S| sqrt 2) - a r
    v = 2 * 5e-6 / (0.001 * np.sqrt(2)) - 2.0 * 0.004 / 6
    assert tight.v_out[0] == pytest.approx(v, rel=1e-9)
    assert loose.v_out[0] == pytest.approx(1 / 60, rel=1e-9)


def test_corner_that_no_speed_keeps_within_its_tolerance_is_a_standstill():
    moves = Writer().set(feed=3000, tolerance=0.001).to(X=50).to(Y=50).moves
    result = plan(limited_path(moves, control(cutting_filter=(0.02, 0.0))))
    assert result.v_out[0] == 0
    assert result.wait.tolist() == pytest.approx([0.02, 0.02])


@pytest.mark.parametrize("rows", [0, 1])
def test_program_that_does_not_move_takes_no_time(rows):
    writer = Writer()
    for _ in range(rows):
        writer.to(X=0)
    result = plan(limited_path(writer.moves, control()))
    assert result.total == 0
    assert len(result.v_out) == len(result.limit) == rows


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"feeds": [0, 0]}, r"part\.nc:1: F 0\.0 of a row that cuts must be finite and positive"),
        ({"feeds": [100, np.nan]}, r"part\.nc:2: F nan of a row"),
        ({"feeds": [100, np.inf]}, r"part\.nc:2: F inf of a row"),
        ({"feeds": [100]}, r"feeds has shape \(1,\), the program 2 rows"),
        ({"feeds": np.ones((2, 2))}, "plan takes the feeds and speeds of one individual, got 2"),
        ({"speeds": np.ones((3, 2))}, "plan takes the feeds and speeds of one individual, got 3"),
        ({"speeds": [-1, 0]}, r"part\.nc:1: S -1\.0 must be finite and at least 0"),
        ({"feed_override": 0}, r"feed_override = 0\.0 % must be finite and positive"),
        ({"rapid_override": [100, -5]}, r"rapid_override = -5\.0 % must be"),
        ({"rapid_override": [100]}, r"rapid_override has shape \(1,\): give one value, or 2"),
    ],
)
def test_commands_that_cannot_be_are_refused(change, message):
    path = limited_path(Writer().to(X=1).to(X=2).moves, control())
    with pytest.raises(ValueError, match=message):
        plan(path, **change)


def test_feed_per_revolution_needs_a_turning_spindle():
    writer = Writer().set(feed_mode=FeedMode.PER_REVOLUTION, speed=100).to(X=1)
    with pytest.raises(ValueError, match=r"part\.nc:1: the feed is bound to the spindle"):
        plan(limited_path(writer.moves, control()))


def test_surface_speed_at_the_centre_needs_a_limit():
    writer = Writer().set(
        feed_mode=FeedMode.PER_REVOLUTION, speed=100, direction=1, constant_surface_speed=True
    ).to(Z=1)  # fmt: skip
    with pytest.raises(ValueError, match=r"give auxiliary\.maximum_speed"):
        plan(limited_path(writer.moves, control()))


def test_axis_that_the_control_lacks_is_named():
    with pytest.raises(ValueError, match=r"part\.nc:2: axis B moves, the control has X"):
        limited_path(Writer().to(X=1).to(B=3).moves, ControlParameters(axes={"X": axis()}))


def test_positions_must_be_numbers():
    moves = Writer().to(X=1).to(X=np.nan).moves
    with pytest.raises(ValueError, match=r"part\.nc:2: position \[nan, 0\.0"):
        limited_path(moves, control())


def test_a_block_takes_at_most_300_bytes_with_its_moves():
    writer = Writer()
    for x in range(200):
        writer.to(X=x)
    result = plan(limited_path(writer.moves, control()))
    result.time  # noqa: B018
    arrays = [array for _, array in result.path.moves.columns()]
    for part in (result, result.path, result.motion):
        arrays += [value for value in vars(part).values() if isinstance(value, np.ndarray)]
    assert sum(array.nbytes for array in arrays) <= 300 * 200


def test_threads_take_no_override() -> None:
    writer = Writer().set(feed=1.5, feed_mode=FeedMode.PER_REVOLUTION, speed=600, direction=1)
    path = limited_path(writer.to(kind=Kind.THREAD, Z=-30).moves, control())
    assert plan(path, feed_override=20).total == plan(path).total
