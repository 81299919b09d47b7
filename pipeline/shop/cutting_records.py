"""A Sunday afternoon of cutting tests: dynamometer, spindle without a cut, passes of a program."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.shop.cutting_program import cutting_program, warm_up
from pipeline.shop.cutting_run import Run, pass_powers, pass_truth, run
from pipeline.shop.cutting_truth import dynamometer_truth
from pipeline.shop.dynamometer_records import write_dynamometer
from pipeline.shop.ledger import stamp
from pipeline.shop.part_programs import part_programs
from pipeline.shop.post import PartProgram, Tool
from pipeline.shop.spindle_load import no_load_power

if TYPE_CHECKING:
    from pipeline.shop.parameters import ShopParameters

OPENING = 14.0 * 3600
"""When the spindle's tests begin, on the Sunday before the first week [s of the day]."""
PAUSE = 900.0
"""Between them [s]."""


@dataclass(frozen=True, kw_only=True)
class Session:
    """A run of a program that is to be written."""

    program: PartProgram
    name: str
    done: Run


def write_cutting(folder: Path, parameters: "ShopParameters") -> dict[str, Any]:
    """Write ``dynamometer/*.csv`` and ``cutting/*`` into ``folder``, when cuts are recorded.

    Returns
    -------
    dict
        ``parameters``: what a linear-edge model should find; ``spindle``: the same of power
        without a cut and specific force, with the passes; ``more``: what such a model leaves out,
        how both are defined, and what is true of each file.  Nothing when cuts are not recorded.

    Raises
    ------
    ValueError
        When the machine has no tool of the number that the tests ask for.
    """
    cutting = parameters.cutting
    if not cutting.recorded:
        return {}
    recorded = write_dynamometer(folder, parameters)
    found = dynamometer_truth(cutting, recorded)
    spindle = _write_spindle(folder, parameters, recorded.cut)
    return {**found, "spindle": spindle}


def _write_spindle(folder: Path, parameters: "ShopParameters", cut: float) -> dict[str, Any]:
    cutting, spindle = parameters.cutting, parameters.spindle
    tool = _tool(parameters)
    program, passes = cutting_program(cutting, tool, parameters.control)
    powers = pass_powers(passes, cutting, cut)
    idle = warm_up(cutting, tool, parameters.control)
    begin = parameters.start.astype("datetime64[ms]") - np.timedelta64(86400 - round(OPENING), "s")
    later = begin + np.timedelta64(round(PAUSE), "s")
    files = []
    for name, what, its, start in (
        ("no-load", idle, [], begin),
        (program.name, program, list(zip(passes, powers, strict=True)), later),
    ):
        done = run(what, its, start, parameters, parameters.generator(f"cutting run {name}"))
        files.append(_written(folder, Session(program=what, name=name, done=done), start))
    rows = [pass_truth(one, power) for one, power in zip(passes, powers, strict=True)]
    speeds = np.array(cutting.spindle.speeds)
    power = no_load_power(speeds, spindle, cutting.spindle.oil_temperature)
    removed = [r["removal_rate_mm3_s"] for r in rows]
    return {
        "no_load_W": np.stack([speeds, power], axis=1).tolist(),
        "specific_force": sum(r["power_W"] for r in rows) / sum(removed) * 1e3,
        "rated_power_W": spindle.motor.rated_power,
        "base_speed_rpm": spindle.motor.base_speed,
        "efficiency": cutting.spindle.efficiency,
        "passes": rows,
        "files": files,
    }


def _tool(parameters: "ShopParameters") -> Tool:
    """The end mill as the control's tool table has it."""
    asked = parameters.cutting.tool
    programs, _ = part_programs(parameters.control, parameters.generator("part programs"))
    for tool in (t for p in programs for t in p.tools):
        if tool.number == asked.number and tool.diameter == asked.diameter:
            return tool
    raise ValueError(
        f"EndMill.number = {asked.number}: the control has no tool of that number with a diameter "
        f"of {asked.diameter} [mm]"
    )


def _written(folder: Path, session: Session, start: np.datetime64) -> dict[str, Any]:
    """Write program and log; what is true of the log."""
    program, log = f"cutting/{session.name}.nc", f"cutting/{session.name}-run1.txt"
    said = "\n".join(session.done.lines) + "\n"
    for name, text in ((program, session.program.text), (log, said)):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="ascii", newline="\n")
    return {
        "file": log, "program": program, "start": stamp(start, 0.0),
        "lines": len(session.done.lines), "greatest_load_percent": float(session.done.load.max()),
    }  # fmt: skip
