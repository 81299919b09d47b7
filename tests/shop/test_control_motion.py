"""The simulated control's motion: closed forms, another planner, limits, waits."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.schema.si import RPM
from pipeline.shop.control.planner import Control, Operator, Plan, Ramp, section
from pipeline.shop.control.postprocessor import PartProgram, Post, Step, Tool
from pipeline.shop.control.records import display
from pipeline.shop.motion import profile, rest_to_rest
from pipeline.shop.parameters import ControlParameters, MotorParameters

A, J = 3000.0, 40000.0  # mm/s2, mm/s3
TOOL = Tool(number=1, name="T", diameter=10, speed=12000, feed=1200, plunge=300)
EXACT = 1e-9  # rounding of sixty halvings and of sums over seven phases


def plan(program: PartProgram, operator: Operator | None = None, **changes: object) -> Plan:
    """Plan from the reference position, with codes and tool changes that do not scatter."""
    codes = {"codes": ControlParameters().codes, "tool_change_scatter": 0.0}
    control = Control(
        parameters=ControlParameters(**(codes | changes)),  # type: ignore[arg-type]
        motor=MotorParameters(), lengths={1: 100.0, 2: 100.0}, operator=operator or Operator(),
        random=np.random.default_rng(1), place=[-400.0, 0.0, 0.0], tool=2,
    )  # fmt: skip
    return control.run(program)


def post() -> Post:
    made = Post(numbered=False, spaced=True, peck_clearance=1.0)
    made.begin("O1", "TEST", (TOOL,), (0.0, 0.0, 0.0))
    made.take(TOOL)
    made.approach(0.0, 0.0, 5.0)
    return made


def spans(found: Plan, kind: str) -> list[float]:
    return [s.end - s.start for s in found.spans if s.kind == kind]


@pytest.mark.parametrize(
    ("length", "cap", "time"),
    [
        (0.1, 500.0, 4 * (0.1 / (2 * J)) ** (1 / 3)),  # the acceleration is not reached
        (50.0, 500.0, A / J + np.sqrt(A**2 / J**2 + 4 * 50.0 / A)),  # the speed is not reached
        (300.0, 500.0, 300.0 / 500.0 + 500.0 / A + A / J),
    ],
)
def test_one_way_takes_the_time_of_the_closed_form(length, cap, time):
    assert rest_to_rest(length, cap, A, J).duration == pytest.approx(time, rel=EXACT)


def test_profiles_are_as_fast_as_a_time_optimal_planner():
    """Ruckig (MIT) finds the fastest motion under the same limits; ours is that one."""
    ruckig = pytest.importorskip("ruckig")
    random = np.random.default_rng(5)
    for _ in range(300):
        v_0, v_1 = random.uniform(0, 200, 2)
        length, cap = random.uniform(15, 200), random.uniform(200, 400)
        ours = profile(np.array([v_0, v_1]), np.array([length]), np.array([cap]), A, J)
        asked = ruckig.InputParameter(1)
        asked.current_velocity, asked.target_velocity = [v_0], [v_1]
        asked.target_position = [length]
        asked.max_velocity, asked.max_acceleration, asked.max_jerk = [cap], [A], [J]
        theirs = ruckig.Trajectory(1)
        ruckig.Ruckig(1).calculate(asked, theirs)
        assert ours.duration == pytest.approx(theirs.duration, rel=1e-7)  # its own tolerance


stretches = st.lists(
    st.tuples(st.floats(0.05, 80), st.floats(-3.1, 3.1), st.floats(100, 6000)), min_size=1,
    max_size=25,
)  # fmt: skip


@settings(max_examples=150, deadline=None)
@given(stretches)
def test_no_cut_passes_its_limits(blocks):
    """Restated from samples of the speed along polylines; corners from the angle between chords."""
    control = ControlParameters()
    points, heading = [np.zeros(3)], 0.0
    for length, turn, _ in blocks:
        heading += turn
        points.append(points[-1] + length * np.array([np.cos(heading), np.sin(heading), 0]))
    steps = [
        Step(kind="line", line=k + 1, end=tuple(p), feed=b[2])
        for k, (p, b) in enumerate(zip(points[1:], blocks, strict=True))
    ]
    feeds = np.array([b[2] / 60 for b in blocks])
    found = section(tuple(points[0]), steps, feeds, control)
    time = np.arange(0, found.motion.duration, 1e-3)
    s, v = found.motion.at(time)
    block = np.minimum(np.searchsorted(found.ends, s), len(blocks) - 1)
    assert np.all(v <= feeds[block] * (1 + EXACT) + 1e-6)
    slope = np.diff(v) / 1e-3
    assert np.abs(slope).max(initial=0) <= control.cutting_acceleration * 1e3 * (1 + 1e-6)
    jerk = np.abs(np.diff(slope)).max(initial=0) / 1e-3
    assert jerk <= control.cutting_jerk * 1e3 * (1 + 1e-6) + 1e-3  # rounding of two differences
    assert found.motion.length == pytest.approx(sum(b[0] for b in blocks), rel=EXACT)
    for k, (_, turn, _) in enumerate(blocks[1:]):
        bisector = np.cos(turn / 2)  # sine of half the angle that the chords form
        room = control.centripetal_acceleration * 1e3 * control.junction_deviation
        limit = np.inf if bisector == 1 else np.sqrt(room * bisector / (1 - bisector))
        speed = np.interp(found.ends[k], s, v)
        near = A * 1e-3  # what the speed may change between two samples
        assert speed <= limit + near


def test_a_cut_at_reduced_feed_takes_the_closed_form():
    made = post()
    made.line(x=150.0, feed=1200.0)
    found = plan(made.end("O1"), Operator(feed_override=((0, 80.0),)))
    v, control = 16.0, ControlParameters()
    a, j = control.cutting_acceleration * 1e3, control.cutting_jerk * 1e3
    short = 2 * np.sqrt(v / j)  # a change by 16 mm/s does not reach a
    assert v < a * a / j
    assert spans(found, "cut") == [pytest.approx(150 / v + short, rel=EXACT)]


def test_rapids_move_each_axis_on_its_own():
    made = post()
    made.rapid(x=300.0, y=40.0)
    found = plan(made.end("O1"))
    x = ControlParameters().x
    v, a, j = x.rapid / 60, x.acceleration * 1e3, x.jerk * 1e3
    assert spans(found, "rapid")[-1] == pytest.approx(300 / v + v / a + a / j, rel=EXACT)
    moved = [s for s in found.spans if s.kind == "rapid"][-1]
    assert [p.length for p in moved.axes] == pytest.approx([300, 40])


def test_arcs_turn_the_way_of_their_code():
    made = post()
    made.arc(10.0, 10.0, (10.0, 0.0), anticlockwise=False)
    made.arc(0.0, 20.0, (0.0, 10.0), anticlockwise=True)
    made.arc(0.0, 20.0, (0.0, 10.0), anticlockwise=False)
    assert [line[:2] for line in made.lines[-3:]] == ["G2", "G3", "G2"]
    turns = [s.turn for s in made.steps if s.kind == "arc"]
    assert turns == pytest.approx([-np.pi / 2, np.pi / 2, -2 * np.pi])


def test_deep_holes_are_pecked():
    """Fanuc's G83 by hand: up to R after each peck, back to the clearance above it."""
    made = post()
    made.drill([(30.0, 40.0)], 2.0, -9.0, peck=4.0)
    line = len(made.lines) - 1
    heights = [(s.kind, s.end[2]) for s in made.steps if s.line == line]
    assert heights == [
        ("rapid", 5.0), ("rapid", 2.0), ("line", -2.0), ("rapid", 2.0), ("rapid", -1.0),
        ("line", -6.0), ("rapid", 2.0), ("rapid", -5.0), ("line", -9.0), ("rapid", 5.0),
    ]  # fmt: skip


