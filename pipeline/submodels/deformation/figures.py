"""Facts and figures of spindle growth for the machine's page: first hour, sensors, errors.

They come from the three stored files alone: model, verdict, predictions.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import timedelta
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd

from pipeline.charts.bands import Axis, Strip
from pipeline.charts.numbers import instant, moment
from pipeline.schema.arrays import Floats
from pipeline.schema.si import HOUR, MINUTE
from pipeline.schema.verdict import Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.deformation.model import DeformationModel
from pipeline.submodels.deformation.records import GROWTH

GOAL_MAX_UM, GOAL_MAPE = 6.0, 0.7
"""Goals of FFNN2015: largest error [um] on a range of 50 um, and relative error [%]."""
FAULT = re.compile(
    r"sensor (?P<sensor>.+) is (?P<kind>\w+) from minute (?P<minute>\d+)"
    r"(?:, off by up to (?:(?P<departure>[+-][\d.]+)|[\d.]+) K)?"
)
"""A fault as the verdict words it."""
AS_IS, REPLACED = "largest error with the faulty sensor", "largest error with it replaced"
"""Facts of a case that say what a faulty sensor costs."""

Seen = Shown[DeformationModel]


@dataclass(frozen=True, kw_only=True)
class FirstHour:
    """Growth in the first hour of one recording."""

    case: str
    """The recording in which the spindle grew most."""
    growth: float
    low: float
    high: float
    """Largest predicted growth within the hour, with its 90 % interval [um]."""
    measured: float
    """Reading of the probe then [um]."""
    speed: float | None
    """Highest speed of the recording [rev/min]."""
    settled_min: float
    """Time from which the growth stays within ``within_um`` of its last value [min]."""
    within_um: float
    """[um]."""
    others: int
    """Recordings of an hour or more, this one included."""


@dataclass(frozen=True, kw_only=True)
class SensorFault:
    """A sensor that is faulty in one recording or several."""

    sensor: str
    kind: str
    """Its name; what is wrong with it."""
    case: str
    """First recording in which it was noticed."""
    minute: float
    """Minute of the recording at which it was detected [min]."""
    worst_K: float | None
    """Largest departure [K], above zero where it reads too high; None where it gives no value."""
    cases: int
    """Recordings in which it is faulty."""
    lasts: bool
    """Whether the last recording is among them."""
    place: str
    """Place of the sensor, as far as the machine's file names it."""
    moment: str
    """Time of detection, by the recording's clock."""
    last: str
    """The last recording in which it is faulty."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GrowthFacts:
    """Facts of the page, computed once."""

    shown: Seen

    @cached_property
    def whole(self) -> pd.DataFrame:
        """Rows of growth of all recordings, each once; empty without predictions."""
        rows = self.shown.predictions
        if rows is None:
            return pd.DataFrame({"group": [], "role": [], "t": []})
        return rows[(rows["quantity"] == GROWTH) & (rows["regime"] == "")]

    @cached_property
    def limit(self) -> float | None:
        """Largest error that passes [um]."""
        verdict = self.shown.verdict
        found = () if verdict is None else (s.limits.get("max") for s in verdict.of(GROWTH))
        return next((limit for limit in found if limit is not None), None)

    @cached_property
    def first_hour(self) -> FirstHour | None:
        """The recording with the largest growth within its first hour."""
        best: tuple[float, str] | None = None
        others = 0
        for name, rows in self.whole.groupby("group"):
            if rows["t"].max() < HOUR:
                continue
            others += 1
            peak = float(rows.loc[rows["t"] <= HOUR, "predicted"].max())
            if best is None or peak > best[0]:
                best = peak, str(name)
        if best is None:
            return None
        rows = self.whole[self.whole["group"] == best[1]].sort_values("t")
        within = rows[rows["t"] <= HOUR]
        top = within.iloc[int(np.nanargmax(within["predicted"].to_numpy(float)))]
        tolerance = self.limit or GOAL_MAX_UM
        return FirstHour(
            case=best[1], growth=float(top["predicted"]), low=float(top["low"]),
            high=float(top["high"]), measured=float(top["measured"]),
            speed=condition(self.shown.verdict, best[1], "highest speed"),
            settled_min=settled(within["t"].to_numpy(float), within["predicted"].to_numpy(float),
                                tolerance),
            within_um=tolerance, others=others,
        )  # fmt: skip

    @cached_property
    def faults(self) -> list[SensorFault]:
        """Faulty sensors in the order in which they were noticed."""
        verdict = self.shown.verdict
        cases = () if verdict is None else sorted(verdict.cases, key=lambda c: c.case)
        found: dict[str, list[tuple[str, re.Match[str]]]] = {}
        for case in cases:
            for name, fact in case.facts.items():
                match = FAULT.fullmatch(str(fact.value)) if name.startswith("faulty") else None
                if match is not None:
                    found.setdefault(match["sensor"], []).append((case.case, match))
        last = cases[-1].case if cases else ""
        return [self._fault(name, seen, last) for name, seen in found.items()]

    def _fault(
        self, name: str, seen: Sequence[tuple[str, re.Match[str]]], last: str
    ) -> SensorFault:
        case, first = seen[0]
        departures = [float(m["departure"]) for _, m in seen if m["departure"]]
        return SensorFault(
            sensor=name, kind=first["kind"], case=case, minute=float(first["minute"]),
            worst_K=max(departures, key=abs, default=None), cases=len(seen),
            lasts=seen[-1][0] == last, place=self.place(name), last=seen[-1][0],
            moment=self._moment(case, float(first["minute"])),
        )  # fmt: skip

    def place(self, sensor: str) -> str:
        """Place of a sensor by the machine's file, and its number from the front."""
        model = self.shown.model
        if model is None or sensor not in model.sensors.sensors:
            return "its place is not known"
        names, said = model.sensors.sensors, model.places.get(sensor, "")
        order = f"sensor {names.index(sensor) + 1} of {len(names)} from the front"
        return f"{said}, {order}" if said else order

    def _moment(self, case: str, minute: float) -> str:
        start = instant(self._files.get(case, {}).get("first"))
        return "not dated" if start is None else moment(start + timedelta(minutes=minute))

    @cached_property
    def _files(self) -> Mapping[str, Mapping[str, Any]]:
        if self.shown.signals is None:
            return {}
        manifest = self.shown.shelf.document(self.shown.signals / "manifest.json", "raw files")
        return (manifest or {}).get("files", {})

    @cached_property
    def cost(self) -> tuple[float, float] | None:
        """Largest error with faulty sensors as they are, and with them replaced [um]."""
        verdict = self.shown.verdict
        cases = [] if verdict is None else [
            c for c in verdict.cases if c.role == verdict.judged_role
        ]  # fmt: skip
        as_is = [_number(c.facts[AS_IS].value) for c in cases if AS_IS in c.facts]
        replaced = [_number(c.facts[REPLACED].value) for c in cases if REPLACED in c.facts]
        return (max(as_is), max(replaced)) if as_is and replaced else None

    def runs(self, regime: str) -> list[tuple[Floats, Floats]]:
        """Stretches in a regime: time since each began [s], error of the model [um]."""
        rows, model, verdict = self.shown.predictions, self.shown.model, self.shown.verdict
        if rows is None or model is None or verdict is None:
            return []
        rows = rows[(rows["quantity"] == GROWTH) & (rows["regime"] == regime)
                    & (rows["role"] == verdict.judged_role)]  # fmt: skip
        found = []
        for _, one in rows.groupby("group"):
            one = one.sort_values("t")
            t = one["t"].to_numpy(float)
            error = (one["predicted"] - one["measured"]).to_numpy(float)
            cuts = np.flatnonzero(np.diff(t) > 1.5 * model.sensors.period_s) + 1
            for part, errors in zip(np.split(t, cuts), np.split(error, cuts), strict=True):
                if len(part) and part[-1] - part[0] >= model.rate_s:
                    found.append((part - part[0], errors))
        return found


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else float("nan")


