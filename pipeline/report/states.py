"""State of a machine and of its twin, and rows of actions, as the pages show them."""

from dataclasses import dataclass
from typing import Literal

from pipeline.charts.sections import Action
from pipeline.report.texts import Texts

Status = Literal["failed", "attention", "passed", "unknown"]
NOW = "now"
"""Deadline of what is urgent."""


@dataclass(frozen=True, kw_only=True)
class ActionRow:
    """Action with the page that shows why, ``href`` if any; ``english`` names English fields."""

    action: Action
    href: str = ""
    english: tuple[str, ...] = ()

    def until(self, say: Texts) -> str:
        """Deadline, in words."""
        key = f"until.{self.action.until}"
        return say(key) if say.has(key) else say.given(self.action.until)

    def who(self, say: Texts) -> str:
        """Who does it, in words."""
        return say(f"who.{self.action.who.replace(' ', '_')}")

    def where(self, say: Texts) -> str:
        """Place, in words."""
        return say.given(self.action.where)


@dataclass(frozen=True, kw_only=True)
class StateLine:
    """State of one thing: its status, a few words, and sentences that say why."""

    status: Status
    word: str
    sentences: list[str]


@dataclass(frozen=True, kw_only=True)
class MachineVerdict:
    """Head of a page: the machine's condition, its twin, and what is to be done.

    ``passed`` is how many of the sub-models that count passed, and of how many; None without any.
    """

    condition: StateLine
    twin: StateLine
    actions: list[ActionRow]
    passed: tuple[int, int] | None = None

    @property
    def status(self) -> Status:
        """Status of the twin."""
        return self.twin.status

    def word(self, say: Texts) -> str:
        """Both lines in one, for tables and titles."""
        return say("twin.state", condition=self.condition.word, twin=self.twin.word)


def passed_words(passed: int, of: int, say: Texts) -> str:
    """Number of sub-models that passed, in words."""
    if passed == of:
        return say("twin.all_passed", count=passed)
    return say("twin.some_passed", passed=passed, all=of)
