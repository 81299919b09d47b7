"""Fast lines, compiled: G0 to G3 with numbers, from tokens to rows without a Python object.

A line that holds anything else, or anything wrong, is left to the interpreter.
"""

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from numba.extending import overload

from pipeline.gcode import fast_words as word
from pipeline.gcode import geometry, modal
from pipeline.gcode.dialects.variables import FanucVariables, LinuxcncParameters
from pipeline.gcode.fast_words import (
    WIDTH,
    Table,
    TokenArrays,
    Words,
    given,
    read_words,
    scale_increments,
    table_of,
)
from pipeline.gcode.geometry import LINUXCNC_R_TOLERANCE, LINUXCNC_TOLERANCE, RELATIVE_RADIUS
from pipeline.gcode.modal import FANUC, LINUXCNC, SIEMENS, State
from pipeline.gcode.moves import INCH, FeedMode, Kind
from pipeline.gcode.program import Program
from pipeline.gcode.run import Run
from pipeline.gcode.scanner import Bytes
from pipeline.kernels import compiled
from pipeline.schema.arrays import Floats, Ints

MOTIONS = (0, 10, 20, 30)
AHEAD = 8
"""Lines that are searched for expressions before the table of variables is made."""
FIRST_SYSTEM_PARAMETER = 5000
"""First of LinuxCNC's numbered parameters that may hold the state of the machine."""
Variables = FanucVariables | LinuxcncParameters


Columns: TypeAlias = tuple[npt.NDArray[Any], ...]
RAPID, FEED, ARC = int(Kind.RAPID), int(Kind.FEED), int(Kind.ARC)
TOLERANCE, RELATIVE, R_TOLERANCE, INCREMENTS = range(4)
"""Places in ``choices``: tolerances of arcs, and whether numbers without a point are increments."""
FIRST, SECOND, NORMAL = (0, 2, 1), (1, 0, 2), (2, 1, 0)
"""Axes of G17, G18, G19; X Y Z are 0, 1, 2."""

VARYING = ("kind", "line", "end", "centre", "angle", "plane", "feed")
"""Columns that vary from row to row of fast lines; the others follow from the modal state."""
KIND, LINE, END, CENTRE, ANGLE, PLANE, FEED_COLUMN = range(len(VARYING))

for _shared in (geometry.distance, geometry.sweep, geometry.radii_agree, geometry.centre_of_radius):
    # what the interpreter calls is what is compiled
    overload(_shared, strict=False)(lambda *_, function=_shared: function)


def fast_lines_apply(state: State) -> bool:
    """Whether the modal state allows fast lines."""
    return (
        state.dialect != SIEMENS
        and state.feed_mode == FeedMode.PER_MINUTE
        and state.cutter_compensation == 0
        and state.transformed == 0
        and (state.motion in MOTIONS or state.dialect == LINUXCNC)
    )


def run_fast_lines(
    program: Program, number: int, stop: int, run: Run, variables: Variables | None = None
) -> int:
    """Carry out fast lines from ``number`` to before ``stop``; the first line that was not one.

    Rows and state of ``run`` change, bit for bit as by the interpreter.  Lines with expressions are
    fast ones only with ``variables``.
    """
    content = program.content[number - 1 : number - 1 + AHEAD]
    if content[0] > 1 or not fast_lines_apply(run.state) or run.pending_length != 0:
        return number
    rows, tokens = run.rows, program.tokens
    rows.reserve(stop - number)
    floats, integers = run.state.to_arrays()
    line, count = follow(
        np.frombuffer(program.data, dtype=np.uint8), (tokens.kind, tokens.start, tokens.first),
        (number, stop), floats, integers, _choices(run),
        table_of(_table_variables(variables) if (content == 1).any() else {}),
        tuple(rows.arrays[name] for name in VARYING), rows.count, np.empty(WIDTH),
    )  # fmt: skip
    if count > rows.count:
        run.compensated_position = None
        for name in rows.arrays.keys() - set(VARYING):
            _fill(rows.arrays[name][rows.count : count], _constant(name, run.state))
    rows.count = count
    run.state.from_arrays(floats, integers)
    if run.state.dialect == FANUC:
        run.group_1 = run.state.motion
    return int(line)


def _table_variables(variables: Variables | None) -> dict[int | str, float]:
    """Variables that only an assignment changes."""
    if variables is None:
        return {}
    if isinstance(variables, FanucVariables):
        return variables.locals[-1] | variables.common
    return variables.locals[-1] | {
        key: value for key, value in variables.globals.items()
        if isinstance(key, str) or key < FIRST_SYSTEM_PARAMETER
    }  # fmt: skip


