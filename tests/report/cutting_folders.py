"""A machine's cut as the stages before leave it: coefficients, judged recordings, revolutions."""

import json

import numpy as np
from report_folders import write_table

from pipeline.report.folders import MachineFolders

WAY = "least squares of every sample of the waveform, residuals clustered by revolution"
LIMITS = {"peak_percent": 25.0, "mean_percent": 20.0, "rms_percent": 20.0}
TOOTH = {"K_tc": 1820.0, "K_rc": 690.0, "K_ac": 310.0, "K_te": 21.0, "K_re": 27.5, "K_ae": 4.1}
DEPTH, DIAMETER, FLUTES = 3.0, 25.0, 2
TURN = np.arange(0.0, 360.0, 1.5)


def cut_parameter(
    value: float | None, unit: str, spread: float = 0.04, reason: str = "", how: str = WAY
) -> dict:
    known = value is not None
    ends = sorted((value * (1 - spread), value * (1 + spread))) if known else None
    return {"value": value, "unit": unit, "interval_95": ends, "determined": known,
            "reason": reason, "how": how if known else ""}  # fmt: skip


def coefficients(spread: float = 0.04, factor: float = 1.0) -> dict:
    return {
        name: cut_parameter(factor * value, "N/mm" if name.endswith("e") else "N/mm2",
                            3 * spread if name.endswith("e") else spread)
        for name, value in TOOTH.items()
    }  # fmt: skip


def parameters() -> dict:
    lost = "the tool is too short in the material; record a slot of 10 mm depth"
    return {
        **coefficients(),
        "runout": cut_parameter(11.4, "um", 0.08),
        "runout_angle": cut_parameter(37.0, "deg", 0.2),
        "helix": cut_parameter(None, "deg", reason=lost),
        "kienzle.k_c11": cut_parameter(1480.0, "N/mm2", 0.06, how="a power law over the same"),
        "kienzle.m_c": cut_parameter(0.21, "1", 0.15, how="a power law over the same"),
    }


def conditions(feed: float, depth: float = DEPTH) -> dict:
    return {"speed_rpm": 6000, "feed_mm_min": feed, "feed_per_tooth_mm": feed / 6000 / FLUTES,
            "axial_depth_mm": depth, "entry_deg": 0.0, "exit_deg": 180.0}  # fmt: skip


def name_of(feed: float) -> str:
    return f"6-n6000f{feed:.0f}ap3ae25"


def recording(feed: float, role: str, reason: str = "", **other) -> dict:
    return {"recording": name_of(feed), "sha256": f"{int(feed):064x}", "role": role,
            "reason": reason, **conditions(feed), "revolutions": 99, **other}  # fmt: skip


SPINDLE = {
    "no_load": {
        "coefficients": {"p0": cut_parameter(84.0, "WATT", 0.1), "p1": cut_parameter(3.2, "W s"),
                         "p2": cut_parameter(0.021, "W s^2", 0.2)},
        "range_rpm": [600, 12000],
        "curve": [
            {"speed_rpm": n, "power_W": 84 + 3.2 * n / 60 + 0.021 * (n / 60) ** 2,
             "half_width_95_W": 12 + n / 400, "measured_W": 90 + 3.2 * n / 60 + 5.6e-6 * n**2}
            for n in range(12_000, 0, -600)
        ],
    },
    "specific_force": cut_parameter(2010.0, "N/mm^2", 0.07),
    "K_tc": cut_parameter(1890.0, "N/mm^2", 0.07), "K_te": cut_parameter(21.0, "N/mm", 0.3),
    "recordings": ["cutting/slots-run1.txt", "cutting/no-load-run1.txt"],
    "reason": "", "assumed": "the load is a share of 15 kW",
}  # fmt: skip


