"""Optimised part programs of a machine: facts, trial cuts, and the table over all of them."""

from dataclasses import dataclass, field
from math import comb
from pathlib import Path

from pipeline.charts.numbers import counted, signed
from pipeline.charts.sections import Section, present
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Cell, Column, Table, sources, tabulated
from pipeline.report.cut.tables import figure
from pipeline.report.folders import MachineFolders
from pipeline.report.optimised import tables
from pipeline.report.optimised.tables import AIMS, aim
from pipeline.schema.part import OptimisedPart, Side, TrialCuts, TrialPart

WORTH = 1.0  # percent less: below it nobody changes a program that runs
OVERLOAD_CHANCE = 0.05  # of a load above its limit: with more no program is called loadable
MODELS = "the program, its part in conf/machine and the machine’s models"
WHAT = (
    "F and S of each block were chosen again, inside the limits of the part; every other byte of "
    "the program is as it was. Times are those of the control that was identified; loads rest on "
    "the coefficients in the tables of uncertain quantities."
)
SURPRISE = 0.025  # chance below which trial cuts above the limit are no accident
CUT = "the programs before and after, cut on the simulated shop floor"


@dataclass(frozen=True, kw_only=True)
class PartProgram:
    """Part program, before and after."""

    label: str
    """Label of its files."""
    part: OptimisedPart
    """Stored document of the optimised program."""
    path: Path
    """Path of that document; the optimised program lies beside it."""
    cut: TrialPart | None = None
    """Trial cuts of both on the simulated shop floor; None where nothing was cut."""

    @property
    def program(self) -> Path:
        """The optimised program."""
        return self.path.with_suffix(".nc")

    @property
    def proved(self) -> bool:
        """Whether the geometry is proved to be the same."""
        return self.part.proof.same

    @property
    def inside(self) -> bool:
        """Whether no block exceeds a limit."""
        return not self.part.after.beyond

    @property
    def gain(self) -> float | None:
        """Reduction of the objective [%]; negative where it grew."""
        _, key, _ = AIMS.get(self.part.objective, AIMS["time"])
        change: float | None = getattr(self.part.gain, key)
        return None if change is None else -change

    @property
    def limit(self) -> float | None:
        """Limit of the load [N]."""
        return self.part.load_limit_N

    @property
    def epsilon(self) -> float | None:
        """Chance that was allowed for a load above its limit [1]."""
        return None if self.part.certainty is None else self.part.certainty.epsilon

    def cuts(self, which: Side = "after") -> tuple[int, int] | None:
        """Trial cuts with a load above the limit, and how many there were."""
        return None if self.cut is None else (self.cut.side(which).above, self.cut.seeds)

    @property
    def overloaded(self) -> bool:
        """Whether more trial cuts passed the limit than chance explains at what is allowed."""
        cuts = self.cuts()
        return cuts is not None and at_least(*cuts, self.epsilon or 0.0) < SURPRISE


def at_least(many: int, of: int, chance: float) -> float:
    """Probability that ``many`` or more ``of`` independent cuts pass, each with ``chance``.

    >>> [round(at_least(k, 20, 0.01), 4) for k in (0, 1, 2)]
    [1.0, 0.1821, 0.0169]
    """
    return 1.0 - sum(comb(of, k) * chance**k * (1 - chance) ** (of - k) for k in range(many))


@dataclass(frozen=True, kw_only=True)
class PartPrograms:
    """The optimised programs of a machine, in the order of their labels."""

    programs: list[PartProgram] = field(default_factory=list)
    trial: Path | None = None

    @property
    def seconds(self) -> tuple[float, float] | None:
        """Time of all programs together, before and after [s]; None where one is missing."""
        pairs = [(one.part.before.time_s, one.part.after.time_s) for one in self.programs]
        known = [(a, b) for a, b in pairs if a is not None and b is not None]
        if not known or len(known) < len(pairs):
            return None
        return sum(a for a, _ in known), sum(b for _, b in known)


