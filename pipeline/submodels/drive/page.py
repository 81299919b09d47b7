"""Page of the feed drives: moving mass, friction and loops of each axis; the twin's motion."""

from collections.abc import Iterator
from functools import partial
from typing import Any

from pipeline.charts.bands import Strip, readings
from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried
from pipeline.charts.numbers import number, powers
from pipeline.charts.parameters import fit_words
from pipeline.charts.sections import Block, Heading, present
from pipeline.charts.submodel_page import PageContent, declared, made_from
from pipeline.charts.tables import Column, Table, code, tabulated
from pipeline.charts.words import page_words
from pipeline.schema.drive import (
    BASELINE_TITLES,
    COMMAND,
    FOLLOWING,
    FORCE,
    MOTOR,
    SPEED,
    DriveAxis,
    DriveModel,
    TrainingRecording,
)
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.figures import axis_figures
from pipeline.submodels.drive.speed_loops_page import speed_loops
from pipeline.submodels.drive.truth import known_values

WORDS = page_words(__file__)
METHODS = WORDS.table("methods")
"""Methods of identification in words."""

Seen = Shown[DriveModel]


def content(shown: Seen) -> PageContent:
    """Page content of the feed drives."""
    model = shown.model
    return declared(
        WORDS,
        titles=BASELINE_TITLES,
        cause=_causes(shown),
        meaning=meaning,
        groups={} if model is None else {axis: f"axis {axis}" for axis in model.parameters
                                         if axis != MOTOR} | {MOTOR: "the motor"},
        of_group={} if model is None else {
            group: [*present(Heading(heading=words, text=said), drawn)]
            for group, words, said, drawn in _groups(shown, model)
        },
        figures=[] if model is None else [
            *speed_loops(model.speed_loops, made_from(shown, "model.json")),
            _recordings(shown, model),
        ],
        tried=() if model is None else [
            Tried(task=f"{axis}, {one.task.replace('_', ' ')}", error=one.error,
                  label=METHODS.get(one.method, one.method), unit=powers(one.error_unit),
                  evaluations=one.evaluations, serves=one.chosen)
            for axis, found in model.axes.items() for one in found.methods
        ],
        drawn=_drawn(shown),
        truth=list(known_values(shown, WORDS.content["units"])),
    )  # fmt: skip


def meaning(axis: str, name: str) -> str:
    """Meaning of a parameter, with the direction behind its name.

    >>> meaning("X", "coulomb_negative"), meaning("motor", "L_d"), meaning("X", "other")
    ('friction that speed does not change, towards −X', 'inductance along the magnets’ flux', '–')
    """
    for ending, sign in (("_positive", "+"), ("_negative", "−")):
        if name.endswith(ending):
            words = WORDS.meanings.get(name.removesuffix(ending))
            return f"{words}, towards {sign}{axis}" if words else "–"
    return WORDS.meaning("", name)


# ---- axes


def _groups(shown: Seen, model: DriveModel) -> Iterator[tuple[str, str, str, Block | None]]:
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
            said = WORDS("axis.unknown", why=why.removeprefix(of_axis)).rstrip("; .")
            yield axis, f"Axis {axis}", f"{said}.", None


def _axis_words(model: DriveModel, axis: str, one: DriveAxis) -> Iterator[str]:
    """Quality of the fit, determined loops and shaft of an axis."""
    yield _fitted("fit", one.fit)
    if one.servo_reason:
        yield WORDS("axis.no_loops", reason=one.servo_reason.rstrip("."))
    elif one.servo_fit is not None:
        yield _fitted("loops", one.servo_fit)
    if one.force_unit not in ("", "N"):
        yield WORDS("axis.no_force", command=one.command_unit, force=powers(one.force_unit))
    shaft = model.shafts.get(axis)
    if shaft is None:
        yield WORDS("axis.no_shaft")
    else:
        twist, left = number(shaft.twist_um, 2), number(shaft.left_um, 2)
        yield WORDS("axis.shaft", twist=twist, left=left)


def _fitted(of: str, fit: Any) -> str:
    if fit.relative_error_percent is None:
        return fit_words("", fit.condition, fit.correlation)
    over = f" over {number(fit.samples)} samples" if fit.samples else ""
    said = WORDS(f"axis.{of}", error=number(fit.relative_error_percent, 2), over=over)
    return fit_words(said, fit.condition, fit.correlation)


RECORDED: tuple[Column[TrainingRecording], ...] = (
    Column("Recording", lambda one: code(one.recording)),
    Column("length", lambda one: number(one.seconds), "s"),
    Column("what was done to it", lambda one: "; ".join(one.notes) or "–"),
)


def _recordings(shown: Seen, model: DriveModel) -> Table | None:
    caption = f"Recordings that the drives were identified from ({len(model.recordings)})"
    return tabulated(caption, model.recordings, RECORDED, made_from(shown, "model.json"),
                     folded=True)  # fmt: skip


# ---- recordings against the twin


def _causes(shown: Seen) -> str:
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


def _drawn(shown: Seen) -> list[Drawn]:
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


def _beside(shown: Seen, axis: str, unit: str, case: str) -> list[Strip]:
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
