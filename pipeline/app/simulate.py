"""Simulation of a program by plan, cut and axes (`kerf simulate`)."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.app.check import preflight_lines
from pipeline.app.kerf import share_bar
from pipeline.app.output import check_outputs, label, step
from pipeline.app.programs import (
    CHAMPION,
    Controlled,
    Share,
    machine_control,
    machine_residual,
    needed_drives,
    passed_over,
    read_moves,
    verdict_lines,
)
from pipeline.machine.control.planner import Plan
from pipeline.parameters import structure
from pipeline.schema.bundle import BUNDLE, Bundle, bundle_words
from pipeline.schema.files import together
from pipeline.schema.program_cut import ProgramCut
from pipeline.schema.store import read_json, unstructured, write_json
from pipeline.submodels.contract import submodel
from pipeline.twin.control import (
    ControlModelFile,
    planned_program,
    read_controls,
    time_interval,
)
from pipeline.twin.drive import read_drives
from pipeline.twin.preflight import Preflight
from pipeline.twin.program_axes import program_figures
from pipeline.twin.simulation import (
    block_table,
    blocks,
    program_times,
    summary,
    without_time,
    write_trace,
)

if TYPE_CHECKING:
    from pipeline.app.cut import CutOptions
    from pipeline.report.programs.simulated import Program
    from pipeline.twin.command_correction import CorrectedProgram
    from pipeline.twin.program_axes import Residual

UNIT_TIME_SHARE = 0.02
"""Share of a program's time by which units of a machine differ where a choice is required [1]."""
WITHOUT_TIME = {
    "tool_change": "{} tool change(s) are done",
    "spindle_acceleration": "the spindle starts or stops {} time(s)",
}
"""Actions without a time, by the parameter of the control that would give it."""


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """Program on a machine; ``axes`` is the motion of each axis with a known drive.

    ``checked``: against travel, speeds, feeds and tool lengths; ``residual``: network used, by
    name.
    """

    plan: Plan
    axes: list[dict[str, Any]]
    on: Controlled
    checked: Preflight
    residual: "Residual | None" = None
    residual_name: str = ""

    @property
    def interval(self) -> tuple[float, float] | None:
        """90 % interval of the time of the program [s]; None where it is not known."""
        if not self.on.identified or self.interval_unknown:
            return None
        stored = read_json(self.on.models / "control/model.json", ControlModelFile)
        ends = stored.ends.get(self.on.unit, ())
        return time_interval(self.plan, stored.intervals, stored.conditions, ends)

    @property
    def interval_unknown(self) -> str:
        """Reason why the control's verdict leaves the time's 90 % interval open; else empty."""
        columns = submodel("control").unknown_columns(self.on.models / "control")
        return columns.get("program_time_low", "")

    @property
    def other_units(self) -> dict[str, float]:
        """Time of the program [s] on the other units, where the user named none."""
        on = self.on
        if on.chosen or not on.identified or len(on.units) < 2:
            return {}
        controls = read_controls(on.models / "control/model.json")
        moves = self.plan.path.moves
        return {
            unit: round(planned_program(moves, controls[unit]).total, 3)
            for unit in on.units if unit != on.unit and unit in controls
        }  # fmt: skip


def simulate_program(
    path: Path, machine: str, unit: str | None, share: Share, model: str = CHAMPION,
    *, with_residual: bool = False,
) -> Simulated:  # fmt: skip
    """Plan of the program at ``path`` by the control of ``machine``: the champion's, else conf/'s.

    ``unit``: one of several machines of a kind; its default one when None; ``with_residual``:
    whether following errors hold what the residual network adds to them.
    """
    on = machine_control(machine, unit, model)
    moves = read_moves(path, on.setup, share)
    residual, name = machine_residual(on) if with_residual else (None, "")
    plan = planned_program(moves, on.control)
    return Simulated(
        plan=plan, axes=axes_table(plan, on.models, residual), on=on, checked=on.preflight(moves),
        residual=residual, residual_name=name,
    )  # fmt: skip


