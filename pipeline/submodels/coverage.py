"""Test of 90 % prediction intervals against what groups that were not learnt from say of them.

Samples of a group hang together, so groups count.  The margin of a share of samples is its 95 %
interval by the jackknife over groups, and at least 3 / n for n samples: of none outside among n,
the share outside is below that with 95 % (rule of three; Hanley and Lippman-Hand 1983).

A share saturates at 1, so that an interval of any width keeps an upper limit that few groups or
samples cannot resolve.  Its width still tells: the RMSE over G groups is below that of all groups
to come by at most sqrt(chi2(0.05, G) / G) with 95 %, and a half width from K training groups may be
wider than one from many by Student's t(0.95, K - 1) sqrt(1 + 1 / K) over 1.645, the factor of a
prediction interval from K values (Hahn and Meeker 1991, 4.7).
"""

import numpy as np
import pandas as pd

from pipeline.schema.verdict import Score
from pipeline.submodels import scoring
from pipeline.submodels.conformal import TELLING
from pipeline.submodels.contract import Target
from pipeline.submodels.statistics import jackknife_half_width, student_quantile

CheckReasons = tuple[list[str], list[str]]
"""Reasons of a check: for sure, and too near to the limit to tell."""
NORMAL_90 = 1.645
"""Half of a 90 % interval of a normal distribution over its standard deviation [1]."""
OF_NONE = 3.0
"""Greatest expected number [1] of events of which none was seen, with 95 %."""


def covered(rows: pd.DataFrame, score: Score, target: Target, trained: int) -> CheckReasons:
    """Reasons why an interval holds too few or too many of the samples.

    ``rows`` are those of the groups that decide, ``score`` the one over all of them, ``trained``
    the number of training groups that the width may be calibrated on.
    """
    least, most = target.coverage or (0.0, 1.0)
    share, regime = score.coverage_90, f" {target.regime}" if target.regime else ""
    limits = f"limits {100 * least:g} to {100 * most:g} %"
    if share is None:
        lacking = f"{target.quantity}{regime} has no 90 % interval"
        return [f"{lacking}, limits of the share inside {limits.removeprefix('limits ')}"], []
    said = (
        f"{target.quantity}{regime}: {100 * share:.4g} % of the samples lie inside the 90 % "
        "interval, "
    )
    spread = score.spread.get("coverage_90", 0.0)
    ends = (least, most) if trained >= TELLING else (least,)
    if any(abs(share - end) < spread for end in ends if end > 0):
        return [], [
            f"{said}too near to the {limits}: trainings differ by \u00b1 {100 * spread:.2g} %, "
            "not decided"
        ]
    if least <= share <= most:
        return [], []
    groups = rows["group"].nunique()
    margin = share_margin(rows, score)
    if share < least:
        if least - share > margin:
            return [f"{said}{limits}"], []
        of = "1 group does" if groups == 1 else f"{groups} groups do"
        return [], [f"{said}{limits}, which {of} not tell: record more, not decided"]
    if too_wide(score, groups, trained, target.widest):
        times = f"its half width is {score.half_width_over_rmse:.2g} times the RMSE"
        return [f"{said}{limits}; {times}"], []
    if trained >= TELLING and groups >= scoring.FEWEST_GROUPS and share - most > margin:
        return [f"{said}{limits}"], []
    return [], []


def share_margin(rows: pd.DataFrame, score: Score) -> float:
    """Half of the 95 % interval of the share inside [1]; infinite for a single group."""
    error, low, high = (rows[name].to_numpy(float) for name in ("measured", "low", "high"))
    known = np.isfinite(low) & np.isfinite(high)
    inside = ((low <= error) & (error <= high))[known]
    _, group, count = np.unique(
        rows["group"].to_numpy(str)[known], return_inverse=True, return_counts=True
    )
    held = np.bincount(group, weights=inside)
    if len(count) < 2:
        return float("inf")
    without = (held.sum() - held) / (count.sum() - count)
    return max(float(jackknife_half_width(without)), OF_NONE / score.n)


def too_wide(score: Score, groups: int, trained: int, widest: float) -> bool:
    """Whether the half width over the RMSE is surely above that of an interval of use.

    ``widest`` is the greatest ratio with many training groups [1].
    """
    from scipy.special import chdtri

    ratio, known = score.half_width_over_rmse, max(trained, 2)
    if ratio is None:
        return False
    few = student_quantile(known - 1, 0.95) * np.sqrt(1 + 1 / known) / NORMAL_90
    return bool(ratio * np.sqrt(chdtri(groups, 0.95) / groups) > widest * few)
