"""Variables of the dialects: Macro B's, LinuxCNC's parameters and Sinumerik's variables by name.

Sources: Fanuc 0i-F operator's manual B-64694EN, 16.2 "System variables"; LinuxCNC 2.9 "Parameters",
"Numbered parameters" and "Predefined named parameters".
"""

from collections.abc import Callable

from pipeline.gcode.dialects.siemens_tokens import ARGUMENT, R_PARAMETER, VARIABLE, variable
from pipeline.gcode.modal import CANCELLED
from pipeline.gcode.moves import INCH
from pipeline.gcode.run import Register, Run
from pipeline.gcode.setup import ZERO
from pipeline.gcode.statements import ExpressionError

FANUC_LOCAL = range(1, 34)
FANUC_COMMON = range(100, 1000)
FANUC_OFFSETS = {"EXT": 5201, **{f"G{54 + i}": 5221 + 20 * i for i in range(6)}}
"""Work offset -> first of its six variables."""
FANUC_MORE_OFFSETS = (range(7001, 7961), range(14001, 20001))
"""Variables of G54.1 P1 to P48, and of P1 to P300, 20 apart."""
FANUC_REGISTERS = {10: "length_wear", 11: "length", 12: "radius", 13: "radius_wear"}
"""Thousands of a variable -> what it holds of the tool table (memory C)."""
WITHOUT_EFFECT = (3003, 3004, 3005)
"""Single block, feed hold and settings: how the control runs, not where it goes."""
ALARM, STOP = 3000, 3006


class _WithLocals:
    """Variables of which each macro or subroutine has its own: ``#1`` to ``#33``, local names."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.locals: list[dict[int | str, float]] = [{}]
        self.line = 0

    def enter(self, arguments: dict[int, float]) -> None:
        """Begin a macro or subroutine with its own local variables."""
        self.locals.append(dict(arguments.items()))

    def leave(self) -> None:
        """Return to the caller's local variables."""
        self.locals.pop()


