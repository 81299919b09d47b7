"""Small but realistic folders of a machine, as the stages before the report leave them."""

import json
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.report.folders import FleetInfo, MachineFolders

UTC_NS = pa.timestamp("ns", tz="UTC")
FIRST = date(2024, 3, 4)  # a Monday
FLEET = FleetInfo(
    name="Hall 3",
    git_commit="4f1c2a9",
    params_sha256="c0ffee" * 10,
    notes=("The quick budget cut the forest to 20 trees.",),
    versions={"numpy": "2.4.6"},
)


def empty_machine(root: Path, name: str, origin: str = "simulated", **kwargs) -> MachineFolders:
    """A machine of which no file exists yet."""
    return MachineFolders(
        name=name,
        signals=root / "signals" / name,
        clean=root / "clean" / name,
        models=root / "models" / name,
        golden=root / "golden" / f"{name}.json",
        origin=origin,
        **kwargs,
    )


def machine(
    root: Path,
    name: str,
    origin: str = "simulated",
    days: int = 4,
    passed: bool = True,
    program: str = "O1001",
    state: str = "FEED_HOLD",
    **kwargs,
) -> MachineFolders:
    """A machine with ``days`` recorded days, of which the last two are golden."""
    truth = root / "truth" / f"{name}.json" if origin == "simulated" else None
    folders = empty_machine(root, name, origin, truth=truth, **kwargs)
    names = [(FIRST + timedelta(days=i)).isoformat() for i in range(days)]
    for index, day in enumerate(names):
        write_state(folders.clean / "state" / f"{day}.parquet", day, program, state, seed=index)
    write_signals(folders, names)
    write_cycles(folders, names, program)
    write_model(folders, names, passed)
    if truth is not None:
        truth.parent.mkdir(parents=True, exist_ok=True)
        truth.write_text(json.dumps({
            "simulated": True, "cycles": [{}] * (3 * days),
            "parameters": {"cooling_rate": 0.0007, "spindle": {"rated_power": 15000.0}},
            "log": {"counts": {"rejected": 12, "glitches": {"zero": 4}}},
        }))  # fmt: skip
    return folders


def nanoseconds(day: str) -> int:
    return int(np.datetime64(day, "ns").astype(np.int64))


def write_table(path: Path, columns: dict) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(pa.table(columns), path, compression="zstd")


