"""Provenance of the figures on a page: hashes in each figure's title, and a record beside the page.

A figure is a chart, a table or the group of key numbers.  Its title names, by twelve digits each,
the data that it was computed from, the code, the settings and the model; the record beside the page
has the whole, and each figure's files.  Neither holds a time or a commit, so that the same records
give the same bytes; pages of commands, which nothing builds again, have the commit too.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from markupsafe import Markup

from pipeline.charts.sections import Block, Figure, Figures, Section
from pipeline.charts.sources import Source, hash_of_files
from pipeline.schema.store import write_json, write_text

RECORD = ".figures.json"
"""End of the name of a page's record, in the place of ``.html``."""
SHORT = 12
"""Digits of a hash in a title."""
ALL = "*"
"""Name for every file of a page, in the record of a figure."""


@dataclass(frozen=True, kw_only=True)
class Made:
    """Origin of a page: hashes of code and settings, model, and the command if any."""

    code: str = ""
    """Hash of the code; of a command's page the commit, or the version where there is none."""
    settings: str = ""
    """Hash of the settings of the machine, or of all machines of a fleet."""
    model: str = ""
    """Hash of the model: of the page's sub-model, else of the bundle that serves."""
    version: str = ""
    """Version of the model in the registry; empty on pages of the report, since registries
    differ."""
    dirty: str = ""
    """Whether the code differed from its commit, "true" or "false"; empty where it is a hash."""
    command: tuple[str, ...] = ()
    """Words of the command behind ``kerf``; empty on pages of the report."""
    files: tuple[Source, ...] = ()
    """Files that the page rests on, for figures without files of their own."""


UNKNOWN = Made()
"""Origin of a page of which only the files are known."""


@dataclass(frozen=True, kw_only=True)
class PageRecord:
    """The record beside a page, ``<page>.figures.json``."""

    page: str
    made: Made
    files: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each file by its path."""
    figures: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Files of each figure by its identifier on the page."""


@dataclass(frozen=True, kw_only=True)
class RenderedPage:
    """HTML of a page and the record of its figures."""

    html: str
    record: PageRecord

    def write(self, path: Path) -> None:
        """Store the page and its record beside it; where the page is no file, it has none."""
        if path.is_file() or not path.exists():  # not /dev/stdout
            write_json(self.record, record_of(path))
        write_text(self.html, path)


def record_of(page: Path) -> Path:
    """Path of the record of a page.

    >>> record_of(Path("reports/mill00.html")).as_posix()
    'reports/mill00.figures.json'
    """
    return page.with_name(page.name.removesuffix(".html") + RECORD)


class Trace:
    """Collects the figures of a page while it is rendered; templates call it for each title."""

    def __init__(self, say: Callable[..., str]) -> None:
        self.say = say
        self.begin(UNKNOWN)

    def begin(self, made: Made) -> None:
        """Begin a page."""
        self.made = made
        self.figures: dict[str, tuple[str, ...]] = {}
        self.used: dict[str, Source] = {}
        self.titles: dict[tuple[str, ...], Markup] = {}

    def __call__(self, at: str, sources: Iterable[Source] = ()) -> Markup:
        """Note a figure with its identifier on the page; its title as an attribute of HTML."""
        own = single(sources)
        key = tuple(one.path for one in own)
        if key not in self.titles:
            self.titles[key] = self._title(own or self.made.files)
        self.used |= {one.path: one for one in own or self.made.files}
        self.figures[at] = key or (ALL,)
        return self.titles[key]

    def _title(self, files: Sequence[Source]) -> Markup:
        made = self.made
        data = files[0].sha256 if len(files) == 1 else hash_of_files(("", f.sha256) for f in files)
        words = ", ".join(
            self.say(f"page.hash_{name}", hash=value[:SHORT])
            for name, value in (("data", data if files else ""), ("code", made.code),
                                ("settings", made.settings), ("model", made.model))
            if value
        )  # fmt: skip
        version = f" ({made.version})" if made.version else ""
        return Markup(' title="{}"').format(f"{words}{version}") if words else Markup()

    def record(self, page: str) -> PageRecord:
        """Record of the page as it was rendered."""
        files = {path: one.sha256 for path, one in sorted(self.used.items())}
        made = replace(self.made, files=())
        return PageRecord(page=page, made=made, files=files, figures=self.figures)


def single(sources: Iterable[Source]) -> list[Source]:
    """Files behind sources, those that are named together one by one."""
    return [one for source in sources for one in source.files or (source,) if one.sha256]


def files_of(sections: Iterable[Section]) -> tuple[Source, ...]:
    """Every file that the figures of some sections stand on, each once."""
    found = {one.path: one for section in sections for part in parts_of(section)
             for one in single(getattr(part, "sources", []))}  # fmt: skip
    return tuple(found.values())


def parts_of(section: Section) -> Iterator[Block | Figure]:
    """Tables, listings and single figures of a section."""
    for block in section.blocks:
        yield from block.figures if isinstance(block, Figures) else (block,)
