"""The frame of a sub-model's page: what its files alone give, and what a declaration changes."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from markupsafe import Markup

from pipeline.charts.judged import Tried, chosen_words, scores_table
from pipeline.charts.numbers import resolved
from pipeline.charts.parameters import parameters_table
from pipeline.charts.sections import SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.submodel_page import Counting, Drawn, PageContent, Subject, submodel_page
from pipeline.schema.model import Model, Parameter
from pipeline.schema.verdict import Fact, Figures, GoldenUsed, JudgedCase, Score, Verdict
from pipeline.submodels.contract import Shown
from tests.submodels.made_pages import drawn, plain, tables, words

SUBJECT = Subject(name="growth", title="growth of the bed", needs="a probe at its end over a week")
SCORE = Score(
    quantity="growth", unit="um", group="day 1", regime="", role="held_out", n=60, rmse=1.0,
    max=2.0, limits={"rmse": 5.0}, status="passed", coverage_90=0.9, half_width=1.7,
    baselines={"guess": Figures(rmse=3.0, max=6.0), "mean": Figures(rmse=2.5)},
)  # fmt: skip
SCORES = tuple(replace(SCORE, group=f"day {k}", rmse=float(k), max=2.0 * k) for k in (3, 1, 2))
TOTAL = replace(SCORE, group="all", rmse=2.1, max=6.0, limits={}, status="not judged")
VERDICT = Verdict(
    submodel="growth", machine="mill01", origin="simulated", status="passed", reasons=(),
    judged_role="held_out", golden=None, scores=(*SCORES, TOTAL),
    cases=(JudgedCase(case="day 1", group="day 1", role="held_out", facts={
               "length": Fact(value=24.0, unit="h")}, conditions={"speed": Fact(value="slow")}),
           JudgedCase(case="day 4", group="day 4", role="held_out", note="its probe was not on")),
)  # fmt: skip
MODEL = Model(
    submodel="growth", machine="mill01", origin="simulated", trained_on=(),
    parameters={"": {
        "expansion": Parameter(value=11.2, unit="um/K", interval_95=(10.9, 11.5), determined=True,
                               method="least squares"),
        "lag": Parameter(value=None, unit="s", interval_95=None, method="", determined=False,
                         remedy="record a warm-up"),
    }},
)  # fmt: skip
COUNTS = (Counting(key="growth_rmse", name="Error of the growth", quantity="growth"),
          Counting(key="growth_max", name="Largest error", quantity="growth", error="max",
                   whole=True))  # fmt: skip


def predictions(rows: int = 700) -> pd.DataFrame:
    """Three days of a growth that is predicted with the error of its day."""
    time = np.arange(rows) * 60.0
    growth = 40 * (1 - np.exp(-time / 1200))
    days = [
        pd.DataFrame({
            "case": f"day {k}", "group": f"day {k}", "quantity": "growth", "regime": "",
            "unit": "um", "t": time, "measured": growth, "predicted": growth + k,
            "low": growth - 2, "high": growth + 4, "baseline_guess": growth - 3.0,
        })
        for k in (1, 2, 3)
    ]  # fmt: skip
    return pd.concat(days).sample(frac=1.0, random_state=1)


def page(content: PageContent | None = None, **parts) -> SubModelPage:
    files = {"model": MODEL, "verdict": VERDICT, "predictions": predictions()} | parts
    shown = Shown(machine="mill01", origin="simulated", shelf=SourceRegistry(), **files)
    return submodel_page(shown, SUBJECT, content or PageContent())


def test_all_blocks_come_of_the_three_files():
    said = words(page())
    for one in ("expansion", "record a warm-up", "its probe was not on", "lag", "Worst record"):
        assert one in said
    assert "Of the growth of the bed the records do not determine lag" in said
    without = page(model=None, verdict=None, predictions=None)
    assert without.verdict is None and len(without.sections) == 1
    assert SUBJECT.needs in without.sections[0].text[0]


@pytest.mark.parametrize("together", [2.0, 2.8])
def test_the_worst_group_decides_where_it_is_beyond_its_limit(together):
    failed = tuple(replace(s, limits={"rmse": 2.5}) for s in SCORES)
    total = replace(TOTAL, rmse=together, limits={})
    verdict = replace(VERDICT, status="failed", scores=(*failed, total))
    content = PageContent(counts=[replace(COUNTS[0], whole=True)])
    found = page(content, verdict=verdict)
    assert "3.00 µm in day 3 (limit 2.50 µm)" in plain(found.verdict.sentence)
    assert plain(found.key_figures[0][1]) == "3.00 µm"


@pytest.mark.parametrize(("group", "dated"), [("2026-01-08", True), ("feed/run-1.csv", False)])
def test_the_span_of_a_golden_set_stands_beside_days_alone(group, dated):
    golden = GoldenUsed(sha256="a", files=2, first="2026-01-08", last="2026-01-11")
    scores = tuple(replace(s, role="golden", group=group) for s in SCORES)
    verdict = replace(VERDICT, judged_role="golden", golden=golden, scores=scores)
    sentence = page(PageContent(counts=COUNTS), verdict=verdict).verdict.sentence
    assert "of its golden set" in sentence and ("Jan 2026" in plain(sentence)) == dated


def marked_up(value: object) -> Iterator[Markup]:
    """Every text of a page that its template takes for HTML."""
    if isinstance(value, Markup):
        yield value
    elif is_dataclass(value):
        yield from marked_up([getattr(value, one.name) for one in fields(value)])
    elif isinstance(value, list | tuple):
        for one in value:
            yield from marked_up(one)


def test_text_from_files_stays_text():
    bad = "<script>alert(1)</script>"
    scores = tuple(replace(s, group=f"{bad} {s.group}") for s in SCORES)
    cases = [replace(c, case=bad, group=bad, note=bad, conditions={bad: Fact(value=bad)})
             for c in VERDICT.cases]  # fmt: skip
    one = replace(MODEL.parameters[""]["expansion"], method=bad)
    verdict = replace(VERDICT, scores=(*scores, TOTAL), cases=tuple(cases), reasons=(bad,))
    frame = predictions().assign(case=bad, group=bad)
    found = page(
        PageContent(counts=COUNTS), verdict=verdict, predictions=frame,
        model=replace(MODEL, parameters={bad: {bad: one}}),
    )  # fmt: skip
    texts = list(marked_up(found))
    assert texts and not any("<script" in text for text in texts)


@pytest.mark.parametrize("lacking", ["model", "verdict", "predictions"])
def test_a_file_that_is_not_there_is_named_and_the_rest_stands(lacking):
    found = page(**{lacking: None})
    assert f"{lacking}." in words(found)
    assert ("expansion" in words(found)) == (lacking != "model")
    assert ("day 3" in words(found)) == (lacking != "verdict")


def test_a_pass_says_each_error_with_its_limit_and_how_few_records_there_are():
    found = page(PageContent(case="day", counts=COUNTS, todo={"passed": "Plan with it."}))
    assert plain(found.verdict.sentence) == (
        "The model of the growth of the bed passed on 3 days held out of its fit: error of the "
        "growth up to 3.00 µm (limit 5.00 µm) and largest error 6.00 µm."
    )
    assert found.verdict.todo == "Plan with it. 3 days say little: record more."
    figures = {name: (plain(value), plain(aside)) for name, value, aside in found.key_figures}
    assert figures["Error of the growth"] == (
        "3.00 µm", "worst of 3 days; limit 5.00 µm; mean 2.50 µm"
    )  # fmt: skip
    assert figures["90 % interval"] == ("± 1.70 µm", "holds 90 % of the judged samples")
    compared = {key: one.value for key, one in found.compared.items()}
    assert compared == {"growth_rmse": 3.0, "growth_max": 6.0}


def test_a_failure_names_what_is_beyond_its_limit_else_the_gravest_reasons():
    failed = tuple(replace(s, limits={"rmse": 2.5}) for s in SCORES)
    verdict = replace(VERDICT, status="failed", reasons=("a", "b", "c"), scores=(*failed, TOTAL))
    content = PageContent(counts=COUNTS, cause=" The probe was loose.")
    found = page(content, verdict=verdict).verdict
    said = "up to 3.00 µm in day 3 (limit 2.50 µm); and 3 more reasons. The probe was loose."
    assert said in plain(found.sentence)
    assert "largest error" not in found.sentence and SUBJECT.needs in found.todo
    other = page(content, verdict=replace(VERDICT, status="failed", reasons=("a.", "b", "c")))
    assert "a; b; and 1 more reason." in other.verdict.sentence


@pytest.mark.parametrize(
    ("status", "shown", "said", "todo"),
    [("not judged", "unknown", "has not been judged: one day only.", SUBJECT.needs),
     ("not decided", "attention", "is not decided: one day only.", "2 records leave it open")],
)  # fmt: skip
def test_what_is_not_judged_or_decided_says_why(status, shown, said, todo):
    found = page(verdict=replace(VERDICT, status=status, reasons=("one day only.",))).verdict
    assert found.status == shown and said in found.sentence
    assert todo in found.todo


def test_an_interval_that_is_no_use_is_not_known():
    total = replace(TOTAL, unknown_interval="3 days give one of 4 times the RMSE")
    figures = page(verdict=replace(VERDICT, scores=(*SCORES, total))).key_figures
    assert ("90 % interval", "not known", "3 days give one of 4 times the RMSE") in figures


def test_a_guess_that_comes_closer_is_a_doubt():
    content = PageContent(case="day", counts=COUNTS[:1], guess="mean", titles={"mean": "the mean"})
    assert page(content).doubts == [
        "Error of the growth: on 1 of 3 days the guess (the mean) comes closer than the model."
    ]
    assert not page(replace(content, guess="guess")).doubts


def test_an_axis_follows_the_name_of_a_quantity_and_another_quantity_does_not():
    one = COUNTS[0]
    assert one.holds("growth X") and one.holds("growth")
    assert not one.holds("growth, estimated X") and not one.holds("growths")


def test_typical_and_worst_case_are_drawn_with_interval_guess_and_a_close_look():
    one = Drawn(quantity="growth", other=("guess", "plain guess"), axis="Time, min", factor=1 / 60)
    found = drawn(page(PageContent(case="day", counts=COUNTS, drawn=[one])))
    assert "Typical day, day 2: growth, RMSE 2.00 µm." in found
    worst = found["Worst day, day 3: growth, RMSE 3.00 µm."]
    assert worst.count("curve free") == 2 and 's-band"' in worst and "Time, min" in worst
    assert any(caption.startswith("The same about its greatest error") for caption in found)
    short = drawn(page(predictions=predictions(60)))
    assert not any(caption.startswith("The same") for caption in short)
    assert not any("Worst" in caption for caption in drawn(page(predictions=predictions(2))))


def test_a_length_of_millimetres_is_drawn_in_them():
    large = predictions().assign(measured=lambda d: 100 * d["measured"])
    found = drawn(page(predictions=large))
    assert any("Growth, mm" in svg for svg in found.values())


NUMBERS = st.lists(st.floats(), min_size=3, max_size=9)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_any_numbers_of_a_case_give_a_figure_or_none(measured, predicted, seconds):
    rows = min(map(len, (measured, predicted, seconds)))
    frame = pd.DataFrame({
        "case": "day 3", "group": "day 3", "quantity": "growth", "regime": "", "unit": "um",
        "t": seconds[:rows], "measured": measured[:rows], "predicted": predicted[:rows],
        "low": np.nan, "high": np.nan,
    })  # fmt: skip
    for svg in drawn(page(predictions=frame)).values():
        assert "nan" not in svg.lower().replace("tenant", "")


def test_errors_of_every_group_are_drawn_with_the_best_baseline_and_the_limit():
    (svg,) = (svg for caption, svg in drawn(page()).items() if "best baseline" in caption)
    assert svg.count("point p-passed") == 3 and svg.count("point p-naive") == 3
    assert "mean: 2.50 µm" in svg and "s-limits" in svg


def test_a_table_of_scores_has_the_limited_errors_of_each_baseline_and_the_failed_first():
    failed = replace(SCORES[1], status="failed", reasons=("day 1: RMSE is above 0.5 um",))
    table = scores_table("scores", (*SCORES, failed, TOTAL), [])
    assert [row[0].text for row in table.rows[:2]] == ["all of them", "day 1"]
    assert table.rows[1][-1].text == "RMSE is above 0.5 um"
    assert [name for name, _ in table.groups if name] == ["guess", "mean"]
    assert table.note == "Limits of growth: RMSE 5 µm of each day, recording or run."
    many = {f"m{k}": Figures(rmse=1.0) for k in range(5)} | {"guess": Figures(rmse=2.0)}
    table = scores_table("scores", [replace(SCORE, baselines=many)], [], guess="guess")
    assert [name for name, _ in table.groups if name] == ["guess"]


def test_records_stand_with_conditions_and_the_facts_that_are_declared():
    rows = tables(page(PageContent(shown_facts=("len",))))[
        "Records, their conditions and facts (1)"
    ]
    assert rows[0][:4] == ["day 1", "held out", "slow", "24.0"]


def test_a_single_value_of_a_record_stands_with_its_interval():
    one = predictions(3).groupby("case").head(1).assign(measured=50.0, low=10.0, high=60.0)
    (rows,) = (rows for caption, rows in tables(page(predictions=one)).items()
               if caption.startswith("Single values (3); 3 of 3"))  # fmt: skip
    assert rows[0][2] == "50.0" and rows[0][-1] == "inside"


def test_what_serves_is_said_with_what_does_better_on_the_records_that_decide():
    better, own = Figures(rmse=1.0), Figures(rmse=2.0)
    tried = [Tried(label="ARX", error=0.5, unit="µm", serves=True, later=own),
             Tried(label="TCN", error=0.7, unit="µm", later=better)]  # fmt: skip
    assert chosen_words(tried, "on days left out") == (
        "ARX serves, of 2 it errs least on days left out; on the records that decide TCN does "
        "better, RMSE 1.00 against 2.00 µm."
    )
    tasks = [replace(one, task=task) for task in "abcd" for one in tried]
    assert chosen_words(tasks, "") == "Of 4 tasks ARX serves in 4."


def test_methods_that_several_parameters_share_are_said_once():
    used = {"a": "motion", "b": "motion", "c": "the loop", "d": "the loop", "e": "a data sheet"}
    p = MODEL.parameters[""]["expansion"]
    table = parameters_table("p", {name: replace(p, method=one) for name, one in used.items()}, [])
    assert table.note == "Methods: (a) motion; (b) the loop."
    assert [row[-1].text for row in table.rows] == ["(a)", "(a)", "(b)", "(b)", "a data sheet"]


@given(st.floats(1e-3, 1e4), st.floats(1e-3, 0.5))  # narrower than five digits show
def test_printed_intervals_keep_their_width(value, share):
    low, high = value * (1 - share), value * (1 + share)
    digits = resolved(low, high)
    printed = [float(f"{x:.{digits}g}") for x in (low, high)]
    # two digits of the width: either end is off by at most a twentieth of it
    assert printed[1] - printed[0] == pytest.approx(high - low, rel=0.1)
