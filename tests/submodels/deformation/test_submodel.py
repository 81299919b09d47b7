"""Spindle growth on the contract: roles, leaks, the verdict, serving, refusals, determinism."""

import shutil
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.nets.settings import TrainingSettings
from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.identify import identify, judge
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.deformation import fit
from pipeline.submodels.deformation.methods import METHODS
from pipeline.submodels.deformation.model import (
    REGIMES,
    REPLACED,
    DeformationFitSettings,
    DeformationModel,
    GrowthModel,
    Learnt,
    TrainingFault,
    load_growth_model,
)
from pipeline.submodels.deformation.records import GROWTH
from pipeline.submodels.deformation.submodel import (
    FOLLOWED,
    SUBMODEL,
    DeformationLimits,
    Fitting,
    Judging,
)
from tests.submodels.deformation.growth_files import (
    IDENTITY,
    NAMES,
    RECORDS,
    Made,
    digest,
    made,
    signals_of,
)

TRAINING = [f"p{k:02d}" for k in range(8)]
HELD_OUT = [f"p{k:02d}" for k in range(8, 12)]
ROLES = Roles(training=tuple(f"growth/{name}.csv" for name in TRAINING))
QUICK = DeformationFitSettings(
    folds=2, seeds=2, seeds_left_out=1, later_starts=(1,), compute="serial",
    training=TrainingSettings(passes=20, patience=20),
    methods=("persistence", "linear", "linear_sensors", "expansion", "bp_7", "ffnn_projection"),
)  # fmt: skip


@cache
def _recordings() -> dict[str, Made]:
    names = enumerate([*TRAINING, *HELD_OUT])
    return {name: made(k, warm=k % 4 == 3, air=18.0 + k % 5) for k, name in names}


def recordings() -> dict[str, Made]:
    """Twelve recordings, to be changed."""
    return deepcopy(_recordings())


@dataclass(frozen=True)
class Built:
    signals: Path
    folder: Path
    model: DeformationModel
    verdict: Verdict
    predictions: pd.DataFrame


def build(folder: Path, found: dict[str, Made], settings: DeformationFitSettings = QUICK) -> Built:
    signals, out = signals_of(folder, found), folder / "model"
    fitting = Fitting(
        identity=IDENTITY, roles=ROLES, deformation_records=RECORDS, deformation_fit=settings
    )
    judging = Judging(
        identity=IDENTITY, roles=ROLES, deformation_records=RECORDS,
        deformation_limits=DeformationLimits(),
    )  # fmt: skip
    identify(SUBMODEL, {"signals": signals}, out, settings=fitting)
    (folder / "golden").mkdir(exist_ok=True)
    judge(
        SUBMODEL, {"signals": signals}, out, folder / "golden", folder / "metrics.json",
        folder / "plots", settings=judging,
    )  # fmt: skip
    return Built(
        signals, out, read_json(out / "model.json", DeformationModel),
        read_json(out / "verdict.json", Verdict), pd.read_parquet(out / "predictions.parquet"),
    )  # fmt: skip


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    found = recordings()
    dead, drifting = found["p09"], found["p10"]
    dead.temperatures[40:, 1] = 850.0
    drifting.temperatures[:, 3] += 0.05 * np.arange(120)
    return build(tmp_path_factory.mktemp("growth"), found)


def test_the_model_that_serves_has_the_least_error_on_recordings_left_out(built):
    errors = {name: one.rmse_um for name, one in built.model.compared.items()}
    assert built.model.champion == min(errors, key=lambda name: errors[name])
    assert errors[built.model.champion] < 0.3 * errors["persistence"]
    assert set(errors) == set(QUICK.methods)


def test_the_fit_does_not_change_when_held_out_recordings_do(built, tmp_path):
    found = recordings()
    other = {name: made(100 + k) if name in HELD_OUT else one
             for k, (name, one) in enumerate(found.items())}  # fmt: skip
    again = build(tmp_path, other)
    for file in ("model.json", "methods.json"):
        assert digest(again.folder / file) == digest(built.folder / file)


def test_growth_is_predicted_on_recordings_that_were_held_out(built):
    total = built.verdict.total(GROWTH)
    assert total is not None and total.rmse is not None
    assert total.role == "held_out" and total.rmse < 1.0
    assert total.baselines["persistence"].rmse is not None
    assert total.baselines["persistence"].rmse > 5 * total.rmse


def test_every_method_is_in_one_table_with_its_seeds(built):
    table = built.model.compared
    assert {name: one.seeds for name, one in table.items()} == {
        name: QUICK.seeds_left_out if METHODS[name].seeded else 1 for name in QUICK.methods
    }
    total = built.verdict.total(GROWTH)
    assert total is not None
    assert {*total.baselines, built.model.champion} >= table.keys()
    low, high = table["ffnn_projection"].seed_rmse_um
    assert 0 < low <= high


