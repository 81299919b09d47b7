"""Parameters of the feed drives on their page: shop units, meanings, truth of simulated machines.

Files are in SI, people speak of mm/s and micrometres: parameters are converted here.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pipeline.charts.default_section import parameters_table
from pipeline.charts.numbers import (
    NARROW,
    between,
    counted,
    number,
    percent,
    powers,
    real,
    relative,
    resolved,
    signed,
)
from pipeline.charts.sources import Source, stated
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.schema.drive import MOTOR, DriveAxis, DriveModel
from pipeline.schema.model import Parameter
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.mechanics.inverse_dynamics import DIRECTIONS

SHOP = {
    "m/s": ("mm/s", 1e3), "m": ("µm", 1e6), "H": ("mH", 1e3), "s": ("ms", 1e3), "ohm": ("Ω", 1.0),
    "1": ("", 1.0),
}  # fmt: skip
"""SI unit in a file -> unit as shown, factor."""
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
    "loop_gain": "Kv: speed over following error at constant speed, with what is fed forward",
    "velocity_feedforward": "share of the commanded speed that is fed forward",
    "acceleration_feedforward": "command for the commanded acceleration",
    "presliding_stiffness": "stiffness of friction before it slides",
    "presliding_time": "time in which friction lets go of a standing axis",
    "position_lag": "time by which the position loop acts late",
    "velocity_lag": "time by which the velocity loop acts late",
    "backlash": "play between the screw and the carriage",
    "shaft_stiffness": "stiffness between the motor and the carriage",
    "shaft_damping": "damping between the motor and the carriage",
    "motor_mass": "the motor’s side of what moves: rotor, coupling and screw as mass",
    "torque_constant": "torque for one ampere (amplitude of a phase)",
    "R": "resistance of a winding",
    "L_d": "inductance along the magnets’ flux",
    "L_q": "inductance across the magnets’ flux",
    "flux": "flux of the magnets through a winding",
    "dead_voltage": "voltage that the inverter keeps along the current",
}
"""Parameters of a drive and its motor as people call them."""
MOST_OPEN = 20
"""Greatest number of rows of a table that is not folded [1]."""
TRUTH_NOTE = (
    "Motion shows only sums of friction and of the force that is always there: where the fit takes "
    "friction as alike both ways, or that force as none, the truth is parted the same way."
)


def made_from(shown: Shown[DriveModel], *files: str) -> list[Source]:
    """Files of the sub-model that a part of the page stands on."""
    if shown.shelf is None:
        return []
    return sources(shown.shelf, *(shown.folder / file for file in files))


def identified_axes(shown: Shown[DriveModel]) -> dict[str, DriveAxis]:
    """Identified axes by letter."""
    return {} if shown.model is None else dict(sorted(shown.model.axes.items()))


def axis_parameters_table(
    shown: Shown[DriveModel], group: str, whose: str, axis: str = ""
) -> Table | None:
    """Parameters of an axis or the motor with their intervals, or what to record to have them."""
    return parameters_table(
        f"Parameters of {whose}",
        {name: in_shop_units(p) for name, p in shown.parameters(group).items()},
        made_from(shown, "model.json"),
        lambda name: meaning(name, axis),
    )


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


def in_shop_units(p: Parameter) -> Parameter:
    """A parameter with value, interval and unit as a shop speaks them.

    >>> p = Parameter(value=0.004, unit="m/s", interval_95=(0.003, 0.005), determined=True,
    ...               method="a fit")
    >>> in_shop_units(p).value, in_shop_units(p).interval_95, in_shop_units(p).unit
    (4.0, (3.0, 5.0), 'mm/s')
    """
    unit, factor = SHOP.get(p.unit, (p.unit, 1.0))
    ends = p.interval_95
    return replace(
        p, unit=unit, value=None if p.value is None else p.value * factor,
        interval_95=None if ends is None else (ends[0] * factor, ends[1] * factor),
    )  # fmt: skip


HOLDS, MISSES = "holds the truth", "misses the truth"


def truth_table(shown: Shown[DriveModel]) -> Table | None:
    """True value, value found, and whether its 95 % interval holds the truth, by axis."""
    truth = stated(shown.truth, "drives")
    parts = [
        (axis, _values(stated(truth, "axes", axis)), shown.parameters(axis))
        for axis in identified_axes(shown)
    ]
    parts.append((MOTOR, _values(stated(truth, MOTOR)), shown.parameters(MOTOR)))
    split = [(part, truth_as_fitted(true, found), found) for part, true, found in parts]
    parted = any(a != b for (_, a, _), (_, b, _) in zip(parts, split, strict=True))
    rows = [
        (_inside(value, p), _truth_row(part, name, value, p))
        for part, true, parameters in split
        for name, value in true.items()
        if (p := parameters.get(name)) is not None
    ]
    if not rows:
        return None
    known = [inside for inside, _ in rows if inside is not None]
    return Table(
        caption=f"Drives: simulated against identified; {sum(known)} of "
        f"{number(len(known))} intervals hold the truth{left_out(len(rows), MOST_ROWS)}",
        note=TRUTH_NOTE if parted else "",
        heads=[*names("Parameter"),
               *numbers(("true", ""), ("identified", ""), ("off by", "%"), ("95 % interval", "")),
               *names("unit", "interval")],
        rows=[row for _, row in rows[:MOST_ROWS]],
        sources=made_from(shown, "model.json"),
        folded=len(rows) > MOST_OPEN,
    )  # fmt: skip


def truth_words(table: Table) -> str:
    """How many of a truth table's intervals hold the truth, and which miss it."""
    words = [[cell.text for cell in row] for row in table.rows]
    missed = [row[0] for row in words if row[-1] == MISSES]
    total = len(missed) + sum(row[-1] == HOLDS for row in words)
    if not missed:
        return ""
    return (
        f"Of {counted(total, 'interval')} of 95{NARROW}% of the drives’ parameters "
        f"{total - len(missed)} hold the simulated truth ({percent(total - len(missed), total)}); "
        f"{', '.join(missed)} miss{'es' if len(missed) == 1 else ''} it. Where fewer than 95"
        f"{NARROW}% hold it, the intervals are narrower than they say."
    )


