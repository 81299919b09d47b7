"""What was changed in a program's words."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WordChange:
    """One F or S word.

    Parameters
    ----------
    line : int
        Counting from 1.
    letter : str
        ``"F"`` or ``"S"``.
    before : str or None
        As written; None where it was added.
    after : str
        As written.
    """

    line: int
    letter: str
    before: str | None
    after: str