def test_faulty_sensors_are_named_with_the_error_they_would_make(built):
    facts = {one.case: one.facts for one in built.verdict.cases}
    dead, drifting = facts["growth/p09.csv"], facts["growth/p10.csv"]
    assert "temperature_2 is dead" in str(dead["faulty sensor"].value)
    assert "temperature_4 is drifting" in str(drifting["faulty sensor"].value)
    for one in (dead, drifting):
        without, treated = one["RMSE with the faulty sensor"], one["RMSE with it replaced"]
        assert float(without.value or 0) > float(treated.value or 0)
    assert float(dead["RMSE with it replaced"].value or np.inf) < 1.5
    assert "faulty sensor" not in facts["growth/p08.csv"]


def test_all_regimes_have_intervals_and_those_that_follow_the_probe(built):
    frame = built.predictions
    assert set(frame["regime"]) == {"", *REGIMES}
    followed = frame[frame["quantity"] == FOLLOWED]
    fixed = frame[(frame["quantity"] == GROWTH) & (frame["regime"] != "")]
    assert len(followed) == len(fixed)
    for part in (followed, fixed):
        assert (part["low"] < part["predicted"]).all() and (part["predicted"] < part["high"]).all()


def table_of(one: Made, rows: int = 120) -> pd.DataFrame:
    columns = {"t": 60.0 * np.arange(rows), "spindle_speed": one.speed[:rows]}
    columns |= {name: one.temperatures[:rows, k] for k, name in enumerate(NAMES)}
    return pd.DataFrame(columns | {"ambient_temperature": one.ambient[:rows]})


@pytest.mark.parametrize("rows", [120, 30])
def test_serving_gives_what_was_judged_and_needs_nothing_later(built, rows):
    found = SUBMODEL.serve(built.folder)(table_of(recordings()["p08"], rows))
    frame = built.predictions
    judged = frame[
        (frame["case"] == "growth/p08.csv") & (frame["quantity"] == GROWTH)
        & (frame["regime"] == "")
    ]  # fmt: skip
    assert found["growth"].to_numpy() == pytest.approx(
        judged["predicted"].to_numpy()[:rows], abs=1e-6
    )
    assert (found["low"] < found["growth"]).all() and (found["growth"] < found["high"]).all()


@pytest.mark.parametrize(("probe", "quantity"), [(False, GROWTH), (True, FOLLOWED)])
def test_the_served_interval_is_the_judged_one(built, probe, quantity):
    one, frame = recordings()["p08"], built.predictions
    table = table_of(one).assign(**({"growth": one.growth} if probe else {}))
    served = SUBMODEL.serve(built.folder)(table)
    judged = frame[
        (frame["case"] == "growth/p08.csv") & (frame["quantity"] == quantity)
        & ((frame["regime"] == "") | probe)
    ].sort_values("t")  # fmt: skip
    for end in ("low", "high"):
        assert served[end].to_numpy() == pytest.approx(judged[end].to_numpy(), abs=1e-6)
    decided = {one.quantity for one in built.verdict.scores if one.coverage_limits}
    assert quantity in decided


def withheld(built: Built, **changed: Any) -> tuple[np.ndarray, np.ndarray]:
    """Growth and reasons of a recording under a changed model."""
    model = load_growth_model(built.folder)
    model = GrowthModel(replace(model.file, **changed), model.ensembles)
    case = SUBMODEL.cases(Records(signals=built.signals), fitting_settings()).of("held_out")[0]
    pieces = model.pieces(model.checked(case.load().state))
    growth = model.stitched(pieces).mean(axis=0)
    return growth, model.withheld(pieces, growth)


def test_growth_beyond_that_of_training_is_no_correction(built):
    learnt = {**built.model.learnt, GROWTH: Learnt(low=-4.0, high=8.0, unit="um")}
    growth, reason = withheld(built, learnt=learnt, widening=0.25)
    assert ((reason != "") == ((growth > 11.0) | (growth < -7.0))).all()
    assert (reason != "").any() and "-7 to 11 um was not learnt" in reason[reason != ""][0]


def test_two_methods_that_disagree_are_no_correction(built):
    assert set(withheld(built)[1]) == {""}
    growth, reason = withheld(built, second="persistence", agreement_um=3.0)
    assert ((reason != "") == (np.abs(growth) > 3.0)).all()  # half of the growth is always less
    assert "differ by more than 3 um" in reason[reason != ""][0]


