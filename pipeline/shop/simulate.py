"""Simulation of the weeks of one machine: its records, and the truth about them."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.parallel import Compute, mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.si import DAY
from pipeline.shop import sensors
from pipeline.shop.agent_log import Log, Unobserved, write_day
from pipeline.shop.control.records import write_control
from pipeline.shop.cutting.records import write_cutting
from pipeline.shop.drives.feed_records import write_feed, write_shafts
from pipeline.shop.drives.records import write_drives
from pipeline.shop.files import write_text
from pipeline.shop.growth.records import write_growth
from pipeline.shop.parameters import ShopParameters, stamp
from pipeline.shop.schedule import Shop, working_day
from pipeline.shop.sensors import write_devices
from pipeline.shop.timeline import Cycle, Timeline
from pipeline.shop.trial.job import write_parts
from pipeline.shop.wear.records import write_wear


def simulate(
    out: Path, truth: Path, parameters: ShopParameters, compute: Compute = "serial"
) -> None:
    """Write the records of one machine of the simulated shop into ``out``, and ``truth`` (JSON).

    The truth has parameters, working days, cycles, and every fault with its exact time.  Raises
    ValueError when ``truth`` lies in ``out``, or a part program is unknown.
    """
    if truth.resolve().is_relative_to(out.resolve()):
        raise ValueError(f"the truth {truth} must not stand among the records in {out}")
    tasks = [(name, out, parameters) for name in KINDS]
    found = dict(zip(KINDS, mapped(_written, tasks, compute=compute), strict=True))
    document = {
        "simulated": True,
        "machine": parameters.machine,
        "parameters": asdict(parameters),
        **found.pop("work"),
        **found,
    }
    write_devices(out / "Devices.xml", parameters)
    write_parts(out, parameters)
    write_text(truth, json.dumps(document, indent=1, sort_keys=True) + "\n")


def _written(task: tuple[str, Path, ShopParameters]) -> Any:
    name, out, parameters = task
    return KINDS[name](out, parameters)


def write_work(out: Path, parameters: ShopParameters) -> dict[str, Any]:
    """Write ``agent/<day>.txt`` and ``thermocouples/<day>.csv``; truth of days, heat and faults."""
    ambient = sensors.ambient_temperature(parameters)
    shop = Shop(parameters=parameters, random=parameters.generator("schedule"))
    machine = sensors.new_machine(parameters, float(ambient[0]))
    log = Log(parameters=parameters, folder=out, random=parameters.generator("log"))
    tips: list[Floats] = []
    cycles: list[Cycle] = []
    days: list[dict[str, str]] = []
    for number in range(parameters.days):
        timeline = working_day(shop, number)
        day = sensors.sensed_day(machine, timeline, sensors.air_of_day(ambient, number))
        write_day(log, day)
        tips.append(sensors.tip_temperatures(day))
        cycles += _since_first_midnight(timeline)
        days.append(_hours(timeline, parameters.start))
    return {
        "days": days,
        "cycles": [_cycle(c, parameters.start, log.truth.unobserved) for c in cycles],
        "heat": {
            "generated_J": round(machine.generated),
            "to_air_J": round(machine.to_air),
            "to_chiller_J": round(machine.to_chiller),
        },
        "thermocouples": sensors.write_thermocouples(
            out / "thermocouples", np.concatenate(tips), parameters
        ),
        "log": log.truth.document(),
    }


KINDS: dict[str, Callable[[Path, ShopParameters], Any]] = {
    "work": write_work,
    "wear": write_wear,
    "feed": write_feed,
    "growth": write_growth,
    "cutting": write_cutting,
    "drives": write_drives,
    "shafts": write_shafts,
    "control": write_control,
}
"""Kinds of records; what takes longest is among the first, so that processes end together."""


def _since_first_midnight(timeline: Timeline) -> list[Cycle]:
    """Cycles of a day, with seconds that count from the first midnight from here on."""
    for cycle in timeline.cycles:
        cycle.start += timeline.day * DAY
        cycle.end += timeline.day * DAY
    return timeline.cycles


def _hours(timeline: Timeline, start: np.datetime64) -> dict[str, str]:
    midnight = timeline.day * DAY
    row = {"date": stamp(start, midnight)[:10]}
    if timeline.on < DAY:
        row["on"] = stamp(start, midnight + timeline.on)
        row["off"] = stamp(start, midnight + timeline.off)
    return row


def _cycle(cycle: Cycle, start: np.datetime64, unobserved: list[Unobserved]) -> dict[str, Any]:
    """A cycle as written; ``start_seen`` and ``end_seen`` say whether the log can show them."""
    row = asdict(cycle)
    row["start"], row["end"] = stamp(start, cycle.start), stamp(start, cycle.end)
    for edge in ("start", "end"):
        row[f"{edge}_seen"] = not any(u.start <= row[edge] <= u.end for u in unobserved)
    return row
