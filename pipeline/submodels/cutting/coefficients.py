"""Cutting coefficients of a waveform fit and of mean forces, with intervals.

Mean forces over a revolution are linear in the six coefficients (Altintas, *Manufacturing
Automation*, 2nd ed. 2012, section 2.8.1), and neither helix nor modes change them; nor does runout
as long as every tooth has a chip.  Each mean is weighted by its scatter over the revolutions and by
the zero of its recording.

A slice of a tooth gives F_x = -F_t cos(phi) - F_r sin(phi) and F_y = F_t sin(phi) - F_r cos(phi).
The mean tangential force is thus not in the means alone: it depends on the distribution of the
force over the arc.  That is taken from the linear-edge model of the mean forces, and scaled so that
the modelled mean of F_y, which F_t carries, is the measured one.

Kienzle's k_c1.1 and m_c come from cuts at several feeds, F_t = k_c1.1 b h^(1 - m_c), h in mm.  Over
an arc the chip thickness is f_z sin(phi), so that the mean tangential force of all teeth over a
revolution is (N a_p / 2 pi) k_c1.1 integral of (f_z sin phi)^(1 - m_c) dphi, not the force at the
mean thickness.  The two constants are strongly correlated: k_c1.1 is the specific force at 1 mm,
far from the chip thickness of milling.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.cutting.force.force_law import COEFFICIENTS, N_MM, N_MM2, feeds, regressors
from pipeline.schema.arrays import Floats
from pipeline.schema.cutting import CutConditions
from pipeline.schema.model import Parameter
from pipeline.schema.si import DEGREE, MM
from pipeline.submodels.cutting.fit import Fit
from pipeline.submodels.cutting.law_draws import KnownShape, coefficient_draws, law_draws
from pipeline.submodels.cutting.regression import Estimate, digits, regression, undetermined
from pipeline.submodels.cutting.runout import RoundedFit, runout
from pipeline.submodels.cutting.selection import FitUncertainty
from pipeline.submodels.cutting.waveform import PRIOR, CutHarmonics
from pipeline.submodels.statistics import NORMAL_95

KIENZLE = {"kienzle.k_c11": "N/mm^2", "kienzle.m_c": "1"}
"""Kienzle's two constants with their units."""
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
    (low, high), (least, most) = constants.k_c11_interval, constants.m_c_interval
    cases = (
        (constants.k_c11, (low, high), np.sqrt(high / low) - 1 <= widest),
        (constants.m_c, (least, most), (most - least) / 2 <= widest * TYPICAL),
    )
    rows = {}
    for (name, unit), (value, interval, narrow) in zip(KIENZLE.items(), cases, strict=True):
        ends = (digits(interval[0]), digits(interval[1]))
        if narrow:
            method = f"nonlinear least squares in ln k_c1.1 and m_c on {constants.cuts} cuts"
            rows[name] = Parameter(
                value=digits(value), unit=unit, interval_95=ends, determined=True, method=method
            )
        else:
            wide = f"the 95 % interval, {ends[0]:g} to {ends[1]:g}, is wider than asked"
            rows[name] = undetermined(unit, wide)
    return rows


def kienzle(cuts: Sequence[CutHarmonics], widest: float) -> dict[str, Parameter]:
    """Kienzle's constants from the mean tangential forces of three feeds or more."""
    force, share = mean_tangential(cuts)
    try:
        constants = kienzle_by_force(force, [cut.conditions for cut in cuts], share)
    except ValueError as error:
        why, _, remedy = str(error).partition(": ")
        return {name: undetermined(unit, why, remedy) for name, unit in KIENZLE.items()}
    return kienzle_parameters(constants, widest)


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


UNITS = ("N/mm^2", "N/mm^2", "N/mm^2", "N/mm", "N/mm", "N/mm")
"""Units of the six coefficients as they are stored."""
SCALES = (N_MM2, N_MM2, N_MM2, N_MM, N_MM, N_MM)
"""SI value of one such unit."""
BESIDE = 0.1
"""Least size of a coefficient in the test of its interval, over the tangential one [1]."""
NORMAL_90 = 1.645
"""Half of a 90 % interval of a normal distribution over its standard deviation [1]."""
HELIX_DEG = 10.0
"""Half interval of a determined helix angle, at most [deg]."""
HARMONICS = "weighted least squares on the harmonics of the revolution"
WAVEFORM = (
    f"{HARMONICS}, of several feeds with an edge force that grows with the chip and a size effect"
)


