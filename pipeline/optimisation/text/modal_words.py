"""F or S along a program: which visits to its lines read it, and where it may be written.

A register holds the value in force.  A line with a word of the letter sets it; the others take
what they find.  What is written anew must leave every visit its value, in whatever order the lines
are executed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.optimisation.text.program_words import NONE, ProgramWords
from pipeline.optimisation.text.visits import Visits

Rows = NDArray[np.intp]
Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]

OTHER_MEANING = (4, 10, 25, 26, 50, 65, 66, 66.1, 92)
"""G codes whose line has words of these letters that leave the register alone."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ModalWords:
    """K visits that read the register of one letter, in the order of the program.

    Parameters
    ----------
    letter : str
        ``"F"`` or ``"S"``.
    visit : ndarray of intp, shape (K,)
        Which they are among all visits.
    line : ndarray of intp, shape (K,)
        0 in other files.
    row : ndarray of intp, shape (K,)
        First row that reads it.
    sets : ndarray of bool, shape (K,)
        Whether the line has a word of the letter.
    own : ndarray, shape (K,)
        Value in the units of ``Moves``.
    loose : ndarray of intp
        Lines with a word of the letter and no such visit, ascending.
    uncertain : bool
        Whether those may be executed between any two visits.
    optional : ndarray of bool, shape (K,)
        Whether the line begins with ``/``: it may be left out at the machine.
    loose_optional : bool
        Whether one of the loose lines does.
    """

    letter: str
    visit: Rows = field(repr=False)
    line: Rows = field(repr=False)
    row: Rows = field(repr=False)
    sets: Flags = field(repr=False)
    own: Floats = field(repr=False)
    loose: Rows = field(repr=False)
    uncertain: bool
    optional: Flags = field(repr=False)
    loose_optional: bool

    @classmethod
    def along(
        cls, letter: str, words: ProgramWords, visits: Visits, reads: Flags, values: Floats
    ) -> "ModalWords":
        """Those of rows ``reads`` (M,) with ``values`` (M,)."""
        token = np.where(words.codes("G", OTHER_MEANING), NONE, words.token(letter))
        first = visits.first_of(reads)
        visit = np.flatnonzero(first >= 0)
        line, row = visits.line[visit], first[visit]
        has = token != NONE
        loose = np.setdiff1d(np.flatnonzero(has), line)
        return cls(
            letter=letter, visit=visit, line=line, row=row, sets=has[line] & (line > 0),
            own=values[row], loose=loose, uncertain=words.winding and len(loose) > 0,
            optional=words.optional[line], loose_optional=bool(words.optional[loose].any()),
        )  # fmt: skip

    def handed_on(self, keeps: Flags, may: Flags) -> Flags:
        """Visits that must leave their own value in force, for one that cannot be given it (K,).

        Parameters
        ----------
        keeps : ndarray of bool, shape (K,)
            Visits that keep their value.
        may : ndarray of bool, shape (K,)
            Those whose line may be written into.
        """
        bound, needed = np.zeros(len(self.line), dtype=np.bool_), False
        ends = (self.sets | (may & ~self._depends())).tolist()
        keeping, writable, optional = keeps.tolist(), may.tolist(), self.optional.tolist()
        for k in range(len(ends) - 1, -1, -1):
            past = needed and optional[k]  # where the line is left out
            if keeping[k] and not writable[k]:
                needed = past or not ends[k]
            elif needed:
                bound[k] = True
                needed = past or not ends[k]
        return bound

    def written(self, wanted: Floats, may: Flags) -> Mapping[int, float]:
        """Line -> value of its word, changed or new, so that each visit has what is wanted.

        Parameters
        ----------
        wanted : ndarray, shape (K,)
            In the units of ``own``.
        may : ndarray of bool, shape (K,)
            Visits whose line may be written into.

        Raises
        ------
        ValueError
            When a visit would need a word and may have none.
        """
        values: dict[int, float] = {}
        known, value = True, 0.0
        columns = (
            self.line, self.own, wanted, self.sets, may, self._loose_before(), self.optional
        )  # fmt: skip
        for line, own, want, sets, writes, loose, optional in zip(
            *(column.tolist() for column in columns), strict=True
        ):
            past = known, value
            if not known and loose:
                known, value = not self.uncertain, np.nan
            if sets and writes:
                values[line] = want
            elif sets and want != own:
                raise self._error(line, own, want)
            elif not sets and line in values and line > 0:
                pass
            elif not sets and want != (own if known else value):
                if not writes:
                    raise self._error(line, own, want)
                values[line] = want
            if sets or line in values:
                known, value = want == own, want
            if optional and past != (known, value) and not (known and past[0]):
                known, value = False, np.nan  # it depends on whether the line is left out
        return values

    def _depends(self) -> Flags:
        """Visits whose own value depends on whether lines with ``/`` are left out (K,)."""
        if self.loose_optional:
            return ~self.sets
        found, depends = np.zeros(len(self.line), dtype=np.bool_), False
        for k, (sets, optional) in enumerate(
            zip(self.sets.tolist(), self.optional.tolist(), strict=True)
        ):
            depends = optional if sets else depends
            found[k] = depends and not sets
        return found

    def _loose_before(self) -> Flags:
        """Visits before which a loose word may have been executed (K,)."""
        if self.uncertain:
            return np.ones(len(self.line), dtype=np.bool_)
        at = np.searchsorted(self.loose, self.line)
        return np.diff(at, prepend=0) != 0

    def _error(self, line: int, own: float, want: float) -> ValueError:
        return ValueError(
            f"line {line} is to have {self.letter}{want:g} in place of {self.letter}{own:g} and "
            "cannot be given that word: change only what editable_blocks says may be changed"
        )
