"""Intervals of the spindle's temperature and errors of the parts of its days, in tables."""

from collections.abc import Sequence

from pipeline.charts.numbers import fixed, hours, number
from pipeline.charts.sources import Source
from pipeline.charts.tables import Head, Table, cells, names, numbers
from pipeline.schema.verdict import Figures as Errors
from pipeline.schema.verdict import Score, Verdict
from pipeline.submodels.spindle.days import APART, FREE_RUN, WINDOWS
from pipeline.twin.spindle import TARGET, SpindleModelFile

JUDGES = (
    ("physics", "Physics alone"),
    ("forest", "With the forest"),
    ("persistence", "Persistence"),
    ("day_mean", "Day’s mean"),
)
"""Predictions beside the model's, with their heads."""


def score_of(verdict: Verdict | None, regime: str) -> Score | None:
    """Score of a regime over all days that decided."""
    if verdict is None:
        return None
    found = [s for s in verdict.of(TARGET, group="all", role=verdict.judged_role)
             if s.regime == regime]  # fmt: skip
    return found[0] if found else None


def width_words(model: SpindleModelFile | None) -> str | None:
    """Narrowest and widest half width of the interval in windows; None where there is none."""
    if model is None or model.intervals is None:
        return None
    half = sorted(max(band.lower, band.upper) for band in model.intervals.windows.values())
    return f"± {fixed(half[0], 1)} to {fixed(half[-1], 1)} K"


def coverage_words(score: Score | None) -> str:
    """Share of the judged samples that lay inside the interval, with its limits."""
    if score is None or score.coverage_90 is None:
        return "not judged"
    if score.unknown_interval:
        return score.unknown_interval
    words = f"held {fixed(100 * score.coverage_90, 0)} % of the judged days"
    if score.coverage_limits is None:
        return words
    return f"{words}, limit at least {100 * score.coverage_limits[0]:g} %"


def intervals_table(model: SpindleModelFile, made: Sequence[Source]) -> Table | None:
    """Half widths of the 90 % intervals by regime, calibrated on training days left out."""
    if model.intervals is None:
        return None
    kinds = ((WINDOWS, model.intervals.windows), (FREE_RUN, model.intervals.free_run))
    return Table(
        caption="90 % interval of the temperature, by what the model expects and how long ago the "
        "temperature was measured",
        note="Calibrated on training days that the predicting model had not seen."
        + (" In windows the width follows the errors of the day that are known by then."
           if model.intervals.follow.step > 0 else ""),
        heads=[
            *names("Given the temperature", "regime"),
            *numbers(("half width", "K"), ("days", ""), ("samples", "")),
        ],
        rows=[
            cells(
                "once an hour" if kind == WINDOWS else "once a day", regime or "any other",
                fixed(max(band.lower, band.upper), 2), number(band.groups), number(band.n),
            )
            for kind, bands in kinds
            for regime, band in bands.items()
        ],
        sources=list(made),
        folded=True,
    )  # fmt: skip


def parts_table(v: Verdict, made: Sequence[Source], step_s: float) -> Table | None:
    """Errors over all days of the first hour after a start and of cooling, with the interval."""
    every = [(one, score_of(v, one)) for one in (WINDOWS, FREE_RUN, *APART)]
    rows = [(one, score) for one, score in every if score is not None]
    if len(rows) < 3:
        return None
    judges = [(k, w) for k, w in JUDGES if any(k in s.others for _, s in rows)]
    heads = [Head(name="Part of the days"), Head(name="judged", unit="h", numeric=True)]
    for word in ("Model", *(w for _, w in judges)):
        heads += numbers(("MAE", "K"), ("RMSE", "K"), group=word)
    heads += numbers(("inside 90 % interval", "%"))
    return Table(
        caption="Errors of the whole days, of the first hour after a start and of cooling",
        heads=heads,
        rows=[
            cells(
                one, hours(step_s * score.n),
                *(
                    fixed(value, 2)
                    for found in (score, *(score.baselines.get(k, Errors()) for k, _ in judges))
                    for value in (found.mae, found.rmse)
                ),
                "–" if score.coverage_90 is None else fixed(100 * score.coverage_90, 1),
            )
            for one, score in rows
        ],
        sources=list(made),
    )  # fmt: skip
