"""The parts that a page is made of: sections, figures, legends, words for what is absent."""

from dataclasses import dataclass, field
from pathlib import Path

from markupsafe import Markup

from pipeline.report.sources import Source, shown
from pipeline.report.tables import Table


@dataclass(frozen=True, kw_only=True)
class Figure:
    """One figure: its SVG, what stands below it, where it comes from."""

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
    those words.
    """

    figures: list[Figure]
    legend: list[tuple[str, str, str]] = field(default_factory=list)
    kind: str = ""
    folded: str = ""


@dataclass(frozen=True, kw_only=True)
class Heading:
    """What the blocks after it are about, with one paragraph on it."""

    heading: str
    text: str = ""


Block = Table | Figures | Heading


@dataclass(frozen=True, kw_only=True)
class Section:
    """One section: paragraphs, pairs of (what, what to do), then tables and figures."""

    key: str
    title: str
    text: list[str] = field(default_factory=list)
    pairs: list[tuple[str, str]] = field(default_factory=list)
    blocks: list[Block] = field(default_factory=list)
    closing: bool = False


def present(*blocks: Block | None) -> list[Block]:
    """Those blocks that there are."""
    return [b for b in blocks if b is not None]


def absent(path: Path, remedy: str) -> str:
    """One sentence for a file that is not there, and what would bring it."""
    return f"Not known: there is no {shown(path)}. {remedy}"
