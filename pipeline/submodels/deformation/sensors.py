"""Plausibility of temperature sensors against each other: dead or drifting ones, replacements.

The expected temperature of a sensor is its linear regression on the present and low-passed
temperatures of the others.  All of these regressions, for any sensors that are left, follow from
one mean and one covariance of the training recordings (the conditional expectation of a Gaussian
vector).  A sensor that departs from its expectation by far more than is usual in training
recordings left out of the regression is named and replaced by its expectation.  A sample is only
ever held against samples at or before its time.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pipeline.schema.arrays import Bools, Floats, Ints
from pipeline.schema.ranges import NotNegative, Positive, Range, Ranged
from pipeline.submodels.deformation.records import Profile, State, filled
from pipeline.thermal.sensors import lag

DEAD, JUMPED, SHIFTED, DRIFTING, ERRATIC = "dead", "loose", "shifted", "drifting", "erratic"
"""Kinds of faults: no temperature at all or a held one; one that jumps off; one that is off from
the start of a recording; one that departs slowly from those of the others; one that departed so
far in training that nothing can be held against it."""
NOISE_K2 = 1e-6
"""Variance [K^2] of independent noise of a thousandth of a kelvin: sensors may be copies."""
START_FACTOR = 10.0
"""Factor on the tolerated departure at the start, from which it decays as the lags settle [1]."""
JUMP_SAMPLES = 3
"""Number of samples whose median departure is the reference of a jump [1]."""
SIDE_SAMPLES = 4
"""Samples on either side of a step whose straight lines are held against each other [1]."""
LEVEL_SD_K = 30.0
"""Scatter of the level that all channels share from one recording to the next [K]: day, season."""
COMPARABLE = 20.0
"""Ratio of a sensor's tolerance to the median one from which it is faulty everywhere [1]."""
MAD_SD = 1.4826
"""Standard deviation of a normal distribution over its median absolute deviation [1]."""
MOVED = 4.0
"""Least movement of the others that shows a held value, over the least departure [1]."""
SET_ASIDE, SUSPECT = 1 / 3, 2.0
"""Share of the training recordings that may be set aside at first [1], and the ratio of a departure
to the usual one from which they are [1]."""
ROUNDS = 3
"""Number of repetitions of the regressions without the sensors that were faulty [1]."""


@dataclass(frozen=True, kw_only=True)
class SensorSettings(Ranged, section="deformation_fit.sensors"):
    """Plausibility check of sensors."""

    range_degC: tuple[float, float] = (-30.0, 150.0)
    """Temperatures that a working sensor can show; an open or shorted line lies outside."""
    dead_s: NotNegative = 300.0
    """A sensor without a value for so long is dead [s]."""
    held_s: Positive = 1200.0
    """So is one whose value has not changed at all for so long, while those of the others have
    moved by four times ``least_K`` in the median [s]."""
    settle_s: NotNegative = 1800.0
    """Settling time of the lags, unknown at the start of a recording [s]; until then ten times the
    departure is tolerated."""
    smooth_s: Positive = 600.0
    """Time constant of the mean over which a departure counts [s]."""
    lags_s: tuple[Annotated[float, Range(above=0.0)], ...] = (600.0, 3600.0)
    """Time constants of the low-passed temperatures in the regressions [s]."""
    times: Annotated[float, Range(above=1.0)] = 4.0
    """A sensor is faulty when its departure is so many times the median, over the training
    recordings, of the largest departure in each after it has settled [1]."""
    least_K: Positive = 0.5
    """A smaller departure is never a fault [K]."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A faulty sensor in one recording."""

    sensor: str
    """Its name."""
    kind: str
    """``"dead"``, ``"loose"``, ``"shifted"``, ``"drifting"`` or ``"erratic"``."""
    since_s: float
    """Time of detection, since the start of the recording [s]."""
    departure_K: float | None
    """Largest departure from what the other sensors say [K], above zero where it reads too high;
    None where it gives no value."""

    @property
    def sentence(self) -> str:
        """Defect, in words, without a full stop."""
        off = "" if self.departure_K is None else f", off by up to {self.departure_K:+.1f} K"
        return f"sensor {self.sensor} is {self.kind} from minute {self.since_s / 60:.0f}{off}"


