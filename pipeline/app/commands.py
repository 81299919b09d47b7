"""Commands on records, fleet and models, imported when they run so that ``--help`` is quick."""

import secrets
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import pipeline.app.kerf as kerf
from pipeline.app.kerf import app, one_sentence, steps_bar
from pipeline.app.output import aligned, many, outputs, step

if TYPE_CHECKING:
    from pipeline.app.fleet import FileResult


@app.command(rich_help_panel=kerf.PROJECT)
def init(
    folder: Annotated[Path, typer.Argument(help="Folder of a project, new or to bring up.")],
) -> None:
    """Make a project in FOLDER: conf/, dvc.yaml and DVC, run by the Kerf that is installed."""
    from pipeline.app.project import new_project

    with one_sentence():
        made = new_project(folder)
    typer.echo(f"{made} {folder}: `cd {folder}` and `dvc repro`")


@app.command("compile", rich_help_panel=kerf.PROJECT)
def compile_ahead() -> None:
    """Compile the loops of builds and programs for this processor, once and on all cores."""
    from pipeline.app.compiling import compile_loops

    typer.echo(f"{compile_loops()} loops are compiled and kept")


@app.command(rich_help_panel=kerf.RECORDS)
def ingest(
    files: Annotated[list[Path], typer.Argument(help="Logs, documents, tables.")],
    machine: kerf.Machine,
    out: Annotated[Path, typer.Option(help="Folder to write Parquet into.")],
    json: kerf.Json = None,
) -> None:
    """Read FILES into Parquet; say how many records were read, kept and rejected."""
    from pipeline.app.compiling import announced
    from pipeline.app.fleet import ingest_files
    from pipeline.signals.store import strangers_said

    with one_sentence(), announced(), outputs() as to:
        to.ready(json, *files)
        with step(f"read {len(files)} files") as found, steps_bar("reading", len(files)) as advance:
            results = ingest_files(files, machine, out, advance)
            kept, read = sum(r.kept for r in results), sum(r.read for r in results)
            found.add(f"{kept} of {read} records kept")
        to.json([asdict(r) | {"path": typer.format_filename(r.path)} for r in results], json)
        to.say(*_ingested(results, out))
    for r in results:
        for said in filter(None, (r.reason, r.note)):
            typer.echo(f"kerf: {typer.format_filename(r.path)}: {said}", err=True)
    if strangers := strangers_said(out):
        typer.echo(f"kerf: {strangers}", err=True)
    if any(r.reason for r in results):
        raise typer.Exit(2)


def _ingested(results: "list[FileResult]", out: Path) -> Iterator[str]:
    rows = [
        (typer.format_filename(r.path), *map(str, (r.read, r.kept, r.rejected))) for r in results
    ]
    yield from aligned([("file", "read", "kept", "rejected"), *rows], words=1)
    rejected = sum(r.rejected for r in results)
    if rejected:
        yield f"{rejected} rejected, each with its reason in {out / 'rejected.parquet'}"


@app.command(rich_help_panel=kerf.PROJECT)
def status(json: kerf.Json = None) -> None:
    """Show the machines of the fleet, their champions and what the golden week said."""
    from pipeline.app.fleet import fleet_status

    with one_sentence(), outputs() as to:
        rows = fleet_status()
        to.json(rows, json)
        heads = list(rows[0]) if rows else []
        to.say(*aligned([heads, *([*row.values()] for row in rows)], words=len(heads)))


@app.command(rich_help_panel=kerf.PROJECT)
def report(
    out: Annotated[Path, typer.Option(help="Folder to write the pages into.")] = Path("reports"),
) -> None:
    """Write the report of the fleet from what stands in data/."""
    from pipeline.app.fleet import write_report

    with one_sentence():
        index = write_report(out)
    typer.echo(f"wrote {index}")


@app.command(rich_help_panel=kerf.PROJECT)
def verify(
    pages: Annotated[
        list[Path],
        typer.Argument(help="Pages of the report or of commands; Markdown, or folders of it."),
    ],
    sample: Annotated[
        int | None, typer.Option(help="Figures of each page to compare; all by default.", min=1)
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="Draw the figures of this seed again; a new one by default.")
    ] = None,
    json: kerf.Json = None,
) -> None:
    """Compute the figures of PAGES again from the files that they name; name what differs."""
    from pipeline.app.verify import said, verify_all

    with one_sentence(), outputs() as to:
        to.ready(json, *pages)
        seed = secrets.randbelow(10**6) if seed is None else seed
        found = verify_all(pages, sample, seed)
        to.json([asdict(one) for one in found], json)
        to.say(*said(found))
        if sample is not None:
            to.say(f"drawn by --seed {seed}")
    if any(one.failed for one in found):
        raise typer.Exit(1)


