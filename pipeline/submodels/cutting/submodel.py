"""Cutting force as a sub-model: cases are recordings of a dynamometer, and logs of a load."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pandas as pd

from pipeline.schema.cutting import MEAN, PEAK, CutConditions, CuttingModel
from pipeline.schema.golden import GoldenSets
from pipeline.schema.model import Condition, LeftOut, Model
from pipeline.schema.si import MM
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Fact, Role
from pipeline.submodels.cases import (
    Case,
    Cases,
    Records,
    conditions_of,
    held,
    role_of,
    sources,
)
from pipeline.submodels.contract import (
    CUTTING_TIME,
    Ends,
    Input,
    Prediction,
    Predictor,
    Sections,
    SubModel,
    Target,
)
from pipeline.submodels.cutting.experiments import cutting_design
from pipeline.submodels.cutting.identify import cutting_model, identify_cutting_force
from pipeline.submodels.cutting.model import ALIKE, restored
from pipeline.submodels.cutting.predictions import ANGLES, ForcePredictor, force_targets
from pipeline.submodels.cutting.recordings import (
    CuttingRecording,
    read_recordings,
    with_revolution,
)
from pipeline.submodels.cutting.recordings import conditions_of as cut_conditions
from pipeline.submodels.cutting.revolution import wave
from pipeline.submodels.cutting.settings import (
    CuttingFitSettings,
    CuttingLimits,
    CuttingRecords,
    CuttingSetup,
)
from pipeline.submodels.cutting.spindle_load.identify import (
    LoadLogFile,
    identify_spindle_load,
    load_logs,
)
from pipeline.submodels.cutting.spread import force_levels, half_widths
from pipeline.submodels.next_recording import Design

LOG_NOTE = "a log of the spindle's load identifies the specific force and is not predicted"
COLUMNS = {
    "speed_rpm": "rev/min",
    "feed_per_tooth_mm": "mm",
    "axial_depth_mm": "mm",
    "entry_deg": "deg",
    "exit_deg": "deg",
}
"""Columns of a table of conditions, with their units."""
SERVED = ["peak_N", "mean_N", "rms_N", "peak_low_N", "peak_high_N", "mean_low_N", "mean_high_N",
          "outside"]  # fmt: skip
"""Columns of served forces."""

GEOMETRY = ("kind", "diameter_mm", "flutes", "helix_deg")
"""Measures of a tool that its cutting-force coefficients hold for."""


@dataclass(frozen=True, kw_only=True)
class Fitting(Sections):
    """Sections of params.yaml that the fit reads."""

    cutting: CuttingSetup
    cutting_records: CuttingRecords
    cutting_fit: CuttingFitSettings


@dataclass(frozen=True, kw_only=True)
class Judging(Fitting):
    """Sections of params.yaml that the judgement reads."""

    cutting_limits: CuttingLimits


class Cutting(SubModel[Fitting, Judging, CuttingModel]):
    """Forces of a cut over the revolution of the spindle."""

    name: ClassVar[str] = "cutting"
    title: ClassVar[str] = "cutting force"
    needs: ClassVar[str] = (
        "forces of slots at three feeds or more on a dynamometer at 10 kHz, or the load of the "
        "spindle with the executed line of a program of known cuts"
    )
    reads: ClassVar[tuple[str, ...]] = ("signals", "raw")
    model: ClassVar[type] = CuttingModel
    fitting: ClassVar[type] = Fitting
    judging: ClassVar[type] = Judging
    inputs: ClassVar[tuple[Input, ...]] = tuple(
        Input(name=name, unit=unit) for name, unit in COLUMNS.items()
    )
    shared: ClassVar[str] = r"K_\w+|kienzle\.\w+"
    unlike: ClassVar[str] = "its force law is of another material or tool"
    ends: ClassVar[Ends] = {
        (PEAK, ""): ("peak_low_N", "peak_high_N"), (MEAN, ""): ("mean_low_N", "mean_high_N")
    }  # fmt: skip

    def targets(self, settings: Judging, model: CuttingModel) -> tuple[Target, ...]:
        """Force in the plane of the feed, which is judged, and in the channels, which is shown."""
        return force_targets(settings.cutting_limits)

    def cases(self, records: Records, settings: Fitting, sets: GoldenSets | None = None) -> Cases:
        """Dynamometer recordings, then load logs; ValueError for a pattern without a file."""
        files, signals, raw = records.files, records.signals, records.raw
        if signals is None or raw is None:
            raise ValueError("cutting needs the signals and the raw folder: name them in reads")
        wanted = settings.cutting_records

        def role(name: str) -> Role:
            return role_of([name], settings.roles, sets)

        cases: list[Case] = []
        left_out: list[LeftOut] = []
        for one in read_recordings(signals, wanted, settings.cutting, settings.cutting_fit, role):
            if one.reason:
                left_out.append(LeftOut(case=one.name, reason=one.reason))
                continue
            load = partial(_whole, one, settings)
            cases.append(Case(
                name=one.name, group=one.name, role=one.role, files=sources(files, [one.name]),
                load=load, conditions=_facts(one.conditions),
            ))  # fmt: skip
        logs = [] if wanted.spindle is None else load_logs(files, wanted.spindle, signals, raw)
        cases += [
            Case(name=log.name, group=log.name, role=role(log.name),
                 files=sources(files, [log.name]), load=held(log))
            for log in logs
        ]  # fmt: skip
        return Cases(cases=tuple(cases), left_out=tuple(left_out))

    def alike(self, model: CuttingModel) -> tuple[Any, ...]:
        """Material and cutting geometry that the coefficients hold for."""
        return model.material, *(model.tool.get(name) for name in GEOMETRY)

    def fit(self, cases: Cases, settings: Fitting, folder: Path) -> CuttingModel:
        """Coefficients of the training recordings, and the specific force of the training logs."""
        training = cases.of("training")
        recordings = _recordings(cases, settings)
        identified = identify_cutting_force(recordings, settings.cutting, settings.cutting_fit)
        logs = [one for case in training if isinstance(one := case.load(), LoadLogFile)]
        records = settings.cutting_records.spindle
        spindle = None
        if records is not None and logs:
            spindle = identify_spindle_load(logs, records, settings.cutting_fit.widest)
        used = {one.name for one in identified.training}
        used |= set(() if spindle is None else spindle.facts.recordings)
        lost = () if spindle is None else spindle.facts.left_out
        learnt = [case for case in training if case.name in used]
        head = Model(
            submodel=self.name, machine=settings.identity.name, origin=settings.identity.origin,
            parameters={}, trained_on=tuple(case.training for case in learnt),
            left_out=(*cases.left_out, *lost), conditions=conditions_of(learnt),
        )  # fmt: skip
        return cutting_model(head, identified, settings.cutting, settings.cutting_fit, spindle)

    def load(self, folder: Path, settings: Judging) -> Predictor:
        """Predictor of recordings; logs of the spindle's load are not predicted."""
        model = read_json(folder / "model.json", CuttingModel)
        predictor = ForcePredictor(model, settings.cutting, settings.cutting_fit)

        def predict(case: Case) -> Prediction:
            content = case.load()
            if isinstance(content, LoadLogFile):
                return Prediction(frame=pd.DataFrame(), note=LOG_NOTE)
            return predictor.prediction(content)

        return predict

    def serve(self, folder: Path) -> Callable[[pd.DataFrame], pd.DataFrame]:
        """Peak, mean and RMS force in the plane of the feed [N] from a table of conditions.

        The ends of the 90 % intervals of peak and mean stand beside them; ``outside`` names the
        conditions that nothing was learnt at.
        """
        stored = read_json(folder / "model.json", CuttingModel)
        model = None if stored.prediction is None else restored(stored.prediction)
        harmonics = CuttingFitSettings().harmonics
        angles = np.linspace(0.0, 2 * np.pi, ANGLES, endpoint=False)

        def predict(table: pd.DataFrame) -> pd.DataFrame:
            if model is None:
                raise ValueError(f"no force can be predicted: {stored.reason}")
            for name in COLUMNS:
                if name not in table.columns:
                    raise ValueError(f"the input has no column {name}: give {', '.join(COLUMNS)}")
            rows: list[tuple[Any, ...]] = []
            for speed, f_z, a_p, entry, leave in table[list(COLUMNS)].to_numpy(float).tolist():
                if not (0 < speed < np.inf and 0 <= f_z < np.inf and 0 <= a_p < np.inf
                        and 0 <= entry < leave <= 180):  # fmt: skip
                    raise ValueError(
                        f"row {len(rows) + 1} has {speed:g} rev/min, f_z {f_z:g} mm, a_p {a_p:g} "
                        f"mm from {entry:g} to {leave:g} deg: give a speed above 0, feed and depth "
                        "of 0 or more and 0 <= entry < exit <= 180"
                    )
                conditions = CutConditions(
                    speed=speed / 60, f_z=f_z * MM, a_p=a_p * MM, flutes=model.tool.flutes,
                    phi_st=float(np.radians(entry)), phi_ex=float(np.radians(leave)),
                )  # fmt: skip
                force = wave(model.predicted(conditions, harmonics), angles)
                size = np.linalg.norm(force[:, :2], axis=1)
                row = (size.max(), size.mean(), float(np.sqrt(np.mean(size**2))))
                peak = mean = np.nan
                if model.spread is not None:
                    levels = force_levels(model, conditions, harmonics)
                    peak, mean = half_widths(model.spread, levels)
                beyond = ", ".join(outside(_facts(conditions), stored.conditions))
                rows.append((*row, row[0] - peak, row[0] + peak, row[1] - mean, row[1] + mean,
                             beyond))  # fmt: skip
            return pd.DataFrame(rows, columns=SERVED, index=table.index)

        return predict

    def example(self, folder: Path) -> pd.DataFrame:
        """Conditions of one recording of the model, else of a slot."""
        stored = read_json(folder / "model.json", CuttingModel)
        rows = [{name: getattr(one, name) for name in COLUMNS} for one in stored.recordings]
        slot = dict(zip(COLUMNS, (4000.0, 0.1, 1.0, 0.0, 180.0), strict=True))
        whole = [row for row in rows if None not in row.values()]
        return pd.DataFrame([whole[0] if whole else slot]).astype(float)

    def designs(self, model: CuttingModel, cases: Cases, settings: Judging) -> list[Design]:
        """Series of cuts, by the six coefficients."""
        learnt = {one.case for one in model.trained_on}
        frozen = cases.of("golden") or cases.of("held_out")
        training, judged = (
            [one.conditions for case in some
             if isinstance(one := case.load(), CuttingRecording) and one.conditions is not None]
            for some in ([case for case in cases.cases if case.name in learnt], frozen)
        )  # fmt: skip
        return list(cutting_design(model, training, judged))

    def influences(self, case: Case, rows: pd.DataFrame) -> dict[str, Any]:
        """Time that the tool had cut before the recording, where that is stated."""
        file = getattr(case.load(), "file", None)
        used = None if file is None else file.conditions.get("cutting_time_min")
        return {} if used is None else {CUTTING_TIME: np.full(len(rows), used.to("s"))}


