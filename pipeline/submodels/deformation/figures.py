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

from pipeline.charts.bands import Axis, Strip, axis, band, readings, strips_figure
from pipeline.charts.numbers import TOGETHER, counted, fixed, instant, joined, moment
from pipeline.charts.sections import Figure, Figures
from pipeline.charts.submodel_page import made_from
from pipeline.nets.settings import FuzzyFilteredSettings
from pipeline.schema.arrays import Floats
from pipeline.schema.si import HOUR, MINUTE
from pipeline.schema.verdict import Verdict
from pipeline.signals.store import parquet_name
from pipeline.submodels.contract import Shown
from pipeline.submodels.deformation.model import COOLING, WARMING, DeformationModel, MethodsFile
from pipeline.submodels.deformation.records import AMBIENT, GROWTH, SPEED

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
        return "an unknown date" if start is None else moment(start + timedelta(minutes=minute))

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
        cases = (
            [] if verdict is None else [c for c in verdict.cases if c.role == verdict.judged_role]
        )
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


def network_bands(document: Mapping[str, Any], sensors: int) -> Floats:
    """Centre and width [channels] of each band of a stored fuzzy-filtered network, shape (J, 2)."""
    places = np.asarray(document["state"]["places"], dtype=float)
    low, high = np.array([0.0, NARROWEST]), np.array([sensors - 1.0, float(sensors)])
    found: Floats = low + places[:, :2] * (high - low)
    return found[np.argsort(found[:, 0], kind="stable")]


def gaussian(at: Floats, bands: Floats) -> Floats:
    """Membership of places along the sensors in each band [1], shape (J, N)."""
    return np.exp(-0.5 * ((at - bands[:, :1]) / bands[:, 1:2]) ** 2)


def _network_strips(bands: Floats | None, weights: Floats) -> tuple[list[Strip], Axis]:
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


def um(value: float, decimals: int = 0) -> str:
    """A length with its unit."""
    return f"{fixed(value, decimals)}{TOGETHER}µm"


def network_figures(shown: Seen, model: DeformationModel) -> Figures:
    """Bands of the best improved network over the sensors, and the groups of sensors."""
    path = shown.folder / "methods.json"
    stored = None if shown.shelf is None else shown.shelf.read(path, MethodsFile, "the training")
    weights = np.array(model.inputs.weights)
    improved = [] if stored is None else [
        (model.compared[name].rmse_um, name) for name, found in stored.documents.items()
        if found and found[0].get("kind") == FuzzyFilteredSettings.kind and name in model.compared
    ]  # fmt: skip
    bands, words = None, "Weight of each sensor in front, middle and rear (fuzzy c-means)"
    if stored is not None and improved:
        name = min(improved)[1]
        bands = network_bands(stored.documents[name][0], weights.shape[1])
        centres = joined([fixed(c + 1, 1) for c, _ in bands])
        words = (
            f"Above: bands of “{model.compared[name].label}” (first seed) over the sensors, "
            f"centred at sensor {centres}. Below: weight of each sensor in front, middle and rear "
            "(fuzzy c-means)"
        )
    names = "; ".join(f"{k + 1} {name}" for k, name in enumerate(model.sensors.sensors))
    caption = f"{words}. Sensors: {names}."
    strips, below = _network_strips(bands, weights)
    figure = Figure(svg=strips_figure(strips, below, caption), caption=caption,
                    sources=made_from(shown, "model.json", "methods.json"))  # fmt: skip
    legend = [(f"s-{css}", name, "box") for css, name in
              zip(GROUP_CURVES, GROUP_NAMES, strict=True)]  # fmt: skip
    return Figures(figures=[figure], legend=legend, kind="one",
                   folded="How the sensors are grouped, and what the network looks at")  # fmt: skip


def transition_figures(facts: GrowthFacts) -> Figures | None:
    """Errors over the time since the spindle began to warm, and since it began to cool."""
    drawn = []
    for regime, verb, began in ((WARMING, "start or a higher speed", "to warm"),
                                (COOLING, "stop or a lower speed", "to cool")):  # fmt: skip
        one = transitions(facts.runs(regime))
        if one is None:
            continue
        caption = (
            f"After a {verb}: error of the model since the spindle began {began}, over "
            f"{counted(one.count, 'time')}; 90 % of the samples lie within {um(one.widest, 1)}."
        )
        below = axis("Time, min", (0.0, float(one.minutes[-1]) + BIN_MIN / 2))
        strip = Strip(
            head="Model less measured, µm", height=150, zero=True,
            areas=[("s-band", one.minutes, one.low, one.high)],
            curves=[("window", one.minutes, one.middle)],
            levels=() if facts.limit is None else (-facts.limit, facts.limit),
        )  # fmt: skip
        drawn.append(Figure(svg=strips_figure([strip], below, caption), caption=caption,
                            sources=made_from(facts.shown, "predictions.parquet")))  # fmt: skip
    legend = [("l-window", "median", "line"), ("s-band", "90 % of the samples", "box")]
    return Figures(figures=drawn, legend=legend) if drawn else None


def signal_legend(facts: GrowthFacts) -> list[tuple[str, str, str]]:
    """Legend of a recording's signals."""
    groups = [(f"l-{css}", f"sensors, {name}", "line") for css, name in
              zip(GROUP_CURVES, GROUP_NAMES, strict=True)]  # fmt: skip
    faulty = [("l-batch", "faulty sensor", "dots")] if facts.faults else []
    return [*groups, ("l-speed", "air, spindle speed", "line"), *faulty]


def signal_strips(facts: GrowthFacts, case: str) -> list[Strip]:
    """Temperatures and speed of a recording; none where its signals are not there."""
    shown = facts.shown
    if shown.signals is None or shown.model is None or shown.shelf is None:
        return []
    names = shown.model.sensors.sensors
    path = shown.signals / "traces" / parquet_name(case)
    table = shown.shelf.table(path, ("t", *names, AMBIENT, SPEED), "raw files, by reading",
                              all_of=False)  # fmt: skip
    if table is None or "t" not in table.column_names:
        return []
    columns = {name: readings(table.column(name).to_numpy().astype(float))
               for name in table.column_names}  # fmt: skip
    minutes = (columns["t"] - columns["t"][0]) / MINUTE
    faulty = {one.sensor for one in facts.faults if one.case <= case}
    group = np.array(shown.model.inputs.weights).argmax(axis=0)
    curves = [("batch" if name in faulty else GROUP_CURVES[k], minutes, columns[name])
              for k, name in zip(group, names, strict=True) if name in columns]  # fmt: skip
    if AMBIENT in columns:
        curves.append(("speed", minutes, columns[AMBIENT]))
    sound = band(0, 1, *(y for css, _, y in curves if css != "batch"))
    strips = [Strip(head="Temperatures, °C", height=120, curves=curves, unit="°C",
                    scale=(sound.low, sound.high))]  # fmt: skip
    if SPEED in columns:
        strips.append(Strip(head="Spindle speed, rev/min", height=44, zero=True,
                            curves=[("speed", minutes, columns[SPEED])]))  # fmt: skip
    return strips
