"""Where LinuxCNC keeps ``#1`` and ``#<name>``, with what it tells of itself.

Source: LinuxCNC 2.9 "Parameters", "Numbered parameters" and "Predefined named parameters".
"""

from collections.abc import Callable

from pipeline.gcode.errors import ExpressionError
from pipeline.gcode.moves import INCH
from pipeline.gcode.run import Run
from pipeline.gcode.setup import ZERO
from pipeline.gcode.state import CANCELLED

LOCAL = range(1, 31)
PROBED = range(5061, 5071)
WAITED = 5399
"""What M66 waited for."""
SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
HIGHEST = 5601
ROTATION = 9
"""Place of R among the ten variables of a work offset."""


class LinuxcncParameters:
    """Numbered and named parameters.

    Parameters
    ----------
    run : Run
        What predefined parameters tell of.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        self.locals: list[dict[int | str, float]] = [{}]
        self.globals: dict[int | str, float] = {"_value": 0.0, "_value_returned": 0.0}
        self.line = 0
        self.unit = INCH if run.setup.inch_machine else 1.0
        for key, value in run.setup.parameters.items():
            self.write(key, value)
        run.remap()

    def enter(self, arguments: dict[int, float]) -> None:
        """Begin a subroutine with its own #1 to #30 and local names."""
        fresh: dict[int | str, float] = {}
        for number, value in arguments.items():
            fresh[number] = value
        self.locals.append(fresh)

    def leave(self) -> None:
        """Back to the caller's."""
        self.locals.pop()

    def read(self, key: int | str) -> float | None:
        """Value; a number without one reads 0, a name without one is an error."""
        if isinstance(key, int):
            return self._numbered(key)
        store = self.globals if key.startswith("_") else self.locals[-1]
        if key in store:
            return store[key]
        if key in _PREDEFINED:
            return _PREDEFINED[key](self.run)
        if key == "_call_level":
            return float(len(self.locals) - 1)
        if key == "_line":
            return float(self.line)
        if key.startswith(("_hal[", "_ini[")):
            raise ExpressionError(
                f"#<{key}> lives in the running control: give it a value in setup.parameters of "
                "the machine's file"
            )
        raise ExpressionError(f"#<{key}> has no value: assign one before it is read")

    def write(self, key: int | str, value: float | None) -> None:
        """Keep a value."""
        number = value or 0.0
        if isinstance(key, str):
            if key in _PREDEFINED:
                raise ExpressionError(f"#<{key}> can only be read: use another name")
            (self.globals if key.startswith("_") else self.locals[-1])[key] = number
        elif key in LOCAL:
            self.locals[-1][key] = number
        elif not self._write_offset(key, number):
            if not 0 < key <= HIGHEST or 5400 <= key <= 5428:
                raise ExpressionError(f"#{key} cannot be written: use #31 to #5000")
            self.globals[key] = number

    def exists(self, key: int | str) -> bool:
        """Whether a name has a value."""
        if isinstance(key, int):
            return True
        return key in self.globals or key in self.locals[-1] or key in _PREDEFINED

    def _numbered(self, key: int) -> float:
        run = self.run
        if key in LOCAL:
            return self.locals[-1].get(key, 0.0)
        if not 0 < key <= HIGHEST:
            raise ExpressionError(f"#{key} does not exist: use #1 to #{HIGHEST - 1}")
        if (key in PROBED and run.probed) or (key == WAITED and run.waited):
            raise ExpressionError(
                f"#{key} is known only when the machine has run: replace it by a number"
            )
        place = _offset_place(key)
        if place is not None:
            return self._offset(*place)
        if 5420 <= key <= 5425:
            axis = key - 5420
            return run.point[axis] / (run.state.unit if axis < 3 else 1.0)
        if 5401 <= key <= 5406:
            return run.offsets.length[key - 5401] / self._unit(key - 5401)
        if key in (5400, 5410):
            tool = max(run.state.tool, 0)
            entry = run.registers.get(tool)
            return float(tool) if key == 5400 else 2 * entry.radius / self.unit if entry else 0.0
        return self.globals.get(key, 0.0)

    def _offset(self, name: str, axis: int) -> float:
        run = self.run
        if name == "active":
            return float(SYSTEMS.index(run.offsets.active) + 1)
        if name == "shifted":
            return float(any(run.offsets.g92))
        if axis == ROTATION:
            return run.offsets.turned.get(name, 0.0)
        if axis >= 6:
            return 0.0
        if name == "G92":
            return (run.offsets.g92_kept or run.offsets.g92)[axis] / self._unit(axis)
        if name in ("G28", "G30"):
            return run.references.get(name, ZERO)[axis] / self._unit(axis)
        return run.offsets.work.get(name, ZERO)[axis] / self._unit(axis)

    def _unit(self, axis: int) -> float:
        """Millimetres (or degrees) in the machine's unit of an axis."""
        return self.unit if axis < 3 else 1.0

    def _write_offset(self, key: int, value: float) -> bool:
        """Offsets by number; they act when they are next chosen, as in LinuxCNC's own store."""
        place = _offset_place(key)
        if place is None or place[1] in (6, 7, 8):
            return False
        name, axis = place
        offsets, run = self.run.offsets, self.run
        if name in ("active", "shifted"):
            raise ExpressionError(f"#{key} is set by G54 to G59.3 and G92: write one of them")
        if axis == ROTATION:
            offsets.turned[name] = value
            return True
        value *= self._unit(axis)
        if name == "G92":
            offsets.g92[axis] = value
        elif name in ("G28", "G30"):
            reference = list(run.references.get(name, ZERO))
            reference[axis] = value
            x, y, z, a, b, c = reference
            run.references[name] = (x, y, z, a, b, c)
        else:
            offsets.work.setdefault(name, [0.0] * 6)[axis] = value
        return True


