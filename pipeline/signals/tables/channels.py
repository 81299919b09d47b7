"""Channels of a trace: which column becomes which signal, and in which unit it was found."""

import difflib
import re
from collections.abc import Iterable
from dataclasses import dataclass

import pyarrow as pa
import pyarrow.compute as pc

from pipeline.signals.columns import COLUMNS, Column
from pipeline.signals.records import TableLayout, UnreadableFile
from pipeline.signals.units import conversion, mtconnect_unit

_NO_UNIT = ("", "-", "[-]", "[]", "n/a", "none", "()")
_KIND = re.compile(r"_(ref|meas|hat)$")


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One channel: ``raw`` is its column in the file; ``factor``, ``offset`` lead to ``unit``."""

    name: str
    raw: str
    unit: str
    factor: float = 1.0
    offset: float = 0.0
    text: bool = False

    @property
    def field(self) -> pa.Field:
        """Arrow field, the unit as metadata."""
        kind = pa.string() if self.text else pa.float64()
        return pa.field(self.name, kind, metadata={"unit": self.unit})

    def converted(self, values: pa.Array) -> pa.Array:
        """Values [unit of the file] in the channel's unit, shape (T,)."""
        if self.factor != 1.0:
            values = pc.multiply(values, self.factor)
        return pc.add(values, self.offset) if self.offset else values


def known_signal(name: str) -> Column | None:
    """The signal of the table of signals that ``name`` is, or ends with; None for a free name.

    ``_ref``, ``_meas`` and ``_hat`` at the end tell commanded, measured and estimated apart.
    """
    stem = _KIND.sub("", name)
    parts = stem.split("_")
    for first in range(len(parts)):
        column = COLUMNS.get("_".join(parts[first:]))
        if column is not None and (first == 0 or column.unit):
            return column
    return None


def named_channels(layout: TableLayout, units: dict[str, str]) -> list[Channel]:
    """Channels that the layout names.

    Parameters
    ----------
    layout : TableLayout
        Signals and where they are found.
    units : dict of str to str
        Raw name -> unit that the file states.

    Raises
    ------
    ValueError
        When the layout gives a unit that does not fit, or a free name without one.
    UnreadableFile
        When the file's own unit contradicts the layout, or is not known.
    """
    channels = []
    for name, source in layout.columns.items():
        known = known_signal(name)
        if known.text if known else name in layout.text:
            channels.append(Channel(name=name, raw=source.column, unit="", text=True))
            continue
        found = _stated(units.get(source.column))
        if source.unit is not None and found is not None:
            _check_agreement(source.column, source.unit, found)
        unit = source.unit if source.unit is not None else found
        if known is None and unit is None:
            raise _free_without_unit(name)
        target = known.unit if known else None
        try:
            channels.append(_channel(name, source.column, unit, target))
        except ValueError as error:
            message = f"signal {name!r} from column {source.column!r}: {error}"
            raise (ValueError if source.unit is not None else UnreadableFile)(message) from error
    return channels


def rest_channels(
    layout: TableLayout, available: Iterable[str], units: dict[str, str], taken: set[str | None]
) -> list[Channel]:
    """Channels for the columns that the layout does not name, under the file's own names.

    A name that is taken, or that would claim to be a signal of the table of signals, gets ``raw_``
    before it.  A unit that is not known stays as the file has it.
    """
    if not layout.rest:
        return []
    named = {source.column for source in layout.columns.values()} | {layout.time, layout.date}
    channels = []
    used = set(taken) | set(COLUMNS)
    for raw in available:
        if raw in named:
            continue
        name = raw
        while name in used:
            name = f"raw_{name}"
        used.add(name)
        unit = _stated(units.get(raw))
        try:
            channels.append(_channel(name, raw, unit, None))
        except ValueError:
            channels.append(Channel(name=name, raw=raw, unit=unit or ""))
    return channels


def _channel(name: str, raw: str, unit: str | None, target: str | None) -> Channel:
    if target is None:
        target = mtconnect_unit(unit or "")
    factor, offset = conversion(target if unit is None else unit, target)
    return Channel(name=name, raw=raw, unit=target, factor=factor, offset=offset)


def _stated(unit: str | None) -> str | None:
    """A unit that a file states, None when it says nothing."""
    return None if unit is None or unit.strip().lower() in _NO_UNIT else unit.strip()


def _check_agreement(column: str, ours: str, theirs: str) -> None:
    """Refuse a layout's unit that is not the one the file itself states."""
    try:
        same = conversion(theirs, ours) == (1.0, 0.0)
    except ValueError:
        try:
            mtconnect_unit(theirs)
        except ValueError:
            return  # the file's word is not a unit we know; the layout decides
        same = False
    if not same:
        raise UnreadableFile(
            f"column {column!r} is in {theirs!r} by the file and in {ours!r} by the layout: "
            "correct the layout"
        )


def check_time_unit(layout: TableLayout, units: dict[str, str]) -> None:
    """Refuse a ``time_unit`` that is not the unit the file itself states for its time column."""
    found = _stated(units.get(layout.time or ""))
    unit = layout.time_unit.removeprefix("unix_")
    if found is not None and unit != "iso":
        _check_agreement(str(layout.time), unit, found)


def _free_without_unit(name: str) -> ValueError:
    near = ", ".join(difflib.get_close_matches(name, COLUMNS)) or "none"
    return ValueError(
        f"signal {name!r} is not in the table of signals (near: {near}): correct its name, or give "
        "its unit ('' for none) to keep it as a channel of its own"
    )
