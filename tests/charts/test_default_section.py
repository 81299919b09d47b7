"""Section of a sub-model made of its verdict and predictions alone."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.charts.default_section import cases_figures, default_blocks, typical_and_worst
from pipeline.charts.sections import Figures
from pipeline.charts.sources import Source
from pipeline.schema.model import Model, Parameter
from pipeline.schema.verdict import JudgedCase, Score, Verdict

MADE = [Source(path="data/models/mill01/growth/verdict.json", sha256="0" * 64)]
SCORE = Score(
    quantity="growth", unit="um", group="day 1", regime="", role="held_out", n=60, rmse=1.0,
    limits={"rmse": 5.0}, status="passed",
)  # fmt: skip
SCORES = tuple(replace(SCORE, group=f"day {k}", rmse=float(k)) for k in (3, 1, 2))
VERDICT = Verdict(
    submodel="growth", machine="mill01", origin="simulated", status="passed", reasons=(),
    judged_role="held_out", golden=None, scores=SCORES,
    cases=(JudgedCase(case="day 4", group="day 4", role="held_out", note="its probe was not on"),),
)  # fmt: skip


def predictions(rows: int = 60) -> pd.DataFrame:
    """Three days of a growth that is predicted with the error of its day."""
    time = np.arange(rows) * 60.0
    growth = 40 * (1 - np.exp(-time / 1200))
    days = [
        pd.DataFrame({
            "group": f"day {k}", "quantity": "growth", "regime": "", "t": time,
            "measured": growth, "predicted": growth + k,
        })
        for k in (1, 2, 3)
    ]  # fmt: skip
    return pd.concat(days).sample(frac=1.0, random_state=1)


def test_the_typical_case_is_the_median_and_the_worst_the_greatest() -> None:
    assert [one.group for one in typical_and_worst(VERDICT)] == ["day 2", "day 3"]
    alone = replace(VERDICT, scores=SCORES[:1])
    assert [one.group for one in typical_and_worst(alone)] == ["day 3"]
    assert typical_and_worst(replace(VERDICT, judged_role="golden")) == ()


def test_both_are_drawn_with_their_error_and_unit() -> None:
    found = cases_figures(VERDICT, predictions(), MADE, axis="s")
    assert isinstance(found, Figures) and len(found.figures) == 2
    typical, worst = (one.caption for one in found.figures)
    assert typical == "Typical case, day 2: growth, RMSE 2.00 µm, over s."
    assert worst == "Worst case, day 3: growth, RMSE 3.00 µm, over s."
    for one in found.figures:
        drawn = str(one.svg)
        assert drawn.count("<path") >= 2 and "3000" in drawn and "nan" not in drawn.lower()


@pytest.mark.parametrize("rows", [0, 2])
def test_too_few_rows_are_not_drawn(rows: int) -> None:
    assert cases_figures(VERDICT, predictions(rows), MADE) is None


def test_a_case_without_a_number_is_an_empty_figure() -> None:
    unknown = predictions().assign(measured=np.nan, predicted=np.nan)
    found = cases_figures(VERDICT, unknown, MADE)
    assert found is not None and "<path" not in str(found.figures[0].svg)


def test_all_blocks_come_of_the_three_files() -> None:
    model = Model(
        submodel="growth", machine="mill01", origin="simulated", trained_on=(),
        parameters={"": {
            "expansion": Parameter(value=11.2, unit="um/K", interval_95=(10.9, 11.5),
                                   determined=True, method="least squares"),
            "lag": Parameter(value=None, unit="s", interval_95=None, method="", determined=False,
                             remedy="record a warm-up"),
        }},
    )  # fmt: skip
    said = str(default_blocks(model, VERDICT, predictions(), MADE))
    for words in ("expansion", "record a warm-up", "Worst case, day 3", "its probe was not on"):
        assert words in said
    assert default_blocks(None, None, None, MADE) == []
