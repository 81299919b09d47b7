"""Spindle growth on the contract: roles, leaks, the verdict, serving, refusals, determinism."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from pipeline.nets.settings import TrainingSettings
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.identify import identify, judge
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.deformation.comparison import GROWTH, methods_table
from pipeline.submodels.deformation.methods import METHODS
from pipeline.submodels.deformation.model import (
    REGIMES,
    DeformationFitSettings,
    DeformationModel,
    load_growth_model,
)
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


def recordings() -> dict[str, Made]:
    return {
        name: made(k, warm=k % 4 == 3, air=18.0 + k % 5)
        for k, name in enumerate([*TRAINING, *HELD_OUT])
    }


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


def test_the_model_that_serves_has_the_least_error_on_recordings_left_out(built: Built) -> None:
    errors = {name: one.rmse_um for name, one in built.model.compared.items()}
    assert built.model.champion == min(errors, key=lambda name: errors[name])
    assert errors[built.model.champion] < 0.3 * errors["persistence"]
    assert set(errors) == set(QUICK.methods)


def test_training_recordings_alone_are_fitted_on(built: Built) -> None:
    assert {one.case for one in built.model.trained_on} == {f"growth/{n}.csv" for n in TRAINING}
    roles = {one.case: one.role for one in built.verdict.cases}
    assert {c for c, role in roles.items() if role == "held_out"} == {
        f"growth/{n}.csv" for n in HELD_OUT
    }


def test_the_fit_does_not_change_when_held_out_recordings_do(built: Built, tmp_path: Path) -> None:
    found = recordings()
    other = {name: made(100 + k) if name in HELD_OUT else one
             for k, (name, one) in enumerate(found.items())}  # fmt: skip
    again = build(tmp_path, other)
    for file in ("model.json", "methods.json"):
        assert digest(again.folder / file) == digest(built.folder / file)


def test_growth_is_predicted_on_recordings_that_were_held_out(built: Built) -> None:
    total = built.verdict.total(GROWTH)
    assert total is not None and total.rmse is not None
    assert total.role == "held_out" and total.rmse < 1.0
    assert total.baselines["persistence"].rmse is not None
    assert total.baselines["persistence"].rmse > 5 * total.rmse


def test_every_method_is_in_one_table_with_its_seeds(built: Built) -> None:
    table = methods_table(built.predictions, list(built.model.compared))
    assert {name: one.seeds for name, one in table.items()} == {
        name: 2 if METHODS[name].seeded else 1 for name in QUICK.methods
    }
    total = built.verdict.total(GROWTH)
    assert total is not None
    assert table[built.model.champion].rmse_um == pytest.approx(total.rmse, rel=1e-3)
    low, high = table["ffnn_projection"].seed_rmse_um
    assert 0 < low <= high


def test_faulty_sensors_are_named_with_the_error_they_would_make(built: Built) -> None:
    facts = {one.case: one.facts for one in built.verdict.cases}
    dead, drifting = facts["growth/p09.csv"], facts["growth/p10.csv"]
    assert "temperature_2 is dead" in str(dead["faulty sensor"].value)
    assert "temperature_4 is drifting" in str(drifting["faulty sensor"].value)
    for one in (dead, drifting):
        without, treated = one["RMSE with the faulty sensor"], one["RMSE with it replaced"]
        assert float(without.value or 0) > float(treated.value or 0)
    assert float(dead["RMSE with it replaced"].value or np.inf) < 1.5
    assert "faulty sensor" not in facts["growth/p08.csv"]


def test_all_regimes_have_intervals_and_those_that_follow_the_probe(built: Built) -> None:
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
def test_serving_gives_what_was_judged_and_needs_nothing_later(built: Built, rows: int) -> None:
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


def test_the_example_is_served(built: Built) -> None:
    table = SUBMODEL.example(built.folder)
    found = SUBMODEL.serve(built.folder)(table)
    assert len(found) == len(table) and np.isfinite(found.to_numpy()).all()


def test_what_was_not_learnt_is_refused_by_name_and_value(built: Built) -> None:
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


def test_a_dead_sensor_is_no_reason_to_refuse(built: Built) -> None:
    one = recordings()["p08"]
    one.temperatures[:, 1] = 850.0
    found = SUBMODEL.serve(built.folder)(table_of(one))["growth"].to_numpy()
    assert found == pytest.approx(one.growth, abs=6.0)


def test_stored_methods_predict_the_same_bits(built: Built) -> None:
    first, second = (load_growth_model(built.folder) for _ in range(2))
    case = SUBMODEL.cases(Records(signals=built.signals), fitting_settings()).of("held_out")[0]
    pieces = first.pieces(first.checked(case.load().state))
    for name in first.ensembles:
        assert np.array_equal(first.stitched(pieces, name), second.stitched(pieces, name))


def fitting_settings() -> Any:
    return Fitting(
        identity=IDENTITY, roles=ROLES, deformation_records=RECORDS, deformation_fit=QUICK
    )


@pytest.mark.proof
def test_processes_find_the_same_model(built: Built, tmp_path: Path) -> None:
    some = replace(QUICK, methods=("linear", "bp_7"))
    found = {name: one for name, one in recordings().items() if name in TRAINING}
    serial = build(tmp_path / "a", found, some)
    beside = build(tmp_path / "b", found, replace(some, compute="processes"))
    assert digest(serial.folder / "methods.json") == digest(beside.folder / "methods.json")


def test_a_method_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="names 'forest': with the channels recorded choose among"):
        build(tmp_path, recordings(), replace(QUICK, methods=("forest",)))


def test_too_few_training_recordings_are_refused(tmp_path: Path) -> None:
    some = {name: one for name, one in recordings().items() if name in TRAINING[:2]}
    with pytest.raises(ValueError, match="2 training recordings of growth are of use, 4 are"):
        build(tmp_path, some)


def test_each_method_is_named_for_a_person() -> None:
    labels = [one.label for one in METHODS.values()]
    assert len(set(labels)) == len(labels) and all(labels)
