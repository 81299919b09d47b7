"""Totals of a simulated program: by block, tool, type and limit, as stored and shown."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import AXES, METRE, METRE_PER_SECOND, RADIAN, Kind, Moves
from pipeline.gcode.setup import Setup
from pipeline.machine.control.commands import auxiliary_time
from pipeline.machine.control.interpolate import Trace, traces
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.path import Binding, Motion
from pipeline.machine.control.planner import Plan
from pipeline.machine.spindle import CUTTING
from pipeline.schema.arrays import Floats
from pipeline.schema.files import replacing
from pipeline.schema.model import Bands, Condition
from pipeline.schema.program_cut import SimulatedProgram
from pipeline.schema.store import structured, unstructured, write_json
from pipeline.twin.control import planned_program, program_moves, time_interval
from pipeline.twin.preflight import limits_of, preflight, violation_lines
from pipeline.twin.program_advice import program_advice

if TYPE_CHECKING:
    import pandas as pd

_TYPE: dict[int, str] = {
    Kind.RAPID: "rapid",
    Kind.FEED: "feed",
    Kind.THREAD: "feed",
    Kind.PROBE: "feed",
    Kind.ARC: "arc",
    Kind.TOOL_CHANGE: "tool change",
    Kind.DWELL: "dwell",
}
WAITS: dict[int, str] = {
    Kind.TOOL_CHANGE: "tool change",
    Kind.DWELL: "dwell",
    Kind.STOP: "program stop",
    Kind.M_CODE: "M code",
}
"""Names of the standstills in the times by cause, beside those of :class:`.path.Binding`."""
TYPES = ("rapid", "feed", "arc", "tool change", "spindle and M codes", "dwell")


def type_of(kind: NDArray[np.uint8]) -> NDArray[np.str_]:
    """Type of each row in words, one of :data:`TYPES`."""
    words = np.full(256, "spindle and M codes", dtype="<U20")
    for key, word in _TYPE.items():
        words[key] = word
    return words[kind]


def limit_words(plan: Plan) -> NDArray[np.str_]:
    """Limit of each row's speed in words."""
    words = np.array([b.name.lower().replace("_", " ") for b in Binding])
    return words[plan.limit]


def block_table(plan: Plan) -> "pd.DataFrame":
    """One row a move: where it ends [mm], programmed and reached feed [mm/min], time [s].

    ``programmed_feed`` is NaN where no feed holds; the centre, angle and plane are those of arcs.
    """
    import pandas as pd

    moves = plan.path.moves
    cutting = np.isin(moves.kind, CUTTING)
    return pd.DataFrame(
        {
            "line": moves.line,
            "kind": [Kind(k).name.lower() for k in moves.kind],
            "x": moves.end[:, 0],
            "y": moves.end[:, 1],
            "z": moves.end[:, 2],
            "cx": moves.centre[:, 0],
            "cy": moves.centre[:, 1],
            "cz": moves.centre[:, 2],
            "angle": moves.angle,
            "plane": moves.plane.astype(np.int32),
            "programmed_feed": np.where(cutting, programmed_feed(plan), np.nan),
            "reached_feed": plan.v_peak / METRE_PER_SECOND,
            "time": plan.time,
            "length": moves.length,
            "tool": moves.tool,
            "speed": moves.speed,
            "limit": limit_words(plan),
        }
    )


def programmed_feed(plan: Plan) -> Floats:
    """Programmed speed along the path [mm/min]; shape (M,)."""
    path = plan.path
    per_turn = np.where(path.motion == Motion.PER_TURN, plan.spindle_speed, 1.0)
    return path.factor * plan.feed * per_turn / METRE_PER_SECOND


def summary(plan: Plan, name: str) -> dict[str, Any]:
    """Times of a program [s]: in all, by tool, by type, by cause; and advice on them."""
    moves, time = plan.path.moves, plan.time
    kinds, cutting = type_of(moves.kind), np.isin(moves.kind, CUTTING)
    return {
        "program": name,
        "total_time_s": round(plan.total, 3),
        "path_length_mm": round(float(moves.length.sum()), 6),
        "cutting_time_s": round(float(time[cutting].sum()), 3),
        "origin_mm": np.round(moves.origin[:3], 6).tolist(),
        "by_tool": _by_tool(moves, time, cutting),
        "by_type": {t: _seconds(time[kinds == t]) for t in TYPES if (kinds == t).any()},
        "by_cause": {name: round(s, 3) for name, s in time_by_cause(plan).items() if s > 0},
        "advice": [unstructured(one) for one in program_advice(plan)],
    }


