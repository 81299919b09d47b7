"""Two programs by hand: F and S that the machine does not have, or that changed by very much."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.app.check import NEAR, in_force, moves_of, place, speed_of
from pipeline.app.fleet import machine_parameters
from pipeline.app.programs import machine_setup, setup_beside
from pipeline.app.tables import section
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.gcode.moves import FeedMode, Moves
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.problem.arrays import Rows
from pipeline.optimisation.text.feed_words import FeedWords
from pipeline.optimisation.text.modal_words import at_speed, cuts_at_feed
from pipeline.schema.arrays import Bools
from pipeline.schema.limits import MachiningPractice

LINEAR = "XYZ"


@dataclass(frozen=True, kw_only=True)
class MachineLimits:
    """Greatest S [rev/min] and greatest F [mm/min] of a machine; infinite where not known."""

    machine: str = ""
    speed_rpm: float = np.inf
    feed_mm_min: float = np.inf

    @classmethod
    def of(cls, machine: str | None) -> "MachineLimits":
        """Those of a machine’s file: spindle, its drive, cutting speeds of the axes.

        Raises
        ------
        ValueError
            When there is no such machine.
        """
        if machine is None:
            return cls()
        sections = machine_parameters(machine)["machine"][machine]
        drive = section(sections, "spindle_drive", SpindleDrive)
        control = section(sections, "control", ControlParameters)
        speed, feed = np.inf if drive is None else drive.top_speed_rpm, np.inf
        if control is not None:
            speed = min(speed, control.auxiliary.maximum_speed)
            axes = [axis.cutting_speed for name, axis in control.axes.items() if name in LINEAR]
            feed = max(axes, default=np.inf)
        return cls(machine=machine, speed_rpm=float(speed), feed_mm_min=float(feed))


def machine_lines(
    before: Path, after: Path, machine: str | None, dialect: str | None
) -> Iterator[str]:
    """Warnings of F and S of AFTER that are not those of BEFORE: one for each value and reason.

    S above the spindle’s top speed, F above what the axes reach, and a factor of change beyond
    the default of ``kerf optimise``.

    Raises
    ------
    ValueError
        When there is no such machine, or a program cannot be followed.
    """
    setup = setup_beside(machine_setup(machine, dialect), before)
    (_, old), (program, new) = (moves_of(path, setup) for path in (before, after))
    limits, words = MachineLimits.of(machine), FeedWords(program, new)
    feeds, unit = words.written(new.feed), words.unit
    fed = cuts_at_feed(new)
    turns = at_speed(new) & ~new.constant_surface_speed & (new.length > 0)
    changed_feed, changed_speed = _changed(old, new, fed), _changed(old, new, turns, speed=True)
    per_minute = np.where(new.feed_mode == FeedMode.PER_REVOLUTION, new.feed * new.speed, new.feed)
    per_minute = np.where(new.feed_mode == FeedMode.INVERSE_TIME, 0.0, per_minute)
    above = np.flatnonzero(changed_speed & (new.speed > limits.speed_rpm * (1 + NEAR)))
    for rows in _alike(above, new.speed):
        yield (
            f"warning: {_where(new, rows)}: S{new.speed[rows[0]]:g} is above "
            f"{limits.speed_rpm:g} rev/min, the greatest of the spindle of {limits.machine}: "
            "lower it"
        )
    fast = np.flatnonzero((changed_feed | changed_speed) & fed
                          & (per_minute > limits.feed_mm_min * (1 + NEAR)))  # fmt: skip
    for rows in _alike(fast, per_minute):
        yield (
            f"warning: {_where(new, rows)}: F{feeds[rows[0]]:g} {unit(rows[0])} is "
            f"{per_minute[rows[0]]:g} mm/min, above {limits.feed_mm_min:g} of the axes of "
            f"{limits.machine}: lower it"
        )
    if len(old) == len(new):  # with points put in, rows are not each other’s
        yield from _far(old, new, (fed, turns), words)


def _far(old: Moves, new: Moves, rows: tuple[Bools, Bools], words: FeedWords) -> Iterator[str]:
    """F and S that changed by more than the default change."""
    low, high = MachiningPractice().change
    then, now = words.written(old.feed), words.written(new.feed)
    for letter, own, value, mine in (
        ("F", then, now, rows[0]), ("S", old.speed, new.speed, rows[1]),
    ):  # fmt: skip
        ratio = np.divide(value, own, out=np.ones(len(own)), where=mine & (own > 0))
        far = (ratio > high * (1 + NEAR)) | (ratio < low * (1 - NEAR))
        for found in _alike(np.flatnonzero(far), own, value):
            first = found[0]
            yield (
                f"warning: {_where(new, found)}: {letter}{own[first]:g} became "
                f"{letter}{value[first]:g}, ×{ratio[first]:.3g}, outside of ×{low:g} to "
                f"×{high:g}: look whether it is meant"
            )


def _changed(old: Moves, new: Moves, rows: Bools, *, speed: bool = False) -> Bools:
    """Which of some rows have an F, or an S, that no row of their line had before; shape (M,).

    Where points are put in, that no row of their tool had.
    """
    out, lines = np.zeros(len(new), dtype=np.bool_), len(old) == len(new)
    known = set(in_force(old, np.arange(len(old)), lines=lines))
    if speed:
        known = {speed_of(key) for key in known}
    chosen = np.flatnonzero(rows)
    keys = in_force(new, chosen, lines=lines)
    out[chosen] = [(speed_of(key) if speed else key) not in known for key in keys]
    return out


def _alike(rows: Rows, *values: np.ndarray) -> Iterator[Rows]:
    """Rows of equal values, in the order of the first of each."""
    found: dict[tuple[float, ...], list[int]] = {}
    for row in rows.tolist():
        found.setdefault(tuple(float(one[row]) for one in values), []).append(row)
    for alike in found.values():
        yield np.array(alike, dtype=np.intp)


def _where(moves: Moves, rows: Rows) -> str:
    """Line and tool of the first row, and how many other lines."""
    more = len(set(moves.line[rows].tolist())) - 1
    others = f" and {more} more line{'s' * (more > 1)}" if more else ""
    return f"{place(moves, int(rows[0]))}{others}"
