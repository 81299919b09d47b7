"""Page of tool wear: its words, tables and figures, from the stored files."""

from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.charts.sections import Figures, SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.schema.verdict import OutsideConditions
from pipeline.submodels.contract import Shown
from pipeline.submodels.wear.model import GUESS, MEAN, MethodScore, WearModel
from pipeline.submodels.wear.submodel import SUBMODEL
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
    found = SUBMODEL.page(shown(built, **changes))
    assert isinstance(found, SubModelPage)
    return found


def table(page: SubModelPage, caption: str) -> dict[str, list[str]]:
    """Rows of the table whose caption begins so, by their first cell."""
    (found,) = (
        b for b in page.sections[0].blocks if isinstance(b, Table) and b.caption.startswith(caption)
    )
    return {row[0].text: [cell.text for cell in row[1:]] for row in found.rows}


def test_the_error_stands_beside_that_of_the_guess(built: Built) -> None:
    page = page_of(built)
    total = built.judged.verdict.total("flank wear")
    assert total is not None and total.rmse is not None
    assert page.verdict is not None and page.verdict.status == "passed"
    guess = total.baselines[GUESS].rmse
    assert guess is not None
    assert page.verdict.sentence == (
        f"Wear of 3 tools not learnt from is off by {total.rmse:.0f}\u00a0µm (RMSE), "
        f"{guess:.0f}\u00a0µm by a guess without sensors."
    )
    assert page.compared["wear_rmse"].value == total.rmse
    assert "kerf wear FILE --machine rig" in page.verdict.todo


def test_everything_shown_of_simulated_records_says_so(built: Built) -> None:
    section = page_of(built).sections[0]
    assert section.title.endswith("(simulated)")
    for block in section.blocks:
        if isinstance(block, Table) and not block.folded:
            assert "(simulated)" in block.caption
        if isinstance(block, Figures):
            assert all("(simulated)" in one.caption for one in block.figures)
    recorded = page_of(built, origin="recorded").sections[0]
    assert "simulated" not in recorded.title


def test_tools_and_methods_have_their_figures(built: Built) -> None:
    page = page_of(built)
    tools = table(page, "Tools not learnt from")
    assert set(tools) == {"T5", "T6", "T7"}
    assert tools["T6"][0] == "6"  # one of seven was not measured
    methods = table(page, "Methods compared")
    assert [name for name in methods if name.endswith("(serves)")]
    assert len(methods) == len(built.model.scores)
    where = table(page, "Where it errs")
    assert sum(int(row[2]) for row in where.values()) == 20


def test_each_tool_is_drawn_with_its_interval_and_measurements(built: Built) -> None:
    (drawn,) = (b for b in page_of(built).sections[0].blocks if isinstance(b, Figures))
    assert len(drawn.figures) == 3
    of_t6 = next(one for one in drawn.figures if one.caption.startswith("T6"))
    text = str(of_t6.svg)
    assert "s-band" in text and text.count("s-f-none") == 6
    assert "Use of the tool, min" in text


def test_conditions_that_were_not_learnt_are_named(built: Built) -> None:
    outside = OutsideConditions(
        case="T6", condition="spindle_speed", value=900.0, unit="rev/min", learnt="300 to 600"
    )
    page = page_of(built, verdict=replace(built.judged.verdict, outside=(outside,)))
    assert table(page, "Conditions that were not learnt")["T6"] == [
        "spindle speed", "900", "300 to 600", "rev/min",
    ]  # fmt: skip


def test_a_guess_that_is_better_is_said(built: Built) -> None:
    better = {name: MethodScore(rmse=0.1, mae=0.1, worst=0.1) for name in (GUESS, MEAN)}
    model = replace(built.model, scores={**built.model.scores, **better})
    text = " ".join(page_of(built, model=model).sections[0].text)
    assert "errs less than any method that looks at the signals" in text
    assert "errs less" not in " ".join(page_of(built).sections[0].text)


@pytest.mark.parametrize("status", ["failed", "not judged"])
def test_a_verdict_that_is_no_pass_is_said(built: Built, status: str) -> None:
    verdict = replace(built.judged.verdict, status=status, reasons=("T6: off",))
    found = page_of(built, verdict=verdict).verdict
    assert found is not None
    assert found.status == ("failed" if status == "failed" else "unknown")
    assert "T6: off" in found.sentence


def test_files_that_are_absent_are_named(built: Built, tmp_path: Path) -> None:
    assert page_of(built, model=None, verdict=None, predictions=None).verdict is None
    section = page_of(built, model=None, verdict=None, predictions=None).sections[0]
    assert "model.json" in section.text[0]
    section = page_of(built, verdict=None, predictions=None).sections[0]
    assert "verdict.json" in " ".join(section.text)
    assert "predictions.parquet" in " ".join(section.text)
