"""90 % intervals of the forces of a cut, tool by tool, by the draws of its uncertain quantities.

The loads of the station with the greatest peak, and of that with the greatest mean, are computed in
each draw of ``kerf optimise`` (:mod:`.uncertainty`, :mod:`.part_loads`).  The ends are quantiles of
the draws, the load between them their median.
"""

from collections.abc import Mapping

import numpy as np

from pipeline.optimisation.reliability.part_loads import draws_of, station_loads
from pipeline.optimisation.reliability.uncertainty import CutRange, Uncertainty
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.program_cut import ForceInterval
from pipeline.twin.cut.coefficients import ToolCoefficients
from pipeline.twin.cut.loads import Cut
from pipeline.twin.cut.tables import figure

DRAWS = 256
"""Draws of each tool: a 5 % quantile errs by a tenth of the half width."""
LEVELS = (0.05, 0.5, 0.95)
"""Ends of a 90 % interval and its median [1]."""
HEAVY = 0.5
"""Share of a tool's greatest peak load from which a cut counts as heavy [1]."""
DIGITS = 6
"""Decimals of a load [N]: forces of teeth that balance leave less."""


def cut_ranges(cut: Cut) -> dict[int, CutRange]:
    """Feeds, speeds and depths of each tool's heavier cuts, by its number."""
    engagement, found = cut.engagement, {}
    peak = cut.station_loads.peak
    speed = cut.plan.spindle_speed[engagement.block] / 60
    f_z = cut.feed_per_tooth[engagement.block]
    for index, number in enumerate(cut.numbers):
        mine = engagement.feed & (engagement.tool == index) & (f_z > 0) & (speed > 0)
        mine &= engagement.axial_depth > 0
        mine &= peak >= HEAVY * peak[mine].max(initial=0.0)
        if mine.any() and cut.tools[index].load_known:
            found[number] = CutRange(
                feeds_m=_ends(f_z[mine]), speeds=_ends(speed[mine]),
                depths_m=_ends(engagement.axial_depth[mine]),
            )  # fmt: skip
    return found


def _ends(values: Floats) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def force_intervals(
    cut: Cut, uncertain: Uncertainty, coefficients: Mapping[int, ToolCoefficients],
    model: CuttingModel | None, seed: int,
) -> tuple[ForceInterval, ...]:  # fmt: skip
    """Peak and mean load in the plane of each tool that cuts: medians and 90 % intervals."""
    draws, ranges = draws_of(uncertain, DRAWS, seed), cut_ranges(cut)
    rows = []
    for number in dict.fromkeys(cut.numbers[k] for k in cut.tool[cut.tool >= 0].tolist()):
        if number not in ranges or number not in draws.tools:
            continue
        peak_at, mean_at = _stations(cut, cut.numbers.index(number))
        drawn, given = draws.tools[number], coefficients[number]
        (low, peak, high), (mean_low, mean, mean_high) = (
            np.quantile(one * draws.model, LEVELS).round(DIGITS) for one in (
                station_loads(cut, peak_at, drawn), station_loads(cut, mean_at, drawn, mean=True)
            )
        )  # fmt: skip
        rows.append(ForceInterval(
            tool=number, name=cut.tools[cut.numbers.index(number)].name, source=given.source,
            peak_load_N=figure(peak), peak_load_low_N=figure(low), peak_load_high_N=figure(high),
            mean_load_N=figure(mean), mean_load_low_N=figure(mean_low),
            mean_load_high_N=figure(mean_high),
            runout=uncertain.tools[number].runout_words,
            outside=not_learnt(ranges[number], model) if given.kind == "identified" else (),
        ))  # fmt: skip
    return tuple(rows)


def _stations(cut: Cut, index: int) -> tuple[int, int]:
    engagement = cut.engagement
    mine = np.flatnonzero(engagement.feed & (engagement.tool == index))
    loads = cut.station_loads
    return int(mine[np.argmax(loads.peak[mine])]), int(mine[np.argmax(loads.mean[mine])])


ALIKE = 0.01
"""Relative difference up to which conditions count as learnt [1]."""


def not_learnt(used: CutRange, model: CuttingModel | None) -> tuple[str, ...]:
    """Conditions of a tool outside of those that an identified law was learnt at, in words."""
    spread = None if model is None or model.prediction is None else model.prediction.spread
    if spread is None:
        return ()
    every = (
        ("feed per tooth", used.feeds_m, spread.feeds_m, 1e3, "mm"),
        ("spindle speed", used.speeds, spread.speeds, 60.0, "rev/min"),
        ("axial depth of cut", used.depths_m, spread.depths_m, 1e3, "mm"),
    )
    return tuple(
        f"{name} {low * unit:.4g} to {high * unit:.4g} {of}, learnt {least * unit:.4g} to "
        f"{most * unit:.4g}"
        for name, (low, high), (least, most), unit, of in every
        if low < least * (1 - ALIKE) or high > most * (1 + ALIKE)
    )
