"""Numbers, counts and tables in printed lines; pages use :mod:`pipeline.charts.numbers`."""

from collections.abc import Iterator, Sequence

NONE = "-"
"""Text in the place of a missing value."""


def rounded(value: float | None, factor: float = 1, digits: int = 3) -> str:
    """``value`` times ``factor`` with ``digits`` significant digits; integers whole.

    >>> rounded(0.12345), rounded(1234.5), rounded(0.5, 100), rounded(12), rounded(None)
    ('0.123', '1234', '50', '12', '-')
    """
    if value is None:
        return NONE
    if isinstance(value, int):
        return str(int(value * factor))
    shown = value * factor
    return f"{shown:.0f}" if abs(shown) >= 10**digits else f"{shown:.{digits}g}"


def between(low: float | None, high: float | None, factor: float = 1) -> str:
    """The ends of an interval, to stand behind a value; nothing where there are none.

    >>> between(0.5, 2.0), between(None, None)
    (' (0.5 to 2)', '')
    """
    if low is None or high is None:
        return ""
    return f" ({rounded(low, factor)} to {rounded(high, factor)})"


def many(count: int, what: str) -> str:
    """A count with its noun: ``1 move``, ``2 moves``."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def aligned(rows: Sequence[Sequence[str]], *, words: int) -> Iterator[str]:
    """Lines whose columns stand under each other; the first ``words`` columns are left aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [
            word.ljust(width) if i < words else word.rjust(width)
            for i, (word, width) in enumerate(zip(row, widths, strict=True))
        ]
        yield "  ".join(cells).rstrip()
