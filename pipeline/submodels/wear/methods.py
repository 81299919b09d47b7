"""Features of windows of signals, methods on them, and the baseline without sensors.

Features are levels, shape, spectrum, harmonics of the spindle, conditions.  Channels are divided by
their scale in training, so that every feature is a number of about one; logarithms make gains of
sensors and depths of cut additive.  What is learnt is plain numbers, for a file.

Ridge regression chooses its penalty on tools left out of the training tools; the forest is
scikit-learn's, kept as arrays of its nodes; the baseline is wear over the use of the tool (isotonic
regression), or the share of worn tools by the conditions alone where wear is a class.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Count, Range, Ranged
from pipeline.schema.si import MINUTE
from pipeline.signals.units import conversion
from pipeline.signals.wear_windows import ChannelScaling, WearWindows
from pipeline.submodels.conformal import splits

if TYPE_CHECKING:
    from pipeline.schema.forest import Trees

BANDS = 8
"""Bands of the spectrum between the window's own frequency and half the rate [1]."""
HARMONICS = 8
"""Number of harmonics of the spindle frequency [1]; a cutter's teeth pass at some of them."""
FLOOR = 1e-3
"""Least amplitude that a logarithm sees, as a share of the channel's scale [1]."""
SHAPES = ("mean", "deviation", "level", "range", "kurtosis", "skewness", "5 % quantile",
          "95 % quantile")  # fmt: skip
"""Features of a channel before those of its spectrum and of the spindle's harmonics."""
REACH = 4.0
"""Standard deviations of training [1] beyond which a feature counts no further."""


@dataclass(frozen=True, kw_only=True)
class KnownConditions:
    """Conditions that predictions look at, as they were in training."""

    numbers: tuple[str, ...] = ()
    """Names of the continuous ones."""
    words: Mapping[str, tuple[str, ...]]
    """Discrete ones -> their values in training."""

    @staticmethod
    def of(windows: WearWindows, progress: str) -> "KnownConditions":
        """Conditions of training windows, without the tool's use, which only the baseline has.

        A condition that is the same in all windows tells nothing and is left out.
        """
        numbers, words = [], {}
        for name, values in windows.conditions.items():
            different = np.unique(values)
            if name == progress or len(different) < 2:
                continue
            if name in windows.condition_units:
                numbers.append(name)
            else:
                words[name] = tuple(different.tolist())
        return KnownConditions(numbers=tuple(numbers), words=words)

    def columns(self, windows: WearWindows) -> dict[str, Floats]:
        """Conditions of windows as numbers, (N,) each; a word is one column of 0 and 1 for each."""
        found = {name: np.asarray(windows.conditions[name], float) for name in self.numbers}
        for name, known in self.words.items():
            for word in known:
                found[f"{name} {word}"] = (windows.conditions[name] == word).astype(float)
        return found

    def matrix(self, windows: WearWindows) -> Floats:
        """The same, shape (N, K)."""
        columns = list(self.columns(windows).values())
        return np.stack(columns, axis=1) if columns else np.zeros((len(windows), 0))


def features(windows: WearWindows, scaling: ChannelScaling, known: KnownConditions) -> Floats:
    """Features of windows, shape (N, F), by scaling and conditions of training windows."""
    x = windows.values / np.array(scaling.scale)[:, None]
    mean = x.mean(axis=2)
    beside = x - mean[..., None]
    std = beside.std(axis=2)
    level = np.sqrt((x**2).mean(axis=2))
    shape = beside / np.maximum(std, FLOOR)[..., None]
    parts = [
        mean, _log(std), _log(level), np.ptp(shape, axis=2), (shape**4).mean(axis=2),
        (shape**3).mean(axis=2), np.quantile(x, 0.05, axis=2), np.quantile(x, 0.95, axis=2),
        *_bands(beside), *_harmonics(beside, windows), known.matrix(windows),
    ]  # fmt: skip
    return np.concatenate(parts, axis=1).astype(float)


