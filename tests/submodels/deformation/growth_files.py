"""Made recordings of growth: a heated rod of twenty cells, its sensors and its length."""

from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import pandas as pd

from pipeline.schema.arrays import Floats
from pipeline.schema.identity import MachineIdentity
from pipeline.signals.formats import ColumnSource, RecordSource, TableLayout
from pipeline.signals.ingest import ingest
from pipeline.signals.recordings import Channel
from pipeline.submodels.deformation.records import DeformationRecords

SENSORS = 5
CELLS = 20
NAMES = tuple(f"temperature_{k + 1}" for k in range(SENSORS))


@dataclass(frozen=True, kw_only=True)
class Made:
    """A recording before it is written: T rows of one minute."""

    speed: Floats
    temperatures: Floats
    ambient: Floats
    growth: Floats


def made(
    seed: int, *, minutes: int = 120, top: float = 6000.0, warm: bool = False, air: float = 20.0
) -> Made:
    """A speed that changes every twenty minutes heats the rod's front most; the probe starts at 0.

    ``warm`` lets it run for two hours before the recording.
    """
    rng = np.random.default_rng(seed)
    lead = 120 if warm else 0
    levels = rng.choice([0.0, 0.3, 0.6, 1.0], (minutes + lead) // 20 + 1) * top
    speed = np.repeat(levels, 20)[: minutes + lead]
    ambient = air + 1.5 * np.sin(np.arange(minutes + lead) / 90 + seed)
    rod = np.full(CELLS, ambient[0])
    heat = np.linspace(1.0, 0.1, CELLS) ** 2
    rows = []
    for n, outside in zip(speed, ambient, strict=True):
        for _ in range(6):
            flow = np.diff(rod, prepend=rod[0], append=rod[-1])
            rod = rod + 10 * (
                0.004 * np.diff(flow) + 2e-2 * heat * (n / 6000) ** 1.5 - 4e-4 * (rod - outside)
            )
        rows.append(rod.copy())
    field = np.array(rows)
    length = field @ np.linspace(0.25, 0.1, CELLS) + 1.5 * (speed / 6000) ** 2
    length = (length - length[lead])[lead:]
    places = np.linspace(0, CELLS - 1, SENSORS).astype(int)
    sensors = field[lead:, places] + rng.normal(0, 0.05, (minutes, SENSORS))
    return Made(
        speed=speed[lead:], temperatures=sensors, ambient=ambient[lead:],
        growth=length + rng.normal(0, 0.1, minutes),
    )  # fmt: skip


def table(one: Made) -> pd.DataFrame:
    """As a logger writes it."""
    columns = {"Time": 60.0 * np.arange(len(one.speed)), "Speed": one.speed}
    columns |= {f"T{k + 1}": one.temperatures[:, k] for k in range(SENSORS)}
    return pd.DataFrame(columns | {"Ambient": one.ambient, "Growth": one.growth})


LAYOUT = RecordSource(
    format="csv",
    files="growth/*.csv",
    table=TableLayout(
        time="Time", time_unit="s", delimiter=",",
        columns={
            "spindle_speed": ColumnSource(column="Speed", unit="rev/min"),
            **{name: ColumnSource(column=f"T{k + 1}", unit="degC") for k, name in enumerate(NAMES)},
            "ambient_temperature": ColumnSource(column="Ambient", unit="degC"),
            "growth": ColumnSource(column="Growth", unit="um"),
        },
    ),
)  # fmt: skip
RECORDS = DeformationRecords(
    recordings=("growth/*.csv",),
    temperatures={name: Channel(column=name) for name in NAMES},
    displacement=Channel(column="growth"),
    speed=Channel(column="spindle_speed"),
    ambient=Channel(column="ambient_temperature"),
    places={"temperature_2": "nose of the housing"},
)
IDENTITY = MachineIdentity(name="rig", description="made", origin="simulated", credit="made")
"""Section ``deformation_records`` of the made recordings."""


def write_raw(raw: Path, recordings: dict[str, Made]) -> None:
    """Recordings by name as files of a logger."""
    (raw / "growth").mkdir(parents=True, exist_ok=True)
    for name, one in recordings.items():
        table(one).to_csv(raw / "growth" / f"{name}.csv", index=False)


def signals_of(folder: Path, recordings: dict[str, Made]) -> Path:
    """Recordings after their ingest."""
    write_raw(folder / "raw", recordings)
    ingest(folder / "raw", folder / "signals", [LAYOUT], IDENTITY)
    return folder / "signals"


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return sha256(path.read_bytes()).hexdigest()
