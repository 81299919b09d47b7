"""Cuts on a dynamometer that would tell more of the force coefficients.

Rows are the mean forces over a revolution, linear in the six coefficients, with the errors of
:mod:`.law_draws`: zeros, a gain and a wear of each recording, by which its rows are whitened, and
what more recordings do not average out, each a nuisance of known spread: the shares of the channels
in each other, wear in the order of the feeds, a size effect and an edge force that grows with the
chip, as far as they bend a straight line over the named range of feeds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from pipeline.cutting.force.force_law import COEFFICIENTS, N_MM, N_MM2, design, local_lines
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
    zero, named = max(model.fit.zero_N, LEAST_N), named_range(training)
    intervals = [getattr(stated.get(name), "interval_95", None) for name in COEFFICIENTS]
    half = np.array([np.nan if i is None else (i[1] - i[0]) / 2 for i in intervals]) * units
    means = _table(judged)
    yield Design(
        names=COEFFICIENTS, units=("N/m^2",) * 3 + ("N/m",) * 3, half_widths=half,
        floors=np.zeros(6), sizes=sizes, information=_information(training, sizes, zero, named),
        independent=len(training), judged=means, interval=INTERVAL, unit="N",
        limit=float(np.linalg.norm(means @ sizes)) / len(judged) ** 0.5,
        candidates=[
            Candidate(
                record=f"{words}; {LOGGED}",
                information=_information([*training, *cuts], sizes, zero, named),
            )
            for words, cuts in cut_series(training)
        ],
    )  # fmt: skip


def _table(some: Sequence[CutConditions], m: float = 0.0, growth: float = 0.0) -> Floats:
    """Mean forces for each constant of a law; shape (3 R, 6)."""
    return np.concatenate([design(one, (m,) * 3, growth) for one in some])


def _information(
    some: Sequence[CutConditions], sizes: Floats, zero: float, named: Sequence[CutConditions]
) -> Floats:
    """Information of the mean forces of some cuts on the coefficients alone; shape (6, 6)."""
    laws = [(SIZE_EFFECT, 0.0), (0.0, GROWTH)]
    lines = [
        local_lines(np.full((1, 3), m), np.array([growth]), sizes[None], named)[0]
        for m, growth in laws
    ]
    middle = float(np.sqrt(named[0].f_z * named[-1].f_z))
    both = np.zeros((6 + NUISANCES, 6 + NUISANCES))
    for c in some:
        table = _table([c])
        force, edge = table @ sizes, table[:, 3:] @ (sizes[3:] * np.array([FRICTION, 1.0, 0.0]))
        # what each nuisance at its standard deviation adds to the three means
        nuisances = np.column_stack([
            *(CROSSTALK * force[b] * np.eye(3)[a] for a, b in permutations(range(3), 2)),
            WEAR * np.sqrt(0.5) * edge * np.log(c.f_z / middle),
            *(_table([c], *law) @ sizes - table @ line
              for law, line in zip(laws, lines, strict=True)),
        ])  # fmt: skip
        own = GAIN**2 * np.outer(force, force) + WEAR**2 / 2 * np.outer(edge, edge)
        columns = np.hstack([table, nuisances])
        both += columns.T @ np.linalg.solve(own + zero**2 * np.eye(3), columns)
    rest = slice(6, None)
    known = both[rest, rest] + np.eye(NUISANCES)
    return np.asarray(both[:6, :6] - both[:6, rest] @ np.linalg.solve(known, both[rest, :6]))


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
