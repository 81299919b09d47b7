"""Words that a run gives no proof of: in lines that it leaves out, or read by the program itself.

A line that is never executed (behind the end, jumped over) makes no moves to compare, and nothing
tells what F or S would mean in it.  Lines that begin with ``/`` depend on a switch at the machine:
programs are the same where they are so in both of its positions.  A program that reads the F or S
in force may keep it in a variable that outlives the run, or go another way for it.
"""

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof.splits import Splits
from pipeline.optimisation.proof.text import Difference, shown
from pipeline.optimisation.text.word_changes import WordChange

Flags = NDArray[np.bool_]

LEFT_OUT = "it is not executed, so that nothing proves what its F or S means"
OTHER_WAY = "one program executes it and the other does not"
READ = "it reads the F or S in force, which differ"
_READS = re.compile(
    rb"(?i)#<\s*_(?:feed|rpm)\s*>|#\s*\[?\s*4\s*[0-4]\s*[01]\s*9(?![0-9])|\$P_[FS]\b|\$AC_"
)
"""The feed and speed in force: LinuxCNC's parameters, Fanuc's modal variables, Siemens' own."""
_SKIP = re.compile(rb"(?i)\s*(?:N\s*[0-9]+\s*)?/")
LEVELS = tuple(range(1, 10))
"""Of ``/``, all that there are."""


def followed(program: Program, setup: Setup) -> tuple[Moves, Flags]:
    """What a program makes, and which of its lines it executes (L + 1,), that of line n is n."""
    walk = Interpreter(program, setup)
    return walk.moves(), walk.executed


def switches(lines: list[bytes], setup: Setup) -> list[Setup]:
    """The set-up, and where lines begin with ``/`` also with all of them executed, and none."""
    if not any(_SKIP.match(line) for line in lines):
        return [setup]
    others = [skip for skip in ((), LEVELS) if skip != setup.block_skip]
    return [setup, *(replace(setup, block_skip=skip) for skip in others)]


def left_out(
    changes: tuple[WordChange, ...], lines: list[bytes], others: list[bytes], executed: Flags
) -> Difference | None:
    """The first changed word that is in no line that is executed.

    Parameters
    ----------
    changes : tuple of WordChange
        F and S words that differ.
    lines, others : list of bytes
        The programs' lines before and after, the same number of each.
    executed : ndarray of bool, shape (L + 1,)
        Which of them are executed.
    """
    for change in changes:
        if not executed[change.line]:
            return _difference(change.line, lines, others, LEFT_OUT)
    return None


def other_way(
    lines: list[bytes], others: list[bytes], executed: Flags, executed_after: Flags
) -> Difference | None:
    """The first line that one program executes and the other does not."""
    differs = np.flatnonzero(executed != executed_after)
    return _difference(int(differs[0]), lines, others, OTHER_WAY) if len(differs) else None


def read(lines: list[bytes], others: list[bytes], executed: Flags) -> Difference | None:
    """The first executed line that reads the F or S in force."""
    for number, text in enumerate(lines, 1):
        if executed[number] and _READS.search(text):
            return _difference(number, lines, others, READ)
    return None


def of_kept(executed: Flags, splits: Splits | None) -> Flags:
    """Executed lines of a text without those that were put in."""
    return executed if splits is None else np.delete(executed, sorted(splits.points))


def _difference(number: int, lines: list[bytes], others: list[bytes], reason: str) -> Difference:
    return Difference(number, shown(lines[number - 1]), shown(others[number - 1]), reason)
