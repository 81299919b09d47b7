"""Control law of a servo on recorded reference and position, against its recorded command.

A = S_vp V_p [S_pp P_p e + f_v r' - v] + S_vi V_i [S_pp P_p int(e) + f_v r - x] + f_a r'' + c

with e = r - x; e and r are seen T_x late, v and x (its integral) T_v late.  The servo obeys it
whatever the mechanics do: cogging, torsion, cutting, a slip of friction that no model has.

* All signals pass the same zero-phase low-pass filter, so that the servo's rate, its encoder's
  steps and the current's ripple are outside of the comparison.  They remain as delay:
  s(t - T) + b T^2 / 2 s''(t), with b = 0 for a dead time and 1 for a filter of first order.
* A position loop that holds its output between samples is behind by all of its period where the
  recorder takes the command just before the next, its integral by half of it: T_h.
* A control that makes its feed-forward from backward differences of the reference has it half a
  sample late beside the error, one with central differences, or a reference that comes with its
  speed, has it at the same time (Oppenheim and Schafer, Discrete-time signal processing, 2010).
* c is the state of the integral.  It is estimated anew, with its drift, in each window of rows, as
  it sums up the recorder's rounding.
* Signals between whole delays are polynomials through those at NODES of them, so that A is a sum of
  fixed columns with factors of the parameters: a recording of any length is reduced to one small
  triangle (QR), and an evaluation costs microseconds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal

import numpy as np

from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.submodels.drive.motion import first_difference
from pipeline.submodels.drive.records import AxisConstants, Recording, Tracked

TERMS = (
    "position_scale", "velocity_scale", "integral_scale", "velocity_feedforward",
    "acceleration_feedforward", "position_lag", "velocity_lag", "position_hold",
    "lag_spread",
)  # fmt: skip
"""The D parameters in their order."""
SPP, SVP, SVI, FV, FA, TX, TV, TH, TS = range(len(TERMS))
SCALES = (SPP, SVP, SVI)
"""Scale factors of gains that the control's list of parameters may name."""

Difference = Literal["central", "backward"]
"""Differences of the reference, from sample to sample, that are fed forward."""

SLOWEST = 1e-3
"""Longest sampling period of position loops [s]."""
_WIDEST_SCALE = 1e3
"""Greatest ratio of a gain to that of its control's list [1]."""
_REVERSALS = "with reversals and rapid starts, reference, position and current at 1 kHz or more"
REMEDY = {
    "position_scale": f"record feeds at several speeds {_REVERSALS}",
    "velocity_scale": f"record the axis {_REVERSALS}",
    "integral_scale": f"record load steps, or the axis {_REVERSALS}",
    "velocity_feedforward": f"name velocity_feedforward in conf/machine/, or record {_REVERSALS}",
    "acceleration_feedforward": f"record accelerations of several heights {_REVERSALS}",
    "position_lag": f"record the axis {_REVERSALS}",
    "velocity_lag": f"record the axis {_REVERSALS}",
}


