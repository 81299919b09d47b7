"""A machine's feed drives, judged recordings and traces, as the stages before leave them."""

import json
import re
from pathlib import Path

import numpy as np
from page_reader import words
from report_folders import FLEET, write_table

from pipeline.report.folders import MachineFolders
from pipeline.report.pages import write_report

WAY = "least squares of the inverse dynamics, filtered alike"
LIMITS = {"force_percent": 10.0, "following_percent": 15.0}


def drive_parameter(value: float | None, unit: str, spread: float = 0.03, remedy: str = "") -> dict:
    known = value is not None
    ends = sorted((value * (1 - spread), value * (1 + spread))) if known else (None, None)
    return {"value": value, "unit": unit, "low": ends[0], "high": ends[1], "determined": known,
            "how": WAY if known else "the records do not hold it",
            "remedy": None if known else remedy}  # fmt: skip


def friction(v: np.ndarray, level: float = 1.0) -> np.ndarray:
    """Force [N] at speed [mm/s], other towards the negative side."""
    coulomb = np.where(v > 0, 310.0, 355.0) * level
    dip = 130.0 * np.exp(-((np.abs(v) / 4.0) ** 2))
    return np.sign(v) * (coulomb + dip + 0.9 * np.abs(v))


def friction_points(axis: str) -> list[dict]:
    rng = np.random.default_rng(ord(axis))
    speeds = np.array([0.2, 0.5, 1, 2, 4, 8, 16, 32, 64, 120, 250, 400])
    points = []
    for v in np.concatenate([speeds, -speeds]):
        half = 6 + 30 * rng.random() / (1 + abs(v) / 4)
        force = float(friction(np.array(v))) + rng.normal(0, half / 2.5)
        points.append({"velocity_mm_s": v, "force": force, "half_width": half, "seconds": 0.4})
    return points


def friction_curve() -> list[dict]:
    speeds = np.geomspace(0.01, 450, 80)
    signed = np.concatenate([-speeds[::-1], speeds])
    return [{"velocity_mm_s": float(v), "force": float(f)}
            for v, f in zip(signed, friction(signed), strict=True)]  # fmt: skip


def recursive() -> dict:
    t = np.linspace(0.1, 30, 180)
    mass = np.where(t > 15, 540.0, 420.0) + 90 * np.exp(-t) * np.sin(9 * t)
    mass[t > 15] -= 120 * np.exp(-(t[t > 15] - 15) / 1.5)
    half = 260 * np.exp(-t / 1.2) + 9 + 40 * np.exp(-np.abs(t - 15.5))
    return {"recording": "servo/inertia-step-X", "quantity": "mass", "unit": "kg",
            "time_s": t.tolist(), "value": mass.tolist(), "half_width": half.tolist()}  # fmt: skip


def methods() -> list[dict]:
    rows = (("friction", "least_squares", True, 11.92, 54), ("friction", "genetic", False, 12.31,
            12_000), ("servo", "least_squares", True, 0.842, 88), ("servo", "genetic", False, 0.846,
            4800))  # fmt: skip
    return [{"task": task, "method": method, "chosen": chosen, "error": error,
             "error_unit": "N" if task == "friction" else "1", "evaluations": evaluations}
            for task, method, chosen, error, evaluations in rows]  # fmt: skip


