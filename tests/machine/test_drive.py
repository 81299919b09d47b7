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


def plain(
    reference: NDArray[np.float64],
    load: NDArray[np.float64],
    row: NDArray[np.float64],
    *,
    held: int = 1,
    spring: tuple[float, float] | None = None,
) -> NDArray[np.float64]:
    """Position and command of one axis from rest, (2, T), by the equations as they are written."""
    loop, p, i, ahead, further, limit, mass, k, offset, factor = row[:10]
    sides = {True: row[10:14], False: row[14:18]}
    seen_share, held_share = (-np.expm1(-T / lag) if lag > 0 else 1.0 for lag in row[19:21])
    x, v, z, v_ref, seen, summed = float(reference[0]), 0.0, 0.0, 0.0, 0.0, offset / k
    last, rate, step, traces = x, 0.0, T / held, []
    for x_ref, push in zip(reference, load, strict=True):
        new = (x_ref - last) / T
        change, last, rate = (new - rate) / T, x_ref, new
        v_ref += held_share * (loop * (x_ref - x) + ahead * rate - v_ref)
        seen += seen_share * (v - seen)
        demand = p * (v_ref - seen) + summed + further * change
        command = np.clip(demand, -limit, limit)
        if (demand - command) * (v_ref - seen) <= 0:
            summed += T * i * (v_ref - seen)
        traces.append((x, command))
        force = k * command - offset - factor * push
        for _ in range(held):
            coulomb, static, stribeck, viscous = sides[bool(v > 0)]
            curve = coulomb + (static - coulomb) * np.exp(-((v / stribeck) ** 2))
            if spring is not None:
                z = (z + step * v) / (1 + step * (spring[0] * abs(v) / curve + spring[1]))
                after = (v + step / mass * (force - spring[0] * z)) / (1 + step * viscous / mass)
            else:
                free = v + step / mass * (force - viscous * v / 2)
                low, high, _, slow = sides[bool(free > 0)]
                level = (
                    high
                    if v * free <= 0
                    else low + (high - low) * np.exp(-((v / sides[bool(v > 0)][2]) ** 2))
                )
                slip = max(abs(free) - step / mass * level, 0.0) / (1 + step / mass * slow / 2)
                after = np.sign(free) * slip
            x, v = x + step * (v + after) / 2, after
    return np.array(traces).T


@pytest.mark.parametrize("held", [1, 3])
def test_traces_are_those_of_the_equations_in_plain_python(held: int) -> None:
    """Unequal lags, friction by direction, limit, feed-forward: each has its place in the row."""
    for reference in references(3).T:
        load, table = loads(1)[:, 0], rows(1)
        traces = simulate(reference, T, table, load=load, substeps=held)
        position, command = plain(reference, load, table[0], held=held)
        np.testing.assert_allclose(traces.position[0], position, atol=1e-9)
        np.testing.assert_allclose(traces.command[0], command, atol=1e-6)


def test_presliding_is_that_of_the_equations_in_both_directions() -> None:
    spring, table = (2e7, 3.0), rows(1)
    for sign in (1.0, -1.0):
        reference = sign * 2e-5 * np.sin(8 * T * np.arange(STEPS))
        load = 40 * np.sin(11 * T * np.arange(STEPS))
        traces = simulate(reference, T, table, load=load, substeps=4, spring=spring)
        position, command = plain(reference, load, table[0], held=4, spring=spring)
        np.testing.assert_allclose(traces.position[0], position, atol=1e-10)
        np.testing.assert_allclose(traces.command[0], command, atol=1e-6)