def axes_table(
    plan: Plan, models: Path, residual: "Residual | None" = None
) -> list[dict[str, Any]]:
    """Following error [um] and command of each identified axis, in air.

    Also the greatest half-width of the error's 90 % interval [um]: of ``residual``, else of the
    drive.
    """
    found = models / "drive/model.json"
    if not found.exists():
        return []
    drives, lines = read_drives(found), plan.path.moves.line
    name, column = (
        ("drive", "following_error_low") if residual is None else ("following_residual", "low")
    )
    unknown = submodel(name).unknown_columns(models / name)
    why = {letter: unknown.get(f"{letter}_{column}", "") for letter in drives}
    axes: list[dict[str, Any]] = [
        {
            "axis": letter,
            "max_following_um": round(one.max_error * 1e6, 3),
            "at_line": int(lines[one.worst_row]),
            "rms_following_um": round(one.rms_error * 1e6, 3),
            "max_command": round(one.max_command, 3),
            "command_unit": one.command_unit,
            "half_width_90_um": None
            if why[letter] or one.half_width is None
            else round(1e6 * one.half_width, 3),
            "interval_unknown": why[letter],
        }
        for letter, one in program_figures(plan, drives, residual).items()
    ]
    axes += [
        {"axis": letter, "not_followed": drive.servo_reason or "no servo was identified"}
        for letter, drive in drives.items()
        if drive.servo is None
    ]
    return axes


def simulated_document(simulated: Simulated, name: str) -> dict[str, Any]:
    """The JSON of ``kerf simulate``: what it rests on, totals, and every block."""
    return (
        {"verdicts": simulated.on.used}
        | summary(simulated.plan, name)
        | {
            "machine": simulated.on.machine,
            "origin": simulated.on.origin,
            "control": simulated.on.source,
            "unit": simulated.on.unit,
            "total_time_90_s": simulated.interval,
            "interval_unknown": simulated.interval_unknown,
            "total_time_s_on_other_units": simulated.other_units,
            "models": simulated.on.models.as_posix(),
            "without_time": without_time(simulated.plan),
            "axes": simulated.axes,
            "preflight": unstructured(simulated.checked),
            "blocks": blocks(simulated.plan),
        }
        | ({"residual": simulated.residual_name} if simulated.residual_name else {})
    )


def simulated_lines(document: dict[str, Any], program: Path) -> Iterator[str]:
    """Lines of ``kerf simulate``: times by type, cause and tool, advice, following errors."""
    machine = document["machine"]
    assumed = f"as in conf/machine/{machine}.yaml, not identified: times unproven"
    source = "identified" if document["control"] == "identified" else assumed
    yield f"{program.name} on {machine}{label(document['origin'])}, control {source}"
    if "/champion/" not in document["models"]:
        yield f"with {document['models']}, not with the champion"
    yield from verdict_lines(document["verdicts"])
    others = document["total_time_s_on_other_units"]
    if others:
        told = ", ".join(f"{unit} {seconds:.1f} s" for unit, seconds in others.items())
        own = document["total_time_s"]
        widest = max(abs(seconds - own) for seconds in others.values())
        asked = widest > UNIT_TIME_SHARE * own
        yield (
            f"{'warning: ' * asked}on unit {document['unit']}, the default one"
            f"{', which matters here: name yours' * asked}; with --unit: {told}"
        )
    elif document["unit"]:
        yield f"on unit {document['unit']}"
    interval = document["total_time_90_s"]
    unknown = document["interval_unknown"]
    width = f" ({unknown})" if unknown else ""
    if interval:
        width = f" (90 % interval {interval[0]:.1f} to {interval[1]:.1f} s)"
    yield f"{document['total_time_s']:.1f} s{width}, {document['path_length_mm']:.1f} mm"
    for name, count in document["without_time"].items():
        yield (
            f"warning: {WITHOUT_TIME[name].format(count)} in 0 s, since their time is not known: "
            f"give control.auxiliary.{name} in conf/machine/{machine}.yaml, or log such runs"
        )
    yield from _time_lines(document)
    if "residual" in document:
        yield f"following errors with {document['residual']}, half of the 90 % interval after ±"
    elif document["axes"]:
        yield "following errors of the drives' model, half of the 90 % interval after ±"
    for axis in document["axes"]:
        yield _axis_line(axis)


