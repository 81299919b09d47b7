"""The servo's own equation on what it saw, recorded reference and position, against its command.

A = S_vp V_p [S_pp P_p e + f_v r' - v] + S_vi V_i [S_pp P_p int(e) + f_v r - x] + f_a r'' + c

with e = r - x; e and r are seen T_x late, v and x (its integral) T_v late.  The servo obeys it
whatever the mechanics do: cogging, torsion, cutting, a slip of friction that no model has.

* All signals pass the same zero-phase low-pass filter, so that the servo's rate, its encoder's
  steps and the current's ripple are outside of what is compared.  What is left of them is delay:
  s(t - T) + b T^2 / 2 s''(t), with b = 0 for a dead time and 1 for a filter of first order.
* A position loop that holds its output between samples is behind by all of its period where the
  recorder takes the command just before the next, its integral by half of it: T_h.
* c is where the integral stood.  It is found anew, with its drift, in each window of rows, as it
  sums up what the recorder rounds off.
* Signals between whole delays are polynomials through those at NODES of them, so that A is a sum of
  fixed columns with factors of the parameters: a recording of any length is reduced to one small
  triangle (QR), and trying a servo costs microseconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.identification.drive.servo_records import ServoRecord, low_passed
from pipeline.identification.drive.servo_terms import (
    FA,
    FV,
    SPP,
    SVI,
    SVP,
    TERMS,
    TH,
    TS,
    TV,
    TX,
    Nominal,
)

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

NODES = 5
"""Of a delay's polynomial."""
_POLYNOMIALS = [np.linalg.inv(np.vander(range(NODES), increasing=True))]
for _ in range(3):
    _POLYNOMIALS.append(np.arange(1, len(_POLYNOMIALS[-1]))[:, None] * _POLYNOMIALS[-1][1:])
"""Of the nodes' weights in the delay, and of their first three derivatives, lowest power first."""
_SHARE = 0.05
"""Of the shortest period that passes the filter, from node to node: its error is below 1e-4."""
_GROUPS = 7
"""Of columns: e, r', int(e), r, r'' seen T_x late; v and x seen T_v late."""
_PER_PERIOD = 4
"""Rows kept in the shortest period that passes the filter."""
WINDOW = 240
"""Rows over which the integral is followed; what the recorder rounds off sums up beyond them."""
_EDGE = 2
"""Of the filter, in periods of its cut-off, dropped at both ends."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoEquation:
    """Columns and command of all recordings, N rows.

    Parameters
    ----------
    nominal : Nominal
        What the parameters scale.
    columns : ndarray, shape (N, NODES * 7 + 1)
        Signals at whole delays, and the command; the mean of each stretch is taken off.
    triangle : ndarray, shape (M, NODES * 7 + 1)
        R of their QR decomposition.
    node : float
        From one delay to the next [s].
    period : float
        Longest from sample to sample of the recordings [s].
    stretch : ndarray of int, shape (N,)
        Which stretch of a recording each row is from.
    """

    nominal: Nominal
    columns: Floats = field(repr=False)
    triangle: Floats = field(repr=False)
    node: float
    period: float
    stretch: Integers = field(repr=False)

    @property
    def longest(self) -> float:
        """Delay up to which the columns serve [s]."""
        return self.node * (NODES - 1)

    @property
    def rows(self) -> int:
        """N."""
        return len(self.columns)

    @property
    def spread(self) -> float:
        """Standard deviation of the command [A]."""
        return float(np.sqrt(np.mean(self.columns[:, -1] ** 2)))

    @staticmethod
    def undelayed(columns: Floats) -> Floats:
        """Signals without delay, and the command, of ``columns`` (N, M); shape (N, 8)."""
        return columns[:, [*range(0, columns.shape[1] - 1, NODES), -1]]

    @property
    def steepest(self) -> float:
        """Command that the reference's acceleration might explain at most [A s^2/m]."""
        signals = self.undelayed(self.columns)
        ahead = float(np.sqrt(np.mean(signals[:, 4] ** 2)))
        return self.spread / ahead if ahead > 0 else 1.0

    def factors(self, values: Floats) -> Floats:
        """Of the columns, -1 of the command; shape (..., M) of parameters (..., D)."""
        p = np.moveaxis(np.asarray(values, dtype=np.float64), -1, 0)
        late_x, late_v = self._late(p[TX], p[TS])[0], self._late(p[TV], p[TS])[0]
        return np.concatenate(self._groups(p, late_x, late_v), axis=-1)

    def residuals(self, values: Floats) -> Floats:
        """Modelled less recorded command in the triangle's rows [A]; shape (..., M)."""
        found: Floats = self.factors(values) @ self.triangle.T
        return found

    def rmse(self, values: Floats) -> Floats:
        """Of the command [A]; shape (...) of parameters (..., D)."""
        found: Floats = np.sqrt(np.sum(self.residuals(values) ** 2, axis=-1) / self.rows)
        return found

    def slopes(self, values: Floats) -> Floats:
        """Of the factors by the parameters, shape (M, D), of parameters (D,)."""
        late_x, slope_x, spread_x = self._late(values[TX], values[TS])
        late_v, slope_v, spread_v = self._late(values[TV], values[TS])
        none = np.zeros(NODES)
        by_lag = {TX: (slope_x, none), TV: (none, slope_v), TS: (spread_x, spread_v)}
        found = np.zeros((_GROUPS * NODES + 1, len(TERMS)))
        for k in range(len(TERMS)):
            if k in by_lag:
                found[:, k] = np.concatenate(self._groups(values, *by_lag[k]))
            else:
                # every factor is at most linear in each of these parameters
                up, down = values.copy(), values.copy()
                up[k], down[k] = 1.0, 0.0
                found[:, k] = np.concatenate(self._groups(up, late_x, late_v))
                found[:, k] -= np.concatenate(self._groups(down, late_x, late_v))
        found[-1] = 0.0
        return found

    def _groups(self, p: Floats, late_x: Floats, late_v: Floats) -> list[Floats]:
        n = self.nominal
        Kp, Kv, Ki = p[SPP] * n.position_gain, p[SVP] * n.velocity_gain, p[SVI] * n.integral_gain
        held = Kv + Ki * p[TH]
        seen = [held * Kp, held * p[FV], Ki * Kp, Ki * p[FV], p[FA]]
        groups = [np.asarray(g)[..., None] * late_x for g in seen]
        groups += [np.asarray(g)[..., None] * late_v for g in (-Kv, -Ki)]
        return [*groups, -np.ones((*np.shape(Kp), 1))]

    def _late(self, delay: Floats, spread: Floats) -> tuple[Floats, Floats, Floats]:
        """Weights of the nodes at a delay [s], and their slopes by delay and spread.

        A signal seen s(t - T) + b T^2 / 2 s''(t): a delay for b = 0, to second order a first-order
        lag for b = 1.  Each has the shape (..., NODES).
        """
        T, b = np.asarray(delay)[..., None], np.asarray(spread)[..., None]
        powers = (T / self.node) ** np.arange(NODES)
        weight, first, second, third = (
            powers[..., : NODES - n] @ rows / self.node**n for n, rows in enumerate(_POLYNOMIALS)
        )
        half = 0.5 * T**2 * second
        return weight + b * half, first + b * (T * second + 0.5 * T**2 * third), half