def parameters(
    fit: Fit, uncertainty: FitUncertainty, not_sharp: RoundedFit, widest: float,
    means: Sequence[Estimate],
) -> list[Estimate]:  # fmt: skip
    """Coefficients, runout and helix of a fit.

    Of several feeds coefficients are those of the straight line over the named feeds to the law of
    the fit whose edges are not sharp: the straight line of a sharp fit takes a part of a bend for
    runout.  What zeros, wear, gain and the law of the chip leave open of the mean forces is left
    open of the coefficients: their intervals hold the draws of :mod:`.law_draws`.  A coefficient
    that only the mean forces determine is taken from them.  Through the means of two feeds any line
    passes and nothing says which is right: the intervals then hold those of the mean forces.
    """
    each = [cut.conditions for cut in fit.problem.cuts]
    values, law = fit.values[:6], np.full(6, np.inf)
    if feeds(each) > 1:
        draws = law_draws(fit.problem.cuts, not_sharp.line, not_sharp.shape)
        drawn = coefficient_draws(draws, each)
        values = not_sharp.coefficients
        law = half_of_draws(drawn, values)
    if feeds(each) == 2:
        law = np.maximum(law, _reach(means, values))
    rows = coefficients(
        values, law, float(np.mean([one.f_z for one in each])), widest,
        WAVEFORM,
    )  # fmt: skip
    better = [
        mean if mean.determined and not one.determined else one
        for one, mean in zip(rows, means, strict=True)
    ]
    return [*better, *runout(fit, uncertainty, not_sharp, widest), _helix(fit, uncertainty)]


def _reach(means: Sequence[Estimate], values: Floats) -> Floats:
    """Half intervals about ``values`` that hold those of the mean forces; shape (6,)."""
    return np.array([
        abs(one.value * scale - value) + one.half_width * scale if one.determined else 0.0
        for one, value, scale in zip(means, values, SCALES, strict=True)
    ])  # fmt: skip


def coefficients(
    values: Floats, half: Floats, f_z: float, widest: float, method: str
) -> list[Estimate]:
    """The six coefficients of the linear-edge model.

    ``values`` and ``half`` of their 95 % intervals are in N/m^2 and N/m, shape (6,), the mean feed
    per tooth ``f_z`` in m.  A half beyond the share ``widest`` of its value leaves it undetermined.
    """
    edge = max(abs(values[3]), abs(values[0]) * f_z)
    least = BESIDE * np.array([abs(values[0])] * 3 + [edge] * 3)
    return [
        Estimate(
            name=name, unit=UNITS[k], value=values[k] / SCALES[k],
            determined=bool(half[k] <= widest * max(abs(values[k]), least[k])),
            half_width=half[k] / SCALES[k], method=method,
            reason=f"its 95 % interval is {half[k] / SCALES[k]:.3g} {UNITS[k]} to both sides",
            remedy="record cuts of the same tool at three feeds or more",
        )
        for k, name in enumerate(COEFFICIENTS)
    ]  # fmt: skip


def _helix(fit: Fit, uncertainty: FitUncertainty) -> Estimate:
    helix = fit.problem.geometry(fit.x).helix
    half = uncertainty.half_width({"tan_helix": 1.0}) * np.cos(helix) ** 2 / DEGREE
    fitted = fit.problem.terms.helix
    return Estimate(
        name="helix", unit="deg", value=helix / DEGREE, half_width=half if fitted else 0.0,
        determined=bool(fitted and half <= HELIX_DEG), method=HARMONICS if fitted else "given",
        reason="its 95 % interval is wider than 10 deg" if fitted
        else f"{helix / DEGREE:g} deg was taken: the records do not tell another",
        remedy="record a deeper cut, in which the edge lags further" if fitted else "",
    )  # fmt: skip


def modes(fit: Fit, uncertainty: FitUncertainty, widest: float) -> dict[int, list[Estimate]]:
    """Natural frequency and damping of the channels that show feed (0), normal (1), axis (2)."""
    channel_modes = fit.problem.modes(fit.x)
    if channel_modes is None:
        return {}
    natural, damping = channel_modes
    highest = max(cut.conditions.speed * cut.harmonics for cut in fit.problem.cuts)
    names = (
        ("natural_frequency_Hz", "Hz", "natural", natural),
        ("damping", "1", "damping", damping),
    )
    return {
        k: [
            Estimate(
                name=name, unit=unit, value=float(values[k]), lowest=0.0,
                half_width=half * float(values[k]), method=HARMONICS,
                determined=bool(half <= widest and natural[k] <= highest),
                reason=f"the channel shows no mode of its own below {highest:.0f} Hz",
            )
            for name, unit, what, values in names
            for half in [uncertainty.half_width({f"log_{what}{k}": 1.0})]
        ]
        for k in range(3)
    }  # fmt: skip


HOW = "linear regression of the mean forces"


