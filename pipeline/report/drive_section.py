"""The sections on the feed drives: what they are, and how well the twin moves as they do."""

from typing import Any

from pipeline.charts.numbers import counted, fixed, number, powers, quantity, real
from pipeline.charts.sections import Block, Figure, Figures, Heading, Section, present
from pipeline.charts.sources import dig
from pipeline.report.drive_friction_figure import friction_figure, friction_shown
from pipeline.report.drive_inertia_figure import inertia_figure, inertia_shown
from pipeline.report.drive_methods import methods_table, methods_words
from pipeline.report.drive_tables import (
    axis_parameters_table,
    drive_files_table,
    drive_recordings_table,
    drive_sources,
    motor_table,
)
from pipeline.report.drive_verdict import joined
from pipeline.report.facts import Facts
from pipeline.report.model_tables import strongest_correlation

ILL = 1e4  # condition of the scaled Jacobian above which parameters are hard to tell apart


def drives_section(found: Facts) -> Section | None:
    """Each axis: friction over speed, mass over time, parameters; then how they were found."""
    drives = found.drives
    if drives.drive is None:
        return None
    text = [
        "What an axis does with a command is set by what it moves, by friction in guideways and "
        "screw, and by the gains of its loops. These were found from records of the servo drives.",
        _found_from(found),
        "Whether friction is growing cannot be said from one set of records: repeat the same "
        "reciprocation in a few weeks, and the list of changes below says what moved.",
    ]
    if drives.validation is None:
        text.append("No recording has been held against them yet: there is no "
                    "drive_validation.json.")  # fmt: skip
    if not drives.axes:
        text.append("No axis could be identified.")
    blocks: list[Block] = []
    for axis in drives.axes:
        blocks += _axis(found, axis)
    motor = motor_table(found)
    if motor is not None:
        blocks.append(Heading(heading="Motor", text=_fit_words(dig(drives.drive, "motor", "fit"))))
    how = methods_table(found)
    blocks += present(motor)
    if how is not None:
        blocks.append(Heading(heading="How they were found", text=methods_words(found)))
    blocks += present(how, drive_recordings_table(found), drive_files_table(found))
    return Section(key="drives", title="The feed drives: what moves the axes", text=text,
                   blocks=blocks)  # fmt: skip


def _found_from(found: Facts) -> str:
    count = len(found.drives.training)
    if not count:
        return "The recordings that they were found from are not named."
    axes = list(found.drives.axes)
    of = f" of {joined(axes)}" if axes else ""
    return f"Found from {counted(count, 'recording')}{of}."


def _axis(found: Facts, axis: str) -> list[Block]:
    one = found.drives.axes[axis]
    said = (_fit_words(dig(one, "fit")), _loops_words(one), _unknown_force(one))
    words = " ".join(w for w in said if w)
    blocks: list[Block] = [Heading(heading=f"Axis {axis}", text=words)]
    return blocks + present(_figures(found, axis, one), axis_parameters_table(found, axis))


def _fit_words(fit: Any) -> str:
    """How well the fit holds, and which two parameters it tells apart worst."""
    words = []
    error, samples = (real(dig(fit, key)) for key in ("relative_error_percent", "samples"))
    if error is not None:
        over = f" over {number(round(samples))} samples" if samples else ""
        words.append(f"What the fit leaves over is {number(error, 2)} % of the force{over}")
    condition = real(dig(fit, "condition"))
    if condition is not None:
        ill = ", so some are hard to tell apart" if condition > ILL else ""
        words.append(f"the condition is {number(condition, 2)}{ill}")
    pair = strongest_correlation(fit)
    if pair is not None:
        words.append(
            f"told apart worst are {pair[0]} and {pair[1]} (correlation {fixed(pair[2], 2)})"
        )
    text = "; ".join(words)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _loops_words(one: dict[str, Any]) -> str:
    """How well the loops' gains hold, or why there are none."""
    why = str(dig(one, "drive", "servo_reason") or "")
    if why:
        return f"Its loops could not be found: {why.rstrip('.')}."
    error = real(dig(one, "servo_fit", "relative_error_percent"))
    if error is None:
        return ""
    words = f"Its loops’ gains leave {number(error, 2)} % of the command unexplained"
    pair = strongest_correlation(dig(one, "servo_fit"))
    if pair is not None:
        words += f"; told apart worst are {pair[0]} and {pair[1]} (correlation {fixed(pair[2], 2)})"
    return words + "."


def _unknown_force(one: dict[str, Any]) -> str:
    command, force = (str(one.get(key) or "") for key in ("command_unit", "force_unit"))
    if force in ("", "N"):
        return ""
    return (
        f"Nobody has said what force one {command} makes, so forces are in {powers(force)}: give "
        "force_constant, or torque_constant and lead, in conf/machine/ for newtons and kilograms."
    )


def _figures(found: Facts, axis: str, one: dict[str, Any]) -> Figures | None:
    figures, legend = [], []
    friction, inertia = friction_shown(one), inertia_shown(one)
    if friction is not None:
        words = (
            f"Friction of axis {axis} over speed: {counted(friction.count, 'stretch', 'stretches')}"
            " of constant speed with 95 % intervals, and Stribeck’s curve."
        )
        figures.append(Figure(svg=friction_figure(friction, words), caption=words,
                              sources=drive_sources(found)))  # fmt: skip
        for name, sign in (("positive", "+"), ("negative", "−")):
            if len(friction.points[name].speed):
                legend.append((f"p-{name}", f"measured, towards {sign}{axis}", "dot"))
            if len(friction.curve[name].speed) > 1:
                legend.append((f"l-curve-{name}", f"model, towards {sign}{axis}", "line"))
    if inertia is not None:
        last = quantity(float(inertia.value[-1]), powers(inertia.unit))
        words = (
            f"{inertia.quantity.capitalize()} of axis {axis} through "
            f"{inertia.recording or 'a recording'}: the recursive estimate ends at {last}."
        )
        figures.append(Figure(svg=inertia_figure(inertia, words), caption=words,
                              sources=drive_sources(found)))  # fmt: skip
        legend += [("l-modelled", "recursive estimate", "line"),
                   ("s-band", "its 95 % band", "box"),
                   ("l-batch", "value of all training records", "line")]  # fmt: skip
    kind = "one" if len(figures) == 1 else ""
    return Figures(figures=figures, legend=legend, kind=kind) if figures else None
