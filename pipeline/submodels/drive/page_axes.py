"""Axes on the page of the feed drives: friction, mass over time, methods, training recordings."""

from pipeline.charts.default_section import strongest_correlation, training_table
from pipeline.charts.numbers import (
    counted,
    fixed,
    joined,
    number,
    powers,
    quantity,
)
from pipeline.charts.sections import (
    Block,
    Figure,
    Figures,
    Heading,
    Section,
    present,
)
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Table,
    cells,
    left_out,
    names,
    numbers,
)
from pipeline.schema.drive import MOTOR, DriveAxis, DriveModel, FitFacts, Method
from pipeline.schema.model import Correlation
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.figures import (
    friction_figure,
    friction_shown,
    mass_figure,
    mass_shown,
)
from pipeline.submodels.drive.page_parameters import (
    axis_parameters_table,
    identified_axes,
    made_from,
    meaning,
)
from pipeline.submodels.drive.page_speed_loops import shaft_words, speed_loop_blocks

METHODS = {"least_squares": "least squares", "genetic": "genetic search"}
"""Methods of identification in words."""
ALIKE = 1e-3
"""Relative difference of errors below which two searches reached the same optimum [1]."""
ILL = 1e4
"""Condition of the scaled Jacobian above which parameters are hard to separate [1]."""
MOST_NAMED = 4
"""Greatest number of parameters that are named at the head of the page [1]."""


def undetermined_words(shown: Shown[DriveModel]) -> str:
    """Parameters that the records do not determine, the first of them in words."""
    lost = [
        f"({axis}) {name if (words := meaning(name, axis)) == '–' else words}"
        for axis in identified_axes(shown)
        for name, p in shown.parameters(axis).items() if not p.determined
    ]  # fmt: skip
    if not lost:
        return ""
    more = [f"{len(lost) - MOST_NAMED} more"] if len(lost) > MOST_NAMED else []
    return (
        f"Of the drives the records do not determine {'; '.join(lost[:MOST_NAMED] + more)}; the "
        "tables below say what to record for a number."
    )


def drives_section(shown: Shown[DriveModel]) -> Section | None:
    """Each axis: friction over speed, mass over time, parameters; then how they were found."""
    model = shown.model
    if model is None:
        return None
    count = len(model.recordings)
    of = f" of {joined(list(identified_axes(shown)))}" if identified_axes(shown) else ""
    text = [
        "What an axis does with a command is set by what it moves, by friction in guideways and "
        "screw, and by the gains of its loops. These were identified from records of the "
        "servo drives.",
        f"Identified from {counted(count, 'recording')}{of}." if count else
        "The recordings that they were identified from are not named.",
        "Whether friction is growing cannot be said from one set of records: repeat the same "
        "reciprocation in a few weeks, and the list of changes below says what moved.",
    ]  # fmt: skip
    if shown.verdict is None:
        text.append("No recording has been held against them yet.")
    if not identified_axes(shown):
        text.append("No axis could be identified.")
    blocks: list[Block] = []
    for axis in identified_axes(shown):
        blocks += _axis(shown, axis)
    for axis in _gain_alone(model):
        words = f"Its mechanics stays unknown; {_why_open(model, axis)}".rstrip("; ")
        blocks.append(Heading(heading=f"Axis {axis}", text=f"{words}."))
        blocks += present(axis_parameters_table(shown, axis, f"axis {axis}", axis))
    if model.motor is not None:
        words = _fit_words(model.motor.condition, model.motor.correlation)
        blocks.append(Heading(heading="Motor", text=words))
        blocks += present(
            axis_parameters_table(shown, MOTOR, f"the motor of axis {model.motor.axis}")
        )
    blocks += speed_loop_blocks(shown)
    methods = methods_table(shown)
    if methods is not None:
        blocks += [Heading(heading="How they were identified", text=methods_words(shown)), methods]
    blocks += present(
        _recordings_table(shown, model),
        training_table(model, made_from(shown, "model.json")),
    )
    return Section(key="drives", title="The feed drives: what moves the axes", text=text,
                   blocks=blocks)  # fmt: skip