@dataclass(frozen=True, kw_only=True)
class Checked:
    """A state whose faulty sensors are replaced."""

    states: tuple[State, ...]
    """States, one for each set of faulty sensors in the order of time: every state is complete and
    holds the whole recording with the faults of that set."""
    since: tuple[int, ...]
    """First sample of each state [1]."""
    faults: tuple[Fault, ...] = ()
    """Faults in the order of detection."""


@dataclass(frozen=True, kw_only=True)
class SensorModel:
    """Mean and covariance of temperatures, and how far each sensor departs from the others.

    C channels: S sensors and the ambient temperature where it is recorded; L lags.
    """

    sensors: tuple[str, ...]
    """Sensors from front to rear."""
    channels: int
    """C [1]."""
    period_s: float
    """Period of the samples [s]."""
    mean: tuple[float, ...]
    """Mean of the present temperatures, then of those low-passed by each lag [degC]."""
    covariance: tuple[tuple[float, ...], ...]
    """Covariance [K^2]."""
    tolerance_K: tuple[float, ...]
    """Departure from which a sensor is faulty [K]."""
    settings: SensorSettings = field(default_factory=SensorSettings)
    """Settings of the check."""
    held_s: tuple[float, ...] = ()
    """Greatest time of an unchanged value while the others move [s]: longer than usual for a sensor
    of its resolution; empty for ``settings.held_s``."""
    jump_K: tuple[float, ...] = ()
    """Change of the departure within a sample from which it is [K]; empty for any change."""

    @cached_property
    def _arrays(self) -> tuple[Floats, Floats]:
        return np.array(self.mean), np.array(self.covariance)

    @cached_property
    def erratic(self) -> frozenset[int]:
        """Sensors of which much more is tolerated than of the others; two at least are left."""
        tolerance = np.array(self.tolerance_K)
        over = np.flatnonzero(tolerance > COMPARABLE * np.median(tolerance))
        return frozenset(over.tolist() if len(tolerance) - len(over) >= 2 else [])

    def expected(self, vector: Floats, sensor: int, gone: frozenset[int]) -> Floats:
        """Temperature of one sensor as the others say [degC].

        ``vector`` is that of :func:`lagged`, (T, C (1 + L)); sensors ``gone`` are not read either.
        Shape (T,).
        """
        mean = self._arrays[0]
        used, weights, _ = self.regression(sensor, gone)
        return mean[sensor] + (vector[:, used] - mean[used]) @ weights

    def regression(self, sensor: int, gone: frozenset[int]) -> tuple[Ints, Floats, float]:
        """Columns that a sensor's expectation rests on, their weights, and what is left [K]."""
        key = (sensor, gone - {sensor})
        if key not in self._regressions:
            covariance = self._arrays[1]
            channel = np.arange(len(covariance)) % self.channels
            used = np.flatnonzero((channel != sensor) & ~np.isin(channel, list(gone)))
            among = covariance[np.ix_(used, used)] + NOISE_K2 * np.eye(len(used))
            weights = np.linalg.solve(among, covariance[used, sensor])
            left = covariance[sensor, sensor] - weights @ covariance[used, sensor]
            self._regressions[key] = used, weights, float(np.sqrt(max(left, NOISE_K2)))
        return self._regressions[key]

    @cached_property
    def _regressions(self) -> dict[tuple[int, frozenset[int]], tuple[Ints, Floats, float]]:
        return {}

    def replaced(self, state: State, gone: frozenset[int], holes: Bools) -> State:
        """The state with the sensors ``gone``, and single samples that are ``holes``, replaced."""
        if not gone and not holes.any():
            return state
        temperatures = _bridged(state.temperatures, holes)
        one = replace(state, temperatures=temperatures)
        vector = lagged(one, self.settings.lags_s)
        result = temperatures.copy()
        for sensor in sorted(gone):
            result[:, sensor] = self.expected(vector, sensor, gone)
        return replace(state, temperatures=result)

    def departures(self, vector: Floats, gone: frozenset[int]) -> Floats:
        """Departure of each sensor from the others [K], (T, S); zero for those ``gone``."""
        found = np.zeros((len(vector), len(self.sensors)))
        for sensor in range(len(self.sensors)):
            if sensor not in gone:
                found[:, sensor] = vector[:, sensor] - self.expected(vector, sensor, gone)
        return found

    def sizes(
        self, vector: Floats, gone: frozenset[int], kept: bool = True
    ) -> tuple[Floats, Floats]:
        """Smoothed departures over what is tolerated more while the lags settle, and jumps [K].

        A jump counts where the sample after it is there too, unless it need not be ``kept``.

        Shape (T, S), not negative.
        """
        time, found = self.period_s * np.arange(len(vector)), self.departures(vector, gone)
        unsettled = 1 + (START_FACTOR - 1) * np.exp(-time / max(self.settings.settle_s, 1e-9))
        smoothed = np.abs(lag(time, found, self.settings.smooth_s)) / unsettled[:, None]
        jumps = np.zeros(found.shape)
        if len(found) <= JUMP_SAMPLES + 1:
            return smoothed, jumps
        if kept:
            before = np.median(sliding_window_view(found, JUMP_SAMPLES, axis=0)[:-2], axis=-1)
            first, second = found[JUMP_SAMPLES:-1] - before, found[JUMP_SAMPLES + 1 :] - before
            jumps[JUMP_SAMPLES + 1 :] = np.where(
                first * second > 0, np.minimum(np.abs(first), np.abs(second)), 0.0
            )
        else:
            before = np.median(sliding_window_view(found, JUMP_SAMPLES, axis=0)[:-1], axis=-1)
            jumps[JUMP_SAMPLES:] = np.abs(found[JUMP_SAMPLES:] - before)
        return smoothed, jumps

    def ratios(self, vector: Floats, gone: frozenset[int], kept: bool = True) -> Floats:
        """Departures and jumps over what is tolerated when the sensors ``gone`` are not read [1].

        With fewer sensors to rest on an expectation errs more, and so much more is tolerated.
        """
        more = np.array([
            self.regression(k, gone)[2] / self.regression(k, frozenset())[2]
            for k in range(len(self.sensors))
        ])  # fmt: skip
        smoothed, jumps = self.sizes(vector, gone, kept)
        ratios: Floats = smoothed / (np.array(self.tolerance_K) * more)
        if self.jump_K:
            ratios = np.maximum(ratios, jumps / (np.array(self.jump_K) * more))
        return ratios

    def check(self, state: State, ignored: Sequence[str] = ()) -> Checked:
        """Find the faulty sensors of a recording in the order of time, and replace them.

        Sensors that are ``ignored`` are replaced from the start and never blamed.
        At the first sample at which a sensor departs too far, that sensor is faulty without which
        the others agree best.  Where they do not agree without any single one, the temperatures are
        unlike those of the training recordings, and no sensor is blamed.
        """
        settings = self.settings
        holes = holes_of(state, settings, self.held_s)
        dead = _dead_since(holes, max(1, round(settings.dead_s / self.period_s)))
        gone = {self.sensors.index(name): 0 for name in ignored}
        faults: list[Fault] = []
        filled_in = _bridged(state.temperatures, holes)
        vector = lagged(replace(state, temperatures=filled_in), settings.lags_s)
        for sensor in sorted(self.erratic - set(gone)):
            gone[sensor] = 0
            faults.append(self._fault(state, vector, sensor, self.erratic, 0, holes))
        start = 0
        while True:
            blamed = self._next(vector, frozenset(gone), start, dead)
            if blamed is None or len(self.sensors) - len(gone) <= 2:
                break
            sensor, since = blamed
            gone[sensor] = start = since
            faults.append(self._fault(state, vector, sensor, frozenset(gone), since, holes))
        moments = tuple(sorted({0, *gone.values()}))
        states = tuple(
            self.replaced(state, frozenset(s for s, since in gone.items() if since <= first), holes)
            for first in moments
        )
        return Checked(states=states, since=moments, faults=tuple(faults))

    def _next(
        self, vector: Floats, gone: frozenset[int], start: int, dead: Mapping[int, int]
    ) -> tuple[int, int] | None:
        """The next sensor to be blamed, and from which sample on; None where there is none."""
        silent = {s: max(since, start) for s, since in dead.items() if s not in gone}
        ratios = self.ratios(vector, gone)
        over = np.flatnonzero((ratios[start:] > 1).any(axis=1)) + start
        first = int(over[0]) if len(over) else len(vector)
        if silent and min(silent.values()) <= first:
            sensor = min(silent, key=lambda s: (silent[s], s))
            return sensor, silent[sensor]
        for at in over:
            worst = {
                suspect: float(self.ratios(vector[: at + 1], gone | {suspect})[-1].max())
                for suspect in np.flatnonzero(ratios[at] > 0.5).tolist()
            }
            agreeing = [suspect for suspect, one in worst.items() if one < 1.0]
            if not agreeing:
                continue
            if len(agreeing) > 1:  # in the sample of a jump the mean has hardly moved yet
                for suspect in agreeing:
                    found = self.ratios(vector[: at + 1], gone | {suspect}, kept=False)
                    worst[suspect] = float(found[-1].max())
            return min(agreeing, key=lambda one: worst[one]), int(at)
        return None

    def _fault(
        self, state: State, vector: Floats, sensor: int, gone: frozenset[int], since: int,
        holes: Bools,
    ) -> Fault:  # fmt: skip
        off = state.temperatures[:, sensor] - self.expected(vector, sensor, gone)
        silent = bool(holes[since:, sensor].mean() > 0.5)
        # a jump is over within minutes, a drift takes longer than the mean over which it counts
        many, limit = max(1, round(self.settings.dead_s / self.period_s)), self.tolerance_K[sensor]
        jumped = abs(off[since] - off[max(0, since - many)]) > limit
        shifted = bool(np.median(np.abs(off[:many])) > limit)
        off = off[since:][~holes[since:, sensor]]
        kind = ERRATIC if sensor in self.erratic else SHIFTED if shifted else DRIFTING
        return Fault(
            sensor=self.sensors[sensor],
            kind=DEAD if silent else JUMPED if jumped else kind,
            since_s=since * self.period_s,
            departure_K=round(float(off[np.argmax(np.abs(off))]), 2)
            if len(off) and not silent
            else None,
        )