def feature_names(
    channels: Sequence[str], known: KnownConditions, windows: WearWindows, many: int
) -> list[str]:
    """Names of the ``many`` features, in the order of :func:`features`."""
    others = list(known.columns(windows))
    further = (many - len(others)) // len(channels) - len(SHAPES)
    kinds = [*SHAPES, *(f"part {k + 1} of the spectrum" for k in range(further))]
    return [f"{kind} of {name}" for kind in kinds for name in channels] + others


def _log(amplitude: Floats) -> Floats:
    return np.log(np.maximum(amplitude, FLOOR))


def _bands(x: Floats) -> list[Floats]:
    """Logarithm of the RMS in each band of frequencies, (N, C) each."""
    length = x.shape[2]
    power = np.abs(np.fft.rfft(x * np.hanning(length), axis=2)) ** 2 / length**2
    edges = np.geomspace(1.0 / length, 0.5, BANDS + 1)
    frequency = np.fft.rfftfreq(length)
    place = np.clip(np.searchsorted(edges, frequency, side="right") - 1, 0, BANDS - 1)
    rows = [(place == k) & (frequency > 0) for k in range(BANDS)]
    return [_log(np.sqrt(power[..., one].sum(axis=2))) for one in rows if one.any()]


def _harmonics(x: Floats, windows: WearWindows) -> list[Floats]:
    """Logarithm of the amplitude at multiples of the spindle's frequency, (N, C) each."""
    name = spindle_speed(windows.condition_units)
    if name is None or not np.isfinite(windows.conditions[name]).all():
        return []
    factor, _ = conversion(windows.condition_units[name], "rev/min")
    turns = np.asarray(windows.conditions[name], float) * factor / MINUTE
    t = np.arange(x.shape[2]) / windows.rate_Hz
    found = []
    for harmonic in range(1, HARMONICS + 1):
        wave = np.exp(-2j * np.pi * harmonic * turns[:, None] * t) * np.hanning(len(t))
        amplitude = np.abs(np.einsum("nct,nt->nc", x, wave)) * 4.0 / len(t)
        found.append(_log(amplitude))
    return found


def spindle_speed(units: Mapping[str, str]) -> str | None:
    """The condition that is a speed of rotation, None without one."""
    for name, unit in units.items():
        try:
            conversion(unit, "rev/min")
        except ValueError:
            continue
        return name
    return None


@dataclass(frozen=True, kw_only=True)
class FeatureScaling:
    """Mean and standard deviation of F features in training."""

    mean: Sequence[float]
    std: Sequence[float]

    @staticmethod
    def of(x: Floats) -> "FeatureScaling":
        """Scaling by training windows, shape (N, F)."""
        std = x.std(axis=0)
        std = np.where(std > 1e-9, std, 1.0)
        return FeatureScaling(mean=tuple(x.mean(axis=0).tolist()), std=tuple(std.tolist()))

    def scaled(self, x: Floats) -> Floats:
        """Features about zero, bounded by :data:`REACH`; shape (N, F)."""
        found: Floats = (x - np.array(self.mean)) / np.array(self.std)
        return np.clip(found, -REACH, REACH)


PENALTIES = tuple(float(x) for x in np.geomspace(1e-3, 1e3, 13))
"""Penalties of the ridge regression over the mean eigenvalue of the features' products [1]."""


@dataclass(frozen=True, kw_only=True)
class ForestSettings(Ranged, section="wear_fit.forest"):
    """Size of the forest on features."""

    trees: Count = 100
    leaf: Count = 3
    """Trees, and windows in the smallest leaf."""
    features: Annotated[float, Range(above=0.0, most=1.0)] = 0.3
    """Share of the features that a split is chosen among [1]."""


def tool_weights(tool: np.ndarray) -> Floats:
    """Weights of windows so that each tool weighs the same, of mean one; shape (N,)."""
    _, place, count = np.unique(tool, return_inverse=True, return_counts=True)
    weight: Floats = 1.0 / count[place]
    return weight / weight.mean()


# ---- ridge


