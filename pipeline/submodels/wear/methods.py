"""Methods on features, the baseline without sensors, and the blend; as plain numbers for a file.

Ridge regression chooses its penalty on tools left out of the training tools; the forest is
scikit-learn's, kept as arrays of its nodes; the baseline is wear over the use of the tool (isotonic
regression), or the share of worn tools by the conditions alone where wear is a class.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.ranges import Count, Range, Ranged
from pipeline.submodels.conformal import splits

if TYPE_CHECKING:
    from pipeline.schema.forest import Trees

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
        found: Floats = self.constant + x @ np.array(self.slopes)
        return found


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
