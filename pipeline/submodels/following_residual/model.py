"""Stored model of the residual following error, its predictor and its attention.

For each axis and use, networks of each kind are kept as they were trained on all but one fold of
the training recordings; what serves is the mean of those of the champion.  Its ``residual``
is the prediction before the motion for the twin.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import ceil, inf
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from pipeline.nets.settings import WINDOW_KINDS as NETWORKS
from pipeline.nets.settings import (
    ArxSettings,
    CnnLstmAttentionSettings,
    CnnLstmSettings,
    LstmSettings,
    ResNetSettings,
    SequenceSettings,
    TcnSettings,
    WindowTraining,
)
from pipeline.nets.windows import Recording, WindowInput, Windows, windows_of
from pipeline.parallel import mapped
from pipeline.schema.arrays import Floats
from pipeline.schema.bundle import model_hash
from pipeline.schema.model import Band, Model
from pipeline.schema.ranges import Count, NotNegative, Positive, Range, Ranged
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.conformal import half_widths
from pipeline.submodels.following_residual.features import (
    MEASURED,
    REGIMES,
    RESIDUAL,
    before_motion,
    every,
    modelled_following,
    regimes,
)
from pipeline.twin.drive import IdentifiedDrive

if TYPE_CHECKING:
    from pipeline.nets.window_training import TrainedSequence
    from pipeline.twin.program_axes import Residual

PREDICTION, ESTIMATION = "prediction", "estimation"
"""Prediction before the motion, by commands; estimation with earlier measurements as well."""
QUANTITIES = {PREDICTION: "following error", ESTIMATION: "following error, estimated"}
"""Quantities of the two, followed by the axis' letter."""
TWIN, FUZZY, PERSISTENCE = "twin alone", "fuzzy PI", "persistence"
"""No network; none, and a fuzzy PI speed loop; the last available measured residual."""
ATTENTIVE = "cnn_lstm_attention"
"""The published network."""
ARX = "arx"
"""The linear network, which is solved at once."""
KINDS = {name: one for name, one in NETWORKS.items() if name != ResNetSettings.kind}
"""Kind of network that sees the past alone -> its settings."""
NAMES = {
    "arx": "ARX", "lstm": "LSTM", "cnn_lstm": "CNN-LSTM",
    "cnn_lstm_attention": "CNN-LSTM with attention", "tcn": "TCN",
    TWIN: "drive model alone", FUZZY: "drive model with fuzzy PI", PERSISTENCE: "persistence",
}  # fmt: skip
"""Kinds of network by their name in words."""


def titles(*, with_drive: bool) -> dict[str, str]:
    """What serves and what it is compared with, in words."""
    alone = NAMES[TWIN] if with_drive else "nothing predicted"
    return NAMES | {PERSISTENCE: "last error known", TWIN: alone}


