"""State of a machine and of its twin, and rows of what is to be done, as the pages show them."""

from dataclasses import dataclass, field
from typing import Literal

from pipeline.charts.sections import Action

Status = Literal["failed", "attention", "passed", "unknown"]
NOW = "now"
"""Deadline of what is urgent."""


@dataclass(frozen=True, kw_only=True)
class ActionRow:
    """An action with the page that shows why; ``href`` is empty where none does."""

    action: Action
    href: str = ""


@dataclass(frozen=True, kw_only=True)
class StateLine:
    """State of one thing: its status, a few words, and sentences that say why."""

    status: Status
    word: str
    sentences: list[str]


@dataclass(frozen=True, kw_only=True)
class MachineVerdict:
    """Head of a page: the machine's condition, its twin, actions, then notes in order of weight."""

    condition: StateLine
    twin: StateLine
    actions: list[ActionRow]
    notes: list[str] = field(default_factory=list)

    @property
    def status(self) -> Status:
        """Status of the twin."""
        return self.twin.status

    @property
    def word(self) -> str:
        """Both lines in one, for tables and titles."""
        return f"condition {self.condition.word}; twin: {self.twin.word}"