def lagged(state: State, lags_s: Sequence[float]) -> Floats:
    """Channels of a state, then each of them low-passed; shape (T, C (1 + L))."""
    channels = state.channels
    return np.column_stack((channels, *(lag(state.time, channels, s) for s in lags_s)))


def _bridged(temperatures: Floats, holes: Bools) -> Floats:
    """Temperatures with each hole held at the sensor's last value, at the others' mean before."""
    result = np.where(holes, np.nan, temperatures)
    some = np.isfinite(result).any(axis=1)
    first = result[np.argmax(some)]
    start = float(np.mean(first[np.isfinite(first)])) if some.any() else 0.0
    for sensor in np.flatnonzero(holes.any(axis=0)):
        result[:, sensor] = filled(result[:, sensor], start)
    return result


def _dead_since(holes: Bools, samples: int) -> dict[int, int]:
    """First sample at which a sensor has given no value for ``samples``; those that never do.

    Samples at which no sensor gives a value are a gap of the recording and no fault of a sensor.
    """
    found = {}
    silent = holes.all(axis=1)
    for sensor in np.flatnonzero(holes.any(axis=0)):
        run = 0
        for at, hole in enumerate(holes[:, sensor] & ~silent):
            run = run + 1 if hole else 0
            if run >= samples or (hole and at == run - 1 == 0):
                found[int(sensor)] = at
                break
    return found


