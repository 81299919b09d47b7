"""Page of the control: what it does with a program, predicted beside measured times."""

from pipeline.charts.numbers import counted, duration, percent, quantity, relative, signed
from pipeline.charts.parameters import fit_words
from pipeline.charts.submodel_page import Counting, PageContent, made_from
from pipeline.charts.tables import Column, Table, tabulated
from pipeline.schema.verdict import Score
from pipeline.submodels.contract import Shown
from pipeline.submodels.control.segments import NAIVE, OVERRIDE_ONLY, TIME
from pipeline.twin.control import WHOLE, ControlModelFile

MEANINGS = {
    "rapid_speed": "greatest speed in rapids",
    "cutting_speed": "greatest speed in cutting moves",
    "rapid_acceleration": "acceleration along the path in rapids",
    "cutting_acceleration": "acceleration along the path in cutting moves",
    "arc_acceleration": "acceleration towards the centre of arcs, and of curves made of chords",
    "corner_jump": "jump of an axis’ speed that a corner may ask for",
    "jerk": "change of acceleration in time",
    "tolerance": "how far the path may cut a corner",
    "rapid_filter": "smoothing time after interpolation, in rapids",
    "cutting_filter": "smoothing time after interpolation, in cutting moves",
    "settle_time": "wait until the axes are in position at an exact stop",
    "tool_change": "time of a tool change",
    "m_code": "time of an M code",
    "stop": "time of M0 and M1, without the operator’s",
    "spindle_acceleration": "how fast the spindle runs up",
    "spindle_deceleration": "how fast the spindle is stopped",
    "spindle_base_speed": "speed above which the spindle has constant power",
    "spindle_delay": "what each start and stop of the spindle takes beside its ramp",
    "spindle_orientation": "time to orient the spindle",
}
"""Meaning of the parameters of a control, in words."""


def content(shown: Shown[ControlModelFile]) -> PageContent:
    """Page content of the control."""
    return PageContent(
        about="A control cuts a program’s feed wherever the axes cannot follow: at corners, in "
        "arcs, in blocks too short to get up to speed. These are the limits that it keeps by these "
        "records, and the times that it takes for what does not move.",
        rules="Only runs that the control was not fitted on and that ran to their end are judged. "
        "What the operator stopped (feed hold, an override at 0) stands in its own column and is "
        "no part of the comparison. The plain guess is path length over programmed feed, as if the "
        "axes had no mass. Feed read: share of the cutting lines whose feed was read from the "
        "log’s speeds, as the override that the log says may not be the one in force. The interval "
        "of a time is the largest error of programs predicted by a control identified from the "
        "others; it reaches further where a part needs what these runs do not determine.",
        case="run",
        counts=(
            Counting(key="times_worst_percent", name="Error of a program’s time", quantity=TIME,
                     regime=WHOLE, error="relative_percent"),
        ),
        judged_count=("runs_judged", "Runs judged"),
        guess=NAIVE,
        titles={NAIVE: "path over programmed feed", OVERRIDE_ONLY: "recorded override only"},
        todo={
            "passed": "Plan with these times.",
            "failed": "Do not plan with the predicted time of the programs that are beyond the "
            "limit; the types of block below say what the prediction gets wrong.",
            "unknown": "Record another run of each program, to judge the predicted times by.",
        },
        facts=[] if shown.model is None else [_found_from(shown.model)],
        meaning=lambda group, name: meaning(name),
        shown_facts=("program", "completed", "measured", "predicted", "stops", "error", "feed"),
        of_judgement=[_types(shown)],
    )  # fmt: skip


def meaning(name: str) -> str:
    """Meaning of a parameter, with the axes and the machine behind its name.

    >>> meaning("rapid_speed XY@mill02"), meaning("other Z")
    ('greatest speed in rapids (X, Y), on mill02', '–')
    """
    name, _, unit = name.partition("@")
    key, _, axes = name.partition(" ")
    if key not in MEANINGS:
        return "–"
    of_axes = f" ({', '.join(axes)})" if axes else ""
    return f"{MEANINGS[key]}{of_axes}{f', on {unit}' if unit else ''}"


def _found_from(model: ControlModelFile) -> str:
    fit = model.fit
    rmse = "" if fit.rmse_s is None else quantity(fit.rmse_s, "s")
    words = (
        f"The runs are of {counted(len(set(model.programs.values())), 'program')}, cut into "
        f"{counted(fit.segments, 'stretch', 'stretches')} between polled lines."
    )
    said = f"The RMS error of a stretch’s time is {rmse}" if rmse else ""
    return f"{words} {fit_words(said, fit.condition, fit.correlation)}".strip()


TYPES: tuple[Column[tuple[str, float, float, float]], ...] = (
    Column("Type of block", lambda row: row[0]),
    Column("measured", lambda row: duration(row[1]), ""),
    Column("predicted", lambda row: duration(row[1] + row[2]), ""),
    Column("difference", lambda row: signed(row[2]), "s"),
    Column("error", lambda row: relative(100 * row[2] / row[1] if row[1] > 0 else None, signed),
           "%"),
    Column("share of all differences", lambda row: percent(abs(row[2]), row[3]), ""),
)  # fmt: skip


def _types(shown: Shown[ControlModelFile]) -> Table | None:
    """Measured and predicted time of each type of block, over all runs that decide."""
    verdict = shown.verdict
    if verdict is None:
        return None
    sums: dict[str, tuple[float, float]] = {}
    for s in verdict.of(TIME, role=verdict.judged_role):
        if s.group != "all" and s.regime != WHOLE:
            measured, difference = sums.get(s.regime, (0.0, 0.0))
            sums[s.regime] = measured + measured_time(s), difference + (s.bias or 0.0)
    whole = sum(abs(difference) for _, difference in sums.values())
    rows = [(name, measured, difference, whole) for name, (measured, difference) in sums.items()]
    return tabulated("By type of block, over the runs that decide", rows, TYPES,
                     made_from(shown, "verdict.json"))  # fmt: skip


def measured_time(score: Score) -> float:
    """Measured time of a score of one run [s], from its bias and its error of the mean."""
    if score.bias is None or not score.mean_percent:
        return 0.0
    return 100 * score.bias / score.mean_percent
