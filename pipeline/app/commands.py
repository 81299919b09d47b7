"""The commands of kerf, thin: their options are fields of settings that the rooms already have.

Each imports its work when it runs, so that `kerf --help` starts at once.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict
from functools import wraps
from inspect import Parameter, Signature, signature
from json import dumps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import pipeline.app.kerf as kerf
from pipeline.app.kerf import app, one_sentence, share_bar, stages_bar, steps_bar
from pipeline.app.output import Outputs, outputs, step
from pipeline.schema.limits import limit_options

if TYPE_CHECKING:
    from pipeline.app.fleet import FileResult


@contextmanager
def _working() -> Iterator[Outputs]:
    """Where a command with compiled loops writes; bad input is a sentence, compilation is said."""
    from pipeline.app.compiling import announced

    with one_sentence(), outputs() as to, announced():
        yield to


def _say_json(document: Any) -> None:
    typer.echo(dumps(document, indent=1, ensure_ascii=False))


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="Of the new project, or of one to bring up.")],
) -> None:
    """Make a project in FOLDER: conf/, dvc.yaml and DVC, run by the Kerf that is installed."""
    from pipeline.app.project import new_project

    with one_sentence():
        made = new_project(folder)
    typer.echo(f"{made} {folder}: `cd {folder}` and `dvc repro`")


@app.command()
def ingest(
    files: Annotated[list[Path], typer.Argument(help="Logs, documents, tables.")],
    machine: Annotated[str, typer.Option(help="Whose records these are, as in conf/machine/.")],
    out: Annotated[Path, typer.Option(help="Folder to write Parquet into.")],
    json: kerf.Json = False,
) -> None:
    """Read FILES into Parquet; say how many records were read, kept and rejected."""
    from pipeline.app.compiling import announced
    from pipeline.app.fleet import ingest_files

    with one_sentence(), announced(), step(f"read {len(files)} files") as found:
        with steps_bar("reading", len(files)) as advance:
            results = ingest_files(files, machine, out, advance)
        found.add(f"{sum(r.kept for r in results)} of {sum(r.read for r in results)} records kept")
    if json:
        _say_json([asdict(r) | {"path": str(r.path)} for r in results])
    else:
        _say_ingested(results, out)
    for r in results:
        for said in filter(None, (r.reason, r.note)):
            typer.echo(f"kerf: {typer.format_filename(r.path)}: {said}", err=True)
    if any(r.reason for r in results):
        raise typer.Exit(2)


def _say_ingested(results: "list[FileResult]", out: Path) -> None:
    names = [typer.format_filename(r.path) for r in results]
    width = max(map(len, names))
    typer.echo(f"{'file':<{width}}  {'read':>10}  {'kept':>10}  {'rejected':>10}")
    for name, r in zip(names, results, strict=True):
        typer.echo(f"{name:<{width}}  {r.read:>10}  {r.kept:>10}  {r.rejected:>10}")
    rejected = sum(r.rejected for r in results)
    if rejected:
        typer.echo(f"{rejected} rejected, each with its reason in {out / 'rejected.parquet'}")


@app.command()
def status(
    json: Annotated[bool, typer.Option("--json", help="Say it as JSON, a row a machine.")] = False,
) -> None:
    """Show the machines of the fleet, their champions and what the golden week said."""
    from pipeline.app.fleet import fleet_status

    with one_sentence():
        rows = fleet_status()
    if json:
        _say_json(rows)
        return
    columns = list(rows[0]) if rows else []
    widths = {c: max(len(c), *(len(r[c]) for r in rows)) for c in columns}
    for row in [{c: c for c in columns}, *rows]:
        typer.echo("  ".join(f"{row[c]:<{widths[c]}}" for c in columns).rstrip())


@app.command()
def report(
    out: Annotated[Path, typer.Option(help="Folder to write the pages into.")] = Path("reports"),
) -> None:
    """Write the report of the fleet from what stands in data/."""
    from pipeline.app.fleet import write_report

    with one_sentence():
        index = write_report(out)
    typer.echo(f"wrote {index}")


@app.command()
def fleet(
    name: Annotated[str, typer.Argument(help="As in conf/fleet/.")],
    recordings: Annotated[
        Path | None,
        typer.Option(
            help="Folder to collect the fleet's recordings from.", envvar="KERF_RECORDINGS"
        ),
    ] = None,
) -> None:
    """Make NAME the fleet that `dvc repro` builds, and collect its recordings."""
    from pipeline.app.fleet import collect, use_fleet

    with one_sentence():
        chosen = use_fleet(name)
        typer.echo(f"fleet {chosen.name}: {', '.join(chosen.machines)}")
        if recordings is not None:
            for machine, new, files in collect(chosen, recordings):
                typer.echo(f"{machine}: {files} files, {new} new")


@app.command()
def golden(
    machine: kerf.Machine,
    first: Annotated[str | None, typer.Option(help="First UTC day of logs, YYYY-MM-DD.")] = None,
    last: Annotated[str | None, typer.Option(help="Last UTC day of logs, YYYY-MM-DD.")] = None,
    files: Annotated[
        list[str] | None, typer.Option(help="Pattern of further raw files; may be repeated.")
    ] = None,
    sealed: Annotated[
        bool, typer.Option(help="Freeze the sealed set, which promotion alone looks at.")
    ] = False,
    json: kerf.Json = False,
) -> None:
    """Freeze MACHINE's golden set: no model is fitted on it, every sub-model is judged on it."""
    from pipeline.app.fleet import freeze_set, learnt_and_frozen

    with one_sentence():
        frozen = freeze_set(machine, first=first, last=last, files=files or (), sealed=sealed)
        warning = learnt_and_frozen(machine, frozen)
    if warning:
        typer.echo(f"kerf: {warning}", err=True)
    if json:
        which = "sealed" if sealed else "golden"
        _say_json({"machine": machine, "set": which, "sha256": frozen.sha256} | asdict(frozen))
        return
    typer.echo(f"froze {len(frozen.files)} files, sha256 {frozen.sha256[:12]}")


