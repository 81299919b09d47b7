"""Factor and delay of a recorded disturbance in one linear equation, by partial regression.

What an equation leaves over is regressed on the delayed disturbance, beside columns for errors of
the model (Frisch and Waugh 1933): first on a grid of delays, then by steps of Gauss and Newton.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from math import inf, log
from typing import Literal

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.submodels.statistics import Factor, block_numbers, uncertainty_of

Entry = Literal["reference", "speed", "command", "force", "none", "open"]
"""Place where a disturbance enters; none that explains it, or none that is determined."""
DETERMINED = 0.5
"""Relative half width of the factor's interval up to which it is determined [1]."""
EXPLAINS = 0.02
"""Least share of an equation's squared error that a disturbance takes away [1]: what a nearly
correct model leaves over is correlated with whatever moves, by a per cent."""
APART = log(100.0)
"""Least difference of log-likelihood between distinguishable places [1]."""
EARLIEST, LATEST = -0.01, 0.05
"""Range of delays of a disturbance behind its channel [s]."""


@dataclass(frozen=True, kw_only=True)
class EntryFit:
    """Fit of one place where a disturbance may enter."""

    factor: Factor
    """SI quantity at the place for one unit of the channel."""
    delay: float
    delay_half_width: float
    """Delay of the place behind the channel, with half of its 95 % interval [s]."""
    share: float
    """Share of the equation's squared error that it explains [1]."""
    gain: float
    """Gain of log-likelihood over the equation without the disturbance [1]."""
    likelihood: float
    """Logarithm of it, less a constant that all fits of the same recorded signal share [1]."""

    @property
    def clear(self) -> bool:
        """Whether the disturbance enters there at all, with a factor that is determined."""
        return self.factor.is_determined(DETERMINED) and self.share > EXPLAINS and self.gain > APART

    def doubted(self, systematic: float) -> "EntryFit":
        """The fit whose factor may be wrong by ``systematic``, in SI, beside its interval."""
        half = self.factor.half_width + systematic
        return replace(self, factor=replace(self.factor, half_width=half))


def shifted(signal: Floats, samples: float) -> Floats:
    """The signal ``samples`` later, its ends held; shape (T,)."""
    place = np.arange(len(signal)) - samples
    return np.interp(place, np.arange(len(signal)), signal)


def entry_fits(
    own: Floats,
    nuisance: Floats,
    scaled: Mapping[Entry, Floats],
    columns: Callable[[float], dict[Entry, Floats]],
    *,
    period: float,
    step: float,
    weight: float,
    stretch: Ints,
) -> dict[Entry, EntryFit]:
    """Factor and delay of the disturbance at each entry, from the residual ``own`` of one equation.

    ``own`` (N,) is recorded less modelled, ``nuisance`` (N, M) columns of errors of the model and
    ``scaled`` (N, M) their effect on the disturbance at an entry, missing where there is none.
    ``columns`` gives the disturbance at each entry, (N,), by the delay in samples, linear in the
    channel; ``step`` is that of the coarse search over delays [s], ``weight`` half of the
    independent rows in one row [1], ``stretch`` (N,) the stretch of each row.
    """
    column = _at_any_delay(columns)
    stride = max(1, round(step / period))
    tried = np.unique(np.r_[np.arange(round(EARLIEST / period), round(LATEST / period) + 1, stride),
                            0])  # fmt: skip
    whole = float(np.sum(_without(nuisance)(own) ** 2))
    found: dict[Entry, EntryFit] = {}
    for entry in column(0.0):
        left = _without(nuisance + scaled[entry] if entry in scaled else nuisance)

        def place(samples: float, entry: Entry = entry) -> Floats:
            return column(samples)[entry]

        y = left(own)
        first = min(tried, key=lambda samples: _error(y, left(place(float(samples)))))
        found[entry] = _refined(
            y, left, place, float(first), period=period, weight=weight, stretch=stretch,
            others=nuisance.shape[1], whole=whole,
        )  # fmt: skip
    return found


def _without(nuisance: Floats) -> Callable[[Floats], Floats]:
    """Projection of rows that removes the columns of errors."""
    base = np.linalg.qr(nuisance)[0]

    def left(rows: Floats) -> Floats:
        return rows - base @ (base.T @ rows)

    return left


def _error(y: Floats, x: Floats) -> float:
    """Sum of squares that one column leaves over."""
    size = float(x @ x)
    return float(y @ y) - (float(x @ y) ** 2 / size if size > 0 else 0.0)


def _at_any_delay(
    columns: Callable[[float], dict[Entry, Floats]],
) -> Callable[[float], dict[Entry, Floats]]:
    """Columns at any delay, linear between whole samples, each of which is computed once."""
    whole = cache(columns)

    def late(samples: float) -> dict[Entry, Floats]:
        before = float(np.floor(samples))
        share = samples - before
        if share == 0:
            return whole(before)
        low, high = whole(before), whole(before + 1)
        return {entry: (1 - share) * low[entry] + share * high[entry] for entry in low}

    return late


def _refined(
    y: Floats, left: Callable[[Floats], Floats], column: Callable[[float], Floats], at: float,
    *, period: float, weight: float, stretch: Ints, others: int, whole: float,
) -> EntryFit:  # fmt: skip
    """Factor and delay about the delay ``at`` [samples], by steps of Gauss and Newton.

    ``whole`` is the sum of squares of the equation without the disturbance.
    """
    for _ in range(4):
        x = left(column(at))
        slope = left(column(at + 0.5) - column(at - 0.5))
        both = np.column_stack((x, slope))
        c, cd = np.linalg.lstsq(both, y, rcond=None)[0]
        change = float(np.clip(cd / c, -3.0, 3.0)) if c != 0 else 0.0
        if abs(change) < 0.02:
            break
        at = float(np.clip(at + change, EARLIEST / period, LATEST / period))
    x = left(column(at))
    size = float(x @ x)
    c = float(x @ y) / size if size > 0 else 0.0
    residuals = y - c * x
    slope = c * left(column(at + 0.5) - column(at - 0.5)) / period
    jacobian = np.column_stack((x, slope))
    blocks = block_numbers(residuals, stretch, others + 2)
    half = uncertainty_of(jacobian, residuals, blocks).half_width
    least = max(float(residuals @ residuals), 1e-12 * whole)
    ratio = whole / least if whole > 0 else 1.0
    return EntryFit(
        factor=Factor(value=c, half_width=float(half[0])), delay=at * period,
        delay_half_width=float(half[1]), share=1 - 1 / ratio, gain=weight * len(y) * log(ratio),
        likelihood=-weight * len(y) * log(least) if whole > 0 else inf,
    )  # fmt: skip
