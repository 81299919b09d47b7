"""Following errors on the contract: roles, leaks, the verdict, serving, refusals, determinism."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.schema.golden import FrozenSet, GoldenSets
from pipeline.schema.model import SourceFile
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.identify import identify, judge
from pipeline.submodels.cases import Case, Records, leak_reasons
from pipeline.submodels.conformal import half_widths
from pipeline.submodels.contract import Prediction
from pipeline.submodels.following_residual import submodel
from pipeline.submodels.following_residual.features import modelled_following
from pipeline.submodels.following_residual.model import (
    ESTIMATION,
    FUZZY,
    PREDICTION,
    QUANTITIES,
    TWIN,
    ResidualFitSettings,
    ResidualModel,
    load_residual,
)
from pipeline.submodels.following_residual.records import ResidualRecords
from pipeline.submodels.following_residual.submodel import SUBMODEL
from pipeline.submodels.judge import judge as judge_of
from pipeline.submodels.statistics import DRAWN
from tests.submodels.following_residual.axis_files import (
    ALONE,
    PERIOD,
    QUICK,
    drive,
    error_table,
    fitting,
    judging,
    lacked,
    records,
    strokes,
    table,
    write_drive,
    write_signals,
)

TRAINING = tuple(f"feed/p{k}.csv" for k in range(5))
HELD_OUT = ("feed/p5.csv", "feed/p6.csv")
LINEAR = replace(QUICK, kinds=("arx",), windows=400)


@pytest.fixture(autouse=True, scope="module")
def one_core() -> Iterator[None]:
    """Starting processes takes longer than these trainings."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "sched_getaffinity", lambda _: {0})
        yield


def recordings() -> dict[str, pd.DataFrame]:
    return {f"p{k}": table(k) for k in range(7)}


@dataclass(frozen=True)
class Built:
    reads: Mapping[str, Path]
    folder: Path
    model: ResidualModel
    verdict: Verdict
    predictions: pd.DataFrame


def build(
    folder: Path, found: Mapping[str, pd.DataFrame], *, settings: ResidualFitSettings = LINEAR,
    training: tuple[str, ...] = TRAINING, wanted: ResidualRecords | None = None,
    with_drive: bool = True,
) -> Built:  # fmt: skip
    wanted = wanted or records()
    drives = write_drive(folder / "drive") if with_drive else folder / "none"
    reads = {"signals": write_signals(folder / "signals", found), "drive": drives}
    out = folder / "model"
    identify(SUBMODEL, reads, out, settings=fitting(training, wanted, settings))
    (folder / "golden").mkdir()
    judge(
        SUBMODEL, reads, out, folder / "golden", folder / "metrics.json", folder / "plots",
        settings=judging(training, wanted),
    )  # fmt: skip
    return Built(
        reads, out, read_json(out / "model.json", ResidualModel),
        read_json(out / "verdict.json", Verdict), pd.read_parquet(out / "predictions.parquet"),
    )  # fmt: skip


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return build(tmp_path_factory.mktemp("following_residual"), recordings())


def test_the_fit_does_not_change_when_held_out_recordings_do(built, tmp_path):
    found = recordings() | {"p5": table(50), "p6": table(60, extra=False)}
    again = build(tmp_path, found)
    for name in ("model.json", "networks.json"):
        assert (again.folder / name).read_bytes() == (built.folder / name).read_bytes()
    assert not again.predictions.equals(built.predictions)


def test_it_predicts_recordings_that_were_held_out(built):
    for quantity in (f"{QUANTITIES[PREDICTION]} X", f"{QUANTITIES[ESTIMATION]} X"):
        total = built.verdict.total(quantity)
        assert total is not None and total.rmse is not None
        (base,) = (one.rmse for name, one in total.baselines.items() if name != FUZZY)
        assert base is not None and total.rmse < 0.4 * base
        assert total.rmse < 0.6  # um, noise is 0.2
    assert built.verdict.judged_role == "held_out"
    assert built.verdict.status in ("passed", "failed")
    assert all("share inside" in one or "90 %" in one for one in built.verdict.reasons)


