"""Drift of known kinds is asked for within three nights, with its reason; quiet weeks ask nothing.

Every sub-model is fitted on made records and judged, and its nights are scored as the command does.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pipeline.monitoring.nightly import ServingModel
from pipeline.schema.ledger import Ask, Reason
from tests.monitoring.made_nights import (
    SpindleFault,
    cutting_nights,
    cutting_serving,
    drive_nights,
    drive_serving,
    false_asks,
    first_ask,
    run,
    spindle_nights,
    spindle_serving,
)

BEFORE, AFTER, WEEKS = 10, 3, 10
"""Quiet nights, nights of a fault, and quiet weeks of seven nights."""
Made = Callable[[str, int], ServingModel]
SPINDLE: dict[str, tuple[SpindleFault | None, Reason, Ask]] = {
    "sensor, offset of 4 K": (SpindleFault(offset_K=4.0), "sensor", "identification"),
    "sensor, stuck": (SpindleFault(stuck=True), "sensor", "identification"),
    "sensor, noise of 8 K": (SpindleFault(noise_K=8.0), "sensor", "identification"),
    "heat, cooling 25 % less": (SpindleFault(cooling=0.75), "heat", "identification"),
    "program, speeds 80 % higher": (
        SpindleFault(speed=1.8), "program changed", "identification"
    ),
    "records missing": (None, "records missing", "records"),
}  # fmt: skip
"""Faults of the spindle, with the reason and the work that they are to be answered by."""
MAKERS = {"spindle": spindle_serving, "drive": drive_serving, "cutting": cutting_serving}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Each sub-model, fitted once for each seed."""
    known: dict[tuple[str, int], ServingModel] = {}

    def of(name: str, seed: int) -> ServingModel:
        if (name, seed) not in known:
            known[name, seed] = MAKERS[name](tmp_path_factory.mktemp(name), seed)
        return known[name, seed]

    return of


def held(serving: ServingModel, nights: Iterator[Any], reason: Reason, ask: Ask) -> None:
    found = run(serving, nights)
    assert not false_asks(found, BEFORE), "asked before the fault"
    asked = first_ask(found, BEFORE)
    assert asked is not None, "not asked for within three nights"
    assert asked[1].ask == ask, asked[1].words
    # a first night may fit a sensor as well as less cooling: then it says so
    assert {one.reason for one in found if one.ask} <= {reason, "not known"}
    last = [night for night in found if night.ask][-1]
    assert (last.reason, last.ask) == (reason, ask), last.words


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("fault", SPINDLE)
def test_a_fault_of_the_spindle_is_asked_for(made: Made, fault: str, seed: int) -> None:
    what, reason, ask = SPINDLE[fault]
    nights = spindle_nights(seed, BEFORE + AFTER, BEFORE, what)
    held(made("spindle", seed), nights, reason, ask)


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(3))
def test_friction_that_rose_by_a_third_is_asked_for(made: Made, seed: int) -> None:
    nights = drive_nights(seed, BEFORE + AFTER, BEFORE, 1.33)
    held(made("drive", seed), nights, "friction", "identification")


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(3))
def test_a_tool_that_dulls_is_asked_for(made: Made, seed: int) -> None:
    nights = cutting_nights(seed, BEFORE + AFTER, BEFORE, 0.02)
    held(made("cutting", seed), nights, "wear", "identification")


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", ["spindle", "drive"])
def test_ten_quiet_weeks_ask_for_nothing_more_than_once(made: Made, name: str, seed: int) -> None:
    every = 7 * WEEKS
    nights = (
        spindle_nights(seed, every, every, SpindleFault())
        if name == "spindle" else drive_nights(seed, every, every, 1.0)
    )  # fmt: skip
    found = run(made(name, seed), nights)
    assert len({one.night for one in found}) == every
    assert len(false_asks(found)) <= 1


def test_a_fault_of_friction_is_asked_for_in_a_short_run(tmp_path: Path) -> None:
    serving = drive_serving(tmp_path, 7)
    found = run(serving, drive_nights(7, 4, 2, 1.6))
    asked = first_ask(found, 2)
    assert asked is not None and asked[0] <= 2
    assert asked[1].reason == "friction" and "check lubrication" in asked[1].words
    assert not false_asks(found, 2)
