"""Page of spindle growth: first hour, faulty sensors, methods, errors after starts and stops."""

from collections.abc import Iterator

import numpy as np

from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried, case_words
from pipeline.charts.numbers import NARROW, TOGETHER, counted, fixed, number, signed
from pipeline.charts.parameters import listed
from pipeline.charts.sections import Action, Section, present
from pipeline.charts.submodel_page import Counting, PageContent, made_from
from pipeline.charts.tables import Cell, Column, Table, tabulated
from pipeline.schema.si import MINUTE
from pipeline.schema.verdict import Score
from pipeline.submodels.deformation.figures import (
    GOAL_MAPE,
    GOAL_MAX_UM,
    GROUP_NAMES,
    FirstHour,
    GrowthFacts,
    Seen,
    SensorFault,
    network_figures,
    signal_legend,
    signal_strips,
    transition_figures,
    um,
)
from pipeline.submodels.deformation.methods import METHODS, PERSISTENCE
from pipeline.submodels.deformation.model import DeformationModel
from pipeline.submodels.deformation.records import GROWTH
from pipeline.submodels.deformation.sensors import DEAD

COUNTS = (
    Counting(key="growth_max_um", name="Largest error of the growth", quantity=GROWTH, error="max",
             whole=True),
    Counting(key="growth_rmse_um", name="RMSE of the growth", quantity=GROWTH, whole=True),
)  # fmt: skip
"""Errors that count, over all recordings."""


def content(shown: Seen) -> PageContent:
    """Page content of spindle growth."""
    facts, model = GrowthFacts(shown=shown), shown.model
    warm = _warm_words(facts)
    load = f"kerf thermal-growth --machine {shown.machine} --out FILE"
    titles = {name: one.label for name, one in METHODS.items()}
    return PageContent(
        about="A spindle lengthens as it warms, and the tool goes with it towards the workpiece. "
        "The model gives the growth since the start from the temperatures along the spindle, its "
        "speed and the air, so that the control can take it off.",
        rules="A growth that is right when the spindle is warm may be wrong while it warms or "
        "cools, so the errors stand apart. The fixed interval is that of the temperatures alone; "
        "the other one follows the probe where one is left in the machine.",
        case="recording",
        counts=COUNTS,
        guess=PERSISTENCE,
        titles=titles,
        todo={
            "passed": _sentence(f"{warm}, or load the correction ({load})" if warm else
                                f"load the correction ({load})"),
            "failed": "Load no correction from this model; measure the growth before finishing.",
            "unknown": "Record further speed profiles that the model is not fitted on.",
        },
        facts=_goal_words(facts),
        head=_key_figures(facts),
        notes=[_faults_words(facts)],
        actions=list(_actions(facts, warm)),
        meaning=listed({
            f"{name}_growth_per_kelvin": f"growth for each kelvin of the sensors at the {name}"
            for name in GROUP_NAMES
        }),
        figures=[] if model is None else [network_figures(shown, model)],
        tried=[] if model is None else list(_tried(shown, model)),
        drawn=[Drawn(
            quantity=GROWTH, error="max", axis="Time, min", factor=1 / MINUTE,
            beside=lambda case: signal_strips(facts, case), legend=signal_legend(facts),
        )],
        shown_facts=("R", "MAPE", "range", "faulty", "largest error"),
        of_judgement=[transition_figures(facts)],
        first=[_expected(facts)],
    )  # fmt: skip


# ---- in words


def _sentence(words: str) -> str:
    return f"{words[:1].upper()}{words[1:].rstrip('.')}."


def _speed_words(speed: float | None) -> str:
    return "" if speed is None else f" at up to {number(round(speed))}{NARROW}rev/min"


def _interval_words(facts: GrowthFacts, hour: FirstHour) -> str:
    verdict = facts.shown.verdict
    if verdict is not None and (GROWTH, "") in verdict.unknown_intervals:
        return "90 % interval not known"
    return f"90 % interval {fixed(hour.low, 0)} to {um(hour.high)}"


def _hour_words(facts: GrowthFacts) -> str:
    """Growth of the first hour, with its interval; empty where nothing is predicted."""
    hour = facts.first_hour
    if hour is None:
        return ""
    return (
        f"In its first hour{_speed_words(hour.speed)} the spindle grows by up to "
        f"{um(hour.growth)} ({_interval_words(facts, hour)})"
    )


def _warm_words(facts: GrowthFacts) -> str:
    """Advice on the warm-up time; empty where nothing is predicted."""
    hour, verdict = facts.first_hour, facts.shown.verdict
    if hour is None:
        return ""
    sure = verdict is not None and verdict.status == "passed"
    rest = f" (the rest of the hour then moves less than {um(hour.within_um)})"
    return (
        f"warm up for {fixed(np.ceil(hour.settled_min), 0)}{TOGETHER}min"
        f"{_speed_words(hour.speed)} before finishing cuts"
        f"{rest if sure else ' and measure what it then still grows'}"
    )


def _key_figures(facts: GrowthFacts) -> list[tuple[str, str, str]]:
    found = []
    if (hour := facts.first_hour) is not None:
        aside = f"{_interval_words(facts, hour)},{_speed_words(hour.speed)}".rstrip(",")
        found.append(("Growth in the first hour", um(hour.growth), aside))
    if facts.faults:
        named = ", ".join(one.sensor for one in facts.faults)
        found.append(("Faulty temperature sensors", str(len(facts.faults)), named))
    return found


