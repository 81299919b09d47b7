"""Cycles: one run of a program, from ACTIVE in AUTOMATIC to READY or STOPPED.

Feed hold and interruption belong to a cycle.  A short loss of data inside is bridged when the same
program goes on; its seconds are in none of the cycle's times.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from pipeline.signals.cleaning.settings import NS, CleanSettings
from pipeline.signals.cleaning.states import Intervals

ENDS = ("READY", "STOPPED", "PROGRAM_COMPLETED")
COMPLETED = ("READY", "PROGRAM_COMPLETED")
SHORTEST = 1_000_000
"""A last word before a silence is no run of a program [ns]."""
TIMES = {"ACTIVE": "active_s", "FEED_HOLD": "feed_hold_s", "INTERRUPTED": "interrupted_s"}
COLUMNS = ("cycle", "program", "part", "start", "end", "active_s", "feed_hold_s", "interrupted_s",
           "idle_s", "tool_changes", "complete")  # fmt: skip

State = Mapping[str, str | None]


@dataclass
class _Open:
    """A cycle that has not ended yet; times in ns."""

    program: str | None
    part: str | None
    start: int
    end: int
    last: str = ""
    tool: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    tool_changes: int = 0

    def spend(self, start: int, end: int, word: str, tool: str | None) -> None:
        """Count one interval in a state of execution."""
        column = TIMES.get(word, "idle_s")
        self.seconds[column] = self.seconds.get(column, 0.0) + (end - start) / NS
        self.end, self.last = end, word
        if tool is not None:
            self.tool_changes += self.tool is not None and tool != self.tool
            self.tool = tool

    def row(self, complete: bool) -> dict[str, object]:
        """The cycle as a row of the table."""
        times = {c: round(self.seconds.get(c, 0.0), 3) for c in (*TIMES.values(), "idle_s")}
        return {
            "program": self.program, "part": self.part, "start": self.start, "end": self.end,
            **times, "tool_changes": self.tool_changes, "complete": complete,
        }  # fmt: skip


def cycles(found: Intervals, settings: CleanSettings) -> pd.DataFrame:
    """The cycles in a machine's intervals.

    Parameters
    ----------
    found : Intervals
        With ``execution``; ``controller_mode``, ``program``, ``tool_number``, ``part_count``,
        ``emergency_stop`` where the machine tells them.
    settings : CleanSettings
        ``off_after_s``: longer losses of data end a cycle.

    Returns
    -------
    DataFrame
        Columns ``COLUMNS``; times in UTC.  ``complete``: ended by READY in AUTOMATIC, with nothing
        known that cut it short.
    """
    run = _Run(longest_loss=round(settings.off_after_s * NS))
    names = list(found.state)
    for i in range(len(found.start)):
        state = {n: found.state[n][i] for n in names}
        run.step(int(found.start[i]), int(found.end[i]), state)
    run.close(complete=False)
    return _table(run.rows)


@dataclass
class _Run:
    """Goes through the intervals; ``longest_loss`` [ns] of data is bridged inside a cycle."""

    longest_loss: int
    rows: list[dict[str, object]] = field(default_factory=list)
    now: _Open | None = None

    def step(self, start: int, end: int, state: State) -> None:
        """Take one interval [ns] and the states in it."""
        word = state.get("execution")
        if word is None:  # whether a cycle goes on is told by what comes after the loss
            return
        if self.now is not None and start > self.now.end and self._broken(start, state):
            self.close(complete=False)
        taken_over = _taken_over(state)
        if self.now is not None and (word in ENDS or taken_over):
            self.now.end = start
            self.close(complete=word in COMPLETED and not taken_over and self.now.last == "ACTIVE")
        elif self.now is None and word == "ACTIVE" and not taken_over:
            self.now = _Open(
                program=state.get("program"), part=state.get("part_count"), start=start, end=start
            )
        if self.now is not None:
            self.now.spend(start, end, word, state.get("tool_number"))

    def _broken(self, start: int, state: State) -> bool:
        """Whether what comes after a loss of data is not the same program going on."""
        now = self.now
        if now is None:
            return False
        other = state.get("program") not in (None, now.program)
        return other or state["execution"] in ENDS or start - now.end > self.longest_loss

    def close(self, *, complete: bool) -> None:
        """End the cycle that is open."""
        if self.now is not None and self.now.end - self.now.start >= SHORTEST:
            self.rows.append(self.now.row(complete))
        self.now = None


def _taken_over(state: State) -> bool:
    """Whether a hand or an emergency stop has taken the program's place."""
    mode, stop = state.get("controller_mode"), state.get("emergency_stop")
    return mode not in (None, "AUTOMATIC") or stop == "TRIGGERED"


def _table(rows: list[dict[str, object]]) -> pd.DataFrame:
    table = pd.DataFrame(rows, columns=list(COLUMNS[1:]))
    table.insert(0, "cycle", range(1, len(table) + 1))
    for name in ("start", "end"):
        at = pd.to_datetime(table[name].astype("int64"), unit="ns", utc=True)
        table[name] = at.astype("datetime64[ns, UTC]")
    words = ("program", "part")
    numbers = (*TIMES.values(), "idle_s")
    kinds: dict[Hashable, Any] = {"cycle": "int64", "tool_changes": "int64", "complete": bool}
    for name in words:
        kinds[name] = object
    for name in numbers:
        kinds[name] = float
    return table.astype(kinds)
