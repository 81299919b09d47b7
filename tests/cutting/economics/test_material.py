"""Materials: what is in conf/material/ against the tables that it cites."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from pipeline.cutting.economics.material import (
    LinearEdge,
    Material,
    Taylor,
    cutting_speed,
    fastest,
    life,
    wear,
    wear_ends,
)
from pipeline.cutting.tool import Tool
from pipeline.parameters import ParametersError, structure
from tests.cutting.closed_forms import edge_forces, speed_for_life

ROOT = Path(__file__).parents[3]
FILES = sorted((ROOT / "conf/material").glob("*.yaml"))

ISCAR = {
    1: (1350, 0.21), 2: (1500, 0.22), 3: (1675, 0.24), 4: (1700, 0.24), 5: (1900, 0.24),
    6: (1775, 0.24), 7: (1675, 0.24), 8: (1725, 0.24), 9: (1800, 0.24), 10: (2450, 0.23),
    11: (2500, 0.23), 12: (1875, 0.21), 13: (1875, 0.21), 14: (2150, 0.20), 15: (1150, 0.20),
    16: (1350, 0.28), 17: (1225, 0.25), 18: (1350, 0.28), 19: (1225, 0.25), 20: (1420, 0.30),
    21: (700, 0.25), 22: (800, 0.25), 23: (700, 0.25), 24: (700, 0.25), 25: (750, 0.25),
    26: (700, 0.27), 27: (700, 0.27), 28: (700, 0.27), 31: (2600, 0.24), 32: (3100, 0.24),
    33: (3300, 0.24), 34: (3300, 0.24), 35: (3300, 0.24), 36: (1160, 0.24), 37: (1245, 0.24),
}  # fmt: skip
"""Group of VDI 3323: k_c1.1 [N/mm^2], m_c, as printed in ISCAR's Boring Systems of 2022."""


LIU = (0.157, 0.220, 0.276, 0.301, 0.346, 0.466, 0.598)
"""K_rc / K_tc of the rows for aluminium with both, table 5 of Liu et al. 2021."""


def material(path: Path) -> Material:
    return structure({"material": yaml.safe_load(path.read_text())}, "material", Material)


def some(**changes: Any) -> Material:
    values = {
        "name": "steel", "group": 3, "iso": "P", "k_c11": 1675.0, "m_c": 0.24, "radial": 0.3,
        "source": "a table", "ratio_source": "assumed", **changes,
    }  # fmt: skip
    return structure({"material": values}, "material", Material)


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_each_number_is_that_of_the_table_it_cites(path: Path) -> None:
    found = material(path)
    assert "ISCAR" in found.source and f"group {found.group}" in found.source
    assert (found.k_c11, found.m_c) == ISCAR[found.group]
    assert found.ratio_source
    for taylor in found.taylor.values():
        assert taylor.source


def test_the_catalogue_has_ten_groups_and_more() -> None:
    assert len({material(path).group for path in FILES}) >= 10
    assert {material(path).iso for path in FILES} >= set("PMKNS")


@pytest.mark.parametrize("name", ["aluminium", "aluminium_cast"])
def test_the_radial_ratio_of_aluminium_is_the_median_of_those_measured(name: str) -> None:
    found = material(ROOT / f"conf/material/{name}.yaml")
    assert found.radial == round(float(np.median(LIU)), 1)
    assert f"{LIU[0]} to {LIU[-1]}" in found.ratio_source


def test_a7075_has_the_ratios_of_its_row_and_the_hardness_of_its_temper() -> None:
    found = material(ROOT / "conf/material/A7075.yaml")
    assert found.coefficients is not None
    radial = found.coefficients.K_rc / found.coefficients.K_tc
    axial = found.coefficients.K_ac / found.coefficients.K_tc
    assert (round(radial, 3), round(axial, 2)) == (LIU[1], found.axial)
    assert found.hardness_HB == 150  # ASM's data sheet of 7075-T6; group 22 is tabled at 100


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_lives_out_of_a_textbook_say_that_they_are_a_guess(path: Path) -> None:
    """Groover's table 23.2 knows steel and nonsteel only."""
    found = material(path)
    if not any("rough first guess" in life.source for life in found.taylor.values()):
        return
    rows = {"carbide": (0.25, 500.0), "hss": (0.125, 70.0)}
    if found.iso not in "PM":
        rows = {"carbide": (0.25, 900.0), "hss": (0.125, 120.0)}
    for tool, taylor in found.taylor.items():
        assert (taylor.n, taylor.C_m_min) == rows[tool]
        which = "rows of steel work" if found.iso in "PM" else "rows of nonsteel work"
        assert which in taylor.source and "rough first guess" in taylor.source


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_every_material_has_the_life_of_carbide_with_its_spread_or_says_what_is_missing(
    path: Path,
) -> None:
    found = material(path)
    carbide = Tool(kind="flat", diameter_mm=5.0, flutes=2)
    life = found.tool_life(carbide)
    assert life is not None and len(life.ends) > 1 and life.source
    low, high = life.C_range_m_min
    assert low <= life.C_m_min <= high and high / low > 1.5  # makers differ by more
    hss = replace(carbide, material="hss")
    if found.tool_life(hss) is None:
        assert path.stem in ("nickel_alloy", "titanium_alloy")
        said = found.no_life(hss)
        assert f"life of high-speed steel in {found.name}" in said and "taylor.hss" in said


