"""All facts about one machine, gathered once; everything on its page is made from them."""

from dataclasses import dataclass
from datetime import date, datetime

import numpy as np

from pipeline.charts.sources import Shelf
from pipeline.report.controlled import Controlled, controlled
from pipeline.report.cutting_facts import Cutting, cutting_facts
from pipeline.report.driven import Driven, driven
from pipeline.report.folders import MachineFolders
from pipeline.report.modelled import Modelled, modelled, spindle_prefix
from pipeline.report.part_programs import PartPrograms, part_programs
from pipeline.report.reading import Reading, reading
from pipeline.report.working import NO_RECORD, Day, Working, working


@dataclass(frozen=True, kw_only=True)
class Facts:
    """One machine: its folders, what its files say, and which files those were."""

    folders: MachineFolders
    shelf: Shelf
    reading: Reading
    working: Working
    model: Modelled
    control: Controlled
    drives: Driven
    cutting: Cutting
    parts: PartPrograms

    @property
    def without_spindle(self) -> bool:
        """Whether it is known by its control, drives or cuts alone: nothing of its heat."""
        known = self.model.thermal is not None or self.model.validation is not None
        others = (self.control.control, self.drives.drive, self.cutting.document)
        return not known and any(document is not None for document in others)

    @property
    def worked_days(self) -> list[Day]:
        """Days with at least one known second of execution."""
        return [d for d in self.working.days if set(d.seconds) - {NO_RECORD}]

    @property
    def last(self) -> datetime | None:
        """Time of the newest record."""
        last: datetime | None = self.reading.last
        return last

    @property
    def periods(self) -> list[tuple[str, str]]:
        """First and last day of each period of records, periods a week or more apart."""
        return periods_of([d.day for d in self.worked_days])

    @property
    def missing_days(self) -> list[str]:
        """Days inside the periods of records that have none."""
        days = [d.day for d in self.worked_days]
        return [
            lost
            for first, last in self.periods
            for lost in days_between([d for d in days if first <= d <= last])
        ]

    @property
    def surprising_days(self) -> list[str]:
        """Missing days on whose weekday the machine has worked in another week."""
        works = {date.fromisoformat(d.day).weekday() for d in self.worked_days}
        return [d for d in self.missing_days if date.fromisoformat(d).weekday() in works]


def facts(folders: MachineFolders) -> Facts:
    """Read everything that is there about one machine."""
    shelf = Shelf()
    model = modelled(folders, shelf)
    return Facts(
        folders=folders,
        shelf=shelf,
        reading=reading(folders, shelf),
        working=working(folders, shelf, spindle_prefix(model.validation)),
        model=model,
        control=controlled(folders, shelf),
        drives=driven(folders, shelf),
        cutting=cutting_facts(folders, shelf),
        parts=part_programs(folders, shelf),
    )


def days_between(days: list[str]) -> list[str]:
    """ISO days that lie between the first and last of ``days`` and are not among them.

    >>> days_between(["2016-10-10", "2016-10-13", "2016-10-12"])
    ['2016-10-11']
    """
    if not days:
        return []
    every = np.arange(np.datetime64(min(days), "D"), np.datetime64(max(days), "D"))
    return [str(d) for d in every if str(d) not in set(days)]


def periods_of(days: list[str]) -> list[tuple[str, str]]:
    """First and last of each run of ISO days without a hole of more than a week.

    >>> periods_of(["2017-11-13", "2017-11-16", "2019-05-20"])
    [('2017-11-13', '2017-11-16'), ('2019-05-20', '2019-05-20')]
    """
    found: list[tuple[str, str]] = []
    for day in sorted(days):
        near = found and (date.fromisoformat(day) - date.fromisoformat(found[-1][1])).days <= 7
        if near:
            found[-1] = (found[-1][0], day)
        else:
            found.append((day, day))
    return found