def test_an_axis_that_is_wholly_wrong_fails_whichever_method_serves_and_however_wide(built):
    """The drive model alone has nothing to beat, and an interval of the error's size holds it."""
    uses = {PREDICTION: built.model.axes["X"][PREDICTION]}
    scores = {TWIN: uses[PREDICTION].scores[TWIN]}
    alone = replace(uses[PREDICTION], champion=TWIN, scores=scores)
    model = replace(built.model, axes={**built.model.axes, "X": {PREDICTION: alone}})
    settings = judging(TRAINING, records())
    load = SUBMODEL.load(built.folder, settings)

    def of_no_use(case: Case) -> Prediction:
        frame = load(case).frame
        wide = 2 * frame["measured"].abs().max()
        return Prediction(frame=frame.assign(predicted=0.0, low=-wide, high=wide))

    cases = SUBMODEL.cases(Records(**built.reads), settings)
    targets = [one for one in SUBMODEL.targets(settings, model)
               if one.quantity == f"{QUANTITIES[PREDICTION]} X"]  # fmt: skip
    found = judge_of(model, of_no_use, cases, targets, sets=None, files={}).verdict
    assert found.status == "failed"
    assert any("is 100 % of the RMS of what was measured, above 70 %" in r for r in found.reasons)


def test_the_model_with_a_fuzzy_speed_loop_stands_beside_the_prediction(built):
    """Of the prediction alone, and it decides nothing."""
    total = built.verdict.total(f"{QUANTITIES[PREDICTION]} X")
    assert total is not None and total.baselines[FUZZY].rmse is not None
    estimated = built.verdict.total(f"{QUANTITIES[ESTIMATION]} X")
    assert estimated is not None and FUZZY not in estimated.baselines


def test_predictions_are_of_the_whole_following_error(built):
    """Not of what is left over alone: in um, in recorded time, after the settling."""
    rows = built.predictions
    one = rows[
        (rows["case"] == "feed/p5.csv") & (rows["quantity"] == f"{QUANTITIES[PREDICTION]} X")
    ]
    there = table(5)
    error = 1e6 * (there["x_command"] - there["x_actual"])
    at = np.rint(one["t"] / PERIOD).astype(int)
    np.testing.assert_allclose(one["measured"], error.to_numpy()[at], rtol=0, atol=1e-6)
    assert at.min() == round(LINEAR.settle_s / PERIOD) and set(np.diff(at)) == {2}
    assert (one["low"] < one["predicted"]).all() and (one["predicted"] < one["high"]).all()
    base = one[f"baseline_{TWIN}"] + 1e6 * lacked(strokes(5))[at] - one["measured"]
    assert np.abs(base).max() < 1.5  # noise alone
    assert {fact.unit for case in built.verdict.cases for fact in case.facts.values()} == {"%"}


@pytest.mark.parametrize("broken", [False, True])
def test_the_end_of_a_recording_is_held_out_by_time(tmp_path, broken):
    """Of a machine with one recording, also where it has a gap."""
    one = table(0, many=1400)
    if broken:
        one = one.drop(index=range(700, 710))
    wanted = records(last_share=0.3)
    found = build(tmp_path, {"a": one}, training=("feed/a.csv",), wanted=wanted)
    roles = {case.case: case.role for case in found.verdict.cases}
    names = ["feed/a.csv (part 1)", "feed/a.csv (part 2)"] if broken else ["feed/a.csv"]
    assert roles == {f"{name}#begin": "training" for name in names} | {
        f"{name}#end": "held_out" for name in names
    }
    assert found.model.axes["X"][PREDICTION].by_time
    rows = found.predictions
    for name in names:
        begin, end = (rows["t"][rows["case"] == f"{name}#{word}"] for word in ("begin", "end"))
        assert begin.max() < end.min()
    assert found.verdict.judged_role == "held_out"
    assert not any("same bytes" in reason for reason in found.verdict.reasons)