def holes_of(state: State, settings: SensorSettings, held_s: Sequence[float] = ()) -> Bools:
    """Samples that are no temperature: absent, out of range, or held while the others move.

    ``held_s`` says of each sensor how long it may show one value, ``settings`` unless given.

    Shape (T, S).
    """
    values = state.temperatures
    low, high = settings.range_degC
    holes = ~np.isfinite(values) | (values < low) | (values > high)
    for sensor in range(values.shape[1]):
        hold = held_s[sensor] if held_s else settings.held_s
        if np.isinf(hold):
            continue
        began = _held_since(values[:, sensor])
        long = np.flatnonzero(np.arange(len(values)) - began >= round(hold / state.period))
        moved = np.abs(np.where(holes, np.nan, values)[long] - values[began[long]])
        others = np.delete(moved, sensor, axis=1)
        some = np.isfinite(others).any(axis=1)
        far = np.zeros(len(long), bool)
        far[some] = np.nanmedian(others[some], axis=1) > MOVED * settings.least_K
        for at in long[far]:  # the samples since it began are held as well: known from now on only
            holes[at, sensor] = True
    return holes


def _held_since(values: Floats) -> Ints:
    """Sample at which each value was first shown without a change since, shape (T,)."""
    same = np.diff(values, prepend=np.nan) == 0
    return np.maximum.accumulate(np.where(same, -1, np.arange(len(values))))


