"""Spindle growth as a sub-model: cases are recordings of temperatures and a displacement probe."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import LeftOut, Model
from pipeline.schema.ranges import Positive
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Fact
from pipeline.signals.windows import row_period
from pipeline.submodels.cases import (
    Case,
    Cases,
    Records,
    conditions_of,
    held,
    role_of,
    sources,
)
from pipeline.submodels.conformal import (
    AdaptiveSettings,
    adaptive,
    interval,
)
from pipeline.submodels.contract import (
    Ends,
    Input,
    IntervalLimits,
    Prediction,
    Predictor,
    Sections,
    SeenInputs,
    SubModel,
    Target,
)
from pipeline.submodels.deformation.fit import FEWEST_PROFILES, columns_of, errors_of, fit_growth
from pipeline.submodels.deformation.methods import METHODS, SIMPLE
from pipeline.submodels.deformation.model import (
    KEPT,
    REGIMES,
    DeformationFitSettings,
    DeformationModel,
    GrowthModel,
    MethodsFile,
    Treatment,
    load_growth_model,
    treated,
)
from pipeline.submodels.deformation.records import (
    AMBIENT,
    GROWTH,
    SPEED,
    DeformationRecords,
    Profile,
    State,
    conditions_of_profile,
    read_profiles,
    state_of_table,
)
from pipeline.submodels.statistics import drawn_again

FOLLOWED = "growth, interval follows the probe"
"""The same prediction with the interval that adapts to readings of the probe."""


@dataclass(frozen=True, kw_only=True)
class DeformationLimits(IntervalLimits, section="deformation_limits"):
    """Limits on the error of growth on every recording that no method was fitted on."""

    max_um: Positive = 6.0
    rmse_um: Positive = 3.0
    """Largest error and RMSE in each regime of a recording [um]; FFNN2015 names 6 um on a range of
    50 um."""


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the fit reads."""

    deformation_records: DeformationRecords
    deformation_fit: DeformationFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Sections):
    """Sections of params.yaml that the judgement reads."""

    deformation_records: DeformationRecords
    deformation_limits: DeformationLimits


