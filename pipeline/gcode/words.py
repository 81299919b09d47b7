"""Tokens of a program: what each byte is, from which lines and words are made when asked for."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from pipeline.gcode import scanner
from pipeline.gcode.characters import BLANKS
from pipeline.gcode.errors import GcodeError


class Kind(IntEnum):
    """What a run of bytes is."""

    BLANK = scanner.BLANK  # blanks, NUL, DEL, the byte order mark at the start
    WORD = scanner.WORD  # a letter and a number
    VALUED = scanner.VALUED  # a letter and an expression: ``X[#1+2]``, ``F#5``, ``Xsin[30]``
    LONE = scanner.LONE  # a letter without a value
    MACRO = scanner.MACRO  # assignments, control, O-words, Siemens names: up to a comment
    COMMENT = scanner.COMMENT  # ``(…)``
    REMARK = scanner.REMARK  # ``;`` and the rest of the line
    SKIP = scanner.SKIP  # ``/`` or ``/2`` at the head of a line
    PERCENT = scanner.PERCENT  # ``%`` at the head of a line, and the rest of it
    LINE_END = scanner.LINE_END
    OTHER = scanner.OTHER  # anything else: no meaning in ISO 6983


@dataclass(frozen=True, kw_only=True)
class Tokens:
    """K tokens on L lines, in the order of the bytes; together they are all of them.

    Parameters
    ----------
    kind : (K,) array of uint8
        :class:`Kind`.
    start : (K + 1,) array of int32
        Byte that each begins at; it ends where the next begins.
    value : (K,) array of float64
        Number of a WORD, level of a SKIP, else NaN.
    first : (L + 1,) array of int32
        First token of each line.
    """

    kind: npt.NDArray[np.uint8]
    start: npt.NDArray[np.int32]
    value: npt.NDArray[np.float64]
    first: npt.NDArray[np.int32]


def tokens(data: bytes, name: str) -> Tokens:
    """Tokens of any bytes.

    Parameters
    ----------
    data : bytes
        A program, whatever its encoding and line ends.
    name : str
        Of the program, for errors.

    Raises
    ------
    GcodeError
        If it has 2 GiB or more.
    """
    if len(data) >= 2**31 - 1:
        raise GcodeError(
            file=name, line=0, column=0, word=f"{len(data)} bytes", reason="cut it: 2 GiB at most"
        )
    room = len(data) + 1
    kind = np.empty(room, dtype=np.uint8)
    start, first = np.empty(room, dtype=np.int32), np.empty(room, dtype=np.int32)
    value = np.empty(room, dtype=np.float64)
    count, lines = scanner.scan(np.frombuffer(data, dtype=np.uint8), kind, start, value, first)
    for array, length in ((kind, count), (start, count + 1), (value, count), (first, lines + 1)):
        array.resize(length, refcheck=False)  # in place: gives back what was not written
    made = Tokens(kind=kind, start=start, value=value, first=first)
    _read_long_numbers(data, made)
    return made


def number_text(word: bytes) -> str:
    """The digits of a word with a number, without its letter and blanks."""
    return word.translate(None, BLANKS).lstrip(LETTERS).decode("ascii")


LETTERS = b",@^$abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"


def _read_long_numbers(data: bytes, made: Tokens) -> None:
    """Numbers with more digits than the scanner rounds correctly."""
    for index in np.flatnonzero((made.kind == Kind.WORD) & np.isnan(made.value)).tolist():
        word = data[made.start[index] : made.start[index + 1]]
        made.value[index] = float(number_text(word))
