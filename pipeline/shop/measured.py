"""From a timeline to what sensors and counters show in each second of the day."""

from dataclasses import dataclass, field

import numpy as np

from pipeline.shop.parameters import DAY, ShopParameters
from pipeline.shop.timeline import (
    ACTIVE,
    AUTOMATIC,
    EXECUTION,
    MODES,
    READY,
    Timeline,
    carried,
)

POSITIONS = {"X": (0.0, "x", 14.0, 0.10), "Y": (0.0, "y", 9.0, 0.10), "Z": (455.0, "z", 33.0, 0.12)}
"""Axis: reference position [mm], column, load at rest [%] (Z holds its weight), load by mm/s."""

TENTH = 6.0  # s: the control counts these hours in tenths of a minute


@dataclass(kw_only=True)
class Machine:
    """What a machine carries from one day to the next."""

    parameters: ShopParameters
    random: np.random.Generator
    state: np.ndarray  # of the heat network
    sensor: float  # degC, the motor's temperature as its sensor has it
    counters: dict[str, float]
    generated: float = 0.0
    to_air: float = 0.0
    to_chiller: float = 0.0


@dataclass(kw_only=True)
class Day:
    """What could be seen on one day: numbers and words by data item, temperatures of all nodes."""

    timeline: Timeline
    numbers: dict[str, np.ndarray] = field(default_factory=dict)
    words: dict[str, tuple[np.ndarray, list[str]]] = field(default_factory=dict)
    temperatures: np.ndarray = field(default_factory=lambda: np.empty((0, 10)))
    ambient: np.ndarray = field(default_factory=lambda: np.empty(0))


def new_machine(parameters: ShopParameters, ambient: float) -> Machine:
    """A machine that stood over the weekend in air of ``ambient`` [degC]."""
    from pipeline.shop.network import state_at_rest

    random = parameters.generator("machine")
    total = float(random.integers(2_000_000, 60_000_000))
    return Machine(
        parameters=parameters, random=random, state=state_at_rest(ambient), sensor=ambient,
        counters={"t_total": total, "t_auto": 0.31 * total, "t_cut": 0.17 * total},
    )  # fmt: skip


def lived(machine: Machine, timeline: Timeline, ambient: np.ndarray) -> Day:
    """Run the physics of one day in air of ``ambient`` (86400,) [degC] and read all sensors."""
    from pipeline.shop.filters import lagged, slewed
    from pipeline.shop.network import Inputs, heat

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
    day = Day(timeline=timeline, temperatures=hot.temperatures, ambient=ambient)
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
    day: Day, machine: Machine, speed: np.ndarray, torque: np.ndarray, cut: np.ndarray
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


def _axes(day: Day, machine: Machine, cut: np.ndarray) -> None:
    from pipeline.shop.filters import lagged

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


def _controller(day: Day, machine: Machine) -> None:
    t = day.timeline
    day.words["avail"] = (np.zeros(DAY, int), ["AVAILABLE"])
    day.words["estop"] = (t.emergency.astype(int), ["ARMED", "TRIGGERED"])
    day.words["pwr"] = (np.zeros(DAY, int), ["ON"])
    day.words["prog"] = (t.program, t.program_names)
    day.words["exec"] = (t.execution, list(EXECUTION))
    day.words["opmode"] = (t.mode, list(MODES))
    feed = t.feed * (t.execution == ACTIVE)
    day.numbers |= {
        "ln": t.line, "tool": t.tool, "parts": t.part_count, "vpath": feed,
        "fovr": t.feed_override, "rovr": t.rapid_override, "sovr": t.spindle_override,
    }  # fmt: skip
    automatic = (t.mode == AUTOMATIC) & (t.execution != READY) & t.power
    timers = (("t_total", t.power, 1.0), ("t_auto", automatic, TENTH), ("t_cut", t.cutting, TENTH))
    for name, counts, step in timers:
        total = machine.counters[name] + np.cumsum(counts)
        day.numbers[name] = np.floor(total / step) * step
        machine.counters[name] = float(total[-1])
