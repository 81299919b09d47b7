"""Page of the fleet: one line for each machine, in groups, what needs attention first."""

from collections.abc import Sequence
from dataclasses import dataclass

from pipeline.report.facts import MachineFacts
from pipeline.report.folders import MachineFolders
from pipeline.report.states import NOW, ActionRow, MachineVerdict
from pipeline.report.texts import ENGLISH, Texts

GROUPS = ("now", "maintenance", "twin", "other", "nothing", "unknown")
"""Groups by their key in the texts, in the order of the page."""
AT_MACHINE = ("maintenance", "tool room")
MOST_NAMES = 12
"""Machines that a credit names; the others are counted."""


@dataclass(frozen=True, kw_only=True)
class FleetRow:
    """Row of a machine: its verdict, its first action, its group and the end of its records.

    ``last_of`` are the sources that end there; empty without a clock.
    """

    folders: MachineFolders
    verdict: MachineVerdict
    group: str
    last: str
    last_of: str = ""

    @property
    def first(self) -> ActionRow | None:
        """The action that comes first; None without any."""
        return next(iter(self.verdict.actions), None)


@dataclass(frozen=True, kw_only=True)
class FleetGroup:
    """Machines that need the same kind of attention."""

    key: str
    title: str
    rows: list[FleetRow]


@dataclass(frozen=True, kw_only=True)
class FleetPage:
    """Groups that have a machine, the fleet in a sentence, and whose records they are.

    ``condition`` is a sentence where it is the same for all; each machine has its own without it.
    """

    groups: list[FleetGroup]
    headline: str
    condition: str
    simulated: bool
    credits: list[tuple[str, str]]


def fleet_row(facts: MachineFacts, verdict: MachineVerdict, say: Texts) -> FleetRow:
    """Line of one machine."""
    records = facts.records
    newest = records.newest
    last = say("fleet.no_clock") if newest is None and records.files else say.moment(newest)
    of = "" if newest is None else say(f"fleet.last_{'live' if records.last_live else 'all'}")
    return FleetRow(
        folders=facts.folders, verdict=verdict, group=group_of(verdict), last=last, last_of=of
    )  # fmt: skip


def group_of(verdict: MachineVerdict) -> str:
    """Key of the group that a machine belongs to, by its most urgent action."""
    actions = [row.action for row in verdict.actions]
    if verdict.twin.status == "unknown" and all(one.who not in AT_MACHINE for one in actions):
        return "unknown"
    if any(one.until == NOW for one in actions):
        return "now"
    if any(one.who in AT_MACHINE for one in actions):
        return "maintenance"
    if verdict.twin.status in ("failed", "attention"):
        return "twin"
    return "other" if actions else "nothing"


def fleet_page(rows: Sequence[FleetRow], say: Texts = ENGLISH) -> FleetPage:
    """The fleet in groups; in each the machine with most to do first, then by name."""
    ordered = sorted(rows, key=lambda row: (-len(row.verdict.actions), row.folders.name))
    found = [
        FleetGroup(key=key, title=say(f"fleet.group.{key}"),
                   rows=[row for row in ordered if row.group == key])
        for key in GROUPS
    ]  # fmt: skip
    groups = [group for group in found if group.rows]
    parts = [say(f"fleet.in_group.{group.key}", count=len(group.rows)) for group in groups]
    machines = say("fleet.machines", count=len(rows))
    words = {row.verdict.condition.word for row in rows}
    owners: dict[str, list[str]] = {}
    for row in sorted(rows, key=lambda row: row.folders.name):
        if row.folders.credit:
            owners.setdefault(row.folders.credit, []).append(row.folders.name)
    return FleetPage(
        groups=groups,
        headline=say("fleet.headline", machines=machines, groups=", ".join(parts))
        if rows else say("fleet.none"),
        condition=say("fleet.same_condition", condition=words.pop()) if len(words) == 1 else "",
        simulated=bool(rows) and all(row.folders.origin == "simulated" for row in rows),
        credits=[(say.some(names, MOST_NAMES), credit) for credit, names in owners.items()],
    )  # fmt: skip
