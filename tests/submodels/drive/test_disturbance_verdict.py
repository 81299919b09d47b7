"""A channel of pulses in another unit or sign than declared: what verdict and page say of it.

The recordings are those of the simulated EMPS-like drive, which shares nothing with the twin; they
pass through the sub-model's own judgement and page.
"""

from dataclasses import asdict, replace

import pytest

from pipeline.schema.drive import DriveModel, FeedDrive, Servo
from pipeline.schema.store import structured
from pipeline.submodels.drive.submodel import SUBMODEL
from tests.submodels.drive.shown_drives import shown
from tests.submodels.drive.test_disturbance import EMPS, identified, recorded
from tests.submodels.drive.test_judging import judged, stored
from tests.submodels.made_pages import made, words

__all__ = ["judged"]

VOLT = EMPS.kv
"""Command for one m/s at the speed command [V s/m]."""
KINDS = {
    "speed-mm": ("speed", 1 / VOLT, 1e-3, "N", "the speed command", "as if in mm/s, not in N"),
    "command": ("command", 1.0, 1 / EMPS.kf, "kN", "command of the motor", "in N, not in kN"),
    "command-turned": ("command", 1.0, -1.0, "V", "command of the motor", "sign is the opposite"),
    "force-turned": ("force", EMPS.kf, -1.0, "N", "as a force", "sign is the opposite"),
    "force-kN": ("force", EMPS.kf, 1e3, "N", "as a force", "as if in kN, not in N"),
}
"""Entry, size in SI, SI per unit of the channel, declared unit; words for entry and cause."""


@pytest.fixture(scope="module")
def model() -> DriveModel:
    """The drive as identified from recordings without pulses, as its file has it."""
    drive = identified(EMPS)
    assert drive.servo is not None
    found = stored([replace(recorded(EMPS, None, 1000), name="train.csv")])
    servo = {k: v for k, v in asdict(drive.servo).items() if v != float("inf")}
    axis = replace(
        found.axes["X"], command_unit=drive.command_unit, force_unit=drive.force_unit,
        feed_drive=structured(asdict(drive.feed_drive), FeedDrive, "feed_drive"),
        servo=Servo(**servo),
    )  # fmt: skip
    return replace(found, axes={"X": axis})


@pytest.mark.parametrize("kind", KINDS)
def test_verdict_and_page_name_entry_and_cause(kind, judged, model):
    entry, size, per_unit, unit, place, cause = KINDS[kind]
    one = replace(recorded(EMPS, entry, 31, size, per_unit, 0, unit), name="pulses.csv")
    found = judged([one], model=model).verdict
    (case,) = found.cases
    assert place in case.facts["disturbance X enters at"].value
    assert cause in case.facts["disturbance X, cause"].value and cause in case.note
    factor = case.facts["disturbance X, factor"].value
    assert factor == pytest.approx(per_unit, rel=0.05)
    assert following_error(found) < 20  # of its own size, with the pulses where they enter [%]
    page = made(SUBMODEL, shown(model=model, verdict=found, predictions=None, truth=None))
    assert "disturbance X, factor" in str(page) and cause in words(page)


def following_error(verdict) -> float:
    return next(iter(verdict.of("following error X", group="pulses.csv"))).relative_percent