@app.command()
def promote(
    machine: kerf.Machine,
    why: Annotated[str, typer.Option(help="The reason, for champions.json.")],
    to: Annotated[
        int | None, typer.Option(help="Go back to this registered version, without a comparison.")
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Even when it is not shown to be better.")
    ] = False,
    json: kerf.Json = False,
) -> None:
    """Make MACHINE's newest bundle its champion, if it is better on the golden set."""
    from pipeline.champions import promote as promote_bundle

    with one_sentence():
        champion = promote_bundle(machine, why=why, to=to, anyway=anyway)
    if json:
        _say_json({"machine": machine} | asdict(champion))
        return
    typer.echo(f"{machine}: version {champion.version} is champion; commit champions.json")


@app.command()
def predict(
    machine: kerf.Machine,
    submodel: Annotated[str, typer.Argument(help="Which, as `kerf status` lists them.")],
    table: Annotated[Path, typer.Argument(help="Its inputs, CSV or Parquet.")],
    out: Annotated[Path, typer.Option(help="CSV or Parquet to write.")],
    model: kerf.Model = "champion",
) -> None:
    """Predict TABLE with a sub-model of MACHINE's champion."""
    from pipeline.app.programs import predict_table

    with one_sentence(), outputs() as to:
        file = to.file(out, ".csv") or out
        rows = predict_table(machine, submodel, table, file, model)
        to.say(f"wrote {rows} rows to {to.names(file)}")


@app.command()
def transfer(
    machine: kerf.Machine,
    golden: Annotated[str, typer.Option(help="Whose spindle parameters are expected here.")],
    out: Annotated[Path, typer.Option(help="JSON to write the curve into.")],
    between: Annotated[
        float, typer.Option(help="Relative spread of a parameter between machines of a type.")
    ] = 0.3,
    page: Annotated[Path | None, typer.Option(help="HTML page of the curve.")] = None,
) -> None:
    """Pool MACHINE's first minutes of warm-up with a golden machine's spindle parameters."""
    from pipeline.app.transfer import transfer_curve, transfer_table

    with one_sentence():
        found = transfer_curve(machine, golden, out, between, page)
    typer.echo("\n".join(transfer_table(found)))
    typer.echo(f"wrote {', '.join(str(path) for path in (out, page) if path is not None)}")


@app.command()
def compensation(
    machine: kerf.Whose,
    out: Annotated[Path, typer.Option(help="File to write.")],
    format: kerf.Format = "csv",
    model: kerf.Model = "champion",
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Even when the model failed or was not judged.")
    ] = False,
) -> None:
    """Write the correction of MACHINE's spindle growth as a file for its control."""
    from pipeline.app.compensation import said, write_compensation

    with one_sentence(), outputs() as to:
        file = to.file(out) or out
        done = write_compensation(machine, file, format, model, anyway=anyway)
        for line in said(done, Path(to.names(file)), format):
            to.say(line)


