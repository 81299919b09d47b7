"""Simulation of a program by plan, cut and axes (`kerf simulate`)."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.app.kerf import share_bar
from pipeline.app.output import check_outputs, step
from pipeline.app.preflight import preflight_lines
from pipeline.app.programs import (
    Simulated,
    passed_over,
    simulate_program,
    simulated_document,
    simulated_lines,
)
from pipeline.schema.files import together
from pipeline.schema.store import write_json

if TYPE_CHECKING:
    from pipeline.app.cut import CutOptions
    from pipeline.machine.control.planner import Plan
    from pipeline.report.programs.simulated import Program
    from pipeline.twin.correction import CorrectedProgram


@dataclass(frozen=True, kw_only=True)
class SimulateRequest:
    """All options of ``kerf simulate``."""

    program: Path
    machine: str
    unit: str | None
    model: str
    compensated: bool
    out: Path | None
    json: Path | None
    page: Path | None
    compensate: Path | None
    cut: "CutOptions | None"
    """Blank, tools and material; None where nothing is said of a cut."""


def simulate_and_write(
    request: SimulateRequest, standard: Path | None
) -> tuple[Simulated, dict[str, Any]]:
    """Simulate a program and write the requested files; its document."""
    options = request.cut
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
    document = simulated_document(simulated, request.program.stem)
    if options is not None:
        from pipeline.app.cut import cut_document

        with step("followed the cut"):
            document["cut"] = cut_document(simulated, options)
    corrected = _corrected(simulated, request, document)
    with together():
        _write(simulated, corrected, document, request, standard)
    return simulated, document


def _corrected(
    simulated: Simulated, request: SimulateRequest, document: dict[str, Any]
) -> "CorrectedProgram | None":
    if request.compensate is None:
        return None
    from pipeline.app.correction import correct_simulated

    with step("corrected the axes' commands"):
        corrected = correct_simulated(simulated, request.program)
    document["correction"] = {
        "file": request.compensate.as_posix(), "champion": corrected.champion,
        "residual": corrected.residual, "axes": corrected.figures,
    }  # fmt: skip
    return corrected


def _write(
    simulated: Simulated, corrected: "CorrectedProgram | None", document: dict[str, Any],
    request: SimulateRequest, standard: Path | None,
) -> None:  # fmt: skip
    if corrected is not None and request.compensate is not None:
        from pipeline.twin.correction import write_corrected

        write_corrected(corrected, request.compensate)
    if request.json is not None:
        write_json(document, request.json)
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
    from pipeline.schema.program_cut import SimulatedProgram
    from pipeline.schema.store import structured
    from pipeline.twin.simulation import block_table, summary

    times = structured(summary(plan, name), SimulatedProgram, name)
    table = pa.Table.from_pandas(block_table(plan), preserve_index=False)
    return Program(summary=times, moves=program_moves(table, times.origin_mm))


def simulate_lines(
    simulated: Simulated, document: dict[str, Any], request: SimulateRequest
) -> Iterator[str]:
    """Lines of ``kerf simulate`` on a simulated program."""
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
