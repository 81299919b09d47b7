"""Faults of a dynamometer recording: axes, signs, units and a wrong speed or feed.

Each recording is compared with a model that was fitted without it, as it stands and under each
candidate fault.  With a free phase, the weighted residuals of its harmonics are compared by the F
ratio of their mean squares; a candidate is named when the ratio is beyond chance among all
candidates and what is left is small.  A candidate that the model's own extrapolation could imitate
(a feed, a unit of a few times another) counts only inside of what the model was fitted on.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.submodels.cutting.model import CutModel
from pipeline.submodels.cutting.recordings import (
    CuttingRecording,
    cut_harmonics,
    measured_at,
)
from pipeline.submodels.cutting.settings import CuttingFitSettings, CuttingSetup
from pipeline.submodels.cutting.waveform import CutHarmonics, mean_squares

LEVEL = 1e-3
"""Probability with which a sound recording is given a fault, over all candidates [1]."""
FITS = 0.3
"""Residual over the force, as RMS, up to which a candidate explains a recording [1]."""
FAR = 0.2
"""Residual over the force, as RMS, from which a recording is compared with candidates [1]."""
CARRIES = 0.01
"""Share of a direction's power from which one of its harmonics counts as an observation [1]."""
NEAR = 1.25
"""Factor about the feeds of a fit inside which a wrong feed or unit can be identified [1]."""
UNITS = {
    1e3: "its forces are in kN where N is stated",
    1e-3: "its forces are in mN where N is stated, or in N where kN is",
    4.4482: "its forces are in lbf where N is stated",
    9.8067: "its forces are in kgf where N is stated",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """Model that a recording is compared with, and the recordings that it was fitted on."""

    model: CutModel
    fitted_on: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """Possible fault, as its correction."""

    words: str
    """The fault as a clause."""
    channels: NDArray[np.float64]
    """Channels as they should be from those recorded; shape (3, 3)."""
    speed: float = 1.0
    feed: float = 1.0
    """Factors on the stated spindle speed and feed per tooth [1]."""
    moderate: bool = False
    """Whether a model that extrapolates could imitate it."""


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Fault that explains a recording, with the F ratio of the residuals without and with it."""

    words: str
    ratio: float
    before_percent: float
    after_percent: float


def candidates() -> Iterator[Candidate]:
    """All faults that are looked for."""
    for swapped, signs in product((False, True), product((1.0, -1.0), repeat=3)):
        turned = [name for name, sign in zip("xyz", signs, strict=True) if sign < 0]
        if swapped or turned:
            order = [1, 0, 2] if swapped else [0, 1, 2]
            matrix = np.diag(signs)[:, order]
            yield Candidate(words=_axes(swapped, turned), channels=matrix)
    for factor, words in UNITS.items():
        yield Candidate(
            words=words, channels=factor * np.eye(3), moderate=0.01 < factor < 100,
        )  # fmt: skip
    for speed, times in ((2.0, "twice"), (0.5, "half of")):
        words = f"its spindle speed is {times} that stated"
        yield Candidate(words=words, channels=np.eye(3), speed=speed)
    for feed, times in ((2.0, "twice"), (0.5, "half of")):
        words = f"its feed is {times} that stated"
        yield Candidate(words=words, channels=np.eye(3), feed=feed, moderate=True)


def _axes(swapped: bool, turned: Sequence[str]) -> str:
    signs = f"the sign{'s' if len(turned) > 1 else ''} of {' and '.join(turned)}"
    if not swapped:
        return f"{signs} {'are' if len(turned) > 1 else 'is'} turned"
    return "x and y are swapped" + (f" and {signs} turned" if turned else "")


def named_faults(
    recordings: Sequence[CuttingRecording], references: Mapping[str, Reference],
    setup: CuttingSetup, settings: CuttingFitSettings,
) -> dict[str, str]:  # fmt: skip
    """Sentences on the recordings that a fault explains, by name.

    ``references`` holds the model of each recording that was fitted without it; recordings without
    a revolution are not compared.
    """
    by_name = {one.name: one for one in recordings if one.revolution is not None}
    found = {
        name: explained for name, one in by_name.items() if name in references
        if (explained := explanation(one, references[name], by_name, setup, settings)) is not None
    }  # fmt: skip
    named: dict[str, str] = {}
    for name in sorted(found, key=lambda name: -found[name].ratio):
        others = references[name].fitted_on
        if len(others) > 1 and named.keys() & set(others):
            continue  # it was compared with a fit on a faulty one
        named[name] = _sentence(found[name], others)
    return named


def _sentence(found: Explanation, others: Sequence[str]) -> str:
    beside = others[0] if len(others) == 1 else f"{len(others)} other recordings"
    either = f", or that holds the other way round of {beside}" if len(others) == 1 else ""
    return (
        f"{found.words}{either}: {found.before_percent:.3g} % of its force are left over by a fit "
        f"on {beside}, {found.after_percent:.2g} % with that corrected; correct it in "
        "cutting_records or cutting.dynamometer, or record again"
    )


def explanation(
    one: CuttingRecording, reference: Reference, by_name: Mapping[str, CuttingRecording],
    setup: CuttingSetup, settings: CuttingFitSettings,
) -> Explanation | None:  # fmt: skip
    """The fault that explains a recording beyond chance; None where none does."""
    from scipy.special import fdtri

    cut, model = cut_harmonics(one, settings), reference.model
    before, share = _residual(model, cut)
    if share < FAR:
        return None
    inside = _inside(cut, [by_name[n] for n in reference.fitted_on if n in by_name])
    tried = []
    every = list(candidates())
    for candidate in every:
        if candidate.moderate and not inside:
            continue
        other = _undone(one, cut, candidate, setup, settings)
        if other is not None:
            tried.append((*_residual(model, other), other, candidate))
    good = [row for row in tried if row[1] <= FITS]
    if not good:
        return None
    after, left, other, best = min(good, key=lambda row: row[0])
    count = observations(other)  # chance passes this F ratio of two mean squares so rarely
    critical = float(fdtri(count, count, 1.0 - LEVEL / len(every)))
    if before / after < critical:
        return None
    alike = [row[3].words for row in good if row[0] / after < critical and row[3] is not best]
    words = " or ".join([best.words, *alike[:2]])
    if best.speed != 1.0:
        words += f" ({60 * cut.conditions.speed:.4g} rev/min)"
    return Explanation(
        words=words, ratio=before / after, before_percent=100 * share, after_percent=100 * left
    )


def _residual(model: CutModel, cut: CutHarmonics) -> tuple[float, float]:
    """Mean square of the weighted residuals, and RMS residual over RMS force [1]."""
    left = cut.lines - model.beside(cut)
    square = np.abs(left) ** 2
    square[0] *= 2
    share = mean_squares(left).sum() / mean_squares(cut.lines).sum()
    return float((model.weight(cut) ** 2 * square).mean()), float(np.sqrt(share))


def observations(cut: CutHarmonics) -> int:
    """Number of real numbers that carry the force of a recording."""
    power = np.abs(cut.lines) ** 2
    carrying = power > CARRIES * power.sum(axis=0)
    return max(int(carrying[0].sum() + 2 * carrying[1:].sum()), 2)


def _inside(cut: CutHarmonics, others: Sequence[CuttingRecording]) -> bool:
    """Whether feed and depth lie inside of those of the recordings of a fit."""
    if not others:
        return False
    known = np.array([(one.cut[0].f_z, one.cut[0].a_p) for one in others])
    here = np.array([cut.conditions.f_z, cut.conditions.a_p])
    return bool(((known.min(0) / NEAR <= here) & (here <= known.max(0) * NEAR)).all())


def _undone(
    one: CuttingRecording, cut: CutHarmonics, candidate: Candidate, setup: CuttingSetup,
    settings: CuttingFitSettings,
) -> CutHarmonics | None:  # fmt: skip
    """Harmonics of the recording with a fault undone; None where it cannot be the fault."""
    conditions = replace(cut.conditions, f_z=candidate.feed * cut.conditions.f_z)
    if candidate.speed != 1.0:
        return _at_speed(one, candidate.speed, setup, settings)
    rotation = setup.dynamometer.rotation
    change = rotation @ candidate.channels @ rotation.T
    return replace(
        cut, conditions=conditions, lines=cut.lines @ change.T,
        variance=cut.variance @ (change**2).T,
    )  # fmt: skip


def _at_speed(
    one: CuttingRecording, factor: float, setup: CuttingSetup, settings: CuttingFitSettings
) -> CutHarmonics | None:
    """Harmonics at another spindle speed; a feed rate that is stated holds."""
    if one.file is None or one.conditions is None:
        return None
    by_rate = "feed_mm_min" in one.file.conditions
    stated = replace(
        one.conditions, speed=factor * one.conditions.speed,
        f_z=one.conditions.f_z / factor if by_rate else one.conditions.f_z,
    )  # fmt: skip
    try:
        return cut_harmonics(measured_at(one, stated, setup, settings), settings)
    except ValueError:
        return None
