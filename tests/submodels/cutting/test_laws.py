"""Laws of the chip and Kienzle's constants: closed forms, and intervals that hold the truth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import quad
from scipy.stats import multivariate_normal

from pipeline.cutting.force.force_law import ForceLaw, design, local_lines, regressors
from pipeline.schema.cutting import ChipLaw, CutConditions
from pipeline.submodels.cutting.coefficients import (
    Kienzle,
    kienzle_by_force,
    kienzle_parameters,
    mean_regression,
)
from pipeline.submodels.cutting.law_draws import (
    EXPONENTS,
    KnownShape,
    coefficient_draws,
    law_draws,
    named_range,
)
from pipeline.submodels.cutting.recordings import cut_harmonics
from pipeline.submodels.cutting.selection import fitted_line
from pipeline.submodels.cutting.spread import (
    calibrated,
    force_levels,
    half_widths,
    magnitude,
)
from pipeline.submodels.cutting.waveform import STRAIGHT, ChipShape, CutHarmonics
from tests.cutting.closed_forms import edge_forces
from tests.submodels.cutting.recorded import SETTINGS, Truth, identified, recordings

SLOT = CutConditions(speed=100.0, f_z=1e-4, a_p=2e-3, phi_st=0.0, phi_ex=np.pi, flutes=3)
SIZE = ChipLaw(
    cutting=(9e8, 3e8, 1.5e8), exponent=(0.2,) * 3, edge=(2e4, 2e4, 4e3),
    growth=6e-6,
)  # fmt: skip


def means_of(law, feeds, conditions=SLOT):
    """Mean forces of cuts by a law, without scatter."""
    values = np.array([*law.cutting, *law.edge])
    cuts = []
    for f_z in feeds:
        c = replace(conditions, f_z=f_z)
        lines = np.zeros((2, 3), dtype=complex)
        lines[0] = design(c, law.exponent, law.growth) @ values
        cuts.append(CutHarmonics(conditions=c, lines=lines, variance=np.full((2, 3), 0.01)))
    return cuts


@pytest.mark.parametrize("arc", [(0.0, np.pi), (0.0, 1.2), (2.0, np.pi)])
def test_a_straight_line_has_the_means_of_the_closed_form(arc):
    """Gauss quadrature of the arc against Altintas' integrals."""
    c = replace(SLOT, phi_st=arc[0], phi_ex=arc[1])
    closed = regressors(flutes=3, f_z=c.f_z, a_p=c.a_p, phi_st=c.phi_st, phi_ex=c.phi_ex)
    assert design(c, (0.0,) * 3, 0.0) == pytest.approx(closed, rel=1e-9, abs=1e-16)


def line_of(law, conditions):
    """Straight line of one law over the chips of cuts; shape (6,)."""
    values = np.array([(*law.cutting, *law.edge)])
    one = np.array([law.exponent]), np.array([law.growth])
    return local_lines(*one, values, conditions)[0]


def test_the_line_of_a_slot_has_its_mean_forces():
    """What is left of a law beside its line is orthogonal to 1 and sin(phi)."""
    law = design(SLOT, SIZE.exponent, SIZE.growth) @ [*SIZE.cutting, *SIZE.edge]
    line = design(SLOT, (0.0,) * 3, 0.0) @ line_of(SIZE, [SLOT])
    assert line == pytest.approx(law, rel=1e-6)


def test_two_feeds_leave_every_law_and_five_do_not():
    two, five = (law_draws(means_of(SIZE, f)) for f in ((5e-5, 1e-4), np.geomspace(1e-5, 2e-4, 5)))
    straight = [((d.exponent[:, 0] == 0) & (d.growth == 0)).mean() for d in (two, five)]
    assert straight[0] > 0.02  # one of sixteen, less those that others beat by a positive edge
    assert straight[1] < straight[0]  # a straight line bends away from its means
    assert np.ptp(two.exponent[:, 0]) == pytest.approx(0.3)