def test_in_position_waits_until_the_lag_has_died_down():
    """The drive x' = k (x_ref - x), integrated in small steps past the end of a rapid."""
    control = ControlParameters()
    way = rest_to_rest(200.0, 600.0, 5e3, 5e4)
    step = 1e-5
    behind, time = 0.0, 0.0
    while time < way.duration or behind > control.in_position:
        speed = way.at(np.array([time]))[1][0] if time < way.duration else 0.0
        behind += step * (speed - control.position_gain * behind)
        time += step
    made = post()
    made.rapid(x=200.0)
    waited = spans(plan(made.end("O1")), "in_position")[-1]
    assert waited == pytest.approx(time - way.duration, abs=2e-4)  # of the small steps


def test_the_look_ahead_sees_as_many_blocks_as_it_is_told():
    """Blocks of 0.02 mm on a line: with ten in sight it must be able to stop within 0.2 mm."""
    steps = [Step(kind="line", line=k, end=(0.02 * k, 0.0, 0.0)) for k in range(1, 1501)]
    feeds = np.full(1500, 100.0)
    far = section((0.0, 0.0, 0.0), steps, feeds, ControlParameters(look_ahead=1500))
    near = section((0.0, 0.0, 0.0), steps, feeds, ControlParameters(look_ahead=10))
    assert far.motion.speed.max() == pytest.approx(100.0)
    a = ControlParameters().cutting_acceleration * 1e3
    assert near.motion.speed.max() <= np.sqrt(2 * a * 0.2)
    assert near.motion.duration > 1.5 * far.motion.duration


