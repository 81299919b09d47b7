"""Signals of a machine's data items, with the reason of each choice.

Types and components are those of the Devices document (ANSI/MTC1.4 part 2); spindles and the C axis
that it leaves open are decided by what moves with what in the log.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from json import dumps
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from pipeline.app.records import ItemSeries
from pipeline.schema.arrays import Floats, Ints
from pipeline.signals.formats import RecordSource, TableLayout, UnreadableFile
from pipeline.signals.ingest import reader_of
from pipeline.signals.mtconnect.devices import DataItem
from pipeline.signals.units import conversion

GRID = 20_000
"""Points of time at which series are compared, as many reports of the log apart."""
TURNS_RPM = 5.0
"""Least speed of a turning spindle [rev/min]."""
STANDING_SHARE = 0.95
"""Share of the C axis' motions during which its spindle stands [1]."""
APART = 0.1
"""Difference of two correlations that decides between two candidates [1]."""

EVENTS: dict[str, tuple[str, ...]] = {
    "availability": ("AVAILABILITY",),
    "execution": ("EXECUTION",),
    "controller_mode": ("CONTROLLER_MODE",),
    "emergency_stop": ("EMERGENCY_STOP",),
    "power_state": ("POWER_STATE", "POWER_STATUS"),
    "program": ("PROGRAM",),
    "tool_number": ("TOOL_NUMBER", "TOOL_ID", "TOOL_ASSET_ID"),
    "part_count": ("PART_COUNT",),
    "line": ("LINE", "LINE_NUMBER"),
    "spindle_rotary_mode": ("ROTARY_MODE",),
    "path_feedrate": ("PATH_FEEDRATE",),
    "spindle_override": ("ROTARY_VELOCITY_OVERRIDE", "SPINDLE_SPEED_OVERRIDE"),
}
"""Signals of the machine as a whole, by MTConnect type, the first type that there is."""
_AXIS = {
    "Linear": {"POSITION": "position", "AXIS_FEEDRATE": "feedrate", "LOAD": "load"},
    "Rotary": {"ANGLE": "angle", "ANGULAR_VELOCITY": "angular_velocity", "LOAD": "load"},
}
_TIMES = {
    "total_time": ("TOTAL", "POWERED"),
    "auto_time": ("AUTO", "WORKING"),
    "cut_time": ("CUT", "LOADED"),
}
"""Words of the subtypes of a counter of hours: the makers' own, and those of EQUIPMENT_TIMER."""
_NOT_ACTUAL = ("COMMANDED", "PROGRAMMED", "TARGET", "JOG", "RAPID", "x:SUB", "x:SUB_PROGRAM")
IN_BRACKETS = re.compile(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$")
"""Unit at the end of a column's name, as in ``acc [m/s^2]``."""
TIME = re.compile(r"^(t|time|zeit|timestamp|date|datum|clock)([^a-z]|stamp|$)", re.IGNORECASE)
"""Names of a column of time."""
SHORT = {"SECOND": "s", "sec": "s", "MILLISECOND": "ms", "MINUTE": "min"} | {
    unit: unit for unit in ("s", "ms", "us", "ns", "min", "h")
}
"""Units of time as they are written, by the short one."""
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


@dataclass(frozen=True, kw_only=True)
class Choice:
    """Signal, its data item (None while open), and the reason."""

    signal: str
    item: str | None
    why: str
    candidates: tuple[str, ...] = ()


@dataclass
class SignalMapping:
    """Decisions, open choices, and the items that show a spindle held in position."""

    choices: dict[str, Choice] = field(default_factory=dict)
    position_control: dict[str, str] = field(default_factory=dict)
    spindles: list[dict[str, str]] = field(default_factory=list)

    @property
    def signals(self) -> dict[str, str]:
        """Signal -> data item, of those that were decided."""
        return {name: c.item for name, c in self.choices.items() if c.item is not None}


def find_signals(
    items: Sequence[tuple[str, DataItem]], series: Mapping[str, ItemSeries]
) -> SignalMapping:
    """Signals of ``items`` (name in observations, declaration); ``series`` empty without a log."""
    mapping, log = SignalMapping(), Log(series)
    usable = [(n, i) for n, i in items if i.category != "CONDITION" and i.type]
    for signal, kinds in EVENTS.items():
        _one_of(mapping, log, signal, _first_type(usable, kinds))
    for name, wanted in (("rapid_override", True), ("feed_override", False)):
        fits = [(n, i) for n, i in usable if i.type == "PATH_FEEDRATE_OVERRIDE"
                and (i.sub_type == "RAPID") == wanted]  # fmt: skip
        _one_of(mapping, log, name, fits)
    for signal, words in _TIMES.items():
        fits = [(n, i) for n, i in usable if i.type in ("ACCUMULATED_TIME", "EQUIPMENT_TIMER")
                and any(word in (i.sub_type or "").upper() for word in words)]  # fmt: skip
        _one_of(mapping, log, signal, fits)
    _temperatures(mapping, log, usable)
    taken = _spindles(mapping, log, usable)
    _axes(mapping, log, [(n, i) for n, i in usable if n not in taken])
    _c_axis(mapping, log)
    return mapping


def _first_type(
    usable: Sequence[tuple[str, DataItem]], kinds: Sequence[str]
) -> list[tuple[str, DataItem]]:
    for kind in kinds:
        fits = [(n, i) for n, i in usable if i.type == kind and i.sub_type not in _NOT_ACTUAL]
        if fits:
            return fits
    return []


def _one_of(
    mapping: SignalMapping, log: "Log", signal: str, fits: Sequence[tuple[str, DataItem]]
) -> None:
    """Decide ``signal`` among items that fit: the only one, or the only one that the log has."""
    if not fits:
        return
    names = [n for n, _ in fits]
    there = [n for n in names if n in log.series and log.series[n].known.any()]
    if log.series and not there:
        why = "described, and without a value in the logs"
        mapping.choices[signal] = Choice(signal=signal, item=None, why=why, candidates=tuple(names))
        return
    there = there or names
    chosen = next(i for n, i in fits if n == there[0])
    if len(there) == 1:
        why = _described(chosen)
        if len(names) > 1:
            why += ", the only one of its kind with values in the log"
        mapping.choices[signal] = Choice(signal=signal, item=there[0], why=why)
    else:
        why = f"{len(there)} items of type {chosen.type}: choose one"
        mapping.choices[signal] = Choice(signal=signal, item=None, why=why, candidates=tuple(there))


def _described(item: DataItem) -> str:
    kind = (item.type or "") + (f" {item.sub_type}" if item.sub_type else "")
    where = " ".join(filter(None, (item.component, item.component_name)))
    return ", ".join(filter(None, (kind, f"of {where}" if where else "", item.units)))


def _temperatures(
    mapping: SignalMapping, log: "Log", usable: Sequence[tuple[str, DataItem]]
) -> None:
    for signal, words in (
        ("ambient_temperature", ("ambient", "environment", "room")),
        ("coolant_temperature", ("coolant",)),
    ):
        fits = [
            (n, i)
            for n, i in usable
            if i.type == "TEMPERATURE"
            and any(
                w in f"{n} {i.component} {i.component_name} {i.sub_type}".lower() for w in words
            )
        ]
        _one_of(mapping, log, signal, fits)


def _spindles(
    mapping: SignalMapping, log: "Log", usable: Sequence[tuple[str, DataItem]]
) -> set[str]:
    """Speeds, each with the load and temperature that belong to it; the busiest is modelled."""
    speeds = [(n, i) for n, i in usable if i.type in ("ROTARY_VELOCITY", "SPINDLE_SPEED")
              and i.sub_type not in (*_NOT_ACTUAL, "OVERRIDE")]  # fmt: skip
    if len(log.series):
        speeds = [(n, i) for n, i in speeds if log.values(n)] or speeds
    taken = {n for n, _ in speeds}
    why: list[dict[str, str]] = []
    for name, item in speeds:
        spindle, reasons = {"speed": name}, {"speed": _described(item)}
        beside = [n for n, i in speeds if _place(i) == _place(item)]
        for kind in ("LOAD", "TEMPERATURE"):
            fits = [(n, i) for n, i in usable if i.type == kind and _place(i) == _place(item)]
            chosen, reason = _belonging(log, name, beside, fits)
            if chosen:
                spindle[kind.lower()], reasons[kind.lower()] = chosen, reason
                taken.add(chosen)
        mapping.spindles.append(spindle)
        why.append(reasons)
    order = sorted(range(len(speeds)), key=lambda k: _rank(log, mapping.spindles[k]), reverse=True)
    clear = len(order) < 2 or _rank(log, mapping.spindles[order[0]]) > _rank(
        log, mapping.spindles[order[1]])  # fmt: skip
    for place, k in zip(("spindle", "second_spindle"), order, strict=False):
        for quantity, item_name in mapping.spindles[k].items():
            signal, note = f"{place}_{quantity}", why[k][quantity]
            if len(order) > 1 and quantity == "speed":
                note += _which(place, log, clear=clear)
            mapping.choices[signal] = Choice(signal=signal, item=item_name, why=note)
    mapping.spindles = [mapping.spindles[k] for k in order]
    return taken


def _which(place: str, log: "Log", *, clear: bool) -> str:
    if place != "spindle":
        return "; swap it with spindle_… to model this one"
    if not clear:
        return "; two spindles are alike: choose the one to model"
    return "; modelled, as its temperature moves most of those with a load"


def _place(item: DataItem) -> tuple[str | None, str | None]:
    return item.component, item.component_name


def _rank(log: "Log", spindle: Mapping[str, str]) -> tuple[int, float, float]:
    """Rank of a spindle for modelling: quantities with values, its heat, time that it turns."""
    there = sum(log.values(item) if log.series else True for item in spindle.values())
    moves = log.spread(spindle["temperature"]) if "temperature" in spindle else 0.0
    return there, moves, log.share_turning(spindle["speed"])


def _belonging(
    log: "Log", speed: str, beside: Sequence[str], fits: Sequence[tuple[str, DataItem]]
) -> tuple[str | None, str]:
    if len(fits) == 1 and len(beside) == 1:
        return fits[0][0], _described(fits[0][1])
    stem = _stem(speed)
    alike = [(n, i) for n, i in fits if _stem(n) == stem]
    if len(alike) == 1:
        name, item = alike[0]
        moved = log.together(speed, name)
        seen = "" if np.isnan(moved) else f", correlated with {speed} by {moved:.2f} in the log"
        return name, f"{_described(item)}, named like {speed}{seen}"
    scored = sorted(((log.together(speed, n), n, i) for n, i in fits
                     if not np.isnan(log.together(speed, n))), key=lambda s: -s[0])  # fmt: skip
    if scored and (len(scored) == 1 or scored[0][0] - scored[1][0] > APART):
        best, name, item = scored[0]
        return name, f"{_described(item)}, moves with {speed} in the log (correlation {best:.2f})"
    return None, ""


def _stem(name: str) -> str:
    """A name without the word for its quantity: ``S2rpm`` and ``S2load`` give ``s2``."""
    words = r"rpm|speed|load|temp(erature)?|velocity|vel|act(ual)?|ovr|frt|deg|n$"
    return re.sub(rf"({words})", "", name.lower()).strip("_- .")


def _axes(mapping: SignalMapping, log: "Log", usable: Sequence[tuple[str, DataItem]]) -> None:
    for letters, component in (("XYZ", "Linear"), ("ABC", "Rotary")):
        for letter in letters:
            for kind, quantity in _AXIS[component].items():
                fits = [(n, i) for n, i in usable if i.type == kind and i.component == component
                        and _letter(i) == letter and i.sub_type not in _NOT_ACTUAL]  # fmt: skip
                _one_of(mapping, log, f"{letter.lower()}_{quantity}", fits)


def _letter(item: DataItem) -> str:
    """The axis of an item, from its component's name: ``X``, ``X1``, ``Xaxis``, ``axis_X``."""
    name = item.component_name or ""
    match = re.fullmatch(r"(?:axis[ _-]?)?([XYZABC])\d*(?:[ _-]?axis)?", name, re.IGNORECASE)
    return match.group(1).upper() if match else ""


def _c_axis(mapping: SignalMapping, log: "Log") -> None:
    """Whether the modelled spindle is the C axis: it stands while the angle moves."""
    signals = mapping.signals
    angle, speed = signals.get("c_angle"), signals.get("spindle_speed")
    if angle is None or speed is None:
        return
    mode, rate = signals.get("spindle_rotary_mode"), signals.get("c_angular_velocity")
    stands = [log.standing_while(one["speed"], angle) for one in mapping.spindles]
    alone = (
        stands and stands[0] >= STANDING_SHARE and not any(s >= STANDING_SHARE for s in stands[1:])
    )
    if mode is None and not alone:
        return
    mapping.position_control = {"angle": angle, "speed": speed}
    mapping.position_control |= {"rate": rate} if rate else {}
    mapping.position_control |= {"mode": mode} if mode else {}


class Log:
    """Series of a log, compared at equal points of time."""

    def __init__(self, series: Mapping[str, ItemSeries]) -> None:
        self.series = series
        known = [one.time[one.known] for one in series.values()]
        said: Ints = np.unique(np.concatenate([np.zeros(1, np.int64), *known]))[1:]
        place = np.linspace(0, len(said) - 1, GRID).astype(np.int64)
        self.grid: Ints = said[place] if len(said) else np.zeros(GRID, np.int64)

    def values(self, name: str) -> bool:
        """Whether an item has numbers."""
        one = self.series.get(name)
        return one is not None and bool((~np.isnan(one.number)).any())

    def held(self, name: str) -> Floats:
        """The item at the points of the grid, held; NaN where it is not known, shape (GRID,)."""
        if name not in self.series or not len(self.series[name].time):
            return np.full(GRID, np.nan)
        one = self.series[name]
        at = np.searchsorted(one.time, self.grid, side="right") - 1
        return np.where(at >= 0, one.number[np.maximum(at, 0)], np.nan)

    def share_turning(self, name: str) -> float:
        """Share of the reported time in which the spindle turns [1]."""
        return float((np.abs(self.held(name)) > TURNS_RPM).mean())

    def spread(self, name: str) -> float:
        """Distance of an item's quartiles, which glitches do not move; 0 without numbers."""
        held = self.held(name)
        held = held[~np.isnan(held)]
        return float(np.subtract(*np.percentile(held, [75, 25]))) if len(held) else 0.0

    def together(self, speed: str, other: str) -> float:
        """Correlation of |speed| with another item [1]; NaN where one of them does not move."""
        a, b = np.abs(self.held(speed)), self.held(other)
        both = ~(np.isnan(a) | np.isnan(b))
        if both.sum() < 3 or a[both].std() == 0 or b[both].std() == 0:
            return float("nan")
        return float(np.corrcoef(a[both], b[both])[0, 1])

    def standing_while(self, speed: str, angle: str) -> float:
        """Share of the motions of an angle during which a spindle stands [1]; 0 without any."""
        one, other = self.series.get(angle), self.series.get(speed)
        if one is None or other is None or not len(other.time):
            return 0.0
        known = ~np.isnan(one.number)
        time, value = one.time[known], one.number[known]
        moved = time[1:][np.diff(value) != 0]
        at = np.searchsorted(other.time, moved, side="right") - 1
        rpm = np.abs(other.number[at[at >= 0]])
        rpm = rpm[~np.isnan(rpm)]
        return float((rpm <= TURNS_RPM).mean()) if len(rpm) else 0.0


def table_lines(path: Path, form: str, files: str) -> list[str]:
    """Lines of YAML for records like ``path``: columns, times, units and what they may be."""
    layout, table = read_columns(path, form)
    columns = {name.removeprefix("raw_"): table.column(name) for name in table.column_names[1:]}
    units = {f.name.removeprefix("raw_"): f.metadata[b"unit"].decode() for f in table.schema}
    named = {name: bracket[1] for name in columns if (bracket := IN_BRACKETS.search(name))}
    time = next((name for name in columns if TIME.match(name)), None)
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


def read_columns(path: Path, form: str, rate: float | None = 1.0) -> tuple[TableLayout, pa.Table]:
    """The layout by which the most columns are numbers, and what it reads.

    ``rate`` [Hz] numbers the rows; None leaves them the file's own, ValueError where it states none
    or cannot be read.
    """
    found: list[tuple[int, TableLayout, pa.Table]] = []
    for units_row, decimal in product((False, True), ".,") if form == "csv" else [(False, ".")]:
        layout = TableLayout(rest=True, rate=rate, units_row=units_row, decimal=decimal)
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
    said = SHORT.get(unit, unit)
    known = said in SHORT.values()
    said = said if known else next(since_1970, "s")
    why = "by the file" if known else "by its values: check it"
    return [*lines, f"      time_unit: {said}   # {why}; steps of {step:.6g}"]


def _choice(
    name: str, cells: pa.ChunkedArray, stated: str, named: str, more: dict[str, str | float]
) -> str:
    """Comment that makes a signal of a column, with its candidates and range."""
    unit = stated or named
    kind = _kind(name, unit)
    signal = re.sub(r"\W+", "_", IN_BRACKETS.sub("", name)).strip("_").lower() or "channel"
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
