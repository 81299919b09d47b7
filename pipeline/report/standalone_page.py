"""Standalone page of one program: its parts, and how it is written; the templates of all pages."""

from base64 import b64encode
from collections.abc import Callable, Sequence
from csv import writer
from dataclasses import dataclass, field, replace
from hashlib import sha256
from io import StringIO
from pathlib import Path
from typing import Any
from urllib.parse import quote

from markupsafe import Markup

from pipeline.charts.numbers import as_read
from pipeline.charts.sections import Section
from pipeline.charts.sources import Source, shown
from pipeline.charts.tables import Table
from pipeline.report.provenance import Made, RenderedPage, Trace, files_of, parts_of
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.files import written
from pipeline.schema.verdict import UsedModel

COMPILED: dict[str, bytes] = {}
"""Bytecode of the templates by jinja2's key."""
SAFE = " ,;:/()[]=+*!@$'|"
"""Characters that a data address may hold as they are."""


@dataclass(frozen=True, kw_only=True)
class StandalonePage:
    """Head, verdict, key figures and sections of the page of one program."""

    program: str
    machine: str
    about: str
    origin: str
    """Origin of the machine's records, "simulated" or "recorded"."""
    status: str
    word: str
    sentences: list[str]
    """Verdict: its CSS class, its word, and what a reader needs before anything else."""
    key_figures: list[tuple[str, str, str]]
    """Name, value, aside."""
    sections: list[Section] = field(default_factory=list)
    """Sections in the order in which they are read."""
    running: str = ""
    """Kind of page, at its head."""
    computed: str = ""
    """Sentence at its end on what was computed and what was measured."""
    up: tuple[tuple[str, str], ...] = ()
    """Address and words of the report's pages above and beside it; empty for a page by itself."""
    credit: str = ""
    """Names to be credited for the machine's records."""
    script: Markup | None = None
    """The one script that the page's policy lets run, by its hash."""

    @property
    def script_hash(self) -> str:
        """Hash of the script in the form of a Content-Security-Policy."""
        digest = sha256((self.script or "").encode()).digest()
        return f"sha256-{b64encode(digest).decode()}"


def verdicts_section(models: Sequence[UsedModel]) -> Section | None:
    """Verdicts, the gravest first; they stand before all other sections."""
    if not models:
        return None
    return Section(
        key="verdicts", title="What the figures rest on, and whether it was judged",
        text=["Errors are of recordings that the model had not seen."],
        pairs=[
            (_first_up(one.submodel), f"{_first_up(one.sentence[len(one.submodel) + 1:])}.")
            for one in models
        ],
    )  # fmt: skip


def doubts(models: Sequence[UsedModel]) -> list[str]:
    """A sentence for each sub-model that failed or was not judged, to stand in the verdict."""
    return [f"{_first_up(one.sentence)}." for one in models if one.doubtful]


def _first_up(text: str) -> str:
    return text[:1].upper() + text[1:]


def renderer(say: Texts = ENGLISH) -> Callable[..., RenderedPage]:
    """Renderer by template name, page's file, what it was made by, and variables.

    It escapes text and takes its own words from ``say``.
    """
    from jinja2 import BytecodeCache, Environment, FileSystemLoader, StrictUndefined
    from jinja2.bccache import Bucket

    class Compiled(BytecodeCache):
        """Compiled templates of this process: a report has some hundred renderers."""

        def load_bytecode(self, bucket: Bucket) -> None:
            if bucket.key in COMPILED:
                bucket.bytecode_from_string(COMPILED[bucket.key])

        def dump_bytecode(self, bucket: Bucket) -> None:
            COMPILED[bucket.key] = bucket.bytecode_to_string()

    environment = Environment(
        bytecode_cache=Compiled(),
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_as_read,
    )
    trace = Trace(say)
    environment.globals |= {"say": say, "trace": trace}
    environment.filters["csv"] = csv_link
    environment.filters["section_sources"] = section_sources

    def render(name: str, file: str, made: Made, **variables: Any) -> RenderedPage:
        trace.begin(made)
        html = environment.get_template(name).render(**variables)
        return RenderedPage(html=html, record=trace.record(file))

    return render


def _as_read(value: Any) -> Any:
    """Words as they are read; markup, and with it what a template escapes by ``e``, as it is."""
    return as_read(value) if type(value) is str else value


def csv_link(table: Table) -> str:
    """Address that holds a table as CSV, so that it can be saved without a script."""
    text = StringIO()
    rows = writer(text, lineterminator="\n")
    rows.writerow([head.label for head in table.heads])
    rows.writerows([[cell.text for cell in row] for row in table.rows])
    return f"data:text/csv;charset=utf-8,{quote(text.getvalue(), safe=SAFE)}"


def section_sources(section: Section) -> list[Source]:
    """Every file that a section's tables and figures stand on, each once."""
    found: dict[str, Source] = {}
    for part in parts_of(section):
        found |= {one.path: one for one in getattr(part, "sources", [])}
    return list(found.values())


def rendered(page: StandalonePage, file: str, made: Made) -> RenderedPage:
    """A standalone page with the record of its figures; key numbers rest on all of its files."""
    files = made.files or files_of(page.sections)
    return renderer()("standalone.html.j2", file, replace(made, files=files), page=page)


def source_of(path: Path) -> Source:
    """The file that a page stands on, with its hash."""
    return Source(path=shown(path), sha256=sha256(written(path).read_bytes()).hexdigest())
