"""The least-squares fit of a waveform: where it starts, and where it ends.

Phases are sought by turning the modelled revolution against the measured one; the rest follows by
Levenberg and Marquardt from several starts of runout and modes.  What the model leaves out of the
harmonics is a variance that the residuals tell, in rounds.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.tool import Tool
from pipeline.identification.cutting.problem import Cut, Problem, Solved, Terms
from pipeline.identification.cutting.spectrum import COEFFICIENTS, turned

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

ROUNDS = 4
"""Of weights and fit in turn."""
FIRST = 0.15
"""Share of a direction's fluctuation that is left out, at first."""
TURNS = 720
"""Angles that are tried for a phase."""
RUNOUTS = (0.0, 0.3, -0.3)
"""Starts, over feed for each tooth."""
NATURALS = (0.18, 0.4, 0.9)
"""Starts of the modes, as shares of the highest harmonic."""
HELICES_DEG = (0.0, 30.0, 45.0, -30.0)
"""Starts of a helix that is sought; the wrong hand's fall on its bound."""
DAMPING = 0.08
TOLERANCE = 1e-5
TURNED = 0.5
"""Change of a phase that is no refinement [rad]."""
FEW, MANY = 12, 60
"""Evaluations of a first and of a whole descent."""
TAKEN = 2
"""Of the first descents, those that go on."""
FREE = 3
"""Means of forces beyond the coefficients, from which the scatter of zeros is told."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The optimum of a problem.

    Parameters
    ----------
    problem : Problem
        With its last weights.
    x : ndarray, shape (P,)
        Nonlinear unknowns.
    solved : Solved
        Coefficients and residuals there.
    evaluations : int
        Of the cost.
    """

    problem: Problem
    x: Floats
    solved: Solved
    evaluations: int

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


def fitted(tool: Tool, cuts: Sequence[Cut], terms: Terms, begin: "Fit | None" = None) -> Fit:
    """The optimum of a waveform's terms.

    Parameters
    ----------
    tool : Tool
        That cut.
    cuts : sequence of Cut
        The recordings.
    terms : Terms
        Of the model.
    begin : Fit, optional
        Of fewer terms or other recordings, to begin at.
    """
    problem = Problem(tool=tool, cuts=cuts, terms=terms, left_out=_first(cuts))
    starts = list(_starts(problem, begin))
    first = sorted((_down(problem, one, FEW) for one in starts), key=lambda one: one.solved.cost)
    ended = [_settled(one) for one in first[:TAKEN]]
    best = min(ended, key=lambda one: one.unlikely)
    return replace(best, evaluations=FEW * len(starts) + sum(one.evaluations for one in ended))


def _settled(found: Fit) -> Fit:
    """The optimum under the weights that its own residuals ask for."""
    evaluations = 0
    for _ in range(ROUNDS):
        problem = found.problem
        found = _down(problem, found.x, MANY)
        again = phased(problem, found.x, found.values)
        if np.abs(again - found.x).max() > TURNED:  # another tooth is the first
            found = min(_down(problem, again, MANY), found, key=lambda one: one.solved.cost)
        evaluations += found.evaluations
        told = weighted(found)
        found = replace(found, problem=told, solved=told.solved(found.x))
        if np.allclose(told.left_out, problem.left_out, rtol=0.05):
            break
    return replace(_down(found.problem, found.x, MANY), evaluations=evaluations)


def weighted(found: Fit) -> Problem:
    """The same problem under the weights that the residuals of a fit ask for."""
    problem = found.problem
    pairs = list(zip(problem.cuts, found.modelled, strict=True))
    means = np.array([(cut.lines - model)[0].real for cut, model in pairs])
    free = means.size - COEFFICIENTS
    scatter = float(np.mean([cut.variance[0] for cut in problem.cuts]))
    zero = max(float((means**2).sum()) / free - scatter, 0.0) if free >= FREE else 0.0
    return Problem(
        tool=problem.tool, cuts=problem.cuts, terms=problem.terms, zero=zero,
        left_out=left_out(problem, found), _spectra=problem._spectra, _teeth=problem._teeth,
    )  # fmt: skip


def left_out(problem: Problem, found: Fit) -> Floats:
    """Variance of what the model leaves out of each direction's harmonics [N^2]; shape (3,)."""
    pairs = list(zip(problem.cuts, found.modelled, strict=True))
    square = sum((np.abs(cut.lines - model)[1:] ** 2).sum(axis=0) / 2 for cut, model in pairs)
    scatter = sum(cut.variance[1:].sum(axis=0) for cut in problem.cuts)
    count = sum(cut.harmonics for cut in problem.cuts)
    freedom = max(count - (len(found.x) + problem.linear) / 6, 0.2 * count)
    return np.maximum(np.asarray(square) - scatter, 0.0) / freedom


def _first(cuts: Sequence[Cut]) -> Floats:
    spread = np.mean([(np.abs(one.lines[1:]) ** 2).sum(axis=0) / one.harmonics for one in cuts], 0)
    return np.asarray(FIRST**2 * spread)


