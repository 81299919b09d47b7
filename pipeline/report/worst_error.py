"""The error of a verdict that takes the largest share of its limit, as the pages say it."""

from dataclasses import dataclass, replace

from pipeline.charts.numbers import TOGETHER, powers, unit_words
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.verdict import MOST_PERCENT, Score, Verdict


@dataclass(frozen=True, kw_only=True)
class WorstError:
    """An error that has a limit."""

    score: Score
    """That it is of."""
    name: str
    """Name of the error, as the score has it."""
    value: float
    limit: float
    """Its size and limit, in its unit."""
    say: Texts = ENGLISH
    """Language of the words."""

    @property
    def words(self) -> str:
        """Which error it is."""
        key = f"error.{self.name}"
        if self.say.has(key):
            return self.say(key)
        plain = self.name.removesuffix("_percent").replace("_", " ")
        return self.say("error.other", name=plain)

    @property
    def shown(self) -> str:
        """Its size with its unit."""
        return self._sized(self.value)

    @property
    def limit_shown(self) -> str:
        """Its limit with its unit."""
        return f"{self.say.local(f'{self.limit:g}')}{TOGETHER}{self._unit}".rstrip()

    @property
    def baseline(self) -> tuple[str, str] | None:
        """The best baseline by the same error, and that error with its unit."""
        errors: list[tuple[float, str]] = [
            (abs(value), other) for other, figures in self.score.others.items()
            if (value := getattr(figures, self.name)) is not None
        ]  # fmt: skip
        if not errors:
            return None
        value, other = min(errors)
        return baseline_words(other, self.say), self._sized(value)

    def _sized(self, value: float) -> str:
        """A size with its unit; of a share of next to nothing that it is one."""
        if self.name.endswith("percent") and value > MOST_PERCENT:
            return self.say("score.of_nothing", percent=f"{MOST_PERCENT:g}")
        return f"{self.say.number(value)}{TOGETHER}{self._unit}".rstrip()

    @property
    def _unit(self) -> str:
        unit = "" if self.score.unit == "1" else self.score.unit
        return "%" if self.name.endswith("percent") else powers(unit_words(unit))


def worst_error(verdict: Verdict, say: Texts = ENGLISH) -> WorstError | None:
    """The judged error with the largest share of its limit; None where none has a limit."""
    found = [
        WorstError(score=score, name=name, value=abs(value), limit=limit, say=say)
        for score in verdict.scores if score.role == verdict.judged_role
        for name, limit in score.limits.items()
        if limit > 0 and (value := getattr(score, name)) is not None
    ]  # fmt: skip
    return max(found, key=lambda one: one.value / one.limit, default=None)


def worse_elsewhere(verdict: Verdict, shown: WorstError) -> WorstError | None:
    """The largest error of the same kind that is larger: of other records, or without a limit."""
    found = [
        replace(shown, score=score, value=abs(value))
        for score in verdict.scores if score.quantity == shown.score.quantity
        and (value := getattr(score, shown.name)) is not None and abs(value) > shown.value
    ]  # fmt: skip
    return max(found, key=lambda one: one.value, default=None)


def baseline_words(name: str, say: Texts = ENGLISH) -> str:
    """A baseline in words; its own name, without underscores, where the texts do not list it."""
    key = f"baseline.{name}"
    return say(key) if say.has(key) else name.replace("_", " ")