def _whole(one: CuttingRecording, settings: Fitting) -> CuttingRecording:
    """A recording with its revolution, which a sealed one is given when it is asked for."""
    if one.revolution is not None:
        return one
    return with_revolution(one, settings.cutting, settings.cutting_fit)


def outside(facts: Mapping[str, Fact], learnt: Mapping[str, Condition]) -> list[str]:
    """Names of the numeric conditions that lie outside of those learnt, alike ones apart."""
    names = []
    for name, fact in facts.items():
        known = learnt.get(name)
        if known is None or known.low is None or known.high is None or fact.value is None:
            continue
        slack = ALIKE * max(abs(known.low), abs(known.high))
        if not known.low - slack <= float(fact.value) <= known.high + slack:
            names.append(name)
    return names


def _facts(conditions: CutConditions | None) -> dict[str, Fact]:
    if conditions is None:
        return {}
    names = ("spindle speed", "feed per tooth", "axial depth of cut", "entry angle", "exit angle")
    rows = zip(names, conditions.stated.values(), COLUMNS.values(), strict=True)
    return {name: Fact(value=float(f"{value:.6g}"), unit=unit) for name, value, unit in rows}


def _recordings(cases: Cases, settings: Fitting) -> list[CuttingRecording]:
    """All recordings of the dynamometer, those left out with their reason, by name."""
    recordings = [
        one
        for case in cases.of("training", "held_out", "golden")
        if isinstance(one := case.load(), CuttingRecording)
    ]
    for lost in cases.left_out:
        role: Role = "training" if settings.roles.is_training(lost.case) else "held_out"
        one = CuttingRecording(name=lost.case, sha256="", role=role, reason=lost.reason)
        try:
            stated = settings.cutting_records.sources.of(lost.case)
            one = replace(one, conditions=cut_conditions(stated, settings.cutting.tool))
        except ValueError:  # the reason says so where it matters
            pass
        recordings.append(one)
    return sorted(recordings, key=lambda one: one.name)


SUBMODEL = Cutting()
