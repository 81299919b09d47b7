"""Tool life: Taylor's textbook numbers and damage that adds up."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.economics.material import (
    Taylor,
    cutting_speed,
    fastest,
    life,
    wear,
    wear_ends,
)
from tests.cutting.closed_forms import speed_for_life

MINUTE = 60.0
CARBIDE = Taylor(n=0.25, C_m_min=500.0)
EXTENDED = Taylor(
    n=0.2, C_m_min=300.0, f_z_exponent=0.3, f_z_ref_mm=0.1, a_p_exponent=0.15, a_p_ref_mm=2.0
)

exponents = st.floats(0.05, 0.6)
constants = st.floats(20.0, 2000.0)
speeds = st.floats(1.0, 2000.0)  # m/min


def test_the_textbook_example_of_groover() -> None:
    """v = 160 m/min lives 5 min, 100 m/min lives 41 min: n = 0.223, C = 229 (three digits)."""
    taylor = Taylor(n=0.223, C_m_min=229.0)
    found = life(taylor, np.array([160.0, 100.0]) / MINUTE) / MINUTE
    assert found == pytest.approx([5.0, 41.0], rel=0.01)


def test_cutting_speed_is_that_of_the_shop_formula() -> None:
    """V = pi D n / 1000 with D in mm and n in rpm."""
    assert cutting_speed(0.012, 9000 / 60) * 60 == pytest.approx(np.pi * 12 * 9000 / 1000)


@given(exponents, constants, speeds)
def test_life_satisfies_taylor_and_its_inverse(n: float, C: float, speed: float) -> None:
    taylor = Taylor(n=n, C_m_min=C)
    lasting = float(life(taylor, speed / MINUTE))
    assert speed * (lasting / MINUTE) ** n == pytest.approx(C, rel=1e-9)
    assert speed_for_life(taylor, lasting) * MINUTE == pytest.approx(speed, rel=1e-9)


def test_the_extended_law_is_the_plain_one_at_its_reference_and_scales_by_its_exponents() -> None:
    plain = Taylor(n=0.2, C_m_min=300.0)
    at = {"f_z": 0.1e-3, "a_p": 2e-3}
    assert life(EXTENDED, 4.0, at) == pytest.approx(float(life(plain, 4.0)), rel=1e-12)
    doubled = life(EXTENDED, 4.0, {"f_z": 0.2e-3, "a_p": 4e-3})
    assert doubled == pytest.approx(life(plain, 4.0) * 2 ** (-(0.3 + 0.15) / 0.2), rel=1e-12)
    with pytest.raises(ValueError, match="depends on a_p here"):
        life(EXTENDED, 4.0, {"f_z": 0.1e-3})


SPREAD = Taylor(
    n=0.28, C_m_min=200.0, life_min=15.0, C_range_m_min=(140.0, 300.0), n_range=(0.25, 0.3)
)


def test_a_speed_at_a_life_is_taylors_constant_at_that_life() -> None:
    """What makers print, v_c for 15 min, and C for one."""
    assert life(SPREAD, 200 / MINUTE) / MINUTE == pytest.approx(15.0, rel=1e-12)
    plain = Taylor(n=0.28, C_m_min=200.0 * 15**0.28)
    assert life(SPREAD, 90 / MINUTE) == pytest.approx(float(life(plain, 90 / MINUTE)), rel=1e-12)


@given(st.floats(20.0, 600.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_wear_by_any_constants_of_the_spread_is_inside_its_interval(
    speed: float, C_share: float, n_share: float
) -> None:
    inside = Taylor(n=0.25 + 0.05 * n_share, C_m_min=140 + 160 * C_share, life_min=15.0)
    low, high = wear_ends(SPREAD, [60.0], speed / MINUTE)
    for one in (inside, SPREAD):
        used = wear(one, [60.0], speed / MINUTE)
        assert (low <= used * (1 + 1e-9)).all() and (used <= high * (1 + 1e-9)).all()


def test_without_a_spread_there_is_no_interval() -> None:
    assert np.isnan(wear_ends(CARBIDE, [60.0, 0.0], 2.0)).all()


@given(st.floats(1.0, 200.0))
def test_the_fastest_speed_lasts_by_every_constant_and_no_faster_one_does(minutes: float) -> None:
    v_c = float(fastest(SPREAD, minutes * MINUTE))
    lives = [float(life(end, v_c)) / MINUTE for end in SPREAD.ends]
    assert min(lives) == pytest.approx(minutes, rel=1e-9)


@pytest.mark.parametrize(("ends", "said"), [
    ({"C_range_m_min": (250.0, 300.0)}, r"C_range_m_min = \[250.0, 300.0\].* 200 between"),
    ({"n_range": (0.1,)}, r"n_range = \[0.1\]"), ({"life_min": 0.0}, "life_min = 0.0"),
])  # fmt: skip
def test_a_spread_that_is_none_is_refused(ends, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Taylor(**({"n": 0.28, "C_m_min": 200.0} | ends))


def test_each_exponent_belongs_to_its_own_condition() -> None:
    """V T^n (f_z/f_0)^a (a_p/a_0)^b (a_e/e_0)^c = C, restated with all three."""
    taylor = Taylor(
        n=0.2, C_m_min=300.0, f_z_exponent=0.3, f_z_ref_mm=0.1, a_p_exponent=0.15, a_p_ref_mm=2.0,
        a_e_exponent=0.1, a_e_ref_mm=5.0,
    )  # fmt: skip
    lasting = float(life(taylor, 4.0, {"f_z": 0.05e-3, "a_p": 6e-3, "a_e": 2e-3})) / MINUTE
    assert 240.0 * lasting**0.2 * 0.5**0.3 * 3**0.15 * 0.4**0.1 == pytest.approx(300.0, rel=1e-12)


def test_what_does_not_cut_does_not_wear() -> None:
    assert life(CARBIDE, 0.0) == np.inf
    assert wear(CARBIDE, 100.0, 0.0) == 0.0
    assert wear(EXTENDED, 100.0, 4.0, {"f_z": 0.0, "a_p": 2e-3}) == 0.0


@given(st.lists(st.tuples(st.floats(0.0, 1e4), speeds), min_size=1, max_size=6), exponents)
def test_shares_of_life_add_up_and_do_not_depend_on_the_cut_of_the_blocks(
    blocks: list[tuple[float, float]], n: float
) -> None:
    taylor = Taylor(n=n, C_m_min=400.0)
    times, v_c = np.array(blocks).T
    v_c = v_c / MINUTE
    whole = float(wear(taylor, times, v_c).sum())
    halves = wear(taylor, np.repeat(times / 2, 2), np.repeat(v_c, 2)).sum()
    assert halves == pytest.approx(whole, rel=1e-12, abs=1e-300)
    expected = sum(
        t / (60 * (400.0 / (60 * v)) ** (1 / n)) for t, v in zip(times, v_c, strict=True)
    )
    assert whole == pytest.approx(expected, rel=1e-9, abs=1e-300)


def test_a_population_is_each_of_its_members() -> None:
    random = np.random.default_rng(0)
    times, v_c = random.uniform(0, 10, (7, 30)), random.uniform(0, 8, (7, 30))
    at = {"f_z": random.uniform(0, 3e-4, (7, 30)), "a_p": random.uniform(0, 5e-3, 30)}
    together = wear(EXTENDED, times, v_c, at).sum(axis=-1)
    assert together.shape == (7,)
    for row in range(7):
        one = wear(EXTENDED, times[row], v_c[row], {"f_z": at["f_z"][row], "a_p": at["a_p"]}).sum()
        assert together[row] == pytest.approx(float(one), rel=1e-14)
