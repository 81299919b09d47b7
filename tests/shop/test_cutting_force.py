"""The shop's cutting forces: closed forms, balance of power, true paths, limits."""

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest
from scipy.optimize import brentq

from pipeline.schema.arrays import Floats
from pipeline.shop.cutting.force import (
    Block,
    EdgeCoefficients,
    Motion,
    chip_thickness,
    cut_length,
    edge_coefficients,
    edge_force,
    edges,
    forces,
    pass_forces,
    wear,
)
from pipeline.shop.cutting.parameters import (
    Conditions,
    Cutting,
    EndMill,
    Workpiece,
    engaged,
)
from pipeline.shop.cutting.records import linear_edge, runout

LINEAR = EdgeCoefficients(
    cutting=(800e6, 300e6, 200e6), edge=(20e3, 30e3, 5e3), flank=(0.0, 0.0, 0.0), thickness=1e-4,
    exponent=0.0, ploughing=1e-12,
)  # fmt: skip
ONLY_TANGENTIAL = LINEAR._replace(cutting=(800e6, 0.0, 0.0), edge=(0.0, 0.0, 0.0))
ENDLESS = 1e9
STEPS = 720
"""Of a turn."""


def block(begin: float, end: float, radius: float) -> Block:
    """Material for teeth between the two angles: y = R cos(phi) of the nominal circle."""
    low = -np.inf if end == pi else radius * cos(end)
    high = np.inf if begin == 0 else radius * cos(begin)
    return Block(length=ENDLESS, low=low, high=high)


def turn(
    edge: EdgeCoefficients,
    its: Block,
    radii: np.ndarray,
    lag: np.ndarray,
    height: float,
    f_z: float,
) -> Floats:
    """Forces over one turn in endless material."""
    angle = (np.arange(STEPS) + 0.5) * 2 * pi / STEPS
    feed = np.full(STEPS, f_z * len(radii) / (2 * pi))
    x = 1.0 + angle * feed
    flank = np.zeros((len(radii), 3)) + edge.flank
    return forces(edge, flank, its, radii, np.ones(len(radii)), lag, height, angle, x, feed)


def altintas(
    edge: EdgeCoefficients, flutes: int, depth: float, f_z: float, begin: float, end: float
) -> Floats:
    """Mean forces of the linear-edge model, from the antiderivatives of its integrands over phi."""
    (tc, rc, ac), (te, re, ae) = edge.cutting, edge.edge

    def x(p: float) -> float:
        cut = f_z * (tc * cos(2 * p) / 4 - rc * (p / 2 - sin(2 * p) / 4))
        return cut - te * sin(p) + re * cos(p)

    def y(p: float) -> float:
        cut = f_z * (tc * (p / 2 - sin(2 * p) / 4) + rc * cos(2 * p) / 4)
        return cut - te * cos(p) - re * sin(p)

    def z(p: float) -> float:
        return -ac * f_z * cos(p) + ae * p

    share = flutes * depth / (2 * pi)
    return np.array([share * (f(end) - f(begin)) for f in (x, y, z)])


@pytest.mark.parametrize(("begin", "end"), [(0, pi), (0, pi / 2), (pi / 2, pi), (2.0, pi)])
@pytest.mark.parametrize("flutes", [2, 3, 4])
def test_mean_forces_are_those_of_the_closed_form(flutes, begin, end):
    """Without any of the richer effects: on a circle so large that the trochoid is one.

    2e-3 of the greatest component: steps of half a degree at the engagement's ends.
    """
    radius, depth, f_z, slices = 1.0, 2e-3, 1e-4, 16
    lag = (np.arange(slices) + 0.5) / slices * 0.4
    out = turn(
        LINEAR, block(begin, end, radius), np.full((flutes, slices), radius), lag, depth / slices,
        f_z,
    )  # fmt: skip
    expected = altintas(LINEAR, flutes, depth, f_z, begin, end)
    assert out[:, :3].mean(axis=0) == pytest.approx(expected, abs=2e-3 * np.abs(expected).max())


