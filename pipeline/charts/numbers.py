"""Numbers, times and units in readers' notation: sensible digits, always a unit, UTC."""

import math
import re
from collections.abc import Callable, Sequence
from datetime import UTC, date, datetime
from typing import Any

from pipeline.schema.verdict import MOST_PERCENT, OF_NOTHING

NOT_KNOWN = "not known"
NARROW = "\u202f"  # narrow no-break space: between thousands, and before a unit
TOGETHER = "\u00a0"  # no-break space
VOID = "— (of nearly 0)"
"""A share of next to nothing, in a table."""
WEEKDAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")

UNITS = {
    "CELSIUS": "°C", "PERCENT": "%", "REVOLUTION/MINUTE": "rev/min", "MILLIMETER": "mm",
    "MILLIMETER/SECOND": "mm/s", "DEGREE": "°", "DEGREE/SECOND": "°/s", "SECOND": "s", "um": "µm",
    "WATT": "W", "deg": "°",
}  # fmt: skip
"""Unit names of MTConnect as written for readers."""


def _superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def _of_power(mantissa: str, exponent: int) -> str:
    """``1.5e+02`` as 150, what is very large or small with its power of ten."""
    if -4 <= exponent < 6:
        return f"{float(f'{mantissa}e{exponent}'):.12g}"
    return f"{mantissa} × 10{_superscript(exponent)}"


AS_READ: tuple[tuple[re.Pattern[str], str | Callable[[re.Match[str]], str]], ...] = (
    (re.compile(r"(?<=\d) um\b"), f"{NARROW}µm"),
    (re.compile(r"(?<=\d) deg\b"), "°"),
    (re.compile(r"\bdegC\b"), "°C"),
    (re.compile(r"(?<=[A-Za-z)])\^2\b"), "²"),
    (re.compile(r"(?<=[A-Za-z)])\^3\b"), "³"),
    (re.compile(r"(\d+(?:\.\d+)?)e([+-]\d+)\b"), lambda found: _of_power(found[1], int(found[2]))),
    (re.compile(r"(?<![^\s(])-(?=\d)"), "−"),
    (re.compile(r"± (?=\d)"), f"±{NARROW}"),
)
"""Plain notation of terminals and files -> typeset notation of a page."""


def as_read(text: str) -> str:
    """``text`` of a judge or a file with its units and signs as they are set on a page.

    >>> as_read("RMSE 42 um is above 30 um, from -3 to 5 N/mm^2, 1.5e+02 or 2e-08 mm")
    'RMSE 42\u202fµm is above 30\u202fµm, from −3 to 5 N/mm², 150 or 2 × 10⁻⁸ mm'
    """
    for plain, printed in AS_READ:
        text = plain.sub(printed, text)
    return text


def blank_words(stock: str) -> str:
    """The blank of an option or a setting as a drawing has it; a file's name as it is.

    >>> blank_words("box:0,80,0,60,-15,0"), blank_words("cylinder:0,0,50,-20,0.5")
    ('a block of 80 × 60 × 15\u202fmm', 'a bar of Ø 50 × 20.5\u202fmm')
    """
    form, _, ends = stock.partition(":")
    if form not in ("box", "cylinder"):
        return stock
    values = [float(end) for end in ends.split(",")]
    if form == "cylinder":
        return f"a bar of Ø {values[2]:g} × {values[4] - values[3]:g}{NARROW}mm"
    sizes = [f"{high - low:g}" for low, high in zip(values[::2], values[1::2], strict=True)]
    return f"a block of {' × '.join(sizes)}{NARROW}mm"


