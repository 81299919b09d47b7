"""A machine's cut as its sub-model stores it: coefficients, judged recordings, revolutions."""

from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from pipeline.charts.sections import SubModelPage
from pipeline.schema.cutting import (
    CHANNEL_FORCE,
    MAGNITUDE,
    OTHERS,
    PLANE,
    CutRecording,
    CuttingFitFacts,
    CuttingModel,
    FoldModel,
    MethodTried,
    NoLoadPoint,
    ResidualConditions,
    SpindleLoad,
    StoredCutModel,
    TermsTried,
    ToolGeometry,
)
from pipeline.schema.model import Correlation, Parameter, SourceFile, Training
from pipeline.schema.verdict import Figures as Errors
from pipeline.schema.verdict import Score, Verdict
from pipeline.submodels.contract import Shown
from pipeline.submodels.cutting.submodel import SUBMODEL
from tests.submodels.made_pages import made

METHOD = "least squares of every sample of the waveform, residuals clustered by revolution"
TOOTH = {"K_tc": 1820.0, "K_rc": 690.0, "K_ac": 310.0, "K_te": 21.0, "K_re": 27.5, "K_ae": 4.1}
DEPTH, DIAMETER, FLUTES = 3.0, 25.0, 2
TURN = np.arange(0.0, 360.0, 1.5)


def parameter(
    value: float | None, unit: str, spread: float = 0.04, method: str = METHOD, remedy: str = ""
) -> Parameter:
    if value is None:
        return Parameter(
            value=None, unit=unit, interval_95=None, determined=False, method=method, remedy=remedy
        )
    low, high = sorted((value * (1 - spread), value * (1 + spread)))
    return Parameter(
        value=value, unit=unit, interval_95=(low, high), determined=True, method=method
    )


def coefficients(spread: float = 0.04, factor: float = 1.0) -> dict[str, Parameter]:
    return {
        name: parameter(factor * value, "N/mm" if name.endswith("e") else "N/mm^2",
                        3 * spread if name.endswith("e") else spread)
        for name, value in TOOTH.items()
    }  # fmt: skip


def parameters() -> dict[str, Parameter]:
    return {
        **coefficients(),
        "runout": parameter(11.4, "um", 0.08),
        "runout_angle": parameter(37.0, "deg", 0.2),
        "helix": parameter(
            None, "deg", method="the tool is too short in the material",
            remedy="record a slot of 10 mm depth",
        ),
        "kienzle.k_c11": parameter(1480.0, "N/mm^2", 0.06, "a power law over the same"),
        "kienzle.m_c": parameter(0.21, "1", 0.15, "a power law over the same"),
    }  # fmt: skip


def name_of(feed: float) -> str:
    return f"6-n6000f{feed:.0f}ap3ae25"


def recording(feed: float, role: str, reason: str = "") -> CutRecording:
    return CutRecording(
        recording=name_of(feed), role=role, reason=reason, speed_rpm=6000.0, feed_mm_min=feed,
        feed_per_tooth_mm=feed / 6000 / FLUTES, axial_depth_mm=DEPTH, entry_deg=0.0,
        exit_deg=180.0, revolutions=99,
    )  # fmt: skip


POWERS = {
    "p0": parameter(84.0, "WATT", 0.1),
    "p1": parameter(3.2, "W s"),
    "p2": parameter(0.021, "W s^2", 0.2),
    "specific_force": parameter(2010.0, "N/mm^2", 0.07),
    "K_tc": parameter(1890.0, "N/mm^2", 0.07),
    "K_te": parameter(21.0, "N/mm", 0.3),
}
SPINDLE = SpindleLoad(
    recordings=("cutting/slots-run1.txt", "cutting/no-load-run1.txt"),
    reason="",
    assumed="the load is a share of 15 kW",
    range_rpm=(600.0, 12000.0),
    curve=tuple(
        NoLoadPoint(
            speed_rpm=n, power_W=84 + 3.2 * n / 60 + 0.021 * (n / 60) ** 2,
            half_width_95_W=12 + n / 400, measured_W=90 + 3.2 * n / 60 + 5.6e-6 * n**2,
        )
        for n in range(12_000, 0, -600)
    ),
)  # fmt: skip
PLAIN_MODEL = StoredCutModel(
    tool={}, geometry=ToolGeometry(), values=(), natural_Hz=None, damping=None, left_out_N2=()
)


