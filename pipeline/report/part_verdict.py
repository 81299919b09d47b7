"""What the judgement of one part of a machine says: of its program times, of its drives."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class PartVerdict:
    """``status`` of what was judged, the ``sentence`` that says it, what ``todo`` now."""

    status: Literal["passed", "failed", "attention", "unknown"]
    sentence: str
    todo: str


def combined(parts: list[PartVerdict]) -> tuple[PartVerdict, list[PartVerdict]]:
    """The verdict of the whole from its ``parts`` in order of weight, and the parts as ranked.

    The first part that could be judged leads; when it passed and another failed, the whole passes
    with reservations, and what is to do is the other's.
    """
    ranked = sorted(parts, key=lambda p: p.status == "unknown")
    lead = ranked[0]
    failed = [p for p in ranked[1:] if p.status == "failed"]
    if lead.status == "passed" and failed:
        lead = PartVerdict(status="attention", sentence=lead.sentence, todo=failed[0].todo)
    return lead, ranked
