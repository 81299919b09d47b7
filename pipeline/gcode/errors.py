"""Errors of part programs, with the place and the remedy."""

import unicodedata
from collections.abc import Callable


class GcodeError(ValueError):
    """A word that cannot be interpreted: its place, the reason and the remedy.

    Line and column of the word count from 1; 0 where there is none.
    """

    def __init__(self, file: str, line: int, column: int, word: str, reason: str) -> None:
        self.file, self.line, self.column = file, line, column
        self.word, self.reason = word, reason
        super().__init__(f"{file}:{line}:{column}: {word}: {reason}")


ALIKE = dict(
    zip("АВЕКМНОРСТХУІЈЅΑΒΕΖΗΙΚΜΝΟΡΤΥΧаеосрхуіј",
        "ABEKMHOPCTXYIJSABEZHIKMNOPTYXaeocpxyij", strict=True)
)  # fmt: skip
"""Cyrillic and Greek letters -> the Latin letter that they look like."""


def strange_character(text: str, at: int) -> str:
    """Name of a character that is not ASCII at a place of a line; empty where it is ASCII."""
    raw = text[at : at + 4].encode("latin-1", "replace")
    if not raw or raw[0] < 0x80:
        return ""
    length = next((n for n in (2, 3, 4) if _decoded(raw[:n], "utf-8")), 0)
    sign = _decoded(raw[:length], "utf-8") if length else _decoded(raw[:1], "cp1252")
    if not sign:
        return f"byte 0x{raw[0]:02X} has no meaning in a program: retype what stands here"
    name = f"U+{ord(sign):04X} ({unicodedata.name(sign, 'no name')})"
    dash = unicodedata.category(sign) == "Pd" or sign == "\u2212"
    plain = "-" if dash else ALIKE.get(sign, unicodedata.normalize("NFKC", sign))
    if plain.isascii() and plain.strip():
        words = "the minus sign -" if dash else plain
        return f"{name} stands for {words}: type {plain} instead"
    return f"{name} has no meaning in a program: retype what stands here"


def _decoded(raw: bytes, encoding: str) -> str:
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        return ""
    return text if len(text) == 1 else ""


ErrorAt = Callable[[str], GcodeError]
"""Error about one place, from its reason."""
