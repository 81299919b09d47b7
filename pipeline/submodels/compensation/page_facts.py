"""Facts of the following error that the drives' model leaves over, for the machine's page.

They come from the stored files alone: model, verdict, predictions.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.charts.numbers import TOGETHER, fixed
from pipeline.charts.sources import Source
from pipeline.charts.tables import sources
from pipeline.schema.verdict import Fact, Figures, JudgedCase, Role, Score
from pipeline.submodels.compensation.model import (
    ESTIMATION,
    PERSISTENCE,
    PREDICTION,
    QUANTITIES,
    TWIN,
    CompensationModel,
    UseModel,
)
from pipeline.submodels.contract import Shown

BASES = {PREDICTION: TWIN, ESTIMATION: PERSISTENCE}
"""What each use is held against."""
SAME_SPEED = 0.02
"""Share by which the highest speeds of two recordings of one motion differ at most [1]."""

Seen = Shown[CompensationModel]


def um(value: float | None) -> str:
    """A length in um, with three digits below 10 um."""
    return "–" if value is None else f"{bare(value)}{TOGETHER}µm"


def bare(value: float | None) -> str:
    """As :func:`um`, for columns with the unit in their head."""
    return "–" if value is None else fixed(value, 2 if abs(value) < 9.995 else 1)


def short(case: str) -> str:
    """A recording without its folder and ending."""
    return case.rpartition("/")[2].removesuffix(".csv")


@dataclass(frozen=True, kw_only=True, eq=False)
class Traced:
    """One recording of one axis, N samples; errors in um, NaN where they are not known."""

    axis: str
    use: str
    case: str
    """Of what."""
    seconds: np.ndarray
    """Since the recording began [s]; shape (N,)."""
    before: np.ndarray
    after: np.ndarray
    """What the drives' model (of an estimation: the last measured error) leaves over, and what the
    one that serves leaves; shape (N,)."""
    low: np.ndarray
    high: np.ndarray
    """90 % interval of ``before``, as it was predicted; shape (N,)."""

    @property
    def worst(self) -> int:
        """Sample with the greatest error that is left."""
        return int(np.nanargmax(np.abs(self.after)))


@dataclass(frozen=True, kw_only=True, eq=False)
class CompensationFacts:
    """Everything that the page says, found once."""

    shown: Seen

    @cached_property
    def axes(self) -> list[tuple[str, str, UseModel]]:
        """Letter, use and model of every axis: before the motion where that was learnt."""
        model = self.shown.model
        if model is None:
            return []
        found = []
        for letter, uses in model.axes.items():
            for use in (PREDICTION, ESTIMATION):
                if use in uses:
                    found.append((letter, use, uses[use]))
                    break
        return found

    @property
    def role(self) -> Role:
        """Of the recordings that decide."""
        verdict = self.shown.verdict
        return (None if verdict is None else verdict.judged_role) or "held_out"

    def made_from(self, *names: str) -> list[Source]:
        """Stored files that a figure stands on."""
        return sources(self.shown.shelf, *(self.shown.folder / name for name in names))

    def total(self, letter: str, use: str) -> Score | None:
        """Errors over all recordings that decide."""
        verdict = self.shown.verdict
        return None if verdict is None else verdict.total(f"{QUANTITIES[use]} {letter}")

    def errors(self, score: Score, kind: str, one: UseModel) -> Figures | None:
        """Errors of a kind beside the one that serves."""
        return score if kind == one.champion else score.baselines.get(kind)

    def recordings(self, letter: str, use: str) -> list[tuple[Score, JudgedCase | None]]:
        """Recordings that decide, the greatest error first."""
        verdict = self.shown.verdict
        if verdict is None:
            return []
        cases = {case.group: case for case in verdict.cases if case.role == self.role}
        scores = [
            s for s in verdict.of(f"{QUANTITIES[use]} {letter}", role=self.role)
            if s.group != "all" and s.regime == ""
        ]  # fmt: skip
        scores.sort(key=lambda s: -(s.max or 0.0))
        return [(score, cases.get(score.group)) for score in scores]

    def new_speed(self, case: JudgedCase | None, letter: str) -> bool:
        """Whether no recording that was learnt from has the highest speed of this one."""
        name = f"highest speed {letter}"
        verdict, own = self.shown.verdict, None if case is None else case.conditions.get(name)
        if verdict is None or own is None or not isinstance(own.value, float | int):
            return False
        learnt = [
            f.value for c in verdict.cases
            if c.role == "training" and (f := c.conditions.get(name)) is not None
            and isinstance(f.value, float | int)
        ]  # fmt: skip
        return all(abs(own.value - one) > SAME_SPEED * abs(one) for one in learnt)

    def speed(self, case: JudgedCase | None, letter: str) -> Fact | None:
        """Highest commanded speed of a recording."""
        return None if case is None else case.conditions.get(f"highest speed {letter}")

    def traced(self, letter: str, use: str, one: UseModel) -> Traced | None:
        """The recording that decides with the greatest error; None where none can be drawn."""
        rows = self.shown.predictions
        if rows is None or not len(rows):
            return None
        rows = rows[(rows["quantity"] == f"{QUANTITIES[use]} {letter}") & (rows["regime"] == "")
                    & (rows["role"] == self.role)]  # fmt: skip
        left = np.abs((rows["measured"] - rows["predicted"]).to_numpy(float))
        if not np.isfinite(left).any():
            return None
        case = str(rows["case"].iloc[int(np.nanargmax(left))])
        return _trace(rows[rows["case"] == case], letter, use, case, one.champion)


def _trace(rows: pd.DataFrame, letter: str, use: str, case: str, champion: str) -> Traced:
    """Errors before and after of the rows of one recording."""
    rows = rows.sort_values("t", kind="stable")
    seconds, measured, predicted, low, high = (
        rows[name].to_numpy(float) for name in ("t", "measured", "predicted", "low", "high")
    )
    name = f"baseline_{BASES[use]}"
    base = predicted
    if champion != BASES[use] and name in rows.columns:
        base = rows[name].to_numpy(float)
    return Traced(
        axis=letter, use=use, case=case, seconds=seconds, before=measured - base,
        after=measured - predicted, low=low - base, high=high - base,
    )  # fmt: skip
