"""Verification of pages: inputs by their hashes, figures computed again (`kerf verify`).

A page of the report is rendered again from the files that it names, that of a command by the same
command; each text and each line of a drawing is held against the page.  The errors of a sub-model
are computed again from its predictions besides.
"""

import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from html.parser import HTMLParser
from itertools import takewhile, zip_longest
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np

from pipeline.app.document_figures import document_figures
from pipeline.app.fleet import DATA
from pipeline.charts.sources import shown as as_named
from pipeline.fleet import Fleet
from pipeline.parameters import HASHES, SETTINGS, read_params, section_path, structure
from pipeline.report.provenance import ALL, PageRecord, record_of
from pipeline.report.texts import ReportSettings, texts
from pipeline.schema.predictions import BASELINE, read_predictions
from pipeline.schema.store import content, read_json
from pipeline.schema.verdict import Score, Verdict
from pipeline.stages.report import code_of_pages, info_of, machines_of
from pipeline.submodels.contract import Target, sections, submodel, submodels

if TYPE_CHECKING:
    import pandas as pd

MOST = 5
"""Values of one figure that are named at most; the others are counted."""
OUTPUTS = ("--out", "--json", "--page", "--corrected")
"""Options of commands that name a file to write."""
COMMANDS = ("simulate", "optimise", "transfer")
"""Commands that make pages; a record that names another is not followed."""
ALL_GROUPS = "all"
"""Group of a score over all groups of a role."""
LAST_DIGIT = 1e-5
"""Relative difference of an error within the six digits that are stored."""
TEXT = "text"
"""Figure of words that stand in none."""
REMEDY = "build the page again, `dvc repro report` or its command"


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """A figure that is not what its inputs give, or an input that is not what it was."""

    page: str
    figure: str
    """Identifier of the figure, ``text`` of words outside, or ``input``."""
    shown: str
    recomputed: str
    file: str
    """File that it was computed from."""


@dataclass(frozen=True, kw_only=True)
class Verified:
    """Result of a page: how many inputs and figures were compared, and what differs."""

    page: str
    inputs: int
    figures: int
    mismatches: tuple[Mismatch, ...]
    note: str = ""


def verify_all(paths: Iterable[Path], sample: int | None = None) -> list[Verified]:
    """Verify pages and Markdown documents; those of a folder are its Markdown files."""
    found, reports = [], cache(_report)
    for path in paths:
        if path.is_dir():
            documents = sorted(path.rglob("*.md"))
            if not documents:
                raise ValueError(f"{path} holds no Markdown: name pages, as {path}/*.html")
            found += [verify_document(one) for one in documents]
        elif path.suffix == ".md":
            found.append(verify_document(path))
        else:
            found.append(verify_page(path, reports, sample))
    return found


def verify_document(path: Path) -> Verified:
    """Verify the figures of a Markdown document that have a source."""
    try:
        text = content(path, "name a page or a document").decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no Markdown in UTF-8 ({error}): name another file") from error
    figures = list(document_figures(text, Path(), str(path)))
    stale = tuple(
        Mismatch(page=str(path), figure=f"line {one.line}", shown=one.shown,
                 recomputed=one.recomputed, file=one.source)
        for one in figures if one.shown != one.recomputed
    )  # fmt: skip
    files = {one.source.partition("#")[0] for one in figures}
    return Verified(page=str(path), inputs=len(files), figures=len(figures), mismatches=stale)


Reports = Callable[[Path], Mapping[str, str]]
"""HTML of every page of the active fleet, by the folder of its last report."""


def verify_page(page: Path, reports: Reports, sample: int | None = None) -> Verified:
    """Verify one page; ``sample`` is the number of figures that are compared, None for all."""
    try:
        html = content(page, "name a page of the report or of a command").decode()
        record = read_json(record_of(page), PageRecord, REMEDY)
    except UnicodeDecodeError as error:
        raise ValueError(f"{page} is no page of Kerf ({error}): {REMEDY}") from error
    changed, made = list(_changed_inputs(page, record)), record.made.code
    try:
        again, code = _again(page, record, reports)
    except ValueError as error:
        if not changed:
            raise
        return Verified(page=str(page), inputs=len(record.files), figures=0,
                        mismatches=tuple(changed), note=str(error))  # fmt: skip
    figures = _sample([one.id for one in record.figures], html, sample)
    found = [*changed, *_compared(page, record, html, again, None if sample is None else figures)]
    folders = {name: _submodel_folder(record, name) for name in submodels()}
    for name, folder in folders.items():
        if folder is not None and not changed:
            found += _scores_again(page, folder, name, sample)
    note = "" if code == made else f"made by code {made[:12]}, verified by {code[:12]}"
    return Verified(
        page=str(page), inputs=len(record.files), figures=len(figures), mismatches=tuple(found),
        note=note,
    )  # fmt: skip


