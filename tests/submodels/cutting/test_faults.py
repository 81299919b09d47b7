"""Named faults of dynamometer recordings: axes, signs, units, spindle speed; none of sound ones."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pipeline.schema.cutting import CutConditions
from pipeline.schema.model import Model
from pipeline.signals.recordings import Recording, Samples
from pipeline.submodels.cutting.faults import Reference, named_faults
from pipeline.submodels.cutting.fit import fit_waveform
from pipeline.submodels.cutting.identify import cutting_model
from pipeline.submodels.cutting.predictions import ForcePredictor
from pipeline.submodels.cutting.recordings import CuttingRecording, cut_harmonics, with_revolution
from pipeline.submodels.cutting.selection import model_of
from pipeline.submodels.cutting.waveform import Terms
from tests.submodels.cutting.recorded import (
    RATE,
    SETTINGS,
    SLOT,
    SLOTS,
    Truth,
    clean,
    identified,
    known_of,
)

TRUTH = Truth(flutes=2)
QUARTERS = [(6000.0, f_z, 2.0, 0.0, np.pi / 2) for f_z in (0.05, 0.1, 0.15)]


def recorded(
    truth: Truth, test: Any, number: int, seed: int = 0, change: Any = None, speed: float = 1.0
) -> CuttingRecording:
    """A recording whose channels went through ``change`` and whose name states a wrong speed."""
    random = np.random.default_rng([seed, number])
    force = clean(truth, test, 0.3 + number)
    force = force + random.normal(0, 1.5, force.shape) + random.normal(0, 1.0, 3)
    force = force if change is None else force @ np.asarray(change).T
    samples = Samples(
        time=np.arange(len(force)) / RATE, channels=dict(zip("xyz", force.T, strict=True))
    )
    rpm, f_z, a_p, entry, leave = test
    file = SimpleNamespace(load=lambda: samples, conditions={"feed_mm_min": None})
    conditions = CutConditions(
        speed=speed * rpm / 60, f_z=f_z * 1e-3 / speed, a_p=a_p * 1e-3, phi_st=entry,
        phi_ex=leave, flutes=truth.flutes,
    )  # fmt: skip
    blank = CuttingRecording(
        name=f"{number}.csv", sha256=str(number), role="training", conditions=conditions,
        file=cast(Recording, file),
    )  # fmt: skip
    return with_revolution(blank, known_of(truth), SETTINGS)


def named(found: list[CuttingRecording], truth: Truth = TRUTH) -> dict[str, str]:
    """Faults by fits with runout alone on the others, as the folds of a selection are."""
    setup = known_of(truth)
    references = {}
    for one in found:
        others = [other for other in found if other is not one]
        cuts = [cut_harmonics(other, SETTINGS) for other in others]
        model = model_of(fit_waveform(setup.tool, cuts, Terms(runout=True)), with_residual=False)
        references[one.name] = Reference(model=model, fitted_on=tuple(o.name for o in others))
    return named_faults(found, references, setup, SETTINGS)


SWAP = [[0, 1, 0], [1, 0, 0], [0, 0, 1]]


@pytest.mark.parametrize(
    "tests",
    [
        pytest.param(SLOTS, id="slots"),
        pytest.param(QUARTERS, id="quarters", marks=pytest.mark.proof),
    ],
)
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (SWAP, "x and y are swapped"),
        *(
            pytest.param(change, said, marks=pytest.mark.proof)
            for change, said in (
                (np.diag([1, -1, 1]), "the sign of y is turned"),
                (np.diag([-1, 1, 1]), "the sign of x is turned"),
                (1e-3 * np.eye(3), "in kN where N is stated"),
                (np.eye(3) / 4.4482, "in lbf where N is stated"),
            )
        ),
    ],
)
def test_the_fault_of_one_of_three_is_named(tests: Any, change: Any, said: str) -> None:
    found = [recorded(TRUTH, one, k, change=change if k == 1 else None)
             for k, one in enumerate(tests)]  # fmt: skip
    sentences = named(found)
    assert list(sentences) == ["1.csv"]
    assert said in sentences["1.csv"] and "2 other recordings" in sentences["1.csv"]


@pytest.mark.parametrize(
    ("speed", "said"),
    [
        (2.0, "half of that stated"),
        pytest.param(0.5, "twice that", marks=pytest.mark.proof),
    ],
)
def test_a_wrong_speed_in_a_name_is_named(speed: float, said: str) -> None:
    found = [recorded(TRUTH, one, k, speed=speed if k == 1 else 1.0) for k, one in enumerate(SLOTS)]
    sentences = named(found)
    assert f"its spindle speed is {said}" in sentences["1.csv"]


def test_a_speed_whose_revolution_does_not_repeat_is_named_where_it_is_left_out() -> None:
    three = replace(TRUTH, flutes=3, runout=0.001)
    one = recorded(three, SLOTS[1], 1, speed=2.0)
    assert one.revolution is None
    assert "repeat with 6000 rev/min, half of what is stated" in one.reason


def test_of_two_recordings_both_are_doubted() -> None:
    other = recorded(TRUTH, SLOTS[2], 1, change=1e-3 * np.eye(3))
    said = named([recorded(TRUTH, SLOTS[1], 0), other])["1.csv"]
    assert "kN" in said and "or that holds the other way round of 0.csv" in said


def test_the_model_stores_the_fault_of_a_recording_that_was_held_out() -> None:
    swapped = replace(recorded(SLOT, SLOTS[1], 9, change=SWAP), role="held_out")
    sound, setup = identified(SLOT, SLOTS), known_of(SLOT)
    found = replace(sound, recordings=[*sound.recordings, swapped])
    for name, reference in found.references.items():
        others = {one.name for one in sound.recordings} - {name}
        assert set(reference.fitted_on) <= others and reference.fitted_on
    head = Model(submodel="cutting", machine="m", origin="simulated", parameters={}, trained_on=())
    model = cutting_model(head, found, setup, SETTINGS, None)
    assert [bool(one.fault) for one in model.recordings] == [False, False, False, True]
    prediction = ForcePredictor(model, setup, SETTINGS).prediction(swapped)
    assert "x and y are swapped" in prediction.cause


def test_sound_recordings_are_not_accused() -> None:
    _sound(1)


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(60))
def test_sound_recordings_are_not_accused_over_many_seeds(seed: int) -> None:
    _sound(seed)


def _sound(seed: int) -> None:
    """Two or three recordings of a random cut whose chip law is not that of the fit."""
    random = np.random.default_rng(seed)
    truth = Truth(
        flutes=int(random.integers(2, 5)), helix=float(random.uniform(0, 40)),
        runout=float(random.uniform(0, 0.02)), exponent=float(random.uniform(0, 0.3)),
        worn=(), cutting=tuple(random.uniform(0.6, 1.5, 3) * (850, 240, 140)),  # type: ignore[arg-type]
    )  # fmt: skip
    arc = float(random.choice([np.pi, np.pi / 2, 2.0]))
    feeds = random.uniform(0.04, 0.2, int(random.integers(2, 4)))
    tests = [(6000.0, float(f_z), 2.0, 0.0, arc) for f_z in feeds]
    assert named([recorded(truth, one, k, seed) for k, one in enumerate(tests)], truth) == {}
