"""Faulty temperature sensors are found, named and replaced, without a look at what comes later."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from pipeline.schema.arrays import Floats
from pipeline.schema.model import Model
from pipeline.shop.growth.heat import network
from pipeline.shop.growth.parameters import SENSORS
from pipeline.shop.growth.records import Measured, measured, profiles
from pipeline.shop.parameters import ShopParameters
from pipeline.signals.recordings import Channel
from pipeline.submodels.deformation.fit import fit_growth
from pipeline.submodels.deformation.model import DeformationFitSettings, GrowthModel
from pipeline.submodels.deformation.records import DeformationRecords, Profile, State
from pipeline.submodels.deformation.sensors import (
    DEAD,
    DRIFTING,
    ERRATIC,
    JUMPED,
    SHIFTED,
    SensorModel,
    SensorSettings,
    fit_sensors,
    steps_of,
)
from tests.submodels.deformation.growth_files import NAMES, made


def profile(seed: int) -> Profile:
    one = made(seed, warm=seed % 4 == 3, air=18.0 + seed % 5)
    state = State(period=60.0, temperatures=one.temperatures, speed=one.speed, ambient=one.ambient)
    return Profile(name=f"p{seed}", state=state, growth=one.growth)


TRAINING = [profile(seed) for seed in range(8)]


@pytest.fixture(scope="module")
def model() -> SensorModel:
    return fit_sensors(TRAINING, NAMES, SensorSettings())


def broken(state: State, sensor: int, kind: str) -> State:
    values = state.temperatures.copy()
    minute = np.arange(len(values))
    if kind == "open":
        values[50:, sensor] = 850.0
    elif kind == "silent":
        values[50:, sensor] = np.nan
    elif kind == "held":
        values[20:, sensor] = values[20, sensor]
    elif kind == "loose":
        values[60:, sensor] += 8.0
    elif kind == "drift":
        values[:, sensor] += 0.05 * minute
    return replace(state, temperatures=values)


@pytest.mark.parametrize("seed", range(8, 14))
def test_sound_sensors_are_not_blamed(model, seed):
    found = model.check(profile(seed).state)
    assert found.faults == () and found.since == (0,)


@pytest.mark.parametrize(
    ("kind", "named"),
    [("open", DEAD), ("silent", DEAD), ("loose", JUMPED), ("drift", DRIFTING)],
)
@pytest.mark.parametrize("sensor", [0, 2, 4])
def test_a_faulty_sensor_is_named_and_its_temperature_restored(model, sensor, kind, named):
    sound = profile(9).state
    found = model.check(broken(sound, sensor, kind))
    assert [(one.sensor, one.kind) for one in found.faults] == [(NAMES[sensor], named)]
    assert NAMES[sensor] in found.faults[0].sentence
    off = np.abs(found.states[-1].temperatures - sound.temperatures)[30:]
    assert off.max() < 2.0  # of 8 K and more that the fault makes


def test_a_held_value_is_noticed_while_the_others_move(model):
    (fault,) = model.check(broken(profile(9).state, 0, "held")).faults
    assert fault.sensor == NAMES[0] and 20 * 60 < fault.since_s < 80 * 60


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_drift_is_told_with_its_size_and_sign(model, sign):
    state = profile(10).state
    drifting = broken(state, 2, "drift").temperatures
    temperatures = state.temperatures + sign * (drifting - state.temperatures)
    (fault,) = model.check(replace(state, temperatures=temperatures)).faults
    assert fault.departure_K == pytest.approx(sign * 0.05 * 119, abs=0.5)
    assert f"off by up to {'+' if sign > 0 else '-'}" in fault.sentence


def test_nothing_later_is_looked_at(model):
    state = broken(profile(11).state, 1, "drift")
    whole = model.check(state)
    for many in (40, 70, 100):
        cut = model.check(
            State(
                period=60.0, temperatures=state.temperatures[:many], speed=state.speed[:many],
                ambient=state.ambient[:many],
            )
        )  # fmt: skip
        assert stitched(cut.states, cut.since) == pytest.approx(
            stitched(whole.states, whole.since)[:many], abs=1e-9
        )


def stitched(states: tuple[State, ...], since: tuple[int, ...]) -> Floats:
    result = states[0].temperatures.copy()
    for first, state in zip(since, states, strict=True):
        result[first:] = state.temperatures[first:]
    return result


def test_faults_in_training_do_not_hide_themselves():
    kinds = {1: "drift", 4: "open"}
    some = [
        replace(one, state=broken(one.state, 3, kinds.get(k, ""))) for k, one in enumerate(TRAINING)
    ]
    model = fit_sensors(some, NAMES, SensorSettings())
    for k, one in enumerate(some):
        names = [fault.sensor for fault in model.check(one.state).faults]
        assert names == ([NAMES[3]] if k in kinds else [])


def jumped(one: Profile, sensor: int, by: float, first: int = 60) -> Profile:
    values = one.state.temperatures.copy()
    values[first:, sensor] += by
    return replace(one, state=replace(one.state, temperatures=values))


@pytest.mark.parametrize("sensor", [0, 2, 4])
@pytest.mark.parametrize("by", [4.0, -9.0])
def test_a_jump_in_half_of_the_training_recordings_is_no_part_of_what_is_usual(sensor, by):
    some = [jumped(one, sensor, by, 45 + 4 * k) if k % 2 else one for k, one in enumerate(TRAINING)]
    model = fit_sensors(some, NAMES, SensorSettings())
    assert max(model.tolerance_K) < 3.0
    for k, one in enumerate(some):
        faults = model.check(one.state).faults
        assert [fault.sensor for fault in faults] == ([NAMES[sensor]] if k % 2 else [])
        if faults:  # the sample after that of the jump, which keeps it
            assert faults[0].since_s == 60.0 * (46 + 4 * k) and faults[0].kind == JUMPED


def test_a_single_odd_sample_is_no_jump():
    model = fit_sensors(TRAINING, NAMES, SensorSettings())
    for one in TRAINING:
        odd = jumped(jumped(one, 1, 3.0, 60), 1, -3.0, 61)
        assert not model.check(odd.state).faults
        assert model.check(jumped(one, 1, 3.0, 60).state).faults


def test_an_offset_that_stays_from_a_date_on_is_told_from_the_recordings_before():
    some = [jumped(one, 2, 6.0, 0 if k > 4 else 60) if k > 3 else one
            for k, one in enumerate(TRAINING)]  # fmt: skip
    model = fit_sensors(some, NAMES, SensorSettings())
    faults = [model.check(one.state).faults for one in some]
    assert [len(one) for one in faults] == [0] * 4 + [1] * 4
    assert {fault.sensor for one in faults for fault in one} == {NAMES[2]}
    assert {one[0].kind for one in faults[5:]} == {SHIFTED}


def test_a_sensor_of_which_far_more_is_tolerated_is_faulty_everywhere(model):
    wide = replace(model, tolerance_K=(*model.tolerance_K[:4], 69.0))
    state = profile(9).state
    (fault,) = wide.check(state).faults
    assert (fault.sensor, fault.kind, fault.since_s) == (NAMES[4], ERRATIC, 0.0)
    assert wide.check(state, ignored=(NAMES[4],)).faults == ()


def test_neither_a_slope_nor_its_change_is_a_step_but_a_jump_is():
    minute = np.arange(40.0)
    kink = np.where(minute < 20, 0.1 * minute, 2.0 + 1.5 * (minute - 20))
    found = steps_of(np.column_stack([kink, kink + 5.0 * (minute >= 25)]))
    assert np.abs(found[:, 0]).max() < 2.1 and int(np.argmax(found[:, 1])) == 25
    assert found[25, 1] == pytest.approx(5.0)


def test_a_sensor_that_is_dead_in_all_recordings_is_to_be_left_out():
    some = [replace(one, state=broken(one.state, 3, "open")) for one in TRAINING]
    with pytest.raises(ValueError, match="leave the dead sensor out"):
        fit_sensors(some, NAMES, SensorSettings())


def test_samples_without_any_sensor_are_a_gap_and_no_fault(model):
    state = profile(8).state
    values = state.temperatures.copy()
    values[30:60] = np.nan
    assert model.check(replace(state, temperatures=values)).faults == ()


def test_a_sensor_that_shows_whole_kelvins_may_hold_a_value_longer():
    whole = []
    for one in TRAINING:
        values = one.state.temperatures.copy()
        values[:, 4] = np.round(values[:, 4])
        whole.append(replace(one, state=replace(one.state, temperatures=values)))
    found = fit_sensors(whole, NAMES, SensorSettings())
    assert found.held_s[4] > max(found.held_s[:4])
    plain = replace(found, held_s=())
    dead = [
        sum(fault.kind == DEAD for one in whole for fault in each.check(one.state).faults)
        for each in (found, plain)
    ]
    assert dead[0] < dead[1] / 2


NINE = tuple(f"temperature_{k + 1}" for k in range(SENSORS))
NINE_RECORDS = DeformationRecords(
    recordings=("p*",), temperatures={name: Channel(column=name) for name in NINE},
    displacement=Channel(column="growth"), speed=Channel(column="speed"),
    ambient=Channel(column="ambient"),
)  # fmt: skip
HEAD = Model(
    submodel="deformation", machine="mill01", origin="simulated", parameters={}, trained_on=()
)
LEARNT = 14
SEEDS, FEWEST = 100, 95
NAMED_S = 300.0
SETTINGS = DeformationFitSettings(
    folds=4, seeds=1, seeds_left_out=1, later_starts=(2,), compute="serial",
    methods=("persistence", "linear", "linear_sensors"),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Seeded:
    """Recordings of one seed, the sensor that jumps, and the sample of the jump by recording."""

    recordings: list[Profile]
    sensor: str
    jumps: dict[str, int]


@pytest.fixture(scope="module")
def exposed() -> list[Measured]:
    """What the sensors are exposed to, and the growth, without any fault."""
    parameters = ShopParameters(machine="mill01")
    net = network(parameters)
    return [measured(net, one, parameters) for one in profiles(parameters)]


def seeded(exposed: list[Measured], seed: int) -> Seeded:
    rng = np.random.default_rng(seed)
    offsets, sensor = rng.uniform(-0.17, 0.17, SENSORS + 1), int(rng.integers(SENSORS))
    by = float(rng.choice([-1, 1]) * rng.uniform(3, 20))
    held_out = len(exposed) - LEARNT
    first = rng.choice(LEARNT, LEARNT // 2, replace=False)
    second = LEARNT + rng.choice(held_out, held_out // 2, replace=False)
    jumping = {*first.tolist(), *second.tolist()}
    recordings, jumps = [], {}
    for k, one in enumerate(exposed):
        rows, name = len(one.time), f"p{k:02d}"
        values = one.temperatures + offsets + rng.normal(0, 0.06, one.temperatures.shape)
        if k in jumping:
            jumps[name] = int(rows * rng.uniform(0.35, 0.65))
            values[jumps[name] :, sensor] += by
        values = np.round(values, 1)
        state = State(period=60.0, temperatures=values[:, :SENSORS], speed=np.abs(one.speed),
                      ambient=values[:, SENSORS])  # fmt: skip
        growth = one.growth + rng.normal(0, 0.3, rows)
        recordings.append(Profile(name=name, state=state, growth=growth))
    return Seeded(recordings=recordings, sensor=NINE[sensor], jumps=jumps)


def holds(model: GrowthModel, made: Seeded) -> bool:
    """Whether no recording held out is worse than persistence and the one sensor alone is named."""
    better = [_worse(model, one) < 1 for one in made.recordings[LEARNT:]]
    named = [_named(model, made, one) for one in made.recordings]
    return all(better) and all(named)


def _worse(model: GrowthModel, one: Profile) -> float:
    """RMSE over that of persistence, as it is served [1]."""
    pieces = model.pieces(model.checked(one.state))
    growth: Floats = model.stitched(pieces).mean(axis=0)
    served = np.where(model.withheld(pieces, growth) == "", growth, 0.0)
    return float(np.sqrt(np.mean((served - one.growth) ** 2) / np.mean(one.growth**2)))


def _named(model: GrowthModel, made: Seeded, one: Profile) -> bool:
    faults = model.file.sensors.check(one.state).faults
    if one.name not in made.jumps:
        # a sensor that cannot be told from its faults is named everywhere
        return {fault.sensor for fault in faults} <= {made.sensor}
    late = [fault.since_s - 60.0 * made.jumps[one.name] for fault in faults]
    return [fault.sensor for fault in faults] == [made.sensor] and late[0] <= NAMED_S


@pytest.mark.proof
def test_a_sensor_that_jumps_in_half_of_the_recordings_is_named_and_serves_no_more(exposed):
    good = []
    for seed in range(SEEDS):
        made = seeded(exposed, seed)
        found = fit_growth(HEAD, made.recordings[:LEARNT], NINE_RECORDS, SETTINGS)
        good.append(holds(found, made))
    assert sum(good) >= FEWEST, [seed for seed, one in enumerate(good) if not one]
