"""The command `kerf preflight`: a program by hand against what the machine can reach."""

from collections.abc import Iterator
from pathlib import Path

from pipeline.app.fleet import machine_parameters
from pipeline.app.programs import machine_limits, machine_setup, read_moves, setup_beside
from pipeline.twin.preflight import Preflight, preflight, violation_lines


def preflight_program(
    path: Path, machine: str, dialect: str | None = None, beside: Path | None = None
) -> Preflight:
    """Hold the program at ``path`` against the limits of ``machine``.

    Subprograms are searched in its folder, and in that of the program ``beside``.

    Raises
    ------
    ValueError
        When there is no such machine, or the program cannot be followed.
    """
    setup = machine_setup(machine, dialect)
    setup = setup if beside is None else setup_beside(setup, beside)
    limits = machine_limits(machine_parameters(machine)["machine"][machine], setup)
    return preflight(read_moves(path, setup, lambda done: None), setup, limits)


def preflight_lines(found: Preflight, program: Path, machine: str) -> Iterator[str]:
    """Each violation, and what was not checked, a line of text each."""
    yield from beyond_lines(found, program, machine)
    yield from not_checked_lines(found, machine)


def beyond_lines(found: Preflight, program: Path, machine: str) -> Iterator[str]:
    """Each violation, and how many there are."""
    for said in violation_lines(found.violations):
        yield f"warning: {said}"
    if many := len(found.violations):
        yield (
            f"warning: {program.name} leaves the limits of {machine} {many} "
            f"time{'s' * (many > 1)}: do not run it as it is"
        )


def not_checked_lines(found: Preflight, machine: str) -> Iterator[str]:
    """What the machine's file does not list, in one line."""
    if found.not_checked:
        yield (
            f"not listed in conf/machine/{machine}.yaml, not checked: "
            f"{'; '.join(found.not_checked)}"
        )