def time_by_cause(plan: Plan) -> dict[str, float]:
    """Time of a program by cause [s]: no second is without one, and their sum is the total.

    A cut takes its length over the programmed feed, ``feed``; what a speed limit of the row costs
    above that has the name of the limit; speeding up and slowing down has that of the corner or
    stop at the slower end, by the squares of the speeds that are missing there (a trapezoid's
    ramp takes (v - v_end)^2 / (2 a v) longer), and is ``acceleration`` where neither end stands
    at its limit.  A standstill has the name of what is waited for.
    """
    path, time = plan.path, plan.motion.time
    moves, pause = path.moves, path.pause
    cutting = np.isin(path.motion, (Motion.CUTTING, Motion.PER_TURN))
    speed = np.where(cutting, programmed_feed(plan) * METRE_PER_SECOND, np.inf)
    top = np.minimum(speed, np.where(cutting, path.cap, np.inf))
    at_feed, at_top = (np.minimum(np.where(cutting, path.length / v, 0.0), time)
                       for v in (speed, top))  # fmt: skip
    held = plan.v_out >= (1 - 1e-9) * path.corner
    neither = Binding.ACCELERATION if path.segments is None else Binding.CORNER
    ends = np.where(held, path.end_reason, neither)
    before = np.searchsorted(np.flatnonzero(path.moving), np.arange(len(path))) - 1
    rows = np.concatenate([np.flatnonzero(path.moving), [-1]])[before]
    v_in = np.where(rows < 0, 0.0, plan.v_out[rows])
    begins = np.where(rows < 0, Binding.EXACT_STOP, ends[rows])
    lacking = [np.where(cutting, np.maximum(top - v, 0.0) ** 2, 0.0) for v in (v_in, plan.v_out)]
    whole = lacking[0] + lacking[1]
    share = np.divide(lacking[0], whole, out=np.full(len(path), 0.5), where=whole > 0)
    ramps = np.where(cutting, time - at_top, 0.0)

    def of(codes: NDArray[np.integer], seconds: Floats) -> Floats:
        return np.bincount(codes, seconds, len(Binding)).astype(np.float64)

    every = of(np.where(cutting, Binding.FEED, Binding.RAPID), np.where(cutting, at_feed, time))
    every += of(path.reason, np.where(cutting, at_top - at_feed, 0.0))
    every += of(begins, ramps * share) + of(ends, ramps * (1 - share))
    rapid = np.isin(path.motion, (Motion.RAPID, Motion.INDEPENDENT))
    every += of(np.where(rapid, Binding.RAPID, Binding.EXACT_STOP), pause)
    found = {b.name.lower().replace("_", " "): float(s)
             for b, s in zip(Binding, every, strict=True)}  # fmt: skip
    waiting, seconds = auxiliary_time(moves, path.control.auxiliary,
                                      plan.spindle_speed[np.newaxis])  # fmt: skip
    for row, wait in zip(waiting.tolist(), seconds[0].tolist(), strict=True):
        name = WAITS[moves.kind[row]]
        found[name] = found.get(name, 0.0) + wait
    spindle = float(plan.wait.sum() - pause.sum() - seconds.sum())
    return found | {"spindle": max(0.0, spindle)}


def program_times(plan: Plan, name: str) -> SimulatedProgram:
    """Times of a program as they are stored."""
    return structured(summary(plan, name), SimulatedProgram, name)


def write_block_table(plan: Plan, path: Path) -> None:
    """Store the moves of a planned program as Parquet."""
    with replacing(path) as part:
        block_table(plan).to_parquet(part, compression="zstd")


def without_time(plan: Plan) -> dict[str, int]:
    """Counts of tool changes, spindle starts and stops without a time in the control."""
    moves, known = plan.path.moves, plan.path.control.auxiliary
    changes = moves.tool[moves.kind == Kind.TOOL_CHANGE].tolist()
    found = {
        "tool_change": sum(known.tool_change + known.tools.get(tool, 0.0) == 0 for tool in changes)
    }
    if np.isinf(known.spindle_acceleration) and known.spindle_delay == 0:
        found["spindle_acceleration"] = int((moves.kind == Kind.SPINDLE).sum())
    return {name: count for name, count in found.items() if count}


def _seconds(times: Floats) -> float:
    return round(float(times.sum()), 3)


def _by_tool(
    moves: Moves, time: Floats, cutting: NDArray[np.bool_]
) -> list[dict[str, float | int]]:
    found: list[dict[str, float | int]] = []
    for tool in dict.fromkeys(moves.tool.tolist()):
        rows = moves.tool == tool
        found.append({
            "tool": int(tool),
            "time_s": _seconds(time[rows]),
            "cutting_s": _seconds(time[rows & cutting]),
            "rapid_s": _seconds(time[rows & (moves.kind == Kind.RAPID)]),
            "length_mm": round(float(moves.length[rows].sum()), 3),
        })  # fmt: skip
    return found


