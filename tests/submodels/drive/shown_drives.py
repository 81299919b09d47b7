"""A machine's feed drives as their page is given them: model, verdict, predictions, truth."""

from dataclasses import replace

import numpy as np
import pandas as pd

from pipeline.schema.drive import (
    MOTOR,
    CurvePoint,
    DirectionFriction,
    DriveAxis,
    DriveModel,
    DriveMotor,
    FeedDriveParameters,
    FitFacts,
    FrictionParameters,
    FrictionPoint,
    Method,
    RecursiveMass,
    TrainingRecording,
)
from pipeline.schema.model import Correlation, LeftOut, Parameter, SourceFile, Training
from pipeline.schema.verdict import Fact, JudgedCase, Score, Verdict
from pipeline.schema.verdict import Figures as Errors
from pipeline.submodels.contract import Shown

METHOD = "least squares of the inverse dynamics, filtered alike"
LIMITS = {"force": 10.0, "following error": 15.0}


def parameter(value: float | None, unit: str, spread: float = 0.03, remedy: str = "") -> Parameter:
    known = value is not None
    ends = tuple(sorted((value * (1 - spread), value * (1 + spread)))) if known else None
    return Parameter(
        value=value, unit=unit, interval_95=ends, determined=known,
        method=METHOD if known else "the records do not hold it", remedy="" if known else remedy,
    )  # fmt: skip


def friction(v: np.ndarray) -> np.ndarray:
    """Force [N] at speed [mm/s], other towards the negative side."""
    dip = 130.0 * np.exp(-((np.abs(v) / 4.0) ** 2))
    return np.sign(v) * (np.where(v > 0, 310.0, 355.0) + dip + 0.9 * np.abs(v))


def friction_points(axis: str) -> tuple[FrictionPoint, ...]:
    rng = np.random.default_rng(ord(axis))
    speeds = np.array([0.2, 0.5, 1, 2, 4, 8, 16, 32, 64, 120, 250, 400])
    points = []
    for v in np.concatenate([speeds, -speeds]).tolist():
        half = 6 + 30 * rng.random() / (1 + abs(v) / 4)
        force = float(friction(np.array(v))) + rng.normal(0, half / 2.5)
        points.append(FrictionPoint(velocity_mm_s=v, force=force, half_width=half, seconds=0.4))
    return tuple(points)


def friction_curve() -> tuple[CurvePoint, ...]:
    speeds = np.geomspace(0.01, 450, 80)
    signed = np.concatenate([-speeds[::-1], speeds])
    return tuple(
        CurvePoint(velocity_mm_s=float(v), force=float(f))
        for v, f in zip(signed, friction(signed), strict=True)
    )


def recursive() -> RecursiveMass:
    t = np.linspace(0.1, 30, 180)
    mass = np.where(t > 15, 540.0, 420.0) + 90 * np.exp(-t) * np.sin(9 * t)
    mass[t > 15] -= 120 * np.exp(-(t[t > 15] - 15) / 1.5)
    half = 260 * np.exp(-t / 1.2) + 9 + 40 * np.exp(-np.abs(t - 15.5))
    return RecursiveMass(
        recording="servo/inertia-step-X", unit="kg", time_s=tuple(t.tolist()),
        value=tuple(mass.tolist()), half_width=tuple(half.tolist()),
    )  # fmt: skip


def method(task: str, name: str, error: float, evaluations: int, unit: str = "N") -> Method:
    return Method(task=task, method=name, chosen=name == "least_squares", error=error,
                  error_unit=unit, evaluations=evaluations)  # fmt: skip


METHODS = (
    method("friction", "least_squares", 11.92, 54), method("friction", "genetic", 12.31, 12_000),
    method("servo", "least_squares", 0.842, 88, "1"), method("servo", "genetic", 0.846, 4800, "1"),
)  # fmt: skip
FACTS = FitFacts(
    samples=23_410, relative_error_percent=2.61, bandwidth_Hz=40.0, delay_s=1e-3, condition=41.7,
    rank=9, correlation=Correlation(
        names=("mass", "coulomb_positive", "viscous_positive"),
        values=((1, 0.05, -0.02), (0.05, 1, -0.83), (-0.02, -0.83, 1))),
)  # fmt: skip
ALIKE = DirectionFriction(coulomb=310.0, static=440.0, stribeck_velocity=0.004, viscous=900.0)