@dataclass(frozen=True, kw_only=True)
class ResidualFitSettings(Ranged, section="following_residual_fit"):
    """Training and comparison of the networks."""

    step_s: Positive = 0.002
    """Row period of a window [s]; the nearest whole number of samples."""
    length: Count = 48
    """Rows of a window."""
    horizon_s: Annotated[float, Range(least=0.001)] = 0.02
    """Age of the youngest measurement that an estimation uses [s]."""
    settle_s: NotNegative = 0.3
    """Begin of each recording that is left out, in which the drives' model settles [s]."""
    windows: Count = 1500
    """Windows of one training; as many of each regime as there are, so that reversals weigh as much
    as the long stretches at constant speed."""
    folds: Annotated[int, Range(least=2, most=20)] = 3
    """Parts of the training recordings that are left out in turn."""
    kinds: tuple[str, ...] = tuple(KINDS)
    estimators: tuple[str, ...] = ("arx", "cnn_lstm_attention")
    """Networks of the prediction, and of the estimation."""
    units: Count = 50
    filters: Count = 16
    """Units of the LSTMs; filters of the convolutions."""
    pool: Count = 1
    """Rows of a convolution of which the greatest enters the LSTM behind it; 1 as published."""
    ridges: tuple[Positive, ...] = (1e-1, 1e-2, 1e-3, 1e-4)
    """Penalties of the linear model, as shares of the variance of its output; the one with the
    least error on the recordings that stop the trainings of the others is taken."""
    training: WindowTraining = field(default_factory=WindowTraining)
    """Training of each network."""
    searched: str = "cnn_lstm_attention"
    """Kind whose learning rate, units and penalty are searched on the first axis; "" for none."""

    def __post_init__(self) -> None:
        super().__post_init__()
        named = (*self.kinds, *self.estimators, *([self.searched] if self.searched else []))
        for kind in named:
            if kind not in KINDS:
                raise ValueError(
                    f"following_residual_fit names the network {kind!r}: choose among "
                    f"{', '.join(KINDS)}"
                )
        if not (self.kinds and self.estimators and self.ridges):
            raise ValueError(
                "following_residual_fit.kinds, .estimators and .ridges need one entry each at least"
            )

    def networks(self, kind: str) -> tuple[SequenceSettings, ...]:
        """Settings of a kind to choose from by the recordings that stop a training."""
        if kind == ARX:
            return tuple(ArxSettings(ridge=ridge) for ridge in self.ridges)
        return (self.network(kind),)

    def network(self, kind: str) -> SequenceSettings:
        """Settings of a kind; of the linear one its first."""
        if kind == ARX:
            return ArxSettings(ridge=self.ridges[0])
        if kind == "tcn":
            return TcnSettings(filters=self.filters)
        if kind == "lstm":
            return LstmSettings(units=self.units)
        made = CnnLstmAttentionSettings if kind == "cnn_lstm_attention" else CnnLstmSettings
        return made(filters=self.filters, units=self.units, pool=self.pool)


@dataclass(frozen=True, kw_only=True)
class KindScore:
    """A kind on training recordings left out."""

    rmse_um: float
    max_um: float
    """Greatest error over all held-out samples [um]."""
    spread_um: float = 0.0
    """Standard deviation over the networks of the folds of the RMSE of what each left out [um]."""


@dataclass(frozen=True, kw_only=True)
class UseModel:
    """Use of a model on one axis."""

    champion: str
    """Kind with the least RMSE on held-out training recordings, or the baseline."""
    scores: Mapping[str, KindScore]
    """Scores by kind, and of the baseline."""
    bands: Mapping[str, Band]
    """Half widths of the 90 % interval by regime [um]."""
    inputs: tuple[WindowInput, ...]
    """Inputs of the networks."""
    by_time: bool = False
    """Whether folds are stretches of time of the recordings, of which there are too few to leave
    whole ones out."""


@dataclass(frozen=True, kw_only=True)
class SearchFacts:
    """Result of an architecture search."""

    kind: str
    axis: str
    method: str
    """Network and axis that it was made on; the search."""
    candidates: int
    pruned: int
    """Trained; stopped early as worse than half of the others."""
    history_um: tuple[float, ...]
    """Least validation RMSE after each generation [um]."""
    chosen: Mapping[str, float]
    """Best settings of the search."""
    bounds_hit: Mapping[str, str] = field(default_factory=dict)
    """Settings whose best value lies on a bound, and which."""


@dataclass(frozen=True, kw_only=True)
class LeakShown:
    """Apparent gain of the published inputs: they hold the measured position."""

    axis: str
    kind: str
    """Kind of network of the comparison."""
    inputs: tuple[str, ...]
    """Inputs that are not available yet."""
    rmse_um: float
    honest_um: float
    """RMSE on training recordings left out, with them and without [um]."""
    max_um: float
    honest_max_um: float
    """Greatest errors there [um]."""


@dataclass(frozen=True, kw_only=True)
class AttentionShown:
    """Mean attention of the published network over its window, K parts of it."""

    axis: str
    """Axis of the motion."""
    ms: tuple[float, ...]
    """Time before the predicted one [ms], the oldest first; shape (K,)."""
    weights: Mapping[str, tuple[float, ...]]
    """Attention weights by regime of the motion [1]; those of a regime add up to 1; shape (K,)."""


