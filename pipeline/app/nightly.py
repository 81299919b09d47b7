"""Command ``kerf nightly``: nights of a machine's champion, their error budget, what they ask."""

from collections.abc import Iterator, Sequence

from pipeline.app.fleet import DATA, check_machine
from pipeline.app.output import aligned
from pipeline.fleet import Fleet
from pipeline.monitoring.budget import MonitoringSettings
from pipeline.parameters import read_params, section_path, structure
from pipeline.schema.ledger import Night, asks, latest, read_ledger, serving, spent
from pipeline.stages.nightly import nightly as stage

QUIET, ASKS = 0, 3
"""Exit statuses: nothing to do; a model is to be identified or trained, or records to be mended."""


def score(machine: str) -> tuple[Night, ...]:
    """Score the nights that the ledger of a machine lacks; all of its nights."""
    check_machine(machine)
    values, ledger = read_params(), DATA / "ledger" / f"{machine}.jsonl"
    ledger.parent.mkdir(parents=True, exist_ok=True)
    champion, raw, signals, clean = (
        DATA / name / machine for name in ("champion", "raw", "signals", "clean")
    )
    section = section_path(values, "monitoring", machine)
    stage(
        champion, raw, signals, clean, DATA / "golden", ledger,
        fleet=structure(values, "fleet", Fleet),
        monitoring=structure(values, section, MonitoringSettings),
    )  # fmt: skip
    return read_ledger(ledger)


def lines(nights: Sequence[Night]) -> Iterator[str]:
    """The last night of each target, and what is asked for."""
    served = latest(serving(nights))
    last = {one.target: one for one in served}
    if not last:
        yield "no night to score: no record is newer than those that the champion was judged on"
        return
    rows = [
        (one.night, one.submodel, f"{one.quantity} {one.regime}".strip() or "-", one.result,
         "-" if one.share is None else f"{100 * one.share:.0f} %", _spent(served, one))
        for one in last.values()
    ]  # fmt: skip
    yield from aligned(
        [("night", "sub-model", "quantity", "result", "of the night", "of 28 nights"), *rows],
        words=4,
    )
    for one in asks(nights):
        said = f"asks for {one.ask}, {one.rule} ({one.reason}: {one.words})"
        yield f"{one.night}, {one.submodel}: {said}"


def _spent(nights: Sequence[Night], of: Night) -> str:
    used = spent(one for one in nights if one.target == of.target)
    return "-" if used is None else f"{100 * used:.0f} %"
