"""Modes of a tool's tip, fitted to its measured frequency response.

Semi-discretisation asks for modes.  Each direction is fitted for itself by a sum of modes, those
beyond the band as residual terms included, with the least squares of the complex response over its
frequencies (rational fraction with positive stiffness and damping; Ewins 2000, section 4.4).  Every
line counts relative to the response itself, as far as the noise allows, so that a stiff mode is
fitted as well as a compliant one.

Modes are added one by one where most is left over.  Even lines are fitted and odd lines judge: a
mode that does not lessen the error on lines left out is noise.  At each mode the error is what
noise leaves open of its peak, and what neighbouring lines of the residual have in common, which no
noise explains.  The modes are taken more compliant by that, so that limits err to the safe side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.cutting.stability.tip_dynamics import (
    DIRECTIONS,
    FrequencyResponse,
    Mode,
    joined_responses,
    modal_receptance,
)
from pipeline.schema.arrays import Bools, Complexes, Floats

CLOSE = 0.01
"""Share of the response to which every line is fitted, where noise is less [1]."""
STIFF = 0.05
"""Share of the greatest response from which on down lines count alike [1]."""
MOST_MODES = 16
"""Greatest number of modes along one direction."""
LESSENED = 0.9
"""Share to which each mode that is kept lessens the error on the lines left out [1]."""
EXACT = 0.1
"""Error on the lines left out, over the required one, that ends the search for modes [1]."""
FELT = 0.01
"""Part of a mode at its peak, over the greatest response, below which it is left out [1]."""
ERROR = 0.1
"""Greatest error of the modes with which a limit is computed [1]."""
FEW = 16
"""Least number of lines of a direction."""
BELOW, ABOVE = 0.2, 2.0
"""Search range of modes beyond the band, over its lowest and its highest frequency [1]."""
DAMPING = (1e-4, 0.7)
"""Range of the damping ratio [1]."""
UNSEEN = 0.05
"""Compliance of modes above the band, over that of those in it, up to which nothing is said [1].

With half or twice the damping of such a mode limits stay within 2 %; at twice the compliance no
more."""
_NEAR = 41
"""Lines over which the noise's median is taken."""
_TRIED = (0.003, 0.01, 0.03, 0.1, 0.3)
"""Damping ratios of the search for a mode."""
_PLACES = 3
"""Places in the band of the search for a mode."""
_PATIENCE = 2
"""Modes that may be added in vain before the search ends."""


@dataclass(frozen=True, kw_only=True)
class ModalFit:
    """Modes of a tip, and how well they say what was measured."""

    modes: tuple[Mode, ...]
    """More compliant than measured by their own error each."""
    error: float
    """Greatest error of a mode's peak, over the greatest peak of its direction [1]."""
    caution: str = ""
    """Note on missing parts of the band; empty where nothing is missing."""


def fit_modes(parts: Sequence[FrequencyResponse]) -> ModalFit:
    """Modes of all directions that were measured.

    ``parts`` are measurements of one tip, each with its own frequencies; a direction whose
    receptance is 0 everywhere has no modes. ValueError when the modes cannot be made out: few
    lines, none of them in the band, noise, or a response that no sum of modes along x and y
    explains.

    Examples
    --------
    >>> from pipeline.cutting.stability.tip_dynamics import modal_receptance
    >>> tip = [Mode(direction="x", natural_frequency_Hz=922.0, damping=0.011, mass_kg=0.04)]
    >>> f = np.arange(200.0, 2000.0)
    >>> found = fit_modes([FrequencyResponse(frequency_Hz=f, receptance=modal_receptance(tip, f))])
    >>> [(round(mode.natural_frequency_Hz, 1), round(mode.damping, 4)) for mode in found.modes]
    [(922.0, 0.011)]
    """
    direct = [
        _direction(part.frequency_Hz, part.receptance[:, axis, axis], name)
        for axis, name in enumerate(DIRECTIONS)
        for part in parts
        if part.receptance[:, axis, axis].any()
    ]
    if not direct:
        raise ValueError(
            "frequency response: none is measured along the force, x over x or y over y; give both"
        )
    crossed = _cross(joined_responses(parts))
    return ModalFit(
        modes=tuple(_taken(mode, 1.0 + crossed) for part in direct for mode in part.modes),
        error=max(crossed, *(part.error for part in direct)),
        caution="; ".join(part.caution for part in direct if part.caution),
    )


