"""Chatter in a recording of vibration, force or sound of a milling cut.

The spectrum of a stable cut has lines at harmonics of the spindle's rotation n (runout) and of the
tooth-passing frequency N n.  Chatter adds f_c and f_c +- m N n (Hopf), or odd multiples of N n / 2
(period doubling): Insperger, Stepan, Bayly, Mann (2003), Multiple chatter frequencies in milling
processes, J. Sound Vib. 262.  A line counts as one where the mean spectrum over segments stands out
of the floor by more than chance allows.  A structure that noise shakes has a narrow peak too, near
the stability boundary a very narrow one; its envelope is Rayleigh's, <a^4> / <a^2>^2 = 2, that of
a self-excited vibration is constant, 1 (kurtosis 3 and 1.5: Jacobsen, Andersen, Brincker 2007,
Eliminating the influence of harmonic components in operational modal analysis, IMAC XXV).  A line
with half of the energy (Bahtiyar, Sencer 2021, ASPE) is chatter below the midpoint of both, one
with less of it below a quarter of the way.

The actual speed is the one within 1.5 % of the nominal at which the lines of the rotation are
highest.  Stable speeds n = f_c / (N k): Delio, Tlusty, Smith (1992), Use of audio signals for
chatter detection and control, J. Eng. Ind. 114.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import log
from typing import Any, Literal

import numpy as np

from pipeline.schema.arrays import Bools, Floats, Ints

Verdict = Literal["stable", "chatter", "not decided"]
Kind = Literal["", "Hopf", "period doubling"]

TURNS, MOST_TURNS = 32, 128
"""Revolutions of a segment [1]: lines of the rotation cover a sixth of the band, or less."""
LEAST_SEGMENTS = 5
"""Half-overlapping segments that a verdict needs [1]: 96 revolutions in the cut."""
SPEED_ERROR = 0.015
"""Deviation of the actual speed from the nominal one, at most [1]."""
GUARD = 2.5
"""Half width of a line of the rotation under Hann's window [bins]."""
HARMONICS = 40
"""Harmonics of the rotation by which the speed is found [1]."""
FALSE_ALARM = 1e-3
"""Probability that noise alone makes a line anywhere in the band [1]."""
STEADY, MIDPOINT = 1.25, 1.5
"""<a^4> / <a^2>^2 below which a line is self-excited; between a steady and a random one [1]."""
GREAT_SHARE, SMALL_SHARE = 0.5, 0.005
"""Share of the energy of a line that is great, and of one that is too small for chatter [1]."""
MAINS, MAINS_HARMONICS = (50.0, 60.0), 13
"""Frequencies of the mains [Hz], and the last harmonic that counts [1]."""
IN_CUT = 0.05
"""Energy of the tooth-passing lines over the greatest of all segments, in a cut at least [1]."""


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
    """Begin of the line, within half a segment; that of the cut where it is there at once [s]."""
    energy_share: float | None = None
    """Energy at the chatter frequencies over that and that of the rotation's lines [1]."""
    envelope: float | None = None
    """<a^4> / <a^2>^2 of the line: 1 steady, 2 random [1]."""
    confidence: float | None = None
    """Share of segments that agree with the verdict, lower end of Jeffreys' 95 % interval [1]."""
    false_alarm: float | None = None
    """Probability that noise alone gives such a line [1]."""
    speed_rpm: float
    tooth_passing_Hz: float
    stable_speeds_rpm: tuple[float, ...] = ()
    seconds_in_cut: float = 0.0
    frequency: Floats
    spectrum: Floats
    """Mean spectrum over the floor, summed over channels, in the cut; shape (F,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Spectra:
    frequency: Floats  # (F,) [Hz]
    power: Floats  # (C, S, F)
    start: Ints  # (S,) first sample
    n: Floats  # (S,) [1/s]
    length: int
    moved: Floats  # (F,) weight of a line by the displacement that it stands for


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
        Spindle speed [1/s], above 0.
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
    if not (np.isfinite(speed) & (speed > 0.0)).all():
        return _with(none, why="the spindle speed is unknown: give it in rev/min")
    if rate < 6 * nominal * teeth:
        return _with(none, why=f"the band is too small: {rate:g} Hz hold no three harmonics of the "
                     f"tooth-passing frequency of {nominal * teeth:.4g} Hz")  # fmt: skip
    recorded = y.shape[1] * nominal / rate
    length = int(np.clip(recorded / LEAST_SEGMENTS, TURNS, MOST_TURNS) * rate / nominal)
    if y.shape[1] < (LEAST_SEGMENTS + 1) * length // 2:
        return _with(none, why=f"it is too short: {y.shape[1] / rate:.3g} s, "
                     f"{(LEAST_SEGMENTS + 1) / 2 * length / rate:.3g} s are needed")  # fmt: skip
    found = _spectra(y, rate, speed, length)
    found = _with_speed(found)
    rotation, order = _rotation(found)
    floor = _floor(found, rotation)
    tooth = rotation & (order % teeth == 0)
    cut, idle = _in_cut(found, tooth, floor, teeth)
    if cut.sum() < LEAST_SEGMENTS:
        return _with(none, why="there is no cut in it, or too short a one: no lines at the "
                     "tooth-passing frequency; check speed and teeth")  # fmt: skip
    own = _with(none, speed_rpm=60 * float(np.median(found.n)),
                tooth_passing_Hz=teeth * float(np.median(found.n)))  # fmt: skip
    moves = np.array([*derivatives, *[0] * (len(y) - len(derivatives))])
    found = replace(found, moved=_moved(found, moves))
    return _judged(own, found, (y, rate, teeth), (cut, idle), (rotation, order, floor), speeds_rpm)


def _with(one: RecordedChatter, **changes: object) -> RecordedChatter:
    return replace(one, **changes)  # type: ignore[arg-type]


def _spectra(y: Floats, rate: float, speed: Floats, length: int) -> _Spectra:
    """Spectra of half-overlapping segments under Hann's window; channels of unit variance."""
    start = np.arange(0, y.shape[1] - length + 1, length // 2)
    window = np.hanning(length)
    scale = y.std(axis=1, keepdims=True)
    y = (y - y.mean(axis=1, keepdims=True)) / np.where(scale > 0, scale, 1.0)
    power = np.stack([
        np.abs(np.fft.rfft(window * (y[:, k : k + length] - y[:, k : k + length].mean(
            axis=1, keepdims=True)))) ** 2
        for k in start.tolist()
    ], axis=1)  # fmt: skip
    return _Spectra(
        frequency=np.arange(length // 2 + 1) * rate / length, power=power / (window**2).sum(),
        start=start,
        n=np.array([speed[k : k + length].mean() for k in start.tolist()]), length=length,
        moved=np.ones((len(y), 1)),
    )  # fmt: skip


def _moved(found: _Spectra, derivatives: Ints) -> Floats:
    """Weight of each line by the displacement it stands for; vibration alone where there is any."""
    chosen = derivatives > 0 if derivatives.any() else np.ones(len(derivatives), bool)
    relative = np.maximum(found.frequency, found.frequency[1]) / found.n.min()
    return np.where(chosen[:, None], relative ** (-2.0 * derivatives[:, None]), 0.0)


def _with_speed(found: _Spectra) -> _Spectra:
    """The same with the speed at which the rotation's lines are highest, by logarithms."""
    step = found.frequency[1]
    last = int(min(HARMONICS, 0.45 * 2 * found.frequency[-1] / found.n.max()))
    logs = np.log(found.power.sum(axis=0) + 1e-12)
    orders, rows = np.arange(1, last + 1), np.arange(len(found.n))[:, None]
    turns = float(np.median(found.n)) / step
    factors = 1 + np.arange(-SPEED_ERROR, SPEED_ERROR, 0.25 / (turns * last))
    score = [
        logs[rows, np.rint(found.n[:, None] * f * orders / step).astype(int)].sum() for f in factors
    ]
    best = np.flatnonzero(np.array(score) >= max(score) - 1e-9)
    return replace(found, n=found.n * float(factors[best].mean()))


def _rotation(found: _Spectra) -> tuple[Bools, Ints]:
    """Bins of the rotation's lines, and each bin's nearest order; shape (S, F)."""
    ratio = found.frequency[None] / found.n[:, None]
    order = np.rint(ratio).astype(np.int64)
    away = np.abs(ratio - order) * found.n[:, None]
    return away < GUARD * found.frequency[1] + 5e-4 * found.frequency, order


def _floor(found: _Spectra, rotation: Bools) -> Floats:
    """Floor of noise in each segment: running median between the lines; shape (C, S, F)."""
    from scipy.ndimage import median_filter

    out = np.empty_like(found.power)
    places = np.arange(len(found.frequency))
    for c, s in np.ndindex(*found.power.shape[:2]):
        between = np.flatnonzero(~rotation[s])
        smooth = median_filter(found.power[c, s, between], 4 * TURNS + 1, mode="nearest")
        out[c, s] = np.interp(places, between, smooth) / log(2)
    return np.maximum(out, 1e-12)


def _in_cut(found: _Spectra, tooth: Bools, floor: Floats, teeth: int) -> tuple[Bools, Bools]:
    """Segments in which the tooth-passing lines stand out, and idle ones; shape (S,).

    Where the speed changes, which spreads the lines, a segment is neither; between two cuts it is
    idle only with the tooth-passing lines near the floor.
    """
    energy = np.where(tooth & (found.frequency > 0.5 * found.n.min()), found.power / floor, 0.0)
    high = energy.max(axis=2).sum(axis=0)
    strength = np.where(tooth, found.power, 0.0).sum(axis=(0, 2))
    strong = strength > IN_CUT * np.quantile(strength, 0.9)
    stands_out = high > 4 * -log(FALSE_ALARM) * len(found.power)
    constant = 2 * teeth * np.abs(np.gradient(found.n)) < GUARD * found.frequency[1]
    cut = stands_out & strong & constant
    between = np.logical_or.accumulate(cut) & np.logical_or.accumulate(cut[::-1])[::-1]
    return cut, constant & ~cut & ~(between & stands_out)


def _judged(
    own: RecordedChatter, found: _Spectra, recorded: tuple[Floats, float, int],
    segments: tuple[Bools, Bools], parts: tuple[Bools, Ints, Floats],
    speeds_rpm: tuple[float, float] | None,
) -> RecordedChatter:  # fmt: skip
    """Verdict on a cut: on its line that stands out, or on lines at orders of the rotation."""
    (y, rate, teeth), (cut, idle), (rotation, order, floor) = recorded, segments, parts
    white = (found.power / floor).sum(axis=0)
    inside = (found.frequency > max(found.n.min(), 10.0)) & (found.frequency < 0.45 * rate)
    free = inside & ~rotation[cut].any(axis=0) & ~_of_mains(found.frequency)
    own = _with(own, frequency=found.frequency, spectrum=white[cut].mean(axis=0),
                seconds_in_cut=float(cut.sum() * found.length / 2 / rate))  # fmt: skip
    if free.sum() < 4 * TURNS:
        return _with(own, why="the band between the lines of the rotation is too small")
    line, chance = _lines(found, white, (cut, idle), free)
    locked = _locked(found, rotation, order, floor, cut, teeth)
    if locked.get("verdict") == "chatter":
        locked["stable_speeds_rpm"] = stable_speeds(
            locked["frequency_Hz"], teeth, own.speed_rpm, speeds_rpm
        )
    if not line.any():
        if locked:
            return _with(own, **locked)
        return _with(own, verdict="stable", confidence=_agree(cut.sum(), cut.sum()),
                     why="no line stands out between those of the rotation")  # fmt: skip
    seen = _loudest(own, found, recorded, cut, (rotation & inside, floor), line)
    near = white[:, max(seen.at - 1, 0) : seen.at + 2].max(axis=1) > -log(0.01) * len(y)
    there = near & cut
    longest = _longest_run(there if there.any() else cut)
    during = np.isin(np.flatnonzero(cut), longest)
    share = float(seen.energy[during].sum() / max(seen.whole[during].sum(), 1e-12))
    steady = _envelope(y, rate, seen.f_c, found, _filled(longest, seen.energy[during]))
    half = abs(seen.f_c / own.tooth_passing_Hz % 1 - 0.5) * own.tooth_passing_Hz
    judged = _with(
        own, frequency_Hz=seen.f_c, frequency_error_Hz=seen.error, energy_share=share,
        envelope=steady, false_alarm=float(min(chance[seen.at], 1.0)),
        kind="period doubling" if half < found.frequency[1] / 2 else "Hopf",
    )  # fmt: skip
    verdict = _verdict(judged, found, cut, there, longest, rate)
    if verdict.verdict == "chatter":
        speeds = stable_speeds(seen.f_c, teeth, own.speed_rpm, speeds_rpm)
        return _with(verdict, stable_speeds_rpm=speeds)
    return _with(own, **locked) if locked else verdict


def _lines(
    found: _Spectra, white: Floats, segments: tuple[Bools, Bools], free: Bools
) -> tuple[Bools, Floats]:
    """Bins of lines that noise alone does not make, and how probable it is that it does; (F,)."""
    from scipy.stats import gamma

    cut, idle = segments
    channels = len(found.power)
    shape = channels * max(cut.sum() / 2, 1.0)
    chance = gamma.sf(white[cut].mean(axis=0) * shape / channels, shape) * free.sum()
    line = free & (chance < FALSE_ALARM)
    if idle.sum() >= 2:  # a line that sounds without the cut too is another machine's
        line &= found.power[:, idle].mean(axis=(0, 1)) < 0.25 * found.power[:, cut].mean((0, 1))
    return line, chance


@dataclass(frozen=True, kw_only=True, eq=False)
class _Line:
    at: int  # its bin
    f_c: float  # [Hz]
    error: float  # [Hz]
    energy: Floats  # of it and the lines a tooth-passing frequency apart, (cut segments,)
    whole: Floats  # that and the energy of the rotation's lines


def _loudest(
    own: RecordedChatter, found: _Spectra, recorded: tuple[Floats, float, int], cut: Bools,
    parts: tuple[Bools, Floats], line: Bools,
) -> _Line:  # fmt: skip
    """The strongest line and those that belong to it, at the frequency at which most moves."""
    rotation, floor = parts
    power = (found.power - floor).sum(axis=0)[cut]
    width = GUARD * found.frequency[1]

    def belongs(f: float) -> Bools:
        apart = (found.frequency - f) % own.tooth_passing_Hz
        return line & (np.minimum(apart, own.tooth_passing_Hz - apart) < width)

    at = int(np.argmax(np.where(line, power.mean(axis=0), 0.0)))
    weighed = ((found.power - floor)[:, cut].mean(axis=1) * found.moved).sum(axis=0)
    at = int(np.argmax(np.where(belongs(found.frequency[at]), weighed, -np.inf)))
    f_c, error = _precise(power, found.frequency, at)
    energy = power[:, belongs(f_c)].sum(axis=1)
    synchronous = np.where(rotation[cut], power, 0.0).sum(axis=1)
    return _Line(at=at, f_c=f_c, error=error, energy=energy, whole=energy + synchronous)


def _verdict(
    own: RecordedChatter, found: _Spectra, cut: Bools, there: Bools, longest: Ints, rate: float
) -> RecordedChatter:
    """Verdict on the line of ``own`` by its energy, its envelope, and where it is ``there``."""
    share, steady = own.energy_share or 0.0, own.envelope or 0.0
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
            begins_s=float((found.start[first] + (first > 0) * found.length / 2) / rate),
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


def _of_mains(frequency: Floats) -> Bools:
    """Bins of the mains' harmonics; shape (F,)."""
    out = np.zeros(len(frequency), bool)
    for mains in MAINS:
        order = np.rint(frequency / mains)
        near = np.abs(frequency - order * mains) < 1.5 * frequency[1]
        out |= near & (order <= MAINS_HARMONICS) & (order > 0)
    return out


def _precise(power: Floats, frequency: Floats, at: int) -> tuple[float, float]:
    """Frequency of a line by the centroid of its bins, and half of its 95 % interval [Hz]."""
    around = slice(max(at - 2, 0), at + 3)
    weight = np.maximum(power[:, around], 0.0)
    each = (weight @ frequency[around]) / np.maximum(weight.sum(axis=1), 1e-12)
    kept = each[weight.sum(axis=1) > 0.1 * weight.sum(axis=1).max()]
    centre = float(weight.sum(axis=0) @ frequency[around] / weight.sum())
    return centre, float(1.96 * kept.std() / max(len(kept) / 2, 1.0) ** 0.5)


def _envelope(y: Floats, rate: float, f_c: float, found: _Spectra, segments: Ints) -> float:
    """<a^4> / <a^2>^2 of the line in consecutive segments, by its loudest channel [1]."""
    begin = int(found.start[segments[len(segments) // 4]])
    part = y[:, begin : int(found.start[segments[-1]]) + found.length]
    n = float(np.median(found.n))
    width = max(abs(f_c / n - round(f_c / n)) * n - found.frequency[1], 2 * found.frequency[1])
    spectrum = np.fft.fft(part - part.mean(axis=1, keepdims=True))
    frequency = np.fft.fftfreq(part.shape[1], 1 / rate)
    a = np.fft.ifft(np.where(np.abs(frequency - f_c) < width, spectrum, 0.0))
    size = part.shape[1]
    a2 = np.abs(a[:, size // 12 : size - size // 12]) ** 2
    loudest = int(np.argmax(a2.mean(axis=1) / np.maximum(part.var(axis=1), 1e-300)))
    return float((a2[loudest] ** 2).mean() / max(a2[loudest].mean() ** 2, 1e-300))


def _locked(
    found: _Spectra, rotation: Bools, order: Ints, floor: Floats, cut: Bools, teeth: int
) -> dict[str, Any]:
    """Chatter at orders of the rotation, as period doubling with an even number of teeth.

    Runout of a tool has orders m N +- 1: what lies at others is chatter where it is most of the
    energy; what lies there may be either.
    """
    power = np.maximum(found.power - floor, 0.0).sum(axis=0)[cut]
    orders = np.where(rotation[cut], order[cut], 0)
    rest = orders % teeth
    foreign = rest > 0
    runout = foreign & ((rest == 1) | (rest == teeth - 1))
    energy = power[orders > 0].sum()
    other, near = power[foreign & ~runout].sum() / energy, power[runout].sum() / energy
    if other + near < GREAT_SHARE:
        return {}
    at = int(np.argmax(np.where(foreign, power, 0.0).mean(axis=0)))
    f_c, spread = _precise(power, found.frequency, at)
    share = float(other + near)
    line = {"energy_share": share, "frequency_Hz": f_c, "frequency_error_Hz": spread}
    half = 2 * round(f_c / float(np.median(found.n))) % (2 * teeth) == teeth
    words = f"{100 * share:.0f} % of the energy lies at multiples of the rotation, not of the teeth"
    if other > 4 * near:
        return line | {"verdict": "chatter", "kind": "period doubling" if half else "Hopf",
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