def blocks(plan: Plan) -> list[dict[str, Any]]:
    """Every move: line, type, time, length, speed reached, what binds it."""
    moves, limits = plan.path.moves, limit_words(plan)
    kinds = [Kind(k).name.lower() for k in moves.kind.tolist()]
    return [
        {
            "line": line, "type": kind, "time_s": round(time, 6), "length_mm": round(length, 6),
            "reached_feed_mm_min": round(peak / METRE_PER_SECOND, 3), "limit": str(limit),
        }
        for line, kind, time, length, peak, limit in zip(
            moves.line.tolist(), kinds, plan.time.tolist(), moves.length.tolist(),
            plan.v_peak.tolist(), limits, strict=True,
        )
    ]  # fmt: skip


MOST = 50_000_000
"""Greatest number of positions of a trace."""


def write_trace(plan: Plan, path: Path, progress: Callable[[float], None] | None = None) -> int:
    """Write time [s], position [mm, deg], row and line at the interpolation period to Parquet.

    ``programmed_x`` and its like are before the filters, ``x`` and its like after them.
    ``progress`` gets the share that is written; the number of samples is returned.  Raises
    ValueError when the program is too long.
    """
    period = plan.path.control.interpolation_period
    if plan.total > MOST * period:
        raise ValueError(
            f"{plan.total:.0f} s at {period} s are more than {MOST} positions: write the trace of "
            "a shorter program, or raise control.interpolation_period"
        )
    moves = plan.path.moves
    axes = [i for i in range(6) if (moves.end[:, i] != moves.origin[i]).any()] or [0]
    written = 0
    chunks = traces(plan)
    first = next(chunks)
    schema = _trace_schema(axes)
    with replacing(path) as part, pq.ParquetWriter(part, schema, compression="zstd") as writer:
        for chunk in chain([first], chunks):
            writer.write_table(_trace_table(chunk, axes, moves))
            written += len(chunk)
            if progress is not None:
                progress(float(chunk.time[-1]) / max(plan.total, 1e-12))
    return written


def _trace_schema(axes: Sequence[int]) -> pa.Schema:
    def position(name: str, axis: int) -> pa.Field:
        return pa.field(name, pa.float64(), metadata={"unit": "mm" if axis < 3 else "deg"})

    names = [(AXES[i].lower(), i) for i in axes]
    return pa.schema([
        pa.field("time", pa.float64(), metadata={"unit": "s"}),
        pa.field("line", pa.int32()),
        *[position(name, i) for name, i in names],
        *[position(f"programmed_{name}", i) for name, i in names],
    ])  # fmt: skip


def _trace_table(chunk: Trace, axes: Sequence[int], moves: Moves) -> pa.Table:
    unit = [1 / METRE if i < 3 else 1 / RADIAN for i in axes]
    columns = [
        chunk.time,
        moves.line[chunk.row],
        *[chunk.position[:, i] * u for i, u in zip(axes, unit, strict=True)],
        *[chunk.programmed[:, i] * u for i, u in zip(axes, unit, strict=True)],
    ]
    return pa.table([pa.array(c) for c in columns], schema=_trace_schema(axes))


def simulate_files(
    files: Mapping[str, Path], raw: Path, control: ControlParameters, setup: Setup, out: Path, *,
    machine: str, origin: str, intervals: Bands | None = None,
    learnt: Mapping[str, Condition] | None = None, ends: Sequence[ControlParameters] = (),
) -> None:  # fmt: skip
    """Simulate each of ``files`` on a machine's control; one that cannot be followed is refused.

    ``files`` are part programs by the stem of ``<name>.json`` and ``<name>.parquet`` in ``out``.
    The interval of a time comes from ``intervals``, the conditions ``learnt`` and the slowest and
    fastest control, ``ends``.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name, path in files.items():
        program = SimulatedProgram(
            program=name, machine=machine, origin=origin, file=path.relative_to(raw).as_posix(),
            sha256=sha256(path.read_bytes()).hexdigest(),
        )  # fmt: skip
        try:
            moves = program_moves(path, setup)
            checked = preflight(moves, setup, limits_of(setup))
            plan = planned_program(moves, control)
        except GcodeError as error:
            program = replace(program, refused=str(error))
        else:
            program = replace(
                program_times(plan, name), machine=machine, origin=origin, file=program.file,
                sha256=program.sha256, blocks=len(moves),
                violations=tuple(violation_lines(checked.violations)),
                total_time_90_s=time_interval(plan, intervals or {}, learnt or {}, ends),
            )  # fmt: skip
            write_block_table(plan, out / f"{name}.parquet")
        write_json(program, out / f"{name}.json")
