"""Parts of a page: sections, figures, legends, words for what is absent."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from markupsafe import Markup

from pipeline.charts.sources import Source, shown
from pipeline.charts.tables import Table
from pipeline.schema.model import Parameter


@dataclass(frozen=True, kw_only=True)
class Figure:
    """Figure: its SVG, its caption, its sources."""

    svg: Markup
    caption: str
    sources: list[Source] = field(default_factory=list)
    status: str = ""
    status_words: str = ""


@dataclass(frozen=True, kw_only=True)
class Figures:
    """Figures that belong together under one legend of (CSS class, words, shape).

    ``kind`` is the CSS class of their arrangement: ``one`` below another, ``program`` for a tall
    one beside others; else as many side by side as fit.  With ``folded`` they open on demand below
    those words.  ``control`` stands above them and moves their marks, where a script runs.
    """

    figures: list[Figure]
    legend: list[tuple[str, str, str]] = field(default_factory=list)
    kind: str = ""
    folded: str = ""
    control: Markup | None = None


def drawing(
    svg: Markup | None, caption: str, sources: Sequence[Source],
    legend: Sequence[tuple[str, str, str]] = (), kind: str = "one wide",
) -> Figures | None:  # fmt: skip
    """One figure with its legend; None where there is none to draw."""
    if svg is None:
        return None
    figure = Figure(svg=svg, caption=caption, sources=list(sources))
    return Figures(figures=[figure], legend=list(legend), kind=kind)


@dataclass(frozen=True, kw_only=True)
class ListingLine:
    """A line of a program: its number, its text before and after, what changed in words.

    ``after`` empty: the same.  ``tone`` is the CSS class of the change's size, ``gap`` whether
    lines are left out before it.
    """

    number: int
    before: Markup
    after: Markup
    notes: tuple[str, ...] = ()
    tone: str = ""
    gap: bool = False


@dataclass(frozen=True, kw_only=True)
class Listing:
    """Lines of a program beside each other, folded below ``caption``; ``unfolded`` they open."""

    caption: str
    lines: list[ListingLine]
    unfolded: bool = False
    sources: list[Source] = field(default_factory=list)
    note: str = ""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """Heading of the blocks after it, with one paragraph."""

    heading: str
    text: str = ""


Block = Table | Figures | Heading | Listing


@dataclass(frozen=True, kw_only=True)
class Section:
    """Section: paragraphs, pairs of (finding, action), then tables and figures."""

    key: str
    title: str
    text: list[str] = field(default_factory=list)
    pairs: list[tuple[str, str]] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)
    closing: bool = False


def present(*blocks: Block | None) -> list[Block]:
    """Blocks that exist."""
    return [b for b in blocks if b is not None]


def absent(path: Path, remedy: str) -> str:
    """Sentence on a missing file, and how to get it."""
    return f"Not known: there is no {shown(path)}. {remedy}"


@dataclass(frozen=True, kw_only=True)
class PartVerdict:
    """``status`` of what was judged, the ``sentence`` that says it, what ``todo`` now.

    ``reserved`` is what nobody could judge, and is beyond its limits as far as it is known.
    """

    status: Literal["passed", "failed", "attention", "unknown"]
    sentence: str
    todo: str
    reserved: bool = False


Role = Literal["tool room", "maintenance", "process engineer", "ML engineer", "data engineer"]
"""Who an action is for."""


NOW = "now"
"""Deadline of what is urgent."""


@dataclass(frozen=True, kw_only=True)
class Action:
    """Action: ``what``, ``where``, ``why``, ``until`` when, and who does it.

    ``evidence`` is the key of the section that shows why; empty where no section does.
    """

    what: str
    where: str
    why: str
    until: str
    who: Role
    evidence: str = ""


@dataclass(frozen=True, kw_only=True)
class Compared:
    """A key figure that is compared with the last report's: its name, its unit, its value."""

    name: str
    unit: str
    value: float | int | str | None


ChangeNote = Callable[[str, str, Parameter, Parameter], str]
"""Group and name of a parameter, the parameter then and now (both determined) -> what it means."""


def unremarkable(group: str, name: str, before: Parameter, now: Parameter) -> str:
    """No words on a parameter's change."""
    return ""


@dataclass(frozen=True, kw_only=True)
class SubModelPage:
    """Content that only one sub-model can show on its machine's page."""

    verdict: PartVerdict | None = None
    """Verdict for the head of the page, in shop-floor words; None where nothing was judged."""
    key_figures: list[tuple[str, str, str]] = field(default_factory=list)
    """Name, value, aside; the first is the one that counts."""
    doubts: list[str] = field(default_factory=list)
    """Weaknesses of a model that passed; they make a reservation of its pass."""
    notes: list[str] = field(default_factory=list)
    """Further observations, the most important first."""
    actions: list[Action] = field(default_factory=list)
    """Actions from these records, besides those of ``verdict`` on the model."""
    sections: list[Section] = field(default_factory=list)
    """Sections in reading order."""
    lead: Section | None = None
    """Section for the machine's own page; None without one."""
    truth: list[Table] = field(default_factory=list)
    """Truth of a simulated machine beside the identified values."""
    compared: dict[str, Compared] = field(default_factory=dict)
    """Key figures that the next report is compared with."""
    changed: ChangeNote = unremarkable
    """Meaning of a change of a parameter since the last report, by its group, its name, the
    parameter then and now; empty where there is none."""