def write_cutting(folders: MachineFolders, **other) -> None:
    folders.models.mkdir(parents=True, exist_ok=True)
    names = [*TOOTH, "log_damping0"]
    matrix = np.eye(7)
    matrix[5, 6] = matrix[6, 5] = 0.93  # of an unknown that the table does not show
    matrix[0, 3] = matrix[3, 0] = -0.87
    matrix[1, 4] = matrix[4, 1] = -0.81
    chain = {
        axis: {"natural_frequency_Hz": cut_parameter(f, "Hz", 0.02),
               "damping": cut_parameter(d, "1", 0.2)}
        for axis, f, d in (("x", 1130.0, 0.041), ("y", 1250.0, 0.036))
    }  # fmt: skip
    (folders.models / "cutting.json").write_text(json.dumps({
        "model": "cutting", "machine": folders.name, "origin": folders.origin,
        "method": "least_squares", "material": "aluminium 6061",
        "tool": {"kind": "flat", "diameter_mm": DIAMETER, "flutes": FLUTES},
        "parameters": parameters(), "mean_force": coefficients(0.12, 1.05),
        "correlation": {"names": names, "matrix": matrix.tolist()},
        "fit": {"rms_error_percent": 8.31, "samples": 19_800, "revolutions": 198,
                "condition": 212.0},
        "measuring_chain": chain,
        "methods": [{"method": "least_squares", "rms_error_percent": 8.31, "evaluations": 41},
                    {"method": "genetic", "rms_error_percent": 8.35, "evaluations": 8200}],
        "recordings": [recording(600, "training"), recording(900, "training"),
                       recording(1200, "judged"), recording(1500, "judged"),
                       recording(300, "left out", "the tool was not in the material")],
        "terms": [{"terms": ["runout"], "value": 0.1141, "kept": False},
                  {"terms": ["runout", "modes"], "value": 0.0853, "kept": True},
                  {"terms": ["runout", "modes", "teeth"], "value": 0.0849, "kept": False}],
        "remainder": {"what": "what mechanics leave over, by the angle of the spindle",
                      "conditions": [{"speed_rpm": 6000, "axial_depth_mm": DEPTH,
                                      "feeds_per_tooth_mm": [0.05, 0.075],
                                      "holds_for_mm": [0.025, 0.15]}]},
        "spindle": SPINDLE, **other,
    }))  # fmt: skip


def forces(feed: float, factor: float = 1.0, runout: float = 0.011) -> np.ndarray:
    """Force of two teeth in a slot on the dynamometer [N] over :data:`TURN`; shape (3, T)."""
    total = np.zeros((3, len(TURN)))
    for tooth in range(FLUTES):
        phi = np.radians(TURN - 180.0 * tooth) % (2 * np.pi)
        h = feed / 6000 / FLUTES * np.sin(phi) + runout * (-1) ** tooth * np.cos(0.6)
        there = (phi < np.pi) & (h > 0)
        t, r, a = (
            DEPTH * factor * np.where(there, TOOTH[f"K_{d}c"] * h + TOOTH[f"K_{d}e"], 0.0)
            for d in "tra"
        )
        total += [t * np.cos(phi) + r * np.sin(phi), -t * np.sin(phi) + r * np.cos(phi), a]
    return total


def trace(feed: float, factor: float = 1.0) -> dict:
    """One mean revolution, rung through by the dynamometer, and what the model says of it."""
    rng = np.random.default_rng(int(feed))
    ring = np.exp(-np.arange(40) / 9.0) * np.cos(np.arange(40) / 2.5)
    measured = np.array([
        np.real(np.fft.ifft(np.fft.fft(f) * np.fft.fft(ring / ring.sum(), len(TURN))))
        for f in forces(feed)
    ])  # fmt: skip
    half = 9 + 0.06 * np.abs(measured) + rng.normal(0, 1, measured.shape)
    modelled, plain = forces(feed, factor), forces(feed, 1.12 * factor, 0.0)
    rows = {"recording": [name_of(feed)] * len(TURN), "angle_deg": TURN}
    for i, axis in enumerate("xyz"):
        rows |= {f"measured_{axis}": measured[i], f"low_{axis}": measured[i] - half[i],
                 f"high_{axis}": measured[i] + half[i], f"modelled_{axis}": modelled[i],
                 f"plain_{axis}": plain[i]}  # fmt: skip
    return rows