def _fill(column: npt.NDArray[Any], value: float) -> None:
    """Set a column; pages that hold nothing but zeros stay unwritten, and so cost no memory."""
    if value != 0 or column.any():
        column[:] = value


def _constant(name: str, state: State) -> float:
    """Value of a column that is the same in all rows of fast lines."""
    if name in ("code", "value") or (name == "speed" and state.direction == 0):
        return 0.0
    return float(getattr(state, name))


def _choices(run: Run) -> np.ndarray:
    increments = run.setup.decimal == "increment" and run.state.dialect == FANUC
    if run.state.dialect == LINUXCNC:
        tolerances = [LINUXCNC_TOLERANCE, RELATIVE_RADIUS, LINUXCNC_R_TOLERANCE]
    else:
        tolerances = [run.setup.arc_tolerance, 0.0, run.setup.arc_tolerance]
    return np.array([*tolerances, float(increments)])


@compiled
def follow(
    data: Bytes, tokens: TokenArrays, lines: tuple[int, int], floats: Floats, integers: Ints,
    choices: Floats, table: Table, columns: Columns, count: int, words: Words,
) -> tuple[int, int]:  # fmt: skip
    """Carry out fast lines; the first line that is none, and the number of rows.

    ``tokens``: kind, start and first; ``lines``: first line and the one to stop before; ``floats``
    and ``integers`` (:meth:`~pipeline.gcode.modal.State.to_arrays`) and ``columns``, of which
    ``count`` are written, change in place; ``choices`` (4,): ``TOLERANCE``, ``RELATIVE``,
    ``R_TOLERANCE``, ``INCREMENTS``; ``words`` (``WIDTH``,) is to work in.
    """
    linuxcnc = integers[modal.DIALECT] == modal.LINUXCNC
    increments = choices[INCREMENTS] > 0
    for line in range(lines[0], lines[1]):
        if not read_words(data, tokens, line, linuxcnc, not increments, table, words):
            return line, count
        if words[word.COUNT] == 0:
            continue
        if increments:
            inch = floats[modal.UNIT] != 1.0
            if not np.isnan(words[word.UNIT]):
                inch = words[word.UNIT] == 20
            scale_increments(data, tokens, line, inch, words)
        done = carry_out(words, floats, integers, choices, columns, count, line)
        if done < 0:
            return line, count
        count = done
    return lines[1], count


@compiled
def carry_out(
    words: Words, floats: Floats, integers: Ints, choices: Floats, columns: Columns, count: int,
    line: int,
) -> int:  # fmt: skip
    """Carry out one line; the number of rows, -1 where it is left as if it were not read."""
    modes = modes_of(words, floats, integers)
    motion, plane, absolute, unit, feed = modes
    linear = given(words, word.X, word.Z)
    moves = linear or given(words, word.A, word.C)
    if not allowed(words, motion, plane, feed, moves):
        return -1
    bend = (0.0, np.nan, np.nan)
    end = columns[END][count]
    if moves:
        target(words, floats, unit, absolute, end)
        if motion >= 20:
            bend = arc(words, floats, integers, choices, (motion, plane, unit), end)
            if bend[0] == 0:
                return -1
    floats[modal.FEED], floats[modal.UNIT] = feed, unit
    integers[modal.MOTION], integers[modal.PLANE] = motion, plane
    integers[modal.ABSOLUTE] = absolute
    if not moves:
        return count
    write(columns, count, line, (motion, plane, feed))
    if motion >= 20:
        write_arc(columns, count, floats, plane, bend)
    elif unit != 1.0 and not linear:
        columns[FEED_COLUMN][count] = (
            feed / unit
        )  # degree/minute does not depend on the unit of length
    for axis in range(6):
        floats[modal.POSITION + axis] = end[axis]
    return count + 1


@compiled
def modes_of(words: Words, floats: Floats, integers: Ints) -> tuple[int, int, int, float, float]:
    """Motion, plane, absolute, unit and feed that are in force with this line."""
    motion, plane = integers[modal.MOTION], integers[modal.PLANE]
    absolute, unit = integers[modal.ABSOLUTE], floats[modal.UNIT]
    feed = floats[modal.FEED]
    if not np.isnan(words[word.MOTION]):
        motion = int(words[word.MOTION]) * 10
    if not np.isnan(words[word.PLANE]):
        plane = int(words[word.PLANE])
    if not np.isnan(words[word.DISTANCE]):
        absolute = int(words[word.DISTANCE] == 90)
    if not np.isnan(words[word.UNIT]):
        unit = INCH if words[word.UNIT] == 20 else 1.0
    if not np.isnan(words[word.F]):
        # LinuxCNC reads F before it changes the unit
        linuxcnc = integers[modal.DIALECT] == modal.LINUXCNC
        feed = words[word.F] * (floats[modal.UNIT] if linuxcnc else unit)
    return motion, plane, absolute, unit, feed