@app.command(rich_help_panel=kerf.PROJECT)
def fleet(
    name: Annotated[str, typer.Argument(help="Fleet, as in conf/fleet/.")],
    recordings: Annotated[
        Path | None,
        typer.Option(
            help="Folder to collect the fleet's recordings from.", envvar="KERF_RECORDINGS"
        ),
    ] = None,
) -> None:
    """Make NAME the fleet that `dvc repro` builds, and collect its recordings."""
    from pipeline.app.fleet import collect, fleet_named, use_fleet

    with one_sentence():
        chosen = fleet_named(name)
        copied = [] if recordings is None else list(collect(chosen, recordings))
        use_fleet(name)
        typer.echo(f"fleet {chosen.name}: {', '.join(chosen.machines)}")
        for machine, new, files in copied:
            typer.echo(f"{machine}: {files} files, {new} new")


@app.command(rich_help_panel=kerf.PROJECT)
def identify(
    machines: Annotated[
        list[str] | None, typer.Option("--machine", "-m", help="A machine, again for more; all.")
    ] = None,
    submodels: Annotated[
        list[str] | None, typer.Option("--submodel", help="A sub-model, again for more; all.")
    ] = None,
) -> None:
    """Identify what DVC calls out of date, all machines at once: here, or where KERF_COMPUTE says.

    `dvc repro` then finds these stages up to date and goes on from there.
    """
    from pipeline.app.cluster import identify_fleet

    with one_sentence():
        errors = identify_fleet(machines or (), submodels or (), typer.echo)
    for error in errors:
        typer.echo(f"kerf: {error}", err=True)
    if errors:
        raise typer.Exit(2)


@app.command(rich_help_panel=kerf.PROJECT)
def worker(
    scheduler: Annotated[str, typer.Argument(help="Its address, as tcp://10.0.0.5:8786.")],
    workers: Annotated[int, typer.Option(min=1, help="Processes, of one thread each.")] = 1,
) -> None:
    """Work for a Dask scheduler until it ends, in the project's folder on a shared disk."""
    from pipeline.app.cluster import work_for

    with one_sentence():
        work_for(scheduler, workers)


@app.command(rich_help_panel=kerf.RECORDS)
def golden(
    machine: kerf.Machine,
    first: Annotated[str | None, typer.Option(help="First day of logs, YYYY-MM-DD.")] = None,
    last: Annotated[str | None, typer.Option(help="Last day of logs, YYYY-MM-DD.")] = None,
    files: Annotated[
        list[str] | None,
        typer.Option(help="Pattern of further raw files, or of parts of tables; may be repeated."),
    ] = None,
    sealed: Annotated[
        bool, typer.Option(help="Freeze the sealed set, which promotion alone looks at.")
    ] = False,
    split: Annotated[
        bool, typer.Option("--split", help="Freeze both sets of all that nothing learns from.")
    ] = False,
    again: Annotated[
        bool, typer.Option("--again", help="In the place of a committed set, without a question.")
    ] = False,
    json: kerf.Json = None,
) -> None:
    """Freeze MACHINE's golden set: no model is fitted on it, every sub-model is judged on it.

    Without days and files it shows what is frozen, by sub-model.
    """
    from pipeline.app.frozen_cases import frozen_cases, frozen_text, split_sets
    from pipeline.app.golden_sets import chosen_set, freeze, learnt_and_frozen

    def asked(question: str) -> bool:
        return again or (sys.stdin.isatty() and typer.confirm(question, err=True))

    with one_sentence(), outputs() as to:
        to.ready(json)
        if split and (first or last or files or sealed):
            raise ValueError("--split freezes both sets of all records: give no days and no files")
        if split:
            split_sets(machine, asked)
        if not (first or last or files or sealed):
            found = frozen_cases(machine)
            to.json(found, json)
            to.say(*frozen_text(found))
            return
        frozen = chosen_set(machine, first=first, last=last, files=files or ())
        freeze(machine, {"sealed" if sealed else "golden": frozen}, asked)
        if warning := learnt_and_frozen(machine, frozen):
            typer.echo(f"kerf: {warning}", err=True)
        about = {"machine": machine, "set": "sealed" if sealed else "golden"}
        to.json(about | {"sha256": frozen.sha256} | asdict(frozen), json)
        to.say(f"froze {many(len(frozen.files), 'file')}, sha256 {frozen.sha256[:12]}")


