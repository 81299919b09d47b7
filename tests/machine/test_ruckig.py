"""Single moves with bounded jerk against ruckig, which is time-optimal."""

import numpy as np
import pytest

from pipeline.machine.control.look_ahead import (
    peak_speed,
    profile_duration,
    profile_state,
    profile_time,
)
from pipeline.machine.control.planner import limited_path, plan, rest_to_rest
from tests.machine.programs import Writer, control

ruckig = pytest.importorskip("ruckig", reason="the oracle of jerk-limited moves is not installed")


def optimum(distance, v, a, jerk, v_0=0.0, v_1=0.0):
    given = ruckig.InputParameter(1)
    given.current_position, given.target_position = [0.0], [float(distance)]
    given.current_velocity, given.target_velocity = [float(v_0)], [float(v_1)]
    given.max_velocity, given.max_acceleration, given.max_jerk = [float(v)], [float(a)], [jerk]
    found = ruckig.Trajectory(1)
    assert ruckig.Ruckig(1).calculate(given, found) == ruckig.Result.Working
    return found


def cases(many, seed):
    rng = np.random.default_rng(seed)
    draw = np.exp(rng.uniform(*np.log([[1e-6, 0.02, 0.1, 5], [1, 1, 10, 500]]), (many, 4)))
    return draw.tolist()


def test_rest_to_rest_is_optimal():
    for distance, v, a, jerk in cases(300, 1):
        best = optimum(distance, v, a, jerk).duration
        # both are closed forms; ruckig solves for its roots to about 1e-8
        assert rest_to_rest(distance, v, a, jerk) == pytest.approx(best, rel=1e-6)


def test_program_of_one_line_is_optimal():
    for distance, v, a, jerk in cases(30, 2):
        writer = Writer().set(feed=v * 60e3).to(X=distance * 1e3)
        limits = {"cutting_acceleration": a * 1e3, "jerk": jerk * 1e3, "cutting_speed": 1e6}
        took = plan(limited_path(writer.moves, control(profile="s_curve", limits=limits))).total
        assert took == pytest.approx(optimum(distance, v, a, jerk).duration, rel=1e-6)


def test_profile_between_two_speeds_is_optimal_and_passes_the_same_places():
    rng = np.random.default_rng(3)
    compared = 0
    for distance, v, a, jerk in cases(300, 4):
        v_0, v_1 = rng.uniform(0, v, 2)
        needed = abs(v_1**2 - v_0**2) / (2 * a) + (v_0 + v_1) * a / jerk
        distance = distance + needed  # far enough that no speed must be undercut
        top = peak_speed(v_0, v_1, distance, v, a, jerk)
        duration = profile_duration(v_0, v_1, top, distance, a, jerk)
        best = optimum(distance, v, a, jerk, v_0, v_1)
        if best.duration < duration * (1 - 1e-6):
            # the optimum may use acceleration at the ends of a short move, up to 1 %
            assert best.duration == pytest.approx(duration, rel=0.01)
            continue
        compared += 1
        for t in np.linspace(0, duration, 9)[1:-1]:
            s, speed = profile_state(v_0, v_1, top, distance, a, jerk, t)
            place, velocity, _ = best.at_time(t)
            assert s == pytest.approx(place[0], abs=1e-6 * distance)
            assert speed == pytest.approx(velocity[0], abs=1e-5 * v)
            assert profile_time(v_0, v_1, top, distance, a, jerk, s) == pytest.approx(t, rel=1e-7)
    assert compared > 250