def _values(truth: Any) -> dict[str, float]:
    """True values by name, as numbers or as objects with a ``value``."""
    found = truth if isinstance(truth, dict) else {}
    plain = {name: v.get("value") if isinstance(v, dict) else v for name, v in found.items()}
    return {str(name): x for name, v in plain.items() if (x := real(v)) is not None}


def truth_as_fitted(
    truth: dict[str, float], parameters: Mapping[str, Parameter]
) -> dict[str, float]:
    """The truth, with friction and constant force split as the fit splits them.

    Motion shows the sums F_c+ + F_0 and F_c- - F_0 alone.  A fit that takes friction as equal in
    both directions, or F_0 as none, moves a part of F_0 into friction, and so must the truth.

    Parameters
    ----------
    truth : dict of str to float
        True values by name, in SI.
    parameters : mapping of str to Parameter
        As identified, by name.
    """
    both = [truth.get(f"coulomb_{direction}") for direction in DIRECTIONS]
    if both[0] is None or both[1] is None:
        return truth
    seen = [
        None if (p := parameters.get(f"coulomb_{direction}")) is None else p.value
        for direction in DIRECTIONS
    ]
    force = truth.get("offset", 0.0)
    offset = parameters.get("offset")
    if seen[0] is not None and seen[0] == seen[1]:
        moved = (both[0] - both[1]) / 2
    elif offset is None or not offset.determined:
        moved = -force
    else:
        return truth
    changed = {"offset": force + moved}
    for direction, sign in (("positive", -1.0), ("negative", 1.0)):
        changed |= {
            name: truth[name] + sign * moved
            for name in (f"coulomb_{direction}", f"static_{direction}") if name in truth
        }  # fmt: skip
    return {**truth, **changed}


def _shown(true: float, p: Parameter) -> float:
    """A true value in the unit in which its parameter is shown."""
    return true * SHOP.get(p.unit, ("", 1.0))[1]


def _inside(true: float, p: Parameter) -> bool | None:
    """Whether the interval holds the truth; None where nothing was found."""
    ends = in_shop_units(p).interval_95
    if not p.determined or ends is None:
        return None
    return ends[0] <= _shown(true, p) <= ends[1]


def _truth_row(part: str, name: str, true: float, p: Parameter) -> list[Cell]:
    shown, inside = in_shop_units(p), _inside(true, p)
    true_shown = _shown(true, p)
    low, high = shown.interval_95 or (None, None)
    digits = resolved(low, high)
    value = shown.value if p.determined else None
    verdict = {
        True: Cell(text=HOLDS, status="passed"),
        False: Cell(text=MISSES, status="failed"),
        None: Cell(text="–"),
    }[inside]
    return cells(
        Cell(text=f"{part} {name}", code=True),
        number(true_shown, digits),
        "not determined" if value is None else number(value, digits),
        relative(
            100 * (value / true_shown - 1) if value is not None and true_shown else None,
            lambda share: signed(share, 2),
        ),
        "–" if inside is None else between(low, high),
        powers(shown.unit) or "–",
        verdict,
    )
