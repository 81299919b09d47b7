"""Words that a run gives no proof of: in lines that it leaves out, or read by the program itself.

A line that is not executed (behind the end, jumped over, skipped) makes no moves to compare, and
nothing tells what F or S would mean in it.  A program that reads the F or S in force may keep it in
a variable that outlives the run, or go another way for it.
"""

import re

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof_splits import Splits
from pipeline.optimisation.proof_text import Difference, shown
from pipeline.optimisation.word_changes import WordChange

Flags = NDArray[np.bool_]

LEFT_OUT = "it is not executed, so that nothing proves what its F or S means"
OTHER_WAY = "one program executes it and the other does not"
READ = "it reads the F or S in force, which differ"
_READS = re.compile(
    rb"(?i)#<\s*_(?:feed|rpm)\s*>|#\s*4\s*[0-4]\s*[01]\s*9(?![0-9])|\$P_[FS]\b|\$AC_"
)
"""The feed and speed in force: LinuxCNC's parameters, Fanuc's modal variables, Siemens' own."""


def followed(program: Program, setup: Setup) -> tuple[Moves, Flags]:
    """What a program makes, and which of its lines it executes (L + 1,), that of line n is n."""
    walk = Interpreter(program, setup)
    return walk.moves(), walk.executed


def without_proof(
    changes: tuple[WordChange, ...],
    lines: list[bytes],
    others: list[bytes],
    executed: Flags,
    executed_after: Flags,
) -> Difference | None:
    """The first line that the moves do not speak for; None where there is none.

    Parameters
    ----------
    changes : tuple of WordChange
        F and S words that differ.
    lines, others : list of bytes
        The programs' lines before and after, the same number of each.
    executed, executed_after : ndarray of bool, shape (L + 1,)
        Which of them are executed.
    """
    if not changes:
        return None
    wrong = [(change.line, LEFT_OUT) for change in changes if not executed[change.line]]
    wrong += [(line, OTHER_WAY) for line in np.flatnonzero(executed != executed_after)[:1].tolist()]
    wrong += [
        (line, READ) for line, text in enumerate(lines, 1) if executed[line] and _READS.search(text)
    ][:1]
    if not wrong:
        return None
    line, reason = min(wrong)
    return Difference(line, shown(lines[line - 1]), shown(others[line - 1]), reason)


def of_kept(executed: Flags, splits: Splits | None) -> Flags:
    """Executed lines of a text without those that were put in."""
    if splits is None:
        return executed
    return np.delete(executed, sorted(splits.points))
