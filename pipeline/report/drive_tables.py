"""Tables of the drives: parameters, methods against each other, recordings, files."""

from pipeline.charts.numbers import NOT_KNOWN, number, real
from pipeline.charts.sources import Source, dig, objects_of, rows_of, words_of
from pipeline.charts.tables import MOST_ROWS, Cell, Table, cells, left_out, names, numbers, sources
from pipeline.report.control_tables import files_table, parameters_table
from pipeline.report.drive_units import in_shop_units
from pipeline.report.facts import Facts

MEANINGS = {
    "mass": "all that moves, the screw’s and the motor’s inertia as mass",
    "force_constant": "force for one unit of the command",
    "coulomb": "friction that speed does not change",
    "static": "friction at the start of motion",
    "stribeck_velocity": "speed over which starting friction gives way",
    "viscous": "friction that grows with speed",
    "load_factor": "what the recorded load is multiplied by",
    "offset": "force that is always there, such as gravity less counterbalance",
    "position_scale": "gain of the position loop over its nominal one",
    "velocity_scale": "gain of the velocity loop over its nominal one",
    "integral_scale": "gain of the velocity loop’s integral over its nominal one",
    "velocity_feedforward": "share of the commanded speed that is fed forward",
    "acceleration_feedforward": "command for the commanded acceleration",
    "position_lag": "time by which the position loop acts late",
    "velocity_lag": "time by which the velocity loop acts late",
    "backlash": "play between the screw and the carriage",
    "R": "resistance of a winding",
    "L_d": "inductance along the magnets’ flux",
    "L_q": "inductance across the magnets’ flux",
    "flux": "flux of the magnets through a winding",
    "dead_voltage": "voltage that the inverter keeps along the current",
}
"""What the parameters of a drive and its motor mean, for people."""


def meaning(name: str, axis: str = "") -> str:
    """What a parameter means, with the direction behind its name.

    >>> meaning("coulomb_negative", "X"), meaning("L_d"), meaning("other")
    ('friction that speed does not change, towards −X', 'inductance along the magnets’ flux', '–')
    """
    for ending, sign in (("_positive", "+"), ("_negative", "−")):
        if name.endswith(ending):
            words = MEANINGS.get(name.removesuffix(ending))
            return f"{words}, towards {sign}{axis}" if words else "–"
    return MEANINGS.get(name, "–")


def drive_sources(found: Facts) -> list[Source]:
    """The file that the parameters stand in."""
    return sources(found.shelf, found.folders.models / "drive.json")


def axis_parameters_table(found: Facts, axis: str) -> Table | None:
    """Parameters of one axis with their intervals, or what to record to have them."""
    parameters = objects_of(found.drives.axes[axis], "parameters")
    return parameters_table(
        f"Parameters of axis {axis}",
        {name: in_shop_units(p) for name, p in parameters.items()},
        lambda name: meaning(name, axis),
        drive_sources(found),
    )


def motor_table(found: Facts) -> Table | None:
    """Parameters of the motor whose currents and voltages were recorded."""
    motor = dig(found.drives.drive, "motor")
    parameters = objects_of(motor, "parameters")
    return parameters_table(
        f"Parameters of the motor of axis {dig(motor, 'axis') or NOT_KNOWN}",
        {name: in_shop_units(p) for name, p in parameters.items()},
        meaning,
        drive_sources(found),
    )


def drive_recordings_table(found: Facts) -> Table | None:
    """Which recordings the drives were found from, and why others were left out."""
    learnt = [
        cells(Cell(text=str(r.get("recording") or NOT_KNOWN), code=True), "learnt from",
              number(seconds) if (seconds := real(r.get("seconds"))) is not None else "–",
              "; ".join(words_of(r, "notes")) or "–")
        for r in found.drives.training
    ]  # fmt: skip
    rest = [
        cells(Cell(text=str(r.get("recording") or NOT_KNOWN), code=True), "left out", "–",
              str(r.get("reason") or "no reason is said"))
        for r in rows_of(found.drives.drive, "recordings", "left_out")
    ]  # fmt: skip
    rows = rest + learnt
    if not rows:
        return None
    return Table(
        caption=f"Recordings that the drives were found from ({number(len(learnt))}), and those "
        f"left out ({number(len(rest))}){left_out(len(rows), MOST_ROWS)}",
        heads=[*names("Recording", "use"), *numbers(("length", "s")),
               *names("what was done to it, or why not")],
        rows=rows[:MOST_ROWS],
        sources=drive_sources(found),
        folded=True,
    )  # fmt: skip


def drive_files_table(found: Facts) -> Table | None:
    """Files by hash that the drives were found from."""
    return files_table(found.drives.drive, "the drives were", drive_sources(found))