def axis_document(axis: str, mass: float = 420.0, **other) -> dict:
    remedy = "record reciprocation at speeds below 1 mm/s, 1 s each"
    low = axis != "Y"
    return {
        "command_unit": "A", "force_unit": "N",
        "parameters": {
            "mass": drive_parameter(mass, "kg", 0.006),
            "coulomb_positive": drive_parameter(310.2, "N"),
            "coulomb_negative": drive_parameter(354.8, "N"),
            "static_positive": drive_parameter(438.0 if low else None, "N", 0.05, remedy),
            "static_negative": drive_parameter(485.0 if low else None, "N", 0.05, remedy),
            "stribeck_velocity_positive": drive_parameter(0.0041 if low else None, "m/s", 0.2,
                                                          remedy),
            "stribeck_velocity_negative": drive_parameter(0.0039 if low else None, "m/s", 0.2,
                                                          remedy),
            "viscous_positive": drive_parameter(902.0, "N s/m"),
            "viscous_negative": drive_parameter(894.0, "N s/m"),
            "offset": drive_parameter(-980.0 if axis == "Z" else None, "N", 0.01,
                                      "let the axis stand and record its command"),
            "position_scale": drive_parameter(1.12, "1", 0.002),
            "velocity_scale": drive_parameter(0.87, "1", 0.02),
            "integral_scale": drive_parameter(0.94, "1", 0.07),
        },
        "drive": {"servo": {}, "feed_drive": {}},
        "friction_points": friction_points(axis), "friction_curve": friction_curve(),
        "methods": methods(),
        "fit": {"samples": 23_410, "relative_error_percent": 2.61, "condition": 41.7, "rank": 9,
                "correlation": {"names": ["mass", "coulomb_positive", "viscous_positive"],
                                "values": [[1, 0.05, -0.02], [0.05, 1, -0.83], [-0.02, -0.83, 1]]}},
        "recursive": recursive() if axis == "X" else None, **other,
    }  # fmt: skip


def write_drive(folders: MachineFolders, letters: str = "XYZ", **other) -> None:
    folders.models.mkdir(parents=True, exist_ok=True)
    (folders.models / "drive.json").write_text(json.dumps({
        "model": "drive", "machine": folders.name, "origin": folders.origin,
        "axes": {axis: axis_document(axis, 420.0 + 90 * i) for i, axis in enumerate(letters)},
        "motor": {"axis": "X", "parameters": {
            "R": drive_parameter(1.86, "ohm"), "L_d": drive_parameter(0.0061, "H", 0.04),
            "L_q": drive_parameter(0.0065, "H", 0.04), "flux": drive_parameter(0.181, "V s", 0.01),
        }, "fit": {"samples": 80_000, "relative_error_percent": 1.2, "condition": 12.0}},
        "recordings": {"training": [f"servo/reciprocation-{axis}" for axis in letters],
                       "left_out": [{"recording": "servo/short", "reason": "has 3 rows"}]},
        "found_from": {f"servo/reciprocation-{axis}.csv": "56" * 32 for axis in letters}, **other,
    }))  # fmt: skip


def drive_run(
    recording: str, force: float | None, following: float | None, role: str = "judged", **other
) -> dict:
    """One axis in one recording, wrong by ``force`` and ``following`` percent."""
    beyond = (force or 0) > LIMITS["force_percent"] or (following or 0) > LIMITS[
        "following_percent"]  # fmt: skip
    status = "not judged" if role == "training" else "failed" if beyond else "passed"
    return {
        "recording": recording, "role": role, "seconds": 24.6, "samples": 24_600,
        "force": None if force is None else {
            "unit": "N", "relative_error_percent": force, "rmse": 3.1 * force,
            "baseline_relative_error_percent": 38.4},
        "following": None if following is None else {
            "rms_um": 412.0, "max_um": 1604.0, "error_rms_um": 4.12 * following,
            "error_max_um": 30.0, "error_rms_percent": following,
            "error_max_percent": 1.3 * following, "baseline_error_rms_um": 71.0},
        "status": status, "reason": None, **other,
    }  # fmt: skip


RUNS = {
    "X": [drive_run("servo/reciprocation-X", 2.6, 2.1, "training"),
          drive_run("servo/circle-20mm", 4.4, 5.9), drive_run("servo/program-plate", 6.2, 7.3)],
    "Y": [drive_run("servo/reciprocation-Y", 2.4, 1.9, "training"),
          drive_run("servo/circle-20mm", 4.9, 6.6), drive_run("servo/program-plate", 5.8, 8.1)],
    "Z": [drive_run("servo/reciprocation-Z", 1.2, 2.4, "training"),
          drive_run("servo/program-plate", 2.2, 9.4)],
}  # fmt: skip