@app.command(rich_help_panel=kerf.MODELS)
def nightly(
    machine: kerf.Machine,
    json: kerf.Json = None,
) -> None:
    """Score MACHINE's champion on the nights that it has not seen; exit status 3 where one asks."""
    from pipeline.app.nightly import ASKS, QUIET, lines, score
    from pipeline.schema.ledger import asks

    with one_sentence(), outputs() as to:
        to.ready(json)
        with kerf.progress_line(f"scoring the nights of {machine}"):
            nights = score(machine)
        to.json([asdict(one) for one in nights], json)
        to.say(*lines(machine, nights))
    raise typer.Exit(ASKS if asks(nights) else QUIET)


@app.command(rich_help_panel=kerf.MODELS)
def predict(
    machine: kerf.Machine,
    submodel: Annotated[str, typer.Argument(help="Sub-model, as `kerf status` lists them.")],
    table: Annotated[Path, typer.Argument(help="Table of its inputs, CSV or Parquet.")],
    out: Annotated[Path, typer.Option(help="CSV or Parquet to write.")],
    model: kerf.Model = "champion",
    anyway: kerf.Anyway = False,
) -> None:
    """Predict TABLE with a sub-model of MACHINE's champion."""
    from pipeline.app.programs import predict_table

    with one_sentence(), outputs() as to:
        file = to.file(out, ".csv") or out
        rows, unknown = predict_table(machine, submodel, table, file, model, anyway=anyway)
        to.say(f"wrote {many(rows, 'row')} to {to.names(file)}")
        to.say(*unknown)


