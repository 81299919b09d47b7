"""Growth as a correction: equal to a linear model, compared with any other, refused outside."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.submodels.deformation.model import (
    LEFT_OUT,
    GrowthModel,
    Treatment,
    load_growth_model,
)
from pipeline.submodels.deformation.records import State, read_profiles
from pipeline.submodels.deformation.thermal_growth import correction
from tests.submodels.deformation.growth_files import RECORDS
from tests.submodels.deformation.test_submodel import QUICK, ROLES, Built, build, recordings

LINEAR = ("linear_static", "linear", "linear_sensors")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    methods = ("persistence", *LINEAR, "bp_7")
    return build(tmp_path_factory.mktemp("growth"), recordings(), replace(QUICK, methods=methods))


@pytest.fixture(scope="module")
def states(built: Built) -> list[State]:
    found = read_profiles(built.signals, RECORDS, ROLES.is_training)
    return [one.profile.state for one in found if one.profile and ROLES.is_training(one.name)]


def serving(built: Built, method: str, treatment: Treatment | None = None) -> GrowthModel:
    one = load_growth_model(built.folder)
    changed = treatment or one.file.treatment
    return GrowthModel(replace(one.file, champion=method, treatment=changed), one.ensembles)


def held_out(built: Built) -> State:
    found = read_profiles(built.signals, RECORDS, ROLES.is_training)
    other = next(one.profile for one in found if not ROLES.is_training(one.name))
    assert other is not None
    return other.state


def served(model: GrowthModel, state: State) -> tuple[np.ndarray, State]:
    checked = model.checked(state)
    return model.stitched(model.pieces(checked)).mean(axis=0), checked.states[-1]


@pytest.mark.parametrize("method", LINEAR)
def test_a_linear_model_is_written_as_it_is(built, states, method):
    model = serving(built, method)
    found = correction(model, states)
    assert found.exact and found.largest_um < 1e-5  # nine digits of every coefficient
    growth, state = served(model, held_out(built))
    assert np.abs(growth).max() > 1
    assert found.growth(model.file.values(state)) == pytest.approx(growth, abs=1e-5)


def test_a_sensor_that_is_left_out_is_not_read(built, states):
    """The others stand in its place, as in the model."""
    model = serving(built, "linear_sensors", Treatment(chosen=LEFT_OUT, ignored=("temperature_2",)))
    found = correction(model, states)
    assert "temperature_2" not in found.inputs
    assert not any(one.input == "temperature_2" for one in (*found.terms, *found.starts))
    growth, state = served(model, held_out(built))
    values = model.file.values(state)
    values["temperature_2"] = np.full(len(growth), np.nan)
    assert found.growth(values) == pytest.approx(growth, abs=1e-5)


def test_a_network_is_linearised_and_the_difference_stated(built, states):
    model = serving(built, "bp_7")
    found = correction(model, states)
    assert not found.exact
    apart = [
        found.growth(model.file.values(state)) - growth
        for growth, state in (served(model, one) for one in states)
    ]
    largest = float(np.abs(np.concatenate(apart)).max())
    assert found.largest_um == pytest.approx(largest, rel=0.01) and largest > 1e-3
    below, above = found.interval_um
    widest = max(one.lower for one in model.file.bands.values())
    assert below == pytest.approx(widest + found.largest_um) and above > 0


def test_growth_is_zero_at_the_start(built, states):
    model = serving(built, "linear_sensors")
    found = correction(model, states)
    assert found.growth(model.file.values(states[3]))[0] == 0


def test_a_model_without_growth_is_refused(built, states):
    with pytest.raises(ValueError, match="persistence serves, which predicts no growth"):
        correction(serving(built, "persistence"), states)


def test_without_recordings_it_is_refused(built):
    with pytest.raises(ValueError, match="none of the recordings"):
        correction(serving(built, "linear"), [])
