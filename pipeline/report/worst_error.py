"""The error of a verdict that takes the largest share of its limit, as the pages say it."""

from dataclasses import dataclass

from pipeline.charts.numbers import TOGETHER, number, powers, unit_words
from pipeline.report.baselines import baseline_words
from pipeline.schema.verdict import Score, Verdict

WORDS = {"mae": "mean error", "rmse": "RMS error", "max": "largest error", "bias": "mean offset"}
"""Errors of a score in words; others by their own name."""


@dataclass(frozen=True, kw_only=True)
class WorstError:
    """An error that has a limit.

    Parameters
    ----------
    score : Score
        That it is of.
    name : str
        Of the error, as the score has it.
    value, limit : float
        Its size and limit, in its unit.
    """

    score: Score
    name: str
    value: float
    limit: float

    @property
    def words(self) -> str:
        """Which error it is."""
        plain = self.name.removesuffix("_percent").replace("_", " ")
        return WORDS.get(self.name, f"{plain} error")

    @property
    def shown(self) -> str:
        """Its size with its unit."""
        return f"{number(self.value)}{TOGETHER}{self._unit}"

    @property
    def limit_shown(self) -> str:
        """Its limit with its unit."""
        return f"{self.limit:g}{TOGETHER}{self._unit}"

    @property
    def baseline(self) -> tuple[str, str] | None:
        """The best baseline by the same error, and that error with its unit."""
        errors: list[tuple[float, str]] = [
            (abs(value), other) for other, figures in self.score.baselines.items()
            if (value := getattr(figures, self.name)) is not None
        ]  # fmt: skip
        if not errors:
            return None
        value, other = min(errors)
        return baseline_words(other), f"{number(value)}{TOGETHER}{self._unit}"

    @property
    def _unit(self) -> str:
        return "%" if self.name.endswith("percent") else powers(unit_words(self.score.unit))


def worst_error(verdict: Verdict) -> WorstError | None:
    """The judged error with the largest share of its limit; None where none has a limit."""
    found = [
        WorstError(score=score, name=name, value=abs(value), limit=limit)
        for score in verdict.scores if score.role == verdict.judged_role
        for name, limit in score.limits.items()
        if limit > 0 and (value := getattr(score, name)) is not None
    ]  # fmt: skip
    return max(found, key=lambda one: one.value / one.limit, default=None)