def _cross(response: FrequencyResponse) -> float:
    """Greatest cross receptance over the greatest direct one [1]: modes along x and y have none."""
    size = np.abs(response.receptance).max(axis=0)
    share = float(max(size[0, 1], size[1, 0]) / max(size[0, 0], size[1, 1]))
    if share > ERROR:
        raise ValueError(
            f"frequency response: the cross receptance is {100 * share:.0f} % of the direct one, "
            f"more than the {100 * ERROR:.0f} % that modes along x and y may leave out; leave it "
            "out where it is a fault of the measurement, else turn the axes of the measurement"
        )
    return share


def _direction(frequency: Floats, measured: Complexes, name: str) -> ModalFit:
    if len(frequency) < FEW:
        raise ValueError(
            f"frequency response along {name}: {len(frequency)} frequencies are too few to make "
            f"out its modes; measure {FEW} or more"
        )
    weight = _weight(frequency, measured)
    found = _chosen(frequency, measured, weight)
    low, high = float(frequency[0]), float(frequency[-1])
    band = f"{low:g} to {high:g} Hz"
    every = _modes(found, name)
    within = [mode for mode in every if low <= mode.natural_frequency_Hz <= high]
    seen = [mode for mode in within if _part(mode, frequency) >= FELT * _top(measured)]
    if not seen:
        raise ValueError(
            f"frequency response along {name}: no mode is found from {band}; measure a band that "
            "holds the modes, with a line every few Hz"
        )
    caution = _caution(every, seen, high, name)
    errors = np.array([_error(mode, found, frequency, measured, weight) for mode in seen])
    share = errors * [_part(mode, frequency) for mode in seen]
    share /= max(_part(mode, frequency) for mode in seen)
    if not (error := float(share.max())) <= ERROR:
        worst = seen[int(share.argmax())]
        raise ValueError(
            f"frequency response along {name}: at {worst.natural_frequency_Hz:.4g} Hz modes are "
            f"off by {100 * error:.0f} % of the greatest peak from {band}, where "
            f"{100 * ERROR:.0f} % are allowed; measure with more averages, finer lines, or a wider "
            "band"
        )
    inside = [_taken(m, 1.0 + e) for m, e in zip(seen, np.minimum(errors, 1.0), strict=True)]
    least = min(mode.damping for mode in seen)
    beyond = [_taken(mode, 1.0, least) for mode in every if mode not in within]
    return ModalFit(modes=(*inside, *beyond), error=error, caution=caution)


def _taken(mode: Mode, factor: float, damping: float | None = None) -> Mode:
    """A mode with its compliance times ``factor``, and another damping where it is not seen."""
    return Mode(
        direction=mode.direction, natural_frequency_Hz=mode.natural_frequency_Hz,
        damping=damping or mode.damping, stiffness_N_m=mode.stiffness / factor,
    )  # fmt: skip


def _caution(modes: Sequence[Mode], seen: Sequence[Mode], high: float, name: str) -> str:
    """Note on possible effects of modes above the band."""
    beyond = sum(1.0 / mode.stiffness for mode in modes if mode.natural_frequency_Hz > high)
    share = beyond / sum(1.0 / mode.stiffness for mode in seen)
    if share > 1.0:
        raise ValueError(
            f"frequency response along {name}: above {high:g} Hz, where the measurement ends, the "
            "tip may give way more than at the modes in the band; measure to a higher frequency"
        )
    if share <= UNSEEN:
        return ""
    return (
        f"modes above {high:g} Hz, where the measurement along {name} ends, have {100 * share:.0f} "
        "% of the compliance of those in it, and their damping is not known"
    )