def _sample(ids: Sequence[str], html: str, most: int | None) -> list[str]:
    """Some figures, another choice for each content of a page, the same for the same."""
    drawn = sorted(ids, key=lambda one: sha256(f"{one} {html}".encode()).digest())
    return drawn[:most]


def _changed_inputs(page: Path, record: PageRecord) -> Iterator[Mismatch]:
    for file, named in record.files.items():
        path = Path(file)
        now = sha256(path.read_bytes()).hexdigest() if path.is_file() else "not there"
        if now != named:
            yield Mismatch(page=str(page), figure="input", shown=named[:12], recomputed=now[:12],
                           file=file)  # fmt: skip


# ---- the page, made again


def _again(page: Path, record: PageRecord, reports: Reports) -> tuple[str, str]:
    """HTML of the page made again, and the hash of the code that made it."""
    if record.made.command:
        return _by_command(page, record.made.command)
    pages = reports(page.parent)
    if record.page not in pages:
        raise ValueError(
            f"{page} is no page of the fleet that is active here: make its fleet active with "
            "`kerf fleet NAME`, or work in its project"
        )
    return pages[record.page], code_of_pages()


def _report(reports: Path) -> Mapping[str, str]:
    """HTML of every page of the active fleet, held against the same earlier report."""
    from pipeline.report.pages import report_of

    values = read_params()
    fleet = structure(values, "fleet", Fleet)
    names = ("signals", "clean", "models", "champion", "golden", "truth", "programs", "parts",
             "trials", "history", "ledger")  # fmt: skip
    folders = [DATA / name for name in names]
    machines = machines_of([*folders, SETTINGS / HASHES], fleet)
    language = structure(values, "pages", ReportSettings).language
    info = info_of(fleet, structure(values, "budget", str))
    report = report_of(machines, info, reports, say=texts(language))
    return {name: one.html for name, one in report.pages.items()}


def _by_command(page: Path, words: Sequence[str]) -> tuple[str, str]:
    """HTML of a command's page by the same command, its files written elsewhere."""
    if words[0] not in COMMANDS:
        raise ValueError(
            f"{record_of(page)} names `kerf {words[0]}`, which makes no page: {REMEDY}"
        )
    call = [one for word in words
            for one in (word.split("=", 1) if word.startswith(OUTPUTS) else (word,))]  # fmt: skip
    with TemporaryDirectory() as place:
        named = {k + 1: Path(call[k + 1]) for k, word in enumerate(call[:-1]) if word in OUTPUTS}
        moved = {k: Path(place) / path.name for k, path in named.items()}
        done = subprocess.run(
            [sys.executable, "-m", "pipeline.app", "-q",
             *(str(moved.get(k, word)) for k, word in enumerate(call))],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        made = next(path for k, path in moved.items() if call[k - 1] == "--page")
        if not made.is_file():
            said = (done.stderr.strip().splitlines() or ["it wrote no page"])[-1]
            raise ValueError(f"{page}: `kerf {' '.join(words)}` does not make it again: {said}")
        html = made.read_text(encoding="utf-8")
        for k, path in moved.items():
            html = html.replace(as_named(path), as_named(named[k]))
        return html, read_json(record_of(made), PageRecord).made.code


# ---- what a page shows


class _Shown(HTMLParser):
    """Words and drawn lines of a page by the identifier of the figure or section around them."""

    VOID = ("meta", "link", "br", "input", "img", "hr")

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[tuple[str, str]] = []
        self.found: dict[str, list[str]] = {}

    def _note(self, words: str) -> None:
        place = self.open[-1][1] if self.open else TEXT
        self.found.setdefault(place, []).append(words)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        own, drawn = dict(attrs), any(one == "svg" for one, _ in self.open)
        place = self.open[-1][1] if self.open else TEXT
        if own.get("id") and not drawn:
            place = own["id"] or ""
        if tag not in self.VOID:
            self.open.append((tag, place))
        for name, value in attrs:
            if value and (drawn or name in ("title", "href", "content", "aria-label")):
                self._note(value)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in self.VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, data: str) -> None:
        if words := " ".join(data.split()):
            self._note(words)


def shown_by(html: str) -> dict[str, list[str]]:
    """Words and drawn lines of a page by the figure or section that they stand in."""
    reader = _Shown()
    reader.feed(html)
    return reader.found


