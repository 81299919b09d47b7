"""Records of a table as a machine's file describes them, proposed from one of its files.

Columns are matched by unit and name; the choice stands in comments for people.
"""

import re
from itertools import product
from json import dumps
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.signals.formats import RecordSource, TableLayout, UnreadableFile
from pipeline.signals.ingest import reader_of
from pipeline.signals.units import conversion

_UNIT = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")
_TIME = re.compile(r"^(t|time|zeit|timestamp|date|datum|clock)([^a-z]|stamp|$)", re.IGNORECASE)
_SHORT = {"SECOND": "s", "sec": "s", "MILLISECOND": "ms", "MINUTE": "min"} | {
    unit: unit for unit in ("s", "ms", "us", "ns", "min", "h")
}
_SINCE_1970 = {"unix_ns": 1e9, "unix_us": 1e6, "unix_ms": 1e3, "unix_s": 1.0}
_DATE_S = 631_152_000
"""A greater count is a date from 1990 on [s since 1970]."""
_KINDS = (
    ("temperature", "degC", "temp|thermo|pt100|ambient"),
    ("force", "N", "force|kraft|^f[xyz]"),
    ("command", "", "command|cmd|_?ref|soll|desired|target|setpoint|^set"),
    ("displacement", "", "disp|probe|growth|drift|gap"),
    ("position", "mm", "pos|ist|^[xyz]$|axis"),
    ("current", "A", "current|curr|strom"),
    ("spindle speed", "rev/min", "rpm|speed|drehzahl"),
    ("acceleration", "m/s^2", "acc|vib"),
)
"""Candidates of a column: unit of the quantity, and words of its name; the first that fits."""


def table_lines(path: Path, form: str, files: str) -> list[str]:
    """Lines of YAML for records like ``path``: columns, times, units and what they may be."""
    layout, table = _read(path, form)
    columns = {name.removeprefix("raw_"): table.column(name) for name in table.column_names[1:]}
    units = {f.name.removeprefix("raw_"): f.metadata[b"unit"].decode() for f in table.schema}
    named = {name: bracket[1] for name in columns if (bracket := _UNIT.search(name))}
    time = next((name for name in columns if _TIME.match(name)), None)
    lines = [f"  - format: {form}", f"    files: {dumps(files, ensure_ascii=False)}", "    table:"]
    lines += ["      units_row: true"] if layout.units_row else []
    lines += ["      decimal: ','"] if layout.decimal == "," else []
    if time is None and form == "tdms":
        lines.append("      # rate: 1000.0   # [Hz], where the file does not state it")
    elif time is None and form == "wav":
        lines.append("      # the file states its rate; give each channel's unit and full scale")
    elif time is None:
        lines.append("      rate: 1000.0   # [Hz]; no column is called a time: correct it")
    else:
        lines += _time(time, columns[time], units[time] or named.get(time, ""))
    lines += ["      rest: true   # every column, under the file's own name",
              "      columns: {}   # instead of it, what is so of:"]  # fmt: skip
    more: dict[str, str | float] = {"full_scale": 1.0} if form == "wav" else {}
    return lines + [
        _choice(n, columns[n], units[n], named.get(n, ""), more) for n in columns if n != time
    ]


def _read(path: Path, form: str) -> tuple[TableLayout, pa.Table]:
    """The layout by which the most columns are numbers, and what it reads."""
    found: list[tuple[int, TableLayout, pa.Table]] = []
    for units_row, decimal in product((False, True), ".,") if form == "csv" else [(False, ".")]:
        layout = TableLayout(rest=True, rate=1.0, units_row=units_row, decimal=decimal)
        source = RecordSource(format=form, files=path.name, table=layout)  # type: ignore[arg-type]
        try:
            table = reader_of(form)(path, source, path.parent).table
        except UnreadableFile as error:
            why = str(error)
            continue
        found.append((sum(map(pa.types.is_floating, table.schema.types)), layout, table))
    if not found:
        raise ValueError(f"{path}: {why}")
    return max(found, key=lambda one: one[0])[1:]


def _time(name: str, cells: pa.ChunkedArray, unit: str) -> list[str]:
    """Lines of the time column: its unit by the file, else by its values."""
    lines = [f"      time: {dumps(name, ensure_ascii=False)}"]
    if not pa.types.is_floating(cells.type):
        return [*lines, "      time_unit: iso", "      time_zone: UTC   # of times without a zone"]
    first, *others = cells.drop_null().to_numpy()[:1000].tolist() or [0.0]
    step = float(np.median(np.diff([first, *others]))) if others else np.nan
    since_1970 = (u for u, n in _SINCE_1970.items() if first / n > _DATE_S)
    said = _SHORT.get(unit, unit)
    known = said in _SHORT.values()
    said = said if known else next(since_1970, "s")
    why = "by the file" if known else "by its values: check it"
    return [*lines, f"      time_unit: {said}   # {why}; steps of {step:.6g}"]


def _choice(
    name: str, cells: pa.ChunkedArray, stated: str, named: str, more: dict[str, str | float]
) -> str:
    """Comment that makes a signal of a column, with its candidates and range."""
    unit = stated or named
    kind = _kind(name, unit)
    signal = re.sub(r"\W+", "_", _UNIT.sub("", name)).strip("_").lower() or "channel"
    signal = f"channel_{signal}" if signal[0].isdigit() else signal
    within = pc.min_max(cells) if pa.types.is_floating(cells.type) else None
    span = f"{within['min']} … {within['max']} {unit or '(unit not stated)'}" if within else "words"
    said = {"column": name} | ({} if stated else {"unit": named}) | more
    where = dumps(said, ensure_ascii=False)
    return f"      #   {signal}: {where}   # {f'could be a {kind}; ' if kind else ''}{span}"


def _kind(name: str, unit: str) -> str:
    """Candidate quantity of a column; ``""`` where neither its unit nor its name shows it."""
    for kind, usual, words in _KINDS:
        if re.search(words, name, re.IGNORECASE) and _fits(unit, usual):
            return kind
    fitting = [kind for kind, usual, _ in _KINDS if unit and usual and _fits(unit, usual)]
    return fitting[0] if fitting else ""


def _fits(unit: str, usual: str) -> bool:
    """Whether a unit is one of the quantity; a unit that is not stated is any."""
    try:
        return not unit or not usual or bool(conversion(unit, usual))
    except ValueError:
        return False