@dataclass(frozen=True, kw_only=True)
class Nominal:
    """Gains of the control's list; 1 in SI where it does not name one."""

    position_gain: float
    """P_p [1/s]."""
    velocity_gain: float
    """V_p [A s/m]."""
    integral_gain: float
    """V_i [A/m]."""
    velocity_feedforward: float
    """f_v [1]."""
    acceleration_feedforward: float
    """f_a [A s^2/m]."""
    current_limit: float | None
    """Greatest command [A]."""
    unnamed: frozenset[str]
    """Gains among these that the list does not name."""

    @classmethod
    def of(cls, constants: AxisConstants) -> "Nominal":
        """Nominal gains from the prior knowledge of the axis."""
        values: dict[str, Any] = {item.name: None for item in fields(cls)}
        values |= {name: getattr(constants, name, None) for name in values}
        unnamed = frozenset(n for n in values if values[n] is None and n != "unnamed")
        ones = {n: 1.0 for n in unnamed if n.endswith("_gain")}
        none = {n: 0.0 for n in unnamed if n.endswith("_feedforward")}
        return cls(**values | ones | none | {"unnamed": unnamed})

    @property
    def integral(self) -> bool | None:
        """Whether the velocity loop has an integral part; None where the list does not say."""
        return None if "integral_gain" in self.unnamed else self.integral_gain > 0

    def named(self, term: str) -> bool:
        """Whether the list names the gain that ``term`` scales, or ``term`` itself."""
        return term.replace("_scale", "_gain") not in self.unnamed

    @property
    def fixed(self) -> Floats:
        """Values of what is not fitted; shape (D,)."""
        found = np.zeros(len(TERMS))
        found[[SPP, SVP]] = 1.0
        found[SVI] = 1.0 if self.integral else 0.0
        found[[FV, FA]] = self.velocity_feedforward, self.acceleration_feedforward
        return found

    def bounds(self, longest: float) -> tuple[Floats, Floats]:
        """Least and greatest values, lags up to ``longest`` [s]; each of shape (D,)."""
        low = np.zeros(len(TERMS))
        high = np.full(len(TERMS), np.inf)
        for k, gain in ((SPP, "position_gain"), (SVP, "velocity_gain")):
            if gain not in self.unnamed:
                low[k], high[k] = 1 / _WIDEST_SCALE, _WIDEST_SCALE
        high[FV], high[[TX, TV]], high[TH] = 2.0, longest, SLOWEST / 2
        high[TS] = 1.0
        return low, high

    def servo(self, values: Floats) -> ServoParameters:
        """The servo of ``values``, shape (D,)."""
        found = dict(zip(TERMS[:TH], values.tolist(), strict=False))
        whole = found["integral_scale"] > 0
        if not whole:
            found["integral_scale"] = 1.0
        if self.current_limit is not None:
            found["current_limit"] = self.current_limit
        return ServoParameters(
            position_gain=self.position_gain,
            velocity_gain=self.velocity_gain,
            integral_gain=self.integral_gain if whole else 0.0,
            **found,
        )

    def unit(self, name: str, command_unit: str) -> str:
        """Unit of the parameter ``name``: scales are gains in SI where the list names none."""
        if (gain := name.replace("_scale", "_gain")) != name and gain not in self.unnamed:
            return "1"
        return {
            "position_scale": "1/s", "velocity_scale": f"{command_unit} s/m",
            "integral_scale": f"{command_unit}/m", "velocity_feedforward": "1",
            "acceleration_feedforward": f"{command_unit} s^2/m",
        }.get(name, "s")  # fmt: skip


ABOVE = 12.0
"""Bandwidth of the comparison over that of the position loop [1]."""
FASTEST = 0.08
"""Greatest bandwidth over the recorder's rate [1]: delays of half a sample still show."""
PERIODS = 40.0
"""Periods of the lowest bandwidth in the longest recording [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoRecord(Tracked):
    """Signals of a servo in one stretch of a recording, T samples."""

    command: Floats = field(repr=False)
    """Command [A]; shape (T,)."""

    def rows(self, first: int, after: int) -> "ServoRecord":
        """Samples ``first`` to before ``after``."""
        part = slice(first, after)
        return replace(
            self, reference=self.reference[part], position=self.position[part],
            command=self.command[part],
        )  # fmt: skip


def servo_records(
    recordings: Sequence[Recording], axis: str
) -> tuple[list[ServoRecord], AxisConstants, str, list[str]]:
    """Records of one axis with one list of gains, that list, the command's unit, those left out.

    Recordings that were taken with other gains than the first are another servo's.  Those with a
    disturbance, which may enter in the loops, serve only where there are no others.
    """
    shown = [one for one in recordings if axis in one.axes]
    recordings = [one for one in shown if one.axes[axis].load is None] or shown
    found: list[ServoRecord] = []
    constants, unit, others = AxisConstants(), "A", []
    for recording in recordings:
        one = recording.axes[axis]
        if one.reference is None or one.position is None:
            continue
        if not found:
            constants, unit = one.constants, one.command_unit
        if one.constants != constants:
            others.append(recording.name)
            continue
        found.append(
            ServoRecord(
                reference=one.reference, position=one.position, command=one.command,
                period=recording.period,
            )
        )  # fmt: skip
    return found, constants, unit, others


def servo_periods(constants: AxisConstants, period: float) -> tuple[float, float]:
    """Bounds of the servo period [s]: as listed, else limited by the recorder's ``period``."""
    listed = constants.servo_period
    return (0.0, period) if listed is None else (listed, listed)


