"""Page of the control: its parameters, predicted beside measured times, the verdict in words."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from pipeline.charts import default_section, sections, svg
from pipeline.charts.numbers import (
    counted,
    duration,
    fixed,
    number,
    percent,
    quantity,
    relative,
    signed,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import (
    MOST_ROWS,
    Cell,
    Head,
    Table,
    cells,
    left_out,
    names,
    numbers,
    sources,
)
from pipeline.schema.verdict import JudgedCase, Score, Status, Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.control.times import NAIVE, OVERRIDE_ONLY, TIME
from pipeline.twin.control import WHOLE, ControlModelFile

MOST_RUNS = 40  # of the figure; the table has them all
RULES = (
    "Only runs that the control was not fitted on and that ran to their end are judged. What the "
    "operator stopped (feed hold, an override at 0) stands in its own column and is no part of the "
    "comparison. An error above 0 says that the prediction is too long. The plain guess is "
    "path length over programmed feed, as if the axes had no mass."
)
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
"""Meaning of the parameters of a control, for people."""
ROW, TOP = 22, 6  # px
WIDEST = 60.0  # percent; an error beyond it stands at the edge as an arrow
LONGEST = 24  # letters of a run's name that stand beside it
FEW = 5  # judged runs below which more are asked for
KIND = {
    "passed": "p-passed",
    "failed": "p-failed",
    "not judged": "p-learnt",
    "not decided": "p-learnt",
}

Seen = Shown[ControlModelFile]


@dataclass(frozen=True, kw_only=True)
class RunTime:
    """One run that was compared: its facts, its score if it has one, and its types of block."""

    case: JudgedCase
    status: Status
    by_type: Mapping[str, Score]

    def value(self, name: str) -> float | None:
        """A fact of the run that is a number."""
        fact = self.case.facts.get(name)
        return fact.value if fact is not None and isinstance(fact.value, int | float) else None

    def word(self, name: str) -> str:
        """A fact of the run that is a word."""
        fact = self.case.facts.get(name)
        return str(fact.value) if fact is not None and fact.value is not None else "not known"

    @property
    def error(self) -> float | None:
        """Of the predicted time [%]."""
        return self.value("error")

    @property
    def judged(self) -> bool:
        """Whether it decides."""
        return self.status != "not judged"


def page(seen: Seen) -> sections.SubModelPage:
    """Everything that a machine's page says of its control."""
    runs, limit = run_times(seen.verdict), _limit(seen.verdict)
    judged = [run for run in runs if run.judged]
    worst = _worst(judged)
    figures = []
    if worst is not None:
        aside = f"worst of {counted(len(judged), 'judged run')}, limit ±{fixed(limit, 0)} %"
        figures.append(("Predicted program times", relative(worst, signed, "%"), aside))
    lost = _undetermined(seen)
    return sections.SubModelPage(
        verdict=_verdict(seen, runs, limit),
        key_figures=figures,
        notes=[f"These runs do not determine of the control: {'; '.join(lost)}."] if lost else [],
        sections=[s for s in (_control_section(seen), _times_section(seen, runs)) if s is not None],
        compared={
            "times_worst_percent": sections.Compared(
                name="Error of program times, worst judged run", unit="%", value=worst
            ),
            "runs_judged": sections.Compared(
                name="Runs judged", unit="", value=len(judged) if seen.verdict else None
            ),
        },
    )


def run_times(verdict: Verdict | None) -> list[RunTime]:
    """Every run whose time was predicted: the judged first, then by name."""
    if verdict is None:
        return []
    found = []
    for case in verdict.cases:
        if "predicted" not in case.facts:
            continue
        scores = {s.regime: s for s in verdict.of(TIME, group=case.group, role=case.role)}
        whole = scores.pop(WHOLE, None)
        status: Status = "not judged" if whole is None else whole.status
        found.append(RunTime(case=case, status=status, by_type=scores))
    return sorted(found, key=lambda run: (not run.judged, run.case.case))


def meaning(name: str) -> str:
    """Meaning of a parameter, with the axes and the machine behind its name.

    ``–`` where the name says all that is known.

    >>> meaning("rapid_speed XY@mill02"), meaning("settle_time"), meaning("other Z")
    ('greatest speed in rapids (X, Y), on mill02', \
'wait until the axes are in position at an exact stop', '–')
    """
    name, _, unit = name.partition("@")
    key, _, axes = name.partition(" ")
    if key not in MEANINGS:
        return "–"
    of_axes = f" ({', '.join(axes)})" if axes else ""
    return f"{MEANINGS[key]}{of_axes}{f', on {unit}' if unit else ''}"


