"""Spindle temperature as a sub-model: cases are days, judged in windows and as free runs."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import ClassVar

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.days import zone_of
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Correlation, Parameter
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Fact, widest
from pipeline.signals.windows import StateSegment, absent_items, read_state, state_days
from pipeline.submodels.cases import (
    Case,
    Cases,
    Records,
    conditions_of,
    files_of_day,
    role_of,
    sources,
)
from pipeline.submodels.contract import (
    TEMPERATURE_RISE,
    Ends,
    Input,
    Predictor,
    Sections,
    SubModel,
    Target,
)
from pipeline.submodels.spindle.calibration import (
    ForestSettings,
    Recipe,
    calibrated,
    days_left_out,
    examples,
    fitted_forest,
    forest_of,
)
from pipeline.submodels.spindle.days import (
    APART,
    BASELINE_TITLES,
    FREE_RUN,
    WINDOWS,
    IntervalSettings,
    SpindleLimits,
    predicted_day,
    with_interval,
)
from pipeline.submodels.spindle.fit import (
    LOGARITHMIC,
    Given,
    SpindleFit,
    SpindleFitSettings,
    is_determined,
    sensor_step,
)
from pipeline.submodels.spindle.structure import FEWEST_DAYS, identify_spindle_network
from pipeline.thermal.network import SOURCES
from pipeline.twin.spindle import (
    NODES,
    TARGET,
    SpindleFitFacts,
    SpindleModelFile,
    SpindleRecords,
    load_forest,
    load_spindle_model,
    save_forest,
    spindle_stretches,
)

METHOD = "bounded least squares (soft L1) on free runs over the training days"
REMEDY = {
    "bearing_friction": "record the spindle turning free at several speeds, 20 minutes each",
    "load_speed": "record cuts at several loads and speeds of some minutes each",
    "copper": "record heavy cuts of some minutes, or the motor's current",
    "windage": "record the spindle near its highest speed, 20 minutes",
    "position_hold": "record the spindle held in position (C axis) for 20 minutes",
}
"""Record that determines a heat source."""
AGAIN_DRAWN = 8
"""Forests of trees drawn with replacement that a day is predicted by again [1]."""
HELD_S = 1200.0
"""Time of the remedy of a spindle held in position [s]."""
RATE_REMEDY = "record warm-up and cooling of the spindle over several hours"


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the fit reads."""

    spindle: SpindleRecords
    spindle_fit: SpindleFitSettings
    residual_forest: ForestSettings
    spindle_interval: IntervalSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Sections):
    """Sections of params.yaml that the judgement reads."""

    spindle: SpindleRecords
    spindle_limits: SpindleLimits


