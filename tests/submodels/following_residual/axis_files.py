"""Made recordings of one feed axis, as the ingest writes them, and the drive that they are of.

The axis is the drive's own model, to which 5 um for each m/s^2 of 8 ms ago are added: what a
network can learn from the command alone.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.nets.settings import TuningSettings, WindowTraining
from pipeline.schema.arrays import Floats
from pipeline.schema.drive import (
    DirectionFriction,
    DriveAxis,
    DriveModel,
    FeedDriveParameters,
    FitFacts,
    FrictionParameters,
    Servo,
)
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Correlation
from pipeline.schema.store import write_json
from pipeline.signals.recordings import Channel
from pipeline.submodels.cases import Roles
from pipeline.submodels.following_residual.features import (
    Features,
    before_motion,
    features_of,
    modelled_following,
)
from pipeline.submodels.following_residual.model import ResidualFitSettings
from pipeline.submodels.following_residual.records import (
    AxisRun,
    ErrorChannels,
    ResidualRecords,
    Run,
)
from pipeline.submodels.following_residual.submodel import Fitting, Judging, ResidualLimits
from pipeline.twin.drive import IdentifiedDrive, identified_drives

PERIOD = 0.002
LAG = 4
"""Samples by which what the drive's model lacks is behind the acceleration."""
PER_ACCELERATION = 5e-6
"""What it lacks [m / (m/s^2)]."""
NOISE = 2e-7
"""Of the measured error [m]."""
IDENTITY = MachineIdentity(name="rig", description="made", origin="simulated", credit="made")
POSITIONS = ErrorChannels(
    reference=Channel(column="x_command", unit="m"), position=Channel(column="x_actual", unit="m"),
    command=Channel(column="x_current"),
)  # fmt: skip
ALONE = ErrorChannels(error=Channel(column="x_error", unit="m"))
QUICK = ResidualFitSettings(
    step_s=0.004, length=12, horizon_s=0.02, settle_s=0.1, windows=60, folds=2, units=4, filters=2,
    kinds=("arx", "lstm"), estimators=("arx",), ridges=(1e-2, 1e-4), searched="",
    training=WindowTraining(epochs=2, patience=2, batch=32),
)  # fmt: skip
SEARCH = TuningSettings(
    population=2, generations=1, epochs=1, patience=1, windows=60, milestones=(), retrained=1,
    units=(3, 4),
)  # fmt: skip


def records(axis: ErrorChannels = POSITIONS, **changes: Any) -> ResidualRecords:
    """Section ``following_residual_records`` of the made recordings."""
    return ResidualRecords(**({"recordings": ("feed/*.csv",), "axes": {"X": axis}} | changes))


def fitting(
    training: tuple[str, ...], wanted: ResidualRecords, settings: ResidualFitSettings
) -> Fitting:
    """What the fit reads."""
    return Fitting(
        identity=IDENTITY, roles=Roles(training=training), following_residual_records=wanted,
        following_residual_fit=settings, tuning=SEARCH,
    )  # fmt: skip


def judging(training: tuple[str, ...], wanted: ResidualRecords) -> Judging:
    """What the judgement reads."""
    return Judging(
        identity=IDENTITY, roles=Roles(training=training), following_residual_records=wanted,
        following_residual_limits=ResidualLimits(),
    )  # fmt: skip


def drive_model(forward: float = 0.0) -> DriveModel:
    """Axis X with a velocity loop of 300 1/s and a loop gain of 60 1/s."""
    way = DirectionFriction(coulomb=150.0, static=190.0, stribeck_velocity=0.004, viscous=380.0)
    facts = FitFacts(
        samples=1000, relative_error_percent=1.0, bandwidth_Hz=None, condition=None, rank=1,
        correlation=Correlation(names=(), values=()),
    )  # fmt: skip
    axis = DriveAxis(
        command_unit="A", force_unit="N",
        feed_drive=FeedDriveParameters(
            mass=150.0, force_constant=100.0,
            friction=FrictionParameters(positive=way, negative=way),
        ),
        servo=Servo(
            position_gain=60.0, velocity_gain=450.0, integral_gain=18e3,
            velocity_feedforward=forward,
        ),
        fit=facts,
    )  # fmt: skip
    return DriveModel(
        submodel="drive",
        machine="rig",
        origin="simulated",
        parameters={},
        trained_on=(),
        axes={"X": axis},
    )


