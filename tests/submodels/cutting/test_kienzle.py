"""Kienzle's constants: exact without noise, within their intervals with it."""

from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import quad

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.schema.cutting import CutConditions
from pipeline.submodels.cutting.coefficients import Kienzle, kienzle_by_force, kienzle_parameters
from tests.cutting.closed_forms import edge_forces

K, M = 1675.0, 0.24
FEEDS = [3e-5, 5e-5, 8e-5, 12e-5, 18e-5]
SEEDS = 100


Arc = tuple[float, float]
SLOT = (0.0, np.pi)


def cuts(feeds: Sequence[float], arc: Arc = SLOT, a_p: float = 2e-3) -> list[CutConditions]:
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


@pytest.mark.parametrize("arc", [(0.0, np.pi), (0.0, 1.1), (2.0, np.pi), (0.7, 2.1)])
@pytest.mark.parametrize("m_c", [0.0, 0.24, 0.6])
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


@pytest.mark.parametrize("scatter", [0.01, 0.05])
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


def test_a_force_that_is_none_is_refused() -> None:
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
