"""Single blocks whose best feed and speed have closed forms, each found within 0.1 %.

The slot is 290 mm long, of which the last 283 mm are in the material (the tool's centre enters 3 mm
before the blank).  With K_re = K_te = 0 its peak load is K_t d f_z sqrt(1 + K_e^2) (Sim2023), its
mean power K_t d D v_f: the specific work times the volume in a second.
"""

import numpy as np
import pytest

from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.tool_life import Taylor, maximum_rate_speed, minimum_cost_speed
from pipeline.optimisation.direct.direct import direct
from pipeline.optimisation.settings import CutLimit, Grouping
from tests.optimisation.direct_parts import (
    DEPTH,
    K_E,
    K_T,
    RATES,
    SIX,
    TAYLOR,
    drive,
    problem,
    side_cut,
    slots,
)  # fmt: skip

NEAR = 1e-3
"""What the answer may be off by; S is in whole rev/min, 0.05 % at the slowest of these."""
D, FLUTES = 6e-3, 2
LENGTH, INSIDE = 0.290, 283 / 290
GROUPING = Grouping()


def load_f_z(limit, depth=DEPTH):
    """Feed for each tooth of a slot at its load limit [mm]."""
    return limit / (K_T * depth * 1e-3 * np.hypot(1, K_E)) * 1e3


def turns(v_c):
    """Of the tool at a cutting speed [m/s]: rev/min."""
    return 60 * v_c / (np.pi * D)


def optimum(found, objective, grouping=GROUPING):
    """Feed [mm/min], speed [rev/min] and decision of one block."""
    decision = direct(found, objective, grouping)
    assert decision.feeds.shape == decision.speeds.shape == (1,)
    return decision.feeds[0], decision.speeds[0], decision


def test_cheapest_speed_of_a_slot_at_its_load_limit():
    """Gilbert: T = (1/n - 1) (T_c + P_t / r), of the time that the tool is in the material.

    f_z stands at the load limit, so that time falls as 1/n.  Rapids do not depend on S.
    """
    found = problem(
        slots(DEPTH), CutLimit(load_N=60.0, feed_mm_min=(50, 2000), speed_rpm=(1000, 20000))
    )
    price, change = SIX.price * INSIDE, RATES.tool_change * INSIDE
    speed = turns(minimum_cost_speed(TAYLOR, change, price, RATES.per_second))
    feed, S, _ = optimum(found, "cost")
    assert pytest.approx(speed, rel=NEAR) == S
    assert feed == pytest.approx(load_f_z(60.0) * FLUTES * speed, rel=NEAR)


def test_speed_of_the_most_parts_in_an_hour():
    """Tools that cost nothing: what is left of the cost is time, that of changing tools with it."""
    rates = CostRates(currency="EUR", labour_per_h=60.0, tool_change_min=10.0)
    tool = type(SIX)(kind="flat", diameter_mm=6.0, flutes=2, stickout_mm=20.0, price=0.0)
    found = problem(
        slots(DEPTH), CutLimit(load_N=60.0, feed_mm_min=(50, 2000), speed_rpm=(1000, 20000)),
        tool=tool, rates=rates,
    )  # fmt: skip
    speed = turns(maximum_rate_speed(TAYLOR, rates.tool_change * INSIDE))
    feed, S, _ = optimum(found, "cost")
    assert pytest.approx(speed, rel=NEAR) == S
    assert feed == pytest.approx(load_f_z(60.0) * FLUTES * speed, rel=NEAR)


def test_fastest_slot_at_its_load_limit():
    """As fast as the spindle turns; the time of the block is L / (f_z N n)."""
    found = problem(
        slots(DEPTH), CutLimit(load_N=60.0, feed_mm_min=(50, 2000), speed_rpm=(1000, 8000))
    )
    feed, S, decision = optimum(found, "time")
    assert S == 8000
    assert feed == pytest.approx(load_f_z(60.0) * FLUTES * 8000, rel=NEAR)
    row = int(np.flatnonzero(found.cuts)[0])
    time = found.row_objectives(decision.row_feeds[None], decision.row_speeds[None])[0, 0, row]
    assert time == pytest.approx(LENGTH * 1e3 / (load_f_z(60.0) * FLUTES * 8000) * 60, rel=NEAR)


def test_fastest_slot_at_the_drive_s_power():
    """F = P eta / (K_t d D) at any S from the base speed on; the slowest of them is taken."""
    found = problem(
        slots(DEPTH), CutLimit(load_N=1000.0, feed_mm_min=(50, 2000), speed_rpm=(1000, 12000)),
        drive=drive(0.2, base=5000.0, top=12000.0, efficiency=0.8),
    )  # fmt: skip
    feed, S, _ = optimum(found, "time")
    assert feed == pytest.approx(0.8 * 200 / (K_T * DEPTH * 1e-3 * D) * 60e3, rel=NEAR)
    assert S == 5000


