"""A part program optimised by hand: objective and limits in; program, JSON and page out."""

import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any, TypeVar

from pipeline.app.cut import (
    REMEDY,
    CutOptions,
    cut_options,
    named_as_options,
    part_of,
    workshop_of,
)
from pipeline.app.programs import (
    CHAMPION,
    machine_control,
    machine_residual,
    program_at,
    setup_beside,
    write_document,
)
from pipeline.app.tables import section
from pipeline.gcode.moves import Moves
from pipeline.optimisation.document import optimised_part, optimised_text
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.job import Progress, machine_models, part_job
from pipeline.optimisation.optimise import optimise_worn
from pipeline.optimisation.settings import OptimisationSettings
from pipeline.report.optimised.page import write_optimised_page
from pipeline.schema.files import together
from pipeline.schema.part import Objective, OptimisedPart, part_values
from pipeline.schema.program_cut import CutWarning
from pipeline.schema.store import write_bytes

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class SearchOptions:
    """Search settings of the options; those that are None are as in conf/."""

    epsilon: float | None = None
    seed: int | None = None
    split: bool = False
    speeds: str | None = None
    proof_comment: bool = False
    compensated: bool = False

    def settings(self, parameters: Mapping[str, Any]) -> OptimisationSettings:
        """The section ``optimisation`` of ``parameters`` with what the options change.

        Raises
        ------
        ValueError
            When a value is out of its range; it names the option.
        """
        own = section(dict(parameters), "optimisation", OptimisationSettings)
        own = own or OptimisationSettings()
        with named_as_options():
            return replace(
                own,
                certainty=_with(own.certainty, epsilon=self.epsilon, seed=self.seed),
                search=_with(own.search, seed=self.seed),
                grouping=_with(own.grouping, speeds=self.speeds, split=self.split or None),
                proof_comment=self.proof_comment or own.proof_comment,
                compensated=self.compensated or own.compensated,
            )


def _with(settings: T, **options: float | str | None) -> T:
    """Settings with those options that are given; None leaves a setting as it is."""
    given = {name: value for name, value in options.items() if value is not None}
    return replace(settings, **given)  # type: ignore[type-var]


@dataclass(frozen=True, kw_only=True)
class PartFiles:
    """Files to write; a page and a JSON only where they are named."""

    program: Path
    json: Path | None = None
    page: Path | None = None

    @classmethod
    def of(cls, program: Path | None, json: Path | None, page: Path | None) -> "PartFiles":
        """The files that were named.

        Raises
        ------
        ValueError
            When none is named for the program.
        """
        if program is None:
            raise ValueError(
                "--out is missing: name a file for the optimised program, as OPTIMISED.nc"
            )
        return cls(program=program, json=json, page=page)

    @property
    def named(self) -> list[Path]:
        """Those that were named."""
        return [path for path in (self.program, self.json, self.page) if path is not None]


def part_options(
    *, stock: str | None, tool_table: str | None, material: str | None, limits: Mapping[str, Any],
    resolution: float | None, work_offset: str | None, frf: list[str] | None,
    wear: list[str] | None = None,
) -> CutOptions:  # fmt: skip
    """Blank, tools and material, all three needed; ``limits`` by the names of their fields.

    Raises
    ------
    ValueError
        When one is missing, or a value is out of its range.
    """
    needed = {"stock": stock, "tool_table": tool_table, "material": material}
    for name, value in needed.items():
        if value is None:
            raise ValueError(f"--{name.replace('_', '-')} is missing: {REMEDY[name]}")
    found = cut_options(
        stock=stock, tool_table=tool_table, material=material, limits=limits,
        resolution=resolution, work_offset=work_offset, frf=frf or (), page=None,
        wear=wear or (),
    )  # fmt: skip
    if found is None:
        raise ValueError("--stock is missing")
    return found


@dataclass(frozen=True, kw_only=True)
class PartRequest:
    """All options of ``kerf optimise`` but the files to write.

    ``beyond`` is what of the program leaves the machine, for its documents; ``moves`` are those of
    the program, where it was followed before.
    """

    program: Path
    machine: str
    unit: str | None
    cut: CutOptions
    objective: Objective
    search: SearchOptions
    model: str = CHAMPION
    beyond: tuple[CutWarning, ...] = ()
    moves: Moves | None = None


def optimise_part(request: PartRequest, progress: Progress) -> tuple[Result, OptimisedPart]:
    """The optimised program with its document.

    Raises
    ------
    ValueError
        When something named is not known, the program cannot be followed or cuts nothing, or no
        feed and speed keep the limits.
    KeyboardInterrupt
        When it was ended before anything kept the limits.
    """
    on = machine_control(request.machine, request.unit, request.model)
    settings = request.search.settings(on.parameters)
    models = machine_models(on.models, on.control)
    if settings.compensated:
        residual, name = machine_residual(on, request.machine)
        models = replace(models, residual=residual, residual_name=name)
    job = partial(
        part_job,
        program_at(request.program),
        part_of(request.cut, request.objective),
        models=models,
        setup=setup_beside(on.setup, request.program),
        settings=settings,
        moves=request.moves,
    )
    workshop = workshop_of(on, request.machine, request.cut, settings.wear)
    with named_as_options():
        result = optimise_worn(workshop, job, progress)
    part = optimised_part(result, machine=request.machine, origin=on.origin, control=on.source)
    warnings = (*request.beyond, *part.warnings)
    return result, replace(part, machine_unit=on.unit or None, warnings=warnings)


@together()
def write_optimised(result: Result, part: OptimisedPart, out: PartFiles) -> list[Path]:
    """Write program, JSON and page; the files that were written."""
    write_bytes(optimised_text(result), out.program)
    if out.json is not None:
        write_document(part_values(part), out.json)
    if out.page is not None:
        write_optimised_page(part, out.page, out.json)
    return out.named


@contextmanager
def interruptible(said: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Ctrl-C asks to end with the best so far instead of ending at once; a second one ends.

    Parameters
    ----------
    said : callable
        Called at the first.

    Yields
    ------
    callable
        Whether it was asked.
    """
    asked = False

    def first(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        asked = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
        said()

    before = signal.signal(signal.SIGINT, first)
    try:
        yield lambda: asked
    finally:
        signal.signal(signal.SIGINT, before)
