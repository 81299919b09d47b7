"""Texts of the lead's and the fleet's page in one place: a file for each language.

``en.toml`` holds every text under its key, with named fields: ``"{count} values were removed"``.  A
text that depends on a count is a table of ``one`` and ``other``.  The other languages hold the same
keys and fields; beside them, in ``contributed``, phrases that come from elsewhere (titles of
sub-models, deadlines, sources), each under its English words.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from string import Formatter
from typing import Any

from pipeline.charts import numbers
from pipeline.charts.words import Entry, flat_entries, form_of

FOLDER = Path(__file__).parent / "languages"
CONTRIBUTED = "contributed"
"""Table of a language's file with phrases that are written elsewhere, in English."""


@dataclass(frozen=True)
class Texts:
    """The texts of one language, and numbers and times as it writes them."""

    language: str
    """Its code, as HTML's ``lang`` has it."""
    entries: Mapping[str, Entry]
    """Text, or forms ``one`` and ``other``, by dotted key."""
    contributed: Mapping[str, str] = field(default_factory=dict)
    """Phrases by their English words."""

    def __call__(self, key: str, count: int | None = None, **fields: object) -> str:
        """The text of ``key`` with its fields filled in; ``count`` chooses the form and is a field.

        ValueError when the language has no such text, or the text asks for a field that is not
        given.
        """
        entry = self.entries.get(key)
        if entry is None:
            raise ValueError(f"languages/{self.language}.toml has no text {key!r}: add it there")
        given = fields if count is None else {"count": self.number(count), **fields}
        try:
            return form_of(entry, count).format(**given)
        except KeyError as error:
            raise ValueError(
                f"text {key!r} of languages/{self.language}.toml has the field {error}, and the "
                f"page gives {', '.join(sorted(given)) or 'none'}: correct the text"
            ) from None

    def has(self, key: str) -> bool:
        """Whether there is a text ``key``."""
        return key in self.entries

    def given(self, phrase: str) -> str:
        """A phrase that is written elsewhere in English; itself where it is not translated."""
        if phrase in self.contributed:
            return self.contributed[phrase]
        words = self.contributed.get(phrase[:1].lower() + phrase[1:])
        return phrase if words is None else words[:1].upper() + words[1:]

    def title(self, phrase: str) -> str:
        """The same with a capital, as it stands at the head of a line."""
        words = self.given(phrase)
        return words[:1].upper() + words[1:]

    def joined(self, words: Sequence[str]) -> str:
        """A list as it is read aloud: ``X, Y and Z``."""
        if len(words) < 2:
            return "".join(words)
        return self("format.and", before=", ".join(words[:-1]), last=words[-1])

    def number(self, value: Any, digits: int = 3) -> str:
        """A number with ``digits`` significant digits."""
        return self.local(numbers.number(value, digits))

    def percent(self, part: float | None, whole: float | None) -> str:
        """Share of ``part`` in ``whole``."""
        return self.local(numbers.percent(part, whole))

    def hours(self, seconds: Any) -> str:
        """Seconds as hours, without the unit."""
        return self.local(numbers.hours(seconds))

    def duration(self, seconds: Any) -> str:
        """Seconds as people say them."""
        text = numbers.duration(seconds)
        days = text.removesuffix(f"{numbers.NARROW}days")
        return self.local(text) if days == text else self("format.days", days=self.local(days))

    def moment(self, value: Any) -> str:
        """Date and time to the minute, UTC."""
        when = numbers.instant(value)
        if when is None:
            return self("format.not_known")
        day = self.day(when.date().isoformat(), year=True)
        return self("format.moment", day=day, time=f"{when:%H:%M}")

    @staticmethod
    def clock(seconds: float) -> str:
        """Time of day from the seconds since midnight.

        >>> Texts.clock(3900)
        '01:05'
        """
        return f"{int(seconds // 3600):02d}:{int(seconds % 3600 // 60):02d}"

    def day(self, day: str, *, year: bool = False) -> str:
        """An ISO day in words; other text as it is."""
        words = numbers.day_words(day, year=year)
        if words == day:
            return day
        weekday, date, month, *rest = words.split(numbers.TOGETHER)
        return self(
            "format.day_of_year" if year else "format.day",
            weekday=self(f"weekday.{weekday}"), day=date, month=self(f"month.{month}"),
            year="".join(rest),
        )  # fmt: skip

    def day_list(self, days: Sequence[str], most: int = 4) -> str:
        """Days in words, at most ``most`` of them by name."""
        names = [self.day(day) for day in days[:most]]
        if len(days) > most:
            names.append(self("format.more", count=len(days) - most))
        return self.joined(names)

    def some(self, names: Sequence[str], most: int = 3) -> str:
        """The first of some names, and how many more there are."""
        shown = ", ".join(names[:most])
        rest = len(names) - most
        return self("format.and_more", before=shown, count=rest) if rest > 0 else shown

    def local(self, text: str) -> str:
        """A number as :mod:`~pipeline.charts.numbers` writes it, with this language's comma."""
        if text == numbers.NOT_KNOWN:
            return self("format.not_known")
        return text.replace(".", self("format.decimal"))


def languages() -> tuple[str, ...]:
    """Codes of the languages that there are."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))


@cache
def texts(language: str) -> Texts:
    """The texts of a language, read once.

    ValueError when there is no such language, or its file lacks a text or a field of the English
    one.
    """
    if language not in languages():
        raise ValueError(
            f"there are no texts in the language {language!r}: choose one of "
            f"{', '.join(languages())}, or add pipeline/report/languages/{language}.toml"
        )
    document = tomllib.loads((FOLDER / f"{language}.toml").read_text(encoding="utf-8"))
    contributed = document.pop(CONTRIBUTED, {})
    found = Texts(language, dict(flat_entries(document)), contributed)
    if language != "en":
        check_like(found, texts("en"))
    return found


def check_like(translation: Texts, model: Texts) -> None:
    """Refuse texts that lack a key or a field of ``model``, or have others.

    ValueError with the file, the key and the field.
    """
    file = f"languages/{translation.language}.toml"
    for key in sorted(set(model.entries) ^ set(translation.entries)):
        lacks = key in model.entries
        raise ValueError(
            f"{file} {'lacks' if lacks else 'has'} the text {key!r}, which languages/"
            f"{model.language}.toml {'has: add it' if lacks else 'lacks: remove it'}"
        )
    for key, entry in translation.entries.items():
        fields, wanted = fields_of(entry), fields_of(model.entries[key])
        if fields != wanted:
            raise ValueError(
                f"text {key!r} of {file} has the fields {_listed(fields)}, and that of "
                f"languages/{model.language}.toml {_listed(wanted)}: use the same"
            )


def fields_of(entry: Entry) -> set[str]:
    """Names of the fields of a text, of all its forms together."""
    forms = [entry] if isinstance(entry, str) else [*entry.values()]
    return {name for form in forms for _, name, _, _ in Formatter().parse(form) if name}


def _listed(names: set[str]) -> str:
    return ", ".join(sorted(names)) or "none"


ENGLISH = texts("en")


@dataclass(frozen=True, kw_only=True)
class ReportSettings:
    """Settings of the pages of the fleet and of its machines."""

    language: str = "en"
    """Language of the fleet's and the leads' pages, by the name of its file in
    pipeline/report/languages; pages of evidence are in English."""

    def __post_init__(self) -> None:
        if self.language not in languages():
            raise ValueError(
                f"pages.language is {self.language!r}: choose one of {', '.join(languages())}"
            )
