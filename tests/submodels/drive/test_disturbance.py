"""Where a recorded disturbance enters, on axes that share nothing with the twin.

One mass with cogging and friction in both directions; servo at 1 kHz, on differenced counts of the
encoder.  ``EMPS`` has a P velocity loop with the gains, resolution and command noise of that
benchmark's record; ``PI`` an integral and velocity feed-forward, which tell all places apart.
"""

import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.schema.drive import (
    DirectionFriction,
    DriveModel,
    FeedDriveParameters,
    FrictionParameters,
    Servo,
)
from pipeline.submodels.drive.comparison import (
    _added,
    axis_comparison,
    following_comparison,
)
from pipeline.submodels.drive.disturbance import Disturbance, disturbance_of, law_fits
from pipeline.submodels.drive.feed_drive import identify_feed_drive
from pipeline.submodels.drive.records import (
    AxisConstants,
    AxisPrior,
    AxisRecord,
    DriveFitSettings,
    DrivePrior,
    Recording,
)
from pipeline.submodels.drive.servo_fit import identify_servo
from pipeline.submodels.drive.submodel import SUBMODEL
from pipeline.submodels.statistics import Factor
from pipeline.twin.drive import IdentifiedDrive
from tests.submodels.drive.shown_drives import shown
from tests.submodels.drive.test_judging import judged, stored
from tests.submodels.made_pages import made, words

__all__ = ["judged"]
PERIOD = 1e-3
STEPS = 10
"""Steps of the mechanics in a sample."""


@dataclass(frozen=True)
class Axis:
    """Truth, in SI."""

    kp: float = 160.0
    kv: float = 243.0
    ki: float = 0.0
    ff: float = 0.0
    kf: float = 35.15
    mass: float = 95.0
    viscous: float = 203.0
    coulomb: float = 20.0
    noise: float = 0.025
    unit: str = "V"
    central: bool = False
    """Whether the control looks one sample of its reference ahead, for central differences."""

    @property
    def constants(self) -> AxisConstants:
        return AxisConstants(
            force_constant=self.kf, position_gain=self.kp, velocity_gain=self.kv,
            integral_gain=self.ki, velocity_feedforward=self.ff,
        )  # fmt: skip


EMPS = Axis()
PI = Axis(kp=60.0, kv=450.0, ki=18e3, ff=0.7, kf=100.0, mass=150.0, noise=0.05, unit="A")
AXES = {"EMPS": EMPS, "PI": PI}
CENTRAL = replace(PI, central=True)
EACH = ["EMPS", pytest.param("PI", marks=pytest.mark.proof)]


@njit(cache=True)
def _run(r, d, where, p, central, position, command, hum):  # pragma: no cover
    kp, kv, ki, ff, kf, mass, viscous, coulomb = p
    x, v, summed, before, h = r[0], 0.0, 0.0, r[0], 1e-3 / 10
    wanted = r + d if where == 0 else r.copy()
    for i in range(len(r)):
        seen = np.round(x / 5e-8) * 5e-8
        late = wanted[max(i - 1, 0)]
        fed = (wanted[i] - late) / 1e-3
        if central:
            fed = (wanted[min(i + 1, len(r) - 1)] - late) / 2e-3
        speed = kp * (wanted[i] - seen) + ff * fed
        if where == 1:
            speed += d[i]
        error = speed - (seen - before) / 1e-3
        before = seen
        summed += ki * error * 1e-3
        u = kv * error + summed + (d[i] if where == 2 else 0.0)
        position[i], command[i] = seen, u
        push = d[i] if where == 3 else 0.0
        for _ in range(10):
            friction = (
                coulomb * np.tanh(v / 5e-4) + viscous * v + 3.0 * np.sin(2 * np.pi * x / 2e-3)
            )
            v += h / mass * (kf * u - friction - push + hum[i])
            x += h * v


WHERE = {"reference": 0, "speed": 1, "command": 2, "force": 3, "none": 4}


def reference(rng: np.random.Generator) -> np.ndarray:
    """Strokes forth and back at five speeds, of random order [m]."""
    parts = [np.zeros(200)]
    for speed in rng.permutation([0.01, 0.03, 0.06, 0.1, 0.13]):
        ramp = np.linspace(0, speed, max(int(speed / 2.0 / PERIOD), 1), endpoint=False)
        forth = np.r_[ramp, np.full(500, speed), ramp[::-1]]
        parts += [forth, np.zeros(100), -forth, np.zeros(100)]
    smooth = np.convolve(np.concatenate(parts), np.ones(40) / 40, "same")
    return np.cumsum(smooth) * PERIOD