def servo_bandwidth(records: Sequence[ServoRecord]) -> float:
    """Bandwidth of the comparison [Hz], from the loop gain by e = v / (S_pp P_p)."""
    top, bottom, slow, rate = 0.0, 0.0, np.inf, np.inf
    for one in records:
        v = np.gradient(one.position, one.period)
        e = one.reference - one.position
        top, bottom = top + float(v @ v), bottom + abs(float(e @ v))
        slow = min(slow, PERIODS / (one.period * len(v)))
        rate = min(rate, 1 / one.period)
    gain = top / bottom if bottom > 0 else np.inf
    return float(min(max(ABOVE * gain / (2 * np.pi), slow), FASTEST * rate))


def servo_low_passed(signals: Floats, period: float, bandwidth: float) -> Floats:
    """Signals, shape (..., T), below ``bandwidth`` [Hz], without a shift in time."""
    from scipy.signal import butter, sosfiltfilt

    lowest = bandwidth * 2 * period
    if lowest >= 1:
        return signals
    return sosfiltfilt(butter(3, lowest, output="sos"), signals, axis=-1)


NODES = 5
"""Nodes of a delay's polynomial [1]."""
_POLYNOMIALS = [np.linalg.inv(np.vander(range(NODES), increasing=True))]
for _ in range(3):
    _POLYNOMIALS.append(np.arange(1, len(_POLYNOMIALS[-1]))[:, None] * _POLYNOMIALS[-1][1:])
"""Coefficients of the nodes' weights in the delay, and of three derivatives, lowest power first."""
_SHARE = 0.05
"""Distance of nodes over the shortest period that passes the filter [1]: errors are below 1e-4."""
_GROUPS = 7
"""Groups of columns [1]: e, r', int(e), r, r'' seen T_x late; v and x seen T_v late."""
_PER_PERIOD = 4
"""Rows in the shortest period that passes the filter [1]."""
WINDOW = 240
"""Rows over which the integral is followed [1]; rounding sums up beyond them."""
_EDGE = 2
"""Periods of the filter's cut-off that are dropped at both ends [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ServoEquation:
    """Columns and command of all recordings, N rows."""

    nominal: Nominal
    """Gains that the parameters scale."""
    columns: Floats = field(repr=False)
    """Signals at whole delays, and the command; the mean of each stretch is taken off;
    shape (N, NODES * 7 + 1)."""
    triangle: Floats = field(repr=False)
    """R of their QR decomposition; shape (M, NODES * 7 + 1)."""
    node: float
    """Distance of delays [s]."""
    period: float
    """Longest sampling period of the recordings [s]."""
    stretch: Ints = field(repr=False)
    """Stretch of the recording of each row; shape (N,)."""
    difference: Difference = "central"
    """Difference of the reference, by which it is fed forward."""

    @property
    def longest(self) -> float:
        """Longest delay of the columns [s]."""
        return self.node * (NODES - 1)

    @property
    def rows(self) -> int:
        """Number of rows N [1]."""
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
        """Greatest acceleration feed-forward that the command allows [A s^2/m]."""
        signals = self.undelayed(self.columns)
        ahead = float(np.sqrt(np.mean(signals[:, 4] ** 2)))
        return self.spread / ahead if ahead > 0 else 1.0

    def factors(self, values: Floats) -> Floats:
        """Factors of the columns, -1 of the command; shape (..., M) of parameters (..., D)."""
        p = np.moveaxis(np.asarray(values, dtype=np.float64), -1, 0)
        late_x, late_v = self._late(p[TX], p[TS])[0], self._late(p[TV], p[TS])[0]
        return np.concatenate(self._groups(p, late_x, late_v), axis=-1)

    def residuals(self, values: Floats) -> Floats:
        """Modelled less recorded command in the triangle's rows [A]; shape (..., M)."""
        return self.factors(values) @ self.triangle.T

    def rmse(self, values: Floats) -> Floats:
        """RMSE of the command [A]; shape (...) of parameters (..., D)."""
        return np.sqrt(np.sum(self.residuals(values) ** 2, axis=-1) / self.rows)

    def slopes(self, values: Floats) -> Floats:
        """Derivatives of the factors by the parameters, shape (M, D), of parameters (D,)."""
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

    def jacobian(self, values: Floats, fitted: Bools) -> Floats:
        """Derivatives of the rows by the ``fitted`` parameters; shape (N, S)."""
        return (self.columns @ self.slopes(values))[:, fitted]

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
    records: Sequence[ServoRecord],
    nominal: Nominal,
    bandwidth: float,
    difference: Difference = "central",
) -> ServoEquation:
    """Columns of all ``records`` below ``bandwidth`` [Hz], fed forward by a ``difference``.

    Stretches at the current limit are cut out: there the command is not that of the loops.
    ValueError when no stretch is long enough for the filter, the command stands still, or a sample
    is no number.
    """
    parts: list[Floats] = []
    period = max(record.period for record in records)
    node = period * _samples_a_node(period, bandwidth)
    for record in records:
        for first, after in stretches(record, nominal.current_limit, bandwidth):
            one = record.rows(first, after)
            rows = stretch_rows(after - first, one.period, node, bandwidth)
            found = servo_signals(one, bandwidth, difference)
            parts += without_drift(delayed(found, rows, node / one.period))
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
        difference=difference,
    )  # fmt: skip


