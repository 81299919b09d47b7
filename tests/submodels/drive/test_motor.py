"""A motor, simulated here, identified with their intervals; and what is not excited.

The noise of a sample is 0.3 V, 0.05 A and 0.5 rad/s (electrical): about 2 % of what the voltages
and 1 % of what the currents swing by.
"""

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from pipeline.submodels.drive.motor import MotorFit, Windows, identify_motor

R, L_D, L_Q, FLUX = TRUE = np.array([0.8, 6e-3, 9e-3, 0.12])
PERIOD, MANY = 1e-4, 8000
T = np.arange(MANY) * PERIOD
Signal = Callable[[np.ndarray], np.ndarray]
WIDEST = 0.5


def speed(t: np.ndarray) -> np.ndarray:
    return 300 + 200 * np.sin(2 * np.pi * 1.3 * t)


def tones(t: np.ndarray, stretch: float) -> np.ndarray:
    frequencies = np.array([17.0, 61.0, 143.0, 291.0]) * stretch
    return 3 * np.sin(2 * np.pi * np.multiply.outer(t, frequencies) + frequencies).sum(axis=-1)


def currents(u_d: Signal, u_q: Signal, w_e: Signal, step: float = 1e-3) -> np.ndarray:
    """Of the motor under these voltages, shape (2, T)."""

    def slope(t: float, i: np.ndarray) -> list[float]:
        return [
            (u_d(t) - R * i[0] + w_e(t) * L_Q * i[1]) / L_D,
            (u_q(t) - R * i[1] - w_e(t) * (L_D * i[0] + FLUX)) / L_Q,
        ]

    return solve_ivp(
        slope, (0, T[-1]), [0.0, 0.0], "DOP853", t_eval=T, rtol=1e-8, atol=1e-9, max_step=step
    ).y


@pytest.fixture(scope="module")
def excited() -> np.ndarray:
    """u_d, u_q, i_d, i_q, w_e of a motor whose speed changes and whose voltages carry tones."""

    def u_d(t):
        return tones(t, 1.0) - 5

    def u_q(t):
        return tones(t, 1.17) + FLUX * speed(t) - 6

    return np.array([u_d(T), u_q(T), *currents(u_d, u_q, speed), speed(T)])


def measured(record: np.ndarray, seed: int, speed_noise: float = 0.5) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=record.shape)
    return record + noise * np.array([0.3, 0.3, 0.05, 0.05, speed_noise])[:, None]


def identified(record: np.ndarray, *, held: bool = False) -> MotorFit:
    signals = dict(zip(("u_d", "u_q", "i_d", "i_q", "w_e"), record, strict=True))
    return identify_motor(signals, period=PERIOD, widest=WIDEST, held=held)


def test_without_noise_the_parameters_are_exact(excited: np.ndarray) -> None:
    """To the integrator's 1e-8 and the sums' fourth order."""
    np.testing.assert_allclose(identified(excited).values, TRUE, rtol=1e-6)


@pytest.mark.parametrize(
    ("seeds", "least"), [(20, 16), pytest.param(100, 90, marks=pytest.mark.proof)]
)
def test_the_intervals_hold_the_parameters_and_the_values_are_within_2_percent(
    excited: np.ndarray, seeds: int, least: int
) -> None:
    """A right interval of 95 % holds so few of its seeds once in a hundred."""
    fits = [identified(measured(excited, seed)) for seed in range(seeds)]
    held = sum((fit.low <= TRUE) & (fit.high >= TRUE) for fit in fits)
    assert (held >= least).all(), held
    assert all(fit.determined.all() for fit in fits)
    errors = np.array([fit.values for fit in fits]) / TRUE - 1
    assert np.abs(errors).max() < 0.02
    # halves that did not see each other's noise leave no bias beside it
    assert (np.abs(errors.mean(axis=0)) < 4 * errors.std(axis=0) / np.sqrt(seeds)).all()


