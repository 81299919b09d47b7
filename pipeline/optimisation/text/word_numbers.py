"""Numbers of F and S words: rounded, and written as the program writes its own."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.gcode.scanner import BLANKS

Floats = NDArray[np.float64]

ROUNDING = 1e-3
"""What rounding an F may cost of it [1]."""
MOST_DECIMALS = 9
SLACK = 1.5e-9
"""Of a number that arithmetic left a little below the one it means [1]."""
_NUMBER = re.compile(rb"[+-]?[0-9.%b]*[0-9.]" % re.escape(BLANKS))


def decimals(values: ArrayLike, least: int = 0) -> NDArray[np.intp]:
    """Decimals with which rounding down costs less than :data:`ROUNDING` of a value.

    Parameters
    ----------
    values : array_like
        Of words, positive.
    least : int
        Decimals that a word has at least.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = np.ceil(-np.log10(ROUNDING * np.asarray(values, dtype=np.float64)) - SLACK)
    needed = np.where(np.isfinite(needed), needed, MOST_DECIMALS)
    return np.clip(needed, least, max(MOST_DECIMALS, least)).astype(np.intp)


def rounded_down(values: ArrayLike, least: int = 0) -> Floats:
    """Values as words hold them: the next one below with as many decimals as are needed.

    Parameters
    ----------
    values : array_like
        Positive.
    least : int
        As :func:`decimals` takes it.

    Returns
    -------
    ndarray
        The float64 nearest to each written number.
    """
    given = np.asarray(values, dtype=np.float64)
    power = 10.0 ** decimals(given, least)
    steps: Floats = np.floor(given * power * (1 + SLACK))
    return steps / power


@dataclass(frozen=True, kw_only=True)
class NumberStyle:
    """How a program writes the numbers of one letter.

    Parameters
    ----------
    point : bool
        Whether they have a decimal point even where nothing follows it.
    least : int
        Decimals that they have at least.
    """

    point: bool = False
    least: int = 0

    @classmethod
    def of(cls, numbers: list[bytes]) -> "NumberStyle":
        """That of most of some numbers as written."""
        pointed = [number for number in numbers if b"." in number]
        if not numbers or 2 * len(pointed) < len(numbers):
            return cls()
        least = min(len(number.partition(b".")[2]) for number in pointed)
        return cls(point=True, least=min(least, MOST_DECIMALS))

    def text(self, value: float) -> bytes:
        """A number that was rounded by :func:`rounded_down`."""
        written = f"{value:.{MOST_DECIMALS}f}".rstrip("0")
        whole, _, fraction = written.partition(".")
        fraction = fraction.ljust(self.least, "0")
        return f"{whole}{'.' if fraction or self.point else ''}{fraction}".encode("ascii")


@dataclass(frozen=True, kw_only=True, eq=False)
class OwnNumbers:
    """Values that a program gives by numbers of its own.

    Parameters
    ----------
    style : NumberStyle
        How it writes them.
    texts : mapping of float to bytes
        In the units of ``Moves`` -> as written.
    values : ndarray, shape (V,)
        The keys of ``texts``, ascending.
    """

    style: NumberStyle
    texts: Mapping[float, bytes] = field(repr=False)
    values: Floats = field(repr=False)

    @classmethod
    def of(cls, words: list[bytes], values: list[float]) -> "OwnNumbers":
        """Of words as written, ``F120.``, and their values."""
        numbers = [digits(word) for word in words]
        texts = dict(zip(values, numbers, strict=True))
        known = np.array(sorted(texts), dtype=np.float64)
        return cls(style=NumberStyle.of(numbers), texts=texts, values=known)


def digits(word: bytes) -> bytes:
    """The number of a word as written, without blanks."""
    found = _NUMBER.search(word, 1)
    return b"" if found is None else found[0].translate(None, BLANKS)


def in_place_of(word: bytes, number: bytes) -> bytes:
    """A word with another number, its letter and the blanks before its number kept."""
    found = _NUMBER.search(word, 1)
    if found is None:
        return word[:1] + number
    lead = found.start() + len(found[0]) - len(found[0].lstrip(BLANKS))
    return word[:lead] + number + word[found.end() :]
