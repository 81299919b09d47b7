"""A cut with a tool that gives way: below the depth of chatter each tooth vibrates as the last."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest

from pipeline.cutting.stability.semi_discretisation import RegenerativeCut
from pipeline.cutting.stability.tip_dynamics import Mode
from pipeline.shop.cutting.parameters import Dynamometer, EndMill, Workpiece
from pipeline.shop.parameters import Cutting, ShopParameters
from pipeline.shop.trial.cutting import Chance
from pipeline.shop.trial.job import TrialJob
from pipeline.shop.trial.trials import prepare
from tests.cutting.chatter import integrated_limit
from tests.shop.tip_chatter import TipMode, unrepeated

STEADY = ShopParameters(
    machine="trial", cutting=Cutting(dynamometer=Dynamometer(speed_error=0.0, speed_wander=0.0))
)
LINEAR = Workpiece(
    tangential=600.0, radial=200.0, axial=0.0, exponent=0.0, edge_tangential=0.0,
    edge_radial=0.0, edge_axial=0.0,
)  # fmt: skip
BLANK = (0.0, 40.0, 0.0, 30.0, -12.0, 0.0)
DIAMETER = 10.0
TIP = TipMode(direction="y", frequency=922.0, damping=0.03, stiffness=5e5)


def even(flutes: int, helix: float = 0.0) -> EndMill:
    """A tool without runout or wear."""
    return EndMill(
        number=1, diameter=DIAMETER, flutes=flutes, helix=helix, runout=0.0, tilt=0.0,
        sharpness=(1.0,) * flutes, break_in=0.0, wear_rate=0.0,
    )  # fmt: skip


def shares(text: str, tool: EndMill, modes, workpiece=LINEAR) -> dict[int, float]:
    job = TrialJob(
        blank=BLANK, limit_load_N=1e4, tools={1: tool}, workpiece=workpiece, lengths={1: 0.0}
    )
    its = prepare(text, "P", job, STEADY)
    part = Chance(
        workpiece=workpiece, tools={1: tool}, used={1: 0.0}, deeper={1: 0.0}, speed_error=0.0,
        angle=0.3,
    )  # fmt: skip
    return unrepeated(its.track, its.swept, part, STEADY, {1: modes}, np.random.default_rng(0))


def side_cut(depth_mm: float, width: float, speed: float, feed: float) -> str:
    """Along the wall at y = 0, which lies to the left of the feed: up-milling, line 5."""
    return (
        f"G21 G90 G54\nG0 X-20 Y{width - DIAMETER / 2:.6f} S{speed:g} M3\nZ5\n"
        f"G1 Z{-depth_mm:.6f} F2000\nX60 F{feed:g}\nG0 Z5\nM30\n"
    )


STABLE, CHATTER = 0.25, 0.4
"""Share of the vibration that differs from tooth to tooth."""


@pytest.mark.parametrize(
    ("rpm", "immersion", "flutes"),
    [
        (12_000.0, 0.1, 2),
        pytest.param(17_000.0, 0.1, 2, marks=pytest.mark.proof),
        (9_000.0, 1.0, 3),
    ],
)
def test_chatter_begins_at_the_depth_of_the_delayed_equation(rpm, immersion, flutes):
    """10 % below it and 15 % above, where vibration grows until teeth leave the material.

    At a thin chip: the tip stands off by as much as a part of a 1 mm immersion all the same, and
    close below the limit a vibration is long in dying.
    """
    cut = RegenerativeCut(
        K_tc=6e8, K_rc=2e8, flutes=flutes, entry=0.0,
        exit=float(np.arccos(1 - 2 * immersion)) if immersion < 1 else pi,
    )  # fmt: skip
    mode = Mode(
        direction=TIP.direction, natural_frequency_Hz=TIP.frequency, damping=TIP.damping,
        stiffness_N_m=TIP.stiffness,
    )  # fmt: skip
    limit = integrated_limit([mode], cut, rpm / 60, 2e-3)
    assert limit < 8e-3
    width = immersion * DIAMETER if immersion < 1 else 15.0 + DIAMETER / 2
    found = [
        shares(side_cut(share * limit * 1e3, width, rpm, 0.01 * flutes * rpm), even(flutes), [TIP])
        for share in (0.9, 1.15)
    ]
    assert found[0][5] < STABLE and found[1][5] > CHATTER


def test_a_line_too_short_to_settle_is_left_out():
    text = side_cut(1.0, 1.0, 12_000.0, 2400.0).replace("X60 F", "X1 F2400\nX1.2 F")
    assert 6 not in shares(text, even(2), [TIP])


def test_a_soft_tip_chatters_where_a_stiff_one_does_not():
    text = side_cut(4.0, 1.0, 12_000.0, 2400.0)
    stiff, soft = (shares(text, even(2), [replace(TIP, stiffness=k)])[5] for k in (1e8, 2e5))
    assert stiff < STABLE and soft > CHATTER