def test_voltages_that_are_held_are_integrated_as_held(excited: np.ndarray) -> None:
    """An inverter's command; taken as sampled it is half a period late."""
    u_d, u_q = excited[:2, :3000]

    i = stepped(u_d, u_q)
    record = np.array([u_d, u_q, *i, speed(T[:3000])])
    right, wrong = identified(record, held=True), identified(record)
    # the currents bend at every sample: 4e-4 of the inductances, the second order of the period
    assert np.abs(right.values[:4] / TRUE - 1).max() < 1e-3
    assert np.abs(wrong.values[:4] / TRUE - 1).max() > 3e-3


@pytest.mark.parametrize(
    ("seeds", "least"), [(10, 7), pytest.param(40, 34, marks=pytest.mark.proof)]
)
def test_dead_time_is_not_taken_for_resistance(excited: np.ndarray, seeds: int, least: int) -> None:
    """The inverter keeps 0.6 V along the current of what is commanded."""
    lost = 0.6
    i = excited[2:4]
    commanded = excited.copy()
    commanded[:2] += lost * i / np.maximum(np.hypot(*i), 1e-12)
    truth = np.append(TRUE, lost)
    fits = [identified(measured(commanded, seed)) for seed in range(seeds)]
    assert all(fit.names[-1] == "dead_voltage" for fit in fits)
    held = sum((fit.low <= truth) & (fit.high >= truth) for fit in fits)
    assert (held >= least).all(), held
    assert abs(np.mean([fit.values[0] for fit in fits]) / R - 1) < 0.01


def stepped(u_d: np.ndarray, u_q: np.ndarray) -> np.ndarray:
    """Currents under voltages that are held, four Runge-Kutta steps a period; shape (2, T)."""

    def slope(i: np.ndarray, u: np.ndarray, w: float) -> np.ndarray:
        back = np.array([-w * L_Q * i[1], w * (L_D * i[0] + FLUX)])
        return (u - R * i - back) / np.array([L_D, L_Q])

    i, h, out = np.zeros(2), PERIOD / 4, np.zeros((2, len(u_d)))
    for k in range(len(u_d) - 1):
        u = np.array([u_d[k], u_q[k]])
        for part in range(4):
            w0, w1, w2 = (speed(T[k] + (part + s) * h) for s in (0.0, 0.5, 1.0))
            a = slope(i, u, w0)
            b = slope(i + 0.5 * h * a, u, w1)
            c = slope(i + 0.5 * h * b, u, w1)
            d = slope(i + h * c, u, w2)
            i = i + h / 6 * (a + 2 * b + 2 * c + d)
        out[:, k + 1] = i
    return out


@cache
def standing() -> np.ndarray:
    def u_d(t):
        return tones(t, 1.0)

    def u_q(t):
        return tones(t, 1.17)

    def still(t):
        return 0.0 * t

    return np.array([u_d(T), u_q(T), *currents(u_d, u_q, still), still(T)])


def without_i_d() -> np.ndarray:
    """Field-oriented control that holds i_d at 0 while i_q and the speed change."""
    i_q = 5 + tones(T, 0.3) / 2
    fine = np.arange(MANY * 50) * PERIOD / 50
    slope = np.gradient(5 + tones(fine, 0.3) / 2, PERIOD / 50)[::50]
    w = speed(T)
    return np.array([-w * L_Q * i_q, R * i_q + L_Q * slope + w * FLUX, 0 * T, i_q, w])


def steady() -> np.ndarray:
    """Nothing changes: two equations for four unknowns."""
    i = np.linalg.solve([[R, -300 * L_Q], [300 * L_D, R]], [-5.0, 40 - 300 * FLUX])
    return np.array([-5.0, 40.0, *i, 300.0])[:, None] + np.zeros((5, MANY))


