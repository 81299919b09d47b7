"""Where the tool's tip is on the workpiece: the machine's frame less tool length and work offset.

A frame of ``Moves`` adds up work offset, G52, G92 and tool length (gcode/offsets.py); what of it is
tool length follows from the offsets in force before the program, and holds until G43 is said again.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.moves import RADIAN, Frame, Moves
from pipeline.gcode.setup import ZERO, Vector
from pipeline.machine.control.path import where

Floats = NDArray[np.float64]

LENGTH = "G43"


@dataclass(frozen=True, kw_only=True)
class WorkFrame:
    """One work offset: where the stock lies, and what each frame of the program holds of length.

    Parameters
    ----------
    name : str
        ``"G54"``, …
    base : ndarray, shape (3,)
        Of the work offset with the external one, in the machine [mm].
    rotation : float
        Of the work offset about Z [deg].
    lengths : ndarray, shape (frames, 3)
        Tool length in each frame of the program [mm].
    """

    name: str
    base: Floats = field(repr=False)
    rotation: float = 0.0
    lengths: Floats = field(repr=False)

    def tip(self, positions: Floats, frame: NDArray[np.int32]) -> Floats:
        """Tip in this offset's coordinates [mm], of machine positions (Q, 3) in frames (Q,)."""
        held = positions - self.lengths[frame] - self.base
        angle = self.rotation * RADIAN
        c, s = np.cos(angle), np.sin(angle)
        turned: Floats = held @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        return turned


def work_frame(
    moves: Moves, row: int, offsets: Mapping[str, Vector], name: str | None = None
) -> WorkFrame:
    """The work offset ``name``, by default the one in force in ``row``.

    Parameters
    ----------
    moves : Moves
        M rows.
    row : int
        First row that cuts.
    offsets : mapping of str to Vector
        Work offsets before the program, as in :class:`pipeline.gcode.setup.Setup`.
    name : str, optional
        Of the work offset that the stock is measured in.

    Raises
    ------
    ValueError
        When the program does not use ``name``, or a tool length cannot be told from a shift.
    """
    used = list(dict.fromkeys(_offset(frame) for frame in moves.frames))
    held = int(moves.frame[row])
    chosen = _offset(moves.frames[held]) if name is None else name
    if chosen not in used and chosen not in offsets:
        raise ValueError(
            f"work offset {chosen!r} is neither in the set-up nor in the program, which has "
            f"{', '.join(used)}: name one of them"
        )
    last = held if _offset(moves.frames[held]) == chosen else len(moves.frames) - 1
    before = moves.frames[: last + 1]
    plain = [f.rotation for f in before if _is_plain(f) and _offset(f) == chosen]
    return WorkFrame(
        name=chosen,
        base=_base(before, chosen, offsets),
        rotation=plain[-1] if plain else 0.0,
        lengths=_lengths(moves, offsets),
    )


def _marks(frame: Frame) -> list[str]:
    return frame.name.split("+")


def _offset(frame: Frame) -> str:
    return _marks(frame)[0]


def _is_plain(frame: Frame) -> bool:
    """Whether its translation is work offset and tool length alone."""
    return set(_marks(frame)[1:]) <= {LENGTH}


def _base(frames: Sequence[Frame], name: str, offsets: Mapping[str, Vector]) -> Floats:
    """Of a work offset as the last of ``frames`` without a length has it (G10), else the set-up."""
    for frame in reversed(frames):
        if frame.name == name:
            return np.array(frame.translation[:3])
    work, external = offsets.get(name, ZERO), offsets.get("EXT", ZERO)
    return np.array([a + b for a, b in zip(work[:3], external[:3], strict=True)])


def _lengths(moves: Moves, offsets: Mapping[str, Vector]) -> Floats:
    """Tool length in each frame [mm]; shape (frames, 3), 0 in those that no row uses."""
    lengths = np.zeros((len(moves.frames), 3))
    known: set[int] = set()
    held, before, tool = np.zeros(3), -1, -1
    for row in np.flatnonzero(np.diff(moves.frame, prepend=-1)):
        index = int(moves.frame[row])
        frame = moves.frames[index]
        if LENGTH not in _marks(frame):
            held = np.zeros(3)
        elif _is_plain(frame):
            base = _base(moves.frames[:index], _offset(frame), offsets)
            held = np.array(frame.translation[:3]) - base
        elif before < 0 or LENGTH not in _marks(moves.frames[before]):
            held = _earlier_length(moves, int(row), offsets)
        elif _marks(moves.frames[before]) == _marks(frame) and moves.tool[row] != tool:
            # what shifts the coordinates stayed in force while another length came
            held = held + np.subtract(frame.translation, moves.frames[before].translation)[:3]
        if index not in known:
            lengths[index] = held
            known.add(index)
        before, tool = index, int(moves.tool[row])
    return lengths


def _earlier_length(moves: Moves, row: int, offsets: Mapping[str, Vector]) -> Floats:
    """Length in the last frame before that of ``row`` that is work offset and length alone."""
    index = int(moves.frame[row])
    for earlier in range(index - 1, -1, -1):
        frame = moves.frames[earlier]
        if _is_plain(frame) and LENGTH in _marks(frame):
            base = _base(moves.frames[:earlier], _offset(frame), offsets)
            return np.array(frame.translation[:3]) - base
    raise ValueError(
        f"{where(moves, row)}: the tool's length cannot be told from what else shifts the "
        f"coordinates ({moves.frames[index].name}): program G43 before it"
    )
