"""Tool wear: what it learns from made lives, who serves, and what must not pass."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.schema.predictions import AGAIN
from pipeline.schema.store import read_json
from pipeline.signals.wear_windows import WearSource
from pipeline.submodels.cases import Case, Records, Roles
from pipeline.submodels.contract import Prediction
from pipeline.submodels.judge import judge
from pipeline.submodels.statistics import DRAWN, auc
from pipeline.submodels.wear import fit
from pipeline.submodels.wear.life import WearLifeSettings
from pipeline.submodels.wear.model import (
    BLEND,
    FOREST,
    GUESS,
    MEAN,
    MEDIAN,
    METHODS,
    RESNET,
    RIDGE,
    WEAR,
    WORN,
    WearModel,
    load_wear,
)
from pipeline.submodels.wear.submodel import SUBMODEL, Fitting
from tests.signals.wear_files import IDENTITY, cut_table, signals_of, wear_at, wear_records
from tests.submodels.wear.worn_tools import (
    NO_NETWORK,
    QUICK,
    ROLES,
    Built,
    build,
    judged,
    judging,
)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return build(tmp_path_factory.mktemp("wear"))


def test_wear_of_tools_that_were_not_learnt_from_is_told(built: Built) -> None:
    """Wear goes to 150 to 195 um; signals show it within the noise, the guess misses the rate."""
    verdict = built.judged.verdict
    assert verdict.status == "passed", verdict.reasons
    total = verdict.total(WEAR)
    assert total is not None and total.n == 3 * 7
    assert total.rmse is not None and total.rmse < 8.0
    guess = total.baselines[GUESS].rmse
    assert guess is not None and total.rmse < 0.7 * guess
    assert {s.group for s in verdict.of(WEAR, role="held_out")} == {"T5", "T6", "T7", "all"}


def test_the_interval_covers_tools_left_out(built: Built) -> None:
    total = built.judged.verdict.total(WEAR)
    assert total is not None and total.coverage_90 is not None and total.coverage_90 >= 0.8
    band = built.model.bands[built.model.champion][""]
    assert band.groups == 5 and 0 < band.upper < 60.0


def test_a_reading_is_one_a_recording(built: Built) -> None:
    assert built.model.per_recording
    rows = built.judged.predictions
    assert len(rows[rows["case"] == "T6"]) == 7
    np.testing.assert_allclose(rows[rows["case"] == "T6"]["t"], 120.0 * np.arange(7))


def test_every_method_is_compared_and_stored(tmp_path: Path) -> None:
    found = build(tmp_path, settings=QUICK)
    model = found.model
    assert set(model.scores) == {RESNET, FOREST, RIDGE, MEDIAN, GUESS, MEAN, BLEND}
    assert model.champion in (RESNET, FOREST, RIDGE, MEDIAN, BLEND)
    assert sum(model.weights.values()) == pytest.approx(1.0)
    assert read_json(found.folder / "model.json", WearModel) == model
    wear = load_wear(found.folder)
    case = found.cases.of("held_out")[0]
    _, told = wear.predict(case.load())
    frame = found.judged.predictions
    rows = frame[frame["case"] == case.name]
    np.testing.assert_allclose(told[model.champion], rows["predicted"], rtol=1e-12)
    assert len(SUBMODEL.curves(found.folder)) == 2
    _, same, again = wear.predict_again(case.load())
    assert len(again) == DRAWN and all(np.array_equal(same[name], told[name]) for name in told)
    for name in told:  # networks and trees are drawn, the rest has no seed
        drawn = np.ptp([one[name] for one in again], axis=0).max()
        assert (drawn > 0) == (name in (RESNET, FOREST, MEDIAN, BLEND)), name


def test_the_same_fit_gives_the_same_bytes(tmp_path: Path, built: Built) -> None:
    again = build(tmp_path, signals=built.signals)
    for name in ("model.json", "methods.json"):
        assert (again.folder / name).read_bytes() == (built.folder / name).read_bytes()


def test_readings_with_interpolated_wear_are_not_judged(tmp_path: Path) -> None:
    found = build(tmp_path, blank=[(6, 2), (6, 3), (1, 1)])
    rows = found.judged.predictions.query("case == 'T6'")
    assert rows["scored"].tolist() == [True, True, False, False, True, True, True]
    facts = next(c.facts for c in found.judged.verdict.cases if c.case == "T6")
    assert facts["readings with interpolated wear, not judged"].value == 2.0


def test_a_life_beyond_what_was_learnt_is_said(tmp_path: Path) -> None:
    signals = signals_of(tmp_path, tools=8, cuts=7)
    table = tmp_path / "raw/wear/lives.csv"
    table.write_text(table.read_text().replace("T6,side,600.0", "T6,side,900.0"))
    from pipeline.signals.ingest import ingest
    from tests.signals.wear_files import SOURCES

    ingest(tmp_path / "raw", signals, SOURCES, IDENTITY)
    found = build(tmp_path, signals=signals)
    outside = {(one.case, one.condition, one.value) for one in found.judged.verdict.outside}
    assert outside == {("T6", "feed", 900.0)}


# ---- what must not pass


def test_swapped_labels_fail(tmp_path: Path) -> None:
    """Wear of training tools is shuffled: what is learnt says nothing of the others."""
    random = np.random.default_rng(1)
    wears = np.array([[wear_at(cut, 7, tool) for cut in range(7)] for tool in range(8)])
    for tool in range(5):
        wears[tool] = random.permutation(wears[tool])
    verdict = build(tmp_path, wears=wears).judged.verdict
    assert verdict.status == "failed"
    total = verdict.total(WEAR)
    assert total is not None and total.rmse is not None and total.rmse > 30.0


def test_a_copied_training_window_is_found(tmp_path: Path) -> None:
    """A third of a held-out recording is one of a training recording: the judge names both."""
    found = build(tmp_path)
    assert found.judged.verdict.status == "passed"
    raw = tmp_path / "raw/wear"
    theirs, mine = (pq.read_table(raw / name).to_pandas() for name in
                    ("T2_003.parquet", "T6_005.parquet"))  # fmt: skip
    channels = ["force", "vibration"]
    mine.loc[100:199, channels] = theirs.loc[100:199, channels]
    pq.write_table(pa.Table.from_pandas(mine), raw / "T6_005.parquet")
    from pipeline.signals.ingest import ingest
    from tests.signals.wear_files import SOURCES

    ingest(tmp_path / "raw", found.signals, SOURCES, IDENTITY)
    verdict = judged(found).judged.verdict
    assert verdict.status == "failed"
    assert verdict.reasons[0].startswith(
        "T6: wear/T6_005.parquet, window at 0.1 s, has the same bytes as wear/T2_003.parquet"
    )


def test_a_tool_is_never_learnt_from_and_judged_on(tmp_path: Path) -> None:
    """Roles that split the recordings of a tool put all of it into training."""
    signals = signals_of(tmp_path, tools=6, cuts=6)
    split = Roles(training=("wear/T[0-3]_00[0-2]*",))
    found = SUBMODEL.cases(Records(signals=signals), judging(split))
    assert {c.name for c in found.of("training")} == {"T0", "T1", "T2", "T3"}
    assert {c.name for c in found.of("held_out")} == {"T4", "T5"}
    training = {one.sha256 for case in found.of("training") for one in case.files}
    assert not training & {one.sha256 for c in found.of("held_out") for one in c.files}
    assert len(training) == 4 * 6


# ---- classes


def class_signals(folder: Path) -> Path:
    """Experiments of one cut each, worn and unworn in turn, at two feeds."""
    from pipeline.signals.formats import ColumnSource, RecordSource, TableLayout
    from pipeline.signals.ingest import ingest

    (folder / "raw").mkdir(parents=True)
    for k in range(10):
        table = cut_table(180.0 * (k % 2), (300.0, 600.0)[k // 2 % 2], k, 800, 1000.0)
        table["wear_class"] = ("unworn", "worn")[k % 2]
        table["feed"] = (300.0, 600.0)[k // 2 % 2]
        pq.write_table(pa.Table.from_pandas(table), folder / f"raw/e{k}.parquet")
    columns = {
        "force": ColumnSource(column="force", unit="N"),
        "vibration": ColumnSource(column="vibration", unit="m/s^2"),
        "feed": ColumnSource(column="feed", unit="mm/min"),
        "wear_class": ColumnSource(column="wear_class"),
    }
    layout = TableLayout(time="time", text=("wear_class",), columns=columns)
    source = RecordSource(format="parquet", files="*.parquet", table=layout)
    ingest(folder / "raw", folder / "signals", (source,), IDENTITY)
    return folder / "signals"


CLASS_RECORDS = replace(
    wear_records(progress="", continuous={"feed": "mm/min"}, discrete=(), table=None, tool=""),
    wear=WearSource(name="wear_class", worn=("worn",), unworn=("unworn",)),
    recordings=("*.parquet",),
)
CLASS_ROLES = Roles(training=("e[0-5].parquet",))


def class_built(folder: Path) -> Built:
    return build(
        folder, signals=class_signals(folder), roles=CLASS_ROLES, records=CLASS_RECORDS,
        settings=replace(NO_NETWORK, folds=3),
    )  # fmt: skip


def test_worn_or_not_is_a_probability(tmp_path: Path) -> None:
    found = class_built(tmp_path)
    model, verdict = found.model, found.judged.verdict
    assert model.quantity == WORN and not model.bands and not model.per_recording
    assert model.scores[model.champion].balanced_accuracy == 1.0
    assert verdict.status == "passed", verdict.reasons
    rows = found.judged.predictions.query("role == 'held_out'")
    assert rows["predicted"].between(0, 1).all()
    right = (rows["predicted"] > 0.5) == (rows["measured"] > 0.5)
    assert right.all()
    facts = next(c.facts for c in verdict.cases if c.case == "e7.parquet")
    assert facts["mean probability of a worn tool"].value > 0.5  # type: ignore[operator]


def told_of(worn: list[int], **by: list[float]) -> fit._Readings:
    """Two readings of each tool, left out; every method says the same of both."""
    twice = {name: np.repeat(np.array(one), 2) for name, one in by.items()}
    tool = np.repeat([f"e{k}" for k in range(len(worn))], 2)
    return fit._Readings(by=twice, wear=np.repeat(np.array(worn, float), 2), tool=tool,
                     use=np.zeros(2 * len(worn)))  # fmt: skip


def who_serves(out: fit._Readings, *, is_class: bool = True) -> tuple[str, dict[str, float]]:
    weights = fit._with_blend(out)
    scores = {name: fit._score(out, one, is_class=is_class) for name, one in out.by.items()}
    return fit._who_serves(out, scores, weights, is_class=is_class)[0], weights


WORN_OR_NOT = [0, 1, 0, 1, 0, 1, 0, 1]


def test_a_part_that_orders_tools_better_serves_instead_of_the_median() -> None:
    """The median of a good and a bad method errs less than neither, and orders worse."""
    ridge = [0.30, 0.45, 0.28, 0.46, 0.31, 0.47, 0.33, 0.44]
    forest = [0.52, 0.30, 0.55, 0.28, 0.50, 0.31, 0.53, 0.29]
    out = told_of(WORN_OR_NOT, ridge=ridge, forest=forest, guess=[0.5] * 8)
    name, _ = who_serves(out)
    assert name == "ridge"
    assert auc(out.by[name], out.wear) == 1.0 > (auc(out.by["median"], out.wear) or 0)


def test_a_part_no_better_than_a_coin_does_not_serve_for_its_order() -> None:
    """Of methods that order tools left out against their class the least bad one is none."""
    coin = [0.95, 0.02, 0.60, 0.99, 0.70, 0.80, 0.99, 0.98]
    against = [0.70, 0.40, 0.80, 0.50, 0.75, 0.45, 0.65, 0.42]
    out = told_of(WORN_OR_NOT, ridge=coin, forest=against, resnet=against, guess=[0.5] * 8)
    name, _ = who_serves(out)
    assert (auc(out.by["ridge"], out.wear) or 0) > 0.5 > (auc(out.by["median"], out.wear) or 0)
    assert name != "ridge"


@pytest.mark.parametrize("is_class", [True, False])
def test_the_guess_alone_never_serves(*, is_class: bool) -> None:
    signals = [0.9, 0.1, 0.8, 0.2, 0.9, 0.1, 0.8, 0.2]
    guess = [0.1, 0.9, 0.2, 0.8, 0.1, 0.9, 0.2, 0.8]
    name, weights = who_serves(told_of(WORN_OR_NOT, ridge=signals, guess=guess), is_class=is_class)
    assert weights["guess"] == pytest.approx(1.0) and name != "blend"


def test_three_tools_are_enough_whatever_the_folds(tmp_path: Path) -> None:
    found = build(tmp_path, roles=Roles(training=("wear/T[0-2]_*",)), settings=QUICK, tools=5)
    assert set(METHODS) <= set(found.model.scores)


def test_a_class_that_is_not_told_fails_by_the_area_under_the_curve(tmp_path: Path) -> None:
    found = class_built(tmp_path)
    settings = judging(CLASS_ROLES, CLASS_RECORDS)
    load = SUBMODEL.load(found.folder, settings)

    def of_no_use(case: Case) -> Prediction:
        one = load(case)
        same = {name: 0.5 for name in map(str, one.frame) if name.startswith(AGAIN)}
        return replace(one, frame=one.frame.assign(predicted=0.5, **same))

    cases = SUBMODEL.cases(Records(signals=found.signals), settings)
    targets = SUBMODEL.targets(settings, found.model)
    verdict = judge(found.model, of_no_use, cases, targets, sets=None, files={}).verdict
    said = f"{WORN}: area under the ROC curve 0.5 is below 0.7"
    assert verdict.status == "failed" and said in verdict.reasons


# ---- serving


def test_a_table_of_samples_is_served(built: Built) -> None:
    predict, example = SUBMODEL.serve(built.folder), SUBMODEL.example(built.folder)
    found = predict(example)
    assert list(found.columns) == ["wear", "low", "high"] and len(found) == 100
    assert (found["low"] <= found["wear"]).all() and (found["wear"] <= found["high"]).all()
    table = cut_table(120.0, 300.0, 999, 300, 1000.0).assign(feed=300.0, cut_type="slot")
    told = predict(table)["wear"]
    assert told.mean() == pytest.approx(120.0, abs=15.0)
    with pytest.raises(ValueError, match="no column 'vibration'"):
        predict(table.drop(columns="vibration"))
    with pytest.raises(ValueError, match="has 50 rows, a window has 100"):
        predict(table.iloc[:50])
    with pytest.raises(ValueError, match="condition feed is not known"):
        predict(table.assign(feed=np.nan))


def test_without_the_use_of_the_tool_the_signals_alone_serve(built: Built) -> None:
    wear = load_wear(built.folder)
    windows = built.cases.of("held_out")[0].load()
    _, with_use = wear.predict(windows)
    _, without = wear.predict(replace(windows, progress=np.full(len(windows), np.nan)))
    assert np.isnan(without[GUESS]).all()
    name, told, _, _ = wear.served(without)
    if wear.file.weights.get(GUESS, 0.0) > 0 and wear.file.champion == BLEND:
        assert name == wear.file.alone
    assert np.isfinite(told).all()
    np.testing.assert_array_equal(with_use[RIDGE], without[RIDGE])


# ---- what cannot be fitted


def fitting(signals: Path, roles: Roles) -> Fitting:
    return Fitting(
        identity=IDENTITY,
        roles=roles,
        wear_records=wear_records(),
        wear_life=WearLifeSettings(),
        wear_fit=NO_NETWORK,
    )


@pytest.mark.parametrize(
    ("patterns", "words"),
    [(("wear/T0_*", "wear/T1_*"), "there are 2 training tools"), ((), "no training tool")],
)
def test_too_few_tools_are_said(tmp_path: Path, patterns: tuple[str, ...], words: str) -> None:
    signals = signals_of(tmp_path, tools=3, cuts=2)
    settings = fitting(signals, Roles(training=patterns))
    cases = SUBMODEL.cases(Records(signals=signals), settings)
    with pytest.raises(ValueError, match=words):
        SUBMODEL.fit(cases, settings, tmp_path)


def test_settings_are_checked() -> None:
    with pytest.raises(ValueError, match="names 'cnn'"):
        replace(NO_NETWORK, methods=("cnn",))
    with pytest.raises(ValueError, match="least and the greatest share"):
        judging(ROLES, coverage=(0.9, 0.8))


def test_a_tool_in_use_without_a_measurement_is_a_case_that_is_not_judged(tmp_path: Path) -> None:
    signals = signals_of(tmp_path, tools=8, cuts=7, blank=[(7, cut) for cut in range(7)])
    built = build(tmp_path, signals=signals)
    settings = replace(judging(), wear_life=WearLifeSettings(in_use=("T7",)))
    there = Records(signals=signals)
    found = judge(
        built.model, SUBMODEL.load(built.folder, settings), SUBMODEL.cases(there, settings),
        SUBMODEL.targets(settings, built.model), sets=None, files=there.files,
    )  # fmt: skip
    (case,) = (one for one in found.verdict.cases if one.case == "T7")
    assert "was not measured" in case.note
    assert "T7" not in {one.group for one in found.verdict.scores}
    assert found.verdict.status == built.judged.verdict.status