def spindle(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Speed [rev/min] and whether it is held, second by second from 06:00 to 16:00."""
    rng = np.random.default_rng(seed)
    blocks = rng.choice([0.0, 3000.0, 8000.0, 12000.0], size=40, p=[0.3, 0.3, 0.2, 0.2])
    speed = np.repeat(blocks, 900)
    held = (np.repeat(rng.random(40) < 0.3, 900) & (speed == 0)).astype(float)
    return speed, held


def write_state(path: Path, day: str, program: str, state: str, seed: int) -> None:
    speed, held = spindle(seed)
    n = len(speed)
    execution = np.where(speed > 0, "ACTIVE", "READY").astype(object)
    execution[5000:5600] = state
    execution[9000:9400] = None
    start = nanoseconds(day) + 6 * 3600 * 10**9
    write_table(path, {
        "time": pa.array(start + np.arange(n) * 10**9, UTC_NS),
        "execution": pa.array(execution, pa.string()),
        "program": pa.array([program] * n),
        "spindle_speed": pa.array(speed),
        "spindle_position_control": pa.array(held),
    })  # fmt: skip


def write_signals(folders: MachineFolders, days: list[str]) -> None:
    files = {
        f"agent/{d}.txt": {
            "sha256": f"{i:064x}", "format": "shdr", "read": 60_000, "kept": 59_997, "rejected": 3,
            "rows": 60_100, "first": f"{d}T06:00:00.125Z", "last": f"{d}T15:59:59.9Z",
            "output": f"observations/{d}.parquet", "reason": None,
        }
        for i, d in enumerate(days)
    }  # fmt: skip
    folders.signals.mkdir(parents=True, exist_ok=True)
    (folders.signals / "manifest.json").write_text(json.dumps({"files": files}))
    write_table(folders.signals / "rejected.parquet", {
        "file": [f"agent/{d}.txt" for d in days for _ in range(3)],
        "line": pa.array([10, 2000, 30_000] * len(days), pa.uint64()),
        "reason": [f"'{d}T24:61' is no time" for d in days for _ in range(2)]
        + ["the line has no value"] * len(days),
        "excerpt": ["2024-03-04T24:61|S1temp|33"] * (3 * len(days)),
    })  # fmt: skip


def write_cycles(folders: MachineFolders, days: list[str], program: str) -> None:
    starts = np.array([nanoseconds(d) + h * 3600 * 10**9 for d in days for h in (6, 9, 12)])
    n = len(starts)
    write_table(folders.clean / "cycles.parquet", {
        "cycle": np.arange(n), "program": [program] * n, "part": pa.array([None] * n, pa.string()),
        "start": pa.array(starts, UTC_NS), "end": pa.array(starts + 2400 * 10**9, UTC_NS),
        "active_s": [2000.0] * n, "feed_hold_s": [60.0] * n, "interrupted_s": [0.0] * n,
        "idle_s": [340.0] * n, "tool_changes": [4] * n, "complete": [True] * (n - 1) + [False],
    })  # fmt: skip
    write_table(folders.clean / "segments.parquet", {
        "start": pa.array(starts, UTC_NS), "end": pa.array(starts + 1800 * 10**9, UTC_NS),
        "kind": ["cut", "air", "warm_up"] * len(days),
    })  # fmt: skip
    midnight = np.array([nanoseconds(d) for d in days])
    write_table(folders.clean / "audit.parquet", {
        "time": pa.array(midnight, UTC_NS), "data_item": ["S1temp"] * len(days),
        "before": ["0"] * len(days), "after": pa.array([None] * len(days), pa.string()),
        "rule": ["zero"] * len(days),
    })  # fmt: skip
    write_table(folders.clean / "gaps.parquet", {
        "data_item": pa.array(["S1temp"] * (len(days) - 1) + [None], pa.string()),
        "start": pa.array(midnight, UTC_NS), "end": pa.array(midnight + 1800 * 10**9, UTC_NS),
        "cause": ["unavailable"] * (len(days) - 1) + ["silence"],
    })  # fmt: skip


def errors(mae: float) -> dict:
    return {"mae_K": mae, "rmse_K": 1.3 * mae, "max_K": 4 * mae}


def judged(mae: float, passed: bool) -> dict:
    return {
        "n_windows": 10, "n_seconds": 36_000, "model": errors(mae), "physics": errors(1.4 * mae),
        "persistence": errors(3.1), "day_mean": errors(3.6), "better_than_persistence": mae < 3.1,
        "passed": passed,
    }  # fmt: skip


def write_model(folders: MachineFolders, days: list[str], passed: bool) -> None:
    golden, training = days[-2:], days[:-2]
    mae = 0.8 if passed else 2.7
    folders.models.mkdir(parents=True, exist_ok=True)
    folders.golden.parent.mkdir(parents=True, exist_ok=True)
    folders.golden.write_text(json.dumps({
        "machine": folders.name, "week": {"from": golden[0], "to": golden[-1]},
        "files": [{"file": f"agent/{d}.txt", "sha256": f"{i:064x}"} for i, d in enumerate(golden)],
    }))  # fmt: skip
    way = "bounded least squares over the training days"
    (folders.models / "spindle_thermal.json").write_text(json.dumps({
        "model": "spindle_thermal_network", "machine": folders.name, "origin": folders.origin,
        "parameters": {
            "cooling_rate": {"value": 0.0007, "unit": "1/s", "interval_95": [0.00065, 0.00076],
                             "determined": True, "how": way},
            "windage": {"value": None, "unit": "K/s/(rad/s)^2", "interval_95": None,
                        "determined": False, "how": "its interval holds 0; run near top speed"},
        },
        "fit": {"nodes": 1, "rmse_K": 1.2}, "training_days": training,
        "found_from": [{"file": f"state/{d}.parquet", "sha256": "ab" * 32} for d in training],
    }))  # fmt: skip
    rows = [{"day": d, **judged(mae + 0.1 * i, passed)} for i, d in enumerate(golden)]
    (folders.models / "validation.json").write_text(json.dumps({
        "machine": folders.name, "origin": folders.origin, "signal": "spindle_temperature",
        "unit": "CELSIUS", "limits": {"mae_K": 2.0, "rmse_K": 3.0},
        "golden": {"from": golden[0], "to": golden[-1], "sha256": "cd" * 32},
        "windows": {"length_s": 3600, "days": rows, "all": judged(mae, passed)},
        "free_run": {"days": [{"day": d, **judged(1.5 * mae, passed)} for d in golden],
                     "all": judged(1.5 * mae, passed)},
        "verdict": "passed" if passed else "failed",
        "reasons": [] if passed else ["MAE over one hour is above 2.0 K"],
    }))  # fmt: skip
    write_predictions(folders, golden, mae)


def write_predictions(folders: MachineFolders, golden: list[str], mae: float) -> None:
    times, measured, window, free = [], [], [], []
    rng = np.random.default_rng(5)
    for index, day in enumerate(golden):
        heat = spindle(index)[0][::10] / 12_000
        warm = 22 + 18 * np.convolve(heat, np.exp(-np.arange(900) / 180) / 180)[: len(heat)]
        error = np.convolve(rng.normal(size=len(heat)), np.ones(90) / 9, mode="same")
        times.append(nanoseconds(day) + (6 * 3600 + 10 * np.arange(len(heat))) * 10**9)
        measured.append(np.round(warm))
        window.append(warm + mae * error)
        free.append(warm + 1.5 * mae * error)
        measured[-1][700:760] = np.nan
    write_table(folders.models / "predictions.parquet", {
        "time": pa.array(np.concatenate(times), UTC_NS),
        "day": np.repeat(golden, [len(t) for t in times]),
        "measured": pa.array(np.concatenate(measured), from_pandas=True),
        "model_window": np.concatenate(window), "model_free": np.concatenate(free),
    })  # fmt: skip
