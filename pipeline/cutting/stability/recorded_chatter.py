"""Chatter in a recording of vibration, force or sound of a milling cut.

The spectrum of a stable cut has lines at harmonics of the spindle's rotation n (runout) and of the
tooth-passing frequency N n.  Chatter adds f_c and f_c +- m N n (quasi-periodic), or odd multiples
of N n / 2 (period doubling): Insperger, Stepan, Bayly, Mann (2003), Multiple chatter frequencies in
milling processes, J. Sound Vib. 262.  A line counts as one where the mean spectrum over segments
stands out of the floor by more than chance allows, and of the flank of a line of the rotation,
which a speed that wanders widens.  A structure that noise shakes has a narrow peak too, near the
stability boundary a very narrow one; its envelope is Rayleigh's, <a^4> / <a^2>^2 = 2, that of a
self-excited vibration is constant, 1 (kurtosis 3 and 1.5: Jacobsen, Andersen, Brincker 2007,
Eliminating the influence of harmonic components in operational modal analysis, IMAC XXV).  A line
with half of the energy (Bahtiyar, Sencer 2021, ASPE) is chatter below the midpoint of both, one
with less of it below a quarter of the way.

Stable speeds n = f_c / (N k): Delio, Tlusty, Smith (1992), Use of audio signals for chatter
detection and control, J. Eng. Ind. 114.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Any, Literal

import numpy as np

from pipeline.cutting.stability.cut_spectra import (
    GUARD,
    LEAST_SEGMENTS,
    MOST_TURNS,
    TURNS,
    CutSpectra,
    cut_spectra,
    in_cut,
    leaked_lines,
    line_frequency,
    line_power,
    mains_lines,
    noise_floor,
    rotation_lines,
    standing_lines,
)  # fmt: skip
from pipeline.schema.arrays import Bools, Floats, Ints

Verdict = Literal["stable", "chatter", "not decided"]
Kind = Literal["", "quasi-periodic", "period doubling"]

STEADY, MIDPOINT = 1.25, 1.5
"""<a^4> / <a^2>^2 below which a line is self-excited; between a steady and a random one [1]."""
GREAT_SHARE, SMALL_SHARE = 0.5, 0.005
"""Share of the energy of a line that is great, and of one that is too small for chatter [1]."""
MOST_CHANGE = 2.0
"""Greatest speed over the least in a recording [1]."""
RISEN = 0.25
"""Power of a line at its begin over the median after it [1]: half of its amplitude."""


@dataclass(frozen=True, kw_only=True)
class RecordedChatter:
    """Verdict on a recording, with what it rests on; frequencies [Hz], times [s], n [rev/min]."""

    verdict: Verdict
    why: str
    kind: Kind = ""
    frequency_Hz: float | None = None
    frequency_error_Hz: float | None = None
    """Half of the 95 % interval of the frequency over the segments [Hz]."""
    begins_s: float | None = None
    """Where the line rises to half of its amplitude [s]."""
    energy_share: float | None = None
    """Energy at the chatter frequencies over that and that of the rotation's lines [1]."""
    envelope: float | None = None
    """<a^4> / <a^2>^2 of the line: 1 steady, 2 random [1]."""
    confidence: float | None = None
    """Share of segments that agree with the verdict, lower end of Jeffreys' 95 % interval [1]."""
    false_alarm: float | None = None
    """Probability that noise alone gives such a line [1]."""
    channel: int | None = None
    """Channel in which the line is loudest, from 0."""
    speed_rpm: float
    tooth_passing_Hz: float
    stable_speeds_rpm: tuple[float, ...] = ()
    seconds_in_cut: float = 0.0
    """About, within half a segment at each end of a cut [s]."""
    frequency: Floats
    spectrum: Floats
    """Mean spectrum over the floor, summed over channels, in the cut; shape (F,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Cut:
    """The spectra of a recording and what their bins and segments are."""

    y: Floats  # (C, T)
    spectra: CutSpectra
    teeth: int
    rotation: Bools  # (S, F) bins of the rotation's lines
    order: Ints  # (S, F) the nearest order of the rotation
    floor: Floats  # (C, S, F)
    cut: Bools  # (S,)
    idle: Bools  # (S,)
    derivatives: Ints  # (C,)

    @property
    def power(self) -> Floats:
        """Power above the floor in the cut, over all channels; (cut segments, F)."""
        return (self.spectra.power - self.floor).sum(axis=0)[self.cut]

    def moved(self) -> Floats:
        """Power of the displacement that the lines stand for, by vibration where there is any."""
        f, order = self.spectra.frequency, self.derivatives[:, None]
        relative = np.maximum(f, f[1]) / self.spectra.n.min()
        weight = np.where((order > 0) | ~order.any(), relative ** (-2.0 * order), 0.0)
        above = (self.spectra.power - self.floor)[:, self.cut].mean(axis=1)
        return (above * weight).sum(axis=0)


def recorded_chatter(
    channels: Floats, rate: float, n: float | Floats, teeth: int, *,
    derivatives: Sequence[int] = (), speeds_rpm: tuple[float, float] | None = None,
) -> RecordedChatter:  # fmt: skip
    """Verdict on a recording.

    Parameters
    ----------
    channels : ndarray, shape (C, T)
        Vibration, force or sound, evenly sampled, any units.
    rate : float
        Sampling rate [Hz].
    n : float or ndarray, shape (T,)
        Spindle speed [1/s], above 0; it changes by no more than the factor ``MOST_CHANGE``.
    teeth : int
        Number of teeth, N.
    derivatives : sequence of int, optional
        For each channel 2 for acceleration, 1 for velocity, 0 for others: of the chatter
        frequencies the one is stated at which the tool moves most.
    speeds_rpm : tuple of float, optional
        Range of the machine [rev/min].
    """
    y = np.atleast_2d(channels)
    speed = np.broadcast_to(np.asarray(n, float), y.shape[1:])
    nominal = float(np.median(speed))
    none = RecordedChatter(
        verdict="not decided", why="", speed_rpm=60 * nominal, tooth_passing_Hz=nominal * teeth,
        frequency=np.zeros(0), spectrum=np.zeros(0),
    )  # fmt: skip
    if not (0.0 < speed.min() <= speed.max() < np.inf):
        return _with(none, why="the spindle speed is unknown: give it in rev/min")
    if speed.max() > MOST_CHANGE * speed.min() * (1 + 1e-9):
        return _with(none, why="the spindle speed changes more than twofold: judge a part of it")
    if rate < 6 * nominal * teeth:
        return _with(none, why=f"the band is too small: {rate:g} Hz hold no three harmonics of the "
                     f"tooth-passing frequency of {nominal * teeth:.4g} Hz")  # fmt: skip
    recorded = y.shape[1] * nominal / rate
    length = int(np.clip(recorded / LEAST_SEGMENTS, TURNS, MOST_TURNS) * rate / nominal)
    if y.shape[1] < (LEAST_SEGMENTS + 1) * length // 2:
        return _with(none, why=f"it is too short: {y.shape[1] / rate:.3g} s, "
                     f"{(LEAST_SEGMENTS + 1) / 2 * length / rate:.3g} s are needed")  # fmt: skip
    found = cut_spectra(y, rate, speed, length)
    rotation, order = rotation_lines(found)
    floor = noise_floor(found, rotation)
    cut, idle = in_cut(found, rotation & (order % teeth == 0), floor, teeth)
    if cut.sum() < LEAST_SEGMENTS:
        return _with(none, why="there is no cut in it, or too short a one: no lines at the "
                     "tooth-passing frequency; check speed and teeth")  # fmt: skip
    one = _Cut(
        y=y, spectra=found, teeth=teeth, rotation=rotation, order=order, floor=floor, cut=cut,
        idle=idle, derivatives=np.array([*derivatives, *[0] * (len(y) - len(derivatives))]),
    )  # fmt: skip
    actual = _actual_speed(one)
    judged = _judged(one, _with(none, speed_rpm=60 * actual, tooth_passing_Hz=teeth * actual,
                                seconds_in_cut=found.seconds(cut)))  # fmt: skip
    if judged.verdict != "chatter" or judged.frequency_Hz is None:
        return judged
    speeds = stable_speeds(judged.frequency_Hz, teeth, judged.speed_rpm, speeds_rpm)
    return _with(judged, stable_speeds_rpm=speeds)


def _with(one: RecordedChatter, **changes: object) -> RecordedChatter:
    return replace(one, **changes)  # type: ignore[arg-type]


def _actual_speed(one: _Cut) -> float:
    """Speed by the centroid of the strongest line of the teeth in the cut [1/s]."""
    found, n = one.spectra, float(np.median(one.spectra.n))
    passing = one.rotation & (one.order > 0) & (one.order % one.teeth == 0)
    at = int(np.argmax(np.where(passing[one.cut].all(axis=0), one.power.mean(axis=0), 0.0)))
    order = round(float(found.frequency[at]) / n)
    return line_frequency(one.power, found.frequency, at)[0] / order if order else n


def _judged(one: _Cut, own: RecordedChatter) -> RecordedChatter:
    """Verdict on a cut: on its line that stands out, or on lines at orders of the rotation."""
    found, cut = one.spectra, one.cut
    white = (found.power / one.floor).sum(axis=0)
    inside = (found.frequency > max(found.n.min(), 10.0)) & (found.frequency < 0.45 * found.rate)
    turned: Bools = np.asarray(one.rotation[cut].any(axis=0))
    free = inside & ~turned & ~mains_lines(found.frequency)
    own = _with(own, frequency=found.frequency, spectrum=white[cut].mean(axis=0))
    if free.sum() < 4 * TURNS:
        return _with(own, why="the band between the lines of the rotation is too small")
    line, chance = standing_lines(found, white, (cut, one.idle), free)
    leaked = leaked_lines(own.spectrum, turned)
    locked = _locked(one)
    if not (line & ~leaked).any():
        if locked:
            return _with(own, **locked)
        return _with(own, verdict="stable", confidence=_agree(cut.sum(), cut.sum()),
                     why="no line stands out between those of the rotation")  # fmt: skip
    seen = _loudest(one, line, leaked, inside)
    near = white[:, max(seen.at - 1, 0) : seen.at + 2].max(axis=1) > -log(0.01) * len(one.y)
    there = near & cut
    longest = _longest_run(there if there.any() else cut)
    during = np.isin(np.flatnonzero(cut), longest)
    full = _filled(longest, seen.energy[during])
    a2, channel = line_power(one.y, seen.f_c, found, int(found.start[full[len(full) // 4]]),
                             int(found.start[full[-1]]) + found.length)  # fmt: skip
    a2 = a2[len(a2) // 12 : len(a2) - len(a2) // 12]
    half = abs(seen.f_c / own.tooth_passing_Hz % 1 - 0.5) * own.tooth_passing_Hz
    judged = _with(
        own, frequency_Hz=seen.f_c, frequency_error_Hz=seen.error, channel=channel,
        energy_share=float(seen.energy[during].sum() / max(seen.whole[during].sum(), 1e-12)),
        envelope=float((a2**2).mean() / max(a2.mean() ** 2, 1e-300)),
        false_alarm=float(min(chance[seen.at], 1.0)),
        kind="period doubling" if half < found.frequency[1] / 2 else "quasi-periodic",
    )  # fmt: skip
    verdict = _verdict(one, judged, there, longest)
    return _with(own, **locked) if locked and verdict.verdict != "chatter" else verdict


@dataclass(frozen=True, kw_only=True, eq=False)
class _Line:
    at: int  # its bin
    f_c: float  # [Hz]
    error: float  # [Hz]
    energy: Floats  # of it and the lines a tooth-passing frequency apart, (cut segments,)
    whole: Floats  # that and the energy of the rotation's lines


def _loudest(one: _Cut, line: Bools, leaked: Bools, inside: Bools) -> _Line:
    """The strongest line and those that belong to it, at the frequency at which most moves."""
    found, power = one.spectra, one.power
    passing, width = one.teeth * float(np.median(found.n)), GUARD * found.frequency[1]

    def belongs(f: float) -> Bools:
        apart = (found.frequency - f) % passing
        return line & (np.minimum(apart, passing - apart) < width)

    at = int(np.argmax(np.where(line & ~leaked, power.mean(axis=0), 0.0)))
    at = int(np.argmax(np.where(belongs(found.frequency[at]), one.moved(), -np.inf)))
    f_c, error = line_frequency(power, found.frequency, at)
    energy = power[:, belongs(f_c)].sum(axis=1)
    synchronous = np.where((one.rotation & inside)[one.cut], power, 0.0).sum(axis=1)
    return _Line(at=at, f_c=f_c, error=error, energy=energy, whole=energy + synchronous)


def _verdict(one: _Cut, own: RecordedChatter, there: Bools, longest: Ints) -> RecordedChatter:
    """Verdict on the line of ``own`` by its energy, its envelope, and where it is ``there``."""
    share, steady, cut = own.energy_share or 0.0, own.envelope or 0.0, one.cut
    runs = np.convolve(there, np.ones(3), "valid") == 3
    first = int(np.argmax(runs)) if runs.any() else 0
    lasts = there[first:].sum() > 0.5 * cut[first:].sum()
    if (
        runs.any()
        and share >= SMALL_SHARE
        and steady < (MIDPOINT if share >= GREAT_SHARE else STEADY)
    ):
        within = slice(first, int(np.flatnonzero(there)[-1]) + 1) if lasts else longest
        return _with(
            own, verdict="chatter", confidence=_agree(there[within].sum(), cut[within].sum()),
            begins_s=_begin(one, own.frequency_Hz or 0.0, first),
            why=f"a steady line at {own.frequency_Hz:.4g} Hz holds {100 * share:.2g} % of the "
            "energy",
        )  # fmt: skip
    if runs.any() and (steady < MIDPOINT or not lasts):
        why = (
            f"holds {100 * share:.1g} % of the energy, little for chatter" if share < SMALL_SHARE
            else "is there in a part of the cut only" if not lasts
            else "is neither steady nor random"
        )  # fmt: skip
        return _with(own, why=f"the line at {own.frequency_Hz:.4g} Hz {why}: its envelope is "
                     f"{steady:.2f}, 1 is steady, 2 random; record longer")  # fmt: skip
    random = "random, as of a structure that noise shakes"
    what = random if steady >= MIDPOINT else "too short for chatter"
    return _with(own, verdict="stable", kind="", confidence=_agree(cut.sum(), cut.sum()),
                 why=f"the line at {own.frequency_Hz:.4g} Hz is {what}")  # fmt: skip


def _begin(one: _Cut, f_c: float, first: int) -> float:
    """Where the line that is there from segment ``first`` on rises [s]."""
    found = one.spectra
    start, half = int(found.start[first]), found.length // 2
    begin = max(start - half, 0)
    a2, _ = line_power(one.y, f_c, found, begin, start + 4 * half)
    return (begin + int(np.argmax(a2 > RISEN * np.median(a2[-2 * half :])))) / found.rate


def _agree(agreeing: int, segments: int) -> float:
    """Lower end of Jeffreys' interval of the share of half-overlapping segments that agree [1]."""
    from scipy.stats import beta

    return float(beta.ppf(0.05, agreeing / 2 + 0.5, (segments - agreeing) / 2 + 0.5))


