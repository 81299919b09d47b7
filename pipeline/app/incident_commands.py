"""Commands on the incidents of a machine: what is there, and its delivery."""

import os
import time
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

import pipeline.app.kerf as kerf
from pipeline.app.kerf import app, one_sentence
from pipeline.app.output import aligned, check_outputs, many, outputs

if TYPE_CHECKING:
    from pipeline.schema.incident import Incident, Monitored

ACTS, FAILED = 3, 1
"""Exit statuses: an incident is to act on; one was not delivered."""
SECRET = "KERF_WEBHOOK_SECRET"
"""Variable with the key of the webhook's signature."""
Since = Annotated[str, typer.Option(help="Only those that go on to this day or begin later.")]


@app.command(rich_help_panel=kerf.RECORDS)
def incidents(
    machine: kerf.Machine,
    since: Since = "",
    lines: Annotated[Path | None, typer.Option(help="JSON lines to write, - for output.")] = None,
    email: Annotated[Path | None, typer.Option(help="Text of an e-mail, - for output.")] = None,
    json: kerf.Json = None,
) -> None:
    """Incidents of MACHINE by its stage monitor; exit status 3 where one needs action."""
    from pipeline.monitoring.delivery import email_text
    from pipeline.schema.store import json_line, write_text

    with one_sentence(), outputs() as to:
        to.ready(json)
        found = _monitored(machine)
        some = _since(found, since)
        to.json([asdict(one) for one in some], json)
        texts = {lines: lambda: "".join(f"{json_line(one)}\n" for one in some),
                 email: lambda: email_text(_of_machine(some), machine, time.time())}  # fmt: skip
        for path, text in texts.items():
            if path is not None:
                file = to.file(path) or path
                check_outputs(None, file)
                write_text(text(), file)
        rows = [(one.severity, one.start[:16], one.end[:16], str(one.count), one.component,
                 one.title) for one in some]  # fmt: skip
        head = ("", "from", "to", "times", "where", "what")
        for line in aligned([head, *rows], words=6) if rows else ["no incident"]:
            to.say(line)
        for name, rule in found.rules.items():
            if rule.not_assessed:
                to.say(f"not assessed: {name.replace('_', ' ')}: {rule.not_assessed}")
    if any(one.severity == "act" for one in some):
        raise typer.Exit(ACTS)


def _of_machine(some: "list[Incident]") -> "list[Incident]":
    """Incidents of the machine; notes on operation are in the list alone."""
    return [one for one in some if one.severity != "note"]


@app.command(rich_help_panel=kerf.RECORDS)
def deliver(
    machine: kerf.Machine,
    webhook: Annotated[str, typer.Option(help="Address that takes a POST of JSON.")],
    since: Since = "",
    attempts: Annotated[int, typer.Option(help="Attempts for each incident.")] = 5,
    timeout: Annotated[float, typer.Option(help="Wait for an answer, s.")] = 10.0,
    json: kerf.Json = None,
) -> None:
    """Send MACHINE's incidents to a webhook, each once; signed with KERF_WEBHOOK_SECRET."""
    from pipeline.app.fleet import DATA
    from pipeline.monitoring.delivery import Webhook
    from pipeline.monitoring.delivery import deliver as deliver_incidents

    with one_sentence(), outputs() as to:
        to.ready(json)
        secret = os.environ.get(SECRET, "").encode()
        hook = Webhook(url=webhook, secret=secret, timeout_s=timeout, attempts=attempts)
        some = _of_machine(_since(_monitored(machine), since))
        sent = deliver_incidents(some, hook, DATA / f"delivered/{machine}.jsonl",
                                 now=time.time, wait=time.sleep)  # fmt: skip
        to.json([asdict(one) for one in sent], json)
        failed = [one for one in sent if one.result == "failed"]
        before = len(some) - len(sent)
        to.say(f"{many(len(sent) - len(failed), 'incident')} delivered to {hook.place}, "
               f"{before} before, {len(failed)} not")  # fmt: skip
        for one in failed:
            to.say(f"incident {one.incident} was not delivered in {many(one.attempts, 'attempt')}: "
                   f"{one.why}; mend that, then run it again: it sends what is left")  # fmt: skip
    if failed:
        raise typer.Exit(FAILED)


@app.command(rich_help_panel=kerf.MODELS)
def replay(
    machine: kerf.Machine,
    out: Annotated[Path, typer.Option(help="Folder of tables, replay.json and the page.")],
    first: Annotated[str, typer.Option("--from", help="First day of the plant, or a time.")],
    last: Annotated[str, typer.Option("--to", help="Last day, included, or a time.")],
    other: Annotated[
        str, typer.Option("--with", help="Span whose parameters are tried, DAY..DAY.")
    ] = "",
) -> None:
    """Name the sub-model that explains what was measured beside MACHINE's twin in a span."""
    from pipeline.app.output import check_folder
    from pipeline.app.page_record import made_by_command
    from pipeline.app.replay import REPLAY, lines, replayed
    from pipeline.app.replay_page import write_replay_page

    with one_sentence():
        check_folder(out)
        found = replayed(machine, first, last, other, out)
        made = made_by_command(machine, Path("data/champion") / machine, {}, [out / REPLAY])
        write_replay_page(found, out, out / "replay.html", made)
        for line in lines(found):
            typer.echo(line)


def _monitored(machine: str) -> "Monitored":
    from pipeline.app.fleet import DATA, check_machine
    from pipeline.schema.incident import Monitored
    from pipeline.schema.store import read_json

    check_machine(machine)
    remedy = f"run `dvc repro monitor@{machine}`"
    return read_json(DATA / f"incidents/{machine}.json", Monitored, remedy)


def _since(found: "Monitored", day: str) -> "list[Incident]":
    from pipeline.schema.days import is_day

    if day and not is_day(day):
        raise ValueError(f"--since {day} is no day: write it as 2026-03-09")
    return found.since(day)
