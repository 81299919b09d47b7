"""Reads a page as its reader meets it: tags, text, whether every tag is closed."""

import re
from html.parser import HTMLParser
from pathlib import Path

VOID = {"meta", "link", "br", "input"}


class Outline(HTMLParser):
    """What a reader of the page meets: text, tags, and whether every tag is closed."""

    def __init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict]] = []
        self.text: list[str] = []

    def handle_starttag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open[-1:] not in (["style"], ["script"]):
            self.text.append(data)


def outline(page: Path) -> Outline:
    parsed = Outline()
    parsed.feed(page.read_text(encoding="utf-8"))
    assert parsed.open == []
    return parsed


def evidence(page: Path) -> list[Path]:
    """Pages of evidence beside a machine's page."""
    return sorted(page.parent.glob(f"{page.stem}_*.html"))


def words(page: Path) -> str:
    """Text of a page."""
    return re.sub(r"\s+", " ", " ".join(outline(page).text))


def every_word(page: Path) -> str:
    """Text of a machine's page and of its pages of evidence, that first."""
    return " ".join(words(one) for one in [page, *evidence(page)])


def section(page: Path, key: str) -> str:
    """HTML of one section, on a page or on those of its evidence; empty when none has it."""
    for one in [page, *evidence(page)]:
        found = re.search(rf'<section id="{key}".*?</section>', one.read_text(), flags=re.S)
        if found:
            return found.group()
    return ""
