"""Errors of part programs, with the place and the remedy."""

from collections.abc import Callable


class GcodeError(ValueError):
    """A word that cannot be interpreted: its place, the reason and the remedy.

    Parameters
    ----------
    file : str
        Name of the program.
    line, column : int
        Of the word, counting from 1; 0 where there is none.
    word : str
        As written.
    reason : str
        Why, and what to do.
    """

    def __init__(self, file: str, line: int, column: int, word: str, reason: str) -> None:
        self.file, self.line, self.column = file, line, column
        self.word, self.reason = word, reason
        super().__init__(f"{file}:{line}:{column}: {word}: {reason}")


ErrorAt = Callable[[str], GcodeError]
"""Error about one place, from its reason."""
