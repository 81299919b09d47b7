"""Plain lines, compiled: G0 to G3 with numbers, from tokens to rows without a Python object.

A line that holds anything else, or anything wrong, is left to the interpreter, so that every rule
and every error stands in one place only; what is done here is the same bits as done there.
"""

from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from numba.extending import overload

from pipeline.gcode import geometry, state
from pipeline.gcode import plain_words as word
from pipeline.gcode.characters import Bytes
from pipeline.gcode.moves import INCH, Kind
from pipeline.gcode.plain_expressions import Floats, Table
from pipeline.gcode.plain_words import (
    TokenArrays,
    Words,
    given,
    read_words,
    scale_increments,
)
from pipeline.kernels import compiled

Integers: TypeAlias = npt.NDArray[np.int64]
Columns: TypeAlias = tuple[npt.NDArray[Any], ...]
RAPID, FEED, ARC = int(Kind.RAPID), int(Kind.FEED), int(Kind.ARC)
TOLERANCE, RELATIVE, R_TOLERANCE, INCREMENTS = range(4)
"""Places in ``choices``: tolerances of arcs, and whether numbers without a point are increments."""
FIRST, SECOND, NORMAL = (0, 2, 1), (1, 0, 2), (2, 1, 0)
"""Axes of G17, G18, G19; X Y Z are 0, 1, 2."""

COLUMNS = ("kind", "line", "end", "centre", "angle", "plane", "feed")
"""What differs from row to row of plain lines; the rest is as the state says."""
KIND, LINE, END, CENTRE, ANGLE, PLANE, FEED_COLUMN = range(len(COLUMNS))

for _shared in (geometry.distance, geometry.sweep, geometry.radii_agree, geometry.centre_of_radius):
    # what the interpreter calls is what is compiled
    overload(_shared, strict=False)(lambda *_, function=_shared: function)


@compiled
def follow(
    data: Bytes,
    tokens: TokenArrays,
    lines: tuple[int, int],
    floats: Floats,
    integers: Integers,
    choices: Floats,
    table: Table,
    columns: Columns,
    count: int,
    words: Words,
) -> tuple[int, int]:
    """Carry out plain lines; the first line that is none, and the number of rows.

    Parameters
    ----------
    data, tokens
        A program's bytes and its tokens' kind, start, value and first.
    lines : (int, int)
        The first, and the one to stop before, counting from 1.
    floats, integers
        Of :meth:`~pipeline.gcode.state.State.to_arrays`; changed in place.
    choices : (4,) array
        ``TOLERANCE``, ``RELATIVE``, ``R_TOLERANCE``, ``INCREMENTS``.
    table
        Variables, which no plain line changes.
    columns, count
        :data:`COLUMNS` of the rows, with room for a row a line, and how many are written.
    words : (``WIDTH``,) array
        To work in.
    """
    linuxcnc = integers[state.DIALECT] == state.LINUXCNC
    increments = choices[INCREMENTS] > 0
    for line in range(lines[0], lines[1]):
        if not read_words(data, tokens, line, linuxcnc, not increments, table, words):
            return line, count
        if words[word.COUNT] == 0:
            continue
        if increments:
            inch = floats[state.UNIT] != 1.0
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
    words: Words,
    floats: Floats,
    integers: Integers,
    choices: Floats,
    columns: Columns,
    count: int,
    line: int,
) -> int:
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
    floats[state.FEED], floats[state.UNIT] = feed, unit
    integers[state.MOTION], integers[state.PLANE] = motion, plane
    integers[state.ABSOLUTE] = absolute
    if not moves:
        return count
    write(columns, count, line, (motion, plane, feed))
    if motion >= 20:
        write_arc(columns, count, floats, plane, bend)
    elif unit != 1.0 and not linear:
        columns[FEED_COLUMN][count] = feed / unit  # degree/minute, which knows no inch
    for axis in range(6):
        floats[state.POSITION + axis] = end[axis]
    return count + 1


@compiled
def modes_of(
    words: Words, floats: Floats, integers: Integers
) -> tuple[int, int, int, float, float]:
    """Motion, plane, absolute, unit and feed that are in force with this line."""
    motion, plane = integers[state.MOTION], integers[state.PLANE]
    absolute, unit = integers[state.ABSOLUTE], floats[state.UNIT]
    feed = floats[state.FEED]
    if not np.isnan(words[word.MOTION]):
        motion = int(words[word.MOTION]) * 10
    if not np.isnan(words[word.PLANE]):
        plane = int(words[word.PLANE])
    if not np.isnan(words[word.DISTANCE]):
        absolute = int(words[word.DISTANCE] == 90)
    if not np.isnan(words[word.UNIT]):
        unit = INCH if words[word.UNIT] == 20 else 1.0
    if not np.isnan(words[word.F]):
        feed = words[word.F] * unit
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
        here = floats[state.POSITION + axis]
        value = words[word.AXES[axis]]
        if np.isnan(value):
            end[axis] = here
            continue
        if axis < 3:
            value *= unit
        end[axis] = value + (floats[state.TRANSLATION + axis] if absolute else here)


@compiled
def arc(
    words: Words,
    floats: Floats,
    integers: Integers,
    choices: Floats,
    modes: tuple[int, int, float],
    end: Floats,
) -> tuple[float, float, float]:
    """Angle [rad] and centre [mm] of an arc; the angle is 0 where the arc is none."""
    motion, plane, unit = modes
    first, second = FIRST[plane - 17], SECOND[plane - 17]
    turn = -1 if motion == 20 else 1
    u_0, v_0 = floats[state.POSITION + first], floats[state.POSITION + second]
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
def centre(words: Words, floats: Floats, integers: Integers, axis: int, unit: float) -> float:
    """One coordinate of the centre that I, J, K name [mm]; NaN where it is missing."""
    value = words[word.CENTRES[axis]]
    if integers[state.ARC_ABSOLUTE]:
        return value * unit + floats[state.TRANSLATION + axis]
    if np.isnan(value) or value == 0:
        value = 0.0  # of -0 too
    return floats[state.POSITION + axis] + value * unit


@compiled
def write(columns: Columns, row: int, line: int, modes: tuple[int, int, float]) -> None:
    """A straight row, but for its end, which stands there already."""
    motion, plane, feed = modes
    columns[KIND][row] = RAPID if motion == 0 else FEED
    columns[LINE][row] = line
    for axis in range(3):
        columns[CENTRE][row, axis] = np.nan
    columns[ANGLE][row] = 0.0
    columns[PLANE][row] = plane
    columns[FEED_COLUMN][row] = feed


@compiled
def write_arc(
    columns: Columns, row: int, floats: Floats, plane: int, bend: tuple[float, float, float]
) -> None:
    """What an arc's row has more than a straight one; the state still stands at its start."""
    columns[KIND][row] = ARC
    columns[ANGLE][row] = bend[0]
    for axis in range(3):
        columns[CENTRE][row, axis] = floats[state.POSITION + axis]
    columns[CENTRE][row, FIRST[plane - 17]] = bend[1]
    columns[CENTRE][row, SECOND[plane - 17]] = bend[2]