def _offset_place(key: int) -> tuple[str, int] | None:
    """What one of the numbers 5161 to 5390 belongs to, and its place there."""
    if key == 5220:
        return "active", 0
    if key == 5210:
        return "shifted", 0
    for name, first in _PLACES:
        last = ROTATION + 1 if first >= 5221 else ROTATION
        if first <= key < first + last:
            return name, key - first
    return None


_PLACES = (
    ("G28", 5161),
    ("G30", 5181),
    ("G92", 5211),
    *((name, 5221 + 20 * index) for index, name in enumerate(SYSTEMS)),
)


def _axis(axis: int) -> Callable[[Run], float]:
    return lambda run: run.point[axis] / (run.state.unit if axis < 3 else 1.0)


def _machine_axis(axis: int) -> Callable[[Run], float]:
    return lambda run: run.state.position[axis] / (run.state.unit if axis < 3 else 1.0)


def _is(name: str, value: int) -> Callable[[Run], float]:
    return lambda run: float(getattr(run.state, name) == value)


_PREDEFINED: dict[str, Callable[[Run], float]] = {
    **{f"_{letter}": _axis(axis) for axis, letter in enumerate("xyzabc")},
    **{f"_{letter}": lambda run: 0.0 for letter in "uvw"},
    **{f"_abs_{letter}": _machine_axis(axis) for axis, letter in enumerate("xyzabc")},
    "_vmajor": lambda run: 2.9,
    "_vminor": lambda run: 0.0,
    "_metric": lambda run: float(run.state.unit == 1.0),
    "_imperial": lambda run: float(run.state.unit != 1.0),
    "_absolute": _is("absolute", 1),
    "_incremental": _is("absolute", 0),
    "_ijk_absolute_mode": _is("arc_absolute", 1),
    "_inverse_time": _is("feed_mode", 93),
    "_units_per_minute": _is("feed_mode", 94),
    "_units_per_rev": _is("feed_mode", 95),
    "_coord_system": lambda run: float(run.state.wcs),
    "_plane": lambda run: run.state.plane * 10.0,
    "_ccomp": lambda run: (run.state.compensation or 40) * 10.0,
    "_motion_mode": lambda run: float(run.state.motion),
    "_tool_offset": lambda run: float(any(run.offsets.length)),
    "_retract_r_plane": lambda run: float(run.retract_to_r),
    "_retract_old_z": lambda run: float(not run.retract_to_r),
    "_lathe_diameter_mode": lambda run: float(run.diameter),
    "_lathe_radius_mode": lambda run: float(not run.diameter),
    "_spindle_on": lambda run: float(run.state.direction != 0),
    "_spindle_cw": lambda run: float(run.state.direction > 0),
    "_spindle_rpm_mode": lambda run: float(not run.state.constant_surface_speed),
    "_spindle_css_mode": lambda run: float(run.state.constant_surface_speed),
    "_feed": lambda run: run.state.feed / run.state.unit,
    "_rpm": lambda run: run.state.speed,
    "_current_tool": lambda run: float(max(run.state.tool, 0)),
    "_selected_tool": lambda run: float(run.state.selected),
    "_current_pocket": lambda run: float(max(run.state.tool, 0)),
    "_selected_pocket": lambda run: float(run.state.selected),
    "_task": lambda run: 0.0,
    "_remap_level": lambda run: 0.0,
    "_cycle": lambda run: float(run.cycle.code if run.cycle.code != CANCELLED else 0),
}
"""Name -> value."""
