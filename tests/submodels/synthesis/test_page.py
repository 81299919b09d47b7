"""Page of generated signals: its words are those of the verdict, its figures are drawn."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.charts.numbers import number
from pipeline.charts.sources import SourceRegistry
from pipeline.schema.predictions import write_predictions
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.synthesis import judging
from pipeline.submodels.synthesis.model import SynthesisModel
from pipeline.submodels.synthesis.submodel import SUBMODEL
from tests.submodels.made_pages import drawn, held_to_golden, made
from tests.submodels.made_pages import words as all_words
from tests.submodels.synthesis.generated_lives import HELD_OUT, once


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Shown:
    built = once(tmp_path_factory)
    done = built.judged()
    folder = tmp_path_factory.mktemp("shown")
    shutil.copytree(built.folder, folder, dirs_exist_ok=True)
    shelf = SourceRegistry()
    model = shelf.read(folder / "model.json", SynthesisModel)
    write_json(done.verdict, folder / "verdict.json")
    write_predictions(done.predictions, folder / "predictions.parquet")
    shelf.read(folder / "verdict.json", Verdict)
    shelf.predictions(folder / "predictions.parquet")
    return Shown(
        machine="rig", origin="simulated", shelf=shelf, folder=folder, model=model,
        verdict=done.verdict, predictions=done.predictions,
    )  # fmt: skip


def words(shown: Shown) -> str:
    return all_words(made(SUBMODEL, shown))


def test_the_page_is_the_golden_one(shown: Shown) -> None:
    held_to_golden(made(SUBMODEL, shown), Path(__file__).with_name("page.txt"))


def test_augmentation_is_called_real_only_where_its_interval_is(shown: Shown) -> None:
    def with_gain(low: float, high: float) -> Shown:
        skills = tuple(
            replace(s, mae=0.5 * (low + high), mae_interval_95=(low, high))
            if (s.quantity, s.baseline) == (judging.AUGMENTED, "recorded") else s
            for s in shown.verdict.skills
        )  # fmt: skip
        return replace(shown, verdict=replace(shown.verdict, skills=skills))

    assert "none are used for learning" in words(with_gain(-0.1, 0.3))
    assert "none are used" not in words(with_gain(0.1, 0.3))
    harm = words(with_gain(-0.3, -0.1))
    assert "raise the mean error" in harm and "interval 10.0 to 30.0 %" in harm
    assert "That is harm" in harm and "That is harm" not in words(with_gain(-0.1, 0.3))


def test_intervals_with_a_false_tendency_are_named(shown: Shown) -> None:
    curves = {
        name: replace(one, false_intervals=((80.0, 120.0),))
        for name, one in shown.model.curves.items()
    }
    said = words(replace(shown, model=replace(shown.model, curves=curves)))
    assert "falls while the wear grows from 80.0 to 120" in said


def test_figures_are_drawn_without_a_number_that_is_none(shown: Shown) -> None:
    found = drawn(made(SUBMODEL, shown))
    # windows of both channels, curve, map, errors, typical and worst tool, spectra
    assert len(found) == 2 + 1 + 1 + 1 + 2 + 1
    assert all("<svg" in one and "nan" not in one.lower() for one in found.values())


def test_it_says_how_well_the_judge_reads_recorded_windows(shown: Shown) -> None:
    rows = shown.predictions
    rows = rows[(rows["quantity"] == judging.GENERATED) & rows["group"].isin(HELD_OUT)]
    slope = np.polyfit(rows["measured"], rows["baseline_recorded"], 1)[0]
    assert f"it reads with a slope of {number(slope)} and a rank correlation" in words(shown)
