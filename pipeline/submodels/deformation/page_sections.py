"""Sections of the page of spindle growth: all methods compared, and where the model errs."""

import numpy as np

from pipeline.charts import default_section
from pipeline.charts.numbers import counted, fixed, joined, number, signed
from pipeline.charts.sections import (
    Block,
    Figure,
    Figures,
    Section,
    present,
)
from pipeline.charts.sources import Source
from pipeline.charts.tables import MOST_ROWS, Cell, Column, Table, code, tabulated
from pipeline.nets.settings import FuzzyFilteredSettings
from pipeline.schema.verdict import Score
from pipeline.submodels.deformation import figures
from pipeline.submodels.deformation.growth_facts import (
    GOAL_MAPE,
    GOAL_MAX_UM,
    GrowthFacts,
    condition,
    judged_on,
    made_from,
    short,
    um,
)
from pipeline.submodels.deformation.model import (
    COOLING,
    REGIMES,
    WARMING,
    MethodScore,
    MethodsFile,
)

FOLLOWED = "growth, interval follows the probe"
"""Name of the same prediction with the interval that follows the probe."""


# ---- which method


def compared_section(facts: GrowthFacts) -> Section | None:
    """All methods beside each other, and who wins."""
    model = facts.shown.model
    if model is None:
        return None
    return Section(
        key="growth-methods",
        title="Spindle growth: methods compared",
        text=[winner_words(facts), _goal_words(facts)],
        blocks=present(_methods_table(facts), _network(facts)),
    )


def winner_words(facts: GrowthFacts) -> str:
    """Which method serves, which is best, and where the fuzzy-filtered network stands."""
    model = facts.shown.model
    if model is None:
        return ""
    table = facts.methods or dict(model.compared)
    ranked = sorted(table, key=lambda name: table[name].rmse_um)
    own, best = table[model.champion], table[ranked[0]]
    where = judged_on(facts) if facts.methods else "training recordings left out in turn"
    said = (
        f"“{own.label}” serves: of {counted(len(model.compared), 'method')} it errs least on "
        "training recordings left out in turn. "
    )
    if ranked[0] == model.champion:
        said += f"On {where} it wins again, with an RMSE of {um(own.rmse_um, 2)}. "
    elif um(best.rmse_um, 2) == um(own.rmse_um, 2):
        said += f"On {where} “{best.label}” is level with it: RMSE {um(own.rmse_um, 2)}. "
    else:
        said += (
            f"On {where} “{best.label}” does better: RMSE {um(best.rmse_um, 2)} against "
            f"{um(own.rmse_um, 2)}. "
        )
    networks = [n for n in ranked if n.startswith("ffnn") and n != "ffnn_classic"]
    if networks and networks[0] != ranked[0]:
        place = ranked.index(networks[0]) + 1
        said += (
            f"The best improved fuzzy-filtered network, “{table[networks[0]].label}”, comes "
            f"{place}{_ordinal(place)} with {um(table[networks[0]].rmse_um, 2)}: on these "
            "recordings it does not win."
        )
    elif networks:
        said += "It is the improved fuzzy-filtered network."
    return said.strip()


def _ordinal(place: int) -> str:
    return {1: "st", 2: "nd", 3: "rd"}.get(place if place < 20 else place % 10, "th")


def _goal_words(facts: GrowthFacts) -> str:
    """Goals of the paper beside what the method that serves reaches."""
    model = facts.shown.model
    own = None if model is None else facts.methods.get(model.champion)
    goals = (
        f"Goals (FFNN2015): largest error below {um(GOAL_MAX_UM)} and relative error (MAPE, "
        f"growth below 5 µm counting as 5 µm) below {fixed(GOAL_MAPE, 1)} %."
    )
    if own is None:
        return goals
    largest = "met" if own.max_um < GOAL_MAX_UM else "missed"
    relative = "met" if own.mape_percent < GOAL_MAPE else "missed"
    return (
        f"{goals} The method that serves: largest error {um(own.max_um)}, {largest}; relative "
        f"error {fixed(own.mape_percent, 1)} %, {relative}. The published figures rest on a test "
        "run that may be the training run."
    )