def _starts(problem: Problem, begin: Fit | None) -> Iterator[Floats]:
    """Places to begin the descent at."""
    if begin is not None:
        known = dict(zip(begin.problem.names, begin.x.tolist(), strict=True))
        for natural in NATURALS if problem.terms.modes and not begin.problem.terms.modes else (0,):
            x = _blank(problem, 0.0, natural or NATURALS[0])
            for k, name in enumerate(problem.names):
                if not name.startswith("phase"):
                    x[k] = known.get(name, x[k])
            if begin.problem.cuts is problem.cuts:
                x[: len(problem.cuts)] = begin.x[: len(problem.cuts)]
                yield x
            else:
                yield phased(problem, x, begin.values)
        return
    runouts = RUNOUTS if problem.terms.runout and problem.tool.flutes > 1 else (0.0,)
    naturals = NATURALS if problem.terms.modes else (0.0,)
    helices = HELICES_DEG if problem.terms.helix else (None,)
    for runout, natural, helix in product(runouts, naturals, helices):
        x = _blank(problem, runout, natural)
        if helix is not None:
            x[problem.names.index("tan_helix")] = np.tan(np.radians(helix))
        x = np.clip(x, *problem.bounds)
        values = guessed(problem, x)
        x = phased(problem, x, values)
        yield phased(problem, x, problem.solved(x).values)


def _blank(problem: Problem, runout: float, natural: float) -> Floats:
    feed = min(cut.conditions.f_z for cut in problem.cuts)
    highest = max(cut.conditions.speed * cut.harmonics for cut in problem.cuts)
    begin = {
        "along": runout * feed, "across": 0.5 * runout * feed,
        "tan_helix": float(np.tan(problem.tool.helix)),
        "log_natural": np.log(max(natural, 1e-3) * highest), "log_damping": np.log(DAMPING),
    }  # fmt: skip
    x = np.array([begin.get(name.rstrip("0123456789"), 0.0) for name in problem.names])
    low, high = problem.bounds
    return np.clip(x, low, high)


def guessed(problem: Problem, x: Floats) -> Floats:
    """Coefficients that the mean forces give, which need no phase."""
    weights = [1 / np.sqrt(one.variance[:1]) for one in problem.cuts]
    table = problem.rows([one[:1] for one in problem.designs(x)], weights)
    measured = problem.rows([one.lines[:1] for one in problem.cuts], weights)
    prior = np.array([2e9, 2e9, 2e9, 1e5, 1e5, 1e5] + [1e3] * (problem.linear - 6))
    table = np.concatenate([table * prior, np.eye(problem.linear)])
    right = np.concatenate([measured, np.zeros(problem.linear)])
    return np.asarray(prior * np.linalg.lstsq(table, right, rcond=None)[0])


def phased(problem: Problem, x: Floats, values: Floats) -> Floats:
    """``x`` with the phases at which coefficients ``values`` come nearest to each recording."""
    found = x.copy()
    for k, (shown, one) in enumerate(zip(problem.designs(x), problem.cuts, strict=True)):
        size = min(shown.shape[2], len(values))
        model = turned(shown[:, :, :size] @ values[:size], -float(x[k]))
        found[k] = phase_of(model, one.lines, problem.weights()[k])
    return found


def phase_of(model: Complexes, lines: Complexes, weight: Floats) -> float:
    """Phase [rad] by which ``model`` must be turned to come nearest to ``lines``."""
    product_ = ((weight**2) * np.conj(model) * lines).sum(axis=1)
    many = min(len(product_), TURNS // 2)
    padded = np.zeros(TURNS, dtype=np.complex128)
    padded[:many] = product_[:many]
    # sum of Re(p_h exp(-i h phase)) over a grid of phases
    likeness = np.real(np.fft.fft(padded))
    best = 2 * np.pi * float(np.argmax(likeness)) / TURNS
    order = np.arange(many)
    for _ in range(4):
        wheel = padded[:many] * np.exp(-1j * order * best)
        slope, bend = (order * wheel.imag).sum(), -((order**2) * wheel.real).sum()
        if bend >= 0:
            break
        best -= float(np.clip(slope / bend, -np.pi / TURNS, np.pi / TURNS))
    return best


def _down(problem: Problem, x: Floats, most: int) -> Fit:
    """The optimum that the descent from ``x`` reaches."""
    from scipy.optimize import least_squares

    low, high = problem.bounds
    scale = problem.scale
    held: dict[bytes, Solved] = {}

    def solved(at: Floats) -> Solved:
        key = at.tobytes()
        if key not in held:
            held.clear()
            held[key] = problem.solved(at)
        return held[key]

    def slopes(at: Floats) -> Floats:
        here = solved(at)
        out = problem.slopes(at, here.values)
        return -(out - here.base @ (here.base.T @ out))

    def residuals(at: Floats) -> Floats:
        return solved(at).residuals

    inner = 1e-9 * (high - low)
    ended = least_squares(
        residuals, np.clip(x, low + inner, high - inner), jac=slopes,
        bounds=(low, high), x_scale=scale, max_nfev=most, xtol=TOLERANCE, ftol=TOLERANCE,
        gtol=None,
    )  # fmt: skip
    return Fit(problem=problem, x=ended.x, solved=solved(ended.x), evaluations=int(ended.nfev))
