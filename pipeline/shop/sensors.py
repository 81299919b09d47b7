"""Data items of the simulated machines, and their readings in each second of a day.

The items are those of the log and of the MTConnect Devices document (2.0); the readings come from
shop air, spindle, axes and counters, and from thermocouples beside the machine.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.files import replacing
from pipeline.schema.si import DAY
from pipeline.shop.files import write_text
from pipeline.shop.motion import lagged, slewed
from pipeline.shop.parameters import AirParameters, Random, ShopParameters, stamp
from pipeline.shop.spindle import BED, COOLANT, FRONT, HOUSING, REAR, Inputs, heat, state_at_rest
from pipeline.shop.timeline import Execution, Mode, Timeline, carried

Category = Literal["SAMPLE", "EVENT", "CONDITION"]
NAMESPACE = "urn:mtconnect.org:MTConnectDevices:2.0"


@dataclass(frozen=True)
class DataItem:
    """One data item; ``native = value * factor``, written with ``decimals`` digits after the point.

    ``native_units`` are those of ``units`` unless they are given.  ``supplied`` is False for items
    that the device model promises and the machine never sends.
    """

    name: str
    component: str
    category: Category
    type: str
    sub_type: str = ""
    units: str = ""
    native_units: str = field(default="", kw_only=True)
    factor: float = field(default=1.0, kw_only=True)
    decimals: int = field(default=0, kw_only=True)
    supplied: bool = field(default=True, kw_only=True)
    # sent as soon as the control is up, before the machine is ready
    at_start: bool = field(default=False, kw_only=True)

    def written(self, values: Floats | Ints, native: bool) -> Floats:
        """``values`` (T,) in ``units`` -> as the log has them, rounded; no negative zero."""
        return np.round(values * (self.factor if native else 1.0), self.decimals) + 0.0

    def texts(self, values: Floats | Ints, native: bool) -> list[str]:
        """Numbers as the log has them: whole ones without a point."""
        if self.decimals == 0 or (native and self.type == "EQUIPMENT_TIMER"):
            return [str(int(v)) for v in values.tolist()]
        return [f"{v:.10g}" for v in values.tolist()]


_MM, _MM_S, _PERCENT = "MILLIMETER", "MILLIMETER/SECOND", "PERCENT"
_MINUTELY: dict[str, Any] = {"native_units": "MILLIMETER/MINUTE", "factor": 60.0, "decimals": 3}
_TIMER: dict[str, Any] = {"native_units": "MINUTE", "factor": 1 / 60}


def _linear(axis: str) -> list[DataItem]:
    return [
        DataItem(f"{axis}pos", axis, "SAMPLE", "POSITION", "ACTUAL", _MM, decimals=4),
        DataItem(f"{axis}feed", axis, "SAMPLE", "AXIS_FEEDRATE", "ACTUAL", _MM_S, **_MINUTELY),
        DataItem(f"{axis}load", axis, "SAMPLE", "LOAD", "", _PERCENT),
        DataItem(f"{axis}travel", axis, "CONDITION", "POSITION"),
    ]


_ROTARY = [
    DataItem("Cang", "C", "SAMPLE", "ANGLE", "ACTUAL", "DEGREE", decimals=4),
    DataItem("Cvel", "C", "SAMPLE", "ANGULAR_VELOCITY", "", "DEGREE/SECOND",
             native_units="DEGREE/MINUTE", factor=60.0, decimals=4),
    DataItem("S1func", "C", "EVENT", "ROTARY_MODE"),
]  # fmt: skip

_SPINDLE = [
    DataItem("S1n", "C", "SAMPLE", "ROTARY_VELOCITY", "ACTUAL", "REVOLUTION/MINUTE"),
    DataItem("S1load", "C", "SAMPLE", "LOAD", "", _PERCENT),
    DataItem("S1temp", "C", "SAMPLE", "TEMPERATURE", "", "CELSIUS"),
    DataItem("spindle_c", "C", "CONDITION", "LOAD"),
    DataItem("S1temp_c", "C", "CONDITION", "TEMPERATURE"),
]

_PATH = [
    DataItem("prog", "path", "EVENT", "PROGRAM"),
    DataItem("exec", "path", "EVENT", "EXECUTION"),
    DataItem("opmode", "path", "EVENT", "CONTROLLER_MODE"),
    DataItem("ln", "path", "EVENT", "LINE_NUMBER", "INCREMENTAL"),
    DataItem("tool", "path", "EVENT", "TOOL_NUMBER"),
    DataItem("parts", "path", "EVENT", "PART_COUNT", "ALL"),
    DataItem("vpath", "path", "SAMPLE", "PATH_FEEDRATE", "ACTUAL", _MM_S, **_MINUTELY),
    DataItem("fovr", "path", "EVENT", "PATH_FEEDRATE_OVERRIDE", "PROGRAMMED", _PERCENT),
    DataItem("rovr", "path", "EVENT", "PATH_FEEDRATE_OVERRIDE", "RAPID", _PERCENT),
    DataItem("sovr", "path", "EVENT", "ROTARY_VELOCITY_OVERRIDE", "", _PERCENT),
    DataItem("t_auto", "path", "SAMPLE", "EQUIPMENT_TIMER", "WORKING", "SECOND", **_TIMER),
    DataItem("t_cut", "path", "SAMPLE", "EQUIPMENT_TIMER", "LOADED", "SECOND", **_TIMER),
    DataItem("t_total", "path", "SAMPLE", "EQUIPMENT_TIMER", "POWERED", "SECOND", **_TIMER),
    DataItem("motion_c", "path", "CONDITION", "MOTION_PROGRAM"),
]

_MACHINE = [
    DataItem("avail", "device", "EVENT", "AVAILABILITY", at_start=True),
    DataItem("estop", "controller", "EVENT", "EMERGENCY_STOP", at_start=True),
    DataItem("logic_c", "controller", "CONDITION", "LOGIC_PROGRAM", at_start=True),
    DataItem("system_c", "controller", "CONDITION", "SYSTEM", at_start=True),
    DataItem("coolant_c", "coolant", "CONDITION", "LEVEL", at_start=True),
    DataItem("lube_c", "lubrication", "CONDITION", "LEVEL", at_start=True),
    DataItem("pwr", "controller", "EVENT", "POWER_STATE"),
    DataItem("asset_chg", "device", "EVENT", "ASSET_CHANGED", supplied=False),
    DataItem("asset_rem", "device", "EVENT", "ASSET_REMOVED", supplied=False),
]


def data_items(c_axis: bool) -> list[DataItem]:
    """All data items of a machine in the order in which its adapter sends them."""
    linear = [item for axis in "XYZ" for item in _linear(axis)]
    return [*_MACHINE, *linear, *(_ROTARY if c_axis else []), *_SPINDLE, *_PATH]


def write_devices(path: Path, parameters: ShopParameters) -> None:
    """Write the device model of ``parameters.machine``."""
    ElementTree.register_namespace("", NAMESPACE)
    root = ElementTree.Element(_tag("MTConnectDevices"))
    ElementTree.SubElement(root, _tag("Header"), {
        "creationTime": f"{parameters.first_day}T00:00:00Z", "sender": "simulated-shop",
        "instanceId": "1", "version": "2.0.0.0", "bufferSize": "131072",
        "assetBufferSize": "1024", "assetCount": "0", "deviceModelChangeTime":
        f"{parameters.first_day}T00:00:00Z",
    })  # fmt: skip
    name = parameters.machine
    device = ElementTree.SubElement(
        ElementTree.SubElement(root, _tag("Devices")), _tag("Device"),
        {"id": name, "name": name, "uuid": f"simulated-{name}"},
    )  # fmt: skip
    description = {"manufacturer": "Simulated", "model": "motor spindle 15 kW"}
    ElementTree.SubElement(device, _tag("Description"), description).text = "simulated"
    _components(device, parameters)
    ElementTree.indent(root)
    with replacing(path) as part:
        ElementTree.ElementTree(root).write(part, encoding="utf-8", xml_declaration=True)


def _tag(name: str) -> str:
    return f"{{{NAMESPACE}}}{name}"


def _components(device: ElementTree.Element, parameters: ShopParameters) -> None:
    machine, items = parameters.machine, data_items(parameters.c_axis)
    _add_items(device, "device", machine, items)
    parts = ElementTree.SubElement(device, _tag("Components"))
    axes = ElementTree.SubElement(_child(parts, "Axes", machine, "axes"), _tag("Components"))
    for axis in "XYZ":
        _add_items(_child(axes, "Linear", machine, axis), axis, machine, items)
    _add_items(_child(axes, "Rotary", machine, "C"), "C", machine, items)
    controller = _child(parts, "Controller", machine, "controller")
    _add_items(controller, "controller", machine, items)
    paths = ElementTree.SubElement(controller, _tag("Components"))
    _add_items(_child(paths, "Path", machine, "path"), "path", machine, items)
    holder = _child(parts, "Systems", machine, "systems")
    systems = ElementTree.SubElement(holder, _tag("Components"))
    for element in ("Coolant", "Lubrication"):
        part = element.lower()
        _add_items(_child(systems, element, machine, part), part, machine, items)


def _child(
    parent: ElementTree.Element, element: str, machine: str, name: str
) -> ElementTree.Element:
    return ElementTree.SubElement(parent, _tag(element), {"id": f"{machine}-{name}", "name": name})


def _add_items(
    element: ElementTree.Element, component: str, machine: str, items: list[DataItem]
) -> None:
    holder = ElementTree.SubElement(element, _tag("DataItems"))
    for item in (i for i in items if i.component == component):
        attributes = {
            "category": item.category, "id": f"{machine}-{item.name}", "name": item.name,
            "type": item.type, "subType": item.sub_type, "units": item.units,
            "nativeUnits": item.native_units or item.units,
        }  # fmt: skip
        ElementTree.SubElement(holder, _tag("DataItem"), {k: v for k, v in attributes.items() if v})


STEP = 60
"""Step of the grid on which the temperature of the air is computed [s]."""
POSITIONS = {"X": (0.0, "x", 14.0, 0.10), "Y": (0.0, "y", 9.0, 0.10), "Z": (455.0, "z", 33.0, 0.12)}
"""Axis: reference position [mm], column, load at rest [%] (Z holds its weight), load by mm/s."""
TENTH = 6.0
"""A tenth of a minute, in which the control counts working and cutting time [s]."""
GRID = 10
"""Time between the kept temperatures of the network [s]."""
RESOLUTION = 0.1
"""Resolution of the logger [K]."""
OPEN = 1372.0
"""Reading of a type K channel whose junction opens for a moment [degC]."""
CHANNELS: dict[str, tuple[float, ...]] = {
    "Spindle front bearing": (0.85, 0.0, 0.12, 0.0, 0.0, 0.03),
    "Spindle rear bearing": (0.0, 0.85, 0.12, 0.0, 0.0, 0.03),
    "Motor housing": (0.0, 0.0, 0.93, 0.0, 0.0, 0.07),
    "Ambient": (0.0, 0.0, 0.01, 0.01, 0.0, 0.98),
    "Coolant": (0.0, 0.0, 0.0, 0.0, 0.98, 0.02),
    "Bed": (0.0, 0.0, 0.0, 0.97, 0.0, 0.03),
}
"""Shares of front bearing, rear bearing, housing, bed, coolant and air in each channel [1]."""


def ambient_temperature(parameters: ShopParameters) -> Floats:
    """Temperature of the air [degC] at each minute of all days, shape (days * 1440,)."""
    p, random = parameters.air, parameters.generator("air")
    minutes = np.arange(parameters.days * DAY // STEP)
    hour = minutes * STEP / 3600 % 24
    day = minutes * STEP // DAY
    heated = np.where((hour >= 4.5) & (hour < 17.5), p.working, p.setback)
    target = np.where(day % 7 < 5, heated, p.weekend)
    weather = np.cumsum(random.normal(0, 0.6, parameters.days)) * p.day_to_day / 1.5
    outside = p.daily_amplitude * np.cos(2 * np.pi * (hour - 15) / 24)
    share = 1 - np.exp(-STEP / (3600 * p.building_lag))
    building = lagged(target, share, p.weekend)
    wander = lagged(random.normal(0, 1, minutes.size), 1 / 45, 0.0) * 0.25 * np.sqrt(90)
    smooth_weather = np.interp(minutes / 1440, np.arange(parameters.days) + 0.5, weather)
    doors = _doors(p, day, hour, random)
    return np.asarray(building + outside + np.clip(smooth_weather, -4, 4) + wander - doors)


def _doors(p: AirParameters, day: Ints, hour: Floats, random: Random) -> Floats:
    """Cold [K] that doors let in: a drop that recovers exponentially."""
    working = (day % 7 < 5) & (hour >= 6) & (hour < 17)
    opened = random.random(day.size) < np.where(working, p.doors_a_day / (11 * 60), 0.0)
    share = 1 - np.exp(-1 / p.door_recovery)
    drops = opened * random.uniform(0.4, 1.6, day.size) * p.door_drop / share
    return np.asarray(lagged(drops, share, 0.0))


def air_of_day(ambient: Floats, day: int) -> Floats:
    """Temperature of the air of one day at each second [degC], shape (86400,)."""
    grid = np.arange(ambient.size) * STEP
    seconds = day * DAY + np.arange(DAY)
    return np.asarray(np.interp(seconds, grid, ambient))


@dataclass(kw_only=True)
class MachineState:
    """State of a machine that outlives a day."""

    parameters: ShopParameters
    random: Random
    state: Floats  # of the heat network
    sensor: float  # degC, the motor's temperature as its sensor has it
    counters: dict[str, float]
    generated: float = 0.0
    to_air: float = 0.0
    to_chiller: float = 0.0


@dataclass(kw_only=True)
class SensedDay:
    """Readings of one day: numbers and words by data item, temperatures of all nodes."""

    timeline: Timeline
    numbers: dict[str, Floats | Ints] = field(default_factory=dict)
    words: dict[str, tuple[Ints, list[str]]] = field(default_factory=dict)
    temperatures: Floats = field(default_factory=lambda: np.empty((0, 10)))
    ambient: Floats = field(default_factory=lambda: np.empty(0))


def new_machine(parameters: ShopParameters, ambient: float) -> MachineState:
    """A machine that stood over the weekend in air of ``ambient`` [degC]."""
    random = parameters.generator("machine")
    total = float(random.integers(2_000_000, 60_000_000))
    return MachineState(
        parameters=parameters, random=random, state=state_at_rest(ambient), sensor=ambient,
        counters={"t_total": total, "t_auto": 0.31 * total, "t_cut": 0.17 * total},
    )  # fmt: skip


def sensed_day(machine: MachineState, timeline: Timeline, ambient: Floats) -> SensedDay:
    """Run the physics of one day in air of ``ambient`` (86400,) [degC] and read all sensors."""
    p, random = machine.parameters.spindle, machine.random
    speed = slewed(timeline.speed_command, p.motor.acceleration)
    process = lagged(random.normal(0, 1, DAY), 0.25, 0.0) * 0.13 * np.sqrt(7)
    cut = timeline.cut_power * np.clip(1 + process, 0.2, 2.2)
    cut *= (speed > 0.5 * timeline.speed_command) & (speed > 1)
    inputs = Inputs(
        speed, cut, timeline.hold, timeline.power, timeline.coolant, timeline.feed > 0, ambient
    )
    hot = heat(machine.state, inputs, p)
    machine.state = hot.state
    machine.generated += hot.generated
    machine.to_air += hot.to_air
    machine.to_chiller += hot.to_chiller
    day = SensedDay(timeline=timeline, temperatures=hot.temperatures, ambient=ambient)
    motor = lagged(hot.temperatures[:, 0], 1 / max(p.sensor_lag, 1.0), machine.sensor)
    machine.sensor = float(motor[-1])
    # the control rounds down; a slow wander of the reading makes whole degrees flicker
    flicker = lagged(random.normal(0, 1, DAY), 0.1, 0.0) * p.sensor_noise * np.sqrt(19)
    day.numbers["S1temp"] = np.floor(motor + flicker)
    _spindle(day, machine, speed, hot.torque, cut)
    _axes(day, machine, cut)
    _controller(day, machine)
    return day


def _spindle(
    day: SensedDay, machine: MachineState, speed: Floats, torque: Floats, cut: Floats
) -> None:
    motor = machine.parameters.spindle.motor
    omega = speed * np.pi / 30
    rated_torque = motor.rated_power / (motor.base_speed * np.pi / 30)
    load = np.maximum(np.abs(torque) / rated_torque, np.abs(torque) * omega / motor.rated_power)
    load[day.timeline.hold & (speed < 1)] = 0.0  # the load meter does not show a held spindle
    day.numbers["S1load"] = np.round(100 * np.minimum(load, 2.0))
    droop = 0.0008 * load * (cut > 0)  # the speed loop lags behind the cut
    day.numbers["S1n"] = np.round(speed * (1 - droop))
    if machine.parameters.c_axis:
        hold = day.timeline.hold
        angle = np.where(hold, carried(day.timeline.c, 0.0), 0.0)  # 0 while it is a spindle
        contour = hold & (day.timeline.feed > 0)
        step = (np.diff(angle, prepend=angle[0]) + 180) % 360 - 180
        day.numbers["Cang"] = angle
        day.numbers["Cvel"] = np.where(contour, np.abs(step), 0.0)
        mode = np.where(contour, 2, np.where(hold, 1, 0))
        day.words["S1func"] = (mode, ["SPINDLE", "INDEX", "CONTOUR"])


def _axes(day: SensedDay, machine: MachineState, cut: Floats) -> None:
    timeline, random = day.timeline, machine.random
    engaged = lagged(cut / machine.parameters.spindle.motor.rated_power, 0.05, 0.0)
    for axis, (reference, column, rest, friction) in POSITIONS.items():
        position = carried(getattr(timeline, column), reference)
        velocity = np.abs(np.diff(position, prepend=position[0]))
        moving = velocity > 0
        # the control shows a filtered load; at rest it hardly moves
        noise = lagged(random.normal(0, 1, DAY), 0.02, 0.0) * np.where(moving, 8.0, 2.5)
        load = rest + friction * np.minimum(velocity, 300) + 22 * engaged + noise
        day.numbers[f"{axis}pos"] = position
        day.numbers[f"{axis}feed"] = velocity
        day.numbers[f"{axis}load"] = np.round(np.maximum(load, 0) * timeline.power)


def _controller(day: SensedDay, machine: MachineState) -> None:
    t = day.timeline
    day.words["avail"] = (np.zeros(DAY, int), ["AVAILABLE"])
    day.words["estop"] = (t.emergency.astype(int), ["ARMED", "TRIGGERED"])
    day.words["pwr"] = (np.zeros(DAY, int), ["ON"])
    day.words["prog"] = (t.program, t.program_names)
    day.words["exec"] = (t.execution, list(Execution.__members__))
    day.words["opmode"] = (t.mode, list(Mode.__members__))
    feed = t.feed * (t.execution == Execution.ACTIVE)
    day.numbers |= {
        "ln": t.line, "tool": t.tool, "parts": t.part_count, "vpath": feed,
        "fovr": t.feed_override, "rovr": t.rapid_override, "sovr": t.spindle_override,
    }  # fmt: skip
    automatic = (t.mode == Mode.AUTOMATIC) & (t.execution != Execution.READY) & t.power
    timers = (("t_total", t.power, 1.0), ("t_auto", automatic, TENTH), ("t_cut", t.cutting, TENTH))
    for name, counts, step in timers:
        total = machine.counters[name] + np.cumsum(counts)
        day.numbers[name] = np.floor(total / step) * step
        machine.counters[name] = float(total[-1])


def tip_temperatures(day: SensedDay) -> Floats:
    """Temperatures of the tips of the thermocouples over a day, each 10 s, (T, 6) [degC]."""
    nodes = day.temperatures[::GRID][:, [FRONT, REAR, HOUSING, BED, COOLANT]]
    sources = np.column_stack([nodes, day.ambient[::GRID]])
    return sources @ np.array(list(CHANNELS.values())).T


def write_thermocouples(folder: Path, tips: Floats, parameters: ShopParameters) -> dict[str, Any]:
    """Write one file for each day of the logger's clock; the truth about its faults and clock."""
    p, random = parameters.logger, parameters.generator("logger")
    shown = np.arange(0, parameters.days * DAY, p.interval, dtype=float)  # of the logger's clock
    zone = 3600.0 * p.zone_hours
    true = (shown - zone - p.clock_offset) / (1 + p.clock_drift / DAY)
    inside = (true >= 0) & (true <= (tips.shape[0] - 1) * GRID)
    shown, true = shown[inside], true[inside]
    grid = np.arange(tips.shape[0]) * GRID
    offsets = random.normal(0, p.offset, tips.shape[1])
    read = np.column_stack([np.interp(true, grid, tip) for tip in tips.T])
    read += offsets + random.normal(0, p.noise, read.shape)
    read = np.round(read / RESOLUTION) * RESOLUTION
    dropouts, spikes = _faults(read, true, parameters, random)
    for day in range(parameters.days):
        rows = (shown >= day * DAY) & (shown < (day + 1) * DAY)
        name = f"{stamp(parameters.start, day * DAY)[:10]}.csv"
        write_text(folder / name, _text(shown[rows], read[rows], parameters), p.encoding)
    return {
        "channels": list(CHANNELS), "rows": int(shown.size), "dropouts": dropouts,
        "blank_cells": int(np.isnan(read).sum()), "spikes": spikes,
        "clock": {"offset_s": p.clock_offset, "drift_s_per_day": p.clock_drift,
                  "zone_hours": p.zone_hours, "shown": "UTC * (1 + drift/86400) + offset + zone"},
        "channel_offsets_K": dict(zip(CHANNELS, np.round(offsets, 4).tolist(), strict=True)),
    }  # fmt: skip


