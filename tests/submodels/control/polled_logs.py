"""Logs as an adapter writes them that polls a control: line, feed, spindle, tool, overrides.

The control is the planner of :mod:`pipeline.machine`, so that what is found can be compared with
the truth; everything between (polls, their jitter, lines passed over, silence about overrides
before they are turned) is made here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.gcode.moves import AXES, METRE, Kind, Moves
from pipeline.machine.control.interpolate import trace
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.planner import Plan
from pipeline.signals.columns import OBSERVATIONS
from pipeline.submodels.control.runs import Run, joined, read_runs, stopped_within
from pipeline.twin.control import Overrides, planned_program

ITEMS = {
    "execution": "exec", "line": "ln", "path_feedrate": "vpath", "spindle_speed": "S1n",
    "feed_override": "fovr", "rapid_override": "rovr", "tool_number": "tool",
}  # fmt: skip
PERIOD = 0.01
"""Of the display of a control [s]."""

EPOCH = 1_772_431_200 * 10**9
"""Of the recordings' time 0, UTC [ns]."""

Said = dict[str, list[tuple[float, float | str]]]
"""When [s] and what each data item said."""


@dataclass(frozen=True, kw_only=True)
class Operated:
    """What the operator does.

    Parameters
    ----------
    feed, rapid : mapping of int to float
        Override from a line on [%]; 100 before.
    said_from : int
        Line from which the log says the feed override; never when 0.
    holds : sequence of (float, float)
        Program time at which the feed is held, and for how long [s].
    abort : float
        Program time at which the operator stops the run for good [s].
    """

    feed: Mapping[int, float] = field(default_factory=dict)
    rapid: Mapping[int, float] = field(default_factory=dict)
    said_from: int = 0
    holds: Sequence[tuple[float, float]] = ()
    abort: float = np.inf

    def overrides(self, moves: Moves) -> Overrides:
        return Overrides(
            feed=in_force(self.feed, moves.line), rapid=in_force(self.rapid, moves.line)
        )


ALONE = Operated()


def in_force(changes: Mapping[int, float], line: np.ndarray) -> np.ndarray:
    """Override of each line [1]."""
    found = np.ones(len(line))
    for since, percent in sorted(changes.items()):
        found[line >= since] = percent / 100
    return found


@dataclass(frozen=True, kw_only=True)
class Polling:
    """How the adapter polls [s]."""

    period: float = 0.15
    jitter: float = 0.015
    lead: float = 1.0


def polled_log(
    moves: Moves, control: ControlParameters, rng: np.random.Generator,
    operated: Operated = ALONE, polling: Polling = Polling(), begin: float = 0.0,
) -> Said:  # fmt: skip
    """The log of one run that starts at ``begin`` [s]."""
    plan = planned_program(moves, control, operated.overrides(moves))
    holds = wall_spans(operated.holds)
    ending = min(plan.total, operated.abort) + sum(length for _, length in operated.holds)
    steps = polling.period + rng.normal(0, polling.jitter, int(ending / polling.period) + 60)
    time = np.cumsum(np.maximum(steps, 0.02)) - polling.lead
    time = time[: int(np.searchsorted(time, ending)) + 1]  # the last one sees the end
    program = np.clip(time - stopped_within(holds, np.zeros_like(time), time), 0, None)
    shown = _shown(plan, program, time, holds, ending, operated)
    return {
        item: [(begin + time[k], value) for k, value in _changes(values)]
        for item, values in shown.items()
    }


def wall_spans(holds: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Holds by the clock on the wall, from program times [s]."""
    spans, before = [], 0.0
    for at, length in sorted(holds):
        spans.append((at + before, at + before + length))
        before += length
    return joined(spans)


def _shown(
    plan: Plan, program: np.ndarray, time: np.ndarray, holds: Sequence[tuple[float, float]],
    ending: float, operated: Operated,
) -> dict[str, list[float | str | None]]:  # fmt: skip
    """What the control shows at each poll; None where it says nothing."""
    moves = plan.path.moves
    row = np.minimum(np.searchsorted(np.cumsum(plan.time), program, side="right"), len(moves) - 1)
    begun, held = time >= 0, np.zeros(len(time), dtype=bool)
    for first, last in holds:
        held |= (time >= first) & (time < last)
    aborted = ending < plan.total
    state = np.where(held, "FEED_HOLD", "ACTIVE").astype(object)
    state[time >= ending] = "STOPPED" if aborted else "PROGRAM_COMPLETED"
    tool = np.where(moves.kind == Kind.TOOL_CHANGE, 0, moves.tool)[row]
    speed = np.where(held | ~begun, 0.0, path_speed(plan, program))
    spindle = np.where(begun, (moves.speed * (moves.direction != 0))[row], 0.0)
    said = begun & (moves.line[row] >= operated.said_from) & bool(operated.said_from)
    percent = 100 * in_force(operated.feed, moves.line)[row]
    rapid = 100 * in_force(operated.rapid, moves.line)[row]
    return {
        "exec": np.where(begun, state, "READY").tolist(),
        "ln": np.where(begun, moves.line[row], 0).astype(float).tolist(),
        "vpath": np.round(speed, 2).tolist(),
        "S1n": spindle.tolist(),
        "fovr": np.where(said, percent, None).tolist(),
        "rovr": rapid.tolist(),
        "tool": np.where(begun, np.maximum(tool, 0), 99).astype(float).tolist(),
    }


def path_speed(plan: Plan, program: np.ndarray) -> np.ndarray:
    """Speed along the path at program times [mm/s]."""
    samples = trace(plan, period=PERIOD)
    way = np.diff(samples.programmed[:, : AXES.index("A")], axis=0) / METRE
    speed = np.append(np.sqrt((way**2).sum(axis=1)) / PERIOD, 0.0)
    return speed[np.minimum((program / PERIOD).astype(int), len(speed) - 1)]


def _changes(values: list[float | str | None]) -> list[tuple[int, float | str]]:
    """Place and value wherever it is another than before."""
    before: float | str | None = None
    found = []
    for place, value in enumerate(values):
        if value is not None and value != before:
            found.append((place, value))
            before = value
    return found


def write_log(said: Mapping[str, Sequence[tuple[float, float | str]]], path: Path) -> Path:
    """Observations on disk, as ``ingest`` writes them."""
    rows = sorted((t, item, v) for item, values in said.items() for t, v in values)
    numbers = [None if isinstance(v, str) else float(v) for _, _, v in rows]
    columns = {
        "time": [EPOCH + round(t * 1e9) for t, _, _ in rows],
        "data_item": [item for _, item, _ in rows],
        "number": numbers,
        "text": [v if isinstance(v, str) else None for _, _, v in rows],
        "sequence": list(range(1, len(rows) + 1)),
        "kind": ["EVENT"] * len(rows),
    }
    empty = [None] * len(rows)
    arrays = []
    for entry in OBSERVATIONS:
        kind = entry.type.value_type if pa.types.is_dictionary(entry.type) else entry.type
        arrays.append(pa.array(columns.get(entry.name, empty), kind).cast(entry.type))
    pq.write_table(pa.Table.from_arrays(arrays, schema=OBSERVATIONS), path)
    return path


def logged_runs(path: Path, *logs: Said, name: str = "log.txt") -> list[Run]:
    """Runs that are read back from logs written to one recording at ``path``."""
    together: Said = {}
    for log in logs:
        for item, values in log.items():
            together.setdefault(item, []).extend(values)
    return read_runs(write_log(together, path), ITEMS, name)