def _top(measured: Complexes) -> float:
    return float(np.abs(measured).max())


def _part(mode: Mode, frequency: Floats) -> float:
    """Greatest part of a mode at the frequencies measured [m/N]."""
    return _top(modal_receptance([mode], frequency)[:, mode.axis, mode.axis])


def _weight(frequency: Floats, measured: Complexes) -> Floats:
    """Inverse uncertainty of each line: noise, and a share of the response [N/m]."""
    from scipy.ndimage import median_filter

    # noise: how far each line is from the straight line between its neighbours
    step = np.diff(frequency)
    share = step[:-1] / (step[:-1] + step[1:])
    off = measured[1:-1] - (1.0 - share) * measured[:-2] - share * measured[2:]
    size = np.abs(off) / np.sqrt(1.0 + share**2 + (1.0 - share) ** 2)
    noise = np.pad(median_filter(size, min(_NEAR, len(size)), mode="nearest"), 1, mode="edge")
    floor = CLOSE * np.hypot(np.abs(measured), STIFF * _top(measured))
    return 1.0 / np.hypot(noise / np.sqrt(np.log(2.0)), floor)


# Parameters of M modes: logarithms of natural frequency [Hz], damping [1] and compliance [m/N] in
# the columns of an array of shape (M, 3).


def _modes(found: Floats, name: str) -> list[Mode]:
    return [
        Mode(direction=name, natural_frequency_Hz=f, damping=zeta, stiffness_N_m=1.0 / c)  # type: ignore[arg-type]
        for f, zeta, c in np.exp(found).tolist()
    ]


def _sum(found: Floats, frequency: Floats) -> Complexes:
    natural, damping, compliance = np.exp(found).T[:, :, None]
    r = frequency / natural
    return (compliance / (1.0 - r * r + 2j * damping * r)).sum(axis=0)


def _slopes(found: Floats, frequency: Floats) -> Complexes:
    """Derivatives of the sum by each parameter; shape (F, 3 M)."""
    natural, damping, compliance = np.exp(found).T[:, :, None]
    r = frequency / natural
    below = 1.0 - r * r + 2j * damping * r
    one = compliance / below
    slopes = np.stack([one * (2j * damping * r - 2.0 * r * r) / below,
                       -one * 2j * damping * r / below, one])  # fmt: skip
    return np.moveaxis(slopes, 2, 0).transpose(0, 2, 1).reshape(len(frequency), -1)


def _both(values: Complexes) -> Floats:
    return np.concatenate([values.real, values.imag])


def _fitted(
    start: Floats, frequency: Floats, measured: Complexes, weight: Floats, *, exact: bool = False
) -> Floats:
    """Parameters with the least squares of the weighted residual, from ``start``."""
    from scipy.optimize import least_squares
    from threadpoolctl import threadpool_limits

    low = np.log([BELOW * frequency[0], DAMPING[0], 1e-9 * _top(measured)])
    high = np.log([ABOVE * frequency[-1], DAMPING[1], 1e6 * _top(measured)])

    def residual(x: Floats) -> Floats:
        return _both(weight * (_sum(x.reshape(-1, 3), frequency) - measured))

    def slopes(x: Floats) -> Floats:
        return _both(weight[:, None] * _slopes(x.reshape(-1, 3), frequency))

    inside = np.clip(start, low + 1e-9, high - 1e-9).ravel()
    many = len(start)
    with threadpool_limits(1):  # matrices are slim: threads wait for one another
        answer = least_squares(
            residual, inside, jac=slopes, bounds=(np.tile(low, many), np.tile(high, many)),
            ftol=1e-8 if exact else 1e-4, max_nfev=100 if exact else 25,
        )  # fmt: skip
    return np.asarray(answer.x).reshape(-1, 3)


