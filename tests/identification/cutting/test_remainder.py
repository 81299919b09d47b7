"""What mechanics leave over: exact where it was learnt, silent elsewhere, better in between."""

import numpy as np
import pytest

from pipeline.identification.cutting.choice import squares
from pipeline.identification.cutting.conditions import Conditions
from pipeline.identification.cutting.fit import fitted
from pipeline.identification.cutting.identify import cut_beside
from pipeline.identification.cutting.model import model_of, restored, stored
from pipeline.identification.cutting.problem import Cut, Terms
from pipeline.identification.cutting.remainder import remainders
from tests.identification.cutting.milling import Truth
from tests.identification.cutting.recorded import SETTINGS, known_of, recordings

LINES = np.random.default_rng(1).normal(size=(2, 9, 3, 2)) @ [1, 1j]


def conditions(f_z, **changed):
    return Conditions(**{
        "speed": 100.0, "f_z": f_z, "a_p": 2e-3, "phi_st": 0.0, "phi_ex": np.pi, "flutes": 2,
        **changed,
    })  # fmt: skip


def learnt(feeds=(5e-5, 1e-4), phases=(0.3, 1.9)):
    """Recordings of A f_z + B at some phases, of which the model says nothing."""
    order = np.arange(9)[:, None]
    cuts = [
        Cut(
            conditions=conditions(f), variance=np.full((9, 3), 1e-9),
            lines=(100 * LINES[0] + 1e6 * f * LINES[1]) * np.exp(1j * order * p),
        )
        for f, p in zip(feeds, phases, strict=True)
    ]  # fmt: skip
    return remainders(cuts, [np.zeros((9, 3))] * len(cuts), phases, 0.0)


def test_it_is_affine_in_the_feed():
    (found,) = learnt()
    exact = 100 * LINES[0] + 1e6 * 7e-5 * LINES[1]
    assert found.at(7e-5, 8) == pytest.approx(exact)


def test_one_feed_makes_it_constant():
    (found,) = learnt((5e-5, 5.1e-5))
    assert np.abs(found.slope).max() == 0.0


def test_far_beyond_the_feeds_it_does_not_run_away():
    (found,) = learnt()
    assert found.at(3e-4, 8) == pytest.approx(found.at(1.25e-4, 8))


@pytest.mark.parametrize(
    "other",
    [
        conditions(7e-5, speed=102.0), conditions(7e-5, a_p=2.1e-3), conditions(7e-5, phi_st=0.1),
        conditions(7e-5, phi_ex=3.0), conditions(2.1e-4), conditions(2.4e-5),
        conditions(7e-5, flutes=3),
    ],
)  # fmt: skip
def test_it_says_nothing_of_other_conditions(other):
    (found,) = learnt()
    assert not found.covers(other)
    assert found.covers(conditions(7e-5, speed=100.5))


def test_scatter_is_not_learnt():
    cut = Cut(
        conditions=conditions(5e-5), lines=LINES[0], variance=np.full((9, 3), 100.0),
    )  # fmt: skip
    (found,) = remainders([cut], [np.zeros((9, 3))], [0.0], 0.0)
    assert np.abs(found.constant).max() == 0.0


def test_it_helps_on_a_feed_between_where_the_law_is_bent():
    """Of four feeds one is left out in turn; a straight law leaves over what is bent in h^0.7."""
    truth = Truth(flutes=2, runout=0.0, exponent=0.3)
    tests = [(6000.0, f, 2.0, 0.0, np.pi) for f in (0.03, 0.06, 0.09, 0.12)]
    cuts = [cut_beside(one, SETTINGS) for one in recordings(truth, tests, 2, zero=0.0)]
    for out in (1, 2):
        rest = [cut for k, cut in enumerate(cuts) if k != out]
        fit = fitted(known_of(truth).tool, rest, Terms())
        without, whole = squares(model_of(fit, over=False), cuts[out])
        with_it, _ = squares(model_of(fit, over=True), cuts[out])
        # over the feed both are straight: what is left is the bend between the feeds
        assert with_it.sum() < 0.6 * without.sum()
        assert with_it.sum() < 0.03**2 * whole.sum()


def test_a_model_is_stored_in_full():
    truth = Truth(flutes=3, exponent=0.3)
    tests = [(6000.0, f, 2.0, 0.0, np.pi) for f in (0.05, 0.1)]
    cuts = [cut_beside(one, SETTINGS) for one in recordings(truth, tests)]
    model = model_of(fitted(known_of(truth).tool, cuts, Terms(modes=True, teeth=True)), over=True)
    again = restored(stored(model))
    here = cuts[0].conditions
    assert again.predicted(here, 20) == pytest.approx(model.predicted(here, 20), rel=1e-12)
    assert np.abs(model.predicted(here, 20) - model.mechanics(here, 20)).max() > 0
