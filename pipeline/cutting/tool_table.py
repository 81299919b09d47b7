"""The tool table of a machine: which tool the number after T means."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool


@dataclass(frozen=True, kw_only=True)
class ToolTable:
    """Tools by their number.

    Parameters
    ----------
    tools : dict of int to Tool
        By the number in the program.
    description : str
        Whose tools they are, for people.

    Raises
    ------
    ValueError
        When there is no tool, or a number is negative.
    """

    tools: dict[int, Tool]
    description: str = ""

    def __post_init__(self) -> None:
        if not self.tools:
            raise ValueError("the tool table is empty: write its tools as `tools: {1: {...}}`")
        for number in self.tools:
            if number < 0:
                raise ValueError(f"tools.{number} is no tool number: it must be 0 or more")

    def tool(self, number: int) -> Tool:
        """The tool with that number.

        Raises
        ------
        ValueError
            When the table does not have it.
        """
        if number not in self.tools:
            known = ", ".join(map(str, sorted(self.tools)))
            raise ValueError(
                f"tool {number} is not in the tool table, which has {known}: add it there, or name "
                "another table"
            )
        return self.tools[number]

    def chosen(self, numbers: Sequence[int]) -> tuple[list[Tool], NDArray[np.int32]]:
        """The tools that a program uses and, for each of its numbers, the index among them.

        Parameters
        ----------
        numbers : sequence of int, length Q
            Tool numbers in the order of the program.

        Returns
        -------
        list of Tool, ndarray of int32 of shape (Q,)
            Tools in the order of their numbers.

        Raises
        ------
        ValueError
            When the table lacks one.
        """
        used, index = np.unique(np.asarray(numbers, dtype=np.int64), return_inverse=True)
        return [self.tool(int(number)) for number in used], index.astype(np.int32).reshape(-1)