def test_draws_plough_and_repeat():
    cuts = means_of(SIZE, (5e-5, 1e-4))
    draws = law_draws(cuts)
    assert (draws.values[:, [0, 3, 4]] >= 0).all()
    assert (draws.values == law_draws(cuts).values).all()
    assert len(draws.laws(16)) == 16


def test_laws_agree_where_they_were_fitted_and_part_beyond():
    draws = law_draws(means_of(SIZE, (5e-5, 1e-4)))

    def share(f_z):
        means = design(replace(SLOT, f_z=f_z), (0.0,) * 3, 0.0)
        lines = local_lines(draws.exponent, draws.growth, draws.values, [replace(SLOT, f_z=f_z)])
        force = (lines @ means.T)[:, 1]
        return force.std() / force.mean()

    assert share(2.5e-4) > share(7.5e-5) and share(1e-5) > 2 * share(7.5e-5)


@pytest.mark.parametrize("feeds", [(5e-5, 1e-4), (3e-5, 6e-5)])
def test_the_line_of_two_feeds_holds_that_of_five(feeds):
    """The straight line through five feeds that reach further lies in the interval of two."""
    found = mean_regression(means_of(SIZE, feeds), 0.5)[1]
    wide = np.linspace(feeds[0] / 1.6, feeds[1] * 1.6, 5)
    true = mean_regression(means_of(SIZE, wide), 0.5)[1]
    for one, other in zip(found, true, strict=True):
        assert abs(one.value - other.value) <= one.half_width, one.name


def test_coefficients_are_named_over_a_ratio_of_five():
    feeds = [c.f_z for c in named_range([SLOT, replace(SLOT, f_z=5e-5)])]
    assert max(feeds) / min(feeds) == pytest.approx(5.0)
    assert max(feeds) * min(feeds) == pytest.approx(5e-9)  # about those recorded
    wide = [c.f_z for c in named_range([SLOT, replace(SLOT, f_z=1e-5)])]
    assert (min(wide), max(wide)) == pytest.approx((1e-5, 1e-4))  # ratio ten: as recorded


def test_one_feed_has_no_line():
    cuts = means_of(SIZE, (1e-4,))
    assert not any(one.determined for one in mean_regression(cuts, 0.5)[1])
    draws = law_draws(cuts)
    assert (draws.values[:, 3:] == 0).all()
    twice = [
        local_lines(draws.exponent, draws.growth, draws.values, [replace(SLOT, f_z=f)])
        @ [*(design(replace(SLOT, f_z=f), (0.0,) * 3, 0.0)[1])]
        for f in (1e-4, 2e-4)
    ]
    growth = twice[1] / twice[0]
    assert growth.max() == pytest.approx(2.0, rel=0.02) and 1.2 < growth.min() < 1.6


def test_wear_between_two_cuts_lies_in_the_interval():
    """An edge that wears from the first feed to the second looks like cutting force."""
    cuts = means_of(replace(SIZE, exponent=(0.0,) * 3, growth=0.0), (5e-5, 1e-4))
    true = coefficient_draws(law_draws(cuts), [one.conditions for one in cuts])
    land = design(cuts[1].conditions, (0.0,) * 3, 0.0) @ [0, 0, 0, 1.2e3, 3e3, 0]
    lines = cuts[1].lines.copy()
    lines[0] += land
    worn = mean_regression([cuts[0], replace(cuts[1], lines=lines)], 0.5)[1]
    assert worn[1].value * 1e6 > np.median(true, axis=0)[1]
    sharp = line_of(
        replace(SIZE, exponent=(0.0,) * 3, growth=0.0), [one.conditions for one in cuts]
    )
    for one, scale, value in zip(worn, [1e6] * 3 + [1e3] * 3, sharp, strict=True):
        assert abs(one.value - value / scale) <= one.half_width, one.name


