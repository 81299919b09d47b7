"""Page of the feed drives in the words of the shop floor: verdict, recordings against the twin."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pipeline.charts import sections, tables
from pipeline.charts.bands import readings
from pipeline.charts.numbers import (
    NARROW,
    NOT_KNOWN,
    TOGETHER,
    counted,
    joined,
    number,
    percent,
    quantity,
    real,
    relative,
    rounded,
)
from pipeline.schema.drive import (
    COMMAND,
    FOLLOWING,
    FORCE,
    LAG,
    LEVEL,
    SPEED,
    DriveAxis,
    DriveModel,
)
from pipeline.schema.verdict import JudgedCase, Score, Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.drive.figures import (
    Curve,
    DriveTrace,
    closest_look,
    drawn_bands,
    trace_figure,
)
from pipeline.submodels.drive.page_axes import drives_section, undetermined_words
from pipeline.submodels.drive.page_disturbance import causes_words, disturbances_table
from pipeline.submodels.drive.page_parameters import (
    identified_axes,
    made_from,
    truth_table,
    truth_words,
)
from pipeline.submodels.drive.records import BLOCK

FORCE_NOTE = (
    "Force: error of the force that the recorded motion needs, over the measured force; its "
    "plain guess is one constant level against the motion."
)
LEVEL_NOTE = (
    "Means: of the force against motion, measured and by the model, whose friction levels they "
    "judge where single samples are rough."
)
FOLLOWING_NOTE = (
    "Following error: the twin runs the recorded reference alone; errors over the record’s own "
    "RMS and maximum; its plain guess is speed over loop gain."
)


@dataclass(frozen=True, kw_only=True)
class DriveRun:
    """One axis in one recording, held against the twin.

    ``scores`` are those that are shown, of the force and of the following error.
    """

    axis: str
    case: JudgedCase
    scores: Mapping[str, Score]

    @property
    def training(self) -> bool:
        """Whether the drives were identified from it."""
        return self.case.role == "training"

    @property
    def status(self) -> str:
        """``passed``, ``failed``, or ``unknown`` where it does not count."""
        found = {one.status for one in self.scores.values()}
        return "failed" if "failed" in found else "passed" if "passed" in found else "unknown"

    @property
    def judged(self) -> bool:
        """Whether it counts: no training recording, and it could be judged."""
        return not self.training and self.status != "unknown"

    def error(self, kind: str) -> float | None:
        """Error of the force or the following error, RMS over its own RMS [%]."""
        score = self.scores.get(kind)
        return None if score is None else score.relative_percent

    def fact(self, name: str) -> float | None:
        """A number that was said of the recording."""
        found = self.case.facts.get(name)
        return None if found is None else real(found.value)


@dataclass(frozen=True, kw_only=True)
class Driven:
    """What is known of the drives, and the files that it stands in."""

    shown: Shown[DriveModel]
    runs: list[DriveRun]

    @classmethod
    def of(cls, shown: Shown[DriveModel]) -> "Driven":
        """Runs by axis, the judged first, then by name."""
        return cls(shown=shown, runs=[] if shown.verdict is None else _runs(shown.verdict))

    @property
    def axes(self) -> dict[str, DriveAxis]:
        """Identified axes by letter."""
        return identified_axes(self.shown)

    @property
    def judged(self) -> list[DriveRun]:
        """Those that count."""
        return [run for run in self.runs if run.judged]

    def limit(self, quantity: str) -> float | None:
        """Largest relative error of a quantity that passes [%]."""
        scores = () if self.shown.verdict is None else self.shown.verdict.scores
        limits = [
            s.limits["relative_percent"] for s in scores
            if s.quantity.startswith(quantity) and "relative_percent" in s.limits
        ]  # fmt: skip
        return limits[0] if limits else None


def _runs(verdict: Verdict) -> list[DriveRun]:
    scores = {(s.quantity, s.group, s.role): s for s in verdict.scores}
    letters = sorted({s.quantity.rpartition(" ")[2] for s in verdict.scores})
    runs = []
    for letter in letters:
        for case in verdict.cases:
            found = {
                kind: score
                for kind in (FORCE, FOLLOWING)
                if (score := scores.get((f"{kind} {letter}", case.group, case.role))) is not None
            }
            # an axis that a recording shows has a highest speed there
            if found or f"highest speed {letter}" in case.conditions:
                runs.append(DriveRun(axis=letter, case=case, scores=found))
    return sorted(runs, key=lambda r: (r.axis, r.training, r.case.case))


def worst(runs: list[DriveRun], kind: str) -> tuple[DriveRun, float] | None:
    """The run with the greatest error of the force or the following error, and that error [%]."""
    known = [(run, error) for run in runs if (error := run.error(kind)) is not None]
    return max(known, key=lambda one: one[1], default=None)


def drive_page(shown: Shown[DriveModel]) -> sections.SubModelPage | None:
    """Verdict, key figures and sections on the feed drives; None where nothing is known of them."""
    if shown.model is None and shown.verdict is None:
        return None
    drives = Driven.of(shown)
    truth = truth_table(shown)
    return sections.SubModelPage(
        verdict=drives_verdict(drives),
        key_figures=_key_figures(drives),
        notes=[
            words
            for words in (undetermined_words(shown), truth_words(truth) if truth else "")
            if words
        ],
        sections=[one for one in (drives_section(shown), following_section(drives)) if one],
        truth=[truth] if truth is not None else [],
        compared=_compared(drives),
    )


def drives_verdict(drives: Driven) -> sections.PartVerdict | None:
    """Whether the twin's axes move as the machine's do; None when they were never compared."""
    verdict = drives.shown.verdict
    if verdict is None:
        return None
    failed = [run for run in drives.judged if run.status == "failed"]
    if failed:
        return _failed(drives, failed)
    if not drives.judged or verdict.status != "passed":
        return _unjudged(drives, verdict)
    axes = _axes_of(drives.judged)
    follow = "axis follows its" if len(axes) == 1 else "axes follow their"
    return sections.PartVerdict(
        status="passed",
        sentence=f"The twin’s {joined(axes)} {follow} records: on {_judged_words(drives.judged)} "
        f"{errors_words(drives, drives.judged)}.",
        todo="The twin’s axes move as the machine’s do.",
    )


def _failed(drives: Driven, failed: list[DriveRun]) -> sections.PartVerdict:
    axes = _axes_of(failed)
    good = [axis for axis in _axes_of(drives.judged) if axis not in axes]
    follow = "axis does not follow its" if len(axes) == 1 else "axes do not follow their"
    judged = [run for run in drives.judged if run.axis in axes]
    rest = f"; {joined(good)} {'does' if len(good) == 1 else 'do'}" if good else ""
    return sections.PartVerdict(
        status="failed",
        sentence=f"The twin’s {joined(axes)} {follow} records: on {_recordings(failed)} of "
        f"{_judged_words(judged)} {errors_words(drives, failed)}{rest}."
        + causes_words([(run.axis, run.case) for run in failed]),
        todo=f"Do not plan with the twin’s {joined(axes)} yet. Where an axis was serviced after "
        "its training records, record its reciprocation again; else the table of recordings "
        "says which motion the twin gets wrong.",
    )


def _unjudged(drives: Driven, verdict: Verdict) -> sections.PartVerdict:
    why = "; ".join(verdict.reasons) or "no recording of an axis was left to judge by"
    part = ""
    if drives.judged:
        part = f" On the judged recordings {errors_words(drives, drives.judged)}."
    if verdict.status == "failed":
        return sections.PartVerdict(
            status="failed",
            sentence=f"The verdict on the twin’s drives does not hold: {why.rstrip('.')}.{part}",
            todo="Put the records right that it names, and judge again.",
        )
    return sections.PartVerdict(
        status="unknown",
        sentence=f"The twin’s drives were not judged: {why.rstrip('.')}.{part}",
        todo="Keep one recording of each axis out of roles.training, to judge the drives by.",
    )


def errors_words(drives: Driven, runs: list[DriveRun]) -> str:
    """The worst errors of ``runs`` against their limits; where runs failed only what is beyond."""
    known = [
        (words, found[1], drives.limit(kind))
        for kind, words in ((FORCE, "the force"), (FOLLOWING, "the following error"))
        if (found := worst(runs, kind)) is not None
    ]
    beyond = [one for one in known if one[2] is not None and one[1] > one[2]]
    said = [
        f"{words} {'' if place else 'is wrong '}by up to {relative(error, rounded, '%')}"
        + (f" (limit {limit:g}{TOGETHER}%)" if limit is not None else "")
        for place, (words, error, limit) in enumerate(beyond or known)
    ]
    return " and ".join(said) or "no error is known"


def _axes_of(runs: list[DriveRun]) -> list[str]:
    return sorted({run.axis for run in runs})


def _judged_words(runs: list[DriveRun]) -> str:
    """How many recordings were judged; blocks of a single one are no other recordings."""
    if all(BLOCK in run.case.case for run in runs):
        return (
            f"{counted(_recordings(runs), 'block')} of the only recording’s own time (each by a "
            "drive of the others)"
        )
    return counted(_recordings(runs), "judged recording")


def _recordings(runs: list[DriveRun]) -> int:
    return len({run.case.case for run in runs})


def _key_figures(drives: Driven) -> list[tuple[str, str, str]]:
    """The worst errors of judged recordings, and whose they are."""
    found = [
        (words, worst(drives.judged, kind), drives.limit(kind))
        for kind, words in ((FORCE, "Force of the axes"), (FOLLOWING, "Following errors"))
    ]
    return [
        (words, relative(one[1], unit="%"),
         f"worst of judged recordings, axis {one[0].axis}"
         + (f", limit{TOGETHER}{limit:g}{TOGETHER}%" if limit is not None else ""))
        for words, one, limit in found if one is not None
    ]  # fmt: skip


def _compared(drives: Driven) -> dict[str, sections.Compared]:
    force, following = (worst(drives.judged, kind) for kind in (FORCE, FOLLOWING))
    judged = None if drives.shown.verdict is None else len(drives.judged)
    return {
        "drive_force_percent": sections.Compared(
            name="Error of the axes’ force, worst judged recording", unit="%",
            value=force[1] if force else None,
        ),
        "drive_following_percent": sections.Compared(
            name="Error of following errors, worst judged recording", unit="%",
            value=following[1] if following else None,
        ),
        "drives_judged": sections.Compared(name="Axes judged in recordings", unit="", value=judged),
    }  # fmt: skip


def following_section(drives: Driven) -> sections.Section | None:
    """Recordings against the twin: tables, then each axis in its most telling recording."""
    if drives.shown.verdict is None:
        return None
    verdict = drives_verdict(drives)
    text = [
        verdict.sentence if verdict is not None else "",
        "Only recordings that the drives were not identified from are judged. The force is "
        "rebuilt from the recorded motion; the following error comes from the twin’s own closed "
        "loop under the reference alone, and a recorded disturbance where the record shows "
        "it to enter.",
    ]
    text += _interval_words(drives)
    if not drives.runs:
        text.append("No axis was held against a recording.")
    drawn = [figures for axis in drives.axes if (figures := _trace_figures(drives, axis))]
    disturbed = disturbances_table(
        [(run.axis, run.case) for run in drives.runs], made_from(drives.shown, "verdict.json")
    )
    return sections.Section(
        key="following",
        title="The feed drives: records against the twin",
        text=[words for words in text if words],
        blocks=[*sections.present(runs_table(drives), disturbed), *drawn],
    )


def _interval_words(drives: Driven) -> list[str]:
    """How wide the 90 % intervals are, and how many of the judged samples they held."""
    if drives.shown.model is None:
        return []
    words = []
    for letter, axis in drives.shown.model.axes.items():
        for name, unit in ((FORCE, axis.force_unit), (FOLLOWING, "µm")):
            band = axis.intervals.get(name)
            if band is not None:
                held = _held(drives.shown.verdict, f"{name} {letter}")
                words.append(f"{name} {letter} ±{quantity(band.upper, unit)}{held}")
    if not words:
        return [
            "No prediction has an interval: fewer than two training recordings move an axis; "
            "record another one."
        ]
    return [
        f"90{NARROW}% intervals, from the errors of training recordings (each by a drive of the "
        f"others, where these determine one): {'; '.join(words)}. They are for motion like that of "
        "these recordings: another mass on the table, or faster reversals, may lie outside."
    ]


def _held(verdict: Verdict | None, name: str) -> str:
    total = None if verdict is None else verdict.total(name)
    if total is None or total.coverage_90 is None:
        return ""
    short = f", fewer than the 90{NARROW}% that are promised" if total.coverage_90 < 0.895 else ""
    return f" (held {percent(total.coverage_90, 1.0)} of the judged samples{short})"


def runs_table(drives: Driven) -> tables.Table | None:
    """Every axis in every recording, the judged first, with the plain guesses beside."""
    runs = drives.runs
    if not runs:
        return None
    force, following = (any(kind in run.scores for run in runs) for kind in (FORCE, FOLLOWING))
    reasons = any(_reason(run, drives) for run in runs)
    level = not following and any(run.fact(f"mean force {run.axis} measured") for run in runs)
    unit = next((run.scores[FORCE].unit for run in runs if FORCE in run.scores), "")
    shown = (force, level, following, reasons)
    notes = zip((FORCE_NOTE, LEVEL_NOTE, FOLLOWING_NOTE), shown, strict=False)
    return tables.Table(
        caption=f"Records against the twin{tables.left_out(len(runs), tables.MOST_ROWS)}",
        note=" ".join(words for words, there in notes if there),
        heads=[
            *tables.names("Recording", "axis"), *tables.numbers(("length", "s")),
            *(tables.numbers(("error", "%"), ("plain guess", "%"), group="Force") if force else []),
            *(tables.numbers(("mean", unit), ("modelled", unit)) if level else []),
            *(tables.numbers(("RMS", "µm"), ("max", "µm"), ("error RMS", "%"), ("error max", "%"),
                      ("error RMS", "µm"), ("plain guess", "µm"), group="Following error")
              if following else []),
            tables.Head(name="verdict"), *tables.names(*(["why"] if reasons else [])),
        ],
        rows=[_run_row(run, drives, shown) for run in runs[:tables.MOST_ROWS]],
        sources=made_from(drives.shown, "verdict.json"),
        folded=len(runs) > 40,
    )  # fmt: skip


def _run_row(
    run: DriveRun, drives: Driven, shown: tuple[bool, bool, bool, bool]
) -> list[tables.Cell]:
    guess = run.scores[FORCE].baselines.get(LEVEL) if FORCE in run.scores else None
    forces = [relative(run.error(FORCE)), relative(guess.relative_percent if guess else None)]
    levels = [_or_dash(run.fact(f"mean force {run.axis} {w}")) for w in ("measured", "modelled")]
    return tables.cells(
        tables.Cell(text=run.case.case, code=True),
        run.axis,
        number(run.fact("length")),
        *(forces if shown[0] else []),
        *(levels if shown[1] else []),
        *(_following_cells(run.scores.get(FOLLOWING)) if shown[2] else []),
        _status_cell(run),
        *([_reason(run, drives) or "–"] if shown[3] else []),
    )


def _following_cells(score: Score | None) -> list[str]:
    """RMS and maximum as measured, errors of the model, and that of the plain guess."""
    if score is None:
        return ["–"] * 6
    guess = score.baselines.get(LAG)
    return [
        _or_dash(_measured(score.rmse, score.relative_percent)),
        _or_dash(_measured(score.max, score.max_percent)),
        relative(score.relative_percent),
        relative(score.max_percent),
        _or_dash(score.rmse),
        _or_dash(guess.rmse if guess else None),
    ]


def _measured(error: float | None, percent: float | None) -> float | None:
    """What was measured, from an error and its share of it [%]."""
    return 100 * error / percent if error is not None and percent else None


def _or_dash(value: float | None) -> str:
    return "–" if value is None else number(value)


def _status_cell(run: DriveRun) -> tables.Cell:
    if run.training:
        return tables.Cell(text="fitted on", status="unknown")
    return tables.Cell(
        text="not judged" if run.status == "unknown" else run.status, status=run.status
    )


def _reason(run: DriveRun, drives: Driven) -> str:
    """Why it failed or was not judged, less what stands with the axis already."""
    if run.training:
        return ""
    said = [
        reason.partition(": ")[2]
        for score in run.scores.values()
        for reason in score.reasons
    ]  # fmt: skip
    own = drives.axes[run.axis].servo_reason if run.axis in drives.axes else ""
    for part in run.case.note.split("; "):
        letters, _, words = part.partition(": ")
        if run.axis in letters.split(" and ") and words and words not in own:
            said.append(words)
    return "; ".join(said)


def _trace_figures(drives: Driven, axis: str) -> sections.Figures | None:
    run = telling(drives, axis)
    trace = None if run is None else drive_trace(drives.shown.predictions, run)
    bands = [] if trace is None else drawn_bands(trace, drives.axes[axis].command_unit)
    if run is None or trace is None or not bands:
        return None
    shown = [(trace.span, _trace_words(run))]
    close = closest_look(trace)
    if close is not None:
        shown.append((close, f"Axis {axis} in {trace.recording} from {number(close[0])} to "
                             f"{number(close[1])} s, where the twin is farthest off."))  # fmt: skip
    status = _status_cell(run)
    return sections.Figures(
        figures=[
            sections.Figure(svg=trace_figure(bands, span, words), caption=words,
                   sources=made_from(drives.shown, "predictions.parquet"), status=status.status,
                   status_words=status.text)
            for span, words in shown
        ],
        legend=[("l-measured", "measured", "line"), ("l-modelled", "twin", "line")],
    )  # fmt: skip


def telling(drives: Driven, axis: str) -> DriveRun | None:
    """The run of an axis that shows most: judged before fitted on, then the longest."""
    predictions = drives.shown.predictions
    if predictions is None or not len(predictions):
        return None
    drawn = set(predictions["case"].unique())
    runs = [run for run in drives.runs if run.axis == axis and run.case.case in drawn]
    return max(
        runs, key=lambda run: (run.judged, not run.training, run.fact("length") or 0.0),
        default=None,
    )  # fmt: skip


def drive_trace(predictions: pd.DataFrame | None, run: DriveRun) -> DriveTrace | None:
    """Measured and modelled signals of an axis in a recording; None where there are none."""
    if predictions is None or not len(predictions):
        return None
    rows = predictions[predictions["case"] == run.case.case]

    def curve(name: str) -> Curve | None:
        of = rows[rows["quantity"] == f"{name} {run.axis}"].sort_values("t", kind="stable")
        columns = [readings(of[c].to_numpy(float)) for c in ("t", "measured", "predicted")]
        timed = np.isfinite(columns[0])
        if timed.sum() < 2:
            return None
        seconds, measured, modelled = (values[timed] for values in columns)
        return Curve(seconds=seconds, measured=measured, modelled=modelled)

    following = curve(FOLLOWING)
    if following is None:
        return None
    return DriveTrace(
        axis=run.axis, recording=run.case.case, following=following, command=curve(COMMAND),
        speed=curve(SPEED),
    )  # fmt: skip


def _trace_words(run: DriveRun) -> str:
    """Caption of a recording: what it is, and how far the twin is off."""
    words = f"Axis {run.axis} in {run.case.case or NOT_KNOWN}"
    errors = [
        f"{name} wrong by {number(error, 2)} %"
        for name, kind in (("following error", FOLLOWING), ("force", FORCE))
        if (error := run.error(kind)) is not None
    ]
    return f"{words}: {', '.join(errors)}." if errors else f"{words}."
