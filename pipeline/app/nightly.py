"""Command ``kerf nightly``: nights of a machine's champion, their error budget, what they ask."""

from collections.abc import Iterator, Sequence

from pipeline.app.fleet import DATA, check_machine
from pipeline.app.output import aligned
from pipeline.schema.bundle import stored_bundle
from pipeline.schema.ledger import Night, asks, latest, read_ledger, serving, spent
from pipeline.stages.__main__ import run

QUIET, ASKS = 0, 3
"""Exit statuses: nothing to do; a model is to be identified or trained, or records to be mended."""


def score(machine: str) -> tuple[Night, ...]:
    """Score the nights that the ledger of a machine lacks; all those of what serves."""
    check_machine(machine)
    ledger = DATA / f"ledger/{machine}.jsonl"
    folders = [DATA / name / machine for name in ("champion", "raw", "signals", "clean")]
    run(f"nightly@{machine}", *map(str, (*folders, DATA / "golden", ledger)), written=str(ledger))
    return serving(read_ledger(ledger), stored_bundle(folders[0], machine))


def lines(machine: str, nights: Sequence[Night]) -> Iterator[str]:
    """The last night of each target, and what is asked for; without a night why there is none."""
    last = {one.target: one for one in latest(nights)}
    if not last:
        why = (
            f"{machine} has no day after its champion's training, and no recording, that the "
            "champion was neither fitted nor judged on; golden and sealed records are never "
            f"scored. New records in data/raw/{machine} and `dvc repro nightly@{machine}` make one"
        )
        if stored_bundle(DATA / "champion" / machine, machine) is None:
            why = f"nothing serves {machine}: `dvc repro champion@{machine}` fills what serves"
        yield f"no night to score: {why}"
        return
    rows = [
        (one.night, one.submodel, f"{one.quantity} {one.regime}".strip() or "-", one.result,
         *("-" if share is None else f"{100 * share:.0f} %" for share in (
             one.share, spent(night for night in nights if night.target == one.target))))
        for one in last.values()
    ]  # fmt: skip
    yield from aligned(
        [("night", "sub-model", "quantity", "result", "of the night", "of 28 nights"), *rows],
        words=4,
    )
    for one in asks(nights):
        said = f"asks for {one.ask} since {one.since}, {one.rule} ({one.reason}: {one.words})"
        yield f"{one.night}, {one.submodel}: {said}"