def test_where_there_is_no_correction_it_is_served_and_judged_so(built, tmp_path):
    shutil.copytree(built.folder, tmp_path / "model")
    file = read_json(tmp_path / "model/model.json", DeformationModel)
    write_json(replace(file, second="persistence", agreement_um=3.0), tmp_path / "model/model.json")
    served = SUBMODEL.serve(tmp_path / "model")(table_of(recordings()["p08"]))
    none = (served["reason"] != "").to_numpy()
    assert none.any() and served.loc[none, ["growth", "low", "high"]].isna().all(axis=None)
    case = SUBMODEL.cases(Records(signals=built.signals), fitting_settings()).of("held_out")[0]
    frame = SUBMODEL.load(tmp_path / "model", judging_settings())(case)
    rows = frame.frame[(frame.frame["quantity"] == GROWTH) & (frame.frame["regime"] == "")]
    assert (rows["predicted"].to_numpy()[none] == 0).all() and rows["low"].isna()[none].all()
    assert frame.facts["without correction"].value == pytest.approx(100 * none.mean(), rel=1e-2)


@pytest.mark.parametrize("champion", ["linear", "expansion"])
def test_persistence_is_to_be_beaten_first_whichever_method_serves(built, champion):
    first = SUBMODEL.targets(judging_settings(), replace(built.model, champion=champion))[0]
    assert first.must_beat[0] == "persistence"


def test_what_is_faulty_never_serves_whatever_training_says(built, monkeypatch):
    errors = iter([2.0, 3.0, 1.0])  # replaced, left out, kept
    monkeypatch.setattr(fit, "_linear_left_out", lambda x, growth: next(errors))
    cases = SUBMODEL.cases(Records(signals=built.signals), fitting_settings()).of("held_out")
    profiles = [case.load() for case in cases]
    model = built.model.sensors
    faults = [TrainingFault(case=one.name, fault=fault) for one in profiles
              for fault in model.check(one.state).faults]  # fmt: skip
    chosen = fit._treatment(profiles, model, faults, (600.0,))
    assert chosen.chosen == REPLACED and chosen.rmse_um["kept"] == 1.0


def test_the_example_is_served(built):
    table = SUBMODEL.example(built.folder)
    found = SUBMODEL.serve(built.folder)(table)
    assert len(found) == len(table) and set(found.pop("reason")) == {""}
    assert np.isfinite(found.to_numpy()).all()


def test_what_was_not_learnt_is_refused_by_name_and_value(built):
    serve, table = SUBMODEL.serve(built.folder), table_of(recordings()["p08"])
    hot = table.assign(**{name: table[name] + 40.0 for name in NAMES})
    with pytest.raises(ValueError, match=r"temperature_1 is [\d.]+ degC in row \d+, .* learnt"):
        serve(hot.assign(ambient_temperature=table["ambient_temperature"] + 40.0))
    with pytest.raises(ValueError, match=r"spindle_speed is 2\.4e\+04 rev/min"):
        serve(table.assign(spindle_speed=24000.0))
    with pytest.raises(ValueError, match="no column temperature_3: give temperature_1"):
        serve(table.drop(columns="temperature_3"))
    with pytest.raises(ValueError, match="120 s apart, 60 s were learnt"):
        serve(table.iloc[::2])


def test_a_dead_sensor_is_no_reason_to_refuse(built):
    one = recordings()["p08"]
    one.temperatures[:, 1] = 850.0
    found = SUBMODEL.serve(built.folder)(table_of(one))["growth"].to_numpy()
    assert found == pytest.approx(one.growth, abs=6.0)


def fitting_settings() -> Any:
    return Fitting(
        identity=IDENTITY, roles=ROLES, deformation_records=RECORDS, deformation_fit=QUICK
    )


def judging_settings() -> Judging:
    return Judging(
        identity=IDENTITY, roles=ROLES, deformation_records=RECORDS,
        deformation_limits=DeformationLimits(),
    )  # fmt: skip


@pytest.mark.proof
def test_processes_find_the_same_model(built, tmp_path):
    some = replace(QUICK, methods=("linear", "bp_7"))
    found = {name: one for name, one in recordings().items() if name in TRAINING}
    serial = build(tmp_path / "a", found, some)
    beside = build(tmp_path / "b", found, replace(some, compute="processes"))
    assert digest(serial.folder / "methods.json") == digest(beside.folder / "methods.json")


def test_a_method_that_does_not_exist_is_refused(tmp_path):
    with pytest.raises(ValueError, match="names 'forest': with the channels recorded choose among"):
        build(tmp_path, recordings(), replace(QUICK, methods=("forest",)))


def test_too_few_training_recordings_are_refused(tmp_path):
    some = {name: one for name, one in recordings().items() if name in TRAINING[:2]}
    with pytest.raises(ValueError, match="2 training recordings of growth are of use, 4 are"):
        build(tmp_path, some)