def _limit(verdict: Verdict | None) -> float | None:
    """Greatest error of a run's time that passes [%]."""
    scores = [] if verdict is None else [s for s in verdict.of(TIME) if s.limits]
    return scores[0].limits.get("relative_percent") if scores else None


def _worst(judged: Sequence[RunTime]) -> float | None:
    """The error of the judged run that is farthest off [%]; None without any."""
    errors = [run.error for run in judged if run.error is not None]
    return max(errors, key=abs) if errors else None


def _undetermined(seen: Seen) -> list[str]:
    """Parameters without a number in the words of their table; a name that has none as it is."""
    words = {name: meaning(name) for name, p in seen.parameters().items() if not p.determined}
    return [name if said == "–" else said for name, said in words.items()]


def _made(seen: Seen, *files: str) -> list[Source]:
    return sources(seen.shelf, *(seen.folder / file for file in files))


def _verdict(
    seen: Seen, runs: Sequence[RunTime], limit: float | None
) -> sections.PartVerdict | None:
    """Whether program times may be planned with; None when no time was predicted at all."""
    if seen.verdict is None:
        return None
    judged = [run for run in runs if run.judged]
    worst = _worst(judged)
    if worst is None or limit is None:
        return sections.PartVerdict(
            status="unknown",
            sentence="Program times are predicted, and no run could be judged.",
            todo="Record another run of each program, to judge the predicted times by.",
        )
    failed = [run for run in judged if run.status == "failed"]
    good = len(judged) - len(failed)
    sentence = (
        f"Predicted program times lie within ±{fixed(limit, 0)} % on {good} of "
        f"{counted(len(judged), 'judged run')}, at worst {signed(worst)} %."
    )
    if failed:
        programs = ", ".join(dict.fromkeys(run.word("program") for run in failed))
        return sections.PartVerdict(
            status="failed",
            sentence=sentence,
            todo=f"Do not plan with the predicted time of {programs}; the types of block below say "
            "what the prediction gets wrong.",
        )
    if seen.verdict.status == "failed":
        return sections.PartVerdict(
            status="failed",
            sentence=f"{sentence} The judgement itself does not hold: {seen.verdict.reasons[0]}.",
            todo="Mend that, run dvc repro, and plan with these times only then.",
        )
    todo = "Plan with these times."
    if len(judged) < FEW:
        todo = (
            f"Plan with these times; {counted(len(judged), 'run')} say little: log more programs."
        )
    return sections.PartVerdict(status="passed", sentence=sentence, todo=todo)


def _control_section(seen: Seen) -> sections.Section | None:
    """What the control does with a program: parameters, runs that they were identified from."""
    model = seen.model
    if model is None:
        return None
    lost = _undetermined(seen)
    text = [
        "A control cuts a program’s feed wherever the axes cannot follow: at corners, in arcs, in "
        "blocks too short to get up to speed. These are the limits that it keeps by these records, "
        "and the times that it takes for what does not move.",
        _found_from(model),
    ]
    if lost:
        text.append(
            f"These runs do not determine: {'; '.join(lost)}. The table says what to record for a "
            "number."
        )
    if seen.verdict is None:
        text.append("No run has been held against it yet: there is no verdict.json.")
    made = _made(seen, "model.json")
    caption = "Parameters of the control"
    return sections.Section(
        key="control",
        title="The control: what it does with a program",
        text=text,
        blocks=sections.present(
            default_section.parameters_table(caption, seen.parameters(), made, meaning),
            default_section.training_table(model, made),
        ),
    )


def _found_from(model: ControlModelFile) -> str:
    fit = model.fit
    words = (
        f"Identified from {counted(len(model.trained_on), 'run')} of "
        f"{counted(len(set(model.programs.values())), 'program')}, cut into "
        f"{counted(fit.segments, 'stretch', 'stretches')} between polled lines"
    )
    if fit.rmse_s is not None:
        words += f"; the RMS error of a stretch’s time is {quantity(fit.rmse_s, 's')}"
    if fit.condition is not None:
        words += f", condition of the fit {number(fit.condition, 2)}"
    pair = default_section.strongest_correlation(fit.correlation)
    if pair is not None:
        words += f". The most correlated are {pair[0]} and {pair[1]} ("
        words += f"correlation {fixed(pair[2], 2)})"
    return words + "."


def _times_section(seen: Seen, runs: Sequence[RunTime]) -> sections.Section | None:
    """Each run's time, measured against predicted, with the plain guess as the baseline."""
    if seen.verdict is None:
        return None
    made, limit = _made(seen, "verdict.json"), _limit(seen.verdict)
    return sections.Section(
        key="times",
        title="Programs: predicted against measured time",
        text=[_score_words(runs, limit), RULES, _interval_words(seen)],
        blocks=sections.present(
            _errors(runs, limit, made),
            _runs_table(runs, made),
            _types_table(runs, made),
            default_section.scores_table(seen.verdict, made, of="Run"),
            default_section.outside_table(seen.verdict, made),
            default_section.left_out_table(seen.verdict, made),
        ),
    )