def write_drive_validation(folders: MachineFolders, runs: dict[str, list] | None = None, **other):
    runs = RUNS if runs is None else runs
    folders.models.mkdir(parents=True, exist_ok=True)
    judged = [r["status"] for rows in runs.values() for r in rows if r["role"] == "judged"]
    (folders.models / "drive_validation.json").write_text(json.dumps({
        "model": "drive", "machine": folders.name, "origin": folders.origin, "limits": LIMITS,
        "passed": all(s == "passed" for s in judged) if judged else None,
        "reason": None if judged else "every recording of X was learnt from",
        "axes": runs, **other,
    }))  # fmt: skip


def trace(recording: str, axis: str, seconds: float = 24.6, rows: int = 4000) -> dict:
    """Reciprocation: following error and command, measured and modelled a little wrong."""
    rng = np.random.default_rng(len(recording) + ord(axis))
    t = np.linspace(0, seconds, rows)
    phase = (t / 4.1) % 1.0
    speed = 260 * np.clip(6 * np.minimum.reduce([phase, np.abs(0.5 - phase), 1 - phase]), 0, 1)
    speed = speed * np.where(phase < 0.5, 1, -1)
    acceleration = np.gradient(speed, t)
    slow = np.where(np.abs(speed) < 1e-9, 0.0, friction(speed + 1e-12))
    force = slow + 0.42 * acceleration
    following = 1e3 * speed / 170 + 0.02 * force + rng.normal(0, 1.0, rows)
    return {
        "axis": [axis] * rows, "recording": [recording] * rows, "role": ["judged"] * rows,
        "time_s": t, "reference_mm": np.cumsum(speed) * (t[1] - t[0]), "velocity_mm_s": speed,
        "following_measured_um": following,
        "following_modelled_um": 1e3 * speed / 172 + 0.019 * force,
        "command_measured": force / 62 + rng.normal(0, 0.15, rows),
        "command_modelled": (0.97 * slow + 0.42 * acceleration) / 62,
    }  # fmt: skip


def write_traces(folders: MachineFolders, traces: list[dict]) -> None:
    columns = {k: [v for one in traces for v in one[k]] for k in traces[0]}
    write_table(folders.models / "drive_traces.parquet", columns)


TRUTH = {
    "axes": {"X": {"mass": 421.0, "coulomb_positive": 309.0, "stribeck_velocity_positive": 0.0040,
                   "viscous_positive": 960.0, "position_scale": {"value": 1.1205}},
             "Y": {"mass": 511.0, "static_positive": 430.0}},
    "motor": {"R": 1.85, "L_d": 0.0060},
}  # fmt: skip


def with_drives(folders: MachineFolders, runs: dict[str, list] | None = None) -> MachineFolders:
    """The same machine with three drives, judged recordings, traces and, if simulated, truth."""
    write_drive(folders)
    write_drive_validation(folders, runs)
    write_traces(folders, [trace(name, axis) for axis, name in (
        ("X", "servo/reciprocation-X"), ("X", "servo/program-plate"), ("Y", "servo/program-plate"),
        ("Z", "servo/program-plate"))])  # fmt: skip
    if folders.truth is not None:
        folders.truth.parent.mkdir(parents=True, exist_ok=True)
        known = json.loads(folders.truth.read_text()) if folders.truth.is_file() else {}
        folders.truth.write_text(json.dumps({**known, "drives": TRUTH}))
    return folders


def report(folders: MachineFolders, tmp_path: Path) -> str:
    """What the machine's page says, written below ``tmp_path``."""
    write_report([folders], FLEET, None, tmp_path / "out")
    return words(tmp_path / "out" / f"{folders.name}.html")


def section(page: Path, key: str) -> str:
    """One section of a page, as HTML; empty when it is not there."""
    found = re.search(rf'<section id="{key}".*?</section>', page.read_text(), flags=re.S)
    return found.group() if found else ""