@pytest.mark.parametrize(
    ("record", "unknown"),
    [
        (standing, {"flux"}),
        (without_i_d, {"inductance_d"}),
        (steady, {"resistance", "inductance_d", "inductance_q", "flux"}),
    ],
)
@pytest.mark.parametrize("seeds", [0, 5, pytest.param(50, marks=pytest.mark.proof)])
def test_what_is_not_excited_is_not_determined(record, unknown: set[str], seeds: int) -> None:
    """And the others are, within 2 %, their intervals as right as ever."""
    clean = record()
    held = np.zeros(4)
    for seed in range(max(seeds, 1)):
        fit = identified(measured(clean, seed) if seeds else clean)
        assert set(fit.reasons) == unknown
        found = ~np.isnan(fit.values)
        assert {name for name, one in zip(fit.names, found, strict=True) if not one} == unknown
        assert (fit.determined == found).all()
        np.testing.assert_allclose(fit.values[found], TRUE[found], rtol=0.02)
        assert np.isinf(fit.high[~found]).all()
        held += (fit.low <= TRUE) & (fit.high >= TRUE)
    # 50 of a right interval fall below 43 four times in a thousand
    assert seeds < 50 or (held >= 43).all()


def test_a_reversed_axis_is_said_and_not_hidden(excited: np.ndarray) -> None:
    record = excited.copy()
    record[4] *= -1
    fit = identified(record)
    assert "check the signs" in fit.reasons["flux"] and not fit.determined[3]


def test_windows_without_a_number_are_left_out_and_counted(excited: np.ndarray) -> None:
    record = excited.copy()
    record[2, 100], record[4, 5000:5003] = np.nan, np.inf
    fit = identified(record)
    assert fit.left_out == 2 and fit.windows == (MANY - 1) // 64 - 2
    np.testing.assert_allclose(fit.values, TRUE, rtol=1e-6)


def test_few_windows_are_no_certainty(excited: np.ndarray) -> None:
    fit = identified(measured(excited, 0)[:, : 64 * 4 + 1])
    assert fit.windows == 4 and not fit.determined.any() and set(fit.reasons) == set(fit.names)


@pytest.mark.parametrize("order", range(4))
@pytest.mark.parametrize("held", [False, True])
def test_modulated_integrals_are_those_of_quadrature(order: int, held: bool) -> None:
    """g, g' and a signal that changes within the window, against adaptive quadrature."""
    from scipy.integrate import quad

    size, period = 64, 1e-3
    t = np.arange(size + 1) * period

    def signal(t):
        return 1 + 5 * t / t[-1] if np.ndim(t) else 1 + 5 * t / (size * period)

    def g(t):
        s = np.pi * t / (size * period)
        return np.sin(s) ** 3 * np.cos(order * s)

    cut = Windows({"x": signal(t)}, period, held=held)
    wanted = quad(lambda t: g(t) * signal(t), 0, size * period, epsabs=1e-12)[0]
    slope = quad(lambda t: g(t) * 5 / (size * period), 0, size * period, epsabs=1e-12)[0]
    halves, rates = cut.halves(cut.signals["x"]), cut.rates(cut.signals["x"])
    np.testing.assert_allclose(halves[:, 0, order], wanted, rtol=1e-4, atol=1e-7)
    np.testing.assert_allclose(rates[:, 0, order], slope, rtol=1e-4, atol=1e-5)
    if held:
        wanted = sum(
            signal(k * period) * quad(g, k * period, (k + 1) * period, epsabs=1e-16)[0]
            for k in range(size)
        )
    found = cut.driven("x")[0, order]
    assert found == pytest.approx(wanted, rel=1e-4 if not held else 1e-9, abs=1e-7)


@pytest.mark.parametrize(
    ("record", "words"),
    [(np.ones((5, 64)), "record of 64 samples has no window of 65"),
     (np.full((5, 100), np.nan), "no window of 65 finite ones")],
)  # fmt: skip
def test_what_is_no_record_is_refused(record: np.ndarray, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        identified(record)