def _gain_alone(model: DriveModel) -> list[str]:
    """Axes of which commanded and actual position told the loop gain, and no more."""
    return sorted(set(model.parameters) - set(model.axes) - {MOTOR})


def _why_open(model: DriveModel, axis: str) -> str:
    of_axis = f"axis {axis}: "
    said = (one.reason for one in model.left_out if one.reason.startswith(of_axis))
    return next(said, "").removeprefix(of_axis).rstrip(".")


def _axis(shown: Shown[DriveModel], axis: str) -> list[Block]:
    one = identified_axes(shown)[axis]
    said = (
        _fit_words(one.fit.condition, one.fit.correlation, one.fit),
        _loops_words(one),
        _unknown_force(one),
        shaft_words(shown, axis),
    )
    blocks: list[Block] = [Heading(heading=f"Axis {axis}", text=" ".join(w for w in said if w))]
    return blocks + present(
        _figures(shown, axis, one), axis_parameters_table(shown, axis, f"axis {axis}", axis)
    )


def _fit_words(
    condition: float | None, correlation: Correlation, fit: FitFacts | None = None
) -> str:
    """How well the fit holds, and which two parameters are the most correlated."""
    words = []
    if fit is not None and fit.relative_error_percent is not None:
        over = f" over {number(fit.samples)} samples" if fit.samples else ""
        error = number(fit.relative_error_percent, 2)
        words.append(f"The residual of the fit is {error} % of the force{over}")
    if condition is not None:
        ill = ", so some are hard to separate" if condition > ILL else ""
        words.append(f"the condition is {number(condition, 2)}{ill}")
    if pair := _worst_pair(correlation):
        words.append(pair)
    text = "; ".join(words)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _worst_pair(correlation: Correlation) -> str:
    pair = strongest_correlation(correlation)
    if pair is None:
        return ""
    return f"the most correlated are {pair[0]} and {pair[1]} (correlation {fixed(pair[2], 2)})"


def _loops_words(one: DriveAxis) -> str:
    """How well the loops' gains hold, or why there are none."""
    if one.servo_reason:
        return f"Its loops could not be found: {one.servo_reason.rstrip('.')}."
    if one.servo_fit is None or one.servo_fit.relative_error_percent is None:
        return ""
    error = number(one.servo_fit.relative_error_percent, 2)
    words = f"Its loops’ gains leave {error} % of the command unexplained"
    pair = _worst_pair(one.servo_fit.correlation)
    return f"{words}; {pair}." if pair else f"{words}."


def _unknown_force(one: DriveAxis) -> str:
    if one.force_unit in ("", "N"):
        return ""
    return (
        f"Nobody has said what force one {one.command_unit} makes, so forces are in "
        f"{powers(one.force_unit)}: give force_constant, or torque_constant and lead, in "
        "conf/machine/ for newtons and kilograms."
    )


def _figures(shown: Shown[DriveModel], axis: str, one: DriveAxis) -> Figures | None:
    figures, legend, made = [], [], made_from(shown, "model.json")
    friction = friction_shown(one)
    mass = mass_shown(one.recursive_mass, shown.parameters(axis).get("mass"))
    if friction is not None:
        words = (
            f"Friction of axis {axis} over speed: {counted(friction.count, 'stretch', 'stretches')}"
            " of constant speed with 95 % intervals, and Stribeck’s curve."
        )
        figures.append(Figure(svg=friction_figure(friction, words), caption=words, sources=made))
        for name, sign in (("positive", "+"), ("negative", "−")):
            if len(friction.points[name].speed):
                legend.append((f"p-{name}", f"measured, towards {sign}{axis}", "dot"))
            if len(friction.curve[name].speed) > 1:
                legend.append((f"l-curve-{name}", f"model, towards {sign}{axis}", "line"))
    if mass is not None:
        last = quantity(float(mass.value[-1]), powers(mass.unit))
        words = (
            f"Mass of axis {axis} through {mass.recording or 'a recording'}: the recursive "
            f"estimate ends at {last}."
        )
        figures.append(Figure(svg=mass_figure(mass, words), caption=words, sources=made))
        legend += [("l-modelled", "recursive estimate", "line"),
                   ("s-band", "its 95 % band", "box"),
                   ("l-batch", "value of all training records", "line")]  # fmt: skip
    kind = "one" if len(figures) == 1 else ""
    return Figures(figures=figures, legend=legend, kind=kind) if figures else None


