"""Commands on the life of a model: promotion, rollback, history, deletion."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

import pipeline.app.kerf as kerf
from pipeline.app.kerf import app, one_sentence
from pipeline.app.output import aligned, outputs

if TYPE_CHECKING:
    from pipeline.schema.decision import Decision, Rule

Why = Annotated[str, typer.Option(help="The reason, for the machine's history.")]
COMMIT = "git add champions.json data/history, and commit them"


@app.command(rich_help_panel=kerf.MODELS)
def promote(
    machine: kerf.Machine,
    why: Why = "",
    to: Annotated[
        int | None, typer.Option(help="This registered version, not the newest bundle.")
    ] = None,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Even where the rules refuse it.")
    ] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Judge and say, without the sealed set or a change.")
    ] = False,
    json: kerf.Json = None,
) -> None:  # fmt: skip
    """Make MACHINE's newest bundle its champion; exit status 1 where the rules refuse it."""
    from pipeline.app.fleet import check_machine
    from pipeline.champions.promotion import RefusedError, decided, judged
    from pipeline.champions.promotion import promote as promote_bundle

    long = kerf.progress_line(f"judging the newest bundle of {machine} against what serves")
    with one_sentence(), outputs() as written, long:
        written.ready(json)
        check_machine(machine)
        if dry_run:
            decision = judged(machine, to=to, anyway=anyway)
            written.json(asdict(decision), json)
            written.say(*_rules(decision.rules), *_serves(decision))
            number = decision.challenger.version
            which = f"version {number}" if number else "the newest bundle, not registered yet,"
            may = "may serve" if decision.may_serve else "may not serve"
            may += " by the rules, and would with --anyway," if decision.overridden else ""
            written.say(f"{which} of {machine} {may} in the place of version "
                        f"{decision.champion.version} ({decision.origin} records); nothing was "
                        "changed")  # fmt: skip
        else:
            try:
                champion = promote_bundle(machine, why=why, to=to, anyway=anyway)
            except RefusedError as refused:
                decision = refused.decision
                written.json(asdict(decision), json)
                typer.echo(f"kerf: {refused}", err=True)
                for line in _rules(decision.against):
                    typer.echo(line, err=True)
            else:
                decision = decided(machine)
                written.json({"machine": machine} | asdict(champion), json)
                if decision.overridden:
                    written.say(f"{machine}: against the rules, by --anyway:")
                    written.say(*_rules(decision.against))
                written.say(*_serves(decision))
                written.say(f"{machine}: version {champion.version} is champion; {COMMIT}")
    if not decision.promoted:
        raise typer.Exit(1)


def _rules(rules: "Sequence[Rule]") -> Iterator[str]:
    """A line for each rule, indented: name, result, why."""
    rows = [(f"  {one.name}", one.result, one.sentence or "-") for one in rules]
    return aligned(rows, words=3) if rows else iter(())


def _serves(decision: "Decision") -> Iterator[str]:
    """What serves without having passed, and what does not serve."""
    machine = decision.machine
    if decision.anyway and not decision.overridden:
        yield f"{machine}: --anyway overrides nothing: it may serve by the rules"
    if decision.unproven:
        yield f"{machine}: serve without having passed: {decision.unproven}"
    if decision.idle:
        yield f"{machine}: do not serve: {decision.idle}"


@app.command(rich_help_panel=kerf.MODELS)
def rollback(
    machine: kerf.Machine,
    why: Why,
    to: Annotated[
        int | None, typer.Option(help="This version, which served once; the one before by default.")
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Even where it has not served for long.")
    ] = False,
    json: kerf.Json = None,
) -> None:
    """Make the version that served MACHINE before its champion again; again, one further back."""
    from pipeline.app.fleet import check_machine
    from pipeline.champions.promotion import rollback as roll_back
    from pipeline.champions.serving import history_of
    from pipeline.schema.history import served

    with one_sentence(), outputs() as written:
        written.ready(json)
        check_machine(machine)
        champion = roll_back(machine, why=why, to=to, force=force)
        written.json({"machine": machine} | asdict(champion), json)
        left = served(history_of(machine))[-2].version
        written.say(f"{machine}: version {champion.version} is champion again, in the place of "
                    f"version {left}; {COMMIT}")  # fmt: skip


@app.command(rich_help_panel=kerf.MODELS)
def history(
    machine: Annotated[
        str | None, typer.Option("--machine", "-m", help="Machine; every one by default.")
    ] = None,
    at: Annotated[
        str | None,
        typer.Option(help="Who served at 2026-03-01T06:00Z, or on the day 2026-03-01."),
    ] = None,
    json: kerf.Json = None,
) -> None:
    """Show which version served when, by whom and why."""
    from pipeline.app.history import history_rows

    with one_sentence(), outputs() as written:
        written.ready(json)
        rows = history_rows(machine, at)
        written.json(rows, json)
        heads = list(rows[0]) if rows else []
        written.say(*aligned([heads, *([*row.values()] for row in rows)], words=len(heads)))


@app.command(rich_help_panel=kerf.MODELS)
def delete(
    machine: kerf.Machine,
    version: Annotated[int, typer.Option("--version", help="Registered version to delete.")],
    why: Why,
) -> None:
    """Delete a version of MACHINE that neither serves, nor served of late, nor is a reference."""
    from pipeline.app.fleet import check_machine
    from pipeline.champions.promotion import delete as delete_version

    with one_sentence():
        check_machine(machine)
        freed = delete_version(machine, version, why=why) / 1e6
    typer.echo(f"{machine}: version {version} is deleted, {freed:.1f} MB are free; {COMMIT}")