def mean_regression(
    cuts: Sequence[CutHarmonics], widest: float, fit: Fit | None = None,
    shape: KnownShape | None = None,
) -> tuple[Floats, list[Estimate]]:  # fmt: skip
    """Coefficients from the mean forces of recordings [N/m^2], [N/m], and each as a parameter.

    The effect of teeth without a chip on the means, by the waveforms of ``fit``, widens the
    intervals; ``shape`` is that of the law of the chip, which mean forces hardly tell.
    """
    values = linear_means(cuts)
    each = [one.conditions for one in cuts]
    f_z = float(np.mean([one.f_z for one in each]))
    if feeds(each) < 2:
        return values, coefficients(values, np.full(6, np.inf), f_z, widest, HOW)
    drawn = coefficient_draws(law_draws(cuts, shape=shape), each)
    named = np.median(drawn, axis=0)
    half = half_of_draws(drawn, named)
    if fit is not None:
        table, _, deviation = _means(cuts)
        modelled = np.concatenate([one[0].real for one in fit.modelled])
        half = np.hypot(half, _solved(table, modelled, deviation) - fit.values[:6])
    return values, coefficients(named, half, f_z, widest, HOW)


def half_of_draws(drawn: Floats, values: Floats) -> Floats:
    """Half of the 95 % interval about ``values`` that holds draws of shape (D, 6); shape (6,)."""
    return np.asarray(np.quantile(np.abs(drawn - values), 0.95, axis=0))


def linear_means(cuts: Sequence[CutHarmonics]) -> Floats:
    """The six coefficients by the mean forces [N/m^2], [N/m]; shape (6,)."""
    return _solved(*_means(cuts))


def _means(cuts: Sequence[CutHarmonics]) -> tuple[Floats, Floats, Floats]:
    """Design matrix, means of the forces [N] and their standard deviations; 3 R rows."""
    each = [one.conditions for one in cuts]
    table = regressors(
        flutes=[c.flutes for c in each], f_z=[c.f_z for c in each], a_p=[c.a_p for c in each],
        phi_st=[c.phi_st for c in each], phi_ex=[c.phi_ex for c in each],
    ).reshape(-1, 6)  # fmt: skip
    measured = np.concatenate([one.lines[0].real for one in cuts])
    return table, measured, np.sqrt(np.concatenate([one.variance[0] for one in cuts]))


def _solved(table: Floats, measured: Floats, deviation: Floats) -> Floats:
    """Weighted least squares with the prior; shape (6,)."""
    scaled = np.concatenate([table / deviation[:, None], np.diag(1 / np.array(PRIOR))])
    length = np.linalg.norm(scaled, axis=0)
    right = np.concatenate([measured / deviation, np.zeros(6)])
    return np.asarray(np.linalg.lstsq(scaled / length, right, rcond=1e-14)[0] / length)


def mean_tangential(
    cuts: Sequence[CutHarmonics], values: Floats | None = None
) -> tuple[Floats, Floats]:
    """Mean tangential force of all teeth [N], and its relative standard deviation; (R,) each.

    ``values`` are the coefficients by which the force is distributed over the arc; those of
    ``cuts`` by default.
    """
    values = linear_means(cuts) if values is None else values
    force, share = [], []
    for one in cuts:
        c = one.conditions
        table = regressors(flutes=c.flutes, f_z=c.f_z, a_p=c.a_p, phi_st=c.phi_st, phi_ex=c.phi_ex)
        carried = float(table[1, [0, 3]] @ values[[0, 3]])
        other = float(table[1, [1, 4]] @ values[[1, 4]])
        measured = float(one.lines[0, 1].real) - other
        tangential = float(_tangential(c) @ values[[0, 3]])
        force.append(tangential * measured / carried if carried > 0 else np.nan)
        share.append(float(np.sqrt(one.variance[0, 1])) / max(abs(measured), 1e-9))
    return np.array(force), np.array(share)


def _tangential(c: CutConditions) -> Floats:
    """Mean tangential force of all teeth over a revolution, for K_tc [m^2] and K_te [m].

    N a_p / (2 pi) (K_tc f_z (cos phi_st - cos phi_ex) + K_te (phi_ex - phi_st)).
    """
    parts = np.array([c.f_z * (np.cos(c.phi_st) - np.cos(c.phi_ex)), c.phi_ex - c.phi_st])
    return np.asarray(c.flutes * c.a_p / (2 * np.pi) * parts)


def tangential_by_load(
    by_load: Mapping[str, Parameter], conditions: CutConditions
) -> tuple[float, float] | None:
    """Mean tangential force by K_tc and K_te of the spindle's load, half of its 90 % interval [N].

    Nothing of the dynamometer is in it.  None where the load did not determine both.
    """
    force = variance = 0.0
    sizes = (_tangential(conditions) * [N_MM2, N_MM]).tolist()
    for name, size in zip(("K_tc", "K_te"), sizes, strict=True):
        one = by_load.get(name)
        if one is None or one.value is None or one.interval_95 is None:
            return None
        force += size * one.value
        half = (one.interval_95[1] - one.interval_95[0]) / 2
        variance += (size * half / NORMAL_95) ** 2
    return force, NORMAL_90 * float(np.sqrt(variance))