@pytest.mark.parametrize("ratio", [0.0, 0.3, 3.0])  # runout over feed per tooth: 3 lets teeth miss
def test_power_is_specific_energy_times_what_is_removed(ratio):
    """With only K_tc every removed mm3 takes the same work, whichever tooth removes it.

    The lever of a chip's force is R, that of its middle R - h / 2: apart by h / 2R of the thickest.
    """
    tool = replace(EndMill(), runout=ratio * 60.0, tilt=ratio * 2.0)
    f_z, depth = 60e-6, 2.0
    teeth = edges(tool, depth, 0.125)
    out = turn(ONLY_TANGENTIAL, block(0, pi, 1.0), teeth.radii, teeth.lag, teeth.height, f_z)
    work = out[:, 3].mean() * 2 * pi  # of a turn
    wide = 2 * teeth.radii.max(axis=0).mean()
    removed = wide * depth * 1e-3 * f_z * tool.flutes
    thickest = f_z * (1 if ratio < 1 else tool.flutes)
    assert work == pytest.approx(800e6 * removed, rel=1e-3 + thickest / 2 / tool.radius)


def test_chips_are_those_of_true_paths():
    """Against a root finder on the parametric paths of all earlier teeth.

    2 nm of 20 um and more: the search ends after two rounds.
    """
    random = np.random.default_rng(3)
    feed = 0.25e-3 / (2 * pi)
    radii = 6e-3 + random.uniform(-1, 1, (3, 1)) * 12e-6
    its = Block(length=ENDLESS, low=-np.inf, high=np.inf)
    angles = random.uniform(0, pi, 40)
    found = [chip_thickness(radii, 0, 0, sin(q), cos(q), feed, 1.0, its) for q in angles]
    expected = [
        max(radii[0, 0] - max(reached(q, k, radii[-k % 3, 0], feed) for k in (1, 2, 3)), 0.0)
        for q in angles
    ]
    assert found == pytest.approx(expected, abs=2e-9)
    assert sum(h > 0 for h in found) > 20


def reached(phi: float, back: int, radius: float, feed: float) -> float:
    """How far out on today's radius at ``phi`` the tooth ``back`` teeth earlier came (of three)."""

    def place(turned: float) -> np.ndarray:
        """Of that tooth about today's centre, ``turned`` before now."""
        own = phi + back * 2 * pi / 3 - turned
        return np.array([radius * sin(own) - feed * turned, radius * cos(own)])

    at = back * 2 * pi / 3
    across = np.array([cos(phi), -sin(phi)])
    crossed = brentq(lambda t: float(place(t) @ across), at - 0.3, at + 0.3, xtol=1e-14)
    return float(place(crossed) @ [sin(phi), cos(phi)])


def test_the_edge_grows_from_nothing_and_the_cut_with_its_exponent():
    blunt_edge = edge_coefficients(Workpiece(), 20e-6)
    assert edge_force(blunt_edge, 0.0, 1.0) == (0.0, 0.0, 0.0)
    assert max(edge_force(blunt_edge, 1e-12, 1.0)) < 1.0  # N/m, where a sudden edge has 3e4
    thick = np.array([edge_force(blunt_edge, h, 1.0) for h in (2e-4, 4e-4)])
    edge = np.array(Workpiece().edge) + [0.35 * 330e6 * 20e-6, 330e6 * 20e-6, 0.0]
    assert (thick[1] - edge) / (thick[0] - edge) == pytest.approx(np.full(3, 2**0.92), rel=1e-6)
    sharp, blunt = (edge_force(blunt_edge, 1e-4, s)[1] for s in (0.9, 1.1))
    assert blunt - sharp == pytest.approx(0.2 * Workpiece().edge[1], rel=1e-6)