@dataclass(frozen=True, kw_only=True)
class ResidualModel(Model):
    """``model.json``; the networks stand in ``networks.json`` beside it."""

    axes: Mapping[str, Mapping[str, UseModel]]
    """Uses by axis letter and use."""
    step_s: float
    horizon_s: float
    settle_s: float
    """Step, horizon and settling time of the settings [s]."""
    length: int
    """Rows of a window."""
    lead_mm: Mapping[str, float] = field(default_factory=dict)
    """Lead of the screws whose turn is an input [mm]."""
    with_drive: bool = True
    """Whether there is a model of the drives; else the error itself is learnt."""
    search: SearchFacts | None = None
    """Search of the settings."""
    leak: LeakShown | None = None
    """Leakage of the published inputs, for comparison only."""
    attention: AttentionShown | None = None
    """Attention of the network over time."""


@dataclass(frozen=True, kw_only=True)
class NetworksFile:
    """``networks.json``: documents of the networks by ``<axis> <use> <kind>``, one a fold."""

    documents: Mapping[str, tuple[Mapping[str, Any], ...]]


def key_of(letter: str, use: str, kind: str) -> str:
    """Name of a kind's networks in ``networks.json``."""
    return f"{letter} {use} {kind}"


@dataclass(frozen=True, kw_only=True, eq=False)
class LoadedResidual:
    """The model with its networks, restored at their first use."""

    file: ResidualModel
    documents: Mapping[str, tuple[Mapping[str, Any], ...]]
    restored: dict[str, "tuple[TrainedSequence, ...]"] = field(default_factory=dict)

    def networks(self, letter: str, use: str, kind: str) -> "tuple[TrainedSequence, ...]":
        """Networks of the folds."""
        from pipeline.nets.window_training import restore_sequence

        key = key_of(letter, use, kind)
        if key not in self.restored:
            self.restored[key] = tuple(restore_sequence(one) for one in self.documents[key])
        return self.restored[key]

    def rows_needed(self, use: UseModel) -> int:
        """Samples of the shortest recording that holds a window of a use."""
        ages = [one.older_than_s or 0.0 for one in use.inputs]
        return self.file.length + ceil(max(ages, default=0.0) / self.file.step_s) + 1

    def windows(self, letter: str, use: str, recording: Recording) -> Windows:
        """All windows of a recording, as a use looks at it."""
        horizon = inf if use == PREDICTION else self.file.horizon_s
        return windows_of(
            [recording], self.file.axes[letter][use].inputs, RESIDUAL, self.file.length, horizon
        )

    def predicted(self, letter: str, use: str, kind: str, windows: Windows) -> Floats:
        """Residual of windows [m] by the mean of a kind's networks, shape (B,)."""
        return np.mean(self.by_each(letter, use, kind, windows), axis=0)

    def by_each(self, letter: str, use: str, kind: str, windows: Windows) -> Sequence[Floats]:
        """Residual of windows [m] by each of a kind's networks on all cores, (B,) each."""
        if kind == TWIN:
            return [np.zeros(len(windows.x))]
        if kind == PERSISTENCE:
            names = [one.name for one in windows.inputs]
            return [windows.x[:, -1, names.index(RESIDUAL)]]
        from pipeline.nets.stored import reproducible

        networks = self.networks(letter, use, kind)
        with reproducible():
            return mapped(lambda one: one.predict(windows.x), networks, compute="threads")

    def residual(
        self, letter: str, reference: Floats, modelled_error: Floats, modelled_command: Floats,
        period: float,
    ) -> tuple[Floats, Floats]:  # fmt: skip
        """Residual before the motion and the half width of its 90 % interval, each (T,) [m].

        Along a commanded position ``reference`` (T,) [m] every ``period`` [s], the axis at rest
        before it, with error [m] and command, in the drive's unit, of the drives' model. For an
        axis that was not learnt it is zero, its width not known (NaN); where the champion is the
        drives' model alone it is zero with the width of that.
        """
        one = self.file.axes.get(letter, {}).get(PREDICTION)
        if one is None:
            return np.zeros(len(reference)), np.full(len(reference), np.nan)
        lead = self.file.lead_mm.get(letter)
        signals = before_motion(reference, period, (modelled_error, modelled_command), lead)
        t = period * np.arange(len(reference))
        grid = np.arange(0.0, t[-1] + 0.5 * self.file.step_s, self.file.step_s)
        regime = regimes(signals)[np.minimum(np.rint(grid / period).astype(int), len(t) - 1)]
        stood = self.file.length - 1
        on_grid = {
            name: np.concatenate([np.full(stood, values[0]), np.interp(grid, t, values)])
            for name, values in signals.items()
        }
        on_grid[RESIDUAL] = np.zeros(stood + len(grid))
        recording = Recording(
            name="command", step_s=self.file.step_s, signals=on_grid, measured=MEASURED
        )
        # nothing was measured: the target is a placeholder, which an axis at rest equals
        windows = windows_of(
            [recording], one.inputs, RESIDUAL, self.file.length, inf, allow_leaks=True
        )
        found = self.predicted(letter, PREDICTION, one.champion, windows)
        _, upper = half_widths(regime, one.bands)
        return np.interp(t, grid, found), np.interp(t, grid, 1e-6 * upper)