def methods_table(shown: Shown[DriveModel]) -> Table | None:
    """Each search on the same data: its error, its evaluations, and which one was kept."""
    rows = [
        cells(
            axis,
            one.task.replace("_", " "),
            METHODS.get(one.method, one.method),
            number(one.error, 4),
            powers(one.error_unit or "–"),
            number(one.evaluations),
            "kept" if one.chosen else "–",
        )
        for axis, found in identified_axes(shown).items()
        for one in found.methods
    ]
    if not rows:
        return None
    return Table(
        caption="Least squares against genetic search, on the same records",
        heads=[*names("Axis", "what was fitted", "method"), *numbers(("error", "")),
               *names("unit"), *numbers(("evaluations", "")), *names("kept")],
        rows=rows,
        sources=made_from(shown, "model.json"),
        folded=True,
    )  # fmt: skip


def methods_words(shown: Shown[DriveModel]) -> str:
    """Which search won, in one sentence; empty without two on the same task."""
    duels = [d for one in identified_axes(shown).values() for d in _duels(one.methods)]
    if not duels:
        return ""
    equal = [abs(a - b) <= ALIKE * max(abs(a), abs(b)) for a, b, _ in duels]
    wins = [
        sum(not same and sign * (b - a) > 0 for (a, b, _), same in zip(duels, equal, strict=True))
        for sign in (1, -1)
    ]
    won = "Neither search won" if wins[0] == wins[1] else (
        f"{'Least squares' if wins[0] > wins[1] else 'The genetic search'} won"
    )  # fmt: skip
    text = (
        f"{won}: of {counted(len(duels), 'task')} least squares has the smaller error in "
        f"{wins[0]}, the genetic search in {wins[1]}, and in {sum(equal)} they are alike within "
        f"{100 * ALIKE:g} %"
    )
    ratios = sorted(ratio for *_, ratio in duels if ratio > 0)
    if not ratios:
        return text + "."
    return (
        f"{text}; for each evaluation of least squares the genetic search needed "
        f"{number(ratios[len(ratios) // 2], 2)} (median)."
    )


def _duels(methods: tuple[Method, ...]) -> list[tuple[float, float, float]]:
    """Of each task: error of least squares, of the genetic search, its evaluations to 1."""
    tasks: dict[str, dict[str, Method]] = {}
    for one in methods:
        tasks.setdefault(one.task, {})[one.method] = one
    found = []
    for by_method in tasks.values():
        first, second = (by_method.get(name) for name in METHODS)
        if first is None or second is None or first.error is None or second.error is None:
            continue
        spent = first.evaluations, second.evaluations
        ratio = spent[1] / spent[0] if spent[0] and spent[1] else 0.0
        found.append((first.error, second.error, ratio))
    return found


def _recordings_table(shown: Shown[DriveModel], model: DriveModel) -> Table | None:
    """Length of each training recording, and the changes to its rows."""
    if not model.recordings:
        return None
    rows = [
        cells(Cell(text=one.recording, code=True), number(one.seconds), "; ".join(one.notes) or "–")
        for one in model.recordings[:MOST_ROWS]
    ]
    return Table(
        caption=f"Recordings that the drives were identified from ({number(len(model.recordings))})"
        f"{left_out(len(model.recordings), MOST_ROWS)}",
        heads=[*names("Recording"), *numbers(("length", "s")), *names("what was done to it")],
        rows=rows,
        sources=made_from(shown, "model.json"),
        folded=True,
    )  # fmt: skip
