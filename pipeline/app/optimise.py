"""Optimisation of a part program on the command line: program, JSON and page."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType
from typing import TypeVar

from pipeline.app.cut import CutOptions, workshop_of
from pipeline.app.programs import Controlled, machine_residual
from pipeline.gcode.moves import Moves
from pipeline.optimisation.document import optimised_part, optimised_text
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.job import JobRequest, Progress, part_program
from pipeline.optimisation.optimise import optimise_worn
from pipeline.optimisation.settings import OptimisationSettings
from pipeline.report.optimised.page import write_optimised_page
from pipeline.schema.files import together
from pipeline.schema.part import OptimisedPart, part_values
from pipeline.schema.store import write_bytes, write_json

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

    def settings(self, own: OptimisationSettings) -> OptimisationSettings:
        """The settings of conf/ with what the options change."""
        return replace(
            own,
            certainty=_with(own.certainty, epsilon=self.epsilon, seed=self.seed),
            search=_with(own.search, seed=self.seed),
            grouping=_with(own.grouping, speeds=self.speeds, split=self.split or None),
            proof_comment=self.proof_comment or own.proof_comment,
            compensated=self.compensated or own.compensated,
        )


def _with(settings: T, **options: float | str | None) -> T:
    given = {name: value for name, value in options.items() if value is not None}
    return replace(settings, **given)  # type: ignore[type-var]


def optimise_part(
    on: Controlled, program: Path, moves: Moves, cut: CutOptions, search: SearchOptions,
    progress: Progress,
) -> tuple[Result, OptimisedPart]:  # fmt: skip
    """Optimised program, which makes ``moves`` as it is, with its document.

    Raises KeyboardInterrupt when it was ended before anything kept the limits.
    """
    settings = search.settings(on.optimisation)
    models = on.identified_models
    if settings.compensated:
        residual, name = machine_residual(on)
        models = replace(models, residual=residual, residual_name=name)
    text, setup = part_program(program, on.setup)
    request = JobRequest(
        program=text, part=cut.part, models=models, setup=setup, settings=settings, moves=moves
    )
    result = optimise_worn(request, workshop_of(on, cut, settings.wear), progress)
    part = optimised_part(result, machine=on.machine, origin=on.origin, control=on.source)
    return result, replace(part, machine_unit=on.unit or None)


@together()
def write_optimised(
    result: Result, part: OptimisedPart, program: Path, json: Path | None, page: Path | None
) -> None:
    """Write the program, and JSON and page where they are named."""
    write_bytes(optimised_text(result), program)
    if json is not None:
        write_json(part_values(part), json)
    if page is not None:
        write_optimised_page(part, page, json)


@contextmanager
def interruptible(said: Callable[[], None]) -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed, to end with the best so far; a second one ends at once."""
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
