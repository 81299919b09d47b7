"""Commands for the fleet: its records, state, report, golden weeks, champions."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.kerf import app
from pipeline.cli.options import Machine
from pipeline.cli.progress import one_sentence, steps_bar


@app.command()
def ingest(
    files: Annotated[list[Path], typer.Argument(help="Logs, documents, tables.")],
    machine: Annotated[str, typer.Option(help="Whose records these are, as in conf/machine/.")],
    out: Annotated[Path, typer.Option(help="Folder to write Parquet into.")],
) -> None:
    """Read FILES into Parquet; say how many records were read, kept and rejected."""
    from pipeline.commands.fleet import ingest_files

    with one_sentence(), steps_bar("reading", len(files)) as advance:
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

    with one_sentence():
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
    from pipeline.commands.fleet import collect, use_fleet

    with one_sentence():
        chosen = use_fleet(name)
        typer.echo(f"fleet {chosen.name}: {', '.join(chosen.machines)}")
        if recordings is not None:
            for machine, new, files in collect(chosen, recordings):
                typer.echo(f"{machine}: {files} files, {new} new")


@app.command()
def golden(
    machine: Machine,
    first: Annotated[str | None, typer.Option(help="First UTC day of logs, YYYY-MM-DD.")] = None,
    last: Annotated[str | None, typer.Option(help="Last UTC day of logs, YYYY-MM-DD.")] = None,
    files: Annotated[
        list[str] | None, typer.Option(help="Pattern of further raw files; may be repeated.")
    ] = None,
    sealed: Annotated[
        bool, typer.Option(help="Freeze the sealed set, which promotion alone looks at.")
    ] = False,
) -> None:
    """Freeze MACHINE's golden set: no model is fitted on it, every sub-model is judged on it."""
    from pipeline.commands.fleet import freeze_set

    with one_sentence():
        frozen = freeze_set(machine, first=first, last=last, files=files or (), sealed=sealed)
    typer.echo(f"froze {len(frozen.files)} files, sha256 {frozen.sha256[:12]}")


@app.command()
def promote(machine: Machine) -> None:
    """Make MACHINE's challenger its champion, if it passed the golden week."""
    from pipeline.registry import promote as promote_challenger

    with one_sentence():
        version = promote_challenger(machine)
    typer.echo(f"{machine}: version {version.version} is champion")
