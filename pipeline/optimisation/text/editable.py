"""Which F and S of a program may be changed: its blocks, and what holds the others."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class Held:
    """Blocks that stay as programmed: why, how many, the first of them as ``file:line``."""

    reason: str
    rows: int
    first: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Editable:
    """What may be changed in a program of M rows and B editable blocks.

    A block is one line of the program's own file; rows of one line (cycles, repeats) share it.

    Parameters
    ----------
    block : ndarray of intp, shape (M,)
        Block whose F each row takes, -1 for rows that keep theirs; in the order of the program.
    line : ndarray of intp, shape (B,)
        Line of each block.
    speed : ndarray of bool, shape (M,)
        Rows whose S may be changed.
    may_start : ndarray of bool, shape (M,)
        Rows whose line may get (or has) an S word: where a stretch of one S can begin.
    own_start : ndarray of bool, shape (M,)
        Those whose line has an S word already.
    held : tuple of Held
        What is not among them.
    """

    block: Rows = field(repr=False)
    line: Rows = field(repr=False)
    speed: Flags = field(repr=False)
    may_start: Flags = field(repr=False)
    own_start: Flags = field(repr=False)
    held: tuple[Held, ...]