def usual_holds(states: Sequence[State], settings: SensorSettings) -> tuple[float, ...]:
    """Usual time of an unchanged value of each sensor [s], by its resolution.

    Half as long again as the median, over the recordings, of its longest hold while the others
    moved; ``settings.held_s`` at least.  A sensor that is stuck in fewer than half of the
    recordings does not raise it.
    """
    longest = np.zeros((len(states), states[0].temperatures.shape[1]))
    for k, state in enumerate(states):
        values = state.temperatures
        absent = holes_of(state, settings, (np.inf,) * values.shape[1])
        held = holes_of(state, settings) & ~absent
        for sensor in range(values.shape[1]):
            ages = (np.arange(len(values)) - _held_since(values[:, sensor]))[held[:, sensor]]
            longest[k, sensor] = ages.max(initial=0) * state.period
    usual = 1.5 * np.median(longest, axis=0)
    return tuple(np.maximum(usual, settings.held_s).tolist())


def fit_sensors(
    profiles: Sequence[Profile], sensors: Sequence[str], settings: SensorSettings
) -> SensorModel:
    """Regressions of the sensors on each other, from training recordings that may hold faults.

    The tolerance of a sensor rests on recordings left out of the regressions in turn; sensors that
    exceed it are replaced in their recording, and all is fitted anew. ValueError when fewer than
    two recordings have all sensors.
    """
    states = [one.state for one in profiles]
    held_s = usual_holds(states, settings)
    holes = [holes_of(state, settings, held_s) for state in states]
    # a sensor that is silent for long was not sound before either: its recording waits
    whole = [
        replace(state, temperatures=_bridged(state.temperatures, none))
        for state, none in zip(states, holes, strict=True)
        if not _dead_since(none, max(1, round(settings.dead_s / state.period)))
    ]
    if len(whole) < 2:
        raise ValueError(
            f"{len(whole)} training recordings have a value of every sensor, 2 are the least: "
            "leave the dead sensor out of deformation_records.temperatures"
        )
    blank = SensorModel(
        sensors=tuple(sensors), channels=states[0].channels.shape[1], period_s=states[0].period,
        mean=(), covariance=(), tolerance_K=(1.0,) * len(sensors), settings=settings,
    )  # fmt: skip
    level = _of_one_level(_before_jumps(whole, settings), blank)
    model = _fitted(_agreeing(level, blank), blank)
    for _ in range(ROUNDS):
        # what a faulty sensor said teaches nothing: what the others say of it stands there
        checked = [replace(model, held_s=held_s).check(state) for state in states]
        faulty = [frozenset(fault.sensor for fault in one.faults) for one in checked]
        model = _fitted([one.states[-1] for one in checked], blank, faulty)
    return replace(model, held_s=held_s)