@app.command(rich_help_panel=kerf.MODELS)
def transfer(
    machine: kerf.Machine,
    golden: Annotated[str, typer.Option(help="Machine whose spindle parameters are expected.")],
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


@app.command(rich_help_panel=kerf.MODELS)
def thermal_growth(
    machine: kerf.Machine,
    out: Annotated[Path, typer.Option(help="File to write.")],
    format: kerf.Format = "csv",
    model: kerf.Model = "champion",
    anyway: kerf.Anyway = False,
) -> None:
    """Write the correction of MACHINE's spindle growth as a file for its control."""
    from pipeline.app.thermal_growth import said, write_thermal_growth

    with one_sentence(), outputs() as to:
        file = to.file(out) or out
        done = write_thermal_growth(machine, file, format, model, anyway=anyway)
        to.say(*said(done, Path(to.names(file)), format))


@app.command(rich_help_panel=kerf.MODELS)
def wear(
    files: Annotated[list[Path], typer.Argument(help="Recordings of the cut.")],
    machine: kerf.Machine,
    conditions: kerf.Conditions = None,
    json: kerf.Json = None,
    model: kerf.Model = "champion",
    anyway: kerf.Anyway = False,
) -> None:
    """Estimate the wear of the tools in FILES with its 90 % interval."""
    from pipeline.app.wear import said, wear_of_files

    with one_sentence(), outputs() as to:
        to.ready(json, *files)
        told = wear_of_files(files, machine, model, conditions or (), anyway=anyway)
        to.json(asdict(told), json)
        to.say(*said(told))


@app.command(rich_help_panel=kerf.MODELS)
def synthesise(
    machine: kerf.Machine,
    wear: Annotated[
        str | None, typer.Option(help="Wear of the tool: VB in um, or 1 worn and 0 not.")
    ] = None,
    conditions: kerf.Conditions = None,
    n: Annotated[int, typer.Option("--n", help="Windows to make.")] = 100,
    seed: Annotated[int, typer.Option(help="Seed of the noise.")] = 0,
    out: Annotated[Path | None, typer.Option(help="Parquet or CSV of the windows.")] = None,
    explain: Annotated[
        Path | None, typer.Option(help="Recording whose wear is to be explained, CSV or Parquet.")
    ] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of the explanation.")] = None,
    model: kerf.Model = "champion",
    anyway: kerf.Anyway = False,
) -> None:
    """Make signals of MACHINE at a wear of the tool, or say which wear explains a recording."""
    import pipeline.app.synthesise as work

    with one_sentence():
        if (explain is None) == (out is None):
            raise ValueError("give --out for windows to make, or --explain for a recording")
        if json is not None and explain is None:
            raise ValueError("--json holds what --explain finds: give a recording with it")
        words = work.pairs([*(conditions or ()), *([] if wear is None else [f"wear={wear}"])])
        served = work.served_of(machine, model, anyway=anyway)
        if explain is not None:
            lines = list(work.explained_wear(served, explain, words, json))
        elif out is not None:
            lines = list(work.made_windows(served, words, n, seed, out))
    for line in lines:
        typer.echo(line)


machine_app = typer.Typer(cls=kerf.OneSentence, no_args_is_help=True, help="Machines of one's own.")
app.add_typer(machine_app, name="machine", rich_help_panel=kerf.RECORDS)


@machine_app.callback()
def _machine() -> None:
    """Machines of one's own."""


@machine_app.command()
def new(
    name: Annotated[str, typer.Argument(help="Name of the machine: letters, digits, _.")],
    devices: Annotated[
        Path | None, typer.Option(help="The agent's Devices document, if there is one.")
    ] = None,
    logs: Annotated[
        list[Path] | None,
        typer.Option(help="A log or table, or a folder of them; may be repeated."),
    ] = None,
    device: Annotated[str | None, typer.Option(help="Device of that document.")] = None,
    time_zone: Annotated[
        str, typer.Option(help="Time zone of the plant's days, as America/New_York.")
    ] = "UTC",
) -> None:
    """Propose conf/machine/NAME.yaml and conf/fleet/NAME.yaml, and say why each signal is what."""
    from pipeline.app.machine import write_machine

    with one_sentence():
        lines = write_machine(name, devices, logs or (), device, time_zone)
    for line in lines:
        typer.echo(line)


@machine_app.command()
def schema(
    out: Annotated[Path, typer.Option(help="Folder of the schemas.")] = Path("conf/schema"),
    page: Annotated[
        Path | None, typer.Option(help="Also write every setting and signal, in Markdown.")
    ] = None,
) -> None:
    """Write JSON Schema of the files in conf/, by which editors complete and check them."""
    from pipeline.app.json_schema import write_schemas
    from pipeline.app.settings_page import page as settings_page
    from pipeline.schema.store import write_text

    with one_sentence():
        written = write_schemas(out)
        if page is not None:
            write_text(settings_page(Path("conf")), page)
            written.append(page)
    for path in written:
        typer.echo(f"wrote {path}")


@app.command(rich_help_panel=kerf.RECORDS)
def records(
    machine: kerf.Machine,
    helpful: Annotated[
        bool, typer.Option("--next", help="Say what to record next for each sub-model instead.")
    ] = False,
    json: kerf.Json = None,
) -> None:
    """Show what MACHINE's records hold, item by item, as the last `dvc repro` read them."""
    from pipeline.app.records import lines, next_lines, next_of, records_of

    with one_sentence(), outputs() as to:
        if helpful:
            found = next_of(machine)
            to.json({name: [asdict(one) for one in some] for name, some in found.items()}, json)
            to.say(*next_lines(found))
            return
        rows = records_of(machine)
        to.json([asdict(row) for row in rows], json)
        to.say(*lines(rows))


@app.command("part-record", rich_help_panel=kerf.RECORDS)
def part_record(
    machine: kerf.Machine,
    out: Annotated[Path, typer.Option(help="Folder of the records, a JSON file a part.")],
    first: Annotated[str, typer.Option("--from", help="First day of the plant.")] = "",
    last: Annotated[str, typer.Option("--to", help="Last day, included.")] = "",
    program: Annotated[str, typer.Option(help="Parts of this program alone.")] = "",
) -> None:
    """Write how each finished part of MACHINE's log was made, beside what the twin says of it."""
    from pipeline.app.part_record import lines, records_of

    with one_sentence(), outputs() as to:
        found = records_of(machine, first, last, program)
        out.mkdir(parents=True, exist_ok=True)
        for one in found:
            path = out / f"{machine}_{one.start[:10]}_{one.cycle}.json"
            to.ready(path)
            to.json(asdict(one), path)
        to.say(*lines(found))