@app.command()
def wear(
    files: Annotated[list[Path], typer.Argument(help="Recordings of the cut.")],
    machine: kerf.Whose,
    conditions: Annotated[
        list[str] | None,
        typer.Option("--set", help="A condition that no record tells: name=value, again for more."),
    ] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of every reading.")] = None,
    model: kerf.Model = "champion",
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Even when the model failed or was not judged.")
    ] = False,
) -> None:
    """Tell the wear of the tools in FILES with its 90 % interval."""
    from pipeline.app.fleet import check_outputs
    from pipeline.app.wear import document, said, wear_of_files
    from pipeline.schema.store import write_json

    with one_sentence(), outputs() as to:
        file = to.file(json)
        check_outputs(None, file, inputs=files)
        told = wear_of_files(files, machine, model, conditions or (), anyway=anyway)
        if file is not None:
            write_json(document(told), file)
        for line in said(told):
            to.say(line)


@app.command()
def synthesise(
    machine: kerf.Whose,
    wear: Annotated[
        str | None, typer.Option(help="Of the tool: VB in um, or 1 worn and 0 not.")
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Another condition, name=value; may be repeated."),
    ] = None,
    n: Annotated[int, typer.Option("--n", help="Windows to make.")] = 100,
    seed: Annotated[int, typer.Option(help="Of the noise.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Parquet or CSV of the windows.")] = None,
    explain: Annotated[
        Path | None, typer.Option(help="Recording whose wear is sought, CSV or Parquet.")
    ] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of what --explain found.")] = None,
    model: kerf.Model = "champion",
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Even when the model failed or was not judged.")
    ] = False,
) -> None:
    """Make signals of MACHINE at a wear of the tool, or say which wear explains a recording."""
    import pipeline.app.synthesise as work

    with one_sentence():
        if (explain is None) == (out is None):
            raise ValueError("give --out for windows to make, or --explain for a recording")
        if json is not None and explain is None:
            raise ValueError("--json holds what --explain finds: give a recording with it")
        words = work.pairs([*(set_ or ()), *([] if wear is None else [f"wear={wear}"])])
        served = work.served_of(machine, model, anyway=anyway)
        if explain is not None:
            lines = work.explained_lines(work.explained(served, explain, words, json), served)
        elif out is not None:
            made, rows = work.synthesise(served, words, n, seed, out)
            lines = work.made_lines(made, rows, out)
    for line in lines:
        typer.echo(line)


@app.command()
def interpret(
    program: kerf.Program,
    out: Annotated[Path, typer.Option(help="CSV to write, a row a move.")],
    machine: kerf.Setup = None,
    dialect: kerf.Dialect = None,
) -> None:
    """Follow PROGRAM block by block and write its moves."""
    from pipeline.app.fleet import check_outputs
    from pipeline.app.moves_table import write_moves
    from pipeline.app.programs import machine_setup, passed_over, read_moves

    with _working() as to:
        file = to.file(out, ".csv") or out
        check_outputs(program, file)
        setup = machine_setup(machine, dialect)
        notes = list(passed_over(program, setup))
        with share_bar("interpreting") as share, step(f"followed {program}") as found:
            moves = read_moves(program, setup, share)
            found.add(f"{len(moves)} moves")
        with step(f"wrote {to.names(file)}"):
            length = write_moves(moves, file)
        for note in notes:
            to.say(note)
        to.say(f"{len(moves)} moves, {length:.3f} mm, wrote {to.names(file)}")


@app.command()
def simulate(
    program: kerf.Program,
    machine: kerf.Whose,
    unit: kerf.Unit = None,
    out: Annotated[
        Path | None, typer.Option(help="Parquet of positions at the interpolation period.")
    ] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of the times, block by block.")] = None,
    stock: kerf.Stock = None,
    tool_table: kerf.ToolTable = None,
    material: kerf.Material = None,
    limit_load: kerf.Load = None,
    resolution: kerf.Resolution = None,
    work_offset: kerf.WorkOffset = None,
    frf: kerf.Responses = None,
    wear: kerf.Wear = None,
    page: Annotated[Path | None, typer.Option(help="HTML page of the cut.")] = None,
    compensate: Annotated[
        Path | None, typer.Option(help="CSV of commands with which the axes err least.")
    ] = None,
    compensated: kerf.Compensated = False,
    model: kerf.Model = "champion",
) -> None:
    """Plan PROGRAM as MACHINE's control does: how long each block takes, and why.

    With a blank, tools and its material also what the cut takes: load, power, stability, cost.
    """
    from pipeline.app.simulate import SimulateRequest, simulate_and_write, simulate_lines

    with _working() as to:
        request = SimulateRequest(
            program=program, machine=machine, unit=unit, model=model, compensated=compensated,
            out=to.file(out, ".parquet"), json=to.file(json), page=to.file(page),
            compensate=to.file(compensate, ".csv"),
            cut={
                "stock": stock, "tool_table": tool_table, "material": material,
                "limits": {"load_N": limit_load}, "resolution": resolution,
                "work_offset": work_offset, "frf": frf or (), "page": page, "wear": wear or (),
            },
        )  # fmt: skip
        for line in simulate_lines(*simulate_and_write(request, to.taken), request):
            to.say(line)


