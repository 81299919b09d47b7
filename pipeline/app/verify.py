"""Verification of pages: inputs by their hashes, figures computed again (`kerf verify`).

A page is made again elsewhere, one of the report by the report, that of a command by the same
command; each text and each line of a drawing is held against the page.  The errors of a sub-model
are computed again from its predictions besides.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from hashlib import sha256
from html import unescape
from itertools import takewhile, zip_longest
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

from pipeline.app.document_figures import document_figures
from pipeline.app.fleet import write_report
from pipeline.charts.sources import shown as as_named
from pipeline.parameters import read_params, section_path, structure
from pipeline.report.provenance import ALL, PageRecord, record_of
from pipeline.schema.predictions import read_predictions
from pipeline.schema.store import content, read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.contract import sections, submodel, submodels
from pipeline.submodels.judge import scores_of

MOST = 5
"""Values of one figure that are named at most; the others are counted."""
OUTPUTS = ("--out", "--json", "--page", "--corrected")
"""Options of commands that name a file to write."""
COMMANDS = ("simulate", "optimise", "transfer")
"""Commands that make pages; a record that names another is not followed."""
ERRORS = ("n", "mae", "rmse", "max", "bias")
LAST_DIGIT = 1e-5
"""Relative difference of an error within the six digits that are stored."""
TEXT = "text"
"""Figure of words that stand in none."""
SHOWN = re.compile(
    r'\bid="(?P<id>[^"]*)"|</(?P<end>table|figure|dl)>|="(?P<value>[^"]*)"|>(?P<words>[^<]+)'
)
"""What a page shows: identifiers and ends of its figures, attributes and words."""
REMEDY = "build the page again, `dvc repro report` or its command"


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """A figure that is not what its inputs give."""

    figure: str
    """Identifier of the figure, or ``text`` of words outside."""
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
    """Figures that were compared, of ``shown`` ones."""
    shown: int
    changed: tuple[Mismatch, ...] = ()
    """Inputs that are not what they were, by the beginnings of their hashes."""
    mismatches: tuple[Mismatch, ...] = ()
    note: str = ""

    @property
    def failed(self) -> bool:
        """Whether an input or a figure differs."""
        return bool(self.changed or self.mismatches)


def verify_all(paths: Iterable[Path], sample: int | None = None, seed: int = 0) -> list[Verified]:
    """Verify pages and Markdown documents; those of a folder are its Markdown files."""
    found = []
    with TemporaryDirectory() as place:
        for path in paths:
            if path.is_dir():
                documents = sorted(path.rglob("*.md"))
                if not documents:
                    raise ValueError(f"{path} holds no Markdown: name pages, as {path}/*.html")
                found += [verify_document(one) for one in documents]
            elif path.suffix == ".md":
                found.append(verify_document(path))
            else:
                found.append(verify_page(path, Path(place), sample, seed))
    return found


def verify_document(path: Path) -> Verified:
    """Verify the figures of a Markdown document that have a source."""
    try:
        text = content(path, "name a page or a document").decode()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path} is no Markdown in UTF-8 ({error}): name another file") from error
    figures = list(document_figures(text, Path(), str(path)))
    stale = tuple(
        Mismatch(figure=f"line {one.line}", shown=one.shown, recomputed=one.recomputed,
                 file=one.source)
        for one in figures if one.shown != one.recomputed
    )  # fmt: skip
    files = {one.source.partition("#")[0] for one in figures}
    many = len(figures)
    return Verified(page=str(path), inputs=len(files), figures=many, shown=many, mismatches=stale)


def verify_page(page: Path, place: Path, sample: int | None = None, seed: int = 0) -> Verified:
    """Verify one page, made again below ``place``.

    ``sample`` is the number of figures, and of errors of a sub-model, that are compared, drawn by
    ``seed``; None for all.
    """
    try:
        html = content(page, "name a page of the report or of a command").decode()
        record = read_json(record_of(page), PageRecord, REMEDY)
    except UnicodeDecodeError as error:
        raise ValueError(f"{page} is no page of Kerf ({error}): {REMEDY}") from error
    changed, ids = tuple(_changed(record.files)), list(record.figures)
    found = partial(
        Verified, page=str(page), inputs=len(record.files), shown=len(ids), changed=changed
    )
    try:
        again, code = _again(page, record, place)
    except ValueError as error:
        if not changed:
            raise
        return found(figures=0, note=str(error))
    drawn = Random(seed).sample(ids, min(sample or len(ids), len(ids)))
    wrong = [*_compared(record, html, again, drawn if sample else [TEXT, *ids])]
    if not changed:
        wrong += _scores_again(record, sample, seed)
    made = record.made.code
    note = "" if code == made else f"made by code {made[:12]}, verified by {code[:12]}"
    return found(figures=len(drawn), mismatches=tuple(wrong), note=note)


def _changed(files: Mapping[str, str]) -> Iterator[Mismatch]:
    for file, named in files.items():
        path = Path(file)
        now = sha256(path.read_bytes()).hexdigest() if path.is_file() else "not there"
        if now != named:
            yield Mismatch(figure="input", shown=named[:12], recomputed=now[:12], file=file)


# ---- the page, made again


def _again(page: Path, record: PageRecord, place: Path) -> tuple[str, str]:
    """HTML of a page made again below ``place``, and the hash of the code that made it."""
    words, moved = record.made.command, dict[Path, Path]()
    if words and words[0] not in COMMANDS:
        raise ValueError(
            f"{record_of(page)} names `kerf {words[0]}`, which makes no page: {REMEDY}"
        )
    if words:
        call = [
            one for word in words
            for one in (word.split("=", 1) if word.startswith(OUTPUTS) else (word,))
        ]  # fmt: skip
        named = {k: Path(call[k]) for k in range(1, len(call)) if call[k - 1] in OUTPUTS}
        moved = {path: place / path.name for path in named.values()}
        command = [str(moved[named[k]]) if k in named else word for k, word in enumerate(call)]
        done = subprocess.run(
            [sys.executable, "-m", "pipeline.app", "-q", *command],
            capture_output=True, text=True, check=False,
        )  # fmt: skip
        made = next(moved[path] for k, path in named.items() if call[k - 1] == "--page")
        why = (done.stderr.strip().splitlines() or ["it wrote no page"])[-1]
        why = f"`kerf {' '.join(words)}` does not make it again: {why}"
    else:
        made = _report_again(page.parent, place) / record.page
        why = (
            "it is no page of the fleet that is active here: make its fleet active with `kerf "
            "fleet NAME`, or work in its project"
        )
    if not made.is_file():
        raise ValueError(f"{page}: {why}")
    html = made.read_text(encoding="utf-8")
    for path, elsewhere in moved.items():
        html = html.replace(as_named(elsewhere), as_named(path))
        elsewhere.unlink(missing_ok=True)
    return html, read_json(record_of(made), PageRecord).made.code


def _report_again(reports: Path, place: Path) -> Path:
    """Folder of the report made again, once, held against the same earlier report."""
    out = place / sha256(str(reports).encode()).hexdigest()
    if not out.exists():
        out.mkdir()
        if (earlier := reports / "report.json").is_file():
            shutil.copy(earlier, out)
        write_report(out)
    return out


# ---- what a page shows


def shown_by(html: str, ids: Iterable[str]) -> dict[str, list[str]]:
    """Words and attributes of a page by the figure of ``ids`` that they stand in."""
    figures, place = set(ids), TEXT
    found: dict[str, list[str]] = {}
    for one in SHOWN.finditer(html):
        if one["id"] in figures:
            place = one["id"]
        elif one["end"]:
            place = TEXT
        elif words := " ".join(unescape(one["words"] or one["value"] or "").split()):
            found.setdefault(place, []).append(words)
    return found


def _compared(
    record: PageRecord, html: str, again: str, figures: Iterable[str]
) -> Iterator[Mismatch]:
    """Each of some figures whose words or lines differ, with the first of them."""
    files = record.figures
    shown, right = shown_by(html, files), shown_by(again, files)
    for figure in figures:
        both = zip_longest(shown.get(figure, ()), right.get(figure, ()), fillvalue="nothing")
        pairs = [(was, now) for was, now in both if was != now]
        named = [one for one in files.get(figure, ()) if one != ALL] or list(record.files)
        file = ", ".join([*named[:3], *["…"][: len(named) - 3]])
        more = f" (and {len(pairs) - MOST} more)" if len(pairs) > MOST else ""
        for was, now in pairs[:MOST]:
            one, other = _around(was, now)
            yield Mismatch(figure=figure, shown=one, recomputed=other + more, file=file)


def _around(one: str, other: str, most: int = 60) -> tuple[str, str]:
    """Two words, long ones cut to where they differ."""
    if max(len(one), len(other)) <= most:
        return one, other
    same = takewhile(lambda pair: pair[0] == pair[1], zip(one, other, strict=False))
    start = max(sum(1 for _ in same) - 20, 0)
    return one[start : start + most], other[start : start + most]


# ---- errors of a sub-model, from its predictions


def _scores_again(record: PageRecord, most: int | None, seed: int) -> Iterator[Mismatch]:
    """Errors of the verdict of a sub-model's page that its predictions do not give."""
    name = next((one for one in submodels() if record.page.endswith(f"_{one}.html")), "")
    verdicts = [Path(one) for one in record.files if one.endswith(f"/{name}/verdict.json")]
    if not verdicts or not (predictions := verdicts[0].with_name("predictions.parquet")).is_file():
        return
    verdict, one, values = read_json(verdicts[0], Verdict), submodel(name), read_params()
    settings = one.judging(**{
        section: structure(values, section_path(values, section, verdict.machine), wanted)
        for section, wanted in sections(one.judging).items()
    })  # fmt: skip
    model, frame = (
        read_json(verdicts[0].with_name("model.json"), one.model),
        read_predictions(predictions),
    )
    beyond = {case.case for case in verdict.outside}
    again = {
        (score.quantity, score.regime, score.role, score.group): score
        for target in one.targets(settings, model)
        for score in scores_of(frame, target, verdict.judged_role or "held_out", beyond,
                               len(model.trained_on))
    }  # fmt: skip
    many = len(verdict.scores)
    for was in Random(seed).sample(verdict.scores, min(most or many, many)):
        now = again.get((was.quantity, was.regime, was.role, was.group), was)
        for key in ERRORS:
            old, new = getattr(was, key), getattr(now, key)
            if None in (old, new) or abs(old - new) <= LAST_DIGIT * max(abs(old), now.rmse or 0):
                continue
            regime = f", {was.regime}" if was.regime else ""
            yield Mismatch(
                figure=f"{key} of {was.quantity}{regime}, {was.group}", shown=f"{old:.6g}",
                recomputed=f"{new:.6g}", file=predictions.as_posix(),
            )  # fmt: skip


def said(found: Iterable[Verified]) -> Iterator[str]:
    """Lines of the command: what differs, then a line for each page.

    Of a page that is older than an input the figures are counted, since each may differ.
    """
    for one in found:
        bad = len(one.mismatches)
        if one.changed:
            first = one.changed[0]
            more = f" and {len(one.changed) - 1} more" if one.changed[1:] else ""
            figures = len({each.figure for each in one.mismatches} - {TEXT})
            result = (
                f"made before input {first.file} ({first.shown}, is {first.recomputed}){more} "
                f"changed: make it anew; {figures} of the figures differ"
            )
        else:
            for each in one.mismatches:
                yield (f"{one.page}: {each.figure} shows {each.shown!r}, recomputed "
                       f"{each.recomputed!r} from {each.file}")  # fmt: skip
            result = f"{bad} mismatches" if bad else "as shown"
        of = f" of {one.shown}" if one.figures < one.shown else ""
        note = f" ({one.note})" if one.note else ""
        yield f"{one.page}: {one.inputs} inputs, {one.figures}{of} figures: {result}{note}"
