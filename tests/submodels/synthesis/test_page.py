"""Page of generated signals: its words are those of the verdict, its figures are drawn."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.charts.numbers import number
from pipeline.charts.sections import Figures
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.schema.predictions import write_predictions
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.synthesis import judging
from pipeline.submodels.synthesis.figures import windows_figure
from pipeline.submodels.synthesis.model import SynthesisModel
from pipeline.submodels.synthesis.page import page
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
    return " ".join(page(shown).sections[0].text)


def test_it_says_what_a_judge_reads_and_that_it_is_synthetic(shown: Shown) -> None:
    said = words(shown)
    assert "synthetic" in said and "simulated records" in said
    total = shown.verdict.of(judging.GENERATED, group="all", role="held_out")[0]
    assert f"{number(total.mae)} µm (mean error)" in said
    assert "3 tools not learnt from" in said


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


def test_figures_are_drawn_and_name_their_files(shown: Shown) -> None:
    blocks = page(shown).sections[0].blocks
    figures = next(one for one in blocks if isinstance(one, Figures)).figures
    assert len(figures) == 2 + 1 + 1 + 1  # windows of both channels, curve, spectra, map
    assert all("<svg" in one.svg and "NaN" not in one.svg and "nan" not in one.svg
               for one in figures)  # fmt: skip
    assert all(one.sources for one in figures)


def test_it_says_how_well_the_judge_reads_recorded_windows(shown: Shown) -> None:
    rows = shown.predictions
    rows = rows[(rows["quantity"] == judging.GENERATED) & rows["group"].isin(HELD_OUT)]
    slope = np.polyfit(rows["measured"], rows["baseline_recorded"], 1)[0]
    assert f"it reads with a slope of {number(slope)} and a rank correlation" in words(shown)


@pytest.mark.parametrize(("duration", "said"), [(0.1, "100 ms"), (32.0, "32 s")])
def test_a_long_window_is_told_in_seconds(duration: float, said: str) -> None:
    signal = np.arange(4.0)
    drawn = windows_figure([("wear", signal, signal)], duration, "force")
    assert f"recorded, {said}" in str(drawn)


def test_a_row_for_each_tool_held_out(shown: Shown) -> None:
    tables = [one for one in page(shown).sections[0].blocks if isinstance(one, Table)]
    assert [row[0].text for row in tables[0].rows] == [*HELD_OUT, "all of them"]
    assert [row[0].text for row in tables[1].rows] == ["force", "vibration"]


@pytest.mark.parametrize(("status", "said"), [
    ("failed", "The generated signals failed: too far off."),
    ("not judged", "have not been judged"),
    ("passed", "a judge reads the wear that was asked for"),
])  # fmt: skip
def test_the_head_of_the_page_says_the_verdict(shown: Shown, status: str, said: str) -> None:
    verdict = replace(shown.verdict, status=status, reasons=("too far off",))
    assert said in page(replace(shown, verdict=verdict)).verdict.sentence


def test_without_files_it_says_which(tmp_path: Path) -> None:
    bare = Shown(
        machine="rig", origin="simulated", shelf=SourceRegistry(), folder=tmp_path, model=None,
        verdict=None, predictions=None,
    )  # fmt: skip
    found = page(bare)
    assert found.verdict is None
    assert "model.json" in found.sections[0].text[0]