def _longest_run(there: Bools) -> Ints:
    """Segments of the longest run, of one or more."""
    segments = np.flatnonzero(there)
    return max(np.split(segments, np.flatnonzero(np.diff(segments) > 1) + 1), key=len)


def _filled(run: Ints, energy: Floats) -> Ints:
    """The run without segments at its ends that a line fills in part: below half the median."""
    full = np.flatnonzero(energy >= 0.5 * np.median(energy))
    return run[full[0] : full[-1] + 1]


def _locked(one: _Cut) -> dict[str, Any]:
    """Chatter at orders of the rotation, as period doubling with an even number of teeth.

    Runout of a tool has orders m N +- 1: what lies at others is chatter where it is most of the
    energy; what lies there may be either.
    """
    found, teeth = one.spectra, one.teeth
    power = np.maximum(found.power - one.floor, 0.0).sum(axis=0)[one.cut]
    orders = np.where(one.rotation[one.cut], one.order[one.cut], 0)
    rest = orders % teeth
    foreign = rest > 0
    runout = foreign & ((rest == 1) | (rest == teeth - 1))
    energy = power[orders > 0].sum()
    other, near = power[foreign & ~runout].sum() / energy, power[runout].sum() / energy
    if other + near < GREAT_SHARE:
        return {}
    at = int(np.argmax(np.where(foreign, power, 0.0).mean(axis=0)))
    f_c, spread = line_frequency(power, found.frequency, at)
    share = float(other + near)
    line = {"energy_share": share, "frequency_Hz": f_c, "frequency_error_Hz": spread}
    half = 2 * round(f_c / float(np.median(found.n))) % (2 * teeth) == teeth
    words = f"{100 * share:.0f} % of the energy lies at multiples of the rotation, not of the teeth"
    if other > 4 * near:
        kind = "period doubling" if half else "quasi-periodic"
        return line | {"verdict": "chatter", "kind": kind,
                       "why": f"{words}, where runout has no lines"}  # fmt: skip
    return line | {
        "kind": "",
        "why": f"{words}: runout or chatter; measure the runout, or cut at another speed",
    }


def stable_speeds(
    f_c: float, teeth: int, speed_rpm: float, speeds_rpm: tuple[float, float] | None = None
) -> tuple[float, ...]:
    """Spindle speeds 60 f_c / (N k) [rev/min], highest first: 0.5 to 2 times ``speed_rpm``.

    ``speeds_rpm``: the machine's range, in place of that.

    >>> stable_speeds(900.0, 3, 9000.0)
    (18000.0, 9000.0, 6000.0, 4500.0)
    """
    low, high = speeds_rpm or (0.5 * speed_rpm, 2.0 * speed_rpm)
    top = 60.0 * f_c / teeth
    orders: Sequence[int] = range(
        max(1, int(np.ceil(top / high - 1e-9))), int(top / low + 1e-9) + 1
    )
    return tuple(top / k for k in orders)[:8]
