"""Replay of injected faults of the simulated shop names the sub-model that explains the residual."""

import numpy as np
from dataclasses import replace
from pipeline.shop.sensors import MachineState, SensedDay
from pipeline.shop.timeline import Timeline
from tests.monitoring.faulty_weeks import Fault, _spindle, _one, day_span


def cooling_weaker(machine: MachineState, day: Timeline, since: int) -> tuple[int, int]:
    """The filter of the chiller clogs: the jackets keep a third of their conductance."""
    if since == 0:
        paths = machine.parameters.spindle.paths
        _spindle(machine, paths=replace(paths, stator_jacket=0.35 * paths.stator_jacket,
                                        housing_jacket=0.35 * paths.housing_jacket))  # fmt: skip
    return day_span(day)


def lubricant_stiffer(machine: MachineState, day: Timeline, since: int) -> tuple[int, int]:
    """The lubricant's share of the bearings' friction is three times as high from one day on."""
    if since == 0:
        spindle = machine.parameters.spindle
        _spindle(machine, front=replace(spindle.front, f0=3.0 * spindle.front.f0),
                 rear=replace(spindle.rear, f0=3.0 * spindle.rear.f0))  # fmt: skip
    return day_span(day)


def tool_blunter(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """A tool needs 1.35 times its power from ten o'clock on to the end of the day."""
    found = _one(day, since, 0.15 * machine.parameters.spindle.motor.rated_power)
    if found is None:
        return None
    day.cut_power[found[0] :][day.tool[found[0] :] == day.tool[found[0]]] *= 1.35
    return found[0], day.off


def sensor_offset(day: SensedDay, since: int) -> tuple[int, int]:
    """The sensor of the spindle reads 6 K more from one morning on."""
    day.numbers["S1temp"] = day.numbers["S1temp"] + 6.0
    return day_span(day.timeline)


def sensor_slow_drift(day: SensedDay, since: int) -> tuple[int, int]:
    """The sensor of the spindle reads 0.4 K less each hour of the clock."""
    hours = np.arange(86400) / 3600 + 24 * since - day.timeline.on / 3600 * (since == 0)
    day.numbers["S1temp"] = np.floor(day.numbers["S1temp"] - 0.4 * np.maximum(hours, 0.0))
    return day_span(day.timeline)


def load_meter(day: SensedDay, since: int) -> tuple[int, int]:
    """The load of the spindle reads 1.4 times what it is."""
    day.numbers["S1load"] = np.round(1.4 * day.numbers["S1load"])
    return day_span(day.timeline)


def axis_friction(day: SensedDay, since: int) -> tuple[int, int]:
    """A cover rubs: the X axis needs 12 % more load while it moves."""
    moves = day.numbers["Xfeed"] > 0
    day.numbers["Xload"] = day.numbers["Xload"] + np.where(moves, 12.0, 0.0)
    return day_span(day.timeline)


def axis_viscous(day: SensedDay, since: int) -> tuple[int, int]:
    """Stiff grease: the Z axis needs three times the load that goes with its speed."""
    day.numbers["Zload"] = np.round(
        day.numbers["Zload"] + 2.0 * 0.12 * np.minimum(np.abs(day.numbers["Zfeed"]), 300)
    )
    return day_span(day.timeline)


FAULTS: dict[str, Fault] = {
    "weaker cooling": Fault(before=cooling_weaker),
    "stiffer lubricant": Fault(before=lubricant_stiffer),
    "blunter tool": Fault(before=tool_blunter),
    "sensor offset": Fault(after=sensor_offset),
    "slow drift": Fault(after=sensor_slow_drift),
    "load meter": Fault(after=load_meter),
    "axis friction": Fault(after=axis_friction),
    "stiff grease": Fault(after=axis_viscous),
    "override left": Fault(override=60.0),
}