def settled(t: Floats, growth: Floats, within: float) -> float:
    """Time from which growth stays ``within`` its last value [min], of samples shape (T,).

    Examples
    --------
    >>> settled(np.array([0.0, 60.0, 120.0, 180.0]), np.array([0.0, 8.0, 12.0, 13.0]), 2.0)
    2.0
    """
    away = np.flatnonzero(np.abs(growth - growth[-1]) > within)
    first = int(away[-1]) + 1 if len(away) else 0
    return float(t[min(first, len(t) - 1)]) / 60.0


def condition(verdict: Verdict | None, case: str, name: str) -> float | None:
    """A condition of a case; None where it is not recorded."""
    cases = [] if verdict is None else [c for c in verdict.cases if c.case == case]
    value = cases[0].conditions[name].value if cases and name in cases[0].conditions else None
    return float(value) if isinstance(value, int | float) else None


GROUP_CURVES = ("f1", "f3", "f5")
"""CSS classes of front, middle and rear."""
GROUP_NAMES = ("front", "middle", "rear")
NARROWEST = 0.3
"""Least width of a band of the network [channels]; where its stored places begin."""
BIN_MIN = 5.0
"""Width of a step after a start or a stop [min]."""
SHOWN_MIN = 90.0
"""Time after a start or a stop that is drawn [min]."""
FEWEST = 3
"""Starts or stops below which a step is not drawn [1]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Transitions:
    """Errors after a start or a stop, in steps of time: K steps."""

    minutes: Floats
    """Middle of each step [min]; shape (K,)."""
    low: Floats
    middle: Floats
    high: Floats
    """5, 50 and 95 % of the samples lie below [um]; NaN with too few; shape (K,)."""
    count: int
    """Starts or stops [1]."""

    @property
    def widest(self) -> float:
        """Greatest magnitude [um]."""
        return float(np.nanmax(np.abs([self.low, self.high]), initial=0.0))


def transitions(runs: Sequence[tuple[Floats, Floats]]) -> Transitions | None:
    """Errors [um] of all runs over the time since each began [s]; None with too few."""
    edges = np.arange(0.0, SHOWN_MIN + BIN_MIN, BIN_MIN)
    values = np.full((3, len(edges) - 1), np.nan)
    for k, (first, last) in enumerate(pairwise(edges.tolist())):
        within = [e[(t >= first * MINUTE) & (t < last * MINUTE) & np.isfinite(e)] for t, e in runs]
        there = [e for e in within if len(e)]
        if len(there) >= FEWEST:
            values[:, k] = np.quantile(np.concatenate(there), (0.05, 0.5, 0.95))
    if not np.isfinite(values).any():
        return None
    last = int(np.flatnonzero(np.isfinite(values[1]))[-1]) + 1
    minutes = 0.5 * (edges[:-1] + edges[1:])
    return Transitions(minutes=minutes[:last], low=values[0, :last], middle=values[1, :last],
                       high=values[2, :last], count=len(runs))  # fmt: skip


def transition_strip(one: Transitions, limit: float | None) -> Strip:
    """Median and 90 % of the errors over the time since a start or a stop."""
    return Strip(
        head="Model less measured, µm", height=150, zero=True,
        areas=[("s-band", one.minutes, one.low, one.high)],
        curves=[("window", one.minutes, one.middle)],
        levels=() if limit is None else (-limit, limit),
    )  # fmt: skip


def network_bands(document: Mapping[str, Any], sensors: int) -> Floats:
    """Centre and width [channels] of each band of a stored fuzzy-filtered network, shape (J, 2)."""
    places = np.asarray(document["state"]["places"], dtype=float)
    low, high = np.array([0.0, NARROWEST]), np.array([sensors - 1.0, float(sensors)])
    found: Floats = low + places[:, :2] * (high - low)
    return found[np.argsort(found[:, 0], kind="stable")]


def gaussian(at: Floats, bands: Floats) -> Floats:
    """Membership of places along the sensors in each band [1], shape (J, N)."""
    result: Floats = np.exp(-0.5 * ((at - bands[:, :1]) / bands[:, 1:2]) ** 2)
    return result


def network_strips(bands: Floats | None, weights: Floats) -> tuple[list[Strip], Axis]:
    """Bands (J, 2) of the network over the sensors, and the weight of each sensor in its group.

    ``weights`` (3, S) are those in front, middle and rear [1].
    """
    many = weights.shape[1]
    at = np.arange(1.0, many + 1.0)
    strips = []
    if bands is not None:
        dense = np.linspace(0.0, many - 1.0, 181)
        strips.append(Strip(
            head="Membership in the network’s bands", height=90, scale=(0.0, 1.05),
            curves=[(GROUP_CURVES[k % 3], dense + 1, values)
                    for k, values in enumerate(gaussian(dense, bands))],
        ))  # fmt: skip
    strips.append(Strip(
        head="Weight of each sensor in its group", height=90, scale=(0.0, 1.05),
        dots=[(f"s-{css}", at, row) for css, row in zip(GROUP_CURVES, weights, strict=True)],
    ))  # fmt: skip
    marks = [(float(k), str(int(k))) for k in at]
    return strips, Axis(words="Sensor, from front to rear", span=(0.5, many + 0.5), marks=marks)
