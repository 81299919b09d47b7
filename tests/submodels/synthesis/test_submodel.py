"""Generated signals as a sub-model: what a sound generator shows, and that each fault is named."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.schema.store import read_json, write_json
from pipeline.signals.wear_windows import WearSource
from pipeline.submodels.cases import Roles
from pipeline.submodels.synthesis import judging
from pipeline.submodels.synthesis.fit import curve_of, thinned
from pipeline.submodels.synthesis.model import (
    FOREST,
    NETWORK,
    SynthesisModel,
    load_synthesis,
)
from pipeline.submodels.synthesis.submodel import SUBMODEL
from tests.signals.wear_files import wear_at
from tests.submodels.synthesis.generated_lives import HELD_OUT, SHORT, Built, build, once


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return once(tmp_path_factory)


@pytest.fixture(scope="module")
def verdict(built: Built):
    return built.judged().verdict


def score(verdict, quantity: str, regime: str = ""):
    found = verdict.of(quantity, group="all", role="held_out")
    return next(one for one in found if one.regime == regime)


def test_tools_are_whole_cases(built: Built) -> None:
    roles = {case.name: case.role for case in built.cases.cases}
    assert [name for name, role in roles.items() if role == "held_out"] == list(HELD_OUT)
    assert {one.case for one in built.model.trained_on} == {f"T{k}" for k in range(6)}
    assert all(case.group == case.name for case in built.cases.cases)


def test_a_judge_reads_the_wear_asked_for_better_than_the_mean_would(verdict) -> None:
    one = score(verdict, judging.GENERATED, FOREST)
    assert one.mae < 0.7 * one.baselines["mean"].mae
    assert set(one.baselines) == {"recorded", "nearest", "mean"}


def test_a_learner_of_generated_windows_reads_recorded_ones(verdict) -> None:
    one = score(verdict, judging.LEARNT)
    assert one.mae < 0.7 * one.baselines["mean"].mae


def test_the_gain_of_augmentation_has_an_interval_over_tools(verdict) -> None:
    gain = next(
        s for s in verdict.skills if s.quantity == judging.AUGMENTED and s.baseline == "recorded"
    )
    assert gain.groups == len(HELD_OUT)
    assert gain.mae_interval_95[0] <= gain.mae <= gain.mae_interval_95[1]


def test_the_curve_rises_with_the_wear(built: Built) -> None:
    one = built.model.curves[FOREST]
    assert len(one.asked) == 8
    assert one.rank_correlation > 0.5
    assert one.rank_of_means > 0.8
    assert one.slope > 0.3
    assert one.mse >= one.mae**2 - 1e-6


def test_the_judge_looks_on_at_stated_steps(built: Built) -> None:
    model = built.model
    steps = [one.step for one in model.looks]
    assert steps == sorted(set(steps)) and steps[-1] == model.steps and len(steps) > 1
    last = model.curves[model.judges[0]]
    assert (model.looks[-1].mae, model.looks[-1].slope) == (last.mae, last.slope)
    assert len({one.mae for one in model.looks}) == len(steps)
    assert list(SUBMODEL.curves(built.folder)["judge"]) == [one.mae for one in model.looks]


def test_a_tendency_that_is_false_is_named() -> None:
    asked = np.linspace(0.0, 90.0, 10)
    read = asked.copy()
    read[6:] = read[6:][::-1]
    found = curve_of(asked, np.repeat(read[:, None], 4, axis=1))
    assert len(found.false_intervals) == 1
    low, high = found.false_intervals[0]
    assert low >= 50.0
    assert high == 90.0
    assert curve_of(asked, np.repeat(asked[:, None], 4, axis=1)).false_intervals == ()


def test_a_class_has_two_wears(tmp_path: Path) -> None:
    """Worn or not: a probability, held against 0 and 1, at these two wears."""
    found = build(
        tmp_path, settings=SHORT, wears=np.tile([0, 0, 0, 1, 1, 1], (9, 1)),
        wear=WearSource(name="wear", unit="um", worn=("0.001",), unworn=("0",)),
    )  # fmt: skip
    assert found.model.is_class
    assert found.model.curves[FOREST].asked == (0.0, 1.0)
    total = score(found.judged().verdict, judging.GENERATED, FOREST)
    assert total.unit == "1"
    assert 0.0 <= total.mae <= 1.0
    assert total.limits == {} and found.settings.synthesis_limits.rmse_class == 0.5


def test_conditions_are_those_of_the_records_without_the_use_of_the_tool(built: Built) -> None:
    space = load_synthesis(built.folder).gan.space
    assert [one.name for one in space.continuous] == ["wear", "feed"]
    assert [one.name for one in space.discrete] == ["cut_type", "tool"]
    wear = built.model.conditions["wear"]
    assert (wear.unit, wear.low) == ("um", 0.0)
    assert wear.high == pytest.approx(max(wear_at(5, 6, k) for k in range(6)), abs=0.01)


def test_spectra_and_distances_stand_in_the_predictions(built: Built) -> None:
    frame = built.judged().predictions
    bands = frame[(frame["quantity"] == judging.SPECTRUM) & (frame["regime"] == "force")]
    assert set(bands["group"]) == {f"T{k}" for k in range(9)}
    assert bands["t"].max() <= 500.0  # half of the rate
    assert (frame[frame["quantity"] == judging.SPREAD]["measured"] > 0).all()


def test_what_is_stored_samples_the_same_bits(built: Built) -> None:
    one, two = load_synthesis(built.folder), load_synthesis(built.folder)
    table = SUBMODEL.example(built.folder)
    made = SUBMODEL.serve(built.folder)(table)
    assert list(made.columns) == ["window", "sample", "force", "vibration"]
    assert len(made) == 2 * built.model.length
    pd.testing.assert_frame_equal(made, SUBMODEL.serve(built.folder)(table))
    values = np.random.default_rng(0).normal(size=(3, 2, 100))
    conditions = {"wear": np.full(3, 50.0), "feed": np.full(3, 300.0)}
    assert np.array_equal(
        one.judges[FOREST](values, conditions), two.judges[FOREST](values, conditions)
    )


@pytest.mark.proof
def test_two_fits_are_the_same_bits(tmp_path: Path) -> None:
    files = [build(tmp_path / name, settings=SHORT).folder for name in ("a", "b")]
    for name in ("model.json", "generator.json"):
        assert files[0].joinpath(name).read_bytes() == files[1].joinpath(name).read_bytes()


def test_generators_of_other_seeds_tell_how_far_trainings_differ(tmp_path: Path) -> None:
    """Of what decides, on tools that were held out; the first training is the one that serves."""
    found = build(tmp_path, settings=replace(SHORT, trainings=2))
    predict = SUBMODEL.load(found.folder, found.settings)
    case = next(one for one in found.cases.cases if one.role == "held_out")
    frame = predict(case).frame
    deciding = {judging.GENERATED, judging.LEARNT, judging.SPREAD, judging.COPY}
    assert {one for one, rows in frame.groupby("quantity") if rows["again_1"].notna().all()} == (
        deciding
    )
    rows = frame[frame["quantity"].isin(deciding)]
    np.testing.assert_array_equal(rows["again_0"], rows["predicted"])
    assert (rows["again_1"] != rows["predicted"]).mean() > 0.9
    assert "again_3" in frame and "again_4" not in frame  # both, at the last look and at the end
    learnt = predict(next(iter(found.cases.of("training")))).frame
    assert not any(name.startswith("again_") for name in learnt)


def test_windows_out_of_what_was_learnt_are_counted_and_not_generated(built: Built) -> None:
    """A held-out tool that wears further: its last windows have no generated counterpart."""
    case = next(one for one in built.cases.cases if one.name == "T7")  # wears faster
    worn = case.load().windows
    top = built.model.conditions["wear"].high
    beyond = replace(case, load=lambda: replace(case.load(), windows=replace(
        worn, wear=np.where(worn.wear > 100.0, top + 50.0, worn.wear))))  # fmt: skip
    found = SUBMODEL.load(built.folder, built.settings)(beyond)
    rows = found.frame[found.frame["quantity"] == judging.GENERATED]
    many = found.facts["windows outside of what was learnt"].value
    assert many == int((worn.wear > 100.0).sum())
    assert len(rows) == len(worn) - many
    assert found.facts["words that were not learnt"].value == "T7"


def test_every_window_out_of_what_was_learnt_is_a_note(built: Built) -> None:
    case = next(one for one in built.cases.cases if one.name == "T7")
    worn = case.load().windows
    beyond = replace(case, load=lambda: replace(
        case.load(), windows=replace(worn, wear=worn.wear + 1000.0)))  # fmt: skip
    found = SUBMODEL.load(built.folder, built.settings)(beyond)
    assert "fewer than three windows" in found.note
    assert not len(found.frame)


# ---- canaries


def test_swapped_labels_are_found(tmp_path: Path) -> None:
    """Every training tool is told to be sharp when it is worn: held-out ones show the opposite."""
    wears = np.array([[wear_at(c, 6, k) for c in range(6)] for k in range(9)])
    wears[:6] = wears[:6, ::-1]
    swapped = build(tmp_path, wears=wears).judged().verdict
    assert swapped.status == "failed"
    assert any("is not below that of mean" in one for one in swapped.reasons)


def test_copies_of_training_windows_are_found(built: Built, monkeypatch) -> None:
    """A generator that gives back the training window next in wear."""
    training = [case.load().windows for case in built.cases.of("training")]
    values = np.concatenate([one.values for one in training]).astype(float)
    wear = np.concatenate([one.wear for one in training])

    def copies(self, conditions, *, seed=0):
        asked = np.asarray(conditions["wear"], float)
        return values[np.abs(wear[None] - asked[:, None]).argmin(axis=1)]

    monkeypatch.setattr("pipeline.nets.dcgan.TrainedGan.sample", copies)
    found = built.judged().verdict
    assert found.status == "failed"
    assert any(judging.COPY in one and "-100" in one for one in found.reasons)


def test_a_collapsed_generator_is_found(built: Built, monkeypatch) -> None:
    whole = load_synthesis(built.folder).gan
    one = whole.sample({"wear": [80.0], "feed": [300.0]}, seed=1)

    def same(self, conditions, *, seed=0):
        return np.repeat(one, len(conditions["wear"]), axis=0)

    monkeypatch.setattr("pipeline.nets.dcgan.TrainedGan.sample", same)
    found = built.judged().verdict
    assert found.status == "failed"
    assert any(judging.SPREAD in one and "-100" in one for one in found.reasons)


def test_a_collapse_of_the_training_stands_in_the_model(tmp_path: Path, monkeypatch) -> None:
    from pipeline.nets.dcgan import TrainedGan

    sample = TrainedGan.sample

    def same(self, conditions, *, seed=0):
        many = len(next(iter(conditions.values())))
        return np.repeat(sample(self, conditions, seed=seed)[:1], many, axis=0)

    monkeypatch.setattr("pipeline.nets.dcgan.TrainedGan.sample", same)
    assert any("collapsed" in one for one in build(tmp_path, settings=SHORT).model.faults)


def test_a_leaking_split_is_found(built: Built) -> None:
    """A recording of training stands among the held-out ones under another name."""
    copied = next(iter(built.cases.of("training")))
    leaked = replace(copied, name="T99", group="T99", role="held_out")
    found = built.judged(cases=(*built.cases.cases, leaked)).verdict
    assert found.status == "failed"
    assert any("T99" in one and "same bytes" in one for one in found.reasons)


# ---- what cannot be


def test_without_a_training_tool_it_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no tool .* roles.training"):
        build(tmp_path, settings=SHORT, roles=Roles(training=("nothing",)))


def test_a_broken_file_of_the_wear_model_is_named(tmp_path: Path) -> None:
    from pipeline.submodels.synthesis.submodel import judges_of

    assert judges_of(tmp_path, "um") == ()
    (tmp_path / "methods.json").write_text("{}")
    with pytest.raises(ValueError, match=r"methods.json is no file of the wear model"):
        judges_of(tmp_path, "um")


def test_the_network_of_the_wear_model_judges_too(built: Built, tmp_path: Path) -> None:
    from pipeline.nets.settings import ResNetSettings, WindowTraining
    from pipeline.nets.wear import train_judge

    lives = [case.load().windows for case in built.cases.of("training")]
    values = np.concatenate([one.values for one in lives])
    flat = values.transpose(1, 0, 2).reshape(values.shape[1], -1)
    network = train_judge(
        values, np.concatenate([one.wear for one in lives]),
        np.concatenate([one.tool for one in lives]),
        scaling=(flat.mean(axis=1).tolist(), flat.std(axis=1).tolist()), wear_unit="um",
        conditions={
            "feed": np.concatenate([one.conditions["feed"] for one in lives]),
            "cut_type slot": np.concatenate(
                [one.conditions["cut_type"] == "slot" for one in lives]).astype(float),
        },
        network=ResNetSettings(filters=4, blocks=1), training=WindowTraining(epochs=1),
    )  # fmt: skip
    stored = json.loads((built.folder / "generator.json").read_text())
    stored["judges"] = [network.document()]
    (tmp_path / "generator.json").write_text(json.dumps(stored))
    write_json(replace(built.model, judges=(FOREST, NETWORK)), tmp_path / "model.json")
    verdict = replace(
        built, folder=tmp_path, model=read_json(tmp_path / "model.json", SynthesisModel)
    ).judged().verdict  # fmt: skip
    assert np.isfinite(score(verdict, judging.GENERATED, NETWORK).mae)


def test_thinning_leaves_every_tool_its_life(built: Built) -> None:
    from pipeline.signals.wear_windows import WearWindows

    windows = WearWindows.joined([case.load().windows for case in built.cases.of("training")])
    few = thinned(windows, 30)
    assert len(few) == 30
    for tool in np.unique(windows.tool):
        whole, part = (one.wear[one.tool == tool] for one in (windows, few))
        assert (part.min(), part.max()) == (whole.min(), whole.max())


def test_spindle_orders_are_those_of_a_tone() -> None:
    """Ten turns a second, a tone at the third order: 0.5 is the mean square of one of size 1."""
    t = np.arange(1000) / 1000.0
    signal = np.sin(2 * np.pi * 30.0 * t)[None] + 0.01
    level = judging.order_levels(signal, np.array([10.0]), 1000.0)
    assert int(np.nanargmax(level)) == 2
    assert level[2] == pytest.approx(10 * np.log10(0.25), abs=0.1)