class Spindle(SubModel[Fitting, Judging, SpindleModelFile]):
    """Temperature of the main spindle over a day."""

    name: ClassVar[str] = "spindle"
    title: ClassVar[str] = "spindle temperature"
    needs: ClassVar[str] = "speed, load and temperature of the spindle over a working week"
    reads: ClassVar[tuple[str, ...]] = ("manifest", "clean")
    model: ClassVar[type] = SpindleModelFile
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = (
        Input(name="spindle_speed", unit="rev/min"),
        Input(name="spindle_load", unit="%"),
        Input(name=TARGET, unit="degC", older_than_s=0.0),
    )
    shared: ClassVar[str] = ".*"
    unlike: ClassVar[str] = "its network has another number of nodes"
    ends: ClassVar[Ends] = {(TARGET, FREE_RUN): ("low", "high")}

    def targets(self, settings: Judging, model: SpindleModelFile) -> tuple[Target, ...]:
        """Temperature in windows, which is judged, as a free run and in parts, which are shown."""
        limits = settings.spindle_limits
        others = tuple(BASELINE_TITLES)
        coverage = None if model.intervals is None else limits.share
        return (
            Target(
                quantity=TARGET, unit="K", regime=WINDOWS, baselines=others,
                limits={"mae": limits.mae_K, "rmse": limits.rmse_K},
                must_beat=("persistence",), each_group=True, coverage=coverage,
                titles=BASELINE_TITLES,
                resolution=model.fit.resolution_K,
            ),
            Target(
                quantity=TARGET, unit="K", regime=FREE_RUN, baselines=others, coverage=coverage
            ),
            *(Target(quantity=TARGET, unit="K", regime=one, baselines=others) for one in APART),
        )  # fmt: skip

    def cases(
        self, records: Records, settings: Fitting | Judging, sets: GoldenSets | None = None
    ) -> Cases:
        """Days of the clean state table."""
        clean, files = records.clean, records.files
        if clean is None:
            raise ValueError("the spindle's days stand in the clean records: name them in reads")
        zone, cases = zone_of(clean), []
        _check_zone_of_sets(sets, zone)
        for day in state_days(clean):
            raw = files_of_day(files, day, zone)
            role = role_of(raw, settings.roles, sets, day)
            load = partial(read_state, clean, day)
            if role == "sealed" and not load()[TARGET].notna().any():
                continue  # sealed by a file of something else that was recorded on that day
            conditions = {} if role == "sealed" else _conditions(load(), settings.spindle)
            cases.append(
                Case(
                    name=day, group=day, role=role, files=sources(files, raw), load=load,
                    conditions=conditions,
                )
            )  # fmt: skip
        return Cases(cases=tuple(cases), absent=absent_items(clean))

    def alike(self, model: SpindleModelFile) -> tuple[int]:
        """Nodes of the network: a rate of one node is not one of two."""
        return (model.fit.nodes,)

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> SpindleModelFile:
        """Thermal network of the training days, and the forest on its residual."""
        training, fitting = cases.of("training"), settings.spindle_fit
        pieces = pieces_of(training, settings.spindle, fitting)
        if not pieces:
            raise ValueError(no_stretch(training, cases, settings))
        fit, scores = identify_spindle_network(Given(pieces, settings.spindle, fitting))
        records = replace(settings.spindle, coolant=fit.parameters.coolant_rate > 0)
        data = examples(pieces, records, fit.parameters, settings.residual_forest)
        save_forest(fitted_forest(data, settings.residual_forest), folder / "residual")
        used = sorted({piece.day for piece in pieces})
        recipe = Recipe(records, fitting, settings.residual_forest, fit.parameters)
        days = days_left_out(training, pieces, recipe, settings.spindle_interval)
        forest = forest_of(days, used, data, records)
        intervals = calibrated(
            days, settings.spindle_interval, fitting.window_s, forest_used=forest.used
        )
        trained = [case for case in training if case.name in used]
        return SpindleModelFile(
            submodel=self.name,
            machine=settings.identity.name,
            origin=settings.identity.origin,
            parameters={"": {**_parameters(fit), **_undetermined(fit, settings.spindle, pieces)}},
            trained_on=tuple(case.training for case in trained),
            conditions=conditions_of(trained),
            network=fit.parameters,
            records=records,
            fit=_facts(fit, scores, pieces, fitting),
            training_days=tuple(used),
            forest=forest,
            intervals=intervals,
        )

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of days."""
        model, limits = load_spindle_model(folder, AGAIN_DRAWN), settings.spindle_limits
        stored = read_json(folder / "model.json", SpindleModelFile)
        tried = None
        if not stored.forest.used and (folder / "residual" / NODES).exists():
            forest = load_forest(folder / "residual", replace(stored.forest, used=True))
            tried = replace(model, forest=forest)
        return lambda case: predicted_day(model, case, limits, stored.intervals, tried)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Temperatures from a clean state table: column ``time``, then those that the model needs.

        Of ``spindle_temperature`` only the first row is read, the temperature to start from.  Where
        training days left out calibrated one, ``low`` and ``high`` are the 90 % interval, wider
        beyond the speeds and loads of the training days.
        """
        model = load_spindle_model(folder)
        stored = read_json(folder / "model.json", SpindleModelFile)
        how = stored.intervals

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            for name in ("time", TARGET):
                if name not in table.columns:
                    raise ValueError(f"the input has no column {name}: give the clean state table")
            start = float(table[TARGET].iloc[0]) if len(table) else float("nan")
            if pd.isna(start):
                raise ValueError(
                    f"{TARGET} is not known in the first row: start where it was measured"
                )
            state = table.assign(
                time=pd.to_datetime(table["time"], utc=True, format="ISO8601")
            ).set_index("time")
            found = model.predict(state, start).reset_index(names="time")
            if how is None:
                return found
            factor = widest(_conditions(state, model.records), stored.conditions)
            return with_interval(found, model.step_s, how, factor)

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """An hour of a spindle that turns at one speed."""
        model = load_spindle_model(folder)
        names = [*model.records.signals, *(model.forest.extra if model.forest else ())]
        time = pd.date_range("2026-01-05T08:00", periods=60, freq="min", tz="UTC")
        values = dict.fromkeys(names, 0.0) | {"spindle_speed": 3000.0, "spindle_load": 20.0}
        if "ambient_temperature" in values:
            values["ambient_temperature"] = 20.0
        if "coolant_temperature" in values:
            values["coolant_temperature"] = 22.0
        return pd.DataFrame({"time": time, **values, TARGET: 22.0})

    def influences(self, case: Case, rows: pd.DataFrame) -> dict[str, Floats]:
        """Predicted temperature above the air, above the lowest where the air is not recorded."""
        state, predicted = case.load(), rows["predicted"].to_numpy(float)
        air = np.full(len(rows), np.nanmin(predicted))
        if "ambient_temperature" in state and state["ambient_temperature"].notna().any():
            known = state["ambient_temperature"].dropna()
            midnight = pd.DatetimeIndex(known.index)[0].normalize()
            seconds = (pd.DatetimeIndex(known.index) - midnight).total_seconds()
            air = np.interp(rows["t"], np.asarray(seconds, float), known.to_numpy(float))
        return {TEMPERATURE_RISE: predicted - air}


