"""Tables for ``dvc plots`` as CSV: measured against predicted, and the error in each group."""

from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.schema.verdict import Score, Verdict

if TYPE_CHECKING:
    import pandas as pd

POINTS = 400
"""Rows of the table of predictions, evenly spaced among all: a plot shows no more."""
PREDICTIONS = ("case", "t", "measured", "predicted")
SCORES = ("quantity", "unit", "group", "mae", "rmse", "max", "coverage_90")


def first_judged(verdict: Verdict) -> Score | None:
    """First decisive score over all groups, of training cases if not judged; None without."""
    role = verdict.judged_role or "training"
    overall = [score for score in verdict.scores if (score.group, score.role) == ("all", role)]
    judged = [score for score in overall if score.status != "not judged"]
    return next(iter([*judged, *overall]), None)


def write_plots(verdict: Verdict, predictions: "pd.DataFrame", folder: Path) -> None:
    """Write ``predictions.csv`` and ``scores.csv`` into ``folder``; empty without a score."""
    import pandas as pd

    folder.mkdir(parents=True, exist_ok=True)
    one = first_judged(verdict)
    rows = [
        {name: getattr(score, name) for name in SCORES}
        for score in verdict.scores
        if one is not None
        and (score.quantity, score.regime, score.role) == (one.quantity, one.regime, one.role)
    ]
    tables = {
        "predictions": shown_predictions(verdict, predictions),
        "scores": pd.DataFrame(rows, columns=list(SCORES)),
    }
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.6g", lineterminator="\n")


def shown_predictions(verdict: Verdict, predictions: "pd.DataFrame") -> "pd.DataFrame":
    """At most :data:`POINTS` rows of what a verdict judges first, where both values are known."""
    import pandas as pd

    one = first_judged(verdict)
    if one is None:
        return pd.DataFrame(columns=list(PREDICTIONS))
    of_one = predictions[
        (predictions["quantity"] == one.quantity)
        & (predictions["regime"].fillna("") == one.regime)
        & (predictions["role"] == one.role)
    ]
    known = of_one.dropna(subset=["measured", "predicted"])[list(PREDICTIONS)]
    return known.iloc[:: max(1, -(-len(known) // POINTS))]