def drive(forward: float = 0.0) -> IdentifiedDrive:
    """The same, ready for simulation."""
    return identified_drives(drive_model(forward))["X"]


def write_drive(folder: Path) -> Path:
    """Folder of the identified drives."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(drive_model(), folder / "model.json")
    return folder


def strokes(seed: int, many: int = 700) -> Floats:
    """Commanded position [m] with rests and reversals, its acceleration continuous; (T,)."""
    random = np.random.default_rng(seed)
    levels = random.choice([-0.06, -0.03, 0.0, 0.02, 0.05], many // 70 + 1)
    speed = np.repeat(levels, 70)[:many]
    speed[:30] = 0.0
    for width in (15, 9):
        speed = np.convolve(speed, np.ones(width) / width, "same")
    position: Floats = np.cumsum(speed) * PERIOD
    return position


def lacked(reference: Floats) -> Floats:
    """What the drive's model lacks [m]; shape (T,)."""
    acceleration = before_motion(reference, PERIOD, None, None)["acceleration"]
    return PER_ACCELERATION * np.concatenate([np.full(LAG, acceleration[0]), acceleration[:-LAG]])


def table(seed: int, *, extra: bool = True, noise: float = NOISE, many: int = 700) -> pd.DataFrame:
    """A recording; without ``extra`` the drive's model lacks nothing but noise."""
    reference = strokes(seed, many)
    error, current = modelled_following("X", reference, PERIOD, drive())
    random = np.random.default_rng(1000 + seed)
    error = error + (lacked(reference) if extra else 0.0) + random.normal(0.0, noise, many)
    return pd.DataFrame({
        "t": PERIOD * np.arange(many), "x_command": reference, "x_actual": reference - error,
        "x_current": current + random.normal(0.0, 0.05, many),
    })  # fmt: skip


def error_table(seed: int) -> pd.DataFrame:
    """A recording of the error alone, which hangs together over a tenth of a second."""
    random = np.random.default_rng(seed)
    smooth = np.convolve(random.normal(0.0, 5e-6, 760), np.ones(50) / 7, "valid")[:700]
    return pd.DataFrame({"t": PERIOD * np.arange(700), "x_error": smooth})


def write_signals(folder: Path, tables: Mapping[str, pd.DataFrame]) -> Path:
    """``data/signals/<machine>`` with a recording ``feed/<name>.csv`` of each table.

    Tables of the same values are of the same raw bytes.
    """
    (folder / "traces").mkdir(parents=True, exist_ok=True)
    files = {}
    for name, one in tables.items():
        output = f"traces/feed__{name}.csv.parquet"
        pq.write_table(pa.Table.from_pandas(one, preserve_index=False), folder / output)
        files[f"feed/{name}.csv"] = {
            "sha256": sha256(one.to_csv(index=False).encode()).hexdigest(), "output": output,
            "rows": len(one), "first": None, "last": None,
        }  # fmt: skip
    (folder / "manifest.json").write_text(json.dumps({"files": files}))
    return folder


@dataclass(frozen=True)
class Made:
    """Recordings in memory as ``following_residual.fit.fit_axes`` takes them."""

    seed: int
    extra: bool = True
    noise: float = NOISE
    many: int = 700
    group: str = ""

    @property
    def features(self) -> Features:
        """With the drive's model."""
        one = table(self.seed, extra=self.extra, noise=self.noise, many=self.many)
        reference = one["x_command"].to_numpy(float)
        axis = AxisRun(
            error=reference - one["x_actual"].to_numpy(float), reference=reference,
            command=one["x_current"].to_numpy(float), filled=np.zeros(self.many, bool),
        )  # fmt: skip
        name = f"r{self.seed}"
        run = Run(
            name=name, file=name, group=self.group or name, sha256=name, period=PERIOD,
            axes={"X": axis},
        )  # fmt: skip
        return features_of(run, "X", drive(), step_s=QUICK.step_s, lead_mm=None)
