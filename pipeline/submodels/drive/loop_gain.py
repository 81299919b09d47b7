"""Loop gain of a position loop from commanded and actual position alone, without torque.

The following error is what a chain of delayed commanded speeds leaves behind,
e(t) = sum_k h_k r'(t - k D) + sum_k f_k sgn r'(t - k D) + c, the second sum being friction's part.
At constant speed e = v sum_k h_k, so that K_v = 1 / sum_k h_k: speed over following error, with
whatever the control feeds forward.  All regressors are commands: neither the encoder's steps nor
what disturbs the axis biases the sum.  Where the error decays although the speed lasts (a position
loop with an integral, or all of the speed fed forward), the sum is next to nothing of its parts.
Source: finite impulse response by least squares (Ljung, System Identification, 1999, ch. 4.2, 10).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.model import Parameter
from pipeline.submodels.drive.records import Tracked
from pipeline.submodels.drive.servo_equation import servo_low_passed
from pipeline.submodels.statistics import block_numbers, uncertainty_of

NAME = "loop_gain"
TAPS = 20
"""Delays of the command [1]."""
SPAN = 12.0
"""Longest delay over the time constant of the loop [1]: exp(-12) of its answer comes later."""
PASSED = 2.0
"""Bandwidth of the comparison over that of the loop [1]."""
STATIC = 0.1
"""Following error of constant speed, over all of it (RMS), below which the error decays [1]."""
MOST_ROWS = 20_000
"""Rows of one recording [1]."""
CLOCK = 1e-4
"""Relative error of a recorder's clock [1]."""
SHORTEST = 4
"""Least length of a recording over the longest delay [1]."""
METHOD = "commanded speed over following error at constant speed, from positions alone"
OPEN = "not determined by these records"
DECAYS = (
    "none to be seen: the following error decays while the speed lasts, as under a position loop "
    "with an integral (PID) or with all of the speed fed forward"
)
LISTED = "name the gains of the control's list in conf/machine/: no motion shows this one"
RECORD = (
    "record commanded and actual position while the axis goes back and forth at several constant "
    "speeds, each for {:.2g} s or longer"
)


@dataclass(frozen=True, kw_only=True)
class LoopGain:
    """K_v [1/s] with its 95 % interval; whether it is determined, and whether the error decays."""

    value: float
    low: float
    high: float
    determined: bool
    decays: bool = False
    constant_s: float = 0.5

    @property
    def parameter(self) -> Parameter:
        """Parameter as stored."""
        return Parameter.estimated(
            self.value, self.low, self.high, "1/s", determined=self.determined,
            method=METHOD if self.determined else DECAYS if self.decays else OPEN,
            remedy=LISTED if self.decays else RECORD.format(self.constant_s),
        )  # fmt: skip


def loop_gain(records: Sequence[Tracked], widest: float) -> LoopGain | None:
    """Loop gain of an axis; None where no recording moves it under command for long enough.

    Beyond ``widest``, a relative half width of the 95 % interval [1], nothing is determined.
    """
    constant = _time_constant(records)
    found = None if constant is None else _static_gain(records, constant, SPAN)
    other = None if constant is None else _static_gain(records, constant, SPAN / 2)
    if constant is None or found is None or other is None:
        return None
    gain, half, decays = found
    half = half + abs(other[0] - gain) + CLOCK * abs(gain)
    return LoopGain(
        value=1 / gain if gain else np.inf, low=1 / (gain + half),
        high=1 / (gain - half) if gain > half else np.inf,
        determined=not decays and half <= widest * gain, decays=decays,
        constant_s=SPAN * constant,
    )  # fmt: skip


def _static_gain(
    records: Sequence[Tracked], constant: float, span: float
) -> tuple[float, float, bool] | None:
    """Sum of the weights h_k [s], half of its 95 % interval, and whether the error decays."""
    parts = [part for one in records if (part := _columns(one, constant, span))]
    if not parts:
        return None
    columns = np.concatenate([one for one, _ in parts])
    error = np.concatenate([one for _, one in parts])
    stretch = np.repeat(np.arange(len(parts)), [len(one) for _, one in parts])
    # each stretch has a level of its own
    levels = np.equal.outer(stretch, np.arange(len(parts))).astype(np.float64)
    whole = np.hstack([columns, levels])
    weights = np.linalg.lstsq(whole, error, rcond=None)[0]
    gain = float(weights[:TAPS].sum())
    half = _half_width(whole, error - whole @ weights, stretch)
    return gain, half, bool(gain * np.std(columns[:, 0]) < STATIC * np.std(error))


def _time_constant(records: Sequence[Tracked]) -> float | None:
    """Following error over speed, roughly [s]; None where no axis moves."""
    top = bottom = 0.0
    for one in records:
        v, e = np.gradient(one.reference, one.period), one.reference - one.position
        e = e - np.median(e)
        top, bottom = top + float(np.linalg.norm(e) ** 2), bottom + float(np.linalg.norm(v) ** 2)
    return float(np.sqrt(top / bottom)) if top > 0 and bottom > 0 else None


def _columns(one: Tracked, constant: float, span: float) -> tuple[Floats, Floats] | None:
    """Delayed speeds and signs of the command, shape (N, 2 TAPS), and the following error (N,)."""
    period = one.period
    step = max(1, round(span * constant / (TAPS - 1) / period))
    reach = step * (TAPS - 1)
    if len(one.reference) < SHORTEST * reach:
        return None
    bandwidth = PASSED / (2 * np.pi * constant)
    speed = np.gradient(one.reference, period)
    still = 1e-3 * np.abs(speed).max()
    sign = np.where(np.abs(speed) > still, np.sign(speed), 0.0)
    signals = np.stack((speed, sign, one.reference - one.position))
    v, s, e = servo_low_passed(signals, period, bandwidth)
    rows = np.arange(2 * reach, len(e) - reach, max(1, step // 2, len(e) // MOST_ROWS))
    places = rows[:, None] - step * np.arange(TAPS)
    return np.hstack([v[places], s[places]]), e[rows]


def _half_width(columns: Floats, residuals: Floats, stretch: Ints) -> float:
    """Half of the 95 % interval of the sum of the first ``TAPS`` weights [s]."""
    by_sum = columns.copy()  # with the sum as parameter in place of the first weight
    by_sum[:, 1:TAPS] -= columns[:, :1]
    blocks = block_numbers(residuals, stretch, columns.shape[1])
    return float(uncertainty_of(by_sum, residuals, blocks).half_width[0])