def _interval_words(seen: Seen) -> str:
    """How sure a predicted time is, and from what that is known."""
    band = None if seen.model is None else seen.model.intervals.get(WHOLE)
    unknown = {} if seen.verdict is None else seen.verdict.unknown_intervals
    if why := unknown.get((TIME, WHOLE)):
        return f"The time of a whole program stands alone: {why}."
    if band is None:
        return (
            "A predicted time has no interval: too few programs ran to the end to leave some out "
            "and predict them; log runs of two programs or more."
        )
    return (
        f"The 90 % interval of the time of a whole program is ±{fixed(100 * band.upper, 1)} % of "
        f"it: the largest error of {counted(band.groups, 'program')}, each predicted by a control "
        "identified from the others. It reaches further where a part needs what these runs do not "
        "determine."
    )


def _score_words(runs: Sequence[RunTime], limit: float | None) -> str:
    judged = [run for run in runs if run.judged]
    if not runs:
        return "No run has been predicted."
    if not judged:
        return (
            "No run could be judged: each was fitted on, was not run to its end, or has no "
            "known error. Record more runs of the same programs; one of each is enough."
        )
    passed = sum(run.status == "passed" for run in judged)
    worst = max(judged, key=lambda run: abs(run.error or 0.0))
    return (
        f"{passed} of {counted(len(judged), 'judged run')} lie within ±{fixed(limit, 0)} %; the "
        f"worst is {worst.case.case} with {signed(worst.error)} %."
    )


def _errors(
    runs: Sequence[RunTime], limit: float | None, made: Sequence[Source]
) -> sections.Figures | None:
    shown = [run for run in runs if run.error is not None][:MOST_RUNS]
    if not shown:
        return None
    judged = sum(run.judged for run in runs)
    label = (
        f"Error of the predicted time of {counted(len(shown), 'run')}, {judged} of them judged, "
        f"against the limit of ±{fixed(limit, 0)} % and against the plain guess"
    )
    legend = [("p-passed", "predicted, within the limit", "dot"),
              ("p-failed", "predicted, beyond it", "dot"),
              ("p-learnt", "fitted on or not judged", "dot"),
              ("p-naive", "plain guess, path length over feed", "dot"),
              ("s-limits", f"±{fixed(limit, 0)} %", "box")]  # fmt: skip
    figure = sections.Figure(
        svg=error_figure(shown, limit, label), sources=list(made),
        caption="Error of the predicted time, run by run, in percent.",
    )  # fmt: skip
    return sections.Figures(
        kind="one", legend=legend if limit is not None else legend[:-1], figures=[figure]
    )


def error_figure(runs: Sequence[RunTime], limit: float | None, label: str) -> Markup:
    """A point for each predicted time and each plain guess, joined; the limit as a band."""
    low, high = span = _span(runs, limit)
    bottom = TOP + ROW * len(runs)
    parts: list[Markup] = []
    if limit is not None:
        ends = [_percent(end, span) for end in (-limit, limit)]
        parts.append(svg.bar(ends[0], ends[1] - ends[0], TOP, bottom - TOP, "s-limits"))
    for mark in svg.ticks(low, high, most=6):
        x = _percent(mark, span)
        parts.append(svg.down(x, TOP, bottom, "grid zero" if mark == 0 else "grid"))
        parts.append(svg.text(x, bottom + 16, signed(mark, 0), svg.anchor(x)))
    for row, run in enumerate(runs):
        parts += _row(run, TOP + ROW * (row + 0.5), span)
    return svg.figure(parts, height=bottom + 24, label=label, kind="runs")


def _percent(value: float, span: tuple[float, float]) -> float:
    """Place of a value on the axis, beyond the span at its end [%]."""
    low, high = span
    return 100 * (min(max(value, low), high) - low) / (high - low)


def _span(runs: Sequence[RunTime], limit: float | None) -> tuple[float, float]:
    every = [v for run in runs for v in (run.error, run.value(f"error of {NAIVE}"))]
    known = [max(-WIDEST, min(WIDEST, v)) for v in every if v is not None]
    reach = 1.5 * limit if limit else 1.0
    return min([-reach, *(v - 2 for v in known)]), max([reach, *(v + 2 for v in known)])