def _chosen(frequency: Floats, measured: Complexes, weight: Floats) -> Floats:
    """Parameters of the number of modes that cross-validation over lines selects; shape (M, 3)."""
    even, odd = slice(0, None, 2), slice(1, None, 2)
    fit = frequency[even], measured[even], weight[even]

    def left(found: Floats) -> float:
        off = weight[odd] * (_sum(found, frequency[odd]) - measured[odd])
        return float(np.sqrt(np.mean(np.abs(off) ** 2)))

    path = [np.empty((0, 3))]
    price = [left(path[0])]  # error on the lines left out, dearer with each mode
    best = 0
    while len(path) <= min(best + _PATIENCE, MOST_MODES) and price[best] > EXACT:
        dearer, next_one = np.inf, None
        for one in _candidates(path[-1], *fit):
            tried = _fitted(np.vstack([path[-1], one]), *fit)
            error = left(tried) / LESSENED ** len(tried)
            if error < dearer:
                dearer, next_one = error, tried
            if dearer <= price[-1]:
                break
        if next_one is None:
            break
        path.append(next_one)
        price.append(dearer)
        best = int(np.argmin(price))
    found = path[best]
    return _fitted(found, frequency, measured, weight, exact=True) if len(found) else found


def _candidates(
    found: Floats, frequency: Floats, measured: Complexes, weight: Floats
) -> list[Floats]:
    """Modes to be tried, the one that explains most of what is left first."""
    rest = measured - _sum(found, frequency)
    shown = np.convolve(-(weight * rest).imag, [0.25, 0.5, 0.25], mode="same")
    places = [BELOW**0.5 * frequency[0], ABOVE**0.5 * frequency[-1]]
    free: Bools = np.ones(len(frequency), dtype=np.bool_)
    for _ in range(_PLACES):
        if not free.any():
            break
        at = frequency[int(np.where(free, shown, -np.inf).argmax())]
        places.append(float(at))
        free &= np.abs(frequency - at) > 0.05 * at
    tried = []
    for place in places:
        best = (0.0, np.zeros(3))
        for damping in _TRIED:
            shape = weight * _sum(np.log([[place, damping, 1.0]]), frequency)
            along = float((shape.conj() * weight * rest).real.sum())
            gain = along / float(np.linalg.norm(shape))
            if gain > best[0]:
                compliance = along / float(np.linalg.norm(shape)) ** 2
                best = gain, np.log([place, damping, compliance])
        tried.append(best)
    return [one for gain, one in sorted(tried, key=lambda one: -one[0]) if gain > 0.0]


def _error(
    mode: Mode, found: Floats, frequency: Floats, measured: Complexes, weight: Floats
) -> float:
    """Relative error of a mode's peak [1]: from noise and from what noise does not explain."""
    rest = measured - _sum(found, frequency)
    # noise: standard deviation of the logarithm of the peak, from the curvature of the squares
    slopes = _both(weight[:, None] * _slopes(found, frequency))
    squares = np.sum(np.abs(weight * rest) ** 2) / max(2 * len(rest) - found.size, 1)
    spread = np.linalg.pinv(slopes.T @ slopes) * squares
    natural = np.log(mode.natural_frequency_Hz)
    at = 3 * int(np.abs(found[:, 0] - natural).argmin())
    peak = spread[at + 2, at + 2] + spread[at + 1, at + 1] - 2.0 * spread[at + 1, at + 2]
    # the rest: what neighbouring lines around the peak have in common
    width = 2.0 * mode.damping * mode.natural_frequency_Hz
    near = np.abs(frequency - mode.natural_frequency_Hz) <= width
    if near.sum() < 3:
        return float(np.sqrt(max(peak, 0.0)))
    left = rest[near]
    common = np.mean((left[1:].conj() * left[:-1]).real)
    common -= np.mean(np.abs(left) ** 2) / np.sqrt(2.0 * len(left))  # what noise has by chance
    # the least real part, from which the limit comes, is half of the peak
    size = (_top(measured[near]) / 2.0) ** 2
    return float(np.sqrt(max(peak, 0.0) + max(common, 0.0) / size))
