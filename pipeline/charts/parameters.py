"""Parameters of a model on its page: values with intervals, undetermined ones, simulated truth."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from string import ascii_lowercase

from pipeline.charts.numbers import (
    NARROW,
    between,
    counted,
    fixed,
    number,
    percent,
    powers,
    relative,
    resolved,
    signed,
    unit_words,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import MOST_ROWS, Cell, Column, Table, code, tabulated
from pipeline.schema.model import Correlation, Parameter

Units = Mapping[str, tuple[str, float]]
"""Unit in a file -> unit as a shop speaks it, and the factor between the two."""
Meaning = Callable[[str, str], str]
"""Group and name of a parameter -> its meaning in words; "–" where its name says all."""
MOST_OPEN = 20
"""Rows of the table of the truth above which it is folded [1]."""
MOST_NAMED = 4
"""Undetermined parameters that are named at the head of a page [1]."""
ILL = 1e4
"""Condition of the scaled Jacobian above which parameters are hard to separate [1]."""
CLOSE = 0.95
"""Correlation above which little more than the sum of two parameters is determined [1]."""


def in_units(p: Parameter, units: Units) -> Parameter:
    """A parameter with value, interval and unit as a shop speaks them.

    >>> p = Parameter(value=0.004, unit="m/s", interval_95=(0.003, 0.005), determined=True,
    ...               method="a fit")
    >>> shown = in_units(p, {"m/s": ("mm/s", 1e3)})
    >>> shown.value, shown.interval_95, shown.unit
    (4.0, (3.0, 5.0), 'mm/s')
    """
    unit, factor = units.get(p.unit, (p.unit, 1.0))
    ends = p.interval_95
    return replace(
        p, unit=unit, value=None if p.value is None else p.value * factor,
        interval_95=None if ends is None else (ends[0] * factor, ends[1] * factor),
    )  # fmt: skip


def unit_of(p: Parameter) -> str:
    """Unit of a parameter as it is printed; a dash for none."""
    return powers(unit_words(p.unit)) if p.unit not in ("", "1") else "–"


def parameters_table(
    caption: str, parameters: Mapping[str, Parameter], made: Sequence[Source],
    meaning: Callable[[str], str] = lambda name: "–",
) -> Table | None:  # fmt: skip
    """Parameters with value, interval and unit, and their method or what to record."""
    methods = Counter(p.method for p in parameters.values() if p.determined)
    often = [m for m, count in methods.items() if m and (count > 1 or len(methods) == 1)]
    marks = {
        method: "–" if len(methods) == 1 else f"({letter})"
        for method, letter in zip(often, ascii_lowercase, strict=False)
    }
    return tabulated(caption, list(parameters.items()), (
        Column("Parameter", lambda row: code(row[0])),
        Column("means", lambda row: meaning(row[0])),
        Column("value", lambda row: _value(row[1]) if _known(row[1]) else
               Cell(text="not determined", status="unknown"), ""),
        Column("95 % interval", lambda row: between(*_ends(row[1])) if _known(row[1]) and
               row[1].interval_95 else "–", ""),
        Column("unit", lambda row: unit_of(row[1])),
        Column("method, or what to record", lambda row: _basis(row[1], marks)),
    ), made, note=_methods_words(marks))  # fmt: skip


def _known(p: Parameter) -> bool:
    return p.determined and p.value is not None


def _ends(p: Parameter) -> tuple[float | None, float | None]:
    return p.interval_95 or (None, None)


def _value(p: Parameter) -> str:
    """The value with the digits that its interval leaves."""
    return number(p.value, resolved(*_ends(p))) if p.determined else "not determined"


def _basis(p: Parameter, marks: Mapping[str, str]) -> str:
    if _known(p):
        return marks.get(p.method, p.method) or "–"
    return "; ".join(w for w in (p.method, p.remedy) if w) or "–"


def _methods_words(marks: Mapping[str, str]) -> str:
    """The methods, under the marks that stand in the rows."""
    if list(marks.values()) == ["–"]:
        return f"Those with a number were found by {next(iter(marks)).rstrip('.')}."
    said = "; ".join(f"{mark} {method.rstrip('.')}" for method, mark in marks.items())
    return f"Methods: {said}." if said else ""


def undetermined_words(
    groups: Mapping[str, Mapping[str, Parameter]], meaning: Meaning, title: str
) -> str:
    """Parameters that the records do not determine, the first of them in words; empty for none."""
    lost = [
        f"{f'({group}) ' if group else ''}{name if means == '–' else means}"
        for group, parameters in groups.items()
        for name, p in parameters.items() if not p.determined
        for means in [meaning(group, name)]
    ]  # fmt: skip
    if not lost:
        return ""
    more = [f"{len(lost) - MOST_NAMED} more"] if len(lost) > MOST_NAMED else []
    return (
        f"Of the {title} the records do not determine {'; '.join(lost[:MOST_NAMED] + more)}: the "
        "tables say what to record for a number."
    )


def strongest_correlation(correlation: Correlation) -> tuple[str, str, float] | None:
    """Most correlated pair of parameters, and its correlation."""
    pairs = [
        (abs(r), correlation.names[i], correlation.names[j], r)
        for i, row in enumerate(correlation.values)
        for j, r in enumerate(row[:i])
        if r is not None
    ]
    return max(pairs)[1:] if pairs else None


def fit_words(residual: str, condition: float | None, correlation: Correlation) -> str:
    """Quality of a fit, and its two most correlated parameters; "" for nothing."""
    said = [residual] if residual else []
    if condition is not None:
        ill = ", so some are hard to separate" if condition > ILL else ""
        said.append(f"the condition is {number(condition, 2)}{ill}")
    if (pair := strongest_correlation(correlation)) is not None:
        close = ", so that little more than their sum is known" if abs(pair[2]) > CLOSE else ""
        said.append(f"the most correlated are {pair[0]} and {pair[1]} (correlation "
                    f"{fixed(pair[2], 2)}{close})")  # fmt: skip
    text = "; ".join(said)
    return f"{text[0].upper()}{text[1:]}." if text else ""


# ---- the truth of a simulated machine


@dataclass(frozen=True, kw_only=True)
class KnownValue:
    """A parameter of a simulated machine: as it was identified, and its true value."""

    name: str
    """Group and name in one."""
    true: float
    """True value, in the unit of the parameter."""
    parameter: Parameter
    """Identified parameter."""
    period: float = 0.0
    """Period up to which it is determined, in the same unit; 0 for none."""

    @property
    def holds(self) -> bool | None:
        """Whether the 95 % interval holds the truth, or that and whole periods; None without."""
        p = self.parameter
        if not p.determined or p.interval_95 is None:
            return None
        low, high = p.interval_95
        whole = self.period * ceil((low - self.true) / self.period) if self.period else 0.0
        return low <= self.true + whole <= high

    @property
    def off_percent(self) -> float | None:
        """Difference of the value from the true one [%]; None for angles and a truth of 0."""
        p = self.parameter
        if not p.determined or p.value is None or not self.true or self.period:
            return None
        return 100 * (p.value / self.true - 1)


def truth_table(
    title: str, known: Sequence[KnownValue], made: Sequence[Source], note: str = ""
) -> Table | None:
    """True value, identified value, and whether its 95 % interval holds the truth."""
    judged = [one.holds for one in known if one.holds is not None]
    caption = (
        f"{title[:1].upper()}{title[1:]}: simulated against identified; {sum(judged)} of "
        f"{number(len(judged))} intervals hold the truth"
    )
    return tabulated(caption, known, TRUTH, made, most=MOST_ROWS, folded=len(known) > MOST_OPEN,
                     note=note)  # fmt: skip


def _held(one: KnownValue) -> Cell | str:
    modulo = f", modulo {one.period:g}{unit_words(one.parameter.unit)}" if one.period else ""
    said = {True: ("holds the truth", "passed"), False: ("misses the truth", "failed")}
    if one.holds is None:
        return "–"
    return Cell(text=said[one.holds][0] + modulo, status=said[one.holds][1])


TRUTH: tuple[Column[KnownValue], ...] = (
    Column("Parameter", lambda one: code(one.name)),
    Column("true", lambda one: number(float(one.true), resolved(*_ends(one.parameter))), ""),
    Column("identified", lambda one: _value(one.parameter), ""),
    Column("off by", lambda one: relative(one.off_percent, lambda share: signed(share, 2)), "%"),
    Column("95 % interval",
           lambda one: "–" if one.holds is None else between(*_ends(one.parameter)), ""),
    Column("unit", lambda one: unit_of(one.parameter)),
    Column("interval", _held),
)  # fmt: skip


def truth_words(known: Iterable[KnownValue], title: str) -> str:
    """Number of intervals that hold the truth, and those that miss it; empty where none does."""
    judged = [one for one in known if one.holds is not None]
    missed = [one.name for one in judged if not one.holds]
    if not missed:
        return ""
    held, total = len(judged) - len(missed), len(judged)
    return (
        f"Of {counted(total, 'interval')} of 95{NARROW}% of the {title} {held} hold the simulated "
        f"truth ({percent(held, total)}); {', '.join(missed)} miss{'es' * (len(missed) == 1)} it."
    )
