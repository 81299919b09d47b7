"""Cuts on a dynamometer that would tell more of the force coefficients.

Rows are the mean forces over a revolution, linear in the six coefficients.  Each is weighted by the
zero of its recording and by what a cut differs from the next one (wear, gain, a bent law), as a
share of the force: that of the fit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from pipeline.cutting.force.force_law import COEFFICIENTS, N_MM, N_MM2, regressors
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CutConditions, CuttingModel
from pipeline.schema.si import MM
from pipeline.submodels.next_recording import Candidate, Design

CUTS = 6
"""Cuts of some seconds that twenty minutes hold, clamping and zero among them [1]."""
LOGGED = (
    "record the three forces of each cut at 10 kHz from a second before the tool enters, with the "
    "amplifiers reset before"
)
INTERVAL = "mean forces of the judged cuts, by the six coefficients"


def cutting_design(
    model: CuttingModel, training: Sequence[CutConditions], judged: Sequence[CutConditions]
) -> Iterator[Design]:
    """Design of the coefficients; none where they, or cuts to judge them by, are missing."""
    stated = model.parameters.get("", {})
    values = np.array([getattr(stated.get(name), "value", None) for name in COEFFICIENTS], float)
    if model.fit is None or not training or not judged or not np.isfinite(values).any():
        return
    units = np.array([N_MM2] * 3 + [N_MM] * 3)
    sizes = np.where(np.isfinite(values), values, np.nanmax(values[:3]) / 10) * units
    zero, share = model.fit.zero_N, model.fit.rms_error_percent / 100

    def rows(some: Sequence[CutConditions], *, weighted: bool = True) -> Floats:
        design = regressors(
            flutes=[c.flutes for c in some], f_z=[c.f_z for c in some], a_p=[c.a_p for c in some],
            phi_st=[c.phi_st for c in some], phi_ex=[c.phi_ex for c in some],
        )  # fmt: skip
        forces = np.linalg.norm(design @ np.nan_to_num(sizes), axis=1)
        weight = 1 / np.hypot(zero, share * forces) if weighted else np.ones(len(some))
        return np.asarray((design * weight[:, None, None]).reshape(-1, len(COEFFICIENTS)))

    intervals = [getattr(stated.get(name), "interval_95", None) for name in COEFFICIENTS]
    half = np.array([np.nan if i is None else (i[1] - i[0]) / 2 for i in intervals]) * units
    forces = np.linalg.norm(rows(judged, weighted=False) @ sizes) / np.sqrt(len(judged))
    yield Design(
        names=COEFFICIENTS, units=("N/m^2",) * 3 + ("N/m",) * 3, half_widths=half,
        floors=np.zeros(6), sizes=sizes, rows=rows(training), judged=rows(judged, weighted=False),
        interval=INTERVAL, unit="N", limit=float(forces),
        candidates=[
            Candidate(record=f"{words}; {LOGGED}", minutes=20.0, rows=rows(cuts))
            for words, cuts in cut_series(training)
        ],
    )  # fmt: skip


def cut_series(training: Sequence[CutConditions]) -> Iterator[tuple[str, list[CutConditions]]]:
    """Series of cuts within the feeds and depths that were cut before."""
    feeds = np.array([c.f_z for c in training])
    low, high = float(feeds.min()), float(feeds.max())
    deep = max(training, key=lambda c: c.a_p)
    arcs = {"slots": (0.0, np.pi), "down-milled halves": (np.pi / 2, np.pi),
            "up-milled halves": (0.0, np.pi / 2)}  # fmt: skip
    spreads = {
        "half at the least, half at the greatest feed": np.repeat([low, high], CUTS // 2),
        "from the least to the greatest feed": np.linspace(low, high, CUTS),
        "all at the middle feed": np.full(CUTS, (low + high) / 2),
    }  # fmt: skip
    for arc, (entry, leave) in arcs.items():
        for spread, some in spreads.items():
            cuts = [replace(deep, f_z=float(f), phi_st=entry, phi_ex=leave) for f in some]
            said = ", ".join(f"{f / MM:.3g}" for f in dict.fromkeys(some.tolist()))
            yield (
                f"cut {CUTS} {arc}, {spread} ({said} mm a tooth), {deep.a_p / MM:g} mm deep at "
                f"{60 * deep.speed:.0f} rev/min", cuts
            )  # fmt: skip
