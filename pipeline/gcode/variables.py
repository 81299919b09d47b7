"""Where ``#`` variables are kept: a Fanuc's, with its system variables.

Source: Fanuc 0i-F operator's manual B-64694EN, 16.2 "System variables".
"""

from collections.abc import Callable

from pipeline.gcode.errors import ExpressionError
from pipeline.gcode.run import Run

LOCAL = range(1, 34)
COMMON = range(100, 1000)
OFFSETS = {"EXT": 5201, **{f"G{54 + i}": 5221 + 20 * i for i in range(6)}}
"""First of the six variables of a work offset."""
MORE_OFFSETS = (range(7001, 7961), range(14001, 20001))
"""Of G54.1 P1 to P48, and of P1 to P300, 20 apart."""
REGISTERS = {10: "length_wear", 11: "length", 12: "radius", 13: "radius_wear"}
"""Thousands of a variable -> what it holds of the tool table (memory C)."""
NO_EFFECT = (3003, 3004, 3005)
"""Single block, feed hold and settings: how the control runs, not where it goes."""
ALARM, STOP = 3000, 3006


class FanucVariables:
    """Local, common and system variables.

    Parameters
    ----------
    run : Run
        What system variables tell of.
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        self.locals: list[dict[int, float]] = [{}]
        self.common: dict[int, float] = {}
        self.line = 0
        self.stops = 0
        for key, value in run.setup.parameters.items():
            self.write(key, value)

    def enter(self, arguments: dict[int, float]) -> None:
        """Begin a macro with its own local variables."""
        self.locals.append(dict(arguments))

    def leave(self) -> None:
        """Back to the caller's."""
        self.locals.pop()

    def read(self, key: int | str) -> float | None:
        """Value, None where it is vacant."""
        number = self._number(key)
        if number == 0:
            return None
        if number in LOCAL:
            return self.locals[-1].get(number)
        if number in COMMON:
            return self.common.get(number)
        return self._system(number)

    def write(self, key: int | str, value: float | None) -> None:
        """Keep a value; None makes it vacant."""
        number = self._number(key)
        store = self.locals[-1] if number in LOCAL else self.common
        if number in LOCAL or number in COMMON:
            if value is None:
                store.pop(number, None)
            else:
                store[number] = value
        else:
            self._set_system(number, value or 0.0)

    def exists(self, key: int | str) -> bool:
        """Whether it has a value."""
        return self.read(key) is not None

    def _number(self, key: int | str) -> int:
        if isinstance(key, str):
            raise ExpressionError(f"#<{key}> is a name and the dialect fanuc has numbers: use #100")
        return key

    def _system(self, number: int) -> float:
        run = self.run
        place = _offset_place(number)
        if place is not None:
            name, axis = place
            return run.offsets.work.get(name, [0.0] * 6)[axis] / self._unit(axis)
        if number // 1000 in REGISTERS and number % 1000 > 0:
            entry = run.registers.get(number % 1000)
            return getattr(entry, REGISTERS[number // 1000]) / run.state.unit if entry else 0.0
        if number // 20 * 20 in _POSITIONS and 1 <= number % 20 <= 6:
            axis = number % 20 - 1
            return _POSITIONS[number // 20 * 20](run)[axis] / self._unit(axis)
        if number in _MODAL:
            return _MODAL[number](run)
        raise ExpressionError(
            f"#{number} tells what only the machine knows, or is not supported: "
            "give it a value in setup.parameters of the machine's file, or use another variable"
        )

    def _set_system(self, number: int, value: float) -> None:
        run = self.run
        place = _offset_place(number)
        if place is not None:
            name, axis = place
            if run.contour is not None:
                raise ExpressionError("offsets cannot change while G41 or G42 is in force: G40")
            run.offsets.work.setdefault(name, [0.0] * 6)[axis] = value * self._unit(axis)
            run.remap()
        elif number // 1000 in REGISTERS and number % 1000 > 0:
            scaled = value * run.state.unit
            setattr(run.register(number % 1000), REGISTERS[number // 1000], scaled)
        elif number == ALARM:
            raise ExpressionError(
                f"the program stops with its own alarm {value:g}: look what it checks before"
            )
        elif number == STOP:
            self.stops += 1
        elif number not in NO_EFFECT:
            raise ExpressionError(f"#{number} cannot be written, or is not supported: use #100")

    def _unit(self, axis: int) -> float:
        return self.run.state.unit if axis < 3 else 1.0


def _offset_place(number: int) -> tuple[str, int] | None:
    """Work offset and axis that a system variable belongs to."""
    for name, first in OFFSETS.items():
        if first <= number < first + 6:
            return name, number - first
    for numbers in MORE_OFFSETS:
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
"""First variable less 1 -> six coordinates [mm, deg]."""
_MODAL: dict[int, Callable[[Run], float]] = {
    4001: lambda run: run.group_1 / 10,
    4002: lambda run: float(run.state.plane),
    4003: lambda run: 90.0 if run.state.absolute else 91.0,
    4005: lambda run: float(run.state.feed_mode),
    4006: lambda run: 21.0 if run.state.unit == 1.0 else 20.0,
    4007: lambda run: float(run.state.compensation or 40),
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
