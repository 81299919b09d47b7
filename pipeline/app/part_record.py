"""Command ``kerf part-record``: as-built records of the parts in a machine's log."""

from collections.abc import Iterator, Sequence

from pipeline.app.fleet import DATA, check_machine, machine_parameters
from pipeline.app.output import aligned
from pipeline.champions.serving import champion_of
from pipeline.monitoring.part_record import part_records
from pipeline.schema.days import is_day
from pipeline.schema.part_record import PartRecord


def records_of(machine: str, first: str, last: str, program: str) -> list[PartRecord]:
    """As-built records of a machine; ValueError for what is no day."""
    check_machine(machine)
    for option, day in (("--from", first), ("--to", last)):
        if day and not is_day(day):
            raise ValueError(f"{option} {day} is no day: give one as 2026-03-01")
    origin = machine_parameters(machine)["machine"][machine]["identity"]["origin"]
    return list(part_records(machine, origin, DATA, first=first, last=last, program=program,
                             champion=champion_of(machine)))  # fmt: skip


def lines(records: Sequence[PartRecord]) -> Iterator[str]:
    """A line for each part: time against the usual, greatest load, force, alarms."""
    rows = [
        (
            "cycle",
            "begins",
            "program",
            "active s",
            "usual s",
            "most load %",
            "most force N",
            "alarms",
        )
    ]
    for one in records:
        load, force = one.measured.get("spindle_load"), one.twin.get("tangential_force")
        rows.append((
            str(one.cycle), one.start[:16].replace("T", " "), one.program or "-",
            f"{one.active_s:.0f}", "-" if one.usual_s is None else f"{one.usual_s:.0f}",
            "-" if load is None else f"{load.greatest:.0f}",
            "-" if force is None else f"{force.greatest:.0f}", str(len(one.alarms)),
        ))  # fmt: skip
    yield from aligned(rows, words=3)
