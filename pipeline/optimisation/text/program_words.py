"""Where the F and S words of a program stand, and which lines could take one more.

Lines with assignments, flow control, calls, or codes under which F or S is no feed or speed (a
pitch, a dwell, a limit, an argument) are closed: nothing is written into them.
"""

import re
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import INCH
from pipeline.gcode.program import Program, TokenKind
from pipeline.gcode.scanner import BLANKS

Lines = NDArray[np.intp]
Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]

CLOSED_G = (
    4,
    10,
    11,
    25,
    26,
    31,
    33,
    33.1,
    34,
    35,
    38.2,
    38.3,
    38.4,
    38.5,
    50,
    63,
    65,
    66,
    66.1,
    67,
    74,
    76,
    84,
    92,
    92.1,
    92.2,
    92.3,
    93,
    96,
    961,
    962,
    331,
    332,
)
"""Under which F or S of the same line means something else, or might."""
CLOSED_M = (19, 29, 70, 71, 72, 73, 96, 97, 98, 99, 198)
WINDING_M = (96, 97, 98, 99, 198)
WINDING_G = (65, 66, 66.1)
UNITS = {20: INCH, 21: 1.0, 70: INCH, 71: 1.0, 700: INCH, 710: 1.0}
NONE, OTHER = -1, -2
"""No word of a letter in a line; one that is no single number."""
_READS = re.compile(rb"(?i)_feed|_rpm|#\s*41[01]9|\$P_F|\$P_S|\$AC_")


@dataclass(frozen=True, eq=False)
class ProgramWords:
    """Words of a program by line; arrays have L + 1 places, that of line n is n.

    Parameters
    ----------
    program : Program
        Of L lines.
    """

    program: Program = field(repr=False)

    @cached_property
    def line_of(self) -> Lines:
        """Line of each token (K,)."""
        counts = np.diff(self.program.tokens.first)
        return np.repeat(np.arange(1, len(self.program) + 1), counts)

    @cached_property
    def _letters(self) -> NDArray[np.uint8]:
        """Capital letter of each WORD, VALUED and LONE (K,); 0 of other tokens."""
        tokens = self.program.tokens
        data = np.frombuffer(self.program.data, dtype=np.uint8)
        capital = data[tokens.start[:-1]] & 0xDF if len(data) else np.zeros(0, dtype=np.uint8)
        lettered = np.isin(tokens.kind, (TokenKind.WORD, TokenKind.VALUED, TokenKind.LONE))
        return np.where(lettered, capital, 0).astype(np.uint8)

    def _has(self, token: Flags) -> Flags:
        found = np.zeros(len(self.program) + 1, dtype=np.bool_)
        found[self.line_of[token]] = True
        return found

    def codes(self, letter: str, codes: tuple[float, ...]) -> Flags:
        """Lines with one of some G or M codes (L + 1,)."""
        tokens = self.program.tokens
        named = (self._letters == ord(letter)) & (tokens.kind == TokenKind.WORD)
        near = np.round(np.nan_to_num(tokens.value) * 10)
        return self._has(named & np.isin(near, np.round(np.array(codes) * 10)))

    def token(self, letter: str) -> Lines:
        """Token of each line's word of a letter (L + 1,), ``NONE`` or ``OTHER``."""
        found = np.flatnonzero(self._letters == ord(letter))
        at = np.full(len(self.program) + 1, NONE, dtype=np.intp)
        lines = self.line_of[found]
        at[lines] = np.where(self.program.tokens.kind[found] == TokenKind.WORD, found, OTHER)
        several = np.bincount(lines, minlength=len(at)) > 1
        at[several[: len(at)]] = OTHER
        return at

    @cached_property
    def closed(self) -> Flags:
        """Lines that nothing is written into (L + 1,)."""
        kind = self.program.tokens.kind
        plain = (
            TokenKind.BLANK, TokenKind.WORD, TokenKind.VALUED, TokenKind.COMMENT, TokenKind.REMARK, TokenKind.SKIP, TokenKind.LINE_END,
        )  # fmt: skip
        odd = ~np.isin(kind, plain) | (self._letters == ord("O")) | self._odd_values
        return self._has(odd) | self.codes("G", CLOSED_G) | self.codes("M", CLOSED_M)

    @cached_property
    def _odd_values(self) -> Flags:
        """Expressions that are no variable and no bracket, or those of G and M (K,)."""
        tokens = self.program.tokens
        found = tokens.kind == TokenKind.VALUED
        for at in np.flatnonzero(found).tolist():
            text = self.program.data[tokens.start[at] : tokens.start[at + 1]]
            value = text[1:].strip(BLANKS + b"+-")
            found[at] = value[:1] not in (b"#", b"[") or text[:1] in b"GMgm"
        return found

    @cached_property
    def optional(self) -> Flags:
        """Lines that begin with ``/`` and may be left out at the machine (L + 1,)."""
        return self._has(self.program.tokens.kind == TokenKind.SKIP)

    @cached_property
    def winding(self) -> bool:
        """Whether lines may be left out or come again: jumps, loops, calls, block skip."""
        tokens = self.program.tokens
        data = np.frombuffer(self.program.data, dtype=np.uint8)
        macros = tokens.start[:-1][tokens.kind == TokenKind.MACRO]
        return bool(
            (data[macros] != ord("#")).any()
            or (tokens.kind == TokenKind.SKIP).any()
            or self.codes("M", WINDING_M).any()
            or self.codes("G", WINDING_G).any()
        )

    @cached_property
    def reads_itself(self) -> bool:
        """Whether its expressions may read the F or S in force, or it saves and restores them."""
        return bool(_READS.search(self.program.data)) or bool(self.codes("M", (72, 73)).any())

    @cached_property
    def unit(self) -> Floats | None:
        """Millimetres in the unit of each line (L + 1,), NaN before the first G20 or G21.

        None where both are in a program whose lines do not run in their order.
        """
        units = np.full(len(self.program) + 1, np.nan)
        for code, unit in UNITS.items():
            units[self.codes("G", (code,))] = unit
        given = np.flatnonzero(~np.isnan(units))
        if not len(given):
            return units
        if self.winding:
            first = units[given[0]]
            return np.full(len(units), first) if (units[given] == first).all() else None
        last = np.maximum.accumulate(np.where(np.isnan(units), 0, np.arange(len(units))))
        return units[last]

    @cached_property
    def _spaced(self) -> bool:
        """Whether most words that follow another have a blank before them."""
        kind, letters = self.program.tokens.kind, self._letters
        if len(kind) < 3:
            return True
        word = letters > 0
        together = np.count_nonzero(word[1:] & word[:-1])
        apart = np.count_nonzero(word[2:] & (kind[1:-1] == TokenKind.BLANK) & word[:-2])
        return bool(apart >= together)

    def place(self, line: int) -> tuple[int, bytes, bool]:
        """Where a word is added to a line: the byte, what goes before it, whether in small letters.

        At the end of the line's words; with a blank before it where they are separated by blanks.
        """
        tokens, letters = self.program.tokens, self._letters
        first, last = tokens.first[line - 1 : line + 1].tolist()
        words = first + np.flatnonzero(letters[first:last])
        at = int(tokens.start[words[-1] + 1])
        spaced = self._spaced
        if len(words) > 1 and not (len(words) == 2 and letters[words[0]] == ord("N")):
            spaced = bool(tokens.kind[words[-1] - 1] == TokenKind.BLANK)
        small = self.program.data[tokens.start[words[-1]]] >= ord("a")
        return at, b" " * spaced, bool(small)
