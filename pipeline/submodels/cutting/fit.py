"""Least-squares fit of a force waveform, and the same fit by a genetic algorithm for comparison.

Phases follow from rotating the modelled revolution against the measured one; the other unknowns by
a trust-region least-squares descent from several starts of runout and modes.  The variance of the
model error is estimated from the residuals, in alternation with the fit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from pipeline.cutting.tool import Tool
from pipeline.schema.arrays import Complexes, Floats
from pipeline.search.genetic import GeneticSettings
from pipeline.search.result import minimise
from pipeline.submodels.cutting.waveform import (
    COEFFICIENTS,
    CutHarmonics,
    Problem,
    Solved,
    Terms,
    phase_shift,
    rotated,
)

ROUNDS = 4
"""Alternations between weights and fit, at most."""
FIRST = 0.15
"""Start value of the model error, as a share of a direction's fluctuation [1]."""
RUNOUTS = (0.0, 0.3, -0.3)
"""Starts of the runout, over feed per tooth [1]."""
NATURALS = (0.18, 0.4, 0.9)
"""Starts of the natural frequencies, as shares of the highest harmonic [1]."""
HELICES_DEG = (0.0, 30.0, 45.0, -30.0)
"""Starts of an unknown helix angle [deg]; those of the wrong hand fall on its bound."""
GROWTHS = (1.5e-6, 6e-6)
"""Starts of the thickness over which an edge's force grows [m]."""
DAMPING = 0.08
"""Start of the damping ratios [1]."""
TOLERANCE = 1e-5
"""Relative change of cost or unknowns at which a descent ends [1]."""
JUMP = 0.5
"""Change of a phase beyond which another tooth has become the first [rad]."""
FEW, MANY = 12, 60
"""Evaluations of a first and of a whole descent."""
TAKEN = 2
"""First descents that are continued."""
FREE = 3
"""Mean forces beyond the coefficients that the variance of the zeros takes, at least."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """Optimum of a waveform problem."""

    problem: Problem
    """Problem with its last weights."""
    x: Floats
    """Nonlinear unknowns; shape (P,)."""
    solved: Solved
    """Coefficients and residuals there."""
    evaluations: int
    """Evaluations of the cost."""

    @property
    def values(self) -> Floats:
        """Linear unknowns, SI; shape (D,)."""
        return self.solved.values

    @property
    def unlikely(self) -> float:
        """Minus the logarithm of the likelihood, by which fits under other weights compare."""
        weights = self.problem.weights()
        return self.solved.cost - 2 * sum(float(np.log(one).sum()) for one in weights)

    @property
    def modelled(self) -> list[Complexes]:
        """Harmonics of each recording."""
        return [one @ self.values for one in self.problem.designs(self.x)]


def fit_waveform(
    tool: Tool, cuts: Sequence[CutHarmonics], terms: Terms, start: "Fit | None" = None
) -> Fit:
    """Optimum of a waveform's terms; ``start``: a fit of fewer terms or other recordings."""
    spread = np.mean([(np.abs(one.lines[1:]) ** 2).sum(axis=0) / one.harmonics for one in cuts], 0)
    problem = Problem(tool=tool, cuts=cuts, terms=terms, left_out=FIRST**2 * spread)
    places = list(_starts(problem, start))
    descents = sorted(
        (_descent(problem, place, FEW) for place in places), key=lambda place: place.solved.cost
    )
    candidates = [_reweighted_fit(place) for place in descents[:TAKEN]]
    best = min(candidates, key=lambda place: place.unlikely)
    return replace(
        best, evaluations=FEW * len(places) + sum(place.evaluations for place in candidates)
    )