def test_cheapest_speed_where_the_feed_has_its_greatest():
    """F_max binds below Gilbert's speed: S is just what keeps the load at F_max, faster only wears.

    n = F_max / (f_z N).
    """
    greatest = 300.0
    found = problem(
        slots(DEPTH), CutLimit(load_N=60.0, feed_mm_min=(50, greatest), speed_rpm=(1000, 20000))
    )
    feed, S, _ = optimum(found, "cost")
    assert feed == pytest.approx(greatest, rel=NEAR)
    assert pytest.approx(greatest / (load_f_z(60.0) * FLUTES), rel=NEAR) == S


def test_fastest_side_cut_at_its_greatest_chip():
    """Up-milling a_e = D/4 to phi_ex = 60 degrees: h = f_z sin(phi).

    The engagement's bins are 5 degrees wide and their chips those of their middles, phi = 57.5.
    """
    limits = CutLimit(chip_um=(0.0, 20.0), feed_mm_min=(50, 5000), speed_rpm=(1000, 8000))
    found = problem(side_cut(1.5), limits, resolution=0.25)
    feed, S, _ = optimum(found, "time")
    assert S == 8000
    assert feed == pytest.approx(0.020 / np.sin(np.radians(57.5)) * FLUTES * 8000, rel=NEAR)


def test_cheapest_feed_inside_its_range_where_wear_grows_with_the_chip():
    """At one S, cost (r + w) / F with w = B F^(a/n): F^(a/n) = r / (B (a/n - 1)).

    B is what a tool's life costs over the life at F = 1.
    """
    a, n, ref, speed = 0.6, 0.25, 0.05, 9000.0
    taylor = Taylor(n=n, C_m_min=400.0, f_z_exponent=a, f_z_ref_mm=ref)
    found = problem(
        slots(DEPTH), CutLimit(load_N=400.0, feed_mm_min=(20, 5000), speed_rpm=(speed, speed)),
        taylor=taylor,
    )  # fmt: skip
    life_cost = INSIDE * (SIX.price + RATES.tool_change * RATES.per_second)
    load = np.pi * D * speed / 400.0 / (FLUTES * speed * ref) ** a  # v_c (f_z / f_0)^a / C at F = 1
    B = life_cost * load ** (1 / n) / 60
    feed, _, _ = optimum(found, "cost")
    assert feed == pytest.approx((RATES.per_second / (B * (a / n - 1))) ** (n / a), rel=NEAR)
    assert 20 < feed < found.f_z_high.min() * FLUTES * speed * 1e3


def test_least_energy_of_a_slot():
    """(P_base + p_2 n^2 / eta) / n, all else stays with f_z: n = sqrt(eta P_base / p_2)."""
    base, p_2 = 0.4, 0.05
    found = problem(
        slots(DEPTH), CutLimit(load_N=60.0, feed_mm_min=(50, 2000), speed_rpm=(1000, 12000)),
        drive=drive(5.0, base=1000.0, motor_efficiency=0.8, efficiency=0.9,
                    no_load_W=(0.0, 0.0, p_2)),
        energy=EnergyParameters(base_load_kW=base),
    )  # fmt: skip
    feed, S, _ = optimum(found, "energy", Grouping(speeds="own"))  # rapids would turn slower
    assert pytest.approx(60 * np.sqrt(0.8 * 0.9 * base * 1e3 / p_2), rel=NEAR) == S
    assert feed == pytest.approx(load_f_z(60.0) * FLUTES * S, rel=NEAR)


def test_least_wear_is_the_slowest():
    """Wear goes with n^(1/T - 1) at one f_z: slower is always better."""
    found = problem(
        slots(DEPTH), CutLimit(load_N=60.0, feed_mm_min=(10, 2000), speed_rpm=(1000, 12000))
    )
    feed, S, _ = optimum(found, "wear")
    assert S == 1000
    assert feed == pytest.approx(load_f_z(60.0) * FLUTES * 1000, rel=NEAR)


def test_of_speeds_that_take_as_long_the_slowest_is_taken():
    """Above n = F_max / (f_z N) time stays, wear and noise do not."""
    found = problem(
        slots(DEPTH), CutLimit(load_N=60.0, feed_mm_min=(50, 200), speed_rpm=(1000, 12000))
    )
    feed, S, _ = optimum(found, "time")
    assert feed == pytest.approx(200.0, rel=NEAR)
    assert pytest.approx(200.0 / (load_f_z(60.0) * FLUTES), rel=NEAR) == S
