"""Weeks of the simulated shop with one fault, written as its agent's log, read by the pipeline.

Faults act on the simulated machine: on its parameters, on what its tools meet, on what its sensors
read. Nothing of the twin takes part.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.schema.si import DAY
from pipeline.shop import sensors
from pipeline.shop.agent_log import Log, write_day
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.schedule import Shop, working_day
from pipeline.shop.sensors import MachineState, SensedDay, write_devices
from pipeline.shop.timeline import Execution, Timeline

WEDNESDAY = 2
"""Day of the week on which a fault begins; what came before is quiet."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault: what it does to a day before it is sensed, and to what the sensors read then.

    ``before`` gives the first and last second of the day in which it acts; None where it does not.
    """

    before: Callable[[MachineState, Timeline, int], tuple[int, int] | None] | None = None
    after: Callable[[SensedDay, int], tuple[int, int] | None] | None = None


def _spindle(machine: MachineState, **parts: float) -> None:
    spindle = machine.parameters.spindle
    machine.parameters = replace(machine.parameters, spindle=replace(spindle, **parts))


def cooling_failure(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """The pump of the chiller stands: its jackets keep a twentieth of their conductance."""
    if since == 0:
        paths = machine.parameters.spindle.paths
        _spindle(machine, paths=replace(
            paths, stator_jacket=0.05 * paths.stator_jacket,
            housing_jacket=0.05 * paths.housing_jacket))
    return day.on, day.off


def bearing_friction(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """Lubricant's share of the friction of both bearings: twice as high each day."""
    spindle = machine.parameters.spindle
    _spindle(machine, front=replace(spindle.front, f0=min(2.0 * spindle.front.f0, 10.0)),
             rear=replace(spindle.rear, f0=min(2.0 * spindle.rear.f0, 10.0)))
    return day.on, day.off


def _operations(day: Timeline, least: float) -> list[tuple[int, int]]:
    """Spans of a day in which one tool cuts, each longer than four minutes, at ``least`` [W]."""
    heavy = day.cut_power >= least
    key = np.where(heavy | (day.execution == Execution.ACTIVE), day.tool * 10000 + day.line // 100, -1)
    edges = np.flatnonzero(np.diff(key)) + 1
    spans = zip([0, *edges], [*edges, DAY], strict=True)
    return [(int(a), int(b)) for a, b in spans if b - a > 240 and heavy[a:b].mean() > 0.5]


def _one(day: Timeline, since: int, least: float) -> tuple[int, int] | None:
    """The operation after ten o'clock of the first day."""
    found = [one for one in _operations(day, least) if one[0] > 10 * 3600]
    return found[0] if since == 0 and found else None


def tool_breakage(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """Half a minute into an operation the tool breaks: it meets nothing for the next half hour."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := _one(day, since, 0.15 * rated)) is None:
        return None
    a = found[0] + 30
    b, tool = min(a + 1800, day.off), day.tool[a]
    day.cut_power[a:b][day.tool[a:b] == tool] = 0.0
    return a, b


def worn_tool(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """A tool needs 1.6 times its power from ten o'clock on to the end of the day."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := _one(day, since, 0.15 * rated)) is None:
        return None
    a = found[0]
    day.cut_power[a:][day.tool[a:] == day.tool[a]] *= 1.6
    return a, day.off


def overload(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """For two minutes a cut needs 1.3 times the rated power."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := _one(day, since, 0.15 * rated)) is None:
        return None
    a, b = found[0] + 60, found[0] + 180
    day.cut_power[a:b] = 1.3 * rated
    return a, b


def load_without_feed(machine: MachineState, day: Timeline, since: int) -> tuple[int, int] | None:
    """For two minutes the tool is jammed: the feed stands at 80 % load, the program runs."""
    rated = machine.parameters.spindle.motor.rated_power
    if (found := _one(day, since, 0.15 * rated)) is None:
        return None
    a, b = found[0] + 60, found[0] + 180
    day.cut_power[a:b], day.feed[a:b] = 0.8 * rated, 0.0
    for axis in (day.x, day.y, day.z):
        axis[a:b] = np.nan
    return a, b


def dead_sensor(day: SensedDay, since: int) -> tuple[int, int] | None:
    """From ten o'clock on the first day the sensor says the same, over days."""
    a = 10 * 3600 if since == 0 else 0
    one = day.numbers["S1temp"]
    one[a:] = 37.0
    return max(a, day.timeline.on), day.timeline.off


def drifting_sensor(day: SensedDay, since: int) -> tuple[int, int] | None:
    """From ten o'clock of the first day the sensor reads 1 K more each hour of the clock."""
    hours = (np.arange(DAY) + since * DAY) / 3600 - 10
    day.numbers["S1temp"] = np.floor(day.numbers["S1temp"] + np.maximum(hours, 0.0))
    return max(10 * 3600 if since == 0 else 0, day.timeline.on), day.timeline.off


FAULTS: dict[str, Fault] = {
    "cooling failure": Fault(before=cooling_failure),
    "bearing friction": Fault(before=bearing_friction),
    "dead sensor": Fault(after=dead_sensor),
    "drifting sensor": Fault(after=drifting_sensor),
    "tool breakage": Fault(before=tool_breakage),
    "worn tool": Fault(before=worn_tool),
    "overload": Fault(before=overload),
    "load without feed": Fault(before=load_without_feed),
}
QUIET = Fault()


def write_weeks(out: Path, parameters: ShopParameters, fault: Fault = QUIET) -> list[tuple[int, int]]:
    """Write the agent's log of all weeks; spans [ns] in which the fault acted.

    It begins on Wednesday of the first week.
    """
    ambient = sensors.ambient_temperature(parameters)
    shop = Shop(parameters=parameters, random=parameters.generator("schedule"))
    machine = sensors.new_machine(parameters, float(ambient[0]))
    log = Log(parameters=parameters, folder=out, random=parameters.generator("log"))
    spans, tips = [], []
    for number in range(parameters.days):
        timeline, since = working_day(shop, number), number - WEDNESDAY
        acted = since >= 0 and timeline.on < DAY
        found = fault.before(machine, timeline, since) if acted and fault.before else None
        day = sensors.sensed_day(machine, timeline, sensors.air_of_day(ambient, number))
        if acted and fault.after:
            found = fault.after(day, since)
        write_day(log, day)
        tips.append(sensors.tip_temperatures(day))
        if found is not None:
            start = parameters.start.astype("datetime64[ns]").astype(np.int64) + number * DAY * 10**9
            spans.append((int(start + found[0] * 10**9), int(start + found[1] * 10**9)))
    write_devices(out / "Devices.xml", parameters)
    sensors.write_thermocouples(out / "thermocouples", np.concatenate(tips), parameters)
    return spans