def part_programs(folders: MachineFolders, shelf: SourceRegistry) -> PartPrograms:
    """Optimised programs of a machine, with their trial cuts."""
    if folders.parts is None:
        return PartPrograms()
    trial = None if folders.trial is None else shelf.read(folders.trial, TrialCuts, CUT)
    cuts = {} if trial is None else trial.parts
    programs = [
        PartProgram(label=path.stem, part=part, path=path, cut=cuts.get(path.stem))
        for path in sorted(folders.parts.glob("*.json"))
        if (part := shelf.read(path, OptimisedPart, MODELS)) is not None
    ]
    return PartPrograms(programs=programs, trial=folders.trial if trial is not None else None)


def loadable(parts: PartPrograms) -> list[PartProgram]:
    """Optimised programs that are worth a look, the greatest gain first."""
    worth = [one for one in parts.programs if is_worth_loading(one)]
    return sorted(worth, key=lambda one: -(one.gain or 0.0))


def is_worth_loading(one: PartProgram) -> bool:
    """Whether it gains enough, is proved, inside its limits, and no trial cut speaks against it."""
    sure = one.proved and not one.overloaded and (one.epsilon or 0.0) <= OVERLOAD_CHANCE
    return sure and one.inside and (one.gain or 0.0) >= WORTH


def refused(parts: PartPrograms) -> list[PartProgram]:
    """Programs that must not be loaded: not proved, or too often beyond the limit when cut."""
    return [one for one in parts.programs if not one.proved or one.overloaded]


def part_key_figures(parts: PartPrograms) -> list[tuple[str, str, str]]:
    """Saving of time of all programs together; nothing without any."""
    seconds = parts.seconds
    if seconds is None or not seconds[0]:
        return []
    change = 100 * (seconds[1] / seconds[0] - 1)
    return [("Time of part programs", f"{signed(change)} %",
             f"predicted, of {counted(len(parts.programs), 'program')}")]  # fmt: skip


def part_changes(parts: PartPrograms) -> dict[str, float | int | None]:
    """Entries of ``report.json``; none for a machine without any."""
    if not parts.programs:
        return {}
    before, after = parts.seconds or (None, None)
    return {"parts": len(parts.programs), "parts_before_s": before, "parts_after_s": after}


def part_programs_section(parts: PartPrograms, shelf: SourceRegistry) -> Section | None:
    """All optimised programs in a table."""
    if not parts.programs:
        return None
    return Section(
        key="part-programs", title="Part programs: faster or cheaper", text=[WHAT],
        blocks=present(overview_table(parts, shelf)),
    )  # fmt: skip


def overview_table(parts: PartPrograms, shelf: SourceRegistry) -> Table | None:
    """Every program: time, cost and peak load before and after, and what is proved."""
    programs = parts.programs
    currencies = {row.part.currency or "" for row in programs}
    currency = currencies.pop() if len(currencies) == 1 else ""

    def total(name: str, unit: str, key: str, digits: int) -> list[Column[PartProgram]]:
        return [
            Column("before", lambda row: tables.side(row.part, "before", key, digits), unit, name),
            Column("after", lambda row: tables.side(row.part, "after", key, digits), unit, name),
        ]

    return tabulated("Part programs before and after", programs, (
        Column("Program", lambda row: row.label),
        Column("aim", lambda row: aim(row.part)),
        *total("Time", "s", "time_s", 4),
        Column("change", lambda row: tables.change(row.part.gain.time_percent), "", "Time"),
        *total("Cost", currency, "cost", 4),
        Column("change", lambda row: tables.change(row.part.gain.cost_percent), "", "Cost"),
        *total("Peak load", "N", "peak_load_N", 3),
        Column("limit", lambda row: figure(row.limit), "N"),
        Column("same moves", lambda row: Cell(
            text="proved" if row.proved else "not proved",
            status="passed" if row.proved else "failed",
        )),
    ), sources(shelf, *(row.path for row in programs)))  # fmt: skip
