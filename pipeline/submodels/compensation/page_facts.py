"""Facts of the following error that the drives' model leaves over, for the machine's page.

They come from the stored files alone: model, verdict, predictions, networks.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from pipeline.charts.numbers import TOGETHER, fixed
from pipeline.charts.sources import Source
from pipeline.charts.tables import sources
from pipeline.schema.store import StoreError
from pipeline.schema.verdict import Fact, Figures, JudgedCase, Role, Score
from pipeline.submodels.compensation.features import REGIMES, before_motion, regimes
from pipeline.submodels.compensation.features import modelled_following as followed
from pipeline.submodels.compensation.model import (
    ESTIMATION,
    PERSISTENCE,
    PREDICTION,
    QUANTITIES,
    TWIN,
    Compensation,
    CompensationModel,
    UseModel,
    load_compensation,
)
from pipeline.submodels.contract import Shown
from pipeline.twin.drive import IdentifiedDrive, read_drives

ATTENTIVE = "cnn_lstm_attention"
"""Kind of the published network."""
BASES = {PREDICTION: TWIN, ESTIMATION: PERSISTENCE}
"""What each use is held against."""
SAME_SPEED = 0.02
"""Share by which the highest speeds of two recordings of one motion differ at most [1]."""
DRAWN_WINDOWS = 100
"""Windows of a regime over which the attention is averaged, at most [1]."""
PERIOD = 0.001
"""Between samples of the motion on which the attention is shown [s]."""
RAMP_S, EVEN_S, STAND_S = 0.1, 0.3, 0.2
"""Acceleration, constant speed and rest of that motion [s]."""

Seen = Shown[CompensationModel]


def um(value: float | None) -> str:
    """A length in um, with three digits below 10 um."""
    return "–" if value is None else f"{bare(value)}{TOGETHER}µm"


def bare(value: float | None) -> str:
    """As :func:`um`, for columns with the unit in their head."""
    return "–" if value is None else fixed(value, 2 if abs(value) < 9.995 else 1)


def short(case: str) -> str:
    """A recording without its folder and ending."""
    return case.rpartition("/")[2].removesuffix(".csv")


@dataclass(frozen=True, kw_only=True, eq=False)
class Traced:
    """One recording of one axis, N samples; errors in um, NaN where they are not known."""

    axis: str
    use: str
    case: str
    """Of what."""
    seconds: np.ndarray
    """Since the recording began [s]; shape (N,)."""
    before: np.ndarray
    after: np.ndarray
    """What the drives' model (of an estimation: the last measured error) leaves over, and what the
    one that serves leaves; shape (N,)."""
    low: np.ndarray
    high: np.ndarray
    """90 % interval of ``before``, as it was predicted; shape (N,)."""

    @property
    def worst(self) -> int:
        """Sample with the greatest error that is left."""
        return int(np.nanargmax(np.abs(self.after)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Attended:
    """Mean attention of a network over its window, K rows."""

    ms: np.ndarray
    """Before the time that is predicted [ms], the oldest first; shape (K,)."""
    weights: Mapping[str, np.ndarray]
    """By regime [1]; those of a regime add up to 1; shape (K,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CompensationFacts:
    """Everything that the page says, found once."""

    shown: Seen

    @cached_property
    def axes(self) -> list[tuple[str, str, UseModel]]:
        """Letter, use and model of every axis: before the motion where that was learnt."""
        model = self.shown.model
        if model is None:
            return []
        found = []
        for letter, uses in model.axes.items():
            for use in (PREDICTION, ESTIMATION):
                if use in uses:
                    found.append((letter, use, uses[use]))
                    break
        return found

    @property
    def role(self) -> Role:
        """Of the recordings that decide."""
        verdict = self.shown.verdict
        return (None if verdict is None else verdict.judged_role) or "held_out"

    def made_from(self, *names: str) -> list[Source]:
        """Stored files that a figure stands on."""
        return sources(self.shown.shelf, *(self.shown.folder / name for name in names))

    def total(self, letter: str, use: str) -> Score | None:
        """Errors over all recordings that decide."""
        verdict = self.shown.verdict
        return None if verdict is None else verdict.total(f"{QUANTITIES[use]} {letter}")

    def errors(self, score: Score, kind: str, one: UseModel) -> Figures | None:
        """Errors of a kind beside the one that serves."""
        return score if kind == one.champion else score.baselines.get(kind)

    def recordings(self, letter: str, use: str) -> list[tuple[Score, JudgedCase | None]]:
        """Recordings that decide, the greatest error first."""
        verdict = self.shown.verdict
        if verdict is None:
            return []
        cases = {case.group: case for case in verdict.cases if case.role == self.role}
        scores = [
            s for s in verdict.of(f"{QUANTITIES[use]} {letter}", role=self.role)
            if s.group != "all" and s.regime == ""
        ]  # fmt: skip
        scores.sort(key=lambda s: -(s.max or 0.0))
        return [(score, cases.get(score.group)) for score in scores]

    def new_speed(self, case: JudgedCase | None, letter: str) -> bool:
        """Whether no recording that was learnt from has the highest speed of this one."""
        name = f"highest speed {letter}"
        verdict, own = self.shown.verdict, None if case is None else case.conditions.get(name)
        if verdict is None or own is None or not isinstance(own.value, float | int):
            return False
        learnt = [
            f.value for c in verdict.cases
            if c.role == "training" and (f := c.conditions.get(name)) is not None
            and isinstance(f.value, float | int)
        ]  # fmt: skip
        return all(abs(own.value - one) > SAME_SPEED * abs(one) for one in learnt)

    def speed(self, case: JudgedCase | None, letter: str) -> Fact | None:
        """Highest commanded speed of a recording."""
        return None if case is None else case.conditions.get(f"highest speed {letter}")

    def traced(self, letter: str, use: str, one: UseModel) -> Traced | None:
        """The recording that decides with the greatest error; None where none can be drawn."""
        rows = self.shown.predictions
        if rows is None or not len(rows):
            return None
        rows = rows[(rows["quantity"] == f"{QUANTITIES[use]} {letter}") & (rows["regime"] == "")
                    & (rows["role"] == self.role)]  # fmt: skip
        left = np.abs((rows["measured"] - rows["predicted"]).to_numpy(float))
        if not np.isfinite(left).any():
            return None
        case = str(rows["case"].iloc[int(np.nanargmax(left))])
        return _trace(rows[rows["case"] == case], letter, use, case, one.champion)

    @cached_property
    def networks(self) -> Compensation | None:
        """The model with its networks; None where they are not there or broken."""
        if self.shown.model is None or not (self.shown.folder / "networks.json").is_file():
            return None
        try:
            return load_compensation(self.shown.folder)
        except StoreError:
            return None

    def attended(self) -> tuple[str, Attended] | None:
        """The first axis whose network has attention, and where that looks; None without one.

        It is shown on one motion to and fro at half of the highest speed that was learnt, from
        the command and the drives' model alone.
        """
        for letter, use, one in self.axes:
            if use != PREDICTION or ATTENTIVE not in one.scores or self.networks is None:
                continue
            top = 1e-3 * _highest(self.shown.model, letter)
            drives = self._drives()
            wanted = {entry.name for entry in one.inputs}
            if top <= 0 or ("modelled error" in wanted and letter not in drives):
                continue
            try:
                return letter, _attended(self.networks, letter, 0.5 * top, drives.get(letter))
            except (KeyError, ValueError):  # no networks of that kind, or broken ones
                return None
        return None

    def _drives(self) -> Mapping[str, IdentifiedDrive]:
        path = self.shown.folder.parent / "drive" / "model.json"
        try:
            found = read_drives(path) if path.is_file() else {}
        except StoreError:
            return {}
        return {letter: one for letter, one in found.items() if one.servo is not None}


def _trace(rows: pd.DataFrame, letter: str, use: str, case: str, champion: str) -> Traced:
    """Errors before and after of the rows of one recording."""
    rows = rows.sort_values("t", kind="stable")
    seconds, measured, predicted, low, high = (
        rows[name].to_numpy(float) for name in ("t", "measured", "predicted", "low", "high")
    )
    name = f"baseline_{BASES[use]}"
    base = predicted
    if champion != BASES[use] and name in rows.columns:
        base = rows[name].to_numpy(float)
    return Traced(
        axis=letter, use=use, case=case, seconds=seconds, before=measured - base,
        after=measured - predicted, low=low - base, high=high - base,
    )  # fmt: skip


def _highest(model: CompensationModel | None, letter: str) -> float:
    """Highest speed that was learnt [mm/s]; 0 where it is not known."""
    found = None if model is None else model.conditions.get(f"highest speed {letter}")
    return 0.0 if found is None or found.high is None else float(found.high)


def to_and_fro(speed: float) -> np.ndarray:
    """Commanded position [m] every ms, shape (T,): rest, to, back at once, rest."""
    ramp, even, stand = (round(s / PERIOD) for s in (RAMP_S, EVEN_S, STAND_S))
    up = speed * 0.5 * (1 - np.cos(np.pi * np.arange(1, ramp + 1) / ramp))
    there = np.concatenate([up, np.full(even, speed), up[::-1]])
    still = np.zeros(stand)
    return PERIOD * np.cumsum(np.concatenate([still, there, -there, still]))


def _attended(
    model: Compensation, letter: str, speed: float, drive: IdentifiedDrive | None
) -> Attended:
    """Mean attention of the folds' networks by regime, on one motion to and fro."""
    from pipeline.nets.windows import Recording
    from pipeline.submodels.compensation.features import MEASURED, RESIDUAL, every

    reference = to_and_fro(speed)
    of_model = None if drive is None else followed(letter, reference, PERIOD, drive)
    lead = model.file.lead_mm.get(letter)
    signals = before_motion(reference, PERIOD, of_model, lead)
    rows = slice(None, None, every(PERIOD, model.file.step_s))
    regime = regimes(signals)[rows]
    on_grid = {name: values[rows] for name, values in signals.items()}
    on_grid[RESIDUAL] = np.zeros(len(regime))
    windows = model.windows(letter, PREDICTION, Recording(
        name="to and fro", step_s=model.file.step_s, signals=on_grid, measured=MEASURED
    ))  # fmt: skip
    weights = {}
    for name in REGIMES:
        of = np.flatnonzero(regime[windows.at] == name)
        of = of[:: max(-(-len(of) // DRAWN_WINDOWS), 1)]
        if len(of):
            found = [
                one.attention(windows.x[of]).mean(axis=0)
                for one in model.networks(letter, PREDICTION, ATTENTIVE)
            ]
            weights[name] = np.mean(found, axis=0)
    many = len(next(iter(weights.values()), ()))
    width = 1e3 * model.file.step_s * model.file.length / max(many, 1)
    return Attended(ms=-width * (np.arange(many)[::-1] + 0.5), weights=weights)
