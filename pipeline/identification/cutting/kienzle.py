"""Kienzle's k_c1.1 and m_c from cuts at several feeds.

F_t = k_c1.1 b h^(1 - m_c), h in mm.  Over an arc the thickness of the chip is f_z sin(phi), so that
the mean tangential force of all teeth over a revolution is
(N a_p / 2 pi) k_c1.1 integral of (f_z sin phi)^(1 - m_c) dphi, not the law at the mean thickness.
Both constants come together, strongly correlated: k_c1.1 is the law at 1 mm, far from the chips of
milling.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.identification.cutting.spindle_power_regression import Regression, regression

Floats = NDArray[np.float64]

NAMES = ("kienzle.k_c11", "kienzle.m_c")
MM = 1e-3
N_MM2 = 1e6
NODES = 48
TYPICAL = 0.25
"""Exponent m_c of most metals, of which a share is the widest interval."""
LEAST_RATIO = 1.5
"""Of the thickest to the thinnest chip, below which the exponent is not told."""
TURNS = 30


@dataclass(frozen=True, kw_only=True, eq=False)
class Kienzle:
    """Constants that cuts gave.

    Parameters
    ----------
    k_c11 : float
        [N/mm^2].
    m_c : float
        [1].
    k_c11_interval, m_c_interval : tuple of float
        95 % intervals; that of k_c1.1 is not symmetric, it comes from its logarithm.
    correlation : float
        Of ln k_c1.1 and m_c.
    scatter : float
        Of a cut's force about the law, as a share [1].
    cuts : int
        How many there were.
    """

    k_c11: float
    m_c: float
    k_c11_interval: tuple[float, float]
    m_c_interval: tuple[float, float]
    correlation: float
    scatter: float
    cuts: int


def kienzle_by_thickness(h: ArrayLike, k_c: ArrayLike, known: ArrayLike = 0.0) -> Kienzle:
    """Constants from specific forces, one a cut: ln k_c = ln k_c1.1 - m_c ln h.

    Parameters
    ----------
    h : array_like, shape (L,)
        Thickness of the chip [m].
    k_c : array_like, shape (L,)
        Tangential force over the chip's section [N/m^2].
    known : array_like, shape (L,) or ()
        Known standard deviation of each, as a share [1].

    Raises
    ------
    ValueError
        When there are fewer than three cuts, a value is not positive, or chips are too alike.
    """
    thickness, specific = _cuts(h, k_c, known, "specific force")
    design = np.stack([np.ones_like(thickness), -np.log(thickness / MM)], axis=1)
    return _kienzle(_fit(design, np.log(specific / N_MM2), known))


def kienzle_by_force(
    force: ArrayLike, *, flutes: ArrayLike, f_z: ArrayLike, a_p: ArrayLike, phi_st: ArrayLike,
    phi_ex: ArrayLike, known: ArrayLike = 0.0,
) -> Kienzle:  # fmt: skip
    """Constants from the mean tangential force of all teeth over a revolution, one a cut.

    Parameters
    ----------
    force : array_like, shape (L,)
        [N]; the mean torque over R, or the mean cutting power over v_c.
    flutes : array_like
        Number of teeth.
    f_z, a_p : array_like
        Feed for each tooth, axial depth [m].
    phi_st, phi_ex : array_like
        Where teeth enter and leave [rad].
    known : array_like, shape (L,) or ()
        Known standard deviation of each, as a share [1].

    Raises
    ------
    ValueError
        As :func:`kienzle_by_thickness`.
    """
    feed, mean = _cuts(f_z, force, known, "mean tangential force")
    arc = [np.broadcast_to(np.asarray(v, dtype=np.float64), feed.shape) for v in (phi_st, phi_ex)]
    if np.any(arc[1] <= arc[0]):
        raise ValueError("phi_ex must be greater than phi_st: teeth leave after they enter")
    width = np.broadcast_to(np.asarray(flutes) * np.asarray(a_p), feed.shape) / MM
    readings = np.log(mean * 2 * np.pi / width)  # in N/mm^2 times mm
    m_c = 0.25
    for _ in range(TURNS):
        level, slope = _log_integral(feed / MM, arc[0], arc[1], m_c)
        design = np.stack([np.ones_like(feed), slope], axis=1)
        fit = _fit(design, readings - level + slope * m_c, known)
        step = float(fit.values[1]) - m_c
        m_c = float(np.clip(m_c + step, -0.5, 0.95))
        if abs(step) < 1e-10:
            break
    return _kienzle(fit)


def kienzle_document(found: Kienzle, widest: float) -> dict[str, Any]:
    """Both constants as they are stored: value and interval, or why they are not determined.

    Parameters
    ----------
    found : Kienzle
        What cuts gave.
    widest : float
        Half of a 95 % interval wider than this share of k_c1.1, or of a typical exponent, is no
        determination.
    """
    how = f"nonlinear least squares in ln k_c1.1 and m_c on {found.cuts} cuts"
    low, high = found.k_c11_interval
    sure = (
        np.sqrt(high / low) - 1 <= widest,
        np.diff(found.m_c_interval)[0] / 2 <= widest * TYPICAL,
    )
    rows = ((found.k_c11, found.k_c11_interval, "N/mm^2"), (found.m_c, found.m_c_interval, "1"))
    document = {}
    for name, (value, interval, unit), told in zip(NAMES, rows, sure, strict=True):
        ends = [float(f"{end:.5g}") for end in interval]
        why = "" if told else f"the 95 % interval, {ends[0]:g} to {ends[1]:g}, is wider than asked"
        document[name] = {
            "value": float(f"{value:.5g}") if told else None,
            "unit": unit,
            "interval_95": ends if told else None,
            "determined": bool(told),
            "reason": why,
            "how": how,
        }
    return document


def _log_integral(f_z: Floats, entry: Floats, leave: Floats, m_c: float) -> tuple[Floats, Floats]:
    """Log of the integral of h^(1 - m_c) over the arc, h in mm, and its slope over m_c.

    Substituting phi = (1 - cos t) / 2 of the arc takes the root at a slot's ends away, so that a
    few Gauss nodes do.
    """
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    t = (nodes + 1) * np.pi / 2
    span = (leave - entry)[:, None]
    h = f_z[:, None] * np.sin(entry[:, None] + span * (1 - np.cos(t)) / 2)
    h = np.maximum(h, 1e-300)
    share = weights * np.sin(t) * h ** (1 - m_c) * span
    total = share.sum(axis=1)
    return np.log(total * np.pi / 4), -(share * np.log(h)).sum(axis=1) / total


def _cuts(
    thickness: ArrayLike, force: ArrayLike, known: ArrayLike, what: str
) -> tuple[Floats, Floats]:
    h, F = (np.atleast_1d(np.asarray(v, dtype=np.float64)) for v in (thickness, force))
    for name, values in (("thickness of the chip", h), (what, F)):
        bad = ~(np.isfinite(values) & (values > 0.0))
        if bad.any():
            raise ValueError(f"{name} = {values[bad][0]} of a cut must be positive")
    if np.any(~(np.asarray(known) >= 0.0)):
        raise ValueError(f"known = {np.min(np.asarray(known))} of a cut must be 0 or more")
    if len(h) != len(F):
        raise ValueError(f"{len(h)} feeds and {len(F)} forces: each cut has one of both")
    if len(h) < 3 or h.max() < LEAST_RATIO * h.min():
        raise ValueError(
            f"{len(h)} cuts with chips of {h.min() / MM:.3g} to {h.max() / MM:.3g} mm do not tell "
            f"Kienzle's exponent: record 3 or more, the thickest {LEAST_RATIO:g} times the thinnest"
        )
    return h, F


def _fit(design: Floats, readings: Floats, known: ArrayLike) -> Regression:
    deviation = np.broadcast_to(np.asarray(known, dtype=np.float64), readings.shape)
    return regression(design, readings, np.diag(deviation**2), np.ones_like(readings))


def _kienzle(fit: Regression) -> Kienzle:
    value, half = fit.values, fit.half_width
    return Kienzle(
        k_c11=float(np.exp(value[0])),
        m_c=float(value[1]),
        k_c11_interval=(float(np.exp(value[0] - half[0])), float(np.exp(value[0] + half[0]))),
        m_c_interval=(float(value[1] - half[1]), float(value[1] + half[1])),
        correlation=float(fit.correlation[0, 1]),
        scatter=fit.share,
        cuts=fit.freedom + len(value),
    )
