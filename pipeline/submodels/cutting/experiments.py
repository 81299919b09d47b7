"""Cuts on a dynamometer that would tell more of the force coefficients.

Rows are the mean forces over a revolution, linear in the six coefficients, with the errors of
:mod:`.law_draws`: zeros, a gain and a wear of each recording, by which its rows are whitened, and
what more recordings do not average out, each a nuisance with its prior: the shares of the channels
in each other, wear in the order of the feeds, a size effect and an edge force that grows with the
chip, as far as they bend a straight line over the named range of feeds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import permutations

import numpy as np

from pipeline.cutting.force.force_law import (
    COEFFICIENTS,
    N_MM,
    N_MM2,
    design,
    local_lines,
    regressors,
)
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CutConditions, CuttingModel
from pipeline.schema.si import MM
from pipeline.submodels.cutting.law_draws import CROSSTALK, FRICTION, GAINS, WEARS, named_range
from pipeline.submodels.next_recording import Candidate, Design

GAIN, WEAR = GAINS[1], WEARS[1]
"""Shares of gain and wear, the middle ones of the draws [1]."""
SIZE_EFFECT, GROWTH = 0.1, 3e-6
"""Standard deviations of the exponent m of a size effect [1] and of the growth h_0 [m]."""
NUISANCES = 9
"""Crosstalk of three channels, wear in the order of the feeds, two bends of the law [1]."""
LEAST_N = 0.3
"""Least standard deviation of a mean force by its zero [N]."""
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
    rows = partial(_rows, sizes=sizes, zero=model.fit.zero_N, named=named_range(training))
    intervals = [getattr(stated.get(name), "interval_95", None) for name in COEFFICIENTS]
    half = np.array([np.nan if i is None else (i[1] - i[0]) / 2 for i in intervals]) * units
    means = _means(judged)
    known = np.concatenate([half, np.zeros(NUISANCES)])
    prior = np.eye(len(known))[6:]
    yield Design(
        names=(*COEFFICIENTS, *("nuisance",) * NUISANCES), half_widths=known,
        units=("N/m^2",) * 3 + ("N/m",) * 3 + ("1",) * NUISANCES, floors=np.zeros(len(known)),
        sizes=np.concatenate([sizes, np.ones(NUISANCES)]), rows=np.vstack([rows(training), prior]),
        judged=np.pad(means, ((0, 0), (0, NUISANCES))), interval=INTERVAL, unit="N",
        limit=float(np.linalg.norm(means @ sizes)) / len(judged) ** 0.5,
        candidates=[
            Candidate(record=f"{words}; {LOGGED}", minutes=20.0, rows=rows(cuts))
            for words, cuts in cut_series(training)
        ],
    )  # fmt: skip


def _means(some: Sequence[CutConditions]) -> Floats:
    """Derivatives of the mean forces by the six coefficients; shape (3 R, 6)."""
    return regressors(
        flutes=[c.flutes for c in some], f_z=[c.f_z for c in some], a_p=[c.a_p for c in some],
        phi_st=[c.phi_st for c in some], phi_ex=[c.phi_ex for c in some],
    ).reshape(-1, 6)  # fmt: skip


def _rows(
    some: Sequence[CutConditions], *, sizes: Floats, zero: float, named: Sequence[CutConditions]
) -> Floats:
    """Whitened derivatives of the mean forces by coefficients and nuisances; (3 R, 15)."""
    laws = [((SIZE_EFFECT,) * 3, 0.0), ((0.0,) * 3, GROWTH)]
    lines = [
        local_lines(np.array([m]), np.array([growth]), sizes[None], named)[0] for m, growth in laws
    ]
    middle = float(np.sqrt(named[0].f_z * named[-1].f_z))
    found = []
    for c in some:
        table = _means([c])
        force, edge = table @ sizes, table[:, 3:] @ (sizes[3:] * np.array([FRICTION, 1.0, 0.0]))
        # what each nuisance at its standard deviation adds to the three means
        columns = [
            CROSSTALK * force[b] * np.eye(3)[a] for a, b in permutations(range(3), 2)
        ]  # fmt: skip
        columns.append(WEAR * np.sqrt(0.5) * edge * np.log(c.f_z / middle))
        for (m, growth), line in zip(laws, lines, strict=True):
            bend = design(c, m, growth) @ sizes - table @ line
            columns.append(bend)
        covariance = max(zero, LEAST_N) ** 2 * np.eye(3)
        covariance += GAIN**2 * np.outer(force, force) + WEAR**2 / 2 * np.outer(edge, edge)
        lower = np.linalg.cholesky(covariance)
        found.append(np.linalg.solve(lower, np.column_stack([table, *columns])))
    return np.concatenate(found)


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
