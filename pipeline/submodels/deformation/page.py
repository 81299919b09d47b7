"""Page of spindle growth: first hour, faulty sensors, methods, errors after starts and stops."""

from collections.abc import Iterator

import numpy as np

from pipeline.charts.cases import Drawn
from pipeline.charts.judged import Tried, case_words
from pipeline.charts.numbers import counted, fixed, number
from pipeline.charts.sections import Action, Section, present
from pipeline.charts.submodel_page import Counting, PageContent, declared
from pipeline.charts.words import page_words
from pipeline.schema.si import MINUTE
from pipeline.submodels.deformation.figures import (
    GOAL_MAPE,
    GOAL_MAX_UM,
    FirstHour,
    GrowthFacts,
    Seen,
    network_figures,
    signal_legend,
    signal_strips,
    transition_figures,
    um,
)
from pipeline.submodels.deformation.methods import METHODS, PERSISTENCE
from pipeline.submodels.deformation.model import DeformationModel
from pipeline.submodels.deformation.records import GROWTH
from pipeline.submodels.deformation.sensors_page import (
    sensor_actions,
    sensor_key_figures,
    sensor_note,
    sensor_table,
)

WORDS = page_words(__file__)
LARGEST = Counting(**WORDS.content["counts"][0])
"""Largest error over all recordings."""


def content(shown: Seen) -> PageContent:
    """Page content of spindle growth."""
    facts, model = GrowthFacts(shown=shown), shown.model
    warm = _warm_words(facts)
    return declared(
        WORDS,
        guess=PERSISTENCE,
        titles={name: one.label for name, one in METHODS.items()},
        todo={**WORDS.content["todo"], "passed": WORDS(
            "todo.warm" if warm else "todo.load", warm=warm, machine=shown.machine
        )},
        facts=_goal_words(facts),
        head=[*_key_figures(facts), *sensor_key_figures(facts)],
        notes=[sensor_note(facts)],
        actions=list(_actions(facts, warm)),
        figures=[] if model is None else [network_figures(shown, model)],
        tried=[] if model is None else list(_tried(shown, model)),
        drawn=[Drawn(
            quantity=GROWTH, error="max", axis="Time, min", factor=1 / MINUTE,
            beside=lambda case: signal_strips(facts, case), legend=signal_legend(facts),
        )],
        of_judgement=[transition_figures(facts)],
        first=[_expected(facts)],
    )  # fmt: skip


# ---- in words


def _speed_words(speed: float | None) -> str:
    return "" if speed is None else WORDS("hour.speed", speed=number(round(speed)))


def _interval_words(facts: GrowthFacts, hour: FirstHour) -> str:
    verdict = facts.shown.verdict
    if verdict is not None and (GROWTH, "") in verdict.unknown_intervals:
        return WORDS("hour.no_interval")
    return WORDS("hour.interval", low=fixed(hour.low, 0), high=um(hour.high))


def _hour_words(facts: GrowthFacts) -> str:
    """Growth of the first hour, with its interval; empty where nothing is predicted."""
    hour = facts.first_hour
    if hour is None:
        return ""
    return WORDS("hour.growth", speed=_speed_words(hour.speed), growth=um(hour.growth),
                 interval=_interval_words(facts, hour))  # fmt: skip


def _warm_words(facts: GrowthFacts) -> str:
    """Advice on the warm-up time; empty where nothing is predicted."""
    hour, verdict = facts.first_hour, facts.shown.verdict
    if hour is None:
        return ""
    sure = verdict is not None and verdict.status == "passed"
    return WORDS(
        "warm.sure" if sure else "warm.unsure", minutes=fixed(np.ceil(hour.settled_min), 0),
        speed=_speed_words(hour.speed), within=um(hour.within_um),
    )  # fmt: skip


def _key_figures(facts: GrowthFacts) -> list[tuple[str, str, str]]:
    hour = facts.first_hour
    if hour is None:
        return []
    aside = f"{_interval_words(facts, hour)},{_speed_words(hour.speed)}".rstrip(",")
    return [(WORDS("hour.head"), um(hour.growth), aside)]


def _goal_words(facts: GrowthFacts) -> list[str]:
    verdict = facts.shown.verdict
    largest = LARGEST.worst(verdict)
    known = [] if verdict is None else [
        float(fact.value) for case in verdict.cases if case.role == verdict.judged_role
        for name, fact in case.facts.items()
        if name.startswith("MAPE") and isinstance(fact.value, float | int)
    ]  # fmt: skip
    goals = WORDS("goals.text", max=um(GOAL_MAX_UM), mape=fixed(GOAL_MAPE, 1))
    if largest is None or largest.max is None or not known:
        return [goals]
    met = ["met" if value < goal else "missed"
           for value, goal in ((largest.max, GOAL_MAX_UM), (max(known), GOAL_MAPE))]  # fmt: skip
    reached = WORDS("goals.reached", max=um(largest.max, 1), max_met=met[0],
                    mape=fixed(max(known), 1), mape_met=met[1])  # fmt: skip
    return [f"{goals} {reached}"]


def _actions(facts: GrowthFacts, warm: str) -> Iterator[Action]:
    """Sensors to be mended, and how to keep the growth out of finishing cuts."""
    yield from sensor_actions(facts)
    verdict = facts.shown.verdict
    if warm and verdict is not None and verdict.status in ("passed", "failed"):
        failed = WORDS("action.failed") if verdict.status == "failed" else ""
        yield Action(
            what=warm, where="Spindle", why=f"{_hour_words(facts)}.{failed}",
            until="before finishing cuts", who="process engineer", evidence="growth",
        )  # fmt: skip


def _expected(facts: GrowthFacts) -> Section | None:
    hour = facts.first_hour
    text = []
    if hour is not None:
        text.append(WORDS(
            "hour.text", growth=_hour_words(facts), recordings=counted(hour.others, "recording"),
            case=case_words(hour.case), measured=um(hour.measured),
            settled=fixed(hour.settled_min, 0), within=um(hour.within_um),
        ))  # fmt: skip
    table = sensor_table(facts)
    if not text and table is None:
        return None
    return Section(key="growth", title=WORDS("hour.title"), text=text, blocks=present(table))


def _tried(shown: Seen, model: DeformationModel) -> Iterator[Tried]:
    total = LARGEST.worst(shown.verdict)
    for name, one in model.compared.items():
        own = name == model.champion
        later = None if total is None else total if own else total.baselines.get(name)
        spread = 0.5 * (one.seed_rmse_um[1] - one.seed_rmse_um[0]) if one.seeds > 1 else None
        yield Tried(label=one.label, error=one.rmse_um, unit="µm", spread=spread,
                    serves=own, later=later)  # fmt: skip
