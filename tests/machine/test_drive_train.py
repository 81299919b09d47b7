"""Drive train: stiffness in series, eigenfrequencies, closed forms, order, sticking, energies."""

from dataclasses import replace
from math import inf, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from pipeline.machine.axis.drive_train import (
    COPPER,
    I_D,
    I_Q,
    INPUT,
    LOAD,
    LOST,
    SHAFT,
    STATES,
    TH_L,
    TH_M,
    W_L,
    W_M,
    WORK_ROWS,
    Direction,
    Shafts,
    TransmissionParameters,
    Winding,
    advance,
    resonance,
    twist_torque,
)

SCREW = TransmissionParameters(
    lead=0.01, mass=300, screw_inertia=2e-3, coupling_stiffness=2e4, screw_stiffness=1e4,
    axial_stiffness=3e8,
)  # fmt: skip
inertias = st.floats(1e-5, 1e-1)
stiffnesses = st.floats(1, 1e6)


def test_parts_in_series_by_their_deflections() -> None:
    """The twist under 1 N m is the sum of the parts' own; the nut gives way along the axis."""
    force = 1 / SCREW.ratio
    along = force / SCREW.axial_stiffness
    twist = 1 / 2e4 + 1 / 1e4 + along / SCREW.ratio
    assert 1 / SCREW.stiffness == pytest.approx(twist, rel=1e-14)


def test_rigid_parts_drop_out() -> None:
    assert replace(SCREW, coupling_stiffness=inf, axial_stiffness=inf).stiffness == 1e4
    whole = replace(SCREW, coupling_stiffness=inf, axial_stiffness=inf, screw_stiffness=inf)
    assert whole.stiffness == inf


def test_load_inertia_has_the_kinetic_energy_of_screw_and_table() -> None:
    speed = 37.0
    v = speed * 0.01 / (2 * pi)
    energy = (2e-3 * speed**2 + 300 * v**2) / 2
    assert SCREW.load_inertia * speed**2 / 2 == pytest.approx(energy, rel=1e-14)


@given(inertias, inertias, stiffnesses)
def test_eigenfrequencies_are_those_of_the_matrices(
    motor: float, load: float, stiffness: float
) -> None:
    """Matrix from the shaft's own torque on unit angles."""
    column = [twist_torque(a - b, 0.0, stiffness, 0.0) for a, b in ((1, 0), (0, 1))]
    matrix = np.array([column, [-c for c in column]])
    squares = eigh(matrix, np.diag([motor, load]), eigvals_only=True)
    top = resonance(motor, load, stiffness) ** 2
    assert squares == pytest.approx([0, top], abs=1e-9 * top)


WINDING = Winding(
    resistance=0.19, inductance_d=1.6e-3, inductance_q=2.4e-3, flux=0.064, pole_pairs=4.0
)
DEAD = WINDING._replace(flux=0.0)
"""Without magnets and current: shafts alone."""
SMOOTH = Direction(coulomb=0.0, static=0.0, stribeck=1.0, viscous=0.0)
DRY = Direction(coulomb=0.3, static=0.5, stribeck=3.0, viscous=2e-3)
FREE = Shafts(
    motor_inertia=3.2e-4, motor_damping=0.0, motor_coulomb=0.0, load_inertia=2.7e-3,
    load_damping=0.0, stiffness=680.0, internal_damping=0.0, rigid=False, positive=SMOOTH,
    negative=SMOOTH,
)  # fmt: skip
ONE = FREE._replace(rigid=True, stiffness=0.0)
J = ONE.motor_inertia + ONE.load_inertia


def run(y, time, steps, shafts, *, winding=DEAD, voltage=(0.0, 0.0), load=0.0) -> np.ndarray:
    """States after each of equal steps, shape (steps + 1, STATES)."""
    y, room = np.array(y, float), np.zeros((WORK_ROWS, STATES))
    states = [y.copy()]
    for _ in range(steps):
        advance(y, time / steps, *voltage, load, winding, shafts, room)
        states.append(y.copy())
    return np.array(states)


