"""Lanes, compiled traces and plain Python are one model; shapes, threads and refusals."""

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.kernels import compiled
from pipeline.machine.axis.drive_step import FARTHEST, decay
from pipeline.machine.axis.feed_drive import DriveColumn, drive_row
from pipeline.twin.drive import DriveParameters, DriveStart
from pipeline.twin.drive_population import (
    DriveErrors,
    drive_table,
    population_errors,
    simulate_traces,
)
from tests.machine.plain_drive import simulate_drive
from tests.twin.axes import AXIS, T, to_and_fro, with_drive, with_servo

FULL = with_servo(
    with_drive(AXIS, offset=70.0),
    velocity_feedforward=0.6, acceleration_feedforward=0.3, velocity_lag=0.001,
    position_lag=0.002, current_limit=0.9,
)  # fmt: skip
STEPS = 4000
OPTIONS = [{}, {"substeps": 3}, {"substeps": 3, "servo_substeps": True}]
NAMES = ("max_error", "rms_error", "max_command", "rms_command")


def varied(individuals: int, axes: int) -> list[list[DriveParameters]]:
    rng = np.random.default_rng(1)
    return [
        [
            with_servo(
                with_drive(FULL, mass=150 * rng.uniform(0.8, 1.2)),
                position_gain=40 * rng.uniform(0.5, 1.5),
            )
            for _ in range(axes)
        ]
        for _ in range(individuals)
    ]


def references(axes: int, steps: int = STEPS) -> NDArray[np.float64]:
    """Reversals, steps that reach the limit, and a crawl that sticks and slips."""
    t = T * np.arange(steps)
    every = [to_and_fro(steps), 0.01 * np.round(np.sin(t), 1), 0.0003 * t]
    return np.stack([every[a % 3] for a in range(axes)], axis=1)


def loads(axes: int) -> NDArray[np.float64]:
    return np.outer(30 * np.sin(7 * T * np.arange(STEPS)), np.ones(axes))


@pytest.mark.parametrize("options", OPTIONS)
def test_compiled_trace_is_the_plain_one(options: dict[str, int]) -> None:
    """1e-9 of what each signal reaches: the polynomial of the dip is within 6e-11 of exp."""
    for a in range(3):
        drive, reference, load = varied(1, 3)[0][a], references(3)[:, a], loads(3)[:, a]
        plain = simulate_drive(reference, T, drive, load=load, **options)
        row = drive_row(drive.servo, drive.feed_drive)[np.newaxis]
        fast = simulate_traces(reference, T, row, load=load, **options)
        for name in ("position", "velocity", "command"):
            expected = getattr(plain, name)
            scale = np.abs(expected).max()
            assert getattr(fast, name)[0] == pytest.approx(expected, abs=1e-9 * scale, rel=0)
        # both stand still in the same samples
        assert ((plain.velocity == 0) == (fast.velocity[0] == 0)).all()


@pytest.mark.parametrize("load", [None, loads(3)], ids=["free", "loaded"])
@pytest.mark.parametrize("substeps", [1, 3])
def test_lanes_are_the_plain_form(load: NDArray[np.float64] | None, substeps: int) -> None:
    drives = varied(3, 3)
    found = population_errors(references(3), T, drive_table(drives), load=load, substeps=substeps)
    for p, axes in enumerate(drives):
        for a, drive in enumerate(axes):
            trace = simulate_drive(
                references(3)[:, a], T, drive, load=None if load is None else load[:, a],
                substeps=substeps,
            )  # fmt: skip
            e, A = np.abs(trace.following_error), np.abs(trace.command)
            expected = (e.max(), np.sqrt(np.mean(e**2)), A.max(), np.sqrt(np.mean(A**2)))
            got = tuple(getattr(found, name)[p, a] for name in NAMES)
            assert got == pytest.approx(expected, rel=1e-9)


def test_lanes_with_the_servo_in_substeps_are_lanes_of_its_period() -> None:
    table, n = drive_table(varied(2, 3)), 4
    fine = np.stack(
        [np.interp(np.arange(STEPS * n) / n, np.arange(STEPS), r) for r in references(3).T], axis=1
    )
    coarse = population_errors(references(3), T, table, substeps=n, servo_substeps=True)
    whole = population_errors(fine, T / n, table)
    # interpolation rounds differently, and the second difference of 0.25 ms sees it
    same(coarse, whole, 1e-8)


def same(one: DriveErrors, other: DriveErrors, rel: float) -> None:
    for name in NAMES:
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=rel, abs=0)


@pytest.mark.parametrize("options", OPTIONS)
def test_own_references_are_followed_as_a_common_one(options: dict[str, int]) -> None:
    table = drive_table(varied(19, 2))
    reference, load = references(2), loads(2)
    common = population_errors(reference, T, table, load=load, **options)
    own = population_errors(np.tile(reference, (19, 1, 1)), T, table, load=load, **options)
    # the same operations in the same order
    same(own, common, 1e-15)
    same(population_errors(reference, T, table, load=np.tile(load, (19, 1, 1)), **options), common,
         1e-15)  # fmt: skip