STARTING = {
    "steel_medium_carbon": (140, 250), "steel_medium_carbon_tempered": (140, 240),
    "steel_low_alloy": (70, 240), "steel_low_alloy_tempered": (70, 200), "steel_tool": (80, 210),
    "stainless_austenitic": (60, 130), "stainless_martensitic": (60, 165), "nickel_alloy": (20, 40),
    "titanium_alloy": (20, 90), "cast_iron_nodular": (80, 220), "cast_iron_grey": (80, 275),
    "aluminium_cast": (152, 850),
}  # fmt: skip
"""Least and greatest starting speed of the makers' tables that a carbide's source names [m/min]."""
DORMER_PRAMET = {15: 1.23, 20: 1.13, 30: 1.0, 45: 0.89, 60: 0.81, 90: 0.72}
"""Speed by the life of an edge [min] over that for 30 min: Milling 2021-2022, page 700."""


@pytest.mark.parametrize("name", STARTING)
def test_lives_by_makers_speeds_are_those_of_their_tables(name: str) -> None:
    life = material(ROOT / f"conf/material/{name}.yaml").taylor["carbide"]
    low, high = STARTING[name]
    assert life.life_min == 15
    assert life.C_range_m_min == (low, round(DORMER_PRAMET[15] * high))
    assert life.C_m_min == round(float(np.sqrt(low * DORMER_PRAMET[15] * high)))
    for minutes, factor in DORMER_PRAMET.items():  # two digits
        assert (minutes / 30) ** -life.n_range[1] == pytest.approx(factor, rel=0.02)
    for faster, share in ((1.2, 1 / 2), (1.5, 1 / 5)):  # Mitsubishi's rule
        assert faster ** (-1 / life.n_range[0]) == pytest.approx(share, rel=0.05)


@pytest.mark.parametrize(("coating", "factor"), [("none", 0.7), ("", 1.0), ("TiAlN", 1.0)])
def test_an_uncoated_edge_is_slower(coating: str, factor: float) -> None:
    found = material(ROOT / "conf/material/steel_tool.yaml")
    tool = Tool(kind="flat", diameter_mm=5.0, flutes=2, coating=coating)
    life, usual = found.tool_life(tool), found.taylor["carbide"]
    assert life is not None and life.C_m_min == pytest.approx(factor * usual.C_m_min)
    assert life.C_range_m_min == pytest.approx([factor * C for C in usual.C_range_m_min])


def test_a6061_is_that_of_sim2023() -> None:
    """Slot without runout: peak load = K_t d f_z sqrt(1 + K_e^2) of a chip f_z thick."""
    law = material(ROOT / "conf/material/A6061.yaml").force_law()
    F_t, F_r, _ = edge_forces(law, 0.05e-3) * 1e-3  # 1 mm deep
    assert np.hypot(F_t, F_r) == pytest.approx(1.23e9 * 1e-3 * 0.05e-3 * np.sqrt(1.25), rel=1e-12)
    assert (law.m_c, law.K_te) == (0.0, 0.0)


def test_measured_coefficients_go_first_and_kienzle_can_be_asked_for() -> None:
    edge = {"K_tc": 700.0, "K_rc": 200.0, "K_te": 10.0, "source": "dynamometer"}
    found = some(coefficients=edge)
    assert found.force_source == "dynamometer"
    assert found.force_law().K_te == 10e3
    h = 0.1e-3
    F_t, F_r, F_a = edge_forces(found.force_law(measured=False), h)
    assert F_t == pytest.approx(1675.0 * 0.1 ** (1 - 0.24) * 1e3, rel=1e-12)  # N/mm in N/m
    assert F_r / F_t == pytest.approx(0.3) and F_a == 0.0
    assert some().force_source == "a table"


def test_a_life_without_a_source_is_not_known() -> None:
    found = some(taylor={"hss": {"n": 0.125, "C_m_min": 70.0, "source": "a book"}})
    hss = Tool(kind="drill", diameter_mm=5.0, flutes=2, material="hss")
    carbide = Tool(kind="drill", diameter_mm=5.0, flutes=2)
    known = found.tool_life(hss)
    assert known is not None and known.C_m_min == 70.0
    assert found.tool_life(carbide) is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"group": 42}, r"material\.group = 42 must lie from 1 to 41"),
        ({"iso": "N"}, "'N' does not go with group 3 of VDI 3323, which is P"),
        ({"group": 12, "iso": "K"}, "which is P or M"),
        ({"iso": "X"}, "'X' is none of P, M"),
        ({"k_c11": 1.5e9}, r"material\.k_c11 = 1500000000\.0 must lie from 10 to 20000"),
        ({"source": " "}, r"material\.source is empty: say where the numbers come from"),
        ({"kc11": 1.0}, "kc11"),
        ({"taylor": {"diamond": {"n": 0.3, "C_m_min": 1.0}}}, "'diamond' is none of carbide, hss"),
        ({"coefficients": {"K_tc": -5.0, "K_rc": 0.0, "source": "x"}}, "K_tc = -5.* at least 0"),
        ({"coefficients": {"K_tc": 5.0, "K_rc": 0.0, "source": ""}}, "say who measured them"),
    ],
)
def test_what_is_no_material_is_refused_by_name(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ParametersError, match=words):
        some(**changes)


def test_edge_coefficients_are_those_of_tables() -> None:
    law = LinearEdge(K_tc=767.01, K_rc=168.8, K_te=27.7, K_re=26.6, source="x").force_law()
    assert edge_forces(law, 0.1e-3)[0] == pytest.approx((767.01 * 0.1 + 27.7) * 1e3)


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
    with pytest.raises(ValueError, match="depends on a_p here"):
        life(EXTENDED, 4.0, {"f_z": 0.1e-3})


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
