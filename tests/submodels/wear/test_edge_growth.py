"""Growth of edge forces with wear, held against the force law of the shop, which is richer."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.cutting.force.force_law import regressors
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.wear.due import EDGE, EDGE_NAMES, fit_edge_growth, mean_forces
from pipeline.submodels.wear.life import engaged
from tests.submodels.wear.shop_lives import (
    followed,
    life_settings,
    mean_force,
    parameters,
    tools,
    windows,
)

MACHINES = pytest.mark.parametrize("machine", ["mill01", "mill02"])
SLOPES = (180.0, 520.0)
"""Tangential and radial, of the made records [N/mm2]."""


def made(machine: str, *, relative: float, growth: tuple[float, float] = SLOPES) -> WearWindows:
    """Records of the machine's cuts with forces of a linear-edge law and errors in per cent."""
    found = windows(machine, 2, tools(machine, training=True))
    cuts = engaged(found, life_settings(machine))
    design = regressors(
        flutes=cuts.flutes, f_z=cuts.f_z, a_p=cuts.a_p, phi_st=cuts.phi_st, phi_ex=cuts.phi_ex
    )[:, :2]
    sharp = design @ np.array([2e9, 0.9e9, 0.0, 30e3, 45e3, 0.0])
    land = design[:, :, list(EDGE)] @ (np.array(growth) * 1e6)
    force = sharp + land * (found.wear * 1e-6)[:, None]
    random = np.random.default_rng(4)
    force *= 1 + relative * random.standard_normal((len(force), 1))
    return replace(found, values=-np.repeat(force[:, :, None], 4, axis=2).astype(np.float32))


@MACHINES
def test_a_linear_law_is_recovered(machine: str) -> None:
    settings = life_settings(machine)
    exact = fit_edge_growth(made(machine, relative=0.0), settings)
    noisy = fit_edge_growth(made(machine, relative=0.05), settings)
    for name, true in zip(EDGE_NAMES, SLOPES, strict=True):
        assert exact.parameters[name].value == pytest.approx(true, rel=1e-4)
        low, high = noisy.parameters[name].interval_95 or (np.nan, np.nan)
        assert low < true < high


def test_without_growth_it_is_not_determined_and_says_what_to_record() -> None:
    flat = made("mill01", relative=0.05, growth=(0.0, 0.0))
    found = fit_edge_growth(flat, life_settings("mill01"))
    assert not any(one.determined for one in found.parameters.values())
    assert "from new to worn" in found.parameters["K_te_over_VB"].remedy


def test_a_record_that_shows_half_of_a_cut_does_not_count() -> None:
    settings = life_settings("mill01")
    found = made("mill01", relative=0.02)
    values = found.values.copy()
    values[7] *= 0.3  # of one window a record: an exit that is all partial
    spoilt = fit_edge_growth(replace(found, values=values), settings)
    clean = fit_edge_growth(found, settings)
    for name in EDGE_NAMES:
        one, other = spoilt.parameters[name], clean.parameters[name]
        assert one.value == pytest.approx(other.value, rel=0.1)


def test_windows_of_the_way_into_the_material_are_left_out() -> None:
    settings = life_settings("mill01")
    whole = made("mill01", relative=0.0)
    half = replace(whole, values=0.4 * whole.values)
    both = WearWindows.joined([whole, half])
    np.testing.assert_allclose(
        mean_forces(both, settings).force, mean_forces(whole, settings).force, rtol=1e-6
    )


@MACHINES
def test_the_shops_growth_lies_in_the_interval(machine: str) -> None:
    """What a linear-edge law should recover of the shop's: its own forces of the same cuts, sharp
    and with each record's wear on all teeth, of usual material and depth, without chance."""
    settings, seed = life_settings(machine), 2
    some = tools(machine, training=True)
    found = fit_edge_growth(windows(machine, seed, some, forces=True, every=2), settings)
    true = fit_edge_growth(_plain(machine, seed, some), settings)
    for name in EDGE_NAMES:
        low, high = found.parameters[name].interval_95 or (np.nan, np.nan)
        value = true.parameters[name].value
        assert value is not None and low < value < high
        assert high - low < value  # and it says something
    pressure = parameters(machine, seed).wear.workpiece.flank_pressure
    radial = true.parameters["K_re_over_VB"].value
    assert radial is not None and 0.7 * pressure < radial < pressure  # thin chips press less


def _plain(machine: str, seed: int, some: list[str]) -> WearWindows:
    """The same records without chance: forces of the shop's law at the mean land."""
    p = parameters(machine, seed)
    wear = replace(p.wear, depth_error=0.0)
    parts = []
    for tool in some:
        one, life = windows(machine, seed, [tool], every=3), followed(machine, seed, tool)
        mean = np.repeat(life.land.mean(axis=1, keepdims=True), life.land.shape[1], axis=1)
        even = replace(
            life, hardness=np.ones(life.hardness.size), land=mean,
            tool=replace(life.tool, mill=replace(life.tool.mill, runout=0.0, tilt=0.0)),
        )  # fmt: skip
        rows = range(0, life.times.size, 3)
        force = [mean_force(wear, even, k, np.random.default_rng(1)) for k in rows]
        values = -np.repeat(np.array(force)[:, :, None], 4, axis=2).astype(np.float32)
        parts.append(replace(one, values=values, wear=mean[::3, 0]))
    return WearWindows.joined(parts)
