"""``kerf …``: what a person does by hand."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="The digital twin of a machine tool that rebuilds itself from the machine's own records.",
)

Machine = Annotated[str, typer.Argument(help="As in conf/machine/.")]


@contextmanager
def _one_sentence() -> Iterator[None]:
    """Bad input ends in one sentence and exit status 2, not in a traceback."""
    try:
        yield
    except (ValueError, OSError) as error:
        typer.echo(f"kerf: {error}", err=True)
        raise typer.Exit(2) from error


@contextmanager
def _progress(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A bar on standard error when a person looks, nothing in a log."""
    if not sys.stderr.isatty():
        yield lambda name: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)

        def advance(name: str) -> None:
            bar.update(task, advance=1, description=f"{what} {name}")

        yield advance


@contextmanager
def _share(what: str) -> Iterator[Callable[[float], None]]:
    """A bar that is told which share is done, on standard error when a person looks."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda done: bar.update(task, completed=done)


@app.command()
def ingest(
    files: Annotated[list[Path], typer.Argument(help="Logs, documents, tables.")],
    machine: Annotated[str, typer.Option(help="Whose records these are, as in conf/machine/.")],
    out: Annotated[Path, typer.Option(help="Folder to write Parquet into.")],
) -> None:
    """Read FILES into Parquet; say how many records were read, kept and rejected."""
    from pipeline.commands.fleet import ingest_files

    with _one_sentence(), _progress("reading", len(files)) as advance:
        results = ingest_files(files, machine, out, advance)
    names = [typer.format_filename(r.path) for r in results]
    width = max(map(len, names))
    typer.echo(f"{'file':<{width}}  {'read':>10}  {'kept':>10}  {'rejected':>10}")
    for name, r in zip(names, results, strict=True):
        typer.echo(f"{name:<{width}}  {r.read:>10}  {r.kept:>10}  {r.rejected:>10}")
    rejected = sum(r.rejected for r in results)
    if rejected:
        typer.echo(f"{rejected} rejected, each with its reason in {out / 'rejected.parquet'}")
    for name, r in zip(names, results, strict=True):
        for said in filter(None, (r.reason, r.note)):
            typer.echo(f"kerf: {name}: {said}", err=True)
    if any(r.reason for r in results):
        raise typer.Exit(2)


@app.command()
def status() -> None:
    """Show the machines of the fleet, their champions and what the golden week said."""
    from pipeline.commands.fleet import fleet_status

    with _one_sentence():
        rows = fleet_status()
    columns = list(rows[0]) if rows else []
    widths = {c: max(len(c), *(len(r[c]) for r in rows)) for c in columns}
    for row in [{c: c for c in columns}, *rows]:
        typer.echo("  ".join(f"{row[c]:<{widths[c]}}" for c in columns).rstrip())


@app.command()
def report(
    out: Annotated[Path, typer.Option(help="Folder to write the pages into.")] = Path("reports"),
) -> None:
    """Write the report of the fleet from what stands in data/."""
    from pipeline.commands.fleet import write_report

    with _one_sentence():
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
    from pipeline.commands.fleet import collect, use_fleet

    with _one_sentence():
        chosen = use_fleet(name)
        typer.echo(f"fleet {chosen.name}: {', '.join(chosen.machines)}")
        if recordings is not None:
            for machine, new, files in collect(chosen, recordings):
                typer.echo(f"{machine}: {files} files, {new} new")


@app.command()
def golden(
    machine: Machine,
    first: Annotated[str, typer.Option(help="First UTC day, YYYY-MM-DD.")],
    last: Annotated[str, typer.Option(help="Last UTC day, YYYY-MM-DD.")],
) -> None:
    """Freeze a golden week of MACHINE: no model may learn from it, every model is judged on it."""
    from pipeline.commands.fleet import freeze_golden

    with _one_sentence():
        frozen = freeze_golden(machine, first, last)
    typer.echo(f"froze {len(frozen.files)} files, sha256 {frozen.sha256[:12]}")


@app.command()
def promote(machine: Machine) -> None:
    """Make MACHINE's challenger its champion, if it passed the golden week."""
    from pipeline.registry import promote as promote_challenger

    with _one_sentence():
        version = promote_challenger(machine)
    typer.echo(f"{machine}: version {version.version} is champion")