def pulses(rng: np.random.Generator, samples: int) -> np.ndarray:
    """Pulses of 1 of random sign, start and length."""
    found = np.zeros(samples)
    for start in np.arange(400, samples - 500, 600) + rng.integers(
        0, 150, (samples - 900) // 600 + 1
    ):
        found[start : start + rng.integers(60, 300)] = rng.choice([-1.0, 1.0])
    return found


def recorded(
    axis: Axis, where: str | None, seed: int, size: float = 0.0, per_unit: float = 1.0,
    late: int = 0, unit: str = "",
) -> Recording:  # fmt: skip
    """A recording whose channel is pulses of ``size`` in SI, over ``per_unit``."""
    rng = np.random.default_rng(seed)
    r = reference(rng)
    pushed = size * pulses(rng, len(r))
    entering = np.roll(pushed, late)
    p = (axis.kp, axis.kv, axis.ki, axis.ff, axis.kf, axis.mass, axis.viscous, axis.coulomb)
    position, command, hum = np.empty(len(r)), np.empty(len(r)), rng.standard_normal(len(r)) * 5
    _run(r, entering, WHERE[where or "none"], p, axis.central, position, command, hum)
    command = command + axis.noise * rng.standard_normal(len(r))
    record = AxisRecord(
        command=command, position=position, reference=r, command_unit=axis.unit,
        constants=axis.constants, load=None if where is None else pushed / per_unit,
        load_unit=unit,
    )  # fmt: skip
    return Recording(name=f"{seed}.csv", trained=where is None, period=PERIOD,
                     air=np.ones(len(r), bool), axes={"X": record})  # fmt: skip


def identified(axis: Axis) -> IdentifiedDrive:
    """The drive as the stage identifies it from a recording without pulses."""
    settings = DriveFitSettings(compare=False)
    training = [recorded(axis, None, 1000 + i) for i in range(2)]
    fit = identify_feed_drive(training, "X", DrivePrior(axes={"X": AxisPrior()}), settings)
    servo = identify_servo(training, "X", settings)
    return IdentifiedDrive(
        feed_drive=fit.feed_drive, servo=servo.servo, command_unit=fit.command_unit,
        force_unit=fit.force_unit, bandwidth_Hz=fit.bandwidth_Hz, delay=fit.delay,
    )  # fmt: skip


class Drives(dict[str, IdentifiedDrive]):
    """Each identified when a test first asks for it."""

    def __missing__(self, name: str) -> IdentifiedDrive:
        self[name] = identified((AXES | {"CENTRAL": CENTRAL})[name])
        return self[name]


@pytest.fixture(scope="module")
def drives() -> dict[str, IdentifiedDrive]:
    return Drives()


def kinds(axis: Axis) -> list[tuple[str, float, float, str, str]]:
    """Entry, size in SI, SI per unit of the channel, declared unit, and a word of the cause."""
    volt = 1.0 if axis is EMPS else 1.5
    speed = volt / axis.kv
    return [
        ("reference", speed / axis.kp, 1.0, "m", "reference position"),
        ("reference", speed / axis.kp, 1e-3, "", "as if in mm"),
        ("speed", speed, 1.0, "", "speed command"),
        ("command", volt, 1.0, "", "command of the motor"),
        ("command", volt, 1 / axis.kf, "", "as if in N"),
        ("force", volt * axis.kf, 1.0, "N", ""),
        ("force", volt * axis.kf, -1.0, "N", "sign is the opposite"),
        ("force", volt * axis.kf, 1e3, "N", "as if in kN, not in N"),
        ("none", volt, 1.0, "N", "explains nothing"),
    ]


def found_in(one: Recording, drive: IdentifiedDrive) -> Disturbance:
    found = disturbance_of(one, "X", drive)
    assert found is not None
    return found


@pytest.mark.parametrize("name", EACH)
def test_place_factor_and_cause_of_each_kind(name, drives):
    for seed, (entry, size, per_unit, unit, word) in enumerate(kinds(AXES[name])):
        found = found_in(recorded(AXES[name], entry, seed, size, per_unit, 0, unit), drives[name])
        assert found.entry == entry, (entry, per_unit, found)
        assert word in found.words and (word or not found.words), found.words
        if entry == "none":
            assert found.factor is None
        else:
            assert found.factor is not None
            assert found.factor.value == pytest.approx(per_unit, rel=0.05)
            assert abs(found.delay) < 2e-3


