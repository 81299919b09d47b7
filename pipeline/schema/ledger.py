"""Ledger of the nights on which the champion of a machine was scored: one line of JSON each.

A ledger only grows: a night that is scored again, since its records have grown, gets a further
line, and the later one counts.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

from pipeline.schema.bundle import Bundle
from pipeline.schema.store import StoreError, json_line, read_lines, write_text

Result = Literal["within", "over", "no records", "not scored"]
"""Result of a night: within the error budget, over it, too few records of a working day to score,
or nothing to score on another."""
Ask = Literal["", "identification", "training", "records"]
"""Work that a night asks for; empty where it asks for none."""
Reason = Literal[
    "", "sensor", "heat", "friction", "wear", "program changed", "records missing", "not known"
]
"""Cause that the residuals of a night speak for."""
PERIOD_NIGHTS = 28
"""Nights of an error budget, of which pages say how much is spent, and of an ask of a target that
no later night has."""
RECORDED = 2
"""Nights with records on which an ask for records is closed."""


@dataclass(frozen=True, kw_only=True)
class Night:
    """One quantity of one sub-model, scored on the records of one night."""

    night: str
    """Day of the plant; of records without a clock the name of the recording."""
    bundle: str
    model: str
    """Hashes of the bundle that served, and of the sub-model in it."""
    submodel: str
    quantity: str
    regime: str
    unit: str
    """Target; the quantity is empty where a night had no records."""
    records: str
    """Hash of the raw files."""
    n: int
    """Samples that were scored."""
    mae: float | None = None
    rmse: float | None = None
    """Errors [unit]."""
    budgets: Mapping[str, float] = field(default_factory=dict)
    """Allowed error of a night by the name of the figure."""
    share: float | None = None
    """Greatest error over its budget [1]."""
    parts: Mapping[str, float] = field(default_factory=dict)
    """Part of the residual that goes with each cause, with its sign [unit]."""
    beyond: float = 0.0
    """Distance of its conditions beyond the learnt ranges, over their width [1]."""
    result: Result
    rule: str = ""
    """Rule that asks, in words; empty where none does."""
    ask: Ask = ""
    since: str = ""
    """First night of the ask, which stays open until the errors are back."""
    reason: Reason = ""
    words: str = ""
    """Reason and what to do, as a sentence."""

    @property
    def target(self) -> tuple[str, str, str]:
        """Sub-model, quantity and regime."""
        return self.submodel, self.quantity, self.regime


def read_ledger(path: Path) -> tuple[Night, ...]:
    """Nights in the order in which they were scored; none where there is no file."""
    remedy = f"restore it with `dvc checkout {path}`, or delete it and run `dvc repro`"
    return tuple(
        replace(night, since=night.since or (night.night if night.ask else ""))
        for night, _ in read_lines(path, Night, remedy)
    )


def write_ledger(nights: Iterable[Night], path: Path) -> None:
    """Store a ledger, all at once: a write that breaks off leaves the file as it was.

    Lines that are stored stay as they are.  Raises StoreError where their nights are not the first
    of the new ones.
    """
    every, known = tuple(nights), read_ledger(path)
    if every[: len(known)] != known:
        raise StoreError(
            f"{path} holds nights that the new ledger lacks, and a ledger only grows: restore it "
            f"with `dvc checkout {path}`, or delete it and run `dvc repro`"
        )
    before = path.read_text(encoding="utf-8") if path.exists() else ""
    write_text(before + "".join(f"{json_line(one)}\n" for one in every[len(known) :]), path)


def latest(nights: Iterable[Night]) -> list[Night]:
    """The last line of each night and target, oldest night first.

    A night that had no records is none any more where a later line has some.
    """
    found: dict[tuple[str, ...], Night] = {}
    for one in nights:
        key = (*one.target, one.model, one.night)
        found.pop((one.submodel, "", "", *key[3:]), None)
        found.pop(key, None)
        found[key] = one
    return list(found.values())


def spent(nights: Iterable[Night]) -> float | None:
    """Share of the error budget of :data:`PERIOD_NIGHTS` nights of one target that is spent [1].

    The budget of a night is its allowed error; None where no night was scored.
    """
    shares = [one.share for one in latest(nights) if one.share is not None][-PERIOD_NIGHTS:]
    return sum(shares) / PERIOD_NIGHTS if shares else None


def serving(nights: Iterable[Night], bundle: Bundle | None) -> tuple[Night, ...]:
    """Nights of the models in the bundle that serves, None where nothing does."""
    models = {} if bundle is None else bundle.submodels
    served = {(name, one.sha256) for name, one in models.items()}
    return tuple(one for one in nights if (one.submodel, one.model) in served)


def asks(nights: Iterable[Night]) -> list[Night]:
    """Newest night of each ask that is open, one for each sub-model and work, the oldest ask first.

    ``nights`` of the models that serve.  An ask for records is closed by :data:`RECORDED` nights
    that have some, one of a target that is not met any more by :data:`PERIOD_NIGHTS` without it.
    """
    known = [one for one in latest(nights) if one.result != "not scored"]
    last = {one.target: one for one in known}.values()
    found: dict[tuple[str, str], Night] = {}
    for one in sorted(last, key=lambda one: one.since):
        later = {two.night for two in known if two.submodel == one.submodel} - {
            two.night for two in known[: known.index(one) + 1]
        }
        if one.ask and len(later) < (RECORDED if one.ask == "records" else PERIOD_NIGHTS):
            found.setdefault((one.submodel, one.ask), one)
    return list(found.values())