def _time_lines(document: dict[str, Any]) -> Iterator[str]:
    """Times by type, cause and tool, and advice on them."""
    for heading, table in (("type", document["by_type"]), ("cause", document["by_cause"])):
        for name, seconds in table.items():
            yield f"  {heading:<6} {name:<20} {seconds:>10.1f} s"
    for tool in document["by_tool"]:
        name = f"T{tool['tool']}" if tool["tool"] >= 0 else "none yet"
        yield f"  {'tool':<6} {name:<20} {tool['time_s']:>10.1f} s"
    for one in document["advice"]:
        yield f"  would save {one['seconds']:.1f} s: {one['what']}, if {one['assumes']}"


def _axis_line(axis: dict[str, Any]) -> str:
    if "not_followed" in axis:
        return f"  axis   {axis['axis']} not followed: {axis['not_followed']}"
    width = axis["half_width_90_um"]
    lacking = axis["interval_unknown"] or "interval not learnt"
    within = f" ({lacking})" if width is None else f" ± {width:.1f} um"
    return (
        f"  {'axis':<6} {axis['axis'] + ' behind by up to':<20} "
        f"{axis['max_following_um']:>10.1f} um{within} in line {axis['at_line']}, "
        f"{axis['rms_following_um']:.1f} um RMS, draws up to {axis['max_command']:.1f} "
        f"{axis['command_unit']}"
    )


@dataclass(frozen=True, kw_only=True)
class SimulateRequest:
    """All options of ``kerf simulate``."""

    program: Path
    machine: str
    unit: str | None
    model: str
    with_residual: bool
    out: Path | None
    json: Path | None
    page: Path | None
    corrected_to: Path | None
    cut: "CutOptions | None"
    """Blank, tools and material; None where nothing is said of a cut."""


def simulate_and_write(
    request: SimulateRequest, standard: Path | None
) -> tuple[Simulated, dict[str, Any]]:
    """Simulate a program and write the requested files; its document."""
    options = request.cut
    read = options.files if options else ()
    check_outputs(
        request.program, request.json, request.out, request.page, request.corrected_to, inputs=read
    )
    with share_bar("planning") as share, step(f"planned {request.program}") as found:
        simulated = simulate_program(
            request.program, request.machine, request.unit, share, request.model,
            with_residual=request.with_residual,
        )  # fmt: skip
        found.add(f"{len(simulated.plan.path.moves)} moves, {simulated.plan.total:.1f} s")
    document = simulated_document(simulated, request.program.stem)
    if options is not None:
        with step("followed the cut"):
            document["cut"] = _cut(simulated, request.program, options)
    corrected = _corrected(simulated, request, document)
    with together():
        _write(simulated, corrected, document, request, standard)
    return simulated, document


def _cut(simulated: Simulated, program: Path, options: "CutOptions") -> ProgramCut:
    """Cut of the program, with tools as worn as they are known to be."""
    from pipeline.app.cut import request_of
    from pipeline.optimisation.document import cut_document
    from pipeline.optimisation.job import job_of
    from pipeline.twin.cut.loads import cut_program

    on, plan = simulated.on, simulated.plan
    settings = replace(on.optimisation, wear="known", with_residual=False)
    job = job_of(request_of(on, program, options, settings, plan.path.moves))
    job = replace(job, models=replace(job.models, residual=simulated.residual))
    return cut_document(cut_program(plan, job.cut), job, simulated.checked)


