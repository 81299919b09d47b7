"""F of the rows of a program in the unit in which the program writes it: G20 or G21, G93 to G95."""

from typing import Literal, get_args

import numpy as np

from pipeline.gcode.moves import FeedMode, Moves
from pipeline.gcode.program import Program
from pipeline.optimisation.text.words import FeedText, ProgramWords
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.part_sheet import FeedUnit

FEED_UNITS: tuple[FeedUnit, ...] = get_args(FeedUnit)


class FeedWords:
    """F of each row of a program in the unit in which the program writes it."""

    def __init__(self, program: Program, moves: Moves) -> None:
        by_time = moves.feed_mode == FeedMode.INVERSE_TIME
        self.length = FeedText.of(ProgramWords(program), moves).unit
        self._factor = np.where(by_time, 1.0, self.length)
        self.code = np.select(
            [by_time, moves.feed_mode == FeedMode.PER_REVOLUTION], [4, 1], 0
        ) + np.where((self.length != 1.0) & ~by_time, 2, 0)  # fmt: skip

    def unit(self, row: int) -> FeedUnit:
        """Unit of the F of a row."""
        return FEED_UNITS[int(self.code[row])]

    def written(self, feeds: Floats) -> Floats:
        """F (M,) in the units of ``Moves`` as the text has it."""
        return np.round(feeds / self._factor, 9)

    def program_unit(self, rows: Bools) -> Literal["mm", "inch"]:
        """Unit of length of most of some rows."""
        return "inch" if 2 * np.count_nonzero(self.length[rows] != 1.0) > rows.sum() else "mm"
