"""Commands for one's own machine: its file proposed, its records listed."""

from pathlib import Path
from typing import Annotated

import typer

import pipeline.app.kerf as kerf
from pipeline.app.kerf import app, one_sentence
from pipeline.app.output import outputs

machine_app = typer.Typer(no_args_is_help=True, help="Machines of one's own.")
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
    json: kerf.Json = None,
) -> None:
    """Show what MACHINE's records hold, item by item, as the last `dvc repro` read them."""
    from pipeline.app.machine import records_of
    from pipeline.app.records import document, lines

    with one_sentence(), outputs() as to:
        rows = records_of(machine)
        to.json(document(rows), json)
        for line in lines(rows):
            to.say(line)
