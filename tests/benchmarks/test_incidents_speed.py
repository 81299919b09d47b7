"""A week of the twin's state at 10 Hz (6 million rows) is monitored within a minute on one core."""

from collections.abc import Callable
from pathlib import Path
from time import process_time

import numpy as np
import pandas as pd
import pytest

from pipeline.monitoring.incident_settings import IncidentSettings
from pipeline.monitoring.incidents import monitored
from pipeline.monitoring.usual import identify_monitor
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.si import DAY
from pipeline.schema.twin_state import QUANTITIES, StateDay, TwinState, write_day

RATE_HZ, MOST_S = 10, 60.0


def write_full_day(folder: Path, day: str, seed: int) -> None:
    """Every column of a day that never stops."""
    n = int(DAY * RATE_HZ)
    rng, t = np.random.default_rng(seed), np.arange(n) / RATE_HZ
    words = {"execution": "ACTIVE", "program": f"O{seed}", "tool_number": "4", "mode": "cut"}
    values = {name: np.full(n, one, object) for name, one in words.items()}
    values |= {
        "spindle_steady": np.full(n, True), "spindle_speed": 6000 + rng.normal(0, 5, n),
        "spindle_load": 40 + rng.normal(0, 3, n), "path_feedrate": 20 + rng.normal(0, 1, n),
    }  # fmt: skip
    for k, (name, (_, parts)) in enumerate(QUANTITIES.items()):
        estimated = 30 + np.sin(t / 3600 + k)
        own = {"estimated": estimated, "low": estimated - 2, "high": estimated + 2,
               "residual": rng.normal(0, 0.5, n)}  # fmt: skip
        own["measured"] = estimated + own["residual"]
        values |= {f"{name}_{part}": own[part] for part in parts}
    index = pd.date_range(day, periods=n, freq=pd.Timedelta(seconds=1 / RATE_HZ), tz="UTC")
    write_day(index, values, folder / f"days/{day}.parquet")


@pytest.mark.benchmark(timer=process_time)
def test_a_week_at_10_hz(tmp_path: Path, benchmark: Callable[..., object]) -> None:
    days = [f"2026-01-{k:02d}" for k in range(5, 12)]
    for seed, day in enumerate(days):
        write_full_day(tmp_path, day, seed % 3)
    state = TwinState(
        bundle="b", submodels={}, period_s=1 / RATE_HZ,
        days={day: StateDay(role="training" if k < 3 else "held_out", seconds=DAY, known_s={},
                            unknown={}) for k, day in enumerate(days)},
    )  # fmt: skip
    settings = IncidentSettings()
    usual = identify_monitor(state, tmp_path, tmp_path, settings)
    mill = MachineIdentity(name="mill")

    def week() -> None:
        found = monitored(state, tmp_path, tmp_path, usual, identity=mill, settings=settings,
                          conditions={})  # fmt: skip
        assert found.worked_s == pytest.approx(7 * DAY)

    benchmark.pedantic(week, rounds=1)  # type: ignore[attr-defined]
    seconds = benchmark.stats["min"]  # type: ignore[attr-defined]
    assert seconds <= MOST_S, f"a week takes {seconds:.1f} s"