class Deformation(SubModel[Fitting, Judging, DeformationModel]):
    """Growth of the spindle from temperatures."""

    name: ClassVar[str] = "deformation"
    title: ClassVar[str] = "spindle growth"
    needs: ClassVar[str] = (
        "three temperatures or more along the spindle and a displacement probe at its nose, once a "
        "minute over ten speed profiles or more"
    )
    reads: ClassVar[tuple[str, ...]] = ("signals",)
    model: ClassVar[type] = DeformationModel
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = (
        Input(name="temperatures", unit="degC", older_than_s=0.0),
        Input(name=AMBIENT, unit="degC", older_than_s=0.0),
        Input(name=SPEED, unit="rev/min", older_than_s=0.0),
    )
    ends: ClassVar[Ends] = {(GROWTH, ""): ("low", "high")}

    def targets(self, settings: Judging, model: DeformationModel) -> tuple[Target, ...]:
        """Growth in all, growth by regime, and growth with the interval that follows the probe.

        Persistence is to be beaten by whichever method serves.  Intervals are judged as they are
        served, those that no probe moves and those that follow it.
        """
        limits = settings.deformation_limits
        others = tuple(name for name in model.compared if name != model.champion)
        beaten = tuple(name for name in SIMPLE if name in others)
        of_regime = {"max": limits.max_um, "rmse": limits.rmse_um}
        return (
            Target(
                quantity=GROWTH, unit="um", baselines=others,
                must_beat=beaten[:1] if model.champion in SIMPLE else beaten, widens=True,
                titles={name: METHODS[name].label for name in SIMPLE},
            ),
            *(
                Target(
                    quantity=GROWTH, unit="um", regime=regime, limits=of_regime, baselines=beaten,
                    coverage=limits.share, widens=True,
                )
                for regime in REGIMES
            ),
            *(
                Target(quantity=FOLLOWED, unit="um", regime=regime, coverage=limits.share,
                       widens=True)
                for regime in REGIMES
            ),
        )  # fmt: skip

    def cases(
        self, records: Records, settings: Fitting | Judging, sets: GoldenSets | None = None
    ) -> Cases:
        """Recordings of growth; ValueError when a pattern fits no file."""
        if records.signals is None:
            raise ValueError("recordings of growth stand in the signals: name them in reads")
        files, wanted = records.files, settings.deformation_records
        cases, left_out = [], []
        found = read_profiles(records.signals, wanted, settings.roles.is_training)
        for one in found:
            if one.profile is None:
                left_out.append(LeftOut(case=one.name, reason=one.reason))
                continue
            role = role_of([one.name], settings.roles, sets)
            conditions = {}
            if role != "sealed":
                conditions = conditions_of_profile(one.profile, speed=wanted.speed is not None)
            cases.append(
                Case(
                    name=one.name, group=one.name, role=role, files=sources(files, [one.name]),
                    load=held(one.profile), conditions=conditions,
                )
            )  # fmt: skip
        return Cases(cases=tuple(cases), left_out=tuple(left_out))

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> DeformationModel:
        """Every method fitted on the training recordings; the one that serves is named."""
        training = cases.of("training")
        if len(training) < FEWEST_PROFILES and cases.left_out:
            first, more = cases.left_out[0], len(cases.left_out) - 1
            others = f", and {more} more are of no use" if more else ""
            raise ValueError(
                f"{len(training)} training recordings of growth are of use, {FEWEST_PROFILES} are "
                f"the least; {first.case}: {first.reason}{others}"
            )
        head = Model(
            submodel=self.name,
            machine=settings.identity.name,
            origin=settings.identity.origin,
            parameters={},
            trained_on=tuple(case.training for case in training),
            left_out=cases.left_out,
            conditions=conditions_of(training),
        )
        model = fit_growth(
            head, [c.load() for c in training], settings.deformation_records,
            settings.deformation_fit,
        )  # fmt: skip
        documents = {
            name: tuple(one.document() for one in ensemble.members)
            for name, ensemble in model.ensembles.items()
        }
        write_json(MethodsFile(documents=documents), folder / "methods.json")
        return model.file

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of recordings."""
        model = load_growth_model(folder)
        return lambda case: _predicted(case.load(), model)

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Growth with its 90 % interval [um] from a table of temperatures since a start.

        The table has ``t`` [s], evenly spaced, a column [degC] for each sensor,
        ``spindle_speed`` [rev/min] and ``ambient_temperature`` [degC] as they were learnt; growth
        is that since its first row.  Where the table has the probe's readings as ``growth`` [um],
        the interval follows them.  Where there is no correction, the ``reason`` stands instead.
        """
        model = load_growth_model(folder)

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            state = _state(table, model.file)
            checked = model.checked(state)
            for one in checked.states:
                refuse_unlearnt(one, model.file)
            pieces = model.pieces(checked)
            growth = model.stitched(pieces).mean(axis=0)
            measured = table[GROWTH].to_numpy(float) if GROWTH in table else None
            low, high = _interval(model.file, state, growth, model.regimes(pieces), measured)
            reason = model.withheld(pieces, growth)
            found = pd.DataFrame({"growth": growth, "low": low, "high": high}, index=table.index)
            found.loc[reason != ""] = np.nan
            return found.assign(reason=reason.astype(str))

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """Ten minutes at the middle of what was learnt."""
        file = read_json(folder / "model.json", DeformationModel)
        t = file.sensors.period_s * np.arange(10.0)
        middle = {name: np.full(10, 0.5 * (one.low + one.high))
                  for name, one in file.learnt.items() if name in file.channels}  # fmt: skip
        return pd.DataFrame({"t": t, **middle})


def _interval(
    file: DeformationModel, state: State, growth: Floats, regime: Any, measured: Floats | None
) -> tuple[Floats, Floats]:
    """Low and high of the 90 % interval [um], (T,) each, following what the probe measured."""
    if measured is None:
        return interval(growth, regime, file.bands)
    following = AdaptiveSettings(step=file.adaptive_step, delay_s=file.probe_delay_s)
    return adaptive(state.time, measured, growth, regime, file.bands, following)


def _state(table: pd.DataFrame, file: DeformationModel) -> State:
    """State of a table; ValueError without a column or row, or with another row period."""
    period = row_period(table, learnt=file.sensors.period_s)
    return state_of_table(table, file.channels, period)