def real(value: Any) -> float | None:
    """``value`` as a finite float, None for anything else (a boolean is not a number)."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def number(value: Any, digits: int = 3) -> str:
    """``value`` with ``digits`` significant digits; integers below 1e15 whole.

    >>> number(0.0123456), number(8.4e-6), number(-2.5)
    ('0.0123', '8.40 × 10⁻⁶', '−2.50')
    """
    x = real(value)
    if x is None:
        return NOT_KNOWN
    if x == 0:
        return "0"
    if isinstance(value, int):
        text = f"{value:,}"
    elif not 1e-4 <= abs(x) < 1e6:
        mantissa, exponent = f"{x:.{digits - 1}e}".split("e")
        text = f"{mantissa} × 10{_superscript(int(exponent))}"
    else:
        order = int(f"{x:.{digits - 1}e}".split("e")[1])  # of what is shown: 0.997 is 1.0
        decimals = max(0, digits - 1 - order)
        text = f"{x:,.{decimals}f}"
    return text.replace(",", NARROW).replace("-", "−")


def as_stated(value: Any, digits: int = 6) -> str:
    """``value`` as a person states it: no digits that say nothing.

    >>> as_stated(60.0), as_stated(0.05), as_stated(1e4)
    ('60', '0.05', '10\u202f000')
    """
    x = real(value)
    return NOT_KNOWN if x is None else number(int(x)) if x == int(x) else f"{x:.{digits}g}"


def fixed(value: Any, decimals: int) -> str:
    """``value`` with a fixed number of decimals, for columns that are compared."""
    x = real(value)
    return NOT_KNOWN if x is None else f"{x:,.{decimals}f}".replace(",", NARROW).replace("-", "−")


def signed(value: Any, decimals: int = 1) -> str:
    """``value`` with its sign and a fixed number of decimals, for differences and errors.

    >>> signed(2.04), signed(-31.42), signed(-0.04)
    ('+2.0', '−31.4', '0.0')
    """
    x = real(value)
    if x is None:
        return NOT_KNOWN
    x = round(x, decimals) + 0.0  # no minus before a zero
    return f"+{fixed(x, decimals)}" if x > 0 else fixed(x, decimals)


def unit_words(unit: str | None) -> str:
    """A unit as people write it; unknown ones as they are."""
    return UNITS.get(unit or "", unit or "")


def powers(unit: str) -> str:
    """A unit as it is printed: mm/s² where a file says mm/s^2, and on one line."""
    unit = re.sub(r"\bum\b", "µm", unit)
    return unit.replace("^2", "²").replace("^3", "³").replace(" ", TOGETHER)


def resolved(low: float | None, high: float | None, least: int = 3) -> int:
    """Significant digits that show an interval's width with two of its own, ``least`` to 5.

    >>> resolved(273.0, 347.0), resolved(1.1178, 1.1222), resolved(2.0, 2.0)
    (3, 5, 3)
    """
    if low is None or high is None or not high > low:
        return least
    magnitude = math.floor(math.log10(max(abs(low), abs(high))))
    return min(5, max(least, magnitude - math.floor(math.log10(high - low)) + 2))


def between(low: float | None, high: float | None) -> str:
    """An interval with the digits that show its width; "not known" when an end is."""
    digits = resolved(low, high)
    known = None not in (low, high)
    return f"{number(low, digits)} to {number(high, digits)}" if known else NOT_KNOWN


def range_words(text: str) -> str:
    """A text with ranges whose ends read alike as one value.

    >>> range_words("spindle speed 4800 rev/min (5000 to 5000), feed 3 to 4")
    'spindle speed 4800 rev/min (5000), feed 3 to 4'
    """
    return re.sub(r"(?<![\w.])(-?[\d.e+-]+) to \1(?![\w.])", r"\1", text)


def quantity(value: Any, unit: str, digits: int = 3) -> str:
    """Number and unit; only "not known" when there is no number."""
    text = number(value, digits)
    unit = unit_words(unit)
    return text if text == NOT_KNOWN or not unit else f"{text}{NARROW}{unit}"


def percent(part: float | None, whole: float | None) -> str:
    """Share of ``part`` in ``whole`` in percent; "not known" of an empty whole."""
    if part is None or not whole:
        return NOT_KNOWN
    share = 100 * part / whole
    if 0 < share < 0.01:
        return f"< 0.01{NARROW}%"
    if part == 0 or part == whole or share >= 10:
        return f"{share:.0f}{NARROW}%" if share < 99.5 or part == whole else f"> 99{NARROW}%"
    return f"{number(share, 2)}{NARROW}%"


def tenths(value: Any) -> str:
    """``value`` with one decimal."""
    return fixed(value, 1)


def relative(value: Any, shown: Callable[[float], str] = tenths, unit: str = "") -> str:
    """A share [%] of what was measured, or is true, as ``shown`` writes it; a dash without one.

    Beyond :data:`MOST_PERCENT` it is a share of next to nothing, which is said in its place.

    >>> relative(-12.34, signed), relative(6.69e8), relative(6.69e8, unit="%")[:14]
    ('−12.3', '— (of nearly 0)', 'more than 1000')
    """
    x = real(value)
    if x is None:
        return "–"
    if abs(x) > MOST_PERCENT:
        return OF_NOTHING if unit else VOID
    return f"{shown(x)}{TOGETHER}{unit}" if unit else shown(x)


def hours(seconds: Any) -> str:
    """Seconds as hours with one decimal, without the unit (it stands in the table's head)."""
    x = real(seconds)
    return NOT_KNOWN if x is None else fixed(x / 3600, 1)


def duration(seconds: Any) -> str:
    """Seconds as people say them: ``42 s``, ``12 min 05 s``, ``3 h 20 min``, ``2.5 days``."""
    x = real(seconds)
    if x is None:
        return NOT_KNOWN
    if round(x, 1) < 60:
        return f"{number(round(x, 1), 3)}{NARROW}s"
    whole = round(x)
    if whole < 3600:
        return f"{whole // 60}{NARROW}min {whole % 60:02d}{NARROW}s"
    if whole < 48 * 3600:
        return f"{whole // 3600}{NARROW}h {whole % 3600 // 60:02d}{NARROW}min"
    return f"{whole / 86400:.1f}{NARROW}days"


def instant(value: Any) -> datetime | None:
    """ISO text, nanoseconds since 1970 or a datetime, in UTC; None for anything else."""
    if isinstance(value, bool) or value is None:
        return None
    try:
        if isinstance(value, int):
            return datetime.fromtimestamp(value / 1e9, UTC)
        when = value if isinstance(value, datetime) else datetime.fromisoformat(str(value).strip())
    except (ValueError, OverflowError, OSError):
        return None
    return when.replace(tzinfo=UTC) if when.tzinfo is None else when.astimezone(UTC)


def moment(value: Any) -> str:
    """Date and time to the minute, UTC."""
    when = instant(value)
    if when is None:
        return NOT_KNOWN
    return f"{day_words(when.date().isoformat(), year=True)}, {when:%H:%M}{TOGETHER}UTC"


def day_words(day: str, *, year: bool = False) -> str:
    """``2016-10-12`` as ``Wed 12 Oct``, with ``year`` also that; other text as it is."""
    try:
        d = date.fromisoformat(day)
    except ValueError:
        return day
    words = (WEEKDAYS[d.weekday()], str(d.day), MONTHS[d.month - 1], *[str(d.year)] * year)
    return TOGETHER.join(words)


def day_list(days: list[str], most: int = 4) -> str:
    """Days in words, at most ``most`` of them by name."""
    names = [day_words(d) for d in days[:most]]
    if len(days) > most:
        names.append(f"{len(days) - most} more")
    return joined(names)


def counted(count: int, one: str, many: str | None = None) -> str:
    """A count with its noun: ``1 file``, ``2 files``."""
    return f"{number(count)} {one if count == 1 else many or one + 's'}"


def joined(words: Sequence[str]) -> str:
    """Words as a list that is read aloud: ``X, Y and Z``."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