Program = Annotated[Path, typer.Argument(help="A part program.")]


@app.command()
def interpret(
    program: Program,
    out: Annotated[Path, typer.Option(help="CSV to write, a row a move.")],
    machine: Annotated[
        str | None, typer.Option(help="Whose offsets and tools hold, as in conf/machine/.")
    ] = None,
    dialect: Annotated[
        str | None, typer.Option(help="fanuc, linuxcnc or siemens; the machine's by default.")
    ] = None,
) -> None:
    """Follow PROGRAM block by block and write its moves."""
    from pipeline.commands.outputs import check_outputs
    from pipeline.commands.programs import machine_setup, moves_table, read_moves

    with _one_sentence(), _share("interpreting") as share:
        check_outputs(program, out)
        moves = read_moves(program, machine_setup(machine, dialect), share)
        moves_table(moves).to_csv(out, index=False)
    typer.echo(f"{len(moves)} moves, {moves.length.sum():.3f} mm, wrote {out}")


@app.command()
def simulate(
    program: Program,
    machine: Annotated[str, typer.Option(help="Whose control, as in conf/machine/.")],
    unit: Annotated[str | None, typer.Option(help="Which of several machines of a kind.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Parquet of positions at the interpolation period.")
    ] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of the times, block by block.")] = None,
    stock: Annotated[
        str | None,
        typer.Option(
            help="Blank to cut, in work coordinates [mm]: box:X0,X1,Y0,Y1,Z0,Z1, "
            "cylinder:X,Y,DIAMETER,Z0,Z1 or an .stl file."
        ),
    ] = None,
    tool_table: Annotated[
        str | None, typer.Option(help="Tools by number: a table of conf/tool/, or a YAML file.")
    ] = None,
    material: Annotated[
        str | None, typer.Option(help="Of the blank, as in conf/material/.")
    ] = None,
    limit_load: Annotated[
        float | None, typer.Option(help="Greatest load on a tool in the plane [N].")
    ] = None,
    resolution: Annotated[
        float | None, typer.Option(help="Of the blank [mm]; 0.2 by default.")
    ] = None,
    work_offset: Annotated[
        str | None, typer.Option(help="That the blank is measured in; that of the first cut.")
    ] = None,
    frf: Annotated[
        list[str] | None,
        typer.Option(help="Frequency response at the tools' tips: x=TIP.csv, y=TIP.csv or a UFF."),
    ] = None,
    page: Annotated[Path | None, typer.Option(help="HTML page of the cut.")] = None,
) -> None:
    """Plan PROGRAM as MACHINE's control does: how long each block takes, and why.

    With a blank, tools and its material also what the cut takes: load, power, stability, cost.
    """
    from pipeline.commands.cutting import cut_document, cut_options, write_page
    from pipeline.commands.cutting_lines import cut_lines
    from pipeline.commands.outputs import check_outputs
    from pipeline.commands.programs import (
        simulate_program,
        simulated_document,
        simulated_lines,
        write_document,
        write_trace,
    )

    with _one_sentence():
        options = cut_options(
            stock=stock, tool_table=tool_table, material=material, limit_load=limit_load,
            resolution=resolution, work_offset=work_offset, frf=frf or (), page=page,
        )  # fmt: skip
        check_outputs(program, json, out, page, inputs=options.files if options else ())
        with _share("planning") as share:
            simulated = simulate_program(program, machine, unit, share)
        document = simulated_document(simulated, program.stem, machine)
        if options is not None:
            document["cut"] = cut_document(simulated, machine, options)
        if json is not None:
            write_document(document, json)
        if out is not None:
            with _share("writing positions") as share:
                write_trace(simulated.plan, out, share)
        if page is not None:
            write_page(document, page, json)
    for line in simulated_lines(document, program):
        typer.echo(line)
    if options is not None:
        for line in cut_lines(document["cut"]):
            typer.echo(line)


def main() -> None:
    """Entry point of the command ``kerf``."""
    app()


if __name__ == "__main__":
    main()