def servo_equation(
    records: Sequence[ServoRecord], nominal: Nominal, bandwidth: float
) -> ServoEquation:
    """Columns of all ``records`` below ``bandwidth`` [Hz].

    Stretches at the current limit are cut out: there the command is not what the loops ask for.

    Raises
    ------
    ValueError
        When no stretch is long enough for the filter, the command stands still, or a sample is no
        number.
    """
    parts: list[Floats] = []
    period = max(record.period for record in records)
    node = period * _samples_a_node(period, bandwidth)
    for record in records:
        for stretch in _below_limit(record, nominal.current_limit, bandwidth):
            found = _stretch(stretch, node, bandwidth)
            parts += [_without_drift(part) for part in _windows(found, WINDOW)]
    if not parts:
        longest = max((len(r.command) * r.period for r in records), default=0.0)
        raise ValueError(
            f"the longest recording of the servo lasts {longest:.3g} s, too short for a filter of "
            f"{bandwidth:.3g} Hz: record for longer"
        )
    columns = np.concatenate(parts)
    if not np.isfinite(columns).all():
        raise ValueError("reference, position or command hold no number in places: record it anew")
    if all(np.ptp(record.command) == 0 for record in records):
        raise ValueError("the command never changes: record the axis while it moves")
    triangle: Floats = np.asarray(np.linalg.qr(columns, mode="r"))
    return ServoEquation(
        nominal=nominal, columns=columns, triangle=triangle, node=node,
        period=period, stretch=np.repeat(np.arange(len(parts)), [len(part) for part in parts]),
    )  # fmt: skip


def _samples_a_node(period: float, bandwidth: float) -> int:
    return max(1, round(_SHARE / (bandwidth * period)))


def _below_limit(record: ServoRecord, limit: float | None, bandwidth: float) -> list[ServoRecord]:
    """Stretches that are long enough and away from the limit."""
    least = round(4 * _EDGE / (bandwidth * record.period)) + NODES * _samples_a_node(
        record.period, bandwidth
    )
    held = np.abs(record.command) >= 0.99 * limit if limit else np.zeros(len(record.command), bool)
    edges = np.flatnonzero(np.diff(np.r_[True, held, True].astype(np.int8)))
    return [record.rows(a, b) for a, b in edges.reshape(-1, 2) if b - a > least]


def _stretch(record: ServoRecord, node: float, bandwidth: float) -> Floats:
    """Columns of one stretch."""
    from scipy.interpolate import CubicSpline

    h = record.period
    motion = np.stack((record.reference, record.position, record.command))
    r, x, A = low_passed(motion, h, bandwidth)
    e, v, v_ref = r - x, derivative(x, h), derivative(r, h)
    swept = h * np.cumsum(e - 0.5 * np.diff(e, prepend=e[0]))
    signals = np.stack((e, v_ref, swept, r - r[0], derivative(v_ref, h), v, x - r[0]))
    edge = round(_EDGE / (bandwidth * h))
    late = int(np.ceil(node * (NODES - 1) / h))
    rows = np.arange(edge + late, len(A) - edge, max(1, int(1 / (_PER_PERIOD * bandwidth * h))))
    spline = CubicSpline(np.arange(len(A)) * h, signals, axis=1)
    delayed = spline((rows * h)[:, None] - node * np.arange(NODES))
    columns: Floats = np.moveaxis(delayed, 0, 1).reshape(len(rows), -1)
    return np.column_stack((columns, A[rows]))


def _windows(columns: Floats, rows: int) -> list[Floats]:
    return np.array_split(columns, max(1, len(columns) // rows))


def _without_drift(columns: Floats) -> Floats:
    """Less their straight lines of least squares."""
    line = np.stack((np.ones(len(columns)), np.linspace(-1, 1, len(columns))), axis=1)
    return columns - line @ np.linalg.lstsq(line, columns, rcond=None)[0]


def derivative(signal: Floats, period: float) -> Floats:
    """Central difference of fourth order, of second at the edges; shape (T,)."""
    found = np.gradient(signal, period)
    near, far = signal[3:-1] - signal[1:-3], signal[4:] - signal[:-4]
    found[2:-2] = (8 * near - far) / (12 * period)
    return found