def test_recordings_left_out_scale_the_interval():
    found = bent((0.05, 0.1, 0.15)).model.spread
    wide = calibrated(found, [(3.0, 0.1, 1.0)] * 20)
    assert wide.peak_scale > 2.5 and wide.mean_scale < 0.6 and wide.freedom == 24
    assert wide.shape_scale == pytest.approx(1.0)


def bent(feeds):
    truth = Truth(flutes=2, runout=0.004, runout_angle=0.0, exponent=0.25)
    return identified(truth, tuple((6000.0, f, 2.0, 0.0, np.pi) for f in feeds))


def test_a_shape_weighs_laws_by_its_density_and_their_step():
    """Bivariate normal of h_0 and m, widened by the variance of an evenly filled step of each."""
    known = KnownShape(
        chip=ChipShape(growth=2e-6, exponent=0.12),
        covariance=np.array([[4e-14, 3e-9], [3e-9, 1e-3]]),
    )
    exponents = np.array([[0.1] * 3, [0.1, 0.15, 0.15], [0.2] * 3])
    found = known.likely(exponents, np.zeros(3))
    unit = np.array([1e6, 1.0])  # h_0 in um
    step = np.array([1e-6, EXPONENTS[1] - EXPONENTS[0]])
    wider = (known.covariance + np.diag(step**2) / 12) * np.outer(unit, unit)
    each = [
        multivariate_normal([0.0, 0.0], wider).logpdf([-2.0, m - 0.12])
        for m in exponents.mean(axis=1)
    ]
    assert np.diff(found) == pytest.approx(np.diff(each), rel=1e-6)


@pytest.mark.parametrize("which", ["fit", "not_sharp"])
def test_a_line_reads_its_own_law_as_it_is_and_edges_add_up(which):
    """Each constant of the fit's own law is read as itself; wear of all recordings as an edge."""
    found = bent((0.05, 0.1, 0.15))
    fit = found.fit if which == "fit" else found.not_sharp.fit
    line = fitted_line(fit, np.ones(6))
    own = line.reading(fit.problem.chip(fit.x))
    scale = np.array([1e9] * 3 + [1e4] * 3)
    assert own * scale / scale[:, None] == pytest.approx(np.eye(6), abs=1e-2)
    assert line.edges.sum(axis=1) == pytest.approx(own[:, 3:], rel=1e-9, abs=1e-9 * own.max())


def test_laws_depart_from_the_law_that_predicts():
    """A law of the model's own constants departs by nothing, one of a tenth more by a tenth."""
    found = bent((0.05, 0.1, 0.15))
    model = found.model
    assert model.chip != STRAIGHT  # the truth has a size effect
    own = ChipLaw(
        cutting=tuple(model.values[:3]), edge=tuple(model.values[3:6]),
        exponent=(model.chip.exponent,) * 3, growth=model.chip.growth,
    )  # fmt: skip
    more = replace(own, cutting=tuple(1.1 * model.values[:3]), edge=tuple(1.1 * model.values[3:6]))
    model = replace(model, spread=replace(model.spread, laws=(own, more)), _departures={})
    cut = found.cuts[0]
    nothing, tenth = model.law_departures(cut.conditions, cut.harmonics)
    whole = model.coefficient_columns(cut.conditions, cut.harmonics) @ model.values[:6]
    assert np.abs(nothing).max() < 1e-9 * np.abs(whole).max()
    assert tenth == pytest.approx(0.1 * whole, abs=1e-9 * np.abs(whole).max())


def test_coefficients_of_a_bent_law_are_its_line_and_its_own_runout_predicts():
    """h^0.75: the straight line over the named feeds within 3 %; a sharp fit errs more."""
    found = bent((0.05, 0.1, 0.15))
    each = [cut.conditions for cut in found.cuts]
    law = ChipLaw(
        cutting=(850e6, 240e6, 140e6), edge=(22e3, 25e3, 4e3), exponent=(0.25,) * 3, growth=0.0,
    )  # fmt: skip
    true = line_of(law, named_range(each))
    assert found.not_sharp.coefficients == pytest.approx(true, rel=0.03)
    assert abs(found.model.geometry.along) == pytest.approx(4e-6, abs=2e-7)
    assert found.model.line == pytest.approx(line_of(law, each), rel=0.03)


