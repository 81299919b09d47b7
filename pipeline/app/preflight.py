"""Preflight of a program against the machine's limits (`kerf preflight`)."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from pipeline.app.cut import REMEDY
from pipeline.app.fleet import machine_parameters
from pipeline.app.programs import machine_limits, machine_setup, read_moves, setup_beside
from pipeline.app.tables import read_tools, section
from pipeline.cutting.engagement.stock import height_map, stock_of
from pipeline.gcode.moves import METRE, Moves
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.settings import Part
from pipeline.twin.cut.loads import CHORD, rapid_speeds
from pipeline.twin.cut.path import cutting_path
from pipeline.twin.preflight import (
    IN_MATERIAL,
    Preflight,
    clearance_not_checked,
    contact_violations,
    preflight,
    rapid_violations,
    violation_lines,
)

NO_BLANK = "not checked: shank and holder against the part (give --stock and --tool-table)"


class Clearance(NamedTuple):
    """Options of the blank and the tools whose shanks and holders are held against it."""

    stock: str | None
    tool_table: str | None
    resolution: float | None
    work_offset: str | None

    @property
    def wanted(self) -> bool:
        """Whether more is given than tools, whose ranges `kerf check` looks at alone."""
        return any((self.stock, self.resolution, self.work_offset))


def preflight_program(
    path: Path, machine: str, dialect: str | None = None, *, beside: Path | None = None,
    clearance: Clearance | None = None, moves: Moves | None = None,
) -> Preflight:  # fmt: skip
    """Preflight of the program at ``path`` against ``machine``, and its tools' bodies.

    ``beside`` is a program whose folder is searched for subprograms too; ``moves`` are those of the
    program, where it was followed with this set-up before.
    """
    setup = machine_setup(machine, dialect)
    setup = setup if beside is None else setup_beside(setup, beside)
    sections = machine_parameters(machine)["machine"][machine]
    moves = read_moves(path, setup, lambda done: None) if moves is None else moves
    found = preflight(moves, setup, machine_limits(sections, setup))
    if clearance is None or not clearance.wanted:
        return found
    control = section(dict(sections), "control", ControlParameters)
    return _with_contacts(found, moves, setup, clearance, control)


def _with_contacts(
    found: Preflight, moves: Moves, setup: Setup, clearance: Clearance,
    control: ControlParameters | None,
) -> Preflight:  # fmt: skip
    if clearance.stock is None or clearance.tool_table is None:
        missing = "stock" if clearance.stock is None else "tool_table"
        raise ValueError(f"--{missing.replace('_', '-')} is missing: {REMEDY[missing]}")
    tools = read_tools(clearance.tool_table).tools
    resolution = (clearance.resolution or Part.resolution_mm) * METRE
    path = cutting_path(
        moves, sorted(tools), chord=CHORD * resolution, offsets=setup.work_offsets,
        offset=clearance.work_offset,
        rapid_speeds=None if control is None else rapid_speeds(control),
    )  # fmt: skip
    blank = height_map(stock_of(clearance.stock), resolution)
    at = moves, path, tools, blank
    met = (*found.violations, *contact_violations(*at), *rapid_violations(*at))
    return replace(found, violations=met, clearance=clearance_not_checked(moves, tools))


def preflight_lines(result: Preflight, program: Path, machine: str) -> Iterator[str]:
    """Each violation, and what was not checked, a line of text each."""
    yield from beyond_lines(result, program, machine)
    yield from not_checked_lines(result, machine)


def clearance_lines(result: Preflight) -> Iterator[str]:
    """Shanks and holders that were not checked against the part, in one line."""
    if result.clearance is None:
        yield NO_BLANK
    elif result.clearance:
        yield f"not checked: {'; '.join(result.clearance)}"


def beyond_lines(result: Preflight, program: Path, machine: str) -> Iterator[str]:
    """Each violation, and how many there are."""
    for said in violation_lines(result.violations):
        yield f"warning: {said}"
    met = sum(one.what in IN_MATERIAL for one in result.violations)
    for many, does in (
        (len(result.violations) - met, f"leaves the limits of {machine}"),
        (met, "brings a shank, a holder or a rapid into the part"),
    ):
        if many:
            yield (
                f"warning: {program.name} {does} {many} time{'s' * (many > 1)}: do not run it as "
                "it is"
            )


def not_checked_lines(result: Preflight, machine: str) -> Iterator[str]:
    """Limits that the machine's file does not list, in one line."""
    if result.not_checked:
        yield (
            f"not listed in conf/machine/{machine}.yaml, not checked: "
            f"{'; '.join(result.not_checked)}"
        )