def pieces_of(
    cases: Iterable[Case], records: SpindleRecords, fitting: SpindleFitSettings, *,
    bridge_s: float | None = None,
) -> list[StateSegment]:  # fmt: skip
    """Stretches of some days for the network, over gaps as in its fit or of ``bridge_s`` [s]."""
    return [
        piece
        for case in cases
        for piece in spindle_stretches(
            case.load(),
            case.name,
            records,
            step=fitting.step_s,
            bridge_s=fitting.bridge_s if bridge_s is None else bridge_s,
            shortest_s=fitting.shortest_s,
        )
    ]


def no_stretch(training: Sequence[Case], cases: Cases, settings: Fitting) -> str:
    """Why no training day has a stretch to learn from, and what to do, in one sentence."""
    start = (
        f"no stretch of at least {settings.spindle_fit.shortest_s:g} s with "
        f"{', '.join((*settings.spindle.signals, TARGET))} on the training days"
    )
    days = sorted(case.name for case in cases.cases)
    if not training:
        there = f"{days[0]} to {days[-1]}" if days else "no day at all"
        return (
            f"{start}: roles names none of the days that there are ({there}, {len(days)} in all); "
            "name some in roles.training_days"
        )
    tables = [case.load() for case in training]
    without = [
        name
        for name in (*settings.spindle.signals, TARGET)
        if not any(name in table.columns and table[name].notna().any() for table in tables)
    ]
    if without:
        named = " and ".join(
            f"{item}, did you mean {' or '.join(like)}?" if like else item
            for item, like in cases.absent.items()
        )
        absent = f" (no record has {named})" if named else ""
        return (
            f"{start}: {', '.join(without)} has no value on any of them; correct its data item "
            f"under mapping.signals{absent}, `kerf records --machine {settings.identity.name}` "
            "lists what there is, or record it"
        )
    return (
        f"{start}: each has a value, never all of them for so long; record a working day, or name "
        f"other days of {days[0]} to {days[-1]} in roles.training_days"
    )


def _check_zone_of_sets(sets: GoldenSets | None, zone: str) -> None:
    """Raise ValueError where days were frozen by another clock than the records are cut by."""
    if sets is None:
        return
    for frozen in (sets.golden, sets.sealed):
        if frozen is not None and frozen.days is not None and frozen.time_zone != zone:
            raise ValueError(
                f"the frozen days {frozen.days.first} to {frozen.days.last} of {sets.machine} are "
                f"those of {frozen.time_zone}, its records are cut by {zone}: freeze them again "
                f"with `kerf golden --machine {sets.machine}`"
            )


def _conditions(state: pd.DataFrame, records: SpindleRecords) -> dict[str, Fact]:
    """Highest speed and load of a day; a signal that the day does not have is no condition."""
    found = {}
    for name, unit in (("spindle_speed", "rev/min"), ("spindle_load", "%")):
        if name in state.columns and state[name].notna().any():
            found[f"highest {name}"] = Fact(value=float(state[name].max()), unit=unit)
    return found