def correlation() -> Correlation:
    matrix = np.eye(7)
    matrix[5, 6] = matrix[6, 5] = 0.93  # of an unknown that the table does not show
    matrix[0, 3] = matrix[3, 0] = -0.87
    matrix[1, 4] = matrix[4, 1] = -0.81
    return Correlation(
        names=(*TOOTH, "log_damping0"), values=tuple(tuple(row) for row in matrix.tolist())
    )


def model(groups: dict[str, Any] | None = None, **changes: Any) -> CuttingModel:
    """A model; ``groups`` replaces some groups of its parameters, None takes one away."""
    every: dict[str, Any] = {
        "": parameters(), "mean force": coefficients(0.12, 1.05), "spindle": POWERS,
        "channel x": {"natural_frequency_Hz": parameter(1130.0, "Hz", 0.02),
                      "damping": parameter(0.041, "1", 0.2)},
        **(groups or {}),
    }  # fmt: skip
    rows = (recording(600, "training"), recording(900, "training"), recording(1200, "judged"),
            recording(1500, "judged"),
            recording(300, "left out", "the tool was not in the material"))  # fmt: skip
    found = CuttingModel(
        submodel="cutting", machine="m", origin="simulated",
        parameters={name: rows_ for name, rows_ in every.items() if rows_ is not None},
        trained_on=tuple(
            Training(case=name_of(f), group=name_of(f),
                     files=(SourceFile(file=name_of(f), sha256=f"{int(f):064x}"),))
            for f in (600, 900)
        ),
        method="least_squares", reason="", material="aluminium 6061",
        tool={"kind": "flat", "diameter_mm": DIAMETER, "flutes": FLUTES},
        remarks={"runout_angle": "from the tooth that stands out most, within half a pitch"},
        correlation=correlation(),
        fit=CuttingFitFacts(rms_error_percent=8.31, samples=19_800, revolutions=198,
                            condition=212.0, left_out_N=(1.0, 1.0, 1.0), zero_N=0.0),
        terms=(TermsTried(terms=("runout",), value=0.1141, kept=False),
               TermsTried(terms=("runout", "modes"), value=0.0853, kept=True),
               TermsTried(terms=("runout", "modes", "teeth"), value=0.0849, kept=False)),
        methods=(MethodTried(method="least_squares", rms_error_percent=8.31, evaluations=41),
                 MethodTried(method="genetic", rms_error_percent=8.35, evaluations=8200)),
        residual_conditions=(
            ResidualConditions(speed_rpm=6000.0, axial_depth_mm=DEPTH, entry_deg=0.0,
                               exit_deg=180.0, feeds_per_tooth_mm=(0.05, 0.075),
                               holds_for_mm=(0.025, 0.15)),
        ),
        recordings=rows, prediction=PLAIN_MODEL, plain=PLAIN_MODEL, folds=(), spindle=SPINDLE,
    )  # fmt: skip
    return replace(found, **changes)


def without_forces(**changes: Any) -> CuttingModel:
    """A model of a machine without a dynamometer."""
    groups = {"": None, "mean force": None, "channel x": None}
    nothing: dict[str, Any] = {
        "recordings": (), "fit": None, "methods": (), "terms": (), "residual_conditions": (),
        "prediction": None, "plain": None, "trained_on": (), "correlation": Correlation(),
    }  # fmt: skip
    return model(groups, **{**nothing, **changes})


def run(
    feed: float, error: float = 8.0, role: str = "held_out", regime: str = ""
) -> tuple[Score, Score]:
    """Scores of a recording whose RMS force is wrong by ``error`` percent, the guess by twice it.

    Peaks are too small by 1/1.5, means too large by 1/2 of that.
    """

    def figures(size: float) -> tuple[dict[str, Any], dict[str, Any]]:
        return {"relative_percent": size}, {"peak_percent": -size / 1.5, "mean_percent": size / 2}

    own, guess = figures(error), figures(2 * error)
    said = "not judged" if role == "training" else "failed" if error > 20.0 else "passed"
    waveform, level = (
        Score(
            quantity=quantity, unit="N", group=name_of(feed), regime=regime, role=role, n=720,
            baselines={"plain": Errors(**guess[k]), "mechanics": Errors(**own[k])},
            limits=limits, status="passed" if k and said == "failed" else said, **own[k],
        )
        for k, (quantity, limits) in enumerate((
            (PLANE, {"relative_percent": 20.0}),
            (MAGNITUDE, {"peak_percent": 25.0, "mean_percent": 20.0}),
        ))
    )  # fmt: skip
    return waveform, level