def test_each_individual_follows_its_own_reference() -> None:
    table = np.tile(drive_table(varied(1, 2)), (20, 1, 1))
    scale = np.linspace(0.5, 1.5, 20)
    own = scale[:, np.newaxis, np.newaxis] * references(2)
    found = population_errors(own, T, table)
    for p in (0, 7, 15, 16, 19):
        alone = population_errors(own[p], T, table[p : p + 1])
        for name in NAMES:
            assert getattr(found, name)[p] == pytest.approx(getattr(alone, name)[0], rel=1e-15)


@pytest.mark.parametrize("individuals", [1, 15, 16, 17, 50])
@pytest.mark.parametrize("axes", [1, 2, 5])
def test_results_do_not_depend_on_company_or_threads(individuals: int, axes: int) -> None:
    table = drive_table(varied(individuals, axes))
    reference = references(axes, 300)
    found = population_errors(reference, T, table, threads=1)
    same(population_errors(reference, T, table, threads=3), found, 0)
    last = population_errors(reference, T, table[-1:])
    for name in NAMES:
        assert getattr(found, name).shape == (individuals, axes)
        assert (getattr(last, name)[0] == getattr(found, name)[-1]).all()


def test_load_factor_multiplies_the_load() -> None:
    table = drive_table(varied(1, 1))
    half = table.copy()
    half[..., DriveColumn.LOAD_FACTOR] = 0.5
    reference, load = references(1), loads(1)
    same(population_errors(reference, T, half, load=load),
         population_errors(reference, T, table, load=0.5 * load), 1e-12)  # fmt: skip


def test_variants_start_where_they_are_told() -> None:
    drive = varied(1, 1)[0][0]
    start = DriveStart(position=0.001, velocity=0.02, command=0.4, reference_velocity=0.03)
    reference = references(1)[500:1500, 0]
    plain = simulate_drive(reference, T, drive, start=start)
    row = drive_row(drive.servo, drive.feed_drive)
    fast = simulate_traces(reference, T, np.stack((row, row)), start=start)
    assert fast.command[1, 0] == pytest.approx(0.4, rel=1e-12)
    assert fast.position[1] == pytest.approx(plain.position, abs=1e-11)


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


def test_unstable_individual_is_infinite_and_leaves_the_others_alone() -> None:
    drives = varied(3, 1)
    table = drive_table(drives)
    table[..., DriveColumn.CURRENT_LIMIT] = np.inf
    expected = population_errors(references(1), T, table)
    table[1, 0, DriveColumn.PROPORTIONAL] *= 100
    found = population_errors(references(1), T, table)
    assert all(np.isinf(getattr(found, name)[1]).all() for name in NAMES)
    for p in (0, 2):
        assert found.rms_error[p] == expected.rms_error[p]


def changed(column: DriveColumn, value: float) -> NDArray[np.float64]:
    table = drive_table(varied(2, 3))
    table[1, 2, column] = value
    return table


@pytest.mark.parametrize(
    "change, said",
    [
        ({"table": np.ones((2, 3))}, r"table has shape \(2, 3\): give \(P, A, 21\)"),
        ({"table": changed(DriveColumn.MASS, 0.0)}, r"row \[1, 2\]: MASS = 0.0 must be finite and"),
        ({"table": changed(DriveColumn.OFFSET, np.nan)}, r"row \[1, 2\]: OFFSET = nan must be"),
        ({"table": changed(DriveColumn.STATIC_NEGATIVE, 1.0)}, "STATIC_NEGATIVE = 1.0 must be"),
        ({"table": changed(DriveColumn.VISCOUS_POSITIVE, -1.0)}, "VISCOUS_POSITIVE = -1.0"),
        ({"reference": np.zeros((10, 2))}, r"reference has shape \(10, 2\): give \(T, 3\)"),
        ({"reference": np.zeros((5, 10, 3))}, r"give \(T, 3\) or \(2, T, 3\)"),
        ({"reference": np.full((10, 3), np.nan)}, r"reference\[0, 0, 0\] = nan: give finite"),
        ({"load": np.full((10, 3), np.inf)}, r"load\[0, 0, 0\] = inf: give finite"),
        ({"load": np.zeros((9, 3))}, "load has 9 samples, the reference 10: give as many"),
        ({"substeps": 0}, "substeps = 0 must be at least 1"),
    ],
)
def test_inputs_out_of_range_are_refused(change: dict[str, object], said: str) -> None:
    known = {"reference": np.zeros((10, 3)), "period": T, "table": drive_table(varied(2, 3))}
    with pytest.raises(ValueError, match=said):
        population_errors(**{**known, **change})


def test_individuals_of_different_axes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"the individuals have \[1, 2\] axes"):
        drive_table([[AXIS], [AXIS, AXIS]])