def test_a_copied_part_is_found_by_its_samples(tmp_path):
    """Cut 4 was learnt from; it stands in another file as cut 9, alone."""
    parts = [table(k).assign(cut=k) for k in range(6)]
    whole = pd.concat(parts, ignore_index=True)
    other = parts[4].assign(cut=9)
    for one in (whole, other):
        one["t"] = PERIOD * np.arange(len(one))
    training = tuple(f"feed/a.csv#cut={k}" for k in range(5))
    wanted = records(parts=("cut",))
    found = build(tmp_path, {"a": whole, "b": other}, training=training, wanted=wanted)
    assert tuple(one.case for one in found.model.trained_on) == training
    (reason,) = (one for one in found.verdict.reasons if "same bytes" in one)
    assert reason.startswith("feed/b.csv#cut=9: ")
    assert found.verdict.status == "failed"
    cases = SUBMODEL.cases(Records(**found.reads), judging(training, wanted))
    honest = [case for case in cases.of("held_out") if case.name == "feed/a.csv#cut=5"]
    assert honest and leak_reasons(found.model, honest) == []


def test_a_machine_without_drives_or_commands_is_estimated(tmp_path):
    found = build(
        tmp_path, {f"p{k}": error_table(k) for k in range(7)}, wanted=records(ALONE),
        with_drive=False,
    )  # fmt: skip
    assert list(found.model.axes["X"]) == [ESTIMATION]
    assert not found.model.with_drive
    assert set(found.predictions["quantity"]) == {f"{QUANTITIES[ESTIMATION]} X"}
    assert found.verdict.judged_role == "held_out"
    served = SUBMODEL.serve(found.folder)(SUBMODEL.example(found.folder))
    assert list(served.columns) == ["t"]


def test_a_machine_without_drives_learns_the_error_itself(tmp_path):
    found = build(tmp_path, recordings(), with_drive=False)
    names = [one.name for one in found.model.axes["X"][PREDICTION].inputs]
    assert names and not any("modelled" in name for name in names)
    rows = found.predictions[found.predictions["quantity"] == f"{QUANTITIES[PREDICTION]} X"]
    column = "predicted" if found.model.axes["X"][PREDICTION].champion == TWIN else None
    assert (rows[column or f"baseline_{TWIN}"] == 0.0).all()


def test_a_search_and_the_published_leak_stand_in_the_model(tmp_path):
    settings = replace(QUICK, kinds=("arx", "lstm"), searched="lstm")
    found = build(tmp_path, recordings(), settings=settings)
    assert found.model.search is not None and found.model.search.kind == "lstm"
    assert found.model.leak is not None and found.model.leak.inputs == ("measured error",)
    assert found.model.leak.honest_um == found.model.axes["X"][PREDICTION].scores["lstm"].rmse_um


def test_networks_that_do_not_serve_are_compared_on_some_samples(tmp_path, monkeypatch):
    """What serves and what it has to beat is known of all; of training recordings nothing else."""
    found = build(tmp_path, recordings(), settings=replace(QUICK, kinds=("arx", "lstm")))
    monkeypatch.setattr(submodel, "COMPARED", 40)
    model = load_residual(found.folder)
    use = model.file.axes["X"][PREDICTION]
    serving = replace(use, champion="lstm")  # whose weights are random: it says how far they matter
    file = replace(model.file, axes={"X": {PREDICTION: serving}})
    cases = SUBMODEL.cases(Records(**found.reads), judging(TRAINING, records()))
    held, learnt = (cases.of(role)[0].load() for role in ("held_out", "training"))
    frame = submodel._predicted(held, replace(model, file=file)).frame
    compared = frame["baseline_arx"].notna()
    assert len(frame) > 100 and 20 <= compared.sum() <= 40
    assert frame[["predicted", "low", "high", f"baseline_{TWIN}"]].notna().all(axis=None)
    again = frame[[name for name in frame if name.startswith("again_")]]
    assert again.shape[1] == DRAWN and (np.ptp(again, axis=1) > 0).mean() > 0.9
    assert "baseline_arx" not in submodel._predicted(learnt, replace(model, file=file)).frame
    assert not any("again" in name for name in submodel._predicted(held, model).frame)