def _faults(
    read: Floats, true: Floats, parameters: ShopParameters, random: Random
) -> tuple[list[dict[str, object]], list[dict[str, object]]]:
    """Blank stretches of a channel and put spikes into ``read`` (T, 6); the faults, in UTC."""
    p, names, start = parameters.logger, list(CHANNELS), parameters.start
    dropouts: list[dict[str, object]] = []
    for a in np.sort(random.integers(0, true.size, p.dropouts)):
        channel = int(random.integers(len(names)))
        b = min(a + int(random.uniform(600, 4 * 3600) / p.interval), true.size) - 1
        read[a : b + 1, channel] = np.nan
        dropouts.append({"channel": names[channel], "start": stamp(start, true[a]),
                         "end": stamp(start, true[b])})  # fmt: skip
    spikes: list[dict[str, object]] = []
    for a in np.unique(random.integers(0, true.size, p.spikes)):
        channel = int(random.integers(len(names)))
        if not np.isnan(read[a, channel]):
            read[a, channel] = OPEN
            spikes.append({"channel": names[channel], "time": stamp(start, true[a]), "value": OPEN})
    return dropouts, spikes


def _text(shown: Floats, read: Floats, parameters: ShopParameters) -> str:
    """One file: a block about the logger, names, units, rows; an empty cell for no value."""
    p = parameters.logger
    comma = p.decimal == ","
    separator, unit = (";", "°C") if p.encoding == "cp1252" or comma else (",", "degC")
    moments = parameters.start + np.round(shown).astype("timedelta64[s]")
    first = str(moments[0]).replace("T", " ")
    head = [
        "Thermocouple logger TL-8 (simulated)",
        f"Machine{separator}{parameters.machine}",
        f"Serial number{separator}TL8-{parameters.seed:05d}",
        f"Start{separator}{first}",
        f"Interval{separator}{p.interval} s",
        "",
        separator.join(["Time", *CHANNELS]),
        separator.join(["", *[unit] * len(CHANNELS)]),
    ]
    tenths = np.nan_to_num(np.round(read / RESOLUTION), nan=np.iinfo(np.int32).min).astype(int)
    words = {k: f"{k * RESOLUTION:.1f}".replace(".", p.decimal) for k in np.unique(tenths).tolist()}
    words[np.iinfo(np.int32).min] = ""
    times = [m.replace("T", " ") for m in np.datetime_as_string(moments, unit="s").tolist()]
    rows = [
        separator.join([time, *(words[k] for k in row)])
        for time, row in zip(times, tenths.tolist(), strict=True)
    ]
    return "\n".join([*head, *rows]) + "\n"