def _methods_table(facts: GrowthFacts) -> Table | None:
    """Errors of all methods on the recordings that decide."""
    model = facts.shown.model
    if model is None:
        return None
    judged = facts.methods
    things = list((judged or dict(model.compared)).items())
    if not judged:
        things.sort(key=lambda one: one[1].rmse_um)
    where = "Held out" if judged else "Left out"
    columns: list[Column[tuple[str, MethodScore]]] = [
        Column("Method", lambda one: one[1].label + (" (serves)" if one[0] == model.champion
                                                     else "")),
        Column("RMSE", lambda one: fixed(one[1].rmse_um, 2), unit="µm", group=where),
        Column("largest error", lambda one: _goal(one[1].max_um, GOAL_MAX_UM), unit="µm",
               group=where),
        Column("R", lambda one: "–" if one[1].r is None else fixed(one[1].r, 4), unit="",
               group=where),
        Column("MAPE", lambda one: _goal(one[1].mape_percent, GOAL_MAPE), unit="%", group=where),
        Column("RMSE of single seeds", lambda one: _seeds(one[1]), unit="µm", group=where),
    ]  # fmt: skip
    if judged:
        columns.append(Column(
            "RMSE", lambda one: fixed(model.compared[one[0]].rmse_um, 2), unit="µm",
            group="Left out",
        ))  # fmt: skip
    return tabulated(
        "All methods on whole recordings that their fit did not see", things, columns,
        made_from(facts, "model.json", "predictions.parquet"),
        note="Held out: recordings that decide. Left out: training recordings, each predicted by "
        "a fit of others. Green where the goal is met. A method that depends on chance is the mean "
        "of its seeds; the last but one column is the range of single ones." if judged else "",
    )  # fmt: skip


def _goal(value: float, goal: float) -> Cell:
    """A value that is ticked where it meets its goal."""
    return Cell(text=fixed(value, 1), status="passed" if value < goal else "")


def _seeds(one: MethodScore) -> str:
    low, high = one.seed_rmse_um
    return "–" if one.seeds == 1 else f"{fixed(low, 2)} to {fixed(high, 2)}"


def _network(facts: GrowthFacts) -> Figures | None:
    """Bands of the best improved network over the sensors, and the groups of sensors."""
    shown = facts.shown
    if shown.model is None:
        return None
    path = shown.folder / "methods.json"
    stored = shown.shelf.read(path, MethodsFile, "the training recordings")
    weights = np.array(shown.model.inputs.weights)
    table = facts.methods or dict(shown.model.compared)
    improved = [] if stored is None else [
        name for name in sorted(table, key=lambda n: table[n].rmse_um)
        if (docs := stored.documents.get(name, ()))
        and docs[0].get("kind") == FuzzyFilteredSettings.kind
    ]  # fmt: skip
    bands = None
    words = "Weight of each sensor in the temperatures of front, middle and rear (fuzzy c-means)"
    if stored is not None and improved:
        bands = figures.network_bands(stored.documents[improved[0]][0], weights.shape[1])
        centres = joined([fixed(c + 1, 1) for c, _ in bands])
        words = (
            f"Above: bands of “{table[improved[0]].label}” (first seed) over the sensors, centred "
            f"at sensor {centres}. Below: weight of each sensor in the temperatures of front, "
            "middle and rear (fuzzy c-means)"
        )
    names = "; ".join(f"{k + 1} {name}" for k, name in enumerate(shown.model.sensors.sensors))
    caption = f"{words}. Sensors: {names}."
    figure = Figure(svg=figures.network_figure(bands, weights, caption), caption=caption,
                    sources=made_from(facts, "model.json", "methods.json"))  # fmt: skip
    legend = [
        (f"s-{css}", name, "box")
        for css, name in zip(figures.GROUP_CURVES, figures.GROUP_NAMES, strict=True)
    ]
    return Figures(figures=[figure], legend=legend, kind="one",
                   folded="How the sensors are grouped, and what the network looks at")  # fmt: skip


# ---- where it errs


def errors_section(facts: GrowthFacts) -> Section | None:
    """Errors by regime, after starts and stops, by recording."""
    shown = facts.shown
    if shown.verdict is None:
        return None
    made = made_from(facts, "verdict.json")
    blocks: list[Block | None] = [
        _regimes_table(facts, made),
        _transitions(facts),
        _recordings_table(facts, made),
        default_section.outside_table(shown.verdict, made),
        default_section.left_out_table(shown.verdict, made),
    ]
    if shown.model is not None:
        blocks.append(default_section.training_table(shown.model, made_from(facts, "model.json")))
    return Section(
        key="growth-errors",
        title="Spindle growth: where the model errs",
        text=[
            "A growth that is right when the spindle is warm may be wrong while it warms or cools, "
            "so the errors stand apart. The fixed interval is that of the temperatures alone; the "
            "other one follows the probe where one is left in the machine.",
        ],
        blocks=present(*blocks),
    )


