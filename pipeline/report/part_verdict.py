"""What the judgement of one part of a machine says: of its program times, of its drives."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class PartVerdict:
    """``status`` of what was judged, the ``sentence`` that says it, what ``todo`` now.

    ``reserved`` is what nobody could judge, and is beyond its limits as far as it is known.
    """

    status: Literal["passed", "failed", "attention", "unknown"]
    sentence: str
    todo: str
    reserved: bool = False


def combined(parts: list[PartVerdict]) -> tuple[PartVerdict, list[PartVerdict]]:
    """The verdict of the whole from its ``parts`` in order of weight, and the parts as ranked.

    The first part that could be judged leads; when it passed and another failed or is reserved,
    the whole passes with reservations, and the sentence and what is to do are the other's. What
    makes the reservation follows the first part.
    """
    first, *others = sorted(parts, key=lambda p: p.status == "unknown")
    others.sort(key=lambda p: 0 if p.status == "failed" else 1 if p.reserved else 2)
    ranked = [first, *others]
    if first.status == "passed" and others and (others[0].status == "failed" or others[0].reserved):
        other = others[0]
        lead = PartVerdict(status="attention", sentence=other.sentence, todo=other.todo)
        return lead, ranked
    return first, ranked
