"""Commands on part programs, whose options are fields of settings, imported when they run."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial, wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any

import typer

import pipeline.app.kerf as kerf
from pipeline.app.kerf import app, one_sentence, share_bar, stages_bar
from pipeline.app.output import Outputs, check_outputs, outputs, step
from pipeline.schema.limits import BY_TOOL, limit_options

SETTINGS = {
    "parts.resolution_mm": "--resolution", "certainty.epsilon": "--epsilon",
    "certainty.seed": "--seed", "search.seed": "--seed", "grouping.speeds": "--speeds",
} | {
    f"{section}.{name}": words.option
    for name, _, words in limit_options()
    for section in ("limits.margins", "margins", "practice", "limits")
} | {f"tool.limit_{name}": f"--limit-{name.partition('_')[0]}" for name in BY_TOOL}  # fmt: skip
"""Option by the path of the setting that it gives."""


@contextmanager
def _working() -> Iterator[Outputs]:
    """Where a command with compiled loops writes; bad input is a sentence, compilation is said.

    A setting that is refused is named by the option that gave it, but for what stands in a file.
    """
    from pipeline.app.compiling import announced
    from pipeline.parameters import ParametersError

    with one_sentence(), outputs() as to, announced():
        try:
            yield to
        except ParametersError:
            raise
        except ValueError as error:
            said = str(error)
            for setting, option in SETTINGS.items():
                said = said.replace(f"{setting} =", option).replace(setting, option)
            raise ValueError(said) from error


@app.command(rich_help_panel=kerf.PROGRAMS)
def interpret(
    program: kerf.Program,
    out: Annotated[Path | None, typer.Option(help="CSV to write, a row a move.")] = None,
    machine: kerf.Setup = None,
    dialect: kerf.Dialect = None,
    at: Annotated[
        int | None, typer.Option(help="Line to restart at: say what is in force before it.")
    ] = None,
    json: kerf.Json = None,
) -> None:
    """Follow PROGRAM block by block and write its moves, or say what a restart at a line needs."""
    from pipeline.app.moves_table import ROWS_AT_ONCE, write_moves
    from pipeline.app.programs import (
        machine_setup,
        moves_in_parts,
        passed_over,
        program_at,
    )
    from pipeline.gcode.interpret import restart_at, restart_lines
    from pipeline.gcode.setup import setup_beside

    with _working() as to:
        if out is None and at is None:
            raise ValueError("--out is missing: name a CSV for the moves, or a line with --at")
        if json is not None and at is None:
            raise ValueError("--json is given without --at: --out holds the moves as CSV")
        if out is not None and out == json:
            raise ValueError(f"{out} is named for two outputs: name a file for each")
        setup = machine_setup(machine, dialect)
        if at is not None:
            found = restart_at(program_at(program), setup_beside(setup, program), at)
            to.json(asdict(found), json, program)
            to.say(*restart_lines(found))
        if out is None:
            return
        file = to.file(out, ".csv") or out
        check_outputs(program, file)
        notes = list(passed_over(program, setup))
        with share_bar("interpreting") as share, step(f"followed {program}") as taken:
            parts = moves_in_parts(program, setup, share, ROWS_AT_ONCE)
            count, length, notices = write_moves(parts, file)
            taken.add(f"{count} moves, wrote {to.names(file)}")
        to.say(*notes, *notices)
        to.say(f"{count} moves, {length:.3f} mm, wrote {to.names(file)}")


@app.command(rich_help_panel=kerf.PROGRAMS)
def simulate(
    program: kerf.Program,
    machine: kerf.Machine,
    unit: kerf.Unit = None,
    out: Annotated[
        Path | None, typer.Option(help="Parquet of positions at the interpolation period.")
    ] = None,
    json: kerf.Json = None,
    stock: kerf.Stock = None,
    tool_table: kerf.ToolTable = None,
    material: kerf.Material = None,
    limit_load: kerf.Load = None,
    resolution: kerf.Resolution = None,
    work_offset: kerf.WorkOffset = None,
    frf: kerf.Responses = None,
    wear: kerf.Wear = None,
    page: Annotated[Path | None, typer.Option(help="HTML page of the cut.")] = None,
    corrected_to: Annotated[
        Path | None,
        typer.Option("--corrected", help="CSV of commands with which the axes err least."),
    ] = None,
    with_residual: kerf.WithResidual = False,
    model: kerf.Model = "champion",
) -> None:
    """Plan PROGRAM as MACHINE's control does: how long each block takes, and why.

    With a blank, tools and its material also what the cut takes: load, power, stability, cost.
    """
    from pipeline.app.simulate import SimulateRequest, simulate_and_write, simulate_lines

    given = (stock, tool_table, material, limit_load, resolution, work_offset, frf, wear, page)
    with _working() as to:
        cut = None
        if any(value is not None for value in given):
            from pipeline.app.cut import cut_options  # it takes its time

            cut = cut_options(
                stock=stock, tool_table=tool_table, material=material, frf=frf,
                limits={"load_N": limit_load}, resolution=resolution, work_offset=work_offset,
                wear=wear, page=page,
            )  # fmt: skip
        request = SimulateRequest(
            program=program, machine=machine, unit=unit, model=model, with_residual=with_residual,
            out=to.file(out, ".parquet"), json=to.file(json), page=to.file(page),
            corrected_to=to.file(corrected_to, ".csv"), cut=cut,
        )  # fmt: skip
        to.say(*simulate_lines(*simulate_and_write(request, to.taken), request))


@app.command(rich_help_panel=kerf.PROGRAMS)
def preflight(
    program: kerf.Program,
    machine: kerf.Machine,
    dialect: kerf.Dialect = None,
    stock: kerf.Stock = None,
    tool_table: kerf.ToolTable = None,
    resolution: kerf.Resolution = None,
    work_offset: kerf.WorkOffset = None,
    json: kerf.Json = None,
) -> None:
    """Hold PROGRAM against MACHINE's travel, spindle speeds, feeds and tool lengths; else exit 1.

    With a blank and tools also shank and holder against the part, as it is when they pass.

    What machine and tool table do not list is named, not checked.
    """
    from pipeline.app.check import (
        Clearance,
        clearance_lines,
        preflight_lines,
        preflight_program,
    )

    with _working() as to:
        clearance = Clearance(stock, tool_table, resolution, work_offset)
        found = preflight_program(program, machine, dialect, clearance=clearance)
        to.json({"program": program.name, "machine": machine} | asdict(found), json, program)
        if not found.violations:
            to.say(f"{program.name} stays inside of what {machine} lists")
        to.say(*preflight_lines(found, program, machine), *clearance_lines(found))
    if found.violations:
        raise typer.Exit(1)


@app.command(rich_help_panel=kerf.PROGRAMS)
def check(
    before: Annotated[Path, typer.Argument(help="A part program.")],
    after: Annotated[Path, typer.Argument(help="The same with other feeds and speeds.")],
    machine: kerf.Setup = None,
    dialect: kerf.Dialect = None,
    splits: Annotated[
        bool, typer.Option(help="Let AFTER have more points on the path of straight cuts.")
    ] = False,
    tool_table: kerf.ToolTable = None,
    material: kerf.Material = None,
    stock: kerf.Stock = None,
    resolution: kerf.Resolution = None,
    work_offset: kerf.WorkOffset = None,
    json: kerf.Json = None,
) -> None:
    """Prove that AFTER differs from BEFORE in F and S words only, and in no move; else exit 1.

    It warns of F and S that changed very much and, with a machine, that are beyond its own.

    With a tool table it warns where a changed F or S leaves the range of the tool.

    With a material too it takes the catalogue's range where the table has none.

    With machine, tool table and blank it warns of a shank or holder that meets the part.
    """
    from pipeline.app.check import (
        Clearance,
        check_lines,
        check_programs,
        clearance_lines,
        machine_lines,
        preflight_lines,
        preflight_program,
        range_lines,
    )

    with _working() as to:
        if material is not None and tool_table is None:
            raise ValueError(
                "--material is given without --tool-table: name a table of conf/tool/ or a YAML "
                "file"
            )
        clearance = Clearance(stock, tool_table, resolution, work_offset)
        if stock is not None and machine is None:
            raise ValueError("--stock is given without --machine: name the machine that cuts it")
        with step(f"compared {before} and {after}") as found:
            proof, moves = check_programs(before, after, machine, dialect, splits=splits)
            found.add(f"{proof.moves} moves, {len(proof.differences)} F and S words")
        reach: list[str] = []
        if machine is not None:
            checked = preflight_program(
                after, machine, dialect, beside=before, clearance=clearance,
                moves=None if moves is None else moves[1],
            )  # fmt: skip
            reach += [*preflight_lines(checked, after, machine), *clearance_lines(checked)]
        warnings: list[str] = []
        if proof.same and moves is not None:
            warnings += machine_lines(after, moves)
        if proof.same and moves is not None and tool_table is not None:
            warnings += range_lines(after, moves, tool_table, material)
        document = asdict(proof) | {"warnings": [*reach, *warnings]}
        to.json(document, json, before, after)
        to.say(*reach, *check_lines(proof, before, after), *warnings)
    if not proof.same:
        raise typer.Exit(1)


def _limit(words: str) -> Any:
    return typer.Option(help=words, rich_help_panel="Limits")


def _with_limits(command: Callable[..., None]) -> Callable[..., None]:
    """The command with an option for each field of ``CutLimit`` in place of its ``limits``.

    The command gets a mapping of the fields' names to what was given, None where nothing was.
    """
    options, fields = [], {}
    for name, kind, words in limit_options():
        given = words.option.removeprefix("--").replace("-", "_")
        default = typer.Option(
            None, words.option, help=words.help, rich_help_panel="Limits",
            metavar="VALUE|T5=VALUE" if name in BY_TOOL
            else {float: None, list[str]: "T5|120-180|WORD"}.get(kind, "LOW HIGH"),
        )  # fmt: skip
        fields[given] = name
        options.append(
            Parameter(given, Parameter.KEYWORD_ONLY, default=default, annotation=kind | None)
        )

    @wraps(command)
    def optimised(**given: Any) -> None:
        limits = {name: given.pop(option) for option, name in fields.items()}
        command(**given, limits=limits)

    own = [one.replace(kind=Parameter.KEYWORD_ONLY)
           for one in signature(command).parameters.values()]  # fmt: skip
    place = [one.name for one in own].index("limits")
    every = [*own[:place], *options, *own[place + 1 :]]
    optimised.__signature__ = Signature(every)  # type: ignore[attr-defined]
    optimised.__annotations__ = {one.name: one.annotation for one in every}
    del optimised.__wrapped__
    return optimised


@app.command(rich_help_panel=kerf.PROGRAMS)
@_with_limits
def optimise(
    *,
    program: kerf.Program,
    machine: kerf.Machine,
    objective: kerf.Objective = "time",
    out: Annotated[Path | None, typer.Option(help="Program to write.")] = None,
    json: kerf.Json = None,
    page: Annotated[Path | None, typer.Option(help="HTML page of what was found.")] = None,
    unit: kerf.Unit = None,
    stock: kerf.Stock = None,
    tool_table: kerf.ToolTable = None,
    material: kerf.Material = None,
    resolution: kerf.Resolution = None,
    work_offset: kerf.WorkOffset = None,
    frf: kerf.Responses = None,
    wear: kerf.Wear = None,
    model: kerf.Model = "champion",
    limits: dict[str, Any],
    epsilon: Annotated[
        float | None, _limit("P(load > limit) at most; 0.01 by default, 0.5 takes nominal values.")
    ] = None,
    split: Annotated[
        bool, typer.Option("--split", help="Split long blocks where the cut changes.")
    ] = False,
    speeds: kerf.Speeds = None,
    seed: Annotated[int | None, typer.Option(help="Seed of all chance.")] = None,
    proof_comment: Annotated[
        bool,
        typer.Option("--proof-comment", help="The proof's hash in a comment at the program's end."),
    ] = False,
    with_residual: kerf.WithResidual = False,
) -> None:
    """Make PROGRAM faster or cheaper inside its limits; only F and S words change.

    Ctrl-C ends the search and writes the best so far.
    """
    from pipeline.app.check import beyond_lines, not_checked_lines
    from pipeline.app.cut import cut_options, request_of
    from pipeline.app.optimise import (
        SearchOptions,
        interruptible,
        optimise_lines,
        optimised_document,
        write_optimised,
    )
    from pipeline.app.page_record import made_by_command
    from pipeline.app.programs import machine_control
    from pipeline.optimisation.optimise import optimise_worn

    with _working() as to:
        written, *shown = to.file(out, program.suffix), to.file(json), to.file(page)
        if written is None:
            raise ValueError(
                "--out is missing: name a file for the optimised program, as OPTIMISED.nc"
            )
        cut = cut_options(
            stock=stock, tool_table=tool_table, material=material, limits=limits, frf=frf,
            resolution=resolution, work_offset=work_offset, wear=wear, objective=objective,
            alone=False,
        )  # fmt: skip
        search = SearchOptions(
            epsilon=epsilon, seed=seed, split=split, speeds=speeds, proof_comment=proof_comment,
            with_residual=with_residual,
        )  # fmt: skip
        check_outputs(program, written, *shown, inputs=cut.files)
        on = machine_control(machine, unit, model)
        request = request_of(on, program, cut, search.settings(on.optimisation))
        checked = on.preflight(request.moves)
        to.say(*beyond_lines(checked, program, machine))
        try:
            with interruptible(_ending) as ending:  # the best so far is written whole too
                with stages_bar() as bar, step(f"optimised {program}"):
                    result = optimise_worn(request, lambda w, s: (bar(w, s), ending())[1])
                    part = optimised_document(on, result, checked)
                read = [program, *cut.files]
                made = partial(made_by_command, machine, on.models, on.sections, read)
                write_optimised(result, part, made, written, *shown)
        except KeyboardInterrupt as error:
            typer.echo("kerf: interrupted, nothing is written", err=True)
            raise typer.Exit(130) from error
        to.say(*not_checked_lines(checked, machine), *optimise_lines(part))
        to.say(f"wrote {to.names(written, *shown)}")
    if part.interrupted:
        raise typer.Exit(130)


def _ending() -> None:
    typer.echo("kerf: ending with the best so far; Ctrl-C again to give up", err=True)


@app.command(rich_help_panel=kerf.RECORDS)
def chatter(
    file: Annotated[Path, typer.Argument(help="Recording of vibration, force or sound.")],
    teeth: Annotated[int, typer.Option(help="Number of teeth of the tool.", min=1)],
    speed: Annotated[str, typer.Option(help="Spindle speed, rev/min, or its column in FILE.")],
    channel: Annotated[
        list[str] | None, typer.Option(help="Column to use, again for more; all by default.")
    ] = None,
    rate: Annotated[float | None, typer.Option(help="Sampling rate, Hz, without a time.")] = None,
    machine: kerf.Setup = None,
    json: kerf.Json = None,
    page: Annotated[Path | None, typer.Option(help="HTML page of the verdict.")] = None,
) -> None:
    """Chatter in FILE, a recording of a cut, and speeds to try; exit status 3, not decided 1."""
    from pipeline.app.chatter import STATUSES, chatter_of, document, said

    with one_sentence(), outputs() as to:
        to.ready(json, file)
        check_outputs(None, page, inputs=(file,))
        found = chatter_of(file, teeth, speed, channels=channel or (), rate=rate, machine=machine)
        to.json(document(found), json)
        to.say(*said(found))
        if page is not None:
            from pipeline.app.chatter_page import write_chatter_page

            write_chatter_page(found, file, page)
    if status := STATUSES[found.verdict.verdict]:
        raise typer.Exit(status)