def _parameters(fit: SpindleFit) -> dict[str, Parameter]:
    units = {"capacity_ratio": "1", "ambient": "CELSIUS", "ambient_offset": "K"}
    found = {}
    for i, name in enumerate(fit.names):
        value, width = float(fit.values[i]), min(float(fit.uncertainty.half_width[i]), 50.0)
        if name in LOGARITHMIC:
            low, high, value = np.exp([value - width, value + width, value]).tolist()
        elif name in SOURCES:
            (low, high), value = fit.intervals[name], fit.parameters.heating[name]
        else:
            low, high = value - width, value + width
        unit = SOURCES.get(name, units.get(name, "1/s"))
        known = is_determined(fit, name) and not (name in SOURCES and low <= 0 <= high)
        why = (
            f"its 95 % interval {low:.2g} to {high:.2g} {unit} includes 0 over the networks "
            f"that the records bear as well ({', '.join(fit.in_doubt)})"
            if name in SOURCES
            else "at a bound or with a 95 % interval wider than the model bears, "
            f"{low:.2g} to {high:.2g}"
        )
        found[name] = Parameter(
            value=float(f"{value:.5g}") if known else None, unit=unit, determined=known,
            interval_95=(float(f"{low:.4g}"), float(f"{high:.4g}")) if known else None,
            method=METHOD if known else why,
            remedy="" if known else REMEDY.get(name, RATE_REMEDY),
        )  # fmt: skip
    return found


def _undetermined(
    fit: SpindleFit, records: SpindleRecords, pieces: Sequence[StateSegment]
) -> dict[str, Parameter]:
    """The heat sources that the records do not determine, with what to record."""
    held = {
        day: sum(float(p.frame["position_hold"].sum()) * p.step for p in pieces if p.day == day)
        for day in sorted({p.day for p in pieces})
    }
    held_s, days = sum(held.values()), sum(seconds > 0 for seconds in held.values())

    def remedy(name: str) -> str:
        on = len({p.day for p in pieces if name in p.frame and (p.frame[name] > 0).any()})
        if name in fit.unfollowed and on >= FEWEST_DAYS:
            return (
                "no further recording helps: heat that comes with it is in the records, and none "
                "of the networks reproduces it"
            )
        if name in fit.unfollowed:
            return (
                f"{REMEDY[name]}, an hour in all, on {FEWEST_DAYS - on} more days: heat that comes "
                f"with it is in the records, and {on} of {len(held)} days do not say which network "
                "reproduces it"
            )
        if name == "position_hold" and held_s >= HELD_S:
            return (
                f"record the spindle held on another day: {held_s / 60:.0f} minutes on {days} of "
                f"{len(held)} days do not tell its heat from the rest"
            )
        return REMEDY[name]

    return {
        name: Parameter(
            value=None, unit=SOURCES[name], interval_95=None, determined=False, method=why,
            remedy=remedy(name),
        )
        for name, why in fit.left_out.items()
        if name in records.sources
    }  # fmt: skip


def _facts(
    fit: SpindleFit,
    scores: dict[str, float],
    pieces: Sequence[StateSegment],
    settings: SpindleFitSettings,
) -> SpindleFitFacts:
    correlation: list[list[float]] = np.round(fit.uncertainty.correlation, 3).tolist()
    return SpindleFitFacts(
        step_s=settings.step_s,
        nodes=fit.parameters.nodes,
        rmse_K=round(fit.rmse_K, 4),
        rmse_days_left_out_K={n: round(s, 4) for n, s in scores.items()},
        condition=round(fit.uncertainty.condition, 3)
        if np.isfinite(fit.uncertainty.condition)
        else None,
        correlation=Correlation(names=fit.names, values=tuple(map(tuple, correlation))),
        evaluations=fit.evaluations,
        seconds=round(sum(len(p.frame) * p.step for p in pieces)),
        bridged_s=round(sum(p.bridged * p.step for p in pieces)),
        in_doubt=fit.in_doubt,
        resolution_K=sensor_step(np.concatenate([p.frame[TARGET].to_numpy(float) for p in pieces])),
    )


SUBMODEL = Spindle()
