"""When a control was active, held and done, from the words that it says of its execution."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from pipeline.identification.control.spans import Span

ACTIVE = frozenset({"ACTIVE"})
HELD = frozenset({"FEED_HOLD", "INTERRUPTED", "OPTIONAL_STOP", "PROGRAM_OPTIONAL_STOP", "WAIT"})
COMPLETED = frozenset({"PROGRAM_COMPLETED"})


@dataclass(frozen=True, kw_only=True)
class Activity:
    """From becoming active to completing or stopping.

    Parameters
    ----------
    start, end : float
        When the control became active and when it ceased to be, in the recording's time [s].
    completed : bool
        Whether the program ran to its end.
    held : tuple of (float, float)
        Spans in which the control said that it was held [s].
    """

    start: float
    end: float
    completed: bool
    held: tuple[Span, ...] = ()


def activities(said: Iterable[tuple[float, str]], end: float) -> Iterator[Activity]:
    """What the words of a control's execution come to.

    Parameters
    ----------
    said : iterable of (float, str)
        When [s], and the word.
    end : float
        Of the recording [s].

    Yields
    ------
    Activity
        All of the recording when no word was said: the control may say nothing of its execution.
    """
    said = list(said)
    start: float | None = None if said else 0.0
    since: float | None = None  # when it was held
    held: list[Span] = []
    for time, word in said:
        if start is None:
            start = time if word in ACTIVE else None
            continue
        if word in HELD:
            since = time if since is None else since
            continue
        if since is not None:
            held.append((since, time))
            since = None
        if word not in ACTIVE:
            yield Activity(start=start, end=time, completed=word in COMPLETED, held=tuple(held))
            start, held = None, []
    if start is not None:
        if since is not None:
            held.append((since, end))
        yield Activity(start=start, end=end, completed=False, held=tuple(held))