def cross(feed: float, error: float) -> tuple[Score, Score]:
    """Scores of a training recording as a fit on others predicts it."""
    return run(feed, error, "training", OTHERS)


def folds(*pairs: tuple[float, float]) -> tuple[FoldModel, ...]:
    """Fits on the second recording of each pair, without the first."""
    return tuple(
        FoldModel(left_out=(name_of(a),), fitted_on=(name_of(b),), prediction=PLAIN_MODEL)
        for a, b in pairs
    )


RUNS = (run(600, 7.2, "training"), run(900, 7.9, "training"), run(1200, 9.4), run(1500, 14.2))


def verdict(*runs: tuple[Score, Score], **changes: Any) -> Verdict:
    scores = [score for pair in runs or RUNS for score in pair]
    words = {score.status for score in scores} - {"not judged"}
    status: Any = "failed" if "failed" in words else "passed" if words else "not judged"
    found = Verdict(
        submodel="cutting", machine="m", origin="simulated", status=status,
        reasons=() if words else ("every recording was learnt from",), judged_role="held_out",
        golden=None, scores=tuple(scores),
    )  # fmt: skip
    return replace(found, **changes)


def predictions() -> pd.DataFrame:
    """Mean revolutions of recordings, and what predicts them."""
    frames = [_revolution(*one) for one in ((600, 1.0), (1200, 0.97), (1500, 0.93))]
    return pd.concat(frames, ignore_index=True)


def _revolution(feed: float, factor: float) -> pd.DataFrame:
    """Force of two teeth in a slot over :data:`TURN`, twice a revolution."""
    phi = np.radians(2 * TURN)
    size = DEPTH * (TOOTH["K_tc"] * feed / 6000 / FLUTES + TOOTH["K_te"])
    measured = size * np.array([np.sin(phi), 0.4 * (1 - np.cos(phi)), 0.1 + 0 * phi])
    of = {"measured": measured, "predicted": factor * measured, "baseline_plain": 1.1 * measured}
    parts = [
        pd.DataFrame({name: force[k] for name, force in of.items()}).assign(
            quantity=CHANNEL_FORCE + axis, t=TURN)
        for k, axis in enumerate("xyz")
    ]  # fmt: skip
    waveform = pd.DataFrame({name: f[:2].ravel() for name, f in of.items()})
    magnitude = pd.DataFrame({name: np.hypot(f[0], f[1]) for name, f in of.items()})
    parts += [waveform.assign(quantity=PLANE, t=np.tile(TURN, 2)),
              magnitude.assign(quantity=MAGNITUDE, t=TURN)]  # fmt: skip
    name = name_of(feed)
    return pd.concat(parts, ignore_index=True).assign(
        case=name, group=name, regime="", unit="N", low=np.nan, high=np.nan
    )


TRUTH = {
    "parameters": {"K_tc": 1800.0, "K_rc": 700.0, "K_te": 25.0, "K_ae": 4.1, "runout": 11.0,
                   "runout_angle": 37.0 + 3 * 360.0 / FLUTES, "helix": 30.0},
    "spindle": {"no_load_W": [[6000, 670.0], [12_000, 1900.0], [500, 90.0]], "efficiency": 0.9,
                "specific_force": 1950.0},
}  # fmt: skip


def shown(
    found: CuttingModel | None = None, judged: Verdict | None = None,
    curves: pd.DataFrame | None = None, **changes: Any,
) -> Shown[CuttingModel]:  # fmt: skip
    """What is given; nothing else is known."""
    return Shown(
        machine="m", origin="simulated", model=found, verdict=judged, predictions=curves, **changes
    )


def page(*parts: Any, **changes: Any) -> SubModelPage:
    """The page of what is given."""
    return made(SUBMODEL, shown(*parts, **changes))