def test_without_the_richer_effects_the_truth_is_what_was_put_in():
    """A straight line is fitted to a straight line; ploughing is as short as it can be."""
    plain = replace(Workpiece(), exponent=0.0, ploughing=0.01)
    cutting = Cutting(workpiece=plain, tool=replace(EndMill(), tilt=0.0))
    slots = [
        Conditions(immersion="slot", width=12.0, feed=f, speed=4000.0) for f in (360.0, 1440.0)
    ]
    found = linear_edge(cutting, slots, 0.0)
    expected = {"K_tc": 796.0, "K_rc": 169.0, "K_ac": 222.0, "K_te": 27.7, "K_re": 30.8,
                "K_ae": 1.4}  # fmt: skip
    assert found == pytest.approx(expected, rel=1e-3)
    assert runout(cutting, 3.0) == pytest.approx({"runout": 6.5, "runout_angle": 48.0})


def test_the_offset_stands_where_its_angle_says():
    """Without helix, tooth j is 2 pi j / N behind the first: R + rho cos(lambda + 2 pi j / N)."""
    tool = replace(EndMill(), helix=0.0, tilt=0.0, runout=10.0, runout_angle=30.0)
    teeth = edges(tool, 2.0, 0.5)
    expected = 6e-3 + 10e-6 * np.cos(pi / 6 + 2 * pi * np.arange(3) / 3)
    assert teeth.radii == pytest.approx(np.repeat(expected[:, None], 4, axis=1), abs=1e-12)
    tilted = edges(replace(tool, tilt=1.0, tilt_angle=30.0), 2.0, 0.5).radii[0]
    assert np.diff(tilted) == pytest.approx(np.full(3, 0.5e-6 * cos(pi / 6)), abs=1e-12)


@pytest.mark.parametrize("immersion", ["slot", "up", "down"])
def test_a_pass_goes_from_air_into_the_cut_and_out(immersion):
    tool, work = EndMill(), Workpiece()
    c = Conditions(immersion=immersion, depth=2.0, width=6.0 if immersion != "slot" else 12.0,
                   feed=1440.0, speed=4000.0)  # fmt: skip
    per_turn, length = c.feed / c.speed, 40.0
    turns = int((length + 14) / per_turn)
    angle = np.arange(turns * 90) * 2 * pi / 90
    x = -7.0 + angle / (2 * pi) * per_turn
    out = pass_forces(
        c,
        tool,
        work,
        Motion(angle=angle, x=x * 1e-3),
        flank=work.flank(0.0),
        length=length,
        slice_height=0.5,
    )
    torque = out[:, 3].reshape(turns, 90).mean(axis=1)
    way = x.reshape(turns, 90).mean(axis=1)
    steady = torque[(way > 1) & (way < length - 7)]
    assert np.ptp(steady) < 0.02 * steady.mean()
    assert not torque[way < -6.2].any() and not torque[way > length + 0.4].any()
    entry = torque[(way > -6) & (way < 0)]
    assert (np.diff(entry) > -0.02 * steady.mean()).all() and entry[0] < 0.3 * steady.mean()


def test_engagement_and_wear_have_their_limits():
    slot = Conditions(immersion="slot", width=12.0, speed=6000.0, feed=600.0)
    assert engaged(slot, 12.0) == pytest.approx((0, pi))
    assert engaged(replace(slot, immersion="up", width=6.0), 12.0) == pytest.approx((0, pi / 2))
    assert engaged(replace(slot, immersion="down", width=3.0), 12.0) == pytest.approx(
        (2 * pi / 3, pi)
    )
    # 100 mm at 0.1 mm a turn: 1000 half turns of 6 mm
    assert cut_length(slot, EndMill(), 100.0) == pytest.approx(6 * pi)
    tool = EndMill()
    lengths = np.linspace(0, 500, 40)
    worn = np.array([wear(tool, length) for length in lengths])
    assert worn[0] == 0 and (np.diff(worn) > 0).all()
    assert worn[-1] - worn[-2] == pytest.approx(0.05e-6 * (lengths[1] - lengths[0]), rel=1e-6)
