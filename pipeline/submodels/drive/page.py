"""Page of the feed drives: moving mass, friction and loops of each axis; the twin's motion."""

from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

from pipeline.charts.bands import Strip, readings
from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import number, powers, real
from pipeline.charts.parameters import KnownValue, fit_words, in_units
from pipeline.charts.sections import Block, Heading, present
from pipeline.charts.sources import stated
from pipeline.charts.submodel_page import Counting, PageContent, made_from
from pipeline.charts.tables import Column, Table, code, tabulated
from pipeline.schema.drive import (
    COMMAND,
    FOLLOWING,
    FORCE,
    LAG,
    LEVEL,
    MOTOR,
    RIGID,
    SPEED,
    DriveAxis,
    DriveModel,
    SpeedLoops,
    TrainingRecording,
)
from pipeline.schema.model import Parameter
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.figures import axis_figures, loops_figure
from pipeline.submodels.drive.inverse_dynamics import DIRECTIONS
from pipeline.submodels.drive.speed_loops import PAPER, verdict_words

SHOP = {
    "m/s": ("mm/s", 1e3), "m": ("µm", 1e6), "H": ("mH", 1e3), "s": ("ms", 1e3), "ohm": ("Ω", 1.0),
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
METHODS = {"least_squares": "least squares", "genetic": "genetic search"}
"""Methods of identification in words."""


def content(shown: Shown[DriveModel]) -> PageContent:
    """Page content of the feed drives."""
    model = shown.model
    figures: list[Block | None] = []
    if model is not None:
        figures = [*_speed_loops(shown, model.speed_loops), _recordings(shown, model)]
    return PageContent(
        about="What an axis does with a command is set by what it moves, by friction in guideways "
        "and screw, and by the gains of its loops. Whether friction is growing cannot be said "
        "from one set of records: repeat the same reciprocation in a few weeks, and the list of "
        "changes says what moved.",
        rules="The force is rebuilt from the recorded motion; the following error comes from the "
        "twin’s own closed loop under the recorded reference alone, and a recorded disturbance "
        "where the record shows it to enter. Intervals are for motion like that of the training "
        "records: another mass on the table, or faster reversals, may lie outside.",
        case="recording",
        counts=(
            Counting(key="drive_force_percent", name="Error of the axes’ force", quantity=FORCE,
                     error="relative_percent"),
            Counting(key="drive_following_percent", name="Error of the following error",
                     quantity=FOLLOWING, error="relative_percent"),
        ),
        judged_count=("drives_judged", "Axes judged in recordings"),
        titles={LEVEL: "one constant level against motion", LAG: "speed over loop gain",
                RIGID: "no twist"},
        todo={
            "passed": "The twin’s axes move as the machine’s do.",
            "failed": "Do not plan with the axes that are named. Where an axis was serviced after "
            "its training records, record its reciprocation again; else the table of scores says "
            "which motion the twin gets wrong.",
            "unknown": "Keep one recording of each axis out of roles.training, to judge by.",
        },
        cause=_causes(shown),
        meaning=meaning,
        units=SHOP,
        groups={} if model is None else {axis: f"axis {axis}" for axis in model.parameters
                                         if axis != MOTOR} | {MOTOR: "the motor"},
        of_group={} if model is None else {
            group: [*present(Heading(heading=words, text=said), drawn)]
            for group, words, said, drawn in _groups(shown, model)
        },
        figures=figures,
        tried=() if model is None else [
            Tried(task=f"{axis}, {one.task.replace('_', ' ')}", error=one.error,
                  label=METHODS.get(one.method, one.method), unit=powers(one.error_unit),
                  evaluations=one.evaluations, serves=one.chosen)
            for axis, found in model.axes.items() for one in found.methods
        ],
        tried_where="on the same records",
        drawn=_drawn(shown),
        shown_facts=("length", "mean force", "disturbance"),
        truth=list(_truth(shown)),
        truth_note="Motion shows only sums of friction and of the force that is always there: "
        "where the fit takes friction as alike both ways, or that force as none, the truth is "
        "parted the same way.",
    )  # fmt: skip


def meaning(axis: str, name: str) -> str:
    """Meaning of a parameter, with the direction behind its name.

    >>> meaning("X", "coulomb_negative"), meaning("motor", "L_d"), meaning("X", "other")
    ('friction that speed does not change, towards −X', 'inductance along the magnets’ flux', '–')
    """
    for ending, sign in (("_positive", "+"), ("_negative", "−")):
        if name.endswith(ending):
            words = MEANINGS.get(name.removesuffix(ending))
            return f"{words}, towards {sign}{axis}" if words else "–"
    return MEANINGS.get(name, "–")


# ---- axes


def _groups(
    shown: Shown[DriveModel], model: DriveModel
) -> Iterator[tuple[str, str, str, Block | None]]:
    """Group, heading, text and figures of each axis and of the motor."""
    made = made_from(shown, "model.json")
    for axis in model.parameters:
        if axis == MOTOR and model.motor is not None:
            words = fit_words("", model.motor.condition, model.motor.correlation)
            yield axis, f"Motor of axis {model.motor.axis}", words, None
        elif (one := model.axes.get(axis)) is not None:
            drawn = axis_figures(axis, one, shown.parameters(axis).get("mass"), made)
            said = " ".join(words for words in _axis_words(model, axis, one) if words)
            yield axis, f"Axis {axis}", said, drawn
        else:  # commanded and actual position gave the loop gain, and no more
            of_axis = f"axis {axis}: "
            why = next((one.reason for one in model.left_out if one.reason.startswith(of_axis)), "")
            said = f"Its mechanics stays unknown; {why.removeprefix(of_axis)}".rstrip("; .")
            yield axis, f"Axis {axis}", f"{said}.", None


def _axis_words(model: DriveModel, axis: str, one: DriveAxis) -> Iterator[str]:
    """Quality of the fit, determined loops and shaft of an axis."""
    yield _fitted("The residual of the fit is {error} % of the force", one.fit)
    if one.servo_reason:
        yield f"Its loops could not be found: {one.servo_reason.rstrip('.')}."
    elif one.servo_fit is not None:
        yield _fitted("Its loops’ gains leave {error} % of the command unexplained", one.servo_fit)
    if one.force_unit not in ("", "N"):
        yield (
            f"Nobody has said what force one {one.command_unit} makes, so forces are in "
            f"{powers(one.force_unit)}: give force_constant, or torque_constant and lead, in "
            "conf/machine/ for newtons and kilograms."
        )
    shaft = model.shafts.get(axis)
    if shaft is None:
        yield (
            "Stiffness and play of its shaft are not known: record motor position, a scale at the "
            "carriage and the current together, at 1 kHz or more."
        )
    else:
        yield (
            f"Motor and carriage differ by {number(shaft.twist_um, 2)} µm (RMS), of which the "
            f"shaft’s equation leaves {number(shaft.left_um, 2)} µm."
        )


def _fitted(words: str, fit: Any) -> str:
    if fit.relative_error_percent is None:
        return fit_words("", fit.condition, fit.correlation)
    over = f" over {number(fit.samples)} samples" if fit.samples else ""
    said = words.format(error=number(fit.relative_error_percent, 2)) + over
    return fit_words(said, fit.condition, fit.correlation)


RECORDED: tuple[Column[TrainingRecording], ...] = (
    Column("Recording", lambda one: code(one.recording)),
    Column("length", lambda one: number(one.seconds), "s"),
    Column("what was done to it", lambda one: "; ".join(one.notes) or "–"),
)


def _recordings(shown: Shown[DriveModel], model: DriveModel) -> Table | None:
    caption = f"Recordings that the drives were identified from ({len(model.recordings)})"
    return tabulated(caption, model.recordings, RECORDED, made_from(shown, "model.json"),
                     folded=True)  # fmt: skip


def _loop_words(row: tuple[str, str, list[float | None]], k: int) -> str:
    value = row[2][k]
    return "–" if value is None else number(value, 3)


LOOPS: tuple[Column[tuple[str, str, list[float | None]]], ...] = (
    Column("Gains", lambda row: row[0]), Column("speed loop", lambda row: row[1]),
    *(Column(head, partial(_loop_words, k=k), unit)
      for k, (head, unit) in enumerate((("within 2 %", "ms"), ("within 0.1 %", "ms"),
      ("overshoot", "%"), ("ripple of speed", "%"), ("following error", "µm")))),
)  # fmt: skip


def _speed_loops(shown: Shown[DriveModel], found: SpeedLoops | None) -> list[Block]:
    """Heading with the verdict, table and figure of the speed loops; nothing where none were."""
    if found is None:
        return []
    head = Heading(heading=f"PI against fuzzy PI on axis {found.axis}", text=verdict_words(found))
    if not found.loops:
        return [head]
    rows: list[tuple[str, str, list[float | None]]] = [
        (one.gains, one.kind, [one.reaching_ms, one.settling_ms, one.overshoot_percent,
                               one.ripple_percent, one.following_um]) for one in found.loops
    ]  # fmt: skip
    rows += [("published, on another axis", kind, [None, reached, None, error, None])
             for kind, error, reached in PAPER]  # fmt: skip
    made = made_from(shown, "model.json")
    table = tabulated(
        f"Speed loops on axis {found.axis} as identified: a step of 1000 rev/min with the switched "
        "inverter, a ramp of 100 mm at 1500 mm/min (simulated)", rows, LOOPS, made,
        note="Feed2025 says that its error of speed is reached after that time. Loops of the "
        "currents, dead time, cogging and play between screw and carriage are not of this axis: "
        "the ripple is the inverter’s and the loops’ alone.",
    )  # fmt: skip
    return present(head, table, loops_figure(found, made))


# ---- recordings against the twin


def _causes(shown: Shown[DriveModel]) -> str:
    """Cause of failed recordings: entry of a recorded disturbance."""
    if shown.verdict is None:
        return ""
    failed = {s.group for s in shown.verdict.scores if s.status == "failed"}
    said = {
        case.case: str(fact.value) for case in shown.verdict.cases if case.group in failed
        for name, fact in case.facts.items()
        if name.startswith("disturbance") and name.endswith(", cause")
    }  # fmt: skip
    return "".join(f" In {case} {words}." for case, words in said.items())


def _drawn(shown: Shown[DriveModel]) -> list[Drawn]:
    """The following error of each axis, else its force, over the speed and the command."""
    if shown.verdict is None or shown.model is None:
        return []
    found = []
    for axis, one in shown.model.axes.items():
        kind = FOLLOWING if shown.verdict.of(f"{FOLLOWING} {axis}") else FORCE
        found.append(Drawn(
            quantity=f"{kind} {axis}", error="relative_percent",
            beside=partial(_beside, shown, axis, one.command_unit),
        ))  # fmt: skip
    return found


def _beside(shown: Shown[DriveModel], axis: str, unit: str, case: str) -> list[Strip]:
    """Speed and command of an axis in a recording."""
    rows = shown.predictions
    if rows is None:
        return []
    rows = rows[rows["case"] == case]
    strips = []
    for name, head, height in ((SPEED, "Speed, mm/s", 44), (COMMAND, f"Command, {unit}", 110)):
        of = rows[rows["quantity"] == f"{name} {axis}"].sort_values("t", kind="stable")
        t, measured, predicted = (readings(of[c].to_numpy(float))
                                  for c in ("t", "measured", "predicted"))  # fmt: skip
        if len(of) > 2:
            css = "speed" if name == SPEED else "measured"
            curves = [(css, t, measured)] + ([("window", t, predicted)] if name == COMMAND else [])
            strips.append(Strip(head=head.rstrip(", "), height=height, curves=curves))
    return strips


# ---- the truth of a simulated machine


def _truth(shown: Shown[DriveModel]) -> Iterator[KnownValue]:
    """Parameters beside the truth, in units of the shop."""
    truth = stated(shown.truth, "drives")
    axes = {} if shown.model is None else dict(shown.model.axes)
    for part in (*sorted(axes), MOTOR):
        found = shown.parameters(part)
        of = stated(truth, MOTOR) if part == MOTOR else stated(truth, "axes", part)
        plain = {str(name): real(v.get("value") if isinstance(v, dict) else v)
                 for name, v in (of if isinstance(of, dict) else {}).items()}  # fmt: skip
        known = {name: v for name, v in plain.items() if v is not None}
        for name, true in truth_as_fitted(known, found).items():
            if (p := found.get(name)) is not None:
                factor = SHOP.get(p.unit, ("", 1.0))[1]
                yield KnownValue(name=f"{part} {name}", true=true * factor,
                                 parameter=in_units(p, SHOP))  # fmt: skip


def truth_as_fitted(
    truth: dict[str, float], parameters: Mapping[str, Parameter]
) -> dict[str, float]:
    """The truth [SI] by name, with friction and constant force split as the fit splits them.

    Motion shows the sums F_c+ + F_0 and F_c- - F_0 alone.  A fit that takes friction as equal in
    both directions, or F_0 as none, moves a part of F_0 into friction, and so must the truth.
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
