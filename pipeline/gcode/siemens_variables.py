"""Variables of a Sinumerik program: REAL, INT and BOOL by name, and R parameters."""

from pipeline.gcode.errors import ExpressionError
from pipeline.gcode.run import Run


class SiemensVariables:
    """Names and their values; DEF makes them, with 0 where it gives no value.

    Parameters
    ----------
    run : Run
        Whose setup says what has a value at the start.
    """

    def __init__(self, run: Run) -> None:
        self.values: dict[int | str, float] = dict(run.setup.parameters)
        self.line = 0

    def enter(self, arguments: dict[int, float]) -> None:
        """Subprograms of this dialect are not followed; there is nothing to set apart."""

    def leave(self) -> None:
        """See :meth:`enter`."""

    def read(self, key: int | str) -> float | None:
        """Value of a name."""
        if key not in self.values:
            raise ExpressionError(f"{key} has no value: define it with DEF before")
        return self.values[key]

    def write(self, key: int | str, value: float | None) -> None:
        """Keep a value."""
        self.values[key] = value or 0.0

    def exists(self, key: int | str) -> bool:
        """Whether a name has a value."""
        return key in self.values