def load_residual(folder: Path) -> LoadedResidual:
    """The model in a folder; StoreError when a file is missing, broken or of another form."""
    return LoadedResidual(
        file=read_json(folder / "model.json", ResidualModel),
        documents=read_json(folder / "networks.json", NetworksFile).documents,
    )


NO_RESIDUAL = "none: no residual model of this machine passed"


def residual_of(models: Path) -> tuple["Residual | None", str]:
    """The residual network of a machine with its name; none where no such model passed."""
    folder = models / "following_residual"
    verdict = folder / "verdict.json"
    if not (folder / "model.json").exists():
        return None, NO_RESIDUAL
    if not verdict.exists() or read_json(verdict, Verdict).status != "passed":
        return None, NO_RESIDUAL
    return load_residual(folder).residual, f"residual network {model_hash(folder)[:12]}"


DRAWN_WINDOWS = 100
"""Windows of a regime over which the attention is averaged, at most [1]."""
PERIOD = 0.001
"""Sampling period of the motion [s]."""
RAMP_S, EVEN_S, STAND_S = 0.1, 0.3, 0.2
"""Acceleration, constant speed and rest of the motion [s]."""


def attention_shown(
    model: LoadedResidual, drives: Mapping[str, IdentifiedDrive]
) -> AttentionShown | None:
    """Attention of the first axis whose network before the motion has any; None without one.

    The motion goes to and fro at half of the highest speed that was learnt; the network sees the
    command and the drives' model alone.
    """
    for letter, uses in model.file.axes.items():
        one, drive = uses.get(PREDICTION), drives.get(letter)
        if one is None or ATTENTIVE not in one.scores:
            continue
        top = _highest(model, letter)
        modelled = drive is not None and drive.servo is not None
        if top > 0 and (modelled or all(entry.name != "modelled error" for entry in one.inputs)):
            return _attended(model, letter, 0.5e-3 * top, drive if modelled else None)
    return None


def _highest(model: LoadedResidual, letter: str) -> float:
    """Highest training speed [mm/s]; 0 where it is not recorded."""
    found = model.file.conditions.get(f"highest speed {letter}")
    return 0.0 if found is None or found.high is None else float(found.high)


def to_and_fro(speed: float) -> Floats:
    """Commanded position [m] every ms, shape (T,): rest, to, back at once, rest."""
    ramp, even, stand = (round(s / PERIOD) for s in (RAMP_S, EVEN_S, STAND_S))
    up = speed * 0.5 * (1 - np.cos(np.pi * np.arange(1, ramp + 1) / ramp))
    there = np.concatenate([up, np.full(even, speed), up[::-1]])
    still = np.zeros(stand)
    return PERIOD * np.cumsum(np.concatenate([still, there, -there, still]))


def _attended(
    model: LoadedResidual, letter: str, speed: float, drive: IdentifiedDrive | None
) -> AttentionShown:
    reference = to_and_fro(speed)
    of_model = None if drive is None else modelled_following(letter, reference, PERIOD, drive)
    signals = before_motion(reference, PERIOD, of_model, model.file.lead_mm.get(letter))
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
            weights[name] = tuple(np.mean(found, axis=0).tolist())
    many = len(next(iter(weights.values()), ()))
    width = 1e3 * model.file.step_s * model.file.length / max(many, 1)
    ms = -width * (np.arange(many)[::-1] + 0.5)
    return AttentionShown(axis=letter, ms=tuple(ms.tolist()), weights=weights)
