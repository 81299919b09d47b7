"""The servo's equation as a table: exact where it can be worked out by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.submodels.drive.records import AxisConstants
from pipeline.submodels.drive.servo_equation import (
    NODES,
    TERMS,
    Nominal,
    ServoRecord,
    delayed,
    servo_bandwidth,
    servo_equation,
    servo_low_passed,
)
from pipeline.submodels.drive.servo_fit import closed_forms

H = 1e-3
T = 6000
TIME = np.arange(T) * H
LIST = Nominal.of(AxisConstants(position_gain=50.0, velocity_gain=300.0, integral_gain=6000.0))
SCALES = dict.fromkeys(("position_scale", "velocity_scale", "integral_scale"), 1.0)


def waves(*frequencies):
    """Motion far below the filter [m], a wave of each frequency [Hz]."""
    return sum(1e-2 / f * np.sin(2 * np.pi * f * TIME + f) for f in frequencies)


def vector(**terms):
    return np.array([{**SCALES, **terms}.get(name, 0.0) for name in TERMS])


def late(signal_of, delay, spread=0.0):
    """A signal of time seen late, and to second order through a lag."""
    second = (signal_of(TIME + H) - 2 * signal_of(TIME) + signal_of(TIME - H)) / H**2
    return signal_of(TIME - delay) + 0.5 * spread * delay**2 * second


def exact(**terms):
    """A record whose command follows from the equation by closed forms: x and e are waves."""
    p = dict(zip(TERMS, vector(**terms), strict=True))
    w, b = 2 * np.pi * 3.0, 2 * np.pi * 2.0

    def e(t):
        return 1e-3 * np.sin(b * t)

    def x(t):
        return 1e-2 * np.sin(w * t)

    def swept(t):
        return -1e-3 / b * np.cos(b * t)

    def v(t):
        return 1e-2 * w * np.cos(w * t)

    def feed(t):
        return v(t) + 1e-3 * b * np.cos(b * t)

    def ahead(t):
        return -1e-2 * w**2 * np.sin(w * t) - 1e-3 * b**2 * np.sin(b * t)

    tx, tv, s = p["position_lag"], p["velocity_lag"], p["lag_spread"]
    Kp, Kv = 50.0 * p["position_scale"], 300.0 * p["velocity_scale"]
    Ki, fv = 6000.0 * p["integral_scale"], p["velocity_feedforward"]
    held = Kv + Ki * p["position_hold"]
    A = held * (Kp * late(e, tx, s) + fv * late(feed, tx, s)) - Kv * late(v, tv, s)
    A += Ki * (Kp * late(swept, tx, s) + fv * late(lambda t: x(t) + e(t), tx, s) - late(x, tv, s))
    A += p["acceleration_feedforward"] * late(ahead, tx, s)
    return ServoRecord(reference=x(TIME) + e(TIME), position=x(TIME), command=A + 3.0, period=H)


@pytest.mark.parametrize(
    "terms",
    [
        {},
        {"position_scale": 0.7, "velocity_scale": 1.3, "integral_scale": 0.4},
        {"position_lag": 1.7e-3, "velocity_lag": 0.6e-3},
        {"position_lag": 2.1e-3, "velocity_lag": 1.4e-3, "lag_spread": 0.8},
        {"position_hold": 4e-4, "velocity_feedforward": 0.6},
        {"velocity_feedforward": 1.0, "acceleration_feedforward": 1.5, "position_lag": 5e-4},
    ],
    ids=str,
)
def test_the_true_servo_leaves_nothing_over(terms):
    equation = servo_equation([exact(**terms)], LIST, 40.0)
    # the filter lets 1e-4 of a wave of 3 Hz through differently at the edges of its padding
    assert equation.rmse(vector(**terms)) < 2e-3 * equation.spread
    other = vector(**terms) * np.where(np.array(TERMS) == "velocity_scale", 1.1, 1.0)
    assert equation.rmse(other) > 0.01 * equation.spread


def test_backward_differences_of_the_reference_are_half_a_sample_late():
    """Its equation leaves nothing over of a servo that has them; another difference does."""
    record, terms = exact(), {"velocity_feedforward": 0.8, "acceleration_feedforward": 2.0}
    r = record.reference
    once = np.diff(r, prepend=r[0]) / H
    twice = np.diff(once, prepend=once[0]) / H
    swept = H * np.cumsum(once - 0.5 * np.diff(once, prepend=once[0]))
    fed = 0.8 * (300.0 * once + 6000.0 * swept) + 2.0 * twice
    record = replace(record, command=record.command + fed)
    left = {
        each: servo_equation([record], LIST, 40.0, each).rmse(vector(**terms))
        for each in ("central", "backward")
    }
    ahead = 0.8 * 300.0 * twice[100:-100].std()
    # half a sample of what is fed forward
    assert left["central"] > 0.3 * (0.5 * H) * ahead
    assert left["backward"] < 0.02 * left["central"]


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.floats(0.3, 3.0), min_size=3, max_size=3), st.floats(0, 1), st.floats(0, 2),
    st.floats(0, 3.9e-3), st.floats(0, 3.9e-3), st.floats(0, 5e-4), st.floats(0, 1),
)  # fmt: skip
def test_slopes_are_the_differences_of_the_factors(scales, fv, fa, tx, tv, hold, spread):
    equation = EQUATION
    at = np.array([*scales, fv, fa, tx, tv, hold, spread])
    found = equation.slopes(at)
    for k in range(len(TERMS)):
        step = np.zeros(len(TERMS))
        step[k] = 1e-7 if "lag" in TERMS[k] and TERMS[k] != "lag_spread" else 1e-4
        difference = (equation.factors(at + step) - equation.factors(at - step)) / (2 * step[k])
        # central differences of polynomials of fourth degree: third derivative times step squared,
        # and what the subtraction of two rounded factors leaves
        rounding = 4 * np.finfo(float).eps * np.abs(equation.factors(at)).max() / step[k]
        atol = 3e-5 * np.abs(difference).max() + rounding
        np.testing.assert_allclose(found[:, k], difference, atol=atol)


EQUATION = servo_equation([exact()], LIST, 40.0)


def test_triangle_stands_for_all_rows():
    at = vector(velocity_scale=1.2, position_lag=1e-3)
    by_rows = EQUATION.columns @ EQUATION.factors(at)
    rmse = np.sqrt(np.mean(by_rows**2))
    assert EQUATION.rmse(at) == pytest.approx(rmse, rel=1e-9)
    assert EQUATION.triangle.shape[0] < EQUATION.rows / 10
    many = np.stack([at, vector(), vector(velocity_feedforward=0.3)])
    np.testing.assert_allclose(EQUATION.rmse(many), [EQUATION.rmse(one) for one in many])


@given(st.lists(st.floats(-2, 2), min_size=NODES, max_size=NODES), st.floats(0, NODES - 1))
def test_delays_are_exact_for_polynomials(coefficients, places):
    """Up to the fourth degree in time."""
    signal = np.polynomial.Polynomial(coefficients)
    nodes = signal(-EQUATION.node * np.arange(NODES))
    weight, slope, _ = EQUATION._late(np.array(places * EQUATION.node), np.array(0.0))
    t = -places * EQUATION.node
    assert weight @ nodes == pytest.approx(signal(t), abs=1e-9)
    assert slope @ nodes == pytest.approx(-signal.deriv()(t), abs=1e-6)


def test_closed_forms_give_the_gains_of_a_servo_without_lags():
    found = closed_forms(EQUATION, 0.0, LIST.fixed)
    np.testing.assert_allclose(found[:3], 1.0, rtol=5e-3)


def test_bandwidth_goes_by_the_error_at_constant_feed():
    """e = v / (S_pp P_p)."""
    position = 0.05 * TIME
    record = ServoRecord(
        reference=position + 0.05 / 20.0, position=position, command=TIME, period=H
    )
    assert servo_bandwidth([record]) == pytest.approx(12 * 20 / (2 * np.pi), rel=1e-6)


def test_no_error_at_all_leaves_the_recorders_rate():
    position = waves(2.0)
    record = ServoRecord(reference=position, position=position, command=TIME, period=H)
    assert servo_bandwidth([record]) == pytest.approx(0.08 / H)


def test_filter_keeps_what_is_slow_where_it_is():
    slow = np.sin(2 * np.pi * 2 * TIME)
    fast = np.sin(2 * np.pi * 300 * TIME)
    found = servo_low_passed(slow + fast, H, 40.0)
    # (2 / 40)^6 is what a filter of third order, run both ways, takes from the wave
    np.testing.assert_allclose(found[500:-500], slow[500:-500], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"command": np.full(T, 2.0)}, "never changes"),
        ({"command": np.where(np.arange(T) == 9, np.nan, TIME)}, "no number"),
    ],
    ids=["still", "nan"],
)
def test_records_that_make_no_table_are_refused(change, words):
    position = waves(2.0)
    record = {"reference": position, "position": position, "command": TIME, "period": H} | change
    with pytest.raises(ValueError, match=words):
        servo_equation([ServoRecord(**record)], LIST, 40.0)


def test_delays_of_whole_samples_need_no_interpolation() -> None:
    """The samples themselves are what the spline between them gives a millionth beside."""
    signals = np.stack([waves(k + 1.0) for k in range(8)])
    rows = np.arange(100, T - 100, 7)
    beside = delayed(signals, rows, 3.0 + 1e-5)
    np.testing.assert_allclose(delayed(signals, rows, 3.0), beside, atol=1e-7)
    assert (
        delayed(signals, rows, 3.0)[0, :NODES].tolist()
        == signals[0, 100 - 3 * np.arange(NODES)].tolist()
    )