def drive_axis(letter: str, **changes) -> DriveAxis:
    axis = DriveAxis(
        command_unit="A", force_unit="N", servo=None, constant_level=330.0,
        feed_drive=FeedDriveParameters(mass=420.0, force_constant=62.0,
                             friction=FrictionParameters(positive=ALIKE, negative=ALIKE)),
        friction_points=friction_points(letter), friction_curve=friction_curve(), methods=METHODS,
        fit=FACTS, recursive_mass=recursive() if letter == "X" else None,
    )  # fmt: skip
    return replace(axis, **changes)


def axis_parameters(letter: str, mass: float = 420.0) -> dict[str, Parameter]:
    remedy = "record reciprocation at speeds below 1 mm/s, 1 s each"
    low = letter != "Y"
    return {
        "mass": parameter(mass, "kg", 0.006),
        "coulomb_positive": parameter(310.2, "N"),
        "coulomb_negative": parameter(354.8, "N"),
        "static_positive": parameter(438.0 if low else None, "N", 0.05, remedy),
        "static_negative": parameter(485.0 if low else None, "N", 0.05, remedy),
        "stribeck_velocity_positive": parameter(0.0041 if low else None, "m/s", 0.2, remedy),
        "stribeck_velocity_negative": parameter(0.0039 if low else None, "m/s", 0.2, remedy),
        "viscous_positive": parameter(902.0, "N s/m"),
        "viscous_negative": parameter(894.0, "N s/m"),
        "offset": parameter(-980.0 if letter == "Z" else None, "N", 0.01,
                            "let the axis stand and record its command"),
        "position_scale": parameter(1.12, "1", 0.002),
        "velocity_scale": parameter(0.87, "1", 0.02),
        "integral_scale": parameter(0.94, "1", 0.07),
    }  # fmt: skip


def drive_model(letters: str = "XYZ", **changes) -> DriveModel:
    names = [f"servo/reciprocation-{letter}" for letter in letters]
    model = DriveModel(
        submodel="drive", machine="mill01", origin="simulated",
        parameters={
            **{one: axis_parameters(one, 420.0 + 90 * i) for i, one in enumerate(letters)},
            MOTOR: {
                "R": parameter(1.86, "ohm"), "L_d": parameter(0.0061, "H", 0.04),
                "L_q": parameter(0.0065, "H", 0.04), "flux": parameter(0.181, "V s", 0.01),
            },
        },
        trained_on=tuple(
            Training(case=name, group=name,
                     files=(SourceFile(file=f"{name}.csv", sha256=f"{i}6" * 32),))
            for i, name in enumerate(names)
        ),
        left_out=(LeftOut(case="servo/short", reason="has 3 rows"),),
        axes={letter: drive_axis(letter) for letter in letters},
        motor=DriveMotor(axis="X", windows=900, left_out=0, condition=12.0,
                         correlation=Correlation()),
        recordings=tuple(TrainingRecording(recording=name, seconds=55.9) for name in names),
    )  # fmt: skip
    return replace(model, **changes)


def scores(
    letter: str, recording: str, force: float | None, following: float | None,
    role: str = "held_out", unit: str = "N",
) -> list[Score]:  # fmt: skip
    """One axis in one recording, wrong by ``force`` and ``following`` percent."""

    def score(kind, unit, error, rmse, most, most_percent, baseline):
        limit = LIMITS[kind]
        status = "not judged" if role == "training" else "failed" if error > limit else "passed"
        return Score(
            quantity=f"{kind} {letter}", unit=unit, group=recording, regime="", role=role, n=24_600,
            relative_percent=error, rmse=rmse, max=most, max_percent=most_percent,
            baselines=baseline, limits={"relative_percent": limit}, status=status,
            reasons=(f"{recording}: {kind} {letter}, relative error {error:g} % is above "
                     f"{limit:g} %",) if status == "failed" else (),
        )  # fmt: skip

    found = []
    if force is not None:
        guess = {"constant_level": Errors(relative_percent=38.4)}
        found.append(score("force", unit, force, 3.1 * force, 99.0, 9.0, guess))
    if following is not None:
        most = 1.3 * following
        guess = {"speed_over_loop_gain": Errors(rmse=71.0)}
        found.append(score("following error", "um", following, 4.12 * following, 16.04 * most,
                           most, guess))  # fmt: skip
    return found