def test_it_serves_its_example(built):
    given = SUBMODEL.example(built.folder)
    found = SUBMODEL.serve(built.folder)(given)
    assert list(found.columns) == ["t", "X_residual", "X_low", "X_high"]
    assert len(found) == len(given) and np.isfinite(found.to_numpy()).all()
    assert ((found["X_low"] < found["X_residual"]) & (found["X_residual"] < found["X_high"])).all()


def test_a_table_without_time_is_refused(built):
    with pytest.raises(ValueError, match="no column t"):
        SUBMODEL.serve(built.folder)(pd.DataFrame({"X_reference": [0.0, 1.0]}))


@pytest.mark.parametrize("period", [0.001, PERIOD, 0.004, 0.01])
def test_a_command_at_rest_has_the_residual_of_rest(built, period):
    """T samples whatever the period; nothing is left over where nothing moves."""
    many = 80
    rest = np.full(many, 0.123)
    model = load_residual(built.folder)
    found, half = model.residual("X", rest, np.zeros(many), np.zeros(many), period)
    assert found.shape == half.shape == (many,)
    np.testing.assert_allclose(found, found[0], rtol=0, atol=1e-12)
    assert abs(1e6 * found[0]) < 0.3
    _, upper = half_widths(np.array(["at rest"]), model.file.axes["X"][PREDICTION].bands)
    np.testing.assert_allclose(1e6 * half, upper[0])


def test_a_command_has_the_residual_that_its_recording_shows(built):
    """Whatever the period at which the command is given."""
    model, reference = load_residual(built.folder), strokes(20)
    error, command = modelled_following("X", reference, PERIOD, drive())
    found, _ = model.residual("X", reference, error, command, PERIOD)
    truth = lacked(reference)
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.3 * np.sqrt(np.mean(truth**2))
    coarse, _ = model.residual("X", reference[::2], error[::2], command[::2], 2 * PERIOD)
    assert np.sqrt(np.mean((coarse - found[::2]) ** 2)) < 0.2 * np.sqrt(np.mean(truth**2))


def test_without_a_training_recording_there_is_no_model(tmp_path):
    with pytest.raises(ValueError, match=r"no training recording .* roles\.training"):
        build(tmp_path, recordings(), training=())


def test_the_first_reason_is_said_where_no_recording_can_be_learnt_from(tmp_path):
    with pytest.raises(ValueError, match=r"no training recording .*'x_command'"):
        build(tmp_path, {"p0": error_table(0)})


def test_signals_and_drives_are_both_read(tmp_path):
    with pytest.raises(ValueError, match="name both in reads"):
        SUBMODEL.cases(Records(signals=tmp_path), judging(TRAINING, records()))


def test_every_training_has_its_curve(built):
    curves = SUBMODEL.curves(built.folder)
    model = load_residual(built.folder)
    assert set(curves) == {
        f"{name}.fold_{k}"
        for name, some in model.documents.items()
        for k in range(1, len(some) + 1)
    }
    for name, values in curves.items():
        assert len(values) >= 1, name
        assert np.isfinite(values).all(), name
    ended = {name: min(values) for name, values in curves.items()}
    network = model.networks("X", PREDICTION, "arx")[0]
    assert ended["X prediction arx.fold_1"] == pytest.approx(1e6 * network.history[:, 2].min())


def test_an_axis_that_holds_a_weight_held_it_before_the_command(built):
    """Its torque command is not zero at rest, nor was it before the first sample."""
    many = 80
    rest, held = np.full(many, 0.123), np.full(many, 2.0)
    found, _ = load_residual(built.folder).residual("X", rest, 0 * held, held, PERIOD)
    np.testing.assert_allclose(found, found[0], rtol=0, atol=1e-12)


def test_a_frozen_recording_is_judged_as_golden(built: Built) -> None:
    frozen = FrozenSet(files=(SourceFile(file="feed/p0.csv", sha256="0" * 64),))
    sets = GoldenSets(machine="rig", golden=frozen)
    found = SUBMODEL.cases(Records(**built.reads), judging(TRAINING, records()), sets)
    assert {case.name: case.role for case in found.cases}["feed/p0.csv"] == "golden"
    assert [case.name for case in found.of("training")] == list(TRAINING[1:])
