"""The default page of any sub-model, and what its parameters' changes are compared by."""

from dataclasses import replace

import pytest
from report_folders import parameter

from pipeline.charts.sources import SourceRegistry
from pipeline.report.changes import MachineFigures, changes, key_figure
from pipeline.report.submodel_pages import default_page
from pipeline.schema.model import Model
from pipeline.schema.verdict import Figures, Score, Verdict
from pipeline.submodels.contract import Shown

NEEDS = "forty cuts with a microscope beside the machine"
MODEL = Model(submodel="wear", machine="m", origin="recorded", trained_on=(),
              parameters={"T1": {"rate": parameter(0.2, "mm/h")}})  # fmt: skip
SCORE = Score(quantity="flank wear", unit="mm", group="T1", regime="", role="held_out", n=9,
              mae=0.02, rmse=0.03, limits={"mae": 0.05}, status="passed",
              baselines={"mean": Figures(mae=0.11), "no_wear": Figures(mae=0.3)})  # fmt: skip
VERDICT = Verdict(submodel="wear", machine="m", origin="recorded", status="passed", reasons=(),
                  judged_role="held_out", golden=None,
                  scores=(SCORE, replace(SCORE, group="T2", mae=0.04)))  # fmt: skip


def shown(**parts) -> Shown:
    files = {"model": MODEL, "verdict": VERDICT, "predictions": None} | parts
    return Shown(machine="m", origin="recorded", shelf=SourceRegistry(), **files)


def test_a_passed_submodel_is_told_by_its_worst_score_limit_and_best_baseline():
    page = default_page(shown(), "wear", "tool wear", NEEDS)
    assert page.verdict.status == "passed"
    said = page.verdict.sentence.replace("\xa0", " ")
    assert said == (
        "The model of the tool wear passed on records held out of its fit: flank wear, mean error "
        "0.0400 mm worst in T2 (limit 0.05 mm; the mean of the training records 0.110 mm)."
    )
    (section,) = page.sections
    assert (section.key, section.title) == ("wear", "Tool wear")
    assert "Parameters of T1" in [block.caption for block in section.blocks]


@pytest.mark.parametrize(
    ("parts", "status", "words"),
    [
        ({"verdict": replace(VERDICT, status="failed", reasons=("too far off",))}, "failed",
         "Do not use this model"),
        ({"verdict": None}, "unknown", f"Record {NEEDS}."),
        ({"verdict": replace(VERDICT, status="not judged", reasons=("one tool only",))}, "unknown",
         f"Record {NEEDS}."),
    ],
)  # fmt: skip
def test_what_is_not_passed_says_what_to_do(parts, status, words):
    page = default_page(shown(**parts), "wear", "tool wear", NEEDS)
    assert page.verdict.status == status and words in page.verdict.todo


def test_a_submodel_without_files_has_no_verdict_and_says_what_it_needs():
    page = default_page(shown(model=None, verdict=None), "wear", "tool wear", NEEDS)
    assert page.verdict is None
    assert NEEDS in page.sections[0].text[0] and "model.json" in page.sections[0].text[0]


def figures(value: float | None, **compared: float) -> MachineFigures:
    return MachineFigures(
        figures={name: key_figure(name, "s", v) for name, v in compared.items()},
        parameters={"wear": {"T1": {"rate": parameter(value, "mm/h")}}},
    )


def test_a_changed_parameter_stands_with_the_note_of_its_submodel():
    note = {"wear": lambda group, name, p, q: f"{group} {name} grew by {q.value / p.value:g}"}
    (change,) = changes(figures(0.2), figures(0.4), note)
    assert (change.what, change.before, change.now) == (
        "Parameter wear T1 rate", "0.200\u00a0mm/h", "0.400\u00a0mm/h"
    )  # fmt: skip
    assert (change.difference, change.note) == ("+0.200\u00a0mm/h", "T1 rate grew by 2")
    assert changes(figures(0.2), figures(0.2), note) == []
    assert changes(figures(0.2), figures(None), note)[0].now == "not known"


def test_counts_change_by_whole_numbers_and_what_was_not_there_was_not_known():
    before, now = figures(0.2, runs=3), figures(0.2, runs=5, new=1.5)
    found = {c.what: (c.before, c.now, c.difference) for c in changes(before, now, {})}
    assert found == {
        "runs": ("3\u00a0s", "5\u00a0s", "+2\u00a0s"),
        "new": ("not known", "1.50\u00a0s", ""),
    }
