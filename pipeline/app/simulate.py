"""The command `kerf simulate`: plan a program, follow its cut and its axes, write, say."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.app.fleet import check_outputs
from pipeline.app.kerf import share_bar
from pipeline.app.output import step
from pipeline.app.preflight import preflight_lines
from pipeline.app.programs import (
    Simulated,
    passed_over,
    simulate_program,
    simulated_document,
    simulated_lines,
    write_document,
)
from pipeline.schema.files import together

if TYPE_CHECKING:
    from pipeline.app.cut import CutOptions
    from pipeline.machine.control.planner import Plan
    from pipeline.report.programs.simulated import Program
    from pipeline.twin.corrected_program import CorrectedProgram


@dataclass(frozen=True, kw_only=True)
class SimulateRequest:
    """All options of ``kerf simulate``; ``cut`` by the names that ``cut_options`` gives them."""

    program: Path
    machine: str
    unit: str | None
    model: str
    compensated: bool
    out: Path | None
    json: Path | None
    page: Path | None
    compensate: Path | None
    cut: Mapping[str, Any]

    @property
    def options(self) -> "CutOptions | None":
        """The options of a cut, None where nothing is said of one.

        Raises
        ------
        ValueError
            When only a part of what a cut needs is said, or a value is out of its range.
        """
        given = dict(self.cut)
        limits = given.pop("limits")
        if all(value is None or value == () for value in (*given.values(), *limits.values())):
            return None
        from pipeline.app.cut import cut_options

        return cut_options(**self.cut)


def simulate_and_write(
    request: SimulateRequest, standard: Path | None
) -> tuple[Simulated, dict[str, Any]]:
    """Simulate a program and write what was asked for; its document.

    Parameters
    ----------
    request : SimulateRequest
        The options.
    standard : Path or None
        File that goes to standard output, which no page can name.

    Raises
    ------
    ValueError
        When something named is not known, cannot be followed or cannot be written.
    """
    options = request.options
    read = options.files if options else ()
    check_outputs(
        request.program, request.json, request.out, request.page, request.compensate, inputs=read
    )
    with share_bar("planning") as share, step(f"planned {request.program}") as found:
        simulated = simulate_program(
            request.program, request.machine, request.unit, share, request.model,
            compensated=request.compensated,
        )  # fmt: skip
        found.add(f"{len(simulated.plan.path.moves)} moves, {simulated.plan.total:.1f} s")
    document = simulated_document(simulated, request.program.stem, request.machine)
    if options is not None:
        from pipeline.app.cut import cut_document

        with step("followed the cut"):
            document["cut"] = cut_document(simulated, request.machine, options)
    corrected = _corrected(simulated, request, document)
    with together():
        _write(simulated, corrected, document, request, standard)
    return simulated, document


def _corrected(
    simulated: Simulated, request: SimulateRequest, document: dict[str, Any]
) -> "CorrectedProgram | None":
    if request.compensate is None:
        return None
    from pipeline.app.correction import correct_simulated, correction_document

    with step("corrected the axes' commands"):
        corrected = correct_simulated(simulated, request.program, request.machine)
    document["correction"] = correction_document(corrected, request.compensate)
    return corrected


def _write(
    simulated: Simulated, corrected: "CorrectedProgram | None", document: dict[str, Any],
    request: SimulateRequest, standard: Path | None,
) -> None:  # fmt: skip
    if corrected is not None and request.compensate is not None:
        from pipeline.twin.corrected_program import write_corrected

        write_corrected(corrected, request.compensate)
    if request.json is not None:
        write_document(document, request.json)
    if request.out is not None:
        from pipeline.twin.simulation import write_trace

        with share_bar("writing positions") as share:
            write_trace(simulated.plan, request.out, share)
    if "cut" in document and request.page is not None:
        from pipeline.report.cut.page import SimulatedCut, write_cut_page

        shown = SimulatedCut(
            program=request.program.stem, machine=request.machine, origin=simulated.on.origin,
            cut=document["cut"], verdicts=document["verdicts"],
            time=planned_times(simulated.plan, request.program.stem),
        )  # fmt: skip
        write_cut_page(shown, request.page, None if request.json == standard else request.json)


def planned_times(plan: "Plan", name: str) -> "Program":
    """A planned program as its page draws it: times, and its moves."""
    import pyarrow as pa

    from pipeline.report.programs.moves import program_moves
    from pipeline.report.programs.simulated import Program
    from pipeline.schema.program import SimulatedProgram
    from pipeline.schema.structure import structured
    from pipeline.twin.simulation import block_table, summary

    times = structured(summary(plan, name), SimulatedProgram, name)
    table = pa.Table.from_pandas(block_table(plan), preserve_index=False)
    return Program(summary=times, moves=program_moves(table, times.origin_mm))


def simulate_lines(
    simulated: Simulated, document: dict[str, Any], request: SimulateRequest
) -> Iterator[str]:
    """What ``kerf simulate`` says of a program that was simulated."""
    yield from preflight_lines(simulated.checked, request.program, request.machine)
    yield from passed_over(request.program, simulated.on.setup)
    yield from simulated.plan.path.moves.notices
    yield from simulated_lines(document, request.program)
    if "correction" in document:
        from pipeline.app.correction import correction_lines

        yield from correction_lines(document["correction"])
    if "cut" in document:
        from pipeline.app.cut_lines import cut_lines

        yield from cut_lines(document["cut"])