def _goal_words(facts: GrowthFacts) -> list[str]:
    verdict = facts.shown.verdict
    largest = COUNTS[0].worst(verdict)
    known = [] if verdict is None else [
        float(fact.value) for case in verdict.cases if case.role == verdict.judged_role
        for name, fact in case.facts.items()
        if name.startswith("MAPE") and isinstance(fact.value, float | int)
    ]  # fmt: skip
    goals = (
        f"Goals (FFNN2015): largest error below {um(GOAL_MAX_UM)} and relative error (MAPE, "
        f"growth below 5 µm counting as 5 µm) below {fixed(GOAL_MAPE, 1)} %."
    )
    if largest is None or largest.max is None or not known:
        return [goals]
    met = ["met" if value < goal else "missed"
           for value, goal in ((largest.max, GOAL_MAX_UM), (max(known), GOAL_MAPE))]  # fmt: skip
    return [
        f"{goals} The method that serves: largest error {um(largest.max, 1)}, {met[0]}; MAPE up "
        f"to {fixed(max(known), 1)} %, {met[1]}. The published figures rest on a test run that may "
        "be the training run."
    ]


# ---- faulty sensors


def _fault_words(one: SensorFault) -> str:
    off = ""
    if one.worst_K is not None:
        side = "high" if one.worst_K > 0 else "low"
        off = f", reads up to {fixed(abs(one.worst_K), 1)}{TOGETHER}K too {side}"
    return (
        f"{one.kind} since {case_words(one.case)}, minute {fixed(one.minute, 0)} ({one.moment})"
        f"{off}, in {counted(one.cases, 'recording')}, last in {case_words(one.last)}"
    )


def _cost_words(facts: GrowthFacts) -> str:
    if facts.cost is None:
        return ""
    return (
        f"Read as they are they would put the predicted growth off by up to {um(facts.cost[0])}; "
        f"the model does without them and is off by up to {um(facts.cost[1], 1)}."
    )


def _faults_words(facts: GrowthFacts) -> str:
    said = "; ".join(f"{one.sensor} is {_fault_words(one)}" for one in facts.faults)
    return f"Temperature sensors: {said}. {_cost_words(facts)}".rstrip() if said else ""


def _actions(facts: GrowthFacts, warm: str) -> Iterator[Action]:
    """Sensors to be mended, and how to keep the growth out of finishing cuts."""
    for one in facts.faults:
        if one.lasts:
            yield Action(
                what="Reconnect or replace the sensor" if one.kind == DEAD
                else "Replace the sensor",
                where=f"{one.sensor} ({one.place})",
                why=f"It is {_fault_words(one)}. The model does without it.",
                until="next stop", who="maintenance", evidence="growth",
            )  # fmt: skip
    verdict = facts.shown.verdict
    if warm and verdict is not None and verdict.status in ("passed", "failed"):
        failed = " That model failed." if verdict.status == "failed" else ""
        yield Action(
            what=warm[:1].upper() + warm[1:], where="Spindle",
            why=f"{_hour_words(facts)}.{failed}", until="before finishing cuts",
            who="process engineer", evidence="growth",
        )  # fmt: skip


def _todo(one: SensorFault) -> str:
    if not one.lasts:
        return "nothing: the last recording is sound"
    return "check cable and plug, else replace" if one.kind == DEAD else "replace"


FAULTS: tuple[Column[SensorFault], ...] = (
    Column("Sensor", lambda one: one.sensor),
    Column("where it sits", lambda one: one.place),
    Column("is", lambda one: Cell(text=one.kind, status="failed")),
    Column("since recording", lambda one: case_words(one.case)),
    Column("at minute", lambda one: fixed(one.minute, 0), unit=""),
    Column("date", lambda one: one.moment),
    Column("off by up to", lambda one: "–" if one.worst_K is None else signed(one.worst_K), "K"),
    Column("recordings", lambda one: number(one.cases), unit=""),
    Column("last in", lambda one: case_words(one.last)),
    Column("what to do", _todo),
)


def _expected(facts: GrowthFacts) -> Section | None:
    hour = facts.first_hour
    text = []
    if hour is not None:
        text.append(
            f"{_hour_words(facts)}: the largest of {counted(hour.others, 'recording')} that last "
            f"an hour, {case_words(hour.case)}, where the probe read {um(hour.measured)} at that "
            f"time. From minute {fixed(hour.settled_min, 0)} the rest of that hour moves less than "
            f"{um(hour.within_um)}."
        )
    table: Table | None = tabulated(
        "Faulty temperature sensors", facts.faults, FAULTS, made_from(facts.shown, "verdict.json"),
        note=_cost_words(facts),
    )  # fmt: skip
    if not text and table is None:
        return None
    title = "Spindle growth: what to expect"
    return Section(key="growth", title=title, text=text, blocks=present(table))


def _tried(shown: Seen, model: DeformationModel) -> Iterator[Tried]:
    total: Score | None = COUNTS[0].worst(shown.verdict)
    for name, one in model.compared.items():
        later = None if total is None else total.baselines.get(name)
        spread = 0.5 * (one.seed_rmse_um[1] - one.seed_rmse_um[0]) if one.seeds > 1 else None
        yield Tried(label=one.label, error=one.rmse_um, unit="µm", spread=spread,
                    serves=name == model.champion,
                    later=total if name == model.champion else later)  # fmt: skip