@pytest.mark.proof
@pytest.mark.parametrize("name", [*AXES, "CENTRAL"])
@pytest.mark.parametrize("kind", range(9))
def test_place_is_right_in_a_hundred_of_a_hundred(name, kind, drives):
    axis = CENTRAL if name == "CENTRAL" else AXES[name]
    entry, size, per_unit, unit, _ = kinds(axis)[kind]
    every = [
        found_in(recorded(axis, entry, seed, size, per_unit, 0, unit), drives[name])
        for seed in range(100)
    ]
    assert [one.entry for one in every] == [entry] * 100
    factors = [one.factor for one in every if one.factor is not None]
    assert len(factors) == (0 if entry == "none" else 100)
    held = [abs(one.value - per_unit) <= one.half_width for one in factors]
    assert not held or sum(held) >= 85  # of intervals of 95 %


@pytest.mark.parametrize("name", EACH)
def test_a_closed_loop_with_pulses_is_followed_wherever_they_enter(name, drives):
    """Left out, the pulses make the twin hardly better than the plain guess."""
    for entry, size, per_unit, unit, _ in kinds(AXES[name])[:-1]:
        one = recorded(AXES[name], entry, 77, size, per_unit, 0, unit)
        found = axis_comparison(one, "X", drives[name], 4).following
        without = following_comparison(one, "X", drives[name], 4, None)
        assert not isinstance(found, str) and not isinstance(without, str)
        # standing, the simulated axis creeps on its friction while the twin's sticks
        moving = np.abs(np.gradient(one.axes["X"].reference, PERIOD)) > 1e-3
        error, left = (np.std((each.modelled - each.measured)[moving]) for each in (found, without))
        assert error < 0.2 * left, (entry, per_unit)  # the rest is cogging
        if entry in ("speed", "command"):
            # the command that is shown holds what was added to it, as the recorded one does
            command = one.axes["X"].command
            missed = np.std((found.command - command)[moving])
            assert missed < 0.1 * np.std(command[moving]), entry


@pytest.mark.parametrize(
    ("name", "kind", "seeds"),
    [
        ("PI", 0, 1),
        ("CENTRAL", 2, 1),
        *(pytest.param(name, kind, 3, marks=pytest.mark.proof)
          for name in ("PI", "CENTRAL") for kind in (0, 2)),
    ],
)  # fmt: skip
def test_a_disturbance_tells_the_differences_that_are_fed_forward(name, kind, seeds, drives):
    """The factor is within its interval, and what the choice leaves open is below 1 %."""
    axis = {"PI": PI, "CENTRAL": CENTRAL}[name]
    entry, size, per_unit, unit, _ = kinds(axis)[kind]
    for seed in range(seeds):
        one = recorded(axis, entry, seed, size, per_unit, 0, unit)
        by_law = {each: fits[entry] for each, fits in law_fits(one, "X", drives[name]).items()}
        likelier = max(by_law, key=lambda each: by_law[each].likelihood)
        assert likelier == ("central" if axis.central else "backward")
        found = found_in(one, drives[name]).factor
        assert found is not None
        assert abs(found.value - per_unit) < found.half_width < 0.01 * per_unit


@pytest.mark.parametrize("seed", [5, *(pytest.param(k, marks=pytest.mark.proof) for k in (6, 7))])
def test_a_delay_is_found_with_its_interval(seed, drives):
    """The servo reads a sample; a force is held until the next, half a sample later on average."""
    for entry, size, held in (("command", 1.0, 0.0), ("force", 40.0, 0.5 * PERIOD)):
        found = found_in(recorded(EMPS, entry, seed, size, late=20), drives["EMPS"])
        assert found.entry == entry
        assert found.delay_half_width < 1e-3
        assert abs(found.delay - 0.020 - held) < found.delay_half_width
        assert "ms behind its channel" in found.words


def test_the_twin_has_a_force_when_it_acts():
    """The middle of its impulse is the delay behind that of the channel; the steps are held."""
    channel = np.r_[np.zeros(40), np.hanning(21), np.zeros(40)]
    factor = Factor(value=3.0, half_width=0.1)
    servo = ServoParameters(position_gain=40.0, velocity_gain=300.0, integral_gain=0.0)
    for substeps in (1, 4):
        fine = PERIOD / substeps
        late = Disturbance(entry="force", factor=factor, unit="N", delay=7.3 * PERIOD)
        load = _added(channel, late, servo, fine, substeps).load
        middle = fine * (np.arange(len(load)) + 0.5) @ load / load.sum()
        assert middle == pytest.approx((50 + 7.3) * PERIOD, abs=1e-3 * PERIOD)
        assert load.sum() * fine == pytest.approx(3.0 * channel.sum() * PERIOD, rel=1e-3)