def refuse_unlearnt(state: State, file: DeformationModel) -> None:
    """Refuse a state beyond what was learnt.

    ValueError when a temperature or the speed lies beyond the learnt range by more than its
    declared widening; the message names the channel and the value.
    """
    for name, values in file.values(state).items():
        learnt = file.learnt.get(name)
        if learnt is None:
            continue
        low, high = learnt.accepted(file.widening)
        outside = (values < low) | (values > high)
        if outside.any():
            raise ValueError(
                f"{name} is {values[np.argmax(outside)]:.4g} {learnt.unit} in row "
                f"{int(np.argmax(outside)) + 1}, {learnt.low:.4g} to {learnt.high:.4g} "
                f"{learnt.unit} were learnt: record growth there"
            )


def _predicted(profile: Profile, model: GrowthModel) -> Prediction:
    """A recording by every method, with both intervals, and what a faulty sensor costs.

    Where there is no correction growth counts as unchanged, without an interval: what the machine
    then has.
    """
    file = model.file
    checked = model.checked(profile.state)
    pieces = model.pieces(checked)
    by_seed = {name: model.stitched(pieces, name) for name in model.ensembles}
    growth, regime = by_seed[file.champion].mean(axis=0), model.regimes(pieces)
    time, measured = profile.state.time, profile.growth
    columns: dict[str, Floats] = {}
    for name, values in by_seed.items():
        columns |= columns_of(name, values)
    reason = model.withheld(pieces, growth)
    given = reason == ""
    growth = np.where(given, growth, 0.0)
    drawn = drawn_again(by_seed[file.champion])
    again = {name: np.where(given, one, 0.0) for name, one in drawn.items()}
    ends = [_interval(file, profile.state, growth, regime, probe) for probe in (None, measured)]
    (low, high), (near, far) = np.where(given, np.array(ends), np.nan)
    whole = pd.DataFrame({
        "quantity": GROWTH, "unit": "um", "regime": "", "t": time, "measured": measured,
        "predicted": growth, "low": low, "high": high, **columns, **again,
    })  # fmt: skip
    followed = whole[["unit", "t", "measured", "predicted", *again]].assign(
        quantity=FOLLOWED, regime=regime, low=near, high=far
    )
    frame = pd.concat([whole, whole.assign(regime=regime), followed], ignore_index=True)
    facts = dict(_facts(profile, model, growth))
    if not given.all():
        facts["without correction"] = Fact(value=float(f"{100 * np.mean(~given):.3g}"), unit="%")
        facts["no correction because"] = Fact(value=str(reason[~given][0]))
    inputs = file.values(profile.state)
    seen = SeenInputs(quantity=GROWTH, t=time, measured=measured, inputs=inputs)
    return Prediction(frame=frame, facts=facts, seen=(seen,))


def _facts(profile: Profile, model: GrowthModel, growth: Floats) -> Mapping[str, Fact]:
    """Correlation, relative error, and each faulty sensor with the error that it would make."""
    whole = errors_of(growth, profile.growth)
    spread = float(np.nanmax(profile.growth) - np.nanmin(profile.growth))
    facts = {
        "R": Fact(value=whole.r, unit="1"),
        "MAPE, growth below 5 um as 5 um": Fact(value=whole.mape, unit="%"),
        "range of growth": Fact(value=float(f"{spread:.4g}"), unit="um"),
    }
    found = model.file.sensors.check(profile.state)
    for k, fault in enumerate(found.faults):
        name = "faulty sensor" if k == 0 else f"faulty sensor {k + 1}"
        facts[name] = Fact(value=fault.sentence)
    if found.faults:
        as_is = treated(model.file.sensors, profile.state, Treatment(chosen=KEPT))
        kept = errors_of(model.stitched(model.pieces(as_is)).mean(axis=0), profile.growth)
        for words, errors in (("with the faulty sensor", kept), ("with it replaced", whole)):
            facts[f"RMSE {words}"] = Fact(value=errors.rmse, unit="um")
            facts[f"largest error {words}"] = Fact(value=errors.largest, unit="um")
    return facts


SUBMODEL = Deformation()