def steps_of(temperatures: Floats) -> Floats:
    """Step of each sensor before each sample [K], (T, S); zero near both ends.

    The difference of two straight lines, through the samples before it and those from it on, so
    that neither a slope nor a change of slope is a step.
    """
    found, many = np.zeros(temperatures.shape), SIDE_SAMPLES
    if len(temperatures) < 2 * many:
        return found
    centred = np.arange(many) - (many - 1) / 2
    # value of the line half a sample beyond its end
    ahead = 1 / many + centred * (many / 2) / np.sum(centred**2)
    windows = sliding_window_view(temperatures, many, axis=0)
    before, after = windows[:-many] @ ahead, windows[many:] @ ahead[::-1]
    found[many : len(temperatures) - many + 1] = after - before
    return found


def lone_steps(steps: Sequence[Floats]) -> list[Floats]:
    """Steps of each sensor that no other sensor shows too [K], of the steps of each recording.

    Each is the least distance from zero and from a multiple of any other sensor's step; the
    multiple is the L1 regression over all recordings, which a few jumps do not move.

    Shape (T, S), not negative.
    """
    every, many = np.vstack(steps), steps[0].shape[1]
    found = [np.abs(one) for one in steps]
    for sensor in range(many):
        for other in (k for k in range(many) if k != sensor):
            slope = _slope(every[:, other], every[:, sensor])
            for one, least in zip(steps, found, strict=True):
                apart = np.abs(one[:, sensor] - slope * one[:, other])
                least[:, sensor] = np.minimum(least[:, sensor], apart)
    return found


def _slope(x: Floats, y: Floats) -> float:
    """Slope of the L1 regression of ``y`` on ``x`` through zero: a weighted median of y / x."""
    some = np.flatnonzero(x)
    ratio, weight = y[some] / x[some], np.abs(x[some])
    order = np.argsort(ratio)
    heap = np.cumsum(weight[order])
    return float(ratio[order[np.searchsorted(heap, heap[-1] / 2)]]) if len(some) else 0.0


def _before_jumps(states: Sequence[State], settings: SensorSettings) -> list[State]:
    """Recordings up to the first jump of a sensor, without those that show too little before it.

    A step of one sensor alone counts that is several times the largest of an ordinary recording:
    that which three of four recordings exceed.
    """
    steps = lone_steps([steps_of(state.temperatures) for state in states])
    usual = np.quantile([one.max(axis=0) for one in steps], 0.25, axis=0)
    limit = np.maximum(settings.times * usual, settings.least_K)
    found = []
    for state, one in zip(states, steps, strict=True):
        over = np.flatnonzero((one > limit).any(axis=1))
        many = int(over[0]) if len(over) else len(state)
        if many * state.period > settings.settle_s + settings.smooth_s:
            found.append(state.within(slice(many)))
    return found if len(found) >= 2 else list(states)


def _of_one_level(states: Sequence[State], blank: SensorModel) -> list[State]:
    """Recordings in which no sensor's offset against the others differs from that of most.

    The regressions rest on what moves within recordings, so that no offset enters them.  A sensor's
    offset is the mean of its departure over a recording; usual are those in the shortest interval
    that holds half of the recordings.
    """
    settings = blank.settings
    vectors = [lagged(state, settings.lags_s) for state in states]
    within = np.mean([np.cov(one, rowvar=False, bias=True) for one in vectors], axis=0)
    model = replace(blank, covariance=tuple(map(tuple, (within + LEVEL_SD_K**2).tolist())),
                    mean=(0.0,) * within.shape[0])  # fmt: skip
    levels = np.array([one.mean(axis=0) for one in vectors])
    gone: frozenset[int] = frozenset()
    kept = np.ones(len(states), bool)
    while len(blank.sensors) - len(gone) > 2:
        over = _unusual(model.departures(levels, gone), settings)
        if not (over > 1).any():
            break
        suspects = np.flatnonzero((over > 0.5).any(axis=0)).tolist()
        worst = {s: float(np.sum(_unusual(model.departures(levels, gone | {s}), settings) > 1))
                 for s in suspects}  # fmt: skip
        blamed = min(suspects, key=lambda s: (worst[s], -over[:, s].max()))
        kept &= over[:, blamed] <= 1
        gone |= {blamed}
    found = [state for state, keep in zip(states, kept, strict=True) if keep]
    return found if len(found) >= 2 else list(states)