@compiled
def allowed(words: Words, motion: int, plane: int, feed: float, moves: bool) -> bool:
    """Whether the words of a line go together without a word left over."""
    centres = 0
    for axis in range(3):
        if not np.isnan(words[word.CENTRES[axis]]):
            if axis == NORMAL[plane - 17]:
                return False
            centres += 1
    radius = not np.isnan(words[word.R])
    if not np.isnan(words[word.F]) and not words[word.F] > 0:
        return False
    if motion not in (20, 30) or not moves:
        named = not np.isnan(words[word.MOTION])
        straight = motion in (0, 10) or not (moves or named)
        return straight and centres == 0 and not radius and (motion == 0 or feed > 0 or not moves)
    return feed > 0 and (centres > 0) != radius


@compiled
def target(words: Words, floats: Floats, unit: float, absolute: int, end: Floats) -> None:
    """Machine position that the axis words name [mm, deg]."""
    for axis in range(6):
        here = floats[modal.POSITION + axis]
        value = words[word.AXES[axis]]
        if np.isnan(value):
            end[axis] = here
            continue
        if axis < 3:
            value *= unit
        end[axis] = value + (floats[modal.TRANSLATION + axis] if absolute else here)


@compiled
def arc(
    words: Words, floats: Floats, integers: Ints, choices: Floats, modes: tuple[int, int, float],
    end: Floats,
) -> tuple[float, float, float]:  # fmt: skip
    """Angle [rad] and centre [mm] of an arc; the angle is 0 where the arc is none."""
    motion, plane, unit = modes
    first, second = FIRST[plane - 17], SECOND[plane - 17]
    turn = -1 if motion == 20 else 1
    u_0, v_0 = floats[modal.POSITION + first], floats[modal.POSITION + second]
    u_1, v_1 = end[first], end[second]
    if not np.isnan(words[word.R]):
        verdict, u_c, v_c = geometry.centre_of_radius(
            u_0, v_0, u_1, v_1, words[word.R] * unit, turn, choices[R_TOLERANCE]
        )
    else:
        u_c = centre(words, floats, integers, first, unit)
        v_c = centre(words, floats, integers, second, unit)
        if np.isnan(u_c) or np.isnan(v_c):
            return 0.0, u_c, v_c
        verdict = geometry.radii_agree(
            u_0, v_0, u_1, v_1, u_c, v_c, choices[TOLERANCE], choices[RELATIVE]
        )
    if verdict != geometry.OK:
        return 0.0, u_c, v_c
    return geometry.sweep(u_0, v_0, u_1, v_1, u_c, v_c, turn, 1), u_c, v_c


@compiled
def centre(words: Words, floats: Floats, integers: Ints, axis: int, unit: float) -> float:
    """One coordinate of the centre that I, J, K name [mm]; NaN where it is missing."""
    value = words[word.CENTRES[axis]]
    if integers[modal.ARC_ABSOLUTE]:
        return value * unit + floats[modal.TRANSLATION + axis]
    if np.isnan(value) or value == 0:
        value = 0.0  # of -0 too
    return floats[modal.POSITION + axis] + value * unit


@compiled
def write(columns: Columns, row: int, line: int, modes: tuple[int, int, float]) -> None:
    """A straight row, but for its end, which stands there already."""
    motion, plane, feed = modes
    columns[KIND][row] = RAPID if motion == 0 else FEED
    columns[LINE][row] = line
    for axis in range(3):
        columns[CENTRE][row, axis] = np.nan
    if columns[ANGLE][row] != 0.0:  # a page of zeros that is not written costs no memory
        columns[ANGLE][row] = 0.0
    columns[PLANE][row] = plane
    columns[FEED_COLUMN][row] = feed


@compiled
def write_arc(
    columns: Columns, row: int, floats: Floats, plane: int, bend: tuple[float, float, float]
) -> None:
    """Add the arc to a straight row; the state's position is still the arc's start."""
    columns[KIND][row] = ARC
    columns[ANGLE][row] = bend[0]
    for axis in range(3):
        columns[CENTRE][row, axis] = floats[modal.POSITION + axis]
    columns[CENTRE][row, FIRST[plane - 17]] = bend[1]
    columns[CENTRE][row, SECOND[plane - 17]] = bend[2]