def _row(run: RunTime, y: float, span: tuple[float, float]) -> list[Markup]:
    error, naive = run.error, run.value(f"error of {NAIVE}")
    words = run.case.case.rpartition("/")[2].replace(".txt", "")
    words = words if len(words) <= LONGEST else f"…{words[1 - LONGEST :]}"
    parts = [svg.text(0, y + 4, words, "name end", dx=-8)]
    at = [_percent(v, span) for v in (naive, error) if v is not None]
    if len(at) == 2:
        ends = {"x1": f"{at[0]:.2f}%", "x2": f"{at[1]:.2f}%"}
        parts.append(svg.tag("line", y1=y, y2=y, class_="join", **ends))
    if naive is not None:
        parts.append(_point(naive, y, "p-naive", span))
    if error is not None:
        parts.append(_point(error, y, KIND[run.status], span))
        parts.append(svg.text(100, y + 4, f"{signed(error)} %", "tick", dx=8))
    return parts


def _point(value: float, y: float, kind: str, span: tuple[float, float]) -> Markup:
    low, high = span
    if value < low or value > high:
        edge, arrow = (0, "◂") if value < low else (100, "▸")
        return svg.text(edge, y + 4, arrow, "tick" if edge == 0 else "tick end")
    size = 3.5 if kind == "p-naive" else 5.0
    return svg.tag(
        "circle", cx=f"{_percent(value, span):.2f}%", cy=y, r=size, class_=f"point {kind}"
    )


def _runs_table(runs: Sequence[RunTime], made: Sequence[Source]) -> Table | None:
    """Each run: measured, stopped, predicted, guessed, and the verdict on it."""
    if not runs:
        return None
    heads = [
        *names("Run", "program"),
        *numbers(("lasted", ""), ("stopped", ""), group="Measured"),
        *numbers(("time", ""), ("error", "%"), group="Predicted"),
        *numbers(("time", ""), ("error", "%"), group="Plain guess"),
        *numbers(("error", "%"), group="Recorded override"),
        *numbers(("feed read", "")),
        Head(name="verdict"),
    ]
    return Table(
        caption=f"Predicted against measured time, run by run{left_out(len(runs), MOST_ROWS)}",
        note="Feed read: share of the cutting lines whose feed was read from the log’s speeds, as "
        "the override that the log says may not be the one in force. Recorded override: the error "
        "with what the log says alone.",
        heads=heads,
        rows=[_run_row(run) for run in runs[:MOST_ROWS]],
        sources=list(made),
        folded=len(runs) > 30,
    )


def _run_row(run: RunTime) -> list[Cell]:
    status = run.status if run.judged else "unknown"
    return cells(
        Cell(text=run.case.case, code=True),
        Cell(text=run.word("program"), code=True),
        duration(run.value("measured")),
        duration(run.value("stops")),
        duration(run.value("predicted")),
        relative(run.error, signed),
        duration(run.value(NAIVE)),
        relative(run.value(f"error of {NAIVE}"), signed),
        relative(run.value(f"error of {OVERRIDE_ONLY}"), signed),
        percent(run.value("feed read from speeds"), 1.0),
        Cell(text=run.status if run.judged else _why_not(run), status=status),
    )


def _why_not(run: RunTime) -> str:
    if run.case.role == "training":
        return "fitted on"
    return "not judged" if run.word("completed") == "yes" else "not completed"


def _types_table(runs: Sequence[RunTime], made: Sequence[Source]) -> Table | None:
    """Measured and predicted time of each type of block, over all judged runs."""
    judged = [run for run in runs if run.judged]
    over = "the judged runs" if judged else "all runs, none of which is judged"
    by_type: dict[str, list[Score]] = {}
    for run in judged or runs:
        for name, score in run.by_type.items():
            by_type.setdefault(name, []).append(score)
    sums = {name: _sums(scores) for name, scores in by_type.items()}
    if not sums:
        return None
    whole = sum(abs(predicted - measured) for measured, predicted in sums.values())
    return Table(
        caption=f"By type of block, over {over}",
        heads=[
            Head(name="Type of block"),
            *numbers(("measured", ""), ("predicted", ""), ("difference", "s"), ("error", "%")),
            *numbers(("share of all differences", "")),
        ],
        rows=[
            cells(
                name, duration(measured), duration(predicted), signed(predicted - measured),
                relative(100 * (predicted / measured - 1) if measured > 0 else None, signed),
                percent(abs(predicted - measured), whole),
            )
            for name, (measured, predicted) in sums.items()
        ],
        sources=list(made),
    )  # fmt: skip


def measured_time(score: Score) -> float:
    """Measured time of a score of one run [s], from its bias and its error of the mean."""
    if score.bias is None or not score.mean_percent:
        return 0.0
    return 100 * score.bias / score.mean_percent


def _sums(scores: Sequence[Score]) -> tuple[float, float]:
    """Measured and predicted time of scores together [s]."""
    measured = sum(measured_time(s) for s in scores)
    return measured, measured + sum(s.bias or 0.0 for s in scores)