def component(peak: float, error: float) -> dict:
    """One component whose RMS is wrong by ``error`` percent."""
    measured = {"peak": peak, "mean": 0.43 * peak, "rms": 0.55 * peak}
    return {"measured": measured, "modelled": {k: v * (1 - error / 150) for k, v in
                                               measured.items()},
            "rms_error_percent": error, "peak_error_percent": -error / 1.5,
            "mean_error_percent": error / 2}  # fmt: skip


def cut_run(
    feed: float, error: float | None = 8.0, role: str = "judged", plain: float | None = None,
    **other,
) -> dict:  # fmt: skip
    """One recording whose RMS force is wrong by ``error`` percent, the plain guess by twice it."""
    guess = 2 * (error or 0.0) if plain is None else plain
    status = "not judged" if role == "training" else "failed" if (
        error or 0) > LIMITS["rms_percent"] else "passed"  # fmt: skip
    scales = {"x": 0.9, "y": 1.0, "z": 1.2, "resultant": 1.0}
    peaks = {"x": 0.42 * feed, "y": 0.36 * feed, "z": 0.11 * feed, "resultant": 0.55 * feed}
    every = None if error is None else {
        c: component(peaks[c], scales[c] * error) for c in scales}  # fmt: skip
    return {
        "recording": name_of(feed), "role": role, "conditions": conditions(feed),
        "components": every,
        "plain": {"what": "mean-force coefficients, no runout, no measuring chain",
                  "components": {c: component(peaks[c], scales[c] * guess) for c in scales}},
        "status": status, "reason": "the coefficients were found from it"
        if role == "training" else "", **other,
    }  # fmt: skip


RUNS = [cut_run(600, 7.2, "training"), cut_run(900, 7.9, "training"),
        cut_run(1200, 9.4), cut_run(1500, 14.2)]  # fmt: skip


def write_cutting_validation(
    folders: MachineFolders, runs: list | None = None, cross: list | None = None, **other
) -> None:
    runs = RUNS if runs is None else runs
    folders.models.mkdir(parents=True, exist_ok=True)
    counted = [r["status"] for r in [*runs, *(cross or [])] if r["status"] != "not judged"]
    (folders.models / "cutting_validation.json").write_text(json.dumps({
        "model": "cutting", "machine": folders.name, "origin": folders.origin, "limits": LIMITS,
        "passed": all(s == "passed" for s in counted) if counted else None,
        "reason": "" if counted else "every recording was learnt from",
        "recordings": runs, "cross": cross or [], **other,
    }))  # fmt: skip


def write_cutting_traces(folders: MachineFolders, traces: list[dict]) -> None:
    columns = {k: [v for one in traces for v in one[k]] for k in traces[0]}
    write_table(folders.models / "cutting_traces.parquet", columns)


TRUTH = {
    "parameters": {"K_tc": 1800.0, "K_rc": 700.0, "K_te": 25.0, "K_ae": 4.1, "runout": 11.0,
                   "runout_angle": 37.0 + 3 * 360.0 / FLUTES, "helix": 30.0},
    "spindle": {"no_load_W": [[6000, 670.0], [12_000, 1900.0], [500, 90.0]], "efficiency": 0.9,
                "specific_force": 1950.0},
}  # fmt: skip


def with_cutting(
    folders: MachineFolders, runs: list | None = None, cross: list | None = None
) -> MachineFolders:
    """The same machine with coefficients, judged recordings, revolutions and, maybe, truth."""
    write_cutting(folders)
    write_cutting_validation(folders, runs, cross)
    write_cutting_traces(folders, [trace(feed, f) for feed, f in (
        (600, 1.0), (1200, 0.97), (1500, 0.93))])  # fmt: skip
    if folders.truth is not None:
        folders.truth.parent.mkdir(parents=True, exist_ok=True)
        known = json.loads(folders.truth.read_text()) if folders.truth.is_file() else {}
        folders.truth.write_text(json.dumps({**known, "cutting": TRUTH}))
    return folders