def _regimes_table(facts: GrowthFacts, made: list[Source]) -> Table | None:
    """Errors and coverage while warming, cooling and steady."""
    things = [(name, score) for name in REGIMES if (score := facts.of_all(name)) is not None]

    def followed(name: str) -> str:
        score = facts.of_all(name, FOLLOWED)
        return _percent(None if score is None else score.coverage_90)

    columns: list[Column[tuple[str, Score]]] = [
        Column("While the spindle is", lambda one: one[0]),
        Column("samples", lambda one: number(one[1].n), unit=""),
        Column("MAE", lambda one: fixed(one[1].mae, 2), unit="µm"),
        Column("RMSE", lambda one: fixed(one[1].rmse, 2), unit="µm"),
        Column("largest error", lambda one: fixed(one[1].max, 1), unit="µm"),
        Column("fixed", lambda one: _percent(one[1].coverage_90), unit="%",
               group="Inside the 90 % interval"),
        Column("follows the probe", lambda one: followed(one[0]), unit="%",
               group="Inside the 90 % interval"),
    ]  # fmt: skip
    return tabulated(f"Errors by regime, {judged_on(facts)}", things, columns, made)


def _recordings_table(facts: GrowthFacts, made: list[Source]) -> Table | None:
    """Errors of the model that serves, recording by recording, the worst first."""
    verdict = facts.shown.verdict
    faulty = {} if verdict is None else {
        c.case: joined([str(f.value).split()[1] for name, f in c.facts.items()
                        if name.startswith("faulty")] or ["–"])
        for c in verdict.cases
    }  # fmt: skip

    def speed(one: Score) -> str:
        value = condition(verdict, one.group, "highest speed")
        return "–" if value is None else number(round(value))

    columns: list[Column[Score]] = [
        Column("Recording", lambda one: code(short(one.group))),
        Column("highest speed", speed, unit="rev/min"),
        Column("samples", lambda one: number(one.n), unit=""),
        Column("MAE", lambda one: fixed(one.mae, 2), unit="µm"),
        Column("RMSE", lambda one: fixed(one.rmse, 2), unit="µm"),
        Column("largest error", lambda one: fixed(one.max, 1), unit="µm"),
        Column("bias", lambda one: signed(one.bias, 2), unit="µm"),
        Column("inside 90 % interval", lambda one: _percent(one.coverage_90), unit="%"),
        Column("faulty sensors", lambda one: faulty.get(one.group, "–")),
    ]  # fmt: skip
    things = facts.ranked()[::-1]
    return tabulated(f"Errors by recording ({len(things)})", things, columns, made,
                     most=MOST_ROWS, folded=True)  # fmt: skip


def _percent(share: float | None) -> str:
    return "–" if share is None else fixed(100 * share, 1)


def _transitions(facts: GrowthFacts) -> Figures | None:
    """Errors over the time since the spindle began to warm, and since it began to cool."""
    found = {
        regime: one for regime in (WARMING, COOLING)
        if (one := figures.transitions(facts.runs(regime))) is not None
    }  # fmt: skip
    if not found:
        return None
    reach = 1.1 * max([facts.limit or 0.1, *(one.widest for one in found.values())])
    drawn = []
    for regime, one in found.items():
        verb = "start or a higher speed" if regime == WARMING else "stop or a lower speed"
        caption = (
            f"After a {verb}: error of the model since the spindle began "
            f"{'to warm' if regime == WARMING else 'to cool'}, over {counted(one.count, 'time')}; "
            f"90 % of the samples lie within {um(one.widest)}."
        )
        drawn.append(Figure(
            svg=figures.transition_figure(one, reach, facts.limit, caption), caption=caption,
            sources=made_from(facts, "predictions.parquet"),
        ))  # fmt: skip
    legend = [("l-window", "median", "line"), ("s-band", "90 % of the samples", "box")]
    if facts.limit is not None:
        legend.append(("l-limit", f"limit of the largest error, ±{um(facts.limit)}", "dots"))
    return Figures(figures=drawn, legend=legend)