RUNS = {
    ("X", "servo/reciprocation-X"): (2.6, 2.1, "training"),
    ("X", "servo/circle-20mm"): (4.4, 5.9), ("X", "servo/program-plate"): (6.2, 7.3),
    ("Y", "servo/reciprocation-Y"): (2.4, 1.9, "training"),
    ("Y", "servo/circle-20mm"): (4.9, 6.6), ("Y", "servo/program-plate"): (5.8, 8.1),
    ("Z", "servo/reciprocation-Z"): (1.2, 2.4, "training"),
    ("Z", "servo/program-plate"): (2.2, 9.4),
}  # fmt: skip


def verdict_on(runs=None, *, notes=None, facts=None, seconds=None, **changes) -> Verdict:
    """The verdict on runs: (axis, recording) -> errors of force and following error, role."""
    runs = RUNS if runs is None else runs
    found = [one for (axis, name), run in runs.items() for one in scores(axis, name, *run)]
    roles = {(name, run[2] if len(run) > 2 else "held_out"): [] for (_, name), run in runs.items()}
    for (axis, name), run in runs.items():
        roles[name, run[2] if len(run) > 2 else "held_out"].append(axis)
    cases = tuple(
        JudgedCase(
            case=name, group=name, role=role, note=(notes or {}).get(name, ""),
            conditions={f"highest speed {a}": Fact(value=250.0, unit="mm/s") for a in axes},
            facts={"length": Fact(value=(seconds or {}).get(name, 24.6), unit="s"),
                   **(facts or {})},
        )
        for (name, role), axes in roles.items()
    )  # fmt: skip
    statuses = {one.status for one in found} - {"not judged"}
    status = "failed" if "failed" in statuses else "passed" if statuses else "not judged"
    verdict = Verdict(
        submodel="drive", machine="mill01", origin="simulated", status=status,
        reasons=() if statuses else ("every recording of X was learnt from",),
        judged_role="held_out" if statuses else None, golden=None, scores=tuple(found), cases=cases,
    )  # fmt: skip
    return replace(verdict, **changes)


def trace(recording: str, axis: str, seconds: float = 24.6, rows: int = 4000) -> pd.DataFrame:
    """Reciprocation: following error, command and speed, the model a little wrong."""
    rng = np.random.default_rng(len(recording) + ord(axis))
    t = np.linspace(0, seconds, rows)
    phase = (t / 4.1) % 1.0
    speed = 260 * np.clip(6 * np.minimum.reduce([phase, np.abs(0.5 - phase), 1 - phase]), 0, 1)
    speed = speed * np.where(phase < 0.5, 1, -1)
    acceleration = np.gradient(speed, t)
    slow = np.where(np.abs(speed) < 1e-9, 0.0, friction(speed + 1e-12))
    force = slow + 0.42 * acceleration
    following = 1e3 * speed / 170 + 0.02 * force + rng.normal(0, 1.0, rows)
    columns = {
        ("following error", "um"): (following, 1e3 * speed / 172 + 0.019 * force),
        ("command", "A"): (force / 62 + rng.normal(0, 0.15, rows),
                           (0.97 * slow + 0.42 * acceleration) / 62),
        ("speed", "mm/s"): (speed, np.full(rows, np.nan)),
    }  # fmt: skip
    return pd.concat([
        pd.DataFrame({"case": recording, "group": recording, "quantity": f"{name} {axis}",
                      "unit": unit, "regime": "", "t": t, "measured": measured,
                      "predicted": predicted})
        for (name, unit), (measured, predicted) in columns.items()
    ], ignore_index=True)  # fmt: skip


def predictions() -> pd.DataFrame:
    """Traces of four axes in recordings."""
    return pd.concat(
        [
            trace("servo/reciprocation-X", "X"),
            *(trace("servo/program-plate", axis) for axis in "XYZ"),
        ],
        ignore_index=True,
    )


TRUTH = {"drives": {
    "axes": {"X": {"mass": 421.0, "coulomb_positive": 309.0, "stribeck_velocity_positive": 0.0040,
                   "viscous_positive": 960.0, "position_scale": {"value": 1.1205}},
             "Y": {"mass": 511.0, "static_positive": 430.0}},
    "motor": {"R": 1.85, "L_d": 0.0060},
}}  # fmt: skip


def shown(**changes) -> Shown[DriveModel]:
    """Everything that the page is made of."""
    parts = {"model": drive_model(), "verdict": verdict_on(), "predictions": predictions(),
             "truth": TRUTH, **changes}  # fmt: skip
    return Shown(machine="mill01", origin="simulated", **parts)