def _corrected(
    simulated: Simulated, request: SimulateRequest, document: dict[str, Any]
) -> "CorrectedProgram | None":
    """Corrected command of the program's axes, noted in the document."""
    if request.corrected_to is None:
        return None
    from pipeline.submodels.following_residual.model import residual_of
    from pipeline.twin.command_correction import (
        CommandCorrectionSettings,
        CorrectedProgram,
        corrected_program,
    )

    on, plan = simulated.on, simulated.plan
    drives = read_drives(needed_drives(on, "--corrected"))
    with step("corrected the axes' commands"):
        residual, words = residual_of(on.models)
        settings = structure(on.parameters, "command_correction", CommandCorrectionSettings)
        axes, cutting = corrected_program(plan, drives, residual, settings=settings)
    corrected = CorrectedProgram(
        machine=on.machine, origin=on.origin, program=request.program.stem,
        champion=_champion(on.models, on.machine), residual=words, total=plan.total, axes=axes,
        cutting=cutting,
    )  # fmt: skip
    document["correction"] = {
        "file": request.corrected_to.as_posix(), "champion": corrected.champion,
        "residual": words, "axes": corrected.figures,
    }  # fmt: skip
    return corrected


def _champion(models: Path, machine: str) -> str:
    """The bundle in ``models``, and the version as which it serves."""
    from pipeline.champions.serving import chosen_champion

    entry = chosen_champion(machine)
    stored = models / BUNDLE
    if entry is None or not stored.exists() or read_json(stored, Bundle).sha256 != entry.bundle:
        return bundle_words(models)
    return f"version {entry.version}, {bundle_words(models)}"


def _write(
    simulated: Simulated, corrected: "CorrectedProgram | None", document: dict[str, Any],
    request: SimulateRequest, standard: Path | None,
) -> None:  # fmt: skip
    if corrected is not None and request.corrected_to is not None:
        from pipeline.twin.command_correction import write_corrected

        write_corrected(corrected, request.corrected_to)
    if request.json is not None:
        write_json(document, request.json)
    if request.out is not None:
        with share_bar("writing positions") as share:
            write_trace(simulated.plan, request.out, share)
    if "cut" in document and request.page is not None:
        from pipeline.app.page_record import made_by_command
        from pipeline.report.cut.page import write_cut_page

        shown = _shown(simulated, document, request.program.stem)
        made = made_by_command(
            simulated.on.machine, simulated.on.models, simulated.on.sections,
            [request.program, *(request.cut.files if request.cut else ())],
        )  # fmt: skip
        source = None if request.json == standard else request.json
        write_cut_page(shown, request.page, source, made)


def _shown(simulated: Simulated, document: dict[str, Any], name: str) -> "Program":
    """The program with its cut as its page draws it."""
    import pyarrow as pa

    from pipeline.report.programs.moves import program_moves
    from pipeline.report.programs.simulated import Program

    times = replace(
        program_times(simulated.plan, name), machine=simulated.on.machine,
        origin=simulated.on.origin, total_time_90_s=document["total_time_90_s"],
    )  # fmt: skip
    table = pa.Table.from_pandas(block_table(simulated.plan), preserve_index=False)
    return Program(
        summary=times, moves=program_moves(table, times.origin_mm), cut=document["cut"],
        verdicts=document["verdicts"],
    )  # fmt: skip


def simulate_lines(
    simulated: Simulated, document: dict[str, Any], request: SimulateRequest
) -> Iterator[str]:
    """Lines of ``kerf simulate`` on a simulated program."""
    yield from preflight_lines(simulated.checked, request.program, request.machine)
    yield from passed_over(request.program, simulated.on.setup)
    yield from simulated.plan.path.moves.notices
    yield from simulated_lines(document, request.program)
    if "correction" in document:
        yield from correction_lines(document["correction"])
    if "cut" in document:
        from pipeline.app.cut import cut_lines

        yield from cut_lines(document["cut"])


def correction_lines(document: dict[str, Any]) -> Iterator[str]:
    """Following error as predicted, before and after correction, in lines of ``kerf simulate``."""
    from pipeline.twin.command_correction import correction_table

    yield f"corrected command in {document['file']}, residual network: {document['residual']}"
    yield "following error as predicted:"
    yield from (f"  {line}" for line in correction_table(document["axes"]))
    most = max(one["max_after_um"] for one in document["axes"])
    yield (
        f"rapids are commanded as planned: there an axis stays behind by up to {most:.0f} um; the "
        "correction fades out after a cut and in before the next, for all axes alike"
    )
