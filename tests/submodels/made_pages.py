"""Pages of sub-models as tests read them: made by the frame, in words, as an outline."""

import os
import re
from pathlib import Path
from typing import Any

from pipeline.charts.sections import Figures, Heading, SubModelPage
from pipeline.charts.submodel_page import PageContent, Subject, submodel_page
from pipeline.charts.tables import Table
from pipeline.submodels.contract import Shown, SubModel


def made(submodel: SubModel, shown: Shown) -> SubModelPage:
    """The page of a sub-model, as the report makes it."""
    subject = Subject(name=submodel.name, title=submodel.title, needs=submodel.needs)
    return submodel_page(shown, subject, submodel.page(shown) or PageContent())


def plain(text: str) -> str:
    """Text with ordinary spaces."""
    return " ".join(text.split())


def blocks(page: SubModelPage, kind: type) -> list[Any]:
    """Tables, figures or headings of a page."""
    return [b for s in page.sections for b in s.blocks if isinstance(b, kind)]


def tables(page: SubModelPage) -> dict[str, list[list[str]]]:
    """Cells of every table in words, the truth's among them, by caption."""
    return {plain(t.caption): [[plain(c.text) for c in row] for row in t.rows]
            for t in (*blocks(page, Table), *page.truth)}  # fmt: skip


def drawn(page: SubModelPage) -> dict[str, str]:
    """Figures of a page by caption."""
    return {plain(f.caption): str(f.svg) for b in blocks(page, Figures) for f in b.figures}


def words(page: SubModelPage) -> str:
    """Everything that a page says, without its figures."""
    said = [] if page.verdict is None else [page.verdict.sentence, page.verdict.todo]
    said += [word for figure in page.key_figures for word in figure]
    said += [*page.doubts, *page.notes]
    for section in page.sections:
        said += [section.title, *section.text]
    said += [f"{b.heading} {b.text}" for b in blocks(page, Heading)]
    for caption, rows in tables(page).items():
        said += [caption, *(cell for row in rows for cell in row)]
    said += [table.note for table in (*blocks(page, Table), *page.truth)]
    return plain(" ".join([*said, *drawn(page)]))


def outline(page: SubModelPage) -> str:
    """Head, sections, captions and heads of a page, with every number as #."""
    lines = [] if page.verdict is None else [page.verdict.status, page.verdict.sentence,
                                             page.verdict.todo]  # fmt: skip
    lines += [" | ".join(figure) for figure in page.key_figures]
    lines += [*page.doubts, *page.notes]
    lines += [f"{a.who}: {a.what}, {a.where}" for a in page.actions]
    for section in page.sections:
        lines += [f"== {section.title}", *section.text]
        for block in section.blocks:
            if isinstance(block, Heading):
                lines.append(f"-- {block.heading}: {block.text}")
            elif isinstance(block, Figures):
                lines += [f"figure: {one.caption}" for one in block.figures]
            elif isinstance(block, Table):
                lines.append(f"table: {block.caption}: {', '.join(h.label for h in block.heads)}")
    lines += [f"truth: {table.caption}" for table in page.truth]
    text = "\n".join(plain(line) for line in lines if line)
    return re.sub(r"[−+-]?\d[\d.]*(?: × 10\S+)?", "#", text) + "\n"


def held_to_golden(page: SubModelPage, golden: Path) -> None:
    """The outline is the one that is stored; KERF_WRITE_GOLDEN=1 stores it."""
    if os.environ.get("KERF_WRITE_GOLDEN"):
        golden.write_text(outline(page))
    assert outline(page) == golden.read_text(), f"if it is meant, write {golden.name} anew"
