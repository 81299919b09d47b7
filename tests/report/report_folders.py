"""Small but realistic folders of a machine, as the stages before the report leave them."""

import json
from datetime import date, timedelta
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from page_reader import every_word

from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.pages import write_report
from pipeline.schema.golden import Days, FrozenSet, GoldenSets
from pipeline.schema.model import Correlation, Parameter, SourceFile, Training
from pipeline.schema.predictions import write_predictions
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Figures, GoldenUsed, JudgedCase, Score, Verdict
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import Forest, SpindleFitFacts, SpindleModelFile, SpindleRecords

UTC_NS = pa.timestamp("ns", tz="UTC")
ABOVE = "MAE over one hour is above 2.0 K"
FIRST = date(2024, 3, 4)  # a Monday
FLEET = FleetInfo(
    name="Hall 3",
    git_commit="4f1c2a9",
    params_sha256="c0ffee" * 10,
    notes=("The quick budget cut the forest to 20 trees.",),
    versions={"numpy": "2.4.6"},
)


def reported(root: Path, folders: MachineFolders) -> str:
    """Every word of the report of a machine ``m``."""
    write_report([folders], FLEET, None, root / "out")
    return every_word(root / "out" / "m.html")


def empty_machine(root: Path, name: str, origin: str = "simulated", **kwargs) -> MachineFolders:
    """A machine of which no file exists yet."""
    return MachineFolders(
        name=name,
        signals=root / "signals" / name,
        clean=root / "clean" / name,
        models=root / "models" / name,
        programs=root / "programs" / name,
        champion=root / "champion" / name,
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
    folders = empty_machine(root, name, origin, truth=truth, submodels=("spindle",), **kwargs)
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
            "parameters": {"spindle": {"rated_power": 15000.0}},
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


def live_table(folders: MachineFolders, last: str) -> None:
    """A table of temperatures that goes on until ``last``, beside a log that ends earlier."""
    path = folders.signals / "manifest.json"
    known = json.loads(path.read_text())
    known["files"]["thermo/a.csv"] = {
        "sha256": "0" * 64, "read": 90_000, "kept": 90_000, "rejected": 0, "format": "csv",
        "first": "2024-03-04T00:00:00Z", "last": last,
    }  # fmt: skip
    path.write_text(json.dumps(known))


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
    write_alarms(folders, midnight + 7 * 3600 * 10**9)


def write_alarms(folders: MachineFolders, starts: np.ndarray) -> None:
    """A warning of a minute at each time; the last is a fault that is still active."""
    last = np.arange(len(starts)) == len(starts) - 1

    def of(warning: object, fault: object, kind: pa.DataType | None = None) -> pa.Array:
        return pa.array([fault if one else warning for one in last], kind or pa.string())

    end = [None if one else int(t) + 60 * 10**9 for t, one in zip(starts, last, strict=True)]
    write_table(folders.clean / "alarms.parquet", {
        "data_item": of("coolant_c", "servo_c"), "level": of("warning", "fault"),
        "code": of("217", "62"), "message": of("COOLANT LEVEL LOW", "FOLLOWING ERROR"),
        "start": pa.array(starts, UTC_NS), "end": pa.array(end, pa.int64()).cast(UTC_NS),
        "ended": of("cleared", "open"), "program": of("O1001", None),
        "line": of(120.0, None, pa.float64()),
    })  # fmt: skip


def errors(mae: float) -> dict:
    return {"mae": mae, "rmse": 1.3 * mae, "max": 4 * mae}


def score(mae: float, group: str, regime: str, passed: bool) -> Score:
    decides = group != "all" and regime == "windows"
    return Score(
        **errors(mae), quantity="spindle_temperature", unit="K", group=group, regime=regime,
        role="golden", n=3600, limits={"mae": 2.0, "rmse": 3.0} if decides else {},
        baselines={"persistence": Figures(**errors(3.1)), "physics": Figures(**errors(1.4 * mae)),
                   "day_mean": Figures(**errors(3.6))},
        status="not judged" if not decides else "passed" if passed else "failed",
        reasons=(ABOVE,) if decides and not passed else (),
    )  # fmt: skip


def parameter(
    value: float | None, unit: str, spread: float = 0.08, method: str = "", remedy: str = ""
) -> Parameter:
    interval = None if value is None else (value * (1 - spread), value * (1 + spread))
    return Parameter(value=value, unit=unit, interval_95=interval, determined=value is not None,
                     method=method, remedy=remedy)  # fmt: skip


def log_of(day: str, index: int) -> SourceFile:
    return SourceFile(file=f"agent/{day}.txt", sha256=f"{index:064x}")


def spindle_model(folders: MachineFolders, training: list[str]) -> SpindleModelFile:
    method = "bounded least squares over the training days"
    return SpindleModelFile(
        submodel="spindle", machine=folders.name, origin=folders.origin,
        parameters={"": {
            "cooling_rate": parameter(0.0007, "1/s", method=method),
            "windage": parameter(None, "K/s/(rad/s)^2", method="its interval holds 0",
                                 remedy="run near top speed"),
        }},
        trained_on=tuple(
            Training(case=day, group=day, files=(log_of(day, index),))
            for index, day in enumerate(training)
        ),
        network=SpindleThermalParameters(cooling_rate=0.0007), records=SpindleRecords(),
        fit=SpindleFitFacts(
            step_s=10.0, nodes=1, rmse_K=1.2, rmse_days_left_out_K={}, condition=12.0,
            correlation=Correlation(), evaluations=200, seconds=72_000.0, bridged_s=0.0,
        ),
        training_days=tuple(training),
        forest=Forest(used=False, why="it does not help", sources=(), extra=(), days=(),
                      examples=0, rmse_days_left_out_K=None, rmse_without_K=None),
    )  # fmt: skip


def spindle_verdict(folders: MachineFolders, golden: list[str], passed: bool) -> Verdict:
    mae = 0.8 if passed else 2.7
    days = [score(mae + 0.1 * i, day, "windows", passed) for i, day in enumerate(golden)]
    free = [score(1.5 * mae, day, "free run", passed) for day in golden]
    whole = [score(mae, "all", "windows", passed), score(1.5 * mae, "all", "free run", passed)]
    return Verdict(
        submodel="spindle", machine=folders.name, origin=folders.origin,
        status="passed" if passed else "failed",
        reasons=() if passed else (ABOVE,), judged_role="golden",
        golden=GoldenUsed(sha256="cd" * 32, files=2, first=golden[0], last=golden[-1]),
        scores=(*days, *free, *whole),
        cases=tuple(JudgedCase(case=day, group=day, role="golden") for day in golden),
    )  # fmt: skip


def write_model(folders: MachineFolders, days: list[str], passed: bool) -> None:
    golden, training = days[-2:], days[:-2]
    files = tuple(log_of(day, len(training) + i) for i, day in enumerate(golden))
    week = FrozenSet(files=files, days=Days(first=golden[0], last=golden[-1]))
    folders.golden.parent.mkdir(parents=True, exist_ok=True)
    write_json(GoldenSets(machine=folders.name, golden=week), folders.golden)
    folder = folders.models / "spindle"
    write_json(spindle_model(folders, training), folder / "model.json")
    write_json(spindle_verdict(folders, golden, passed), folder / "verdict.json")
    frame = spindle_predictions(golden, 0.8 if passed else 2.7)
    write_predictions(frame, folder / "predictions.parquet")


def spindle_predictions(golden: list[str], mae: float) -> pd.DataFrame:
    parts = []
    rng = np.random.default_rng(5)
    for index, day in enumerate(golden):
        heat = spindle(index)[0][::10] / 12_000
        warm = 22 + 18 * np.convolve(heat, np.exp(-np.arange(900) / 180) / 180)[: len(heat)]
        error = np.convolve(rng.normal(size=len(heat)), np.ones(90) / 9, mode="same")
        measured = np.round(warm)
        measured[700:760] = np.nan
        for regime, wrong in (("windows", mae), ("free run", 1.5 * mae)):
            parts.append(pd.DataFrame({
                "case": day, "group": day, "role": "golden", "quantity": "spindle_temperature",
                "unit": "K", "regime": regime, "t": 6 * 3600.0 + 10 * np.arange(len(heat)),
                "measured": measured, "predicted": warm + wrong * error, "low": np.nan,
                "high": np.nan, "scored": True,
            }))  # fmt: skip
    return pd.concat(parts, ignore_index=True)
