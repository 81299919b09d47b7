"""Page of the control: what it does with a program, predicted beside measured times."""

from pipeline.charts.numbers import counted, duration, percent, quantity, relative, signed
from pipeline.charts.parameters import fit_words
from pipeline.charts.submodel_page import PageContent, declared, made_from
from pipeline.charts.tables import Column, Table, tabulated
from pipeline.charts.words import page_words
from pipeline.schema.verdict import Score
from pipeline.submodels.contract import Shown
from pipeline.submodels.control.segments import TIME
from pipeline.twin.control import WHOLE, ControlModelFile

WORDS = page_words(__file__)


def content(shown: Shown[ControlModelFile]) -> PageContent:
    """Page content of the control."""
    return declared(
        WORDS,
        facts=[] if shown.model is None else [_found_from(shown.model)],
        meaning=lambda group, name: meaning(name),
        of_judgement=[_types(shown)],
    )


def meaning(name: str) -> str:
    """Meaning of a parameter, with the axes and the machine behind its name.

    >>> meaning("rapid_speed XY@mill02"), meaning("other Z")
    ('greatest speed in rapids (X, Y), on mill02', '–')
    """
    name, _, unit = name.partition("@")
    key, _, axes = name.partition(" ")
    if key not in WORDS.meanings:
        return "–"
    of_axes = f" ({', '.join(axes)})" if axes else ""
    return f"{WORDS.meanings[key]}{of_axes}{f', on {unit}' if unit else ''}"


def _found_from(model: ControlModelFile) -> str:
    fit = model.fit
    words = WORDS(
        "runs.cut", programs=counted(len(set(model.programs.values())), "program"),
        stretches=counted(fit.segments, "stretch", "stretches"),
    )  # fmt: skip
    rmse = "" if fit.rmse_s is None else quantity(fit.rmse_s, "s")
    said = WORDS("runs.fit", rmse=rmse) if rmse else ""
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