def start(**values: float) -> np.ndarray:
    y = np.zeros(STATES)
    for name, value in values.items():
        y[{"i_d": I_D, "i_q": I_Q, "w_m": W_M, "w_l": W_L, "th_m": TH_M, "th_l": TH_L}[name]] = (
            value
        )
    return y


@pytest.mark.parametrize("shafts", [ONE, FREE._replace(stiffness=2e3)])
def test_order_four_where_it_is_smooth(shafts: Shafts) -> None:
    """Everything at once, sliding one way, against the finest steps."""
    shafts = shafts._replace(motor_damping=1e-3, positive=DRY, negative=DRY, motor_coulomb=0.1)
    y = start(i_d=-4.0, i_q=20.0, w_m=90.0, w_l=90.0)

    def final(steps: int) -> np.ndarray:
        ran = run(y, 4e-3, steps, shafts, winding=WINDING, voltage=(60.0, 40.0), load=1.0)
        return ran[-1]

    finest = final(4096)
    errors = [np.linalg.norm((final(n) / finest - 1)[:6]) for n in (128, 256, 512)]
    orders = np.log2(errors[:-1]) - np.log2(errors[1:])
    # 4 in the limit; at these steps the next term still shows
    assert orders == pytest.approx(4, abs=0.15)


def test_motor_and_shafts_are_what_an_independent_integrator_says() -> None:
    """The equations of both sources written out again, and scipy's DOP853 on them."""
    K, D, C_m, C_l = 680.0, 0.02, 1e-3, 2e-3
    shafts = FREE._replace(internal_damping=D, motor_damping=C_m, load_damping=C_l)
    R, L_d, L_q, flux, p = WINDING

    def rates(t: float, y: np.ndarray) -> list[float]:
        i_d, i_q, w_m, th_m, w_l, th_l = y
        u = (50 - 20j) * np.exp(-1j * p * th_m)
        torque = 1.5 * p * (flux * i_q + (L_d - L_q) * i_d * i_q)
        return [
            (u.real - R * i_d + p * w_m * L_q * i_q) / L_d,
            (u.imag - R * i_q - p * w_m * (L_d * i_d + flux)) / L_q,
            (torque - C_m * w_m - K * (th_m - th_l) - D * (w_m - w_l)) / 3.2e-4,
            w_m,
            (K * (th_m - th_l) + D * (w_m - w_l) - C_l * w_l - 0.7) / 2.7e-3,
            w_l,
        ]

    first = [3.0, -8.0, 20.0, 0.4, 25.0, 0.39]
    expected = solve_ivp(rates, (0, 0.02), first, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    y = np.concatenate([first, np.zeros(STATES - 6)])
    found = run(y, 0.02, 4000, shafts, winding=WINDING, voltage=(50.0, -20.0), load=0.7)[-1, :6]
    assert found == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize("sign", [1, -1])
def test_coasting_down_under_coulomb_friction(sign: int) -> None:
    """w falls by T_c / J, stops at J w / T_c after J w^2 / 2 T_c, and stays exactly there."""
    dry = Direction(coulomb=0.3, static=0.3, stribeck=1.0, viscous=0.0)
    other = dry._replace(coulomb=9.0, static=9.0)
    shafts = ONE._replace(positive=dry if sign > 0 else other, negative=other if sign > 0 else dry)
    y = start(w_m=10.0 * sign, w_l=10.0 * sign)
    stop = J * 10 / 0.3
    states = run(y, 2 * stop, 777, shafts)
    time = np.linspace(0, 2 * stop, 778)
    assert states[:, W_L] == pytest.approx(sign * np.maximum(10 - 0.3 / J * time, 0), abs=1e-11)
    after = states[time > stop]
    assert np.all(after[:, [W_M, W_L]] == 0) and np.all(after[:, TH_L] == after[0, TH_L])
    assert after[-1, TH_L] == pytest.approx(sign * J * 100 / (2 * 0.3), rel=1e-11)
    # all that moved is heat
    assert after[-1, LOST] == pytest.approx(J * 100 / 2, rel=1e-11)


@pytest.mark.parametrize("shafts", [ONE, FREE])
@pytest.mark.parametrize("sign", [1, -1])
def test_below_the_static_level_nothing_creeps(shafts: Shafts, sign: int) -> None:
    up, down = DRY, DRY._replace(static=0.8)
    shafts = shafts._replace(positive=up, negative=down, motor_coulomb=0.1)
    # a load against motion pushes downwards; rigid shafts hold with the motor's bearings as well
    level = (0.8 if sign > 0 else 0.5) + (0.1 if shafts.rigid else 0.0)
    held = run(np.zeros(STATES), 1.0, 1000, shafts, load=sign * level * (1 - 1e-9))
    assert np.all(held == 0)
    gone = run(np.zeros(STATES), 0.01, 10, shafts, load=sign * level * (1 + 1e-9))[-1]
    assert gone[TH_L] * -sign > 0


def test_a_reversal_keeps_its_order() -> None:
    """Thrown against a load: slides, is still, slides back; errors against 16 times the steps."""
    shafts = ONE._replace(positive=DRY, negative=DRY, motor_coulomb=0.05)
    y = start(w_m=12.0, w_l=12.0)

    def final(steps: int) -> np.ndarray:
        states = run(y, 0.05, steps, shafts, load=2.0)
        # one body: its stop is the motor's as well
        assert np.array_equal(states[:, W_M], states[:, W_L])
        return states[-1, [W_L, TH_L]]

    exact = final(50_000)
    errors = np.array([np.abs(final(n) - exact).max() for n in (50, 100, 200, 400)])
    assert np.all(final(50) < 0)
    assert errors[-1] < 1e-8
    assert np.log2(errors[0] / errors[-1]) / 3 > 3


def pulled(t: float, y: np.ndarray, mode: float, held: float) -> list[float]:
    """A load drawn by a spring whose end moves at 2 rad/s; friction slides forwards or sticks."""
    w, angle = y
    s = max(w, 0.0)
    friction = DRY.coulomb + (DRY.static - DRY.coulomb) * np.exp(-((s / 3.0) ** 2)) + 2e-3 * s
    pull = 30.0 * (2.0 * t - angle)
    return [mode * (pull - friction) / FREE.load_inertia, mode * w]


def stick_slip_by_events(time: float) -> list[float]:
    """Instants of break-away and of coming to rest, by scipy's event location."""

    def breaks(t: float, y: np.ndarray, *_: float) -> float:
        return 30.0 * (2.0 * t - y[1]) - DRY.static

    def rests(t: float, y: np.ndarray, *_: float) -> float:
        return y[0]

    breaks.terminal, breaks.direction = True, 1
    rests.terminal, rests.direction = True, -1
    t, y, instants, mode = 0.0, np.zeros(2), [], 0.0
    while t < time:
        event = rests if mode else breaks
        # a nudge carries the start of sliding over its own event
        first = y + np.array([1e-12 * mode, 0.0])
        part = solve_ivp(pulled, (t, time), first, "DOP853", events=event, args=(mode, 0.0),
                         rtol=1e-11, atol=1e-13)  # fmt: skip
        t, y = part.t[-1], part.y[:, -1] * [mode, 1.0]
        if part.status == 1:
            instants.append(t)
            y[0] = 0.0
            mode = 1.0 - mode
    return instants


def test_stick_and_slip_last_as_long_as_with_located_events() -> None:
    """The motor turns at 2 rad/s (its inertia is huge) and draws the load by a soft shaft."""
    shafts = FREE._replace(motor_inertia=1e9, stiffness=30.0, positive=DRY, negative=DRY)
    steps, time = 60_000, 0.3
    states = run(start(w_m=2.0), time, steps, shafts)
    moving = states[:, W_L] > 0
    h = time / steps
    instants = (np.flatnonzero(np.diff(moving.astype(int))) + 0.5) * h
    expected = stick_slip_by_events(time)
    assert len(expected) >= 8
    assert len(instants) == len(expected)
    # a change of the state shows half a step early or late, break-away up to one step later
    assert instants == pytest.approx(expected, abs=1.6 * h)
    assert np.all(states[:, W_L] >= 0)


@settings(max_examples=60, deadline=None)
@given(
    st.floats(-30, 30), st.floats(-30, 30), st.floats(-100, 100), st.floats(-100, 100),
    st.floats(-150, 150), st.floats(-150, 150), st.floats(-5, 5), st.booleans(),
)  # fmt: skip
def test_energy_goes_nowhere_else(
    i_d: float, i_q: float, w_m: float, w_l: float, u: float, v: float, load: float, rigid: bool
) -> None:
    """Electrical and mechanical balance over 2 ms from any state, reversals and sticking within."""
    shafts = (ONE if rigid else FREE)._replace(
        positive=DRY, negative=DRY._replace(coulomb=0.2), motor_coulomb=0.1, motor_damping=1e-3,
        internal_damping=0.0 if rigid else 0.02,
    )  # fmt: skip
    w_l = w_m if rigid else w_l
    y = start(i_d=i_d, i_q=i_q, w_m=w_m, w_l=w_l)
    states = run(y, 2e-3, 1000, shafts, winding=WINDING, voltage=(u, v), load=load)
    s = states.T
    field = 0.75 * (WINDING.inductance_d * s[I_D] ** 2 + WINDING.inductance_q * s[I_Q] ** 2)
    kinetic = (shafts.motor_inertia * s[W_M] ** 2 + shafts.load_inertia * s[W_L] ** 2) / 2
    elastic = shafts.stiffness * (s[TH_M] - s[TH_L]) ** 2 / 2
    electrical = s[INPUT] - s[COPPER] - s[SHAFT] - (field - field[0])
    stored = kinetic + elastic
    mechanical = s[SHAFT] - s[LOST] - s[LOAD] - (stored - stored[0])
    size = np.abs(s[[INPUT, COPPER, SHAFT, LOST, LOAD]]).max() + field.max() + stored.max() + 1e-3
    assert np.abs(electrical).max() < 1e-9 * size
    assert np.abs(mechanical).max() < 1e-9 * size


@given(
    st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(0, 50), st.floats(0, 50),
    st.floats(1e-4, 1e2), st.floats(-1e3, 1e3), st.booleans(),
)  # fmt: skip
def test_friction_never_gives_energy_nor_a_number_that_is_none(
    w_m: float, w_l: float, coulomb: float, more: float, stribeck: float, load: float, rigid: bool
) -> None:
    dry = Direction(coulomb=coulomb, static=coulomb + more, stribeck=stribeck, viscous=1e-3)
    shafts = (ONE if rigid else FREE)._replace(positive=dry, negative=dry, motor_coulomb=coulomb)
    states = run(start(w_m=w_m, w_l=w_m if rigid else w_l), 1e-3, 50, shafts, load=load)
    assert np.isfinite(states).all()
    # a body that turns back and forth within one step is not seen: its friction over that step
    swing = np.abs(np.diff(states[:, [W_M, W_L]], axis=0)).max()
    unseen = (2 * coulomb + more) * swing * 1e-3 / 50
    assert np.all(np.diff(states[:, LOST]) >= -unseen - 1e-12 * (1 + states[-1, LOST]))


def test_a_stiff_shaft_goes_over_into_a_rigid_one() -> None:
    """Motions of the load differ by 1/K: a tenth of the compliance, a tenth of the difference."""
    steps = 20_000

    def final(shafts: Shafts) -> float:
        ran = run(start(), 0.02, steps, shafts, winding=WINDING, voltage=(20.0, 10.0))
        return ran[-1, TH_L]

    rigid = final(ONE)
    soft, stiff = (
        final(FREE._replace(stiffness=K, internal_damping=0.2)) - rigid for K in (1e4, 1e5)
    )
    # what is left of the first swing and the next term of the series
    assert soft / stiff == pytest.approx(10, rel=0.1)
