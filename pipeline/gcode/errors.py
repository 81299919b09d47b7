"""What the room says when a program cannot be followed."""


class GcodeError(ValueError):
    """A word that cannot be followed: where it stands, why, and what to do.

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

    def __init__(self, *, file: str, line: int, column: int, word: str, reason: str) -> None:
        self.file, self.line, self.column = file, line, column
        self.word, self.reason = word, reason
        super().__init__(f"{file}:{line}:{column}: {word}: {reason}")


class ExpressionError(ArithmeticError):
    """An expression without a value, in words; who knows the place makes a GcodeError of it."""