@dataclass(frozen=True, kw_only=True)
class Ridge:
    """Linear in scaled features: ``constant`` and F ``slopes``, fitted with ``penalty``."""

    constant: float
    slopes: Sequence[float]
    penalty: float

    def predict(self, x: Floats) -> Floats:
        """Wear from scaled features (N, F), shape (N,)."""
        return self.constant + x @ np.array(self.slopes)


def fit_ridge(x: Floats, y: Floats, tool: np.ndarray) -> Ridge:
    """Ridge regression whose penalty has the least error on tools left out one at a time."""
    tools = list(dict.fromkeys(tool.tolist()))
    error = np.zeros(len(PENALTIES))
    for _, left in splits(tools, len(tools)):
        out = np.isin(tool, left)
        for k, one in enumerate(_ridges(x[~out], y[~out], tool[~out])):
            error[k] += float(np.mean((one.predict(x[out]) - y[out]) ** 2))
    best = int(np.argmin(error)) if len(tools) > 1 else len(PENALTIES) // 2
    return _ridges(x, y, tool)[best]


def _ridges(x: Floats, y: Floats, tool: np.ndarray) -> list[Ridge]:
    """Ridge regressions for all penalties, from one decomposition."""
    weight = tool_weights(tool)
    share = weight / weight.sum()
    x_mean, y_mean = share @ x, float(share @ y)
    a, b = x - x_mean, y - y_mean
    values, vectors = np.linalg.eigh((a * share[:, None]).T @ a)
    along = vectors.T @ ((a * share[:, None]).T @ b)
    unit = max(float(values.mean()), 1e-12)
    found = []
    for penalty in PENALTIES:
        slopes = vectors @ (along / (np.maximum(values, 0.0) + penalty * unit))
        constant = y_mean - float(x_mean @ slopes)
        found.append(Ridge(constant=constant, slopes=tuple(slopes.tolist()), penalty=penalty))
    return found


# ---- forest


def fit_forest(
    x: Floats, y: Floats, tool: np.ndarray, settings: ForestSettings, seed: int
) -> "Trees":
    """A forest of scaled features (N, F); each tool weighs the same."""
    from sklearn.ensemble import RandomForestRegressor

    from pipeline.schema.forest import Trees

    made = RandomForestRegressor(
        n_estimators=settings.trees, min_samples_leaf=settings.leaf,
        max_features=settings.features, random_state=seed, n_jobs=1,
    ).fit(x, y, sample_weight=tool_weights(tool))  # fmt: skip
    return Trees.of(made)


# ---- without sensors, and together


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Wear over the use of the tool: straight lines between points, constant beyond them."""

    use: Sequence[float]
    wear: Sequence[float]

    def predict(self, use: Floats) -> Floats:
        """Wear at a use, shape (N,); NaN without one."""
        known = np.isfinite(use)
        found = np.interp(np.where(known, use, 0.0), self.use, self.wear)
        return np.where(known, found, np.nan)


def fit_curve(use: Floats, wear: Floats, tool: np.ndarray) -> Curve:
    """Least squares among curves that never fall, over tools of the same weight."""
    from sklearn.isotonic import IsotonicRegression

    made = IsotonicRegression().fit(use, wear, sample_weight=tool_weights(tool))
    at, first = np.unique(made.X_thresholds_, return_index=True)
    return Curve(use=tuple(at.tolist()), wear=tuple(made.y_thresholds_[first].tolist()))


def blend_weights(predicted: Floats, measured: Floats, tool: np.ndarray) -> Floats:
    """Weights from 0 to 1 that add up to 1, of the least squared error; shape (M,).

    ``predicted`` (N, M) are those of M methods on tools that they were not fitted on; each tool
    weighs the same.
    """
    from scipy.optimize import nnls

    root = np.sqrt(tool_weights(tool))[:, None]
    scale = max(float(np.std(measured)), 1e-9) * np.sqrt(len(measured))
    heavy = 1e3 * np.ones((1, predicted.shape[1]))
    a = np.concatenate([root * predicted / scale, heavy])
    b = np.concatenate([root[:, 0] * measured / scale, [1e3]])
    weights: Floats = nnls(a, b)[0]
    return weights / weights.sum()