def _samples_a_node(period: float, bandwidth: float) -> int:
    return max(1, round(_SHARE / (bandwidth * period)))


def stretches(record: ServoRecord, limit: float | None, bandwidth: float) -> list[tuple[int, int]]:
    """First sample and end of each stretch that is long enough and away from the limit."""
    least = round(4 * _EDGE / (bandwidth * record.period)) + NODES * _samples_a_node(
        record.period, bandwidth
    )
    held = np.abs(record.command) >= 0.99 * limit if limit else np.zeros(len(record.command), bool)
    edges = np.flatnonzero(np.diff(np.r_[True, held, True].astype(np.int8)))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a > least]


def stretch_rows(samples: int, period: float, node: float, bandwidth: float) -> Ints:
    """Samples of a stretch that are rows of the equation; shape (N,)."""
    edge = round(_EDGE / (bandwidth * period))
    late = int(np.ceil(node * (NODES - 1) / period))
    return np.arange(
        edge + late, samples - edge, max(1, int(1 / (_PER_PERIOD * bandwidth * period)))
    )


def servo_signals(record: ServoRecord, bandwidth: float, difference: Difference) -> Floats:
    """Signals of the seven groups of columns, and the command; shape (8, T)."""
    h = record.period
    motion = np.stack((record.reference, record.position, record.command))
    r, x, A = servo_low_passed(motion, h, bandwidth)
    e, v = r - x, first_difference(x, h)
    swept = h * np.cumsum(e - 0.5 * np.diff(e, prepend=e[0]))
    way, speed, ahead = _fed_forward(r, h, difference)
    return np.stack((e, speed, swept, way, ahead, v, x - r[0], A))


def delayed(signals: Floats, rows: Ints, node: float) -> Floats:
    """Signals at the delays of the nodes, ``node`` samples apart, and the command.

    Of ``signals`` (8, T) as of :func:`servo_signals`, at the samples ``rows``, (N,); shape
    (N, NODES * 7 + 1).
    """
    places = rows[:, None] - node * np.arange(NODES)
    whole = np.rint(places).astype(np.int64)
    if np.abs(places - whole).max(initial=0.0) < 1e-6:
        found = signals[:-1, whole]
    else:  # recordings of different periods
        from scipy.interpolate import CubicSpline

        found = CubicSpline(np.arange(signals.shape[1]), signals[:-1], axis=1)(places)
    columns = np.moveaxis(found, 0, 1).reshape(len(rows), -1)
    return np.column_stack((columns, signals[-1, rows]))


def _fed_forward(
    reference: Floats, period: float, difference: Difference
) -> tuple[Floats, Floats, Floats]:
    """Integral by trapezoids, speed and acceleration of the reference; shape (T,) each.

    Speed and acceleration are its differences over a sample before, or over one on both sides.
    """

    def rate(signal: Floats) -> Floats:
        if difference == "central":
            return np.asarray(np.gradient(signal, period))
        return np.diff(signal, prepend=signal[0]) / period

    speed = rate(reference)
    way = period * np.cumsum(speed - 0.5 * np.diff(speed, prepend=speed[0]))
    return way, speed, rate(speed)


def without_drift(columns: Floats) -> list[Floats]:
    """Columns of one stretch by windows, each less its own straight line of least squares."""
    found = []
    for part in np.array_split(columns, max(1, len(columns) // WINDOW)):
        line = np.linspace(-1, 1, len(part))
        level = part - part.mean(axis=0)
        found.append(level - np.outer(line, line @ level / (line @ line)))
    return found