class FanucVariables(_WithLocals):
    """Local, common and system variables."""

    def __init__(self, run: Run) -> None:
        super().__init__(run)
        self.common: dict[int | str, float] = {}
        self.stops = 0
        for key, value in run.setup.parameters.items():
            self.write(key, value)

    def read(self, key: int | str) -> float | None:
        """Value, None where it is vacant."""
        number = self._number(key)
        if number == 0:
            return None
        if number in FANUC_LOCAL:
            return self.locals[-1].get(number)
        if number in FANUC_COMMON:
            return self.common.get(number)
        return self._system(number)

    def write(self, key: int | str, value: float | None) -> None:
        """Keep a value; None makes it vacant."""
        number = self._number(key)
        store = self.locals[-1] if number in FANUC_LOCAL else self.common
        if number not in FANUC_LOCAL and number not in FANUC_COMMON:
            self._set_system(number, value or 0.0)
        elif value is None:
            store.pop(number, None)
        else:
            store[number] = value

    def exists(self, key: int | str) -> bool:
        """Whether the variable has a value."""
        return self.read(key) is not None

    def _number(self, key: int | str) -> int:
        if isinstance(key, str):
            raise ExpressionError(f"#<{key}> is a name and the dialect fanuc has numbers: use #100")
        return key

    def _system(self, number: int) -> float:
        run = self.run
        place = _fanuc_offset_place(number)
        if place is not None:
            name, axis = place
            return run.offsets.work.get(name, [0.0] * 6)[axis] / _unit(run, axis)
        if number // 1000 in FANUC_REGISTERS and number % 1000 > 0:
            entry = run.registers.get(number % 1000, Register())
            return float(getattr(entry, FANUC_REGISTERS[number // 1000]) / run.state.unit)
        if number // 20 * 20 in _POSITIONS and 1 <= number % 20 <= 6:
            axis = number % 20 - 1
            return _POSITIONS[number // 20 * 20](run)[axis] / _unit(self.run, axis)
        if number in _MODAL:
            return _MODAL[number](run)
        raise ExpressionError(
            f"#{number} tells what only the machine knows, or is not supported: "
            "give it a value in setup.parameters of the machine's file, or use another variable"
        )

    def _set_system(self, number: int, value: float) -> None:
        run = self.run
        place = _fanuc_offset_place(number)
        if place is not None:
            name, axis = place
            if run.contour is not None:
                raise ExpressionError("offsets cannot change while G41 or G42 is in force: G40")
            run.offsets.work.setdefault(name, [0.0] * 6)[axis] = value * _unit(self.run, axis)
            run.remap()
        elif number // 1000 in FANUC_REGISTERS and number % 1000 > 0:
            scaled = value * run.state.unit
            setattr(run.register(number % 1000), FANUC_REGISTERS[number // 1000], scaled)
        elif number == ALARM:
            raise ExpressionError(
                f"the program stops with its own alarm {value:g}: look what it checks before"
            )
        elif number == STOP:
            self.stops += 1
        elif number not in WITHOUT_EFFECT:
            raise ExpressionError(f"#{number} cannot be written, or is not supported: use #100")


def _unit(run: Run, axis: int) -> float:
    """The program's unit of an axis [mm, deg]."""
    return run.state.unit if axis < 3 else 1.0


def _fanuc_offset_place(number: int) -> tuple[str, int] | None:
    for name, first in FANUC_OFFSETS.items():
        if first <= number < first + 6:
            return name, number - first
    for numbers in FANUC_MORE_OFFSETS:
        index, axis = divmod(number - numbers.start, 20)
        if number in numbers and axis < 6:
            return f"G54.1 P{index + 1}", axis
    return None


_POSITIONS: dict[int, Callable[[Run], list[float]]] = {
    5000: lambda run: run.point,
    5020: lambda run: run.state.position,
    5040: lambda run: run.point,
    5080: lambda run: run.offsets.length,
}
"""Number before the first variable -> six coordinates [mm, deg]."""
_MODAL: dict[int, Callable[[Run], float]] = {
    4001: lambda run: run.group_1 / 10,
    4002: lambda run: float(run.state.plane),
    4003: lambda run: 90.0 if run.state.absolute else 91.0,
    4005: lambda run: float(run.state.feed_mode),
    4006: lambda run: 21.0 if run.state.unit == 1.0 else 20.0,
    4007: lambda run: float(run.state.cutter_compensation or 40),
    4008: lambda run: run.length_mode / 10,
    4009: lambda run: run.state.motion / 10 if run.state.motion >= 730 else 80.0,
    4010: lambda run: 99.0 if run.retract_to_r else 98.0,
    4014: lambda run: run.state.wcs / 10,
    4016: lambda run: 68.0 if run.offsets.rotation else 69.0,
    4107: lambda run: float(run.radius_number),
    4109: lambda run: run.state.feed / run.state.unit,
    4111: lambda run: float(run.length_number),
    4119: lambda run: run.state.speed,
    4120: lambda run: float(max(run.state.selected, 0)),
}
"""Variable -> what is in force."""

LINUXCNC_LOCAL = range(1, 31)
PROBED = range(5061, 5071)
WAITED = 5399
"""Parameter that holds the input that M66 waited for."""
LINUXCNC_SYSTEMS = ("G54", "G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3")
HIGHEST = 5601
ROTATION = 9
"""Place of R among the ten variables of a work offset."""


class LinuxcncParameters(_WithLocals):
    """Numbered and named parameters."""

    def __init__(self, run: Run) -> None:
        super().__init__(run)
        self.globals: dict[int | str, float] = {"_value": 0.0, "_value_returned": 0.0}
        self.unit = INCH if run.setup.inch_machine else 1.0
        for key, value in run.setup.parameters.items():
            self.write(key, value)
        run.remap()

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
        """Store a value."""
        number = value or 0.0
        if isinstance(key, str):
            if key in _PREDEFINED:
                raise ExpressionError(f"#<{key}> can only be read: use another name")
            (self.globals if key.startswith("_") else self.locals[-1])[key] = number
        elif key in LINUXCNC_LOCAL:
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
        if key in LINUXCNC_LOCAL:
            return self.locals[-1].get(key, 0.0)
        if not 0 < key <= HIGHEST:
            raise ExpressionError(f"#{key} does not exist: use #1 to #{HIGHEST - 1}")
        if (key in PROBED and run.probed) or (key == WAITED and run.waited):
            raise ExpressionError(
                f"#{key} is known only when the machine has run: replace it by a number"
            )
        place = _linuxcnc_offset_place(key)
        if place is not None:
            return self._offset(*place)
        if 5420 <= key <= 5425:
            axis = key - 5420
            return run.point[axis] / _unit(run, axis)
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
            return float(LINUXCNC_SYSTEMS.index(run.offsets.active) + 1)
        if name == "shifted":
            return float(any(run.offsets.g92))
        if axis == ROTATION:
            return run.offsets.rotations.get(name, 0.0)
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
        place = _linuxcnc_offset_place(key)
        if place is None or place[1] in (6, 7, 8):
            return False
        name, axis = place
        offsets, run = self.run.offsets, self.run
        if name in ("active", "shifted"):
            raise ExpressionError(f"#{key} is set by G54 to G59.3 and G92: write one of them")
        if axis == ROTATION:
            offsets.rotations[name] = value
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


def _linuxcnc_offset_place(key: int) -> tuple[str, int] | None:
    if key == 5220:
        return "active", 0
    if key == 5210:
        return "shifted", 0
    for name, first in _PLACES:
        if first <= key < first + ROTATION + (first >= 5221):
            return name, key - first
    return None


_PLACES = (
    ("G28", 5161),
    ("G30", 5181),
    ("G92", 5211),
    *((name, 5221 + 20 * index) for index, name in enumerate(LINUXCNC_SYSTEMS)),
)


def _axis(axis: int, *, machine: bool = False) -> Callable[[Run], float]:
    return lambda run: (run.state.position if machine else run.point)[axis] / _unit(run, axis)


def _is(name: str, value: int) -> Callable[[Run], float]:
    return lambda run: float(getattr(run.state, name) == value)


_PREDEFINED: dict[str, Callable[[Run], float]] = {
    **{f"_{letter}": _axis(axis) for axis, letter in enumerate("xyzabc")},
    **{f"_{letter}": lambda run: 0.0 for letter in "uvw"},
    **{f"_abs_{letter}": _axis(axis, machine=True) for axis, letter in enumerate("xyzabc")},
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
    "_ccomp": lambda run: (run.state.cutter_compensation or 40) * 10.0,
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
"""Predefined named parameter -> value."""


class SiemensVariables:
    """Names and their values; DEF makes them, with 0 where it gives no value.

    R0 to R999 are there without DEF; one that neither the program nor the setup gives a value reads
    0, as on a control that is new.
    """

    def __init__(self, run: Run) -> None:
        given = run.setup.parameters.items()
        self.values: dict[int | str, float] = {variable(str(name)): v for name, v in given}
        self.common = frozenset(self.values)
        self.callers: list[dict[int | str, float]] = []
        self.line = 0

    def enter(self, arguments: dict[int, float]) -> None:
        """A subprogram with its arguments; it knows R parameters and the setup's variables only."""
        self.callers.append(self.values)
        self.values = self._shared | {f"{ARGUMENT}{n}": value for n, value in arguments.items()}

    def leave(self) -> None:
        """Return to the caller's local variables."""
        self.values = self.callers.pop() | self._shared

    @property
    def _shared(self) -> dict[int | str, float]:
        def known(name: str) -> bool:
            plain = name.removeprefix(VARIABLE)
            return name in self.common or bool(R_PARAMETER.fullmatch(plain))

        return {key: value for key, value in self.values.items() if known(str(key))}

    def read(self, key: int | str) -> float | None:
        """Value of a name."""
        if key in self.values:
            return self.values[key]
        name = str(key).removeprefix(VARIABLE)
        if R_PARAMETER.fullmatch(name):
            return 0.0
        raise ExpressionError(
            f"{name.upper()} has no value: define it with DEF before"
            + " (a subprogram knows no variables of its caller)" * bool(self.callers)
        )

    def write(self, key: int | str, value: float | None) -> None:
        """Store a value."""
        self.values[key] = value or 0.0

    def exists(self, key: int | str) -> bool:
        """Whether a name has a value."""
        return key in self.values
