"""Nodes of a random forest: stored as JSON without pickle, predicted from without scikit-learn.

A sample goes left up to a node's limit; the value of a leaf is the mean of its training samples.
Features are compared in single precision, as scikit-learn does.
"""

from base64 import b64decode, b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from pipeline.kernels import compiled
from pipeline.schema.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from sklearn.ensemble import RandomForestRegressor


@dataclass(frozen=True, kw_only=True, eq=False)
class Trees:
    """All trees of a forest, K nodes in all, one tree after the other."""

    roots: Ints
    """First node of each tree; shape (R,)."""
    left: Ints
    right: Ints
    feature: Ints
    """Children of a node (-1 at a leaf), and the feature that it looks at; shape (K,)."""
    limit: Floats
    value: Floats
    """Greatest feature that goes left; mean of the training samples at the node; shape (K,)."""
    unknown_left: Bools
    """Whether a sample whose feature is unknown (nan) goes left; shape (K,)."""

    @classmethod
    def of(cls, made: "RandomForestRegressor") -> Self:
        """The trees of a fitted forest."""
        trees = [one.tree_ for one in made.estimators_]
        starts = np.cumsum([0, *(tree.node_count for tree in trees)])

        def shifted(name: str) -> Ints:
            parts = [
                np.where(getattr(tree, name) < 0, -1, getattr(tree, name) + start)
                for tree, start in zip(trees, starts, strict=False)
            ]
            return np.concatenate(parts).astype(np.int64)

        return cls(
            roots=starts[:-1].astype(np.int64), left=shifted("children_left"),
            right=shifted("children_right"),
            feature=np.maximum(np.concatenate([t.feature for t in trees]), 0).astype(np.int64),
            limit=np.concatenate([t.threshold for t in trees]),
            value=np.concatenate([t.value[:, 0, 0] for t in trees]),
            unknown_left=np.concatenate([t.missing_go_to_left for t in trees]).astype(bool),
        )  # fmt: skip

    def predict(self, x: Floats) -> Floats:
        """Mean of the trees for features (N, F), shape (N,)."""
        return self.drawn(x, 0)[0]

    def drawn(self, x: Floats, draws: int) -> Floats:
        """Mean of the trees for features (N, F), and of trees drawn, shape (1 + draws, N).

        Trees drawn with replacement are what the same training would have given with other seeds.
        """
        many = len(self.roots)
        weights = np.full((1 + draws, many), 1.0 / many)
        chosen = np.random.default_rng(0).integers(0, many, (draws, many))
        for row, trees in zip(weights[1:], chosen, strict=True):
            row[:] = np.bincount(trees, minlength=many) / many
        found = np.zeros((1 + draws, len(x)))
        _add_trees(np.ascontiguousarray(x, np.float32), *self._nodes, weights, found)
        return found

    def by_tree(self, x: Floats) -> Floats:
        """Value of each tree for features (N, F), shape (R, N)."""
        found = np.zeros((len(self.roots), len(x)))
        each = np.eye(len(self.roots))
        _add_trees(np.ascontiguousarray(x, np.float32), *self._nodes, each, found)
        # each sample's values beside each other: a mean over trees is then summed pairwise
        return np.asfortranarray(found)

    @cached_property
    def _nodes(self) -> tuple[Any, ...]:
        return (self.roots, self.left, self.right, self.feature, self.limit, self.value,
                self.unknown_left)  # fmt: skip

    def document(self) -> dict[str, Any]:
        """Trees as JSON holds them: little-endian arrays in base64."""
        return {
            name: b64encode(getattr(self, name).astype(kind).tobytes()).decode("ascii")
            for name, (kind, _) in TYPES.items()
        }

    @classmethod
    def restored(cls, document: Mapping[str, Any]) -> Self:
        """The trees of a :meth:`document`; one that lacks an array is refused."""
        missing = [name for name in TYPES if not isinstance(document.get(name), str)]
        if missing:
            raise ValueError(f"the document of a forest has no {missing[0]}")
        return cls(**{
            name: np.frombuffer(b64decode(document[name], validate=True), kind).astype(wide)
            for name, (kind, wide) in TYPES.items()
        })  # fmt: skip


TYPES: Mapping[str, tuple[str, type]] = {
    "roots": ("<i4", np.int64), "left": ("<i4", np.int64), "right": ("<i4", np.int64),
    "feature": ("<i4", np.int64), "limit": ("<f8", np.float64), "value": ("<f8", np.float64),
    "unknown_left": ("|b1", np.bool_),
}  # fmt: skip
"""Arrays of a forest: as they are stored, and as they are used."""


@compiled
def _add_trees(  # type: ignore[no-untyped-def]
    x, roots, left, right, feature, limit, value, unknown_left, weights, found
):
    """Add the trees' values for each row of ``x`` (N, F) to ``found`` (M, N) by ``weights``."""
    for n in range(x.shape[0]):
        for tree in range(len(roots)):
            at = roots[tree]
            while left[at] >= 0:
                seen = x[n, feature[at]]
                goes_left = unknown_left[at] if seen != seen else seen <= limit[at]
                at = left[at] if goes_left else right[at]
            for m in range(weights.shape[0]):
                found[m, n] += weights[m, tree] * value[at]
