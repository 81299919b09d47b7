"""Words of a page in a TOML file beside its code: texts by key, with named fields.

A text that depends on a count is a table of ``one`` and ``other``.
"""

import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pipeline.charts.numbers import number

PLURAL = {"one", "other"}

Entry = str | Mapping[str, str]
"""A text, or its forms ``one`` and ``other``."""


def flat_entries(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Entry]]:
    """Texts of nested tables by dotted key."""
    for name, value in table.items():
        if isinstance(value, str) or set(value) == PLURAL:
            yield above + name, value
        else:
            yield from flat_entries(value, f"{above}{name}.")


def form_of(entry: Entry, count: int | None) -> str:
    """The text, in the form of a count."""
    return entry if isinstance(entry, str) else entry["one" if count == 1 else "other"]


@dataclass(frozen=True, kw_only=True)
class PageWords:
    """Words of a sub-model's page, or of a part of it, read from the file beside it.

    ``content`` holds the fields of :class:`~pipeline.charts.submodel_page.PageContent` that are
    words alone, ``meanings`` those of parameters, each under its name or, of a group, under
    ``"<group> <name>"``; ``words`` every other text.
    """

    content: Mapping[str, Any]
    meanings: Mapping[str, str]
    words: Mapping[str, Entry]

    def __call__(self, key: str, count: int | None = None, **fields: object) -> str:
        """The text of ``key`` with its fields filled in; ``count`` chooses the form and is one."""
        given = fields if count is None else {"count": number(count), **fields}
        return form_of(self.words[key], count).format(**given)

    def table(self, key: str, **fields: object) -> dict[str, str]:
        """Texts of a table by name, in their order, with their fields filled in."""
        head = f"{key}."
        return {name.removeprefix(head): form_of(entry, None).format(**fields)
                for name, entry in self.words.items() if name.startswith(head)}  # fmt: skip

    def meaning(self, group: str, name: str) -> str:
        """Meaning of a parameter; a dash where none is declared."""
        return self.meanings.get(f"{group} {name}") or self.meanings.get(name, "–")


@cache
def page_words(code: str) -> PageWords:
    """Words in the ``.toml`` beside the page's ``code`` (its ``__file__``)."""
    document = tomllib.loads(Path(code).with_suffix(".toml").read_text(encoding="utf-8"))
    return PageWords(
        content=document.pop("content", {}), meanings=document.pop("meanings", {}),
        words=dict(flat_entries(document)),
    )  # fmt: skip