def _unusual(offsets: Floats, settings: SensorSettings) -> Floats:
    """Distance of each offset from the usual ones over what is tolerated [1], of (K, S) in [K]."""
    half = len(offsets) // 2 + 1
    ordered = np.sort(offsets, axis=0)
    widths = ordered[half - 1 :] - ordered[: len(ordered) - half + 1]
    first, sensor = np.argmin(widths, axis=0), np.arange(offsets.shape[1])
    centre = 0.5 * (ordered[first, sensor] + ordered[first + half - 1, sensor])
    spread = MAD_SD * 0.5 * widths[first, sensor]
    spread = np.minimum(spread, settings.times * np.median(spread))
    limit = np.maximum(settings.times * spread, settings.least_K)
    return np.abs(offsets - centre) / limit


def _agreeing(states: Sequence[State], blank: SensorModel) -> list[State]:
    """Recordings without those that agree least with the others, a third at most.

    A fault in several recordings is learnt by the regressions and hides itself; one recording
    after the other is set aside, the one whose largest departure is furthest above the usual.
    """
    kept = list(states)
    while len(kept) > max(2, round((1 - SET_ASIDE) * len(states))):
        largest, least = _largest_departures(kept, blank)[0], blank.settings.least_K
        usual = np.maximum(np.median(largest, axis=0), least / blank.settings.times)
        score = (largest / usual).max(axis=1)
        if score.max() <= SUSPECT:
            break
        del kept[int(np.argmax(score))]
    return kept


def _largest_departures(
    states: Sequence[State], blank: SensorModel
) -> tuple[Floats, Floats, SensorModel]:
    """Largest departures and jumps by recording, cross-validated, (recordings, S) [K]; model."""
    vectors = [lagged(state, blank.settings.lags_s) for state in states]
    largest, jumps = np.zeros((2, len(vectors), len(blank.sensors)))
    for out, vector in enumerate(vectors):
        others = _with_moments(blank, [one for k, one in enumerate(vectors) if k != out])
        smoothed, jumped = others.sizes(vector, frozenset())
        largest[out], jumps[out] = smoothed.max(axis=0), jumped.max(axis=0)
    return largest, jumps, _with_moments(blank, vectors)


def _fitted(
    states: Sequence[State], blank: SensorModel, faulty: Sequence[frozenset[str]] = ()
) -> SensorModel:
    """Model of complete states, without those of sensors ``faulty`` there; tolerance by folds."""
    *sizes, model = _largest_departures(states, blank)
    sound = np.array([[name not in one for name in blank.sensors] for one in faulty] or True)
    tolerance, jump = (_tolerance(size, sound & np.ones(size.shape, bool), blank.settings)
                       for size in sizes)  # fmt: skip
    return replace(model, tolerance_K=tolerance, jump_K=jump)


def _tolerance(largest: Floats, sound: Bools, settings: SensorSettings) -> tuple[float, ...]:
    """Several times the usual largest value of each sensor; one that was never sound is erratic."""
    usual = np.ma.median(np.ma.array(largest, mask=~sound), axis=0).filled(np.nan)
    found = np.maximum(settings.times * usual, settings.least_K)
    found = np.where(np.isnan(found), 2 * COMPARABLE * np.nanmedian(found), found)
    return tuple(np.round(found, 4).tolist())


def _with_moments(model: SensorModel, vectors: Sequence[Floats]) -> SensorModel:
    """The model with mean and covariance of the rows of all recordings, each counting alike."""
    mean = np.mean([one.mean(axis=0) for one in vectors], axis=0)
    covariance = np.mean([(one - mean).T @ (one - mean) / len(one) for one in vectors], axis=0)
    return replace(
        model, mean=tuple(mean.tolist()), covariance=tuple(map(tuple, covariance.tolist()))
    )
