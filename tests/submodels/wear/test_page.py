"""Page of tool wear: its words, tables and figures, from the stored files."""

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.charts.sections import SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear.model import GUESS, MEAN, MethodScore, WearModel
from pipeline.submodels.wear.submodel import SUBMODEL
from tests.submodels.made_pages import drawn, held_to_golden, made, tables, words
from tests.submodels.wear.worn_tools import Built, build


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    return build(tmp_path_factory.mktemp("wear"), blank=[(6, 2)])


def shown(built: Built, **changes: object) -> Shown[WearModel]:
    one = Shown(
        machine="rig", origin="simulated", model=built.model, verdict=built.judged.verdict,
        predictions=built.judged.predictions, shelf=SourceRegistry(), folder=built.folder,
    )  # fmt: skip
    return replace(one, **changes)  # type: ignore[arg-type]


def page_of(built: Built, **changes: object) -> SubModelPage:
    return made(SUBMODEL, shown(built, **changes))


def test_the_page_is_the_golden_one(built: Built) -> None:
    held_to_golden(page_of(built), Path(__file__).with_name("page.txt"))


def test_methods_and_thirds_of_the_wear_have_their_figures(built: Built) -> None:
    found = tables(page_of(built))
    methods = found["Methods compared"]
    assert len(methods) == len(built.model.scores) and methods[0][1] != "–"
    assert sum(row[0].endswith("(serves)") for row in methods) == 1
    assert sum(int(row[3]) for row in found["Where it errs, tools that decide"]) == 20
    tools = {row[0]: row for row in found["Errors of flank wear"] if row[1] == "held out"}
    assert set(tools) == {"T5", "T6", "T7", "all of them"}
    assert tools["T6"][2] == "6"  # one of seven was not measured


def test_the_worst_tool_is_drawn_with_its_interval_and_the_guess(built: Built) -> None:
    worst = next(svg for caption, svg in drawn(page_of(built)).items() if "Worst tool" in caption)
    assert "s-band" in worst and "curve free" in worst and "Use of the tool, min" in worst


def test_a_guess_that_is_better_is_said(built: Built) -> None:
    better = {name: MethodScore(rmse=0.1, mae=0.1, worst=0.1) for name in (GUESS, MEAN)}
    model = replace(built.model, scores={**built.model.scores, **better})
    text = words(page_of(built, model=model))
    assert "errs less than any method that looks at the signals" in text
    assert "errs less" not in words(page_of(built))