def test_the_spindle_takes_up_what_the_motor_gives():
    """Torque times speed, integrated over the run-up, is the energy that turns at its end."""
    ramp = Ramp(motor=MotorParameters(), overload=1.5, n_0=0.0, n_1=9000.0)
    time = np.linspace(0, ramp.duration, 20001)
    omega = ramp.at(time) * RPM
    power = np.minimum(omega / (MotorParameters().base_speed * RPM), 1) * 1.5 * 15e3
    energy = MotorParameters().inertia * (9000 * RPM) ** 2 / 2
    assert np.trapezoid(power, time) == pytest.approx(energy, rel=1e-5)  # of the trapezoids
    back = Ramp(motor=MotorParameters(), overload=1.5, n_0=9000.0, n_1=0.0)
    assert back.at(back.duration - time) == pytest.approx(ramp.at(time), abs=1e-6)


def test_where_the_spindle_is_waited_for():
    made = post()
    made.rapid(z=2.0)
    made.line(x=10.0)
    program = made.end("O1")
    cut = {}
    for where in ("at_m3", "before_cutting"):
        found = plan(program, spindle_wait=where)
        run_up = next(r for _, r in found.ramps if r.n_1)
        begun = next(t for t, r in found.ramps if r is run_up)
        cut[where] = next(s.start for s in found.spans if s.kind == "cut")
        assert cut[where] >= begun + run_up.duration
    # ways and the coolant's answer go on beside the run-up when only the cut waits
    assert cut["before_cutting"] < cut["at_m3"]


def test_a_hold_delays_by_its_length_and_changes_nothing_else():
    made = post()
    made.line(x=100.0)
    program = made.end("O1")
    control, line = ControlParameters(), program.steps[-2].line
    held = Operator(holds={line: 5.0})
    free, hold = (display(plan(program, o), o, control) for o in (Operator(), held))
    extra = (hold.line.size - free.line.size) * control.cycle
    assert extra == pytest.approx(5.0, abs=2 * control.cycle)
    ways = [d.commanded.sum() * control.cycle for d in (free, hold)]
    assert ways[0] == pytest.approx(ways[1], rel=1e-4)  # sums of cycles for integrals
    slope = np.abs(np.diff(hold.commanded[hold.line == line])).max() / control.cycle
    assert slope <= control.cutting_acceleration * 1e3


def test_lines_that_cut_nothing_cannot_be_held():
    made = post()
    operator = Operator(holds={90: 5.0})
    with pytest.raises(ValueError, match="line 90 and those after it cut nothing"):
        display(plan(made.end("O1"), operator), operator, ControlParameters())


def test_cuts_that_an_axis_cannot_follow_are_refused():
    with pytest.raises(ValueError, match=r"5.39, more than the weakest axis can: 4.5"):
        ControlParameters(cutting_acceleration=5.0, centripetal_acceleration=2.0)