@pytest.mark.proof
def test_forces_beyond_the_feeds_lie_in_wider_intervals():
    """A mill with a size effect, learnt at two feeds: half the least and 1.25 times the most."""
    found = bent((0.05, 0.1))
    truth = Truth(flutes=2, runout=0.004, runout_angle=0.0, exponent=0.25)
    share = {}
    for f_z in (0.025, 0.075, 0.125):
        one = recordings(truth, [(6000.0, f_z, 2.0, 0.0, np.pi)], seed=5)[0]
        cut = cut_harmonics(one, SETTINGS)
        levels = force_levels(found.model, cut.conditions, cut.harmonics)
        halves = half_widths(found.model.spread, levels)
        real = magnitude(cut.lines)
        for level, half, measured in zip(levels, halves, (real.max(), real.mean()), strict=True):
            assert abs(level.value - measured) <= half
        share[f_z] = halves[1] / levels[1].value
    assert share[0.025] > 1.2 * share[0.075]
    deeper = replace(cut.conditions, a_p=2 * cut.conditions.a_p)
    level = force_levels(found.model, deeper, cut.harmonics)[1]
    assert level.deviation / level.value > 0.06  # 0.1 ln 2 of it by the depth alone


K, M = 1675.0, 0.24
FEEDS = [3e-5, 5e-5, 8e-5, 12e-5, 18e-5]
SEEDS = 100


Arc = tuple[float, float]
HALF_TURN = (0.0, np.pi)


def cuts(feeds: Sequence[float], arc: Arc = HALF_TURN, a_p: float = 2e-3) -> list[CutConditions]:
    return [
        CutConditions(speed=100.0, f_z=f, a_p=a_p, phi_st=arc[0], phi_ex=arc[1], flutes=3)
        for f in feeds
    ]


def by_slots(force: ArrayLike, feeds: Sequence[float] = FEEDS, deviation: float = 0.0) -> Kienzle:
    return kienzle_by_force(np.array(force), cuts(feeds), np.full(len(feeds), deviation))


def mean_force(
    f_z: float, a_p: float, flutes: int, entry: float, leave: float, m_c: float = M
) -> float:
    """Mean tangential force over a revolution [N], by scipy's quadrature of the force law."""
    law = ForceLaw.kienzle(k_c11=K, m_c=m_c, radial=0.3)
    area = quad(
        lambda phi: edge_forces(law, f_z * np.sin(phi))[0], entry, leave, epsabs=0, epsrel=1e-11
    )
    return float(flutes * a_p / (2 * np.pi) * area[0])


@pytest.mark.parametrize(
    ("arc", "m_c"),
    [((0.0, np.pi), 0.0), ((0.0, 1.1), 0.24), ((2.0, np.pi), 0.6), ((0.7, 2.1), 0.24)],
)
def test_mean_forces_over_an_arc_give_the_law(arc: tuple[float, float], m_c: float) -> None:
    """Against an independent quadrature; 48 nodes are within 1e-8 of it."""
    forces = [mean_force(f, 2e-3, 3, *arc, m_c) for f in FEEDS]
    found = kienzle_by_force(np.array(forces), cuts(FEEDS, arc), np.zeros(5))
    assert found.k_c11 == pytest.approx(K, rel=1e-6)
    assert found.m_c == pytest.approx(m_c, abs=1e-7)