def test_a_factor_that_is_not_determined_is_never_taken_as_one(drives):
    one = recorded(EMPS, "none", 3, 30.0)
    with_channel = axis_comparison(one, "X", drives["EMPS"], 4)
    record = replace(one.axes["X"], load=None)
    silent = axis_comparison(replace(one, axes={"X": record}), "X", drives["EMPS"], 4)
    assert with_channel.disturbance is not None and with_channel.disturbance.factor is None
    for left, right in ((with_channel.following, silent.following),):
        assert not isinstance(left, str) and not isinstance(right, str)
        assert np.array_equal(left.modelled, right.modelled)
    assert np.array_equal(with_channel.force.modelled, silent.force.modelled)


def test_a_channel_that_stands_or_a_loop_that_is_not_known_is_said(drives):
    one = recorded(EMPS, "force", 3, 30.0)
    still = replace(one, axes={"X": replace(one.axes["X"], load=np.full(one.samples, 4.0))})
    assert "never changes" in found_in(still, drives["EMPS"]).words
    by_law = recorded(EMPS, "command", 3, 1.0)
    blind = found_in(by_law, replace(drives["EMPS"], servo=None))
    assert blind.entry == "none" and "as a force on the axis only" in blind.words


def test_places_that_a_loop_does_not_tell_apart_are_said_unless_the_unit_tells(drives):
    odd = found_in(recorded(EMPS, "command", 9, 1.0, 0.4), drives["EMPS"])
    assert odd.entry == "command" and "do not tell" in odd.words and "move alike" in odd.words
    assert "its factor is 0.4" in odd.words
    told = found_in(recorded(PI, "command", 9, 1.5, 0.4), drives["PI"])
    assert told.entry == "command" and "do not tell" not in told.words


RECORDINGS = os.environ.get("KERF_RECORDINGS")


@pytest.mark.skipif(RECORDINGS is None, reason="KERF_RECORDINGS names no folder of recordings")
def test_pulses_on_the_benchmarks_own_record_enter_where_they_were_added():
    """Taken off the recorded reference, they are what the servo followed and the record lacks."""
    from scipy.io import loadmat

    found = loadmat(Path(str(RECORDINGS)) / "emps" / "DATA_EMPS.mat", squeeze_me=True)
    k, kp, kv = (float(found[name]) for name in ("gtau", "kp", "kv"))
    constants = AxisConstants(
        force_constant=k, position_gain=kp, velocity_gain=kv, integral_gain=0.0
    )
    record = AxisRecord(
        command=found["vir"], position=found["qm"], reference=found["qg"], command_unit="V",
        constants=constants,
    )  # fmt: skip
    samples = len(found["t"])
    one = Recording(name="DATA_EMPS.mat", trained=True, period=PERIOD,
                    air=np.ones(samples, bool), axes={"X": record})  # fmt: skip
    way = DirectionFriction(coulomb=20.4, static=20.4, stribeck_velocity=0.005, viscous=203.5)
    screw = FeedDriveParameters(  # as published
        mass=95.1, force_constant=k, offset=-3.16,
        friction=FrictionParameters(positive=way, negative=way),
    )  # fmt: skip
    drive = IdentifiedDrive(
        feed_drive=screw, servo=identify_servo([one], "X", DriveFitSettings(compare=False)).servo,
        command_unit="V", force_unit="N", bandwidth_Hz=12.0,
    )  # fmt: skip
    shape = pulses(np.random.default_rng(1), samples)
    volts = 0.5 * shape
    places = {
        ("reference", "m"): volts / (kp * kv), ("speed", "mm/s"): 1e3 * volts / kv,
        ("command", "N"): k * volts,
    }  # fmt: skip
    for (entry, unit), channel in places.items():
        pushed = replace(record, reference=record.reference - volts / (kp * kv), load=channel)
        seen = found_in(replace(one, axes={"X": pushed}), drive)
        assert seen.entry == entry and (unit == "m" or f"as if in {unit}" in seen.words), seen
    noise = replace(record, load=shape)
    assert found_in(replace(one, axes={"X": noise}), drive).entry == "none"


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
def model(drives) -> DriveModel:
    """The drive as identified from recordings without pulses, as its file has it."""
    drive = drives["EMPS"]
    assert drive.servo is not None
    found = stored([replace(recorded(EMPS, None, 1000), name="train.csv")])
    servo = {k: v for k, v in asdict(drive.servo).items() if v != float("inf")}
    axis = replace(
        found.axes["X"], command_unit=drive.command_unit, force_unit=drive.force_unit,
        feed_drive=drive.feed_drive,
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