def _reweighted_fit(fit: Fit) -> Fit:
    """The optimum under the weights that follow from its own residuals."""
    evaluations = 0
    for _ in range(ROUNDS):
        problem = fit.problem
        fit = _descent(problem, fit.x, MANY)
        realigned = aligned(problem, fit.x, fit.values)
        if np.abs(realigned - fit.x).max() > JUMP:  # another tooth became the first
            fit = min(_descent(problem, realigned, MANY), fit, key=lambda one: one.solved.cost)
        evaluations += fit.evaluations
        new_problem = reweighted(fit)
        fit = replace(fit, problem=new_problem, solved=new_problem.solved(fit.x))
        if np.allclose(new_problem.left_out, problem.left_out, rtol=0.05):
            break
    return replace(_descent(fit.problem, fit.x, MANY), evaluations=evaluations)


def reweighted(fit: Fit) -> Problem:
    """The same problem under the weights that follow from a fit's residuals."""
    problem = fit.problem
    pairs = list(zip(problem.cuts, fit.modelled, strict=True))
    means = np.array([(cut.lines - model)[0].real for cut, model in pairs])
    freedom = means.size - COEFFICIENTS
    scatter = float(np.mean([cut.variance[0] for cut in problem.cuts]))
    zero = max(float((means**2).sum()) / freedom - scatter, 0.0) if freedom >= FREE else 0.0
    return Problem(
        tool=problem.tool, cuts=problem.cuts, terms=problem.terms, zero=zero,
        left_out=left_out(problem, fit), _spectra=problem._spectra, _teeth=problem._teeth,
    )  # fmt: skip


def left_out(problem: Problem, fit: Fit) -> Floats:
    """Variance of the model error of each direction's harmonics [N^2]; shape (3,)."""
    pairs = list(zip(problem.cuts, fit.modelled, strict=True))
    square = sum((np.abs(cut.lines - model)[1:] ** 2).sum(axis=0) / 2 for cut, model in pairs)
    scatter = sum(cut.variance[1:].sum(axis=0) for cut in problem.cuts)
    count = sum(cut.harmonics for cut in problem.cuts)
    freedom = max(count - (len(fit.x) + problem.linear) / 6, 0.2 * count)
    return np.maximum(np.asarray(square) - scatter, 0.0) / freedom


def _starts(problem: Problem, start: Fit | None) -> Iterator[Floats]:
    """Nonlinear unknowns from which descents start."""
    if start is not None:
        earlier = dict(zip(start.problem.names, start.x.tolist(), strict=True))
        new_modes = problem.terms.modes and not start.problem.terms.modes
        grows = problem.terms.edge != "at once" and start.problem.terms.edge == "at once"
        for natural, growth in product(
            NATURALS if new_modes else (0.0,), GROWTHS if grows else GROWTHS[:1]
        ):
            x = _blank(problem, 0.0, natural or NATURALS[0], growth)
            for k, name in enumerate(problem.names):
                if not name.startswith("phase"):
                    x[k] = earlier.get(name, x[k])
            if start.problem.cuts is problem.cuts:
                x[: len(problem.cuts)] = start.x[: len(problem.cuts)]
                yield x
            else:
                yield aligned(problem, x, start.values)
        return
    runouts = RUNOUTS if problem.terms.runout and problem.tool.flutes > 1 else (0.0,)
    naturals = NATURALS if problem.terms.modes else (0.0,)
    helices = HELICES_DEG if problem.terms.helix else (None,)
    for runout, natural, helix in product(runouts, naturals, helices):
        x = _blank(problem, runout, natural)
        if helix is not None:
            x[problem.names.index("tan_helix")] = np.tan(np.radians(helix))
        x = np.clip(x, *problem.bounds)
        values = mean_force_guess(problem, x)
        x = aligned(problem, x, values)
        yield aligned(problem, x, problem.solved(x).values)


def _blank(problem: Problem, runout: float, natural: float, growth: float = GROWTHS[0]) -> Floats:
    feed = min(cut.conditions.f_z for cut in problem.cuts)
    highest = max(cut.conditions.speed * cut.harmonics for cut in problem.cuts)
    values = {
        "growth": growth, "along": runout * feed, "across": 0.5 * runout * feed,
        "tan_helix": float(np.tan(problem.tool.helix)),
        "log_natural": np.log(max(natural, 1e-3) * highest), "log_damping": np.log(DAMPING),
    }  # fmt: skip
    x = np.array([values.get(name.rstrip("0123456789"), 0.0) for name in problem.names])
    low, high = problem.bounds
    return np.clip(x, low, high)