def test_cuts_of_different_arcs_and_depths_go_together() -> None:
    arcs = [(0.0, np.pi), (0.0, 1.0), (2.2, np.pi), (0.5, 2.0), (0.0, np.pi)]
    depths = [1e-3, 2e-3, 3e-3, 1.5e-3, 2.5e-3]
    each = [cuts([f], arc, a)[0] for f, a, arc in zip(FEEDS, depths, arcs, strict=True)]
    forces = [mean_force(c.f_z, c.a_p, 3, c.phi_st, c.phi_ex) for c in each]
    found = kienzle_by_force(np.array(forces), each, np.zeros(5))
    assert (found.k_c11, found.m_c) == pytest.approx((K, M), rel=1e-6)


@pytest.mark.parametrize("scatter", [0.05, pytest.param(0.01, marks=pytest.mark.proof)])
def test_the_truth_is_within_the_intervals(scatter: float) -> None:
    """95 % intervals hold it in 90 of 100 seeds at least, both of them, with 3 % of luck."""
    exact = np.array([mean_force(f, 2e-3, 3, 0.0, np.pi) for f in FEEDS])
    hits = np.zeros(2)
    for seed in range(SEEDS):
        random = np.random.default_rng(seed)
        found = by_slots(exact * np.exp(scatter * random.standard_normal(len(FEEDS))))
        hits += [
            low <= true <= high
            for true, (low, high) in ((K, found.k_c11_interval), (M, found.m_c_interval))
        ]
    assert hits.min() >= 90


def test_intervals_are_never_narrower_than_what_is_known_of_the_forces() -> None:
    """With forces that happen to lie on the law, but are only good to 10 %."""
    exact = [mean_force(f, 2e-3, 3, 0.0, np.pi) for f in FEEDS]
    lucky, honest = by_slots(exact), by_slots(exact, deviation=0.1)
    # in a slot the arc changes the level alone, by as much at all feeds
    design = np.stack([np.ones(5), -np.log(np.array(FEEDS) / 1e-3)], axis=1)
    expected = 1.96 * 0.1 * np.sqrt(np.linalg.inv(design.T @ design)[1, 1])
    half = (honest.m_c_interval[1] - honest.m_c_interval[0]) / 2
    assert half == pytest.approx(expected, rel=1e-3)
    assert lucky.m_c_interval[1] - lucky.m_c_interval[0] < 1e-6


@pytest.mark.parametrize(
    ("feeds", "words"),
    [
        ([1e-4, 2e-4], "2 cuts with chips of 0.1 to 0.2 mm do not tell"),
        ([1e-4, 1.1e-4, 1.2e-4], "the thickest 1.5 times the thinnest"),
    ],
)
def test_cuts_that_do_not_tell_are_refused(feeds: list[float], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        by_slots(np.full(len(feeds), 10.0), feeds)
    with pytest.raises(ValueError, match=r"mean tangential force = 0\.0 of a cut must be positive"):
        by_slots([1.0, 0.0, 2.0], FEEDS[:3])


def test_constants_have_intervals_or_the_reason_why_not() -> None:
    """1 % of scatter over five feeds determines both; 30 % neither."""
    exact = np.array([mean_force(f, 2e-3, 3, 0.0, np.pi) for f in FEEDS])
    sign = np.array([1.0, -1.0, 1.0, -1.0, 1.0])
    sure = kienzle_parameters(by_slots(exact * (1 + 0.01 * sign)), 0.5)
    loose = kienzle_parameters(by_slots(exact * (1 + 0.3 * sign)), 0.5)
    for rows, determined in ((sure, True), (loose, False)):
        assert set(rows) == {"kienzle.k_c11", "kienzle.m_c"}
        for one in rows.values():
            assert one.determined is determined
            assert (one.value is None) is (one.interval_95 is None) is not determined
            assert ("is wider than asked" in one.method) is not determined
    assert sure["kienzle.k_c11"].interval_95 is not None
    low, high = sure["kienzle.k_c11"].interval_95
    assert low < K < high and sure["kienzle.k_c11"].unit == "N/mm^2"