@app.command()
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
    json: kerf.Json = False,
) -> None:
    """Prove that AFTER differs from BEFORE in F and S words only, and in no move; else exit 1.

    It warns of F and S that changed very much and, with a machine, that are beyond its own.

    With a tool table it warns where a changed F or S leaves the range of the tool.

    With a material too it takes the catalogue's range where the table has none.
    """
    from pipeline.app.check import check_lines, check_programs, range_lines
    from pipeline.app.check_machine import machine_lines

    with _working():
        if material is not None and tool_table is None:
            raise ValueError(
                "--material is given without --tool-table: name a table of conf/tool/ or a YAML "
                "file"
            )
        with step(f"compared {before} and {after}") as found:
            proof = check_programs(before, after, machine, dialect, splits=splits)
            found.add(f"{proof.moves} moves, {len(proof.differences)} F and S words")
        warnings: list[str] = []
        if proof.same:
            warnings += machine_lines(before, after, machine, dialect)
        if proof.same and tool_table is not None:
            warnings += range_lines(before, after, machine, dialect, tool_table, material)
    if json:
        _say_json(asdict(proof) | {"warnings": warnings})
    else:
        for line in (*check_lines(proof, before, after), *warnings):
            typer.echo(line)
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
            metavar={float: None, list[str]: "T5|120-180|WORD"}.get(kind, "LOW HIGH"),
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


@app.command()
@_with_limits
def optimise(
    *,
    program: kerf.Program,
    machine: kerf.Whose,
    objective: kerf.Objective = "time",
    out: Annotated[Path | None, typer.Option(help="Program to write.")] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of what was found.")] = None,
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
    seed: Annotated[int | None, typer.Option(help="Of all chance.")] = None,
    proof_comment: Annotated[
        bool,
        typer.Option("--proof-comment", help="The proof's hash in a comment at the program's end."),
    ] = False,
    compensated: kerf.Compensated = False,
) -> None:
    """Make PROGRAM faster or cheaper inside its limits; only F and S words change.

    Ctrl-C ends the search and writes the best so far.
    """
    from pipeline.app.fleet import check_outputs
    from pipeline.app.optimise import (
        PartFiles,
        PartRequest,
        SearchOptions,
        interruptible,
        optimise_part,
        part_options,
        write_optimised,
    )
    from pipeline.app.optimise_lines import optimise_lines

    with _working() as to:
        files = PartFiles.of(to.file(out, program.suffix), to.file(json), to.file(page))
        request = PartRequest(
            program=program, machine=machine, unit=unit, objective=objective,
            cut=part_options(
                stock=stock, tool_table=tool_table, material=material, limits=limits,
                resolution=resolution, work_offset=work_offset, frf=frf, wear=wear,
            ),
            model=model,
            search=SearchOptions(
                epsilon=epsilon, seed=seed, split=split, speeds=speeds,
                proof_comment=proof_comment, compensated=compensated,
            ),
        )  # fmt: skip
        check_outputs(program, *files.named, inputs=request.cut.files)
        try:
            with interruptible(_ending) as ending:  # the best so far is written whole too
                with stages_bar() as shown, step(f"optimised {program}"):
                    result, part = optimise_part(request, lambda w, s: (shown(w, s), ending())[1])
                written = write_optimised(result, part, files)
        except KeyboardInterrupt as error:
            typer.echo("kerf: interrupted, nothing is written", err=True)
            raise typer.Exit(130) from error
        for line in optimise_lines(part):
            to.say(line)
        to.say(f"wrote {to.names(*written)}")
    if part.interrupted:
        raise typer.Exit(130)


def _ending() -> None:
    typer.echo("kerf: ending with the best so far; Ctrl-C again to give up", err=True)