def _compared(
    page: Path, record: PageRecord, html: str, again: str, only: Iterable[str] | None
) -> Iterator[Mismatch]:
    """Each figure whose words or lines differ, with the first of them."""
    shown, right = shown_by(html), shown_by(again)
    files = {one.id: one.files for one in record.figures}
    for figure in {**shown, **right} if only is None else only:
        both = zip_longest(shown.get(figure, ()), right.get(figure, ()), fillvalue="nothing")
        pairs = [(was, now) for was, now in both if was != now]
        named = [one for one in files.get(figure, ()) if one != ALL] or list(record.files)
        file = ", ".join([*named[:3], *["…"][: len(named) - 3]])
        more = f" (and {len(pairs) - MOST} more)" if len(pairs) > MOST else ""
        for was, now in pairs[:MOST]:
            one, other = _around(was, now)
            yield Mismatch(page=str(page), figure=figure, shown=one, recomputed=other + more,
                           file=file)  # fmt: skip


def _around(one: str, other: str, most: int = 60) -> tuple[str, str]:
    """Two words, long ones cut to where they differ."""
    if max(len(one), len(other)) <= most:
        return one, other
    same = takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False))
    start = max(sum(1 for _ in same) - 20, 0)
    return one[start : start + most], other[start : start + most]


# ---- errors of a sub-model, from its predictions


def _submodel_folder(record: PageRecord, name: str) -> Path | None:
    """Folder of a sub-model whose verdict and predictions a page of it rests on."""
    if not re.fullmatch(rf".+_{name}\.html", record.page):
        return None
    found = [Path(one).parent for one in record.files if one.endswith(f"/{name}/verdict.json")]
    return found[0] if found and (found[0] / "predictions.parquet").is_file() else None


def _scores_again(page: Path, folder: Path, name: str, sample: int | None) -> Iterator[Mismatch]:
    """Errors of the stored verdict that the stored predictions do not give."""
    verdict = read_json(folder / "verdict.json", Verdict)
    frame, one = read_predictions(folder / "predictions.parquet"), submodel(name)
    values = read_params()
    settings = one.judging(**{
        section: structure(values, section_path(values, section, verdict.machine), wanted)
        for section, wanted in sections(one.judging).items()
    })  # fmt: skip
    model = read_json(folder / "model.json", one.model)
    targets = {(t.quantity, t.regime): t for t in one.targets(settings, model)}
    for score in verdict.scores[:sample]:
        target = targets.get((score.quantity, score.regime))
        rows = None if target is None else _rows_of(score, target, verdict, frame)
        if rows is None or not len(rows):
            continue
        error = (rows["predicted"] - rows["measured"]).to_numpy(float)
        again = {
            "n": len(error), "mae": np.abs(error).mean(), "rmse": np.sqrt((error**2).mean()),
            "max": np.abs(error).max(), "bias": error.mean(),
        }  # fmt: skip
        for key, now in again.items():
            was = getattr(score, key)
            if was is not None and abs(was - now) > LAST_DIGIT * max(abs(was), again["rmse"]):
                regime = f", {score.regime}" if score.regime else ""
                yield Mismatch(
                    page=str(page), figure=f"{key} of {score.quantity}{regime}, {score.group}",
                    shown=f"{was:.6g}", recomputed=f"{now:.6g}",
                    file=(folder / "predictions.parquet").as_posix(),
                )  # fmt: skip


def _rows_of(
    score: Score, target: Target, verdict: Verdict, frame: "pd.DataFrame"
) -> "pd.DataFrame":
    """Rows of a score: known, of its quantity, regime, role and group, with what it must beat."""
    rows = frame[
        (frame["quantity"] == score.quantity) & (frame["regime"] == score.regime)
        & (frame["role"] == score.role) & frame["scored"]
        & frame["measured"].notna() & frame["predicted"].notna()
    ]  # fmt: skip
    for name in target.must_beat:
        if (column := f"{BASELINE}{name}") in rows:
            known = rows[column].notna()
            rows = rows[known | ~known.groupby(rows["case"]).transform("any")]
    if score.group != ALL_GROUPS:
        return rows[rows["group"] == score.group]
    alone = [
        one.group for one in verdict.scores if one.alone
        and (one.quantity, one.regime, one.role) == (score.quantity, score.regime, score.role)
    ]  # fmt: skip
    return rows[~rows["group"].isin(alone)]


def said(found: Iterable[Verified]) -> Iterator[str]:
    """Lines of the command: each mismatch, then a line for each page."""
    for one in found:
        for bad in one.mismatches:
            if bad.figure == "input":
                yield f"{bad.page}: input {bad.file} was {bad.shown}, is {bad.recomputed}"
            else:
                yield (f"{bad.page}: {bad.figure} shows {bad.shown!r}, recomputed "
                       f"{bad.recomputed!r} from {bad.file}")  # fmt: skip
        result = f"{len(one.mismatches)} mismatches" if one.mismatches else "as shown"
        note = f" ({one.note})" if one.note else ""
        yield f"{one.page}: {one.inputs} inputs, {one.figures} figures: {result}{note}"
