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


def words(page: Path) -> str:
    return re.sub(r"\s+", " ", " ".join(outline(page).text))


def section(page: Path, key: str) -> str:
    """HTML of one section of a page; empty when the page has none of that key."""
    found = re.search(rf'<section id="{key}".*?</section>', page.read_text(), flags=re.S)
    return found.group() if found else ""
