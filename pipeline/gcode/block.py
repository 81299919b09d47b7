"""One block with its numbers: words by letter, G and M codes, to be taken one by one."""

from collections.abc import Mapping
from dataclasses import dataclass

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.statements import WordItem

AXES = {"X": 0, "Y": 1, "Z": 2, "A": 3, "B": 4, "C": 5}
"""Letter -> index into positions."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """Where a block leads: M98, M99, G65 or the end of the program.

    Parameters
    ----------
    kind : str
        ``"call"``, ``"return"`` or ``"end"``.
    item : WordItem
        The word that says so.
    number : int or None
        Of the program to call, or of the N word to return to.
    count : int
        How often.
    arguments : mapping of int to float, or None
        Local variables of a macro; None for a plain subprogram, which shares those of its caller.
    """

    kind: str
    item: WordItem
    number: int | None = None
    count: int = 1
    arguments: Mapping[int, float] | None = None


class Block:
    """What a line asks for, evaluated.  Who carries a word out takes it; what is left is an error.

    Parameters
    ----------
    file : str
        Name for errors.
    line : int
        Counting from 1.
    """

    __slots__ = (
        "actions", "comments", "feed_given", "file", "flow", "items", "line", "m_codes",
        "modifiers", "ordered", "words",
    )  # fmt: skip

    def __init__(self, file: str, line: int) -> None:
        self.file, self.line = file, line
        self.words: dict[str, float] = {}
        self.items: dict[str, WordItem] = {}
        self.ordered: list[tuple[WordItem, float]] = []
        self.actions: list[tuple[int, str, int, WordItem]] = []
        self.m_codes: list[int] = []
        self.modifiers: set[int] = set()
        self.comments: tuple[str, ...] = ()
        self.feed_given = False
        self.flow: Jump | None = None

    def take(self, letter: str) -> float | None:
        """Value of a word, which then counts as carried out; None where there is none."""
        return self.words.pop(letter, None)

    def need(self, letter: str, what: str, item: WordItem) -> float:
        """Value of a word that ``what`` cannot do without."""
        value = self.words.pop(letter, None)
        if value is None:
            raise self.error(item, f"{what} needs {letter}: add it")
        return value

    def whole(self, letter: str, value: float, least: int, most: int) -> int:
        """A word's value as an integer between two limits."""
        number = round(value)
        if abs(number - value) > 1e-4 or not least <= number <= most:
            raise self.error(
                self.items.get(letter),
                f"{letter}{value:g} must be a whole number from {least} to {most}: correct it",
            )
        return number

    def error(self, item: WordItem | None, reason: str) -> GcodeError:
        """The error about one word of the block."""
        return GcodeError(
            file=self.file,
            line=self.line,
            column=item.column if item else 1,
            word=item.text if item else "block",
            reason=reason,
        )

    def any_item(self) -> WordItem | None:
        """A word to point at when none in particular is wrong."""
        return self.ordered[0][0] if self.ordered else None

    @property
    def has_axes(self) -> bool:
        """Whether an axis word is left."""
        return not AXES.keys().isdisjoint(self.words)
