"""Predictions beside measurements as one long table, the same for every sub-model.

Columns: ``case``, ``group``, ``role``, ``quantity``, ``unit``, ``regime``, ``t`` (seconds since the
case began, or degrees of the spindle), ``measured``, ``predicted``, ``low`` and ``high`` (90 %
prediction interval), ``scored`` (whether the row counts) and ``baseline_<name>`` for each baseline.
Null is not measured or not predicted.  ``again_<k>``, not stored, is the prediction of the same
training with other seeds, for the spread of the judge's figures.  ``dvc plots`` takes an excerpt
and the error in each group as CSV.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.schema.store import read_table, write_table
from pipeline.schema.verdict import Score, Verdict

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


WORDS = ("case", "group", "role", "quantity", "unit", "regime")
NUMBERS = ("t", "measured", "predicted", "low", "high")
BASELINE = "baseline_"
AGAIN = "again_"
COLUMNS = (*WORDS, *NUMBERS, "scored")


def column_types() -> Mapping[str, "pa.DataType"]:
    """Arrow type of each column that every table has."""
    import pyarrow as pa

    words = dict.fromkeys(WORDS, pa.string())
    return {**words, **dict.fromkeys(NUMBERS, pa.float64()), "scored": pa.bool_()}


def baselines(frame: "pd.DataFrame") -> list[str]:
    """Names of the baselines that a table has, in its order."""
    return [name.removeprefix(BASELINE) for name in frame.columns if name.startswith(BASELINE)]


def write_predictions(frame: "pd.DataFrame", path: Path) -> None:
    """Store predictions with all their columns; a table without rows keeps them."""
    import pandas as pd
    import pyarrow as pa

    missing = [name for name in COLUMNS if len(frame) and name not in frame.columns]
    if missing:
        raise ValueError(f"predictions have no column {missing[0]}: give all of {COLUMNS}")
    types = dict(column_types())
    types |= {f"{BASELINE}{name}": pa.float64() for name in baselines(frame)}
    empty = pd.Series([], dtype=object)
    arrays = [
        pa.array(frame.get(name, empty), type=kind, from_pandas=True)
        for name, kind in types.items()
    ]
    write_table(pa.table(arrays, names=list(types)), path)


def read_predictions(path: Path) -> "pd.DataFrame":
    """Stored predictions; a file that is missing, broken or lacks a column is a StoreError."""
    return read_table(path, column_types()).to_pandas()


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
