"""Kienzle's k_c1.1 and m_c from cuts at several feeds.

F_t = k_c1.1 b h^(1 - m_c), h in mm.  Over an arc the chip thickness is f_z sin(phi), so that the
mean tangential force of all teeth over a revolution is
(N a_p / 2 pi) k_c1.1 integral of (f_z sin phi)^(1 - m_c) dphi, not the force at the mean thickness.
The two constants are strongly correlated: k_c1.1 is the specific force at 1 mm, far from the chip
thickness of milling.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CutConditions
from pipeline.schema.model import Parameter
from pipeline.schema.si import MM
from pipeline.submodels.cutting.regression import regression

NAMES = ("kienzle.k_c11", "kienzle.m_c")
"""Names of the two constants."""
UNITS = ("N/mm^2", "1")
"""Their units."""
NODES = 48
"""Gauss nodes over an arc."""
TYPICAL = 0.25
"""Exponent m_c of most metals [1], to which its widest interval is relative."""
LEAST_RATIO = 1.5
"""Ratio of the thickest to the thinnest chip below which the exponent is undetermined [1]."""
ITERATIONS = 30
"""Linearisations of the exponent, at most."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Kienzle:
    """Kienzle's constants of a set of cuts."""

    k_c11: float
    """[N/mm^2]."""
    m_c: float
    """[1]."""
    k_c11_interval: tuple[float, float]
    m_c_interval: tuple[float, float]
    """95 % intervals; that of k_c1.1 is not symmetric, it comes from its logarithm."""
    cuts: int
    """Number of cuts."""


def kienzle_by_force(force: Floats, each: Sequence[CutConditions], deviation: Floats) -> Kienzle:
    """Constants from the mean tangential force of all teeth over a revolution [N], one a cut.

    It is the mean torque over R, or the mean cutting power over v_c; ``deviation`` is the standard
    deviation of each, as a share [1]. ValueError when there are fewer than three cuts, a force is
    not positive, or chips are too alike.
    """
    bad = ~(np.isfinite(force) & (force > 0.0))
    if bad.any():
        raise ValueError(f"mean tangential force = {force[bad][0]} of a cut must be positive")
    feed = np.array([c.f_z for c in each])
    if len(feed) < 3 or feed.max() < LEAST_RATIO * feed.min():
        raise ValueError(
            f"{len(feed)} cuts with chips of {feed.min() / MM:.3g} to {feed.max() / MM:.3g} mm do "
            "not tell Kienzle's exponent: record 3 or more, the thickest "
            f"{LEAST_RATIO:g} times the thinnest"
        )
    arc = np.array([(c.phi_st, c.phi_ex) for c in each]).T
    width = np.array([c.flutes * c.a_p for c in each]) / MM
    readings = np.log(force * 2 * np.pi / width)  # in N/mm^2 times mm
    m_c = 0.25
    for _ in range(ITERATIONS):
        base, slope = _log_integral(feed / MM, arc[0], arc[1], m_c)
        design = np.stack([np.ones_like(feed), slope], axis=1)
        fit = regression(
            design, readings - base + slope * m_c, np.diag(deviation**2), np.ones_like(feed)
        )
        step = float(fit.values[1]) - m_c
        m_c = float(np.clip(m_c + step, -0.5, 0.95))
        if abs(step) < 1e-10:
            break
    (level, m_c), (of_level, of_m_c) = fit.values.tolist(), fit.half_width.tolist()
    return Kienzle(
        k_c11=float(np.exp(level)), m_c=m_c,
        k_c11_interval=(float(np.exp(level - of_level)), float(np.exp(level + of_level))),
        m_c_interval=(m_c - of_m_c, m_c + of_m_c), cuts=len(feed),
    )  # fmt: skip


def kienzle_parameters(constants: Kienzle, widest: float) -> dict[str, Parameter]:
    """Both constants as they are stored: value and interval, or why they are undetermined.

    A half of the interval beyond the share ``widest`` of k_c1.1, or of a typical exponent, leaves
    it undetermined.
    """
    method = f"nonlinear least squares in ln k_c1.1 and m_c on {constants.cuts} cuts"
    low, high = constants.k_c11_interval
    narrow = (
        np.sqrt(high / low) - 1 <= widest,
        np.diff(constants.m_c_interval)[0] / 2 <= widest * TYPICAL,
    )
    values = (constants.k_c11, constants.m_c)
    intervals = (constants.k_c11_interval, constants.m_c_interval)
    rows = {}
    for k, name in enumerate(NAMES):
        ends = (float(f"{intervals[k][0]:.5g}"), float(f"{intervals[k][1]:.5g}"))
        wide = f"the 95 % interval, {ends[0]:g} to {ends[1]:g}, is wider than asked"
        rows[name] = Parameter(
            value=float(f"{values[k]:.5g}") if narrow[k] else None,
            unit=UNITS[k],
            interval_95=ends if narrow[k] else None,
            determined=bool(narrow[k]),
            method=method if narrow[k] else wide,
        )
    return rows


def _log_integral(f_z: Floats, entry: Floats, leave: Floats, m_c: float) -> tuple[Floats, Floats]:
    """Log of the integral of h^(1 - m_c) over the arc, h in mm, and its slope over m_c.

    Substituting phi = (1 - cos t) / 2 of the arc removes the root singularity at a slot's ends, so
    that few Gauss nodes suffice.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    t = (nodes + 1) * np.pi / 2
    span = (leave - entry)[:, None]
    h = f_z[:, None] * np.sin(entry[:, None] + span * (1 - np.cos(t)) / 2)
    h = np.maximum(h, 1e-300)
    share = weights * np.sin(t) * h ** (1 - m_c) * span
    total = share.sum(axis=1)
    return np.log(total * np.pi / 4), -(share * np.log(h)).sum(axis=1) / total
