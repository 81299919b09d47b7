"""Live through the weeks of one machine and write its records and the truth."""

from pathlib import Path

import numpy as np

from pipeline.shop.agent_log import Log, write_day
from pipeline.shop.air import ambient_temperature, of_day
from pipeline.shop.control_records import write_control
from pipeline.shop.cutting_records import write_cutting
from pipeline.shop.devices import write_devices
from pipeline.shop.drive_records import write_drives
from pipeline.shop.ledger import Ledger, stamp, write_truth
from pipeline.shop.measured import lived, new_machine
from pipeline.shop.parameters import DAY, ShopParameters
from pipeline.shop.schedule import Shop, working_day
from pipeline.shop.thermocouples import Recorder, write_thermocouples
from pipeline.shop.timeline import Timeline
from pipeline.shop.trial_parts import write_parts


def simulate(out: Path, truth: Path, parameters: ShopParameters) -> None:
    """Write what one machine of the simulated shop records, and the truth about it.

    Parameters
    ----------
    out : Path
        Folder of the machine's raw records: ``Devices.xml``, ``agent/<day>.txt``,
        ``thermocouples/<day>.csv``, ``programs/<name>.nc``, ``control/<run>.txt``,
        ``servo/<trace>.csv``, ``motor/<trace>.csv``, ``dynamometer/<test>.csv``,
        ``cutting/<program>.nc``, ``cutting/<run>.txt``, ``parts/<name>.nc``.  Made if it is
        missing; files of the same names are replaced.
    truth : Path
        File for the truth (JSON), outside ``out``.
    parameters : ShopParameters
        The machine, the weeks and the dirt.

    Raises
    ------
    ValueError
        When ``truth`` lies in ``out``, or a part program is unknown.
    """
    if truth.resolve().is_relative_to(out.resolve()):
        raise ValueError(f"the truth {truth} must not stand among the records in {out}")
    ledger = Ledger()
    ambient = ambient_temperature(parameters)
    shop = Shop(parameters=parameters, random=parameters.generator("schedule"))
    machine = new_machine(parameters, float(ambient[0]))
    log = Log(parameters=parameters, folder=out, ledger=ledger, random=parameters.generator("log"))
    recorder = Recorder(felt=[])
    for number in range(parameters.days):
        timeline = working_day(shop, number)
        day = lived(machine, timeline, of_day(ambient, number))
        write_day(log, day)
        recorder.keep(day.temperatures, day.ambient)
        _enter(ledger, timeline, parameters)
    write_thermocouples(out / "thermocouples", np.concatenate(recorder.felt), parameters, ledger)
    write_devices(out / "Devices.xml", parameters)
    ledger.control = write_control(out, parameters)
    ledger.drives = write_drives(out, parameters)
    ledger.cutting = write_cutting(out, parameters)
    write_parts(out, parameters)
    ledger.heat = {
        "generated_J": round(machine.generated), "to_air_J": round(machine.to_air),
        "to_chiller_J": round(machine.to_chiller),
    }  # fmt: skip
    write_truth(truth, parameters, ledger)


def _enter(ledger: Ledger, timeline: Timeline, parameters: ShopParameters) -> None:
    """Enter the day and its cycles; their seconds count from the first midnight from here on."""
    midnight, start = timeline.day * DAY, parameters.start
    for cycle in timeline.cycles:
        cycle.start += midnight
        cycle.end += midnight
    ledger.cycles += timeline.cycles
    row = {"date": stamp(start, midnight)[:10]}
    if timeline.on < DAY:
        row["on"] = stamp(start, midnight + timeline.on)
        row["off"] = stamp(start, midnight + timeline.off)
    ledger.days.append(row)
