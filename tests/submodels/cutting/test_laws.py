"""Laws of the chip: closed forms, what two feeds cannot tell, and intervals that hold."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.chip_law import (
    chip_laws,
    design,
    law_scales,
    mean_edge_force,
    straight_line_spread,
)
from pipeline.cutting.force.mean_force import regressors
from pipeline.schema.cutting import ChipLaw, CutConditions
from pipeline.submodels.cutting.coefficients import mean_regression
from pipeline.submodels.cutting.identify import identify_cutting_force
from pipeline.submodels.cutting.recordings import cut_harmonics
from pipeline.submodels.cutting.spread import (
    calibrated,
    force_levels,
    half_widths,
    magnitude,
)
from pipeline.submodels.cutting.waveform import CutHarmonics
from tests.submodels.cutting.milling import Truth
from tests.submodels.cutting.recorded import SETTINGS, known_of, recordings

SLOT = CutConditions(speed=100.0, f_z=1e-4, a_p=2e-3, phi_st=0.0, phi_ex=np.pi, flutes=3)
SIZE = ChipLaw(
    name="size effect", cutting=(9e8, 3e8, 1.5e8), exponent=(0.2,) * 3, edge=(2e4, 2e4, 4e3),
    growth=6e-6, weight=1.0,
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


def test_two_feeds_leave_every_law_and_five_do_not():
    two, five = (chip_laws(means_of(SIZE, f)) for f in ((5e-5, 1e-4), np.geomspace(1e-5, 2e-4, 5)))
    families = {law.name for law in two}
    by_family = [sum(law.weight for law in two if law.name == name) for name in families]
    assert by_family == pytest.approx([1 / len(families)] * len(families), rel=0.05)
    assert sum(law.weight for law in five) == pytest.approx(1.0)
    line = next(law.weight for law in five if law.name == "linear edge")
    assert line < 0.5 / len(families)  # a straight line bends away from its means


def test_laws_agree_where_they_were_fitted_and_part_beyond():
    laws = chip_laws(means_of(SIZE, (5e-5, 1e-4)))
    here, there = (law_scales(laws, replace(SLOT, f_z=f)) for f in (1e-4, 2.5e-5))
    assert here == pytest.approx(np.ones_like(here), abs=0.01)
    assert np.ptp(there[:, 0]) > 0.05


@pytest.mark.parametrize("feeds", [(5e-5, 1e-4), (3e-5, 6e-5)])
def test_the_line_of_two_feeds_holds_that_of_five(feeds):
    """The straight line through five feeds that reach further lies in the interval of two."""
    found = mean_regression(means_of(SIZE, feeds), 0.5)[1]
    wide = np.linspace(feeds[0] / 1.6, feeds[1] * 1.6, 5)
    true = mean_regression(means_of(SIZE, wide), 0.5)[1]
    for one, other in zip(found, true, strict=True):
        assert abs(one.value - other.value) <= one.half_width, one.name


def test_one_feed_has_no_line():
    cuts = means_of(SIZE, (1e-4,))
    assert np.isinf(straight_line_spread(cuts)).all()
    laws = chip_laws(cuts)
    forces = np.array([mean_edge_force(law, replace(SLOT, f_z=2e-4)) for law in laws])
    one = np.array([mean_edge_force(law, SLOT) for law in laws])
    growth = forces[:, 0] / one[:, 0]
    assert growth.max() == pytest.approx(2.0) and growth.min() == pytest.approx(2**0.4)


def test_recordings_left_out_scale_the_interval():
    found = identified((0.05, 0.1, 0.15)).spread
    wide = calibrated(found, [(3.0, 0.1)] * 20)
    assert wide.peak_scale > 2.5 and wide.mean_scale < 0.6 and wide.freedom == 24


def identified(feeds):
    truth = Truth(flutes=2, runout=0.004, runout_angle=0.0, exponent=0.25)
    tests = [(6000.0, f, 2.0, 0.0, np.pi) for f in feeds]
    return identify_cutting_force(recordings(truth, tests), known_of(truth), SETTINGS)


def test_forces_beyond_the_feeds_lie_in_wider_intervals():
    """A mill with a size effect, learnt at two feeds: half the least and 1.25 times the most."""
    found = identified((0.05, 0.1))
    truth = Truth(flutes=2, runout=0.004, runout_angle=0.0, exponent=0.25)
    share = {}
    for f_z in (0.025, 0.075, 0.125):
        one = recordings(truth, [(6000.0, f_z, 2.0, 0.0, np.pi)], seed=5)[0]
        cut = cut_harmonics(one, SETTINGS)
        levels = force_levels(found.model, cut.conditions, cut.harmonics)
        halves = half_widths(found.spread, levels)
        real = magnitude(cut.lines)
        for level, half, measured in zip(levels, halves, (real.max(), real.mean()), strict=True):
            assert abs(level.value - measured) <= half
        share[f_z] = halves[1] / levels[1].value
    assert share[0.025] > 1.5 * share[0.075]
    deeper = replace(cut.conditions, a_p=2 * cut.conditions.a_p)
    level = force_levels(found.model, deeper, cut.harmonics)[1]
    assert level.deviation / level.value > 0.06  # 0.1 ln 2 of it by the depth alone
