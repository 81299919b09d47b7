"""Traces of many variants of an axis: company, starts, rows; shapes and refusals."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.kernels import compiled
from pipeline.machine.axis.drive import FARTHEST, decay, simulate
from pipeline.machine.axis.drive_parameters import DriveColumn, DriveStart, drive_row
from tests.twin.axes import AXIS, DriveParameters, T, to_and_fro, with_drive, with_servo

FULL = with_servo(
    with_drive(AXIS, offset=70.0),
    velocity_feedforward=0.6, acceleration_feedforward=0.3, velocity_lag=0.001,
    position_lag=0.002, current_limit=0.9,
)  # fmt: skip
STEPS = 4000


def varied(individuals: int) -> list[DriveParameters]:
    rng = np.random.default_rng(1)
    return [
        with_servo(
            with_drive(FULL, mass=150 * rng.uniform(0.8, 1.2)),
            position_gain=40 * rng.uniform(0.5, 1.5),
        )
        for _ in range(individuals)
    ]


def rows(individuals: int) -> NDArray[np.float64]:
    return np.array([drive_row(one.servo, one.feed_drive) for one in varied(individuals)])


def references(axes: int, steps: int = STEPS) -> NDArray[np.float64]:
    """Reversals, steps that reach the limit, and a crawl that sticks and slips."""
    t = T * np.arange(steps)
    every = [to_and_fro(steps), 0.01 * np.round(np.sin(t), 1), 0.0003 * t]
    return np.stack([every[a % 3] for a in range(axes)], axis=1)


def loads(axes: int) -> NDArray[np.float64]:
    return np.outer(30 * np.sin(7 * T * np.arange(STEPS)), np.ones(axes))


def test_variants_do_not_depend_on_their_company() -> None:
    table, reference = rows(5), references(1)[:, 0]
    whole = simulate(reference, T, table, load=loads(1)[:, 0])
    for i in range(5):
        alone = simulate(reference, T, table[i : i + 1], load=loads(1)[:, 0])
        np.testing.assert_array_equal(alone.command[0], whole.command[i])


def test_load_factor_multiplies_the_load() -> None:
    half = rows(1)
    half[:, DriveColumn.LOAD_FACTOR] = 0.5
    reference, load = references(1)[:, 0], loads(1)[:, 0]
    found = simulate(reference, T, half, load=load)
    expected = simulate(reference, T, rows(1), load=0.5 * load)
    np.testing.assert_allclose(found.position, expected.position, atol=1e-12)


def test_variants_start_where_they_are_told() -> None:
    drive = varied(1)[0]
    start = DriveStart(position=0.001, velocity=0.02, command=0.4, reference_velocity=0.03)
    reference = references(1)[500:1500, 0]
    row = drive_row(drive.servo, drive.feed_drive)
    found = simulate(reference, T, np.stack((row, row)), start=start)
    assert found.position[1, 0] == 0.001 and found.velocity[1, 0] == 0.02
    assert found.command[1, 0] == pytest.approx(0.4, rel=1e-12)


def test_a_row_holds_the_parameters_in_the_order_of_its_columns() -> None:
    row = drive_row(FULL.servo, FULL.feed_drive, load_factor=0.5)
    sides = {"POSITIVE": FULL.feed_drive.friction.positive}
    sides["NEGATIVE"] = FULL.feed_drive.friction.negative
    expected = {"LOAD_FACTOR": 0.5}
    for column in DriveColumn:
        name, _, side = column.name.rpartition("_")
        if side in sides:
            name = {"STRIBECK": "stribeck_velocity"}.get(name, name.lower())
            expected[column.name] = getattr(sides[side], name)
        elif column.name != "LOAD_FACTOR":
            owner = FULL.servo if hasattr(FULL.servo, column.name.lower()) else FULL.feed_drive
            expected[column.name] = getattr(owner, column.name.lower())
    assert row.tolist() == [expected[column.name] for column in DriveColumn]


@compiled
def _decays(y, out):  # type: ignore[no-untyped-def]
    for i in range(y.shape[0]):
        out[i] = decay(y[i])


def test_decay_is_the_exponential() -> None:
    y = np.r_[0.0, np.geomspace(1e-18, FARTHEST, 200_000), np.linspace(FARTHEST, 100, 1000)]
    found = np.empty_like(y)
    _decays(y, found)
    near = y <= FARTHEST
    assert found[0] == 1.0
    assert np.abs(found[near] / np.exp(-32 * y[near]) - 1).max() < 6e-11
    assert np.abs(found - np.exp(-32 * y)).max() < 6e-11


def test_an_unstable_variant_leaves_the_others_alone() -> None:
    table, reference = rows(3), references(1)[:, 0]
    table[:, DriveColumn.CURRENT_LIMIT] = np.inf
    expected = simulate(reference, T, table)
    table[1, DriveColumn.PROPORTIONAL] *= 100
    found = simulate(reference, T, table)
    assert not np.isfinite(found.position[1, -1])
    for p in (0, 2):
        np.testing.assert_array_equal(found.position[p], expected.position[p])


@pytest.mark.parametrize(
    "change, said",
    [
        ({"reference": np.zeros((10, 2))}, r"reference has shape \(10, 2\): give one row"),
        ({"reference": np.full(10, np.nan)}, r"reference\[0\] = nan"),
        ({"load": np.full(10, np.inf)}, r"load\[0\] = inf"),
        ({"load": np.zeros(9)}, "load has 9 samples, the reference 10"),
        ({"period": 0.0}, "period = 0.0 s must be finite and positive"),
        ({"substeps": 0}, "substeps = 0 must be at least 1"),
    ],
)
def test_inputs_out_of_range_are_refused(change: dict[str, object], said: str) -> None:
    known = {"reference": np.zeros(10), "period": T, "table": rows(2)}
    with pytest.raises(ValueError, match=said):
        simulate(**{**known, **change})