def mean_force_guess(problem: Problem, x: Floats) -> Floats:
    """Coefficients that the mean forces give, which need no phase."""
    weights = [1 / np.sqrt(one.variance[:1]) for one in problem.cuts]
    table = problem.rows([one[:1] for one in problem.designs(x)], weights)
    measured = problem.rows([one.lines[:1] for one in problem.cuts], weights)
    prior = np.array([2e9, 2e9, 2e9, 1e5, 1e5, 1e5] + [1e3] * (problem.linear - 6))
    table = np.concatenate([table * prior, np.eye(problem.linear)])
    right = np.concatenate([measured, np.zeros(problem.linear)])
    return np.asarray(prior * np.linalg.lstsq(table, right, rcond=None)[0])


def aligned(problem: Problem, x: Floats, values: Floats) -> Floats:
    """``x`` with the phases at which coefficients ``values`` come nearest to each recording."""
    result = x.copy()
    for k, (shown, one) in enumerate(zip(problem.designs(x), problem.cuts, strict=True)):
        size = min(shown.shape[2], len(values))
        model = rotated(shown[:, :, :size] @ values[:size], -float(x[k]))
        result[k] = phase_shift(model, one.lines, problem.weights()[k])
    return result


def _descent(problem: Problem, x: Floats, evaluations: int) -> Fit:
    from scipy.optimize import least_squares

    low, high = problem.bounds
    scale = problem.scale
    cached: dict[bytes, Solved] = {}

    def solved(place: Floats) -> Solved:
        key = place.tobytes()
        if key not in cached:
            cached.clear()
            cached[key] = problem.solved(place)
        return cached[key]

    def slopes(place: Floats) -> Floats:
        here = solved(place)
        jacobian = problem.slopes(place, here.values)
        return -(jacobian - here.base @ (here.base.T @ jacobian))

    def residuals(place: Floats) -> Floats:
        return solved(place).residuals

    inner = 1e-9 * (high - low)
    solution = least_squares(
        residuals, np.clip(x, low + inner, high - inner), jac=slopes,
        bounds=(low, high), x_scale=scale, max_nfev=evaluations, xtol=TOLERANCE, ftol=TOLERANCE,
        gtol=None,
    )  # fmt: skip
    return Fit(
        problem=problem, x=solution.x, solved=solved(solution.x), evaluations=int(solution.nfev)
    )


STEPS = 3
"""Gauss-Newton steps of the phases for each individual."""
FURTHEST = 0.3
"""Greatest step of a phase [rad]."""


def genetic_fit(reference: Fit, settings: GeneticSettings) -> Fit:
    """The optimum that the genetic algorithm finds of a fit's problem, under its weights.

    Its individuals are the shape unknowns; coefficients follow by linear least squares, phases by
    rotating each modelled revolution against the measured one.
    """
    problem = reference.problem
    low, high = problem.bounds
    phases = len(problem.cuts)
    searched = len(low) - phases
    if searched == 0:
        return reference
    start = np.zeros(len(low))

    def place(individual: Floats) -> Floats:
        x = np.concatenate([start[:phases], individual])
        x = aligned(problem, x, mean_force_guess(problem, x))
        for _ in range(STEPS):
            here = problem.solved(x)
            slopes = problem.slopes(x, here.values, phases)
            slopes = slopes - here.base @ (here.base.T @ slopes)
            step = np.linalg.lstsq(slopes, here.residuals, rcond=None)[0]
            x[:phases] += np.clip(step, -FURTHEST, FURTHEST)
        return x

    def cost(individuals: Floats) -> Floats:
        return np.array([problem.solved(place(one)).cost for one in individuals])

    best = minimise(cost, low[phases:], high[phases:], settings)
    x = place(best.x)
    return Fit(problem=problem, x=x, solved=problem.solved(x), evaluations=best.evaluations)
