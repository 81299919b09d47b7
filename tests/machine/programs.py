"""Programs and controls for the tests, made without the interpreter."""

import numpy as np

from pipeline.gcode.moves import FeedMode, Kind, Moves, PathMode
from pipeline.machine.control.commands import commanded_feeds, spindle_speeds, waits
from pipeline.machine.control.parameters import (
    AuxiliaryParameters,
    AxisParameters,
    ControlParameters,
)
from pipeline.machine.control.path import Path
from pipeline.machine.control.planner import motion_times

IN_PLANE = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}


class Writer:
    """Rows one after the other, from where the last one ended [mm, deg]."""

    def __init__(self, origin=(0, 0, 0, 0, 0, 0)):
        self.origin = np.array(origin, float)
        self.at = self.origin.copy()
        self.rows = []
        self.modal = {
            "feed": 1000.0, "feed_mode": FeedMode.PER_MINUTE, "speed": 0.0, "direction": 0,
            "constant_surface_speed": False, "tool": -1, "path_mode": PathMode.CONTINUOUS,
            "tolerance": 0.0,
        }  # fmt: skip

    def set(self, **modal):
        self.modal |= modal
        return self

    def row(self, kind, **columns):
        row = {
            "kind": kind, "end": self.at.copy(), "centre": np.full(3, np.nan), "angle": 0.0,
            "plane": 17, "code": 0, "value": 0.0,
        }  # fmt: skip
        self.rows.append(row | self.modal | columns)
        return self

    def to(self, *, kind=Kind.FEED, **axes):
        for letter, value in axes.items():
            self.at["XYZABC".index(letter)] = value
        return self.row(kind)

    def by(self, step, kind=Kind.FEED):
        self.at[: len(step)] += step
        return self.row(kind)

    def rapid(self, **axes):
        return self.to(kind=Kind.RAPID, **axes)

    def arc(self, centre, angle, *, plane=17, rise=0.0, growth=0.0, **others):
        """Sweep ``angle`` [rad] about ``centre``, two coordinates of the plane [mm]."""
        a, b, n = IN_PLANE[plane]
        u, v = self.at[a] - centre[0], self.at[b] - centre[1]
        r, phi = np.hypot(u, v) + growth, np.arctan2(v, u) + angle
        middle = np.full(3, np.nan)
        middle[[a, b, n]] = [*centre, self.at[n]]
        self.at[[a, b]] = [centre[0] + r * np.cos(phi), centre[1] + r * np.sin(phi)]
        self.at[n] += rise
        for letter, value in others.items():
            self.at["XYZABC".index(letter)] = value
        return self.row(Kind.ARC, centre=middle, angle=angle, plane=plane)

    @property
    def moves(self) -> Moves:
        many = len(self.rows)

        def column(name, dtype):
            return np.array([row[name] for row in self.rows], dtype)

        return Moves(
            origin=self.origin,
            kind=column("kind", np.uint8),
            line=np.arange(1, many + 1, dtype=np.int32),
            file=np.zeros(many, np.int16),
            end=column("end", float).reshape(many, 6),
            centre=column("centre", float).reshape(many, 3),
            angle=column("angle", float),
            plane=column("plane", np.uint8),
            feed=column("feed", float),
            feed_mode=column("feed_mode", np.uint8),
            speed=column("speed", float),
            direction=column("direction", np.int8),
            constant_surface_speed=column("constant_surface_speed", bool),
            tool=column("tool", np.int32),
            frame=np.zeros(many, np.int32),
            path_mode=column("path_mode", np.uint8),
            tolerance=column("tolerance", float),
            code=column("code", np.int32),
            value=column("value", float),
            files=("part.nc",),
        )


AXIS = {
    "rapid_speed": 30000.0, "cutting_speed": 15000.0, "rapid_acceleration": 5000.0,
    "cutting_acceleration": 2000.0, "arc_acceleration": 1000.0, "corner_jump": 400.0,
}  # fmt: skip


def axis(**changes):
    return AxisParameters(**(AXIS | changes))


def control(*, letters="XYZ", auxiliary=None, limits=None, **changes):
    return ControlParameters(
        axes={letter: axis(**(limits or {})) for letter in letters},
        auxiliary=auxiliary or AuxiliaryParameters(),
        **changes,
    )


def row_times(path: Path, feeds: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Time of each row for a population of F and S, both (P, M), as the optimiser takes it [s]."""
    spindle = spindle_speeds(path, speeds)
    time = motion_times(path, commanded_feeds(path, feeds, 100.0, 100.0), spindle)
    return time + waits(path, spindle, time)
