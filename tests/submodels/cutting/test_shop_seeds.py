"""Intervals of coefficients and forces against the truth of simulated mills, one a seed.

The shop's mills are richer than the model: wear that grows over the series, tilt, a bent edge law,
teeth of different sharpness, crosstalk; and each seed is another one (:func:`other_mill`), for on
one mill alone a bent law is off by the same in every chance.  ``KERF_CUT_SEEDS=100 pytest -s``
on this file prints how often each interval holds the truth, with all training recordings and with
two feeds of a slot.

The true coefficients are those of the straight line through the shop's own edge force over the
range of feeds that :func:`named_range` widens the learnt ones to, with the mean wear of the
recordings that were learnt from.
"""

import os
import random
import sys
from collections import Counter
from dataclasses import replace
from functools import cache, partial
from multiprocessing import Pool
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.stats import binom
from threadpoolctl import threadpool_limits

from pipeline.parameters import structure
from pipeline.schema.identity import MachineIdentity
from pipeline.shop.cutting.dynamometer import write_dynamometer
from pipeline.shop.cutting.records import linear_edge, runout
from pipeline.shop.parameters import ShopParameters
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from pipeline.stages.compose import composed
from pipeline.submodels.cases import Roles, role_of
from pipeline.submodels.cutting.coefficients import parameters
from pipeline.submodels.cutting.identify import identify_cutting_force
from pipeline.submodels.cutting.law_draws import named_range
from pipeline.submodels.cutting.recordings import cut_harmonics, read_recordings
from pipeline.submodels.cutting.revolution import wave
from pipeline.submodels.cutting.settings import CuttingFitSettings, CuttingRecords, CuttingSetup
from pipeline.submodels.cutting.spread import (
    ANGLES,
    force_levels,
    half_widths,
    magnitude,
    wave_half_widths,
)
from tests.small_project import ROOT


def other_mill(shop, seed):
    """Parameters of ``shop`` with everything drawn that a cutting test does not know."""
    random = np.random.default_rng(seed)
    cutting, draw = shop.cutting, random.uniform
    tangential = float(np.exp(draw(np.log(600), np.log(3000))))
    edge = draw(10, 50)
    workpiece = replace(
        cutting.workpiece, tangential=tangential, radial=tangential * draw(0.2, 0.5),
        axial=tangential * draw(0.1, 0.3), exponent=draw(0.0, 0.25), edge_tangential=edge,
        edge_radial=edge * draw(0.8, 2.0), edge_axial=draw(-2, 6),
        ploughing=float(np.exp(draw(np.log(1), np.log(12)))), flank_pressure=draw(200, 900),
        flank_friction=draw(0.3, 0.5),
    )  # fmt: skip
    sharpness = 1 + random.normal(0, 0.1, cutting.tool.flutes).clip(-0.25, 0.25)
    tool = replace(
        cutting.tool, runout=draw(1, 12), runout_angle=draw(-180, 180), tilt=draw(0, 1),
        tilt_angle=draw(-180, 180), sharpness=tuple((sharpness / sharpness.mean()).tolist()),
        break_in=draw(3, 20),
    )  # fmt: skip
    dynamometer = replace(
        cutting.dynamometer, offset=draw(0.5, 5.0), crosstalk=draw(0.005, 0.02),
        depth_error=draw(4, 15), range=4000.0,
    )  # fmt: skip
    other = replace(cutting, workpiece=workpiece, tool=tool, dynamometer=dynamometer)
    return replace(shop, seed=seed, cutting=other)


SEEDS = int(os.environ.get("KERF_CUT_SEEDS", "2"))
COEFFICIENTS = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
FIRST = 1000


TWO = {"mill01": ("f360ap2.", "f960ap2."), "mill02": ("f240ap1.", "f480ap1.")}
"""Two feeds of a slot, by machine."""
NORMAL_90 = 1.645 / 1.96
"""Half of a 90 % interval over that of a 95 % one [1]."""


@cache
def _configuration():
    return yaml.safe_load(composed(ROOT / "conf", ("fleet=simulated",)))


def held(machine, two, folder, seed):
    """Names of the quantities whose 90 % interval holds the truth, and all that were determined."""
    section = partial(structure, _configuration())
    shop = other_mill(section(f"machine.{machine}.shop", ShopParameters), seed)
    raw, signals = folder / f"raw-{seed}", folder / f"signals-{seed}"
    recorded = write_dynamometer(raw, shop)
    sources = section(f"machine.{machine}.records", tuple[RecordSource, ...])
    ingest(raw, signals, list(sources), section(f"machine.{machine}.identity", MachineIdentity))
    known = section(f"machine.{machine}.cutting", CuttingSetup)
    roles = section(f"machine.{machine}.roles", Roles)
    settings = CuttingFitSettings(compare=False)
    records = section(f"machine.{machine}.cutting_records", CuttingRecords)

    def role(name):
        found = role_of([name], roles)
        few = two and not ("slot" in name and any(feed in name for feed in TWO[machine]))
        return "held_out" if few and found == "training" else found

    recordings = read_recordings(signals, records, known, settings, role)
    found = identify_cutting_force(recordings, known, settings)
    truth = true_line(shop.cutting, recorded, found.training)
    depth = 1e3 * float(np.mean([one.cut[0].a_p for one in found.training]))
    truth |= {"runout": runout(shop.cutting, depth)["runout"]}
    waveform = parameters(
        found.fit, found.uncertainty, found.not_sharp, settings.widest, found.mean_force
    )
    inside, determined = [], []
    for method, some in (("waveform", waveform), ("mean force", found.mean_force)):
        for one in some:
            if one.name not in (*COEFFICIENTS, "runout") or one.half_width is None:
                continue
            determined.append((method, one.name))
            off = abs(one.value - truth[one.name])
            inside += [(method, one.name)] if off <= NORMAL_90 * one.half_width else []
            wider = [(f"{method} 95", one.name)]
            determined += wider
            inside += wider if off <= one.half_width else []
    for one in recordings:
        if one.is_training or one.revolution is None:
            continue
        for name, share in _shares(found, cut_harmonics(one, settings)):
            determined.append(("force", name))
            inside += [("force", name)] if share else []
    return inside, determined


def true_line(cutting, recorded, training):
    """The six coefficients over the named range, at the mean wear of the training recordings."""
    files = {Path(one["file"]).stem: one for one in recorded.files}
    mine = [next(f for stem, f in files.items() if stem in one.name) for one in training]
    VB = sum(one["true"]["wear_um"] for one in mine) / len(mine) * 1e-6
    each = [one.cut[0] for one in training]
    arcs = {(c.phi_st, c.phi_ex): f["settings"] for c, f in zip(each, mine, strict=True)}
    flutes = cutting.tool.flutes
    named = [
        replace(arcs[c.phi_st, c.phi_ex], speed=60 * c.speed,
                feed=c.f_z * 1e3 * flutes * 60 * c.speed)
        for c in named_range(each)
    ]  # fmt: skip
    return linear_edge(cutting, named, VB)


def _shares(found, cut):
    """Whether the intervals of peak and mean hold what was measured, and most of each channel."""
    model, spread = found.model, found.model.spread
    levels = force_levels(model, cut.conditions, cut.harmonics)
    real = magnitude(cut.lines)
    for name, level, half, true in zip(
        ("peak", "mean"), levels, half_widths(spread, levels), (real.max(), real.mean()),
        strict=True,
    ):  # fmt: skip
        yield name, abs(level.value - true) <= half
    angle = random.Random(cut.conditions.feed).randrange(
        ANGLES
    )  # one angle a recording: its neighbours err alike
    half = wave_half_widths(model, cut)[angle]
    off = wave(cut.lines - model.beside(cut), np.array([2 * np.pi * angle / ANGLES]))[0]
    for name, close in zip(("along", "across", "axial"), np.abs(off) <= half, strict=True):
        yield name, bool(close)


def within(inside, count, nominal=0.9, tolerated=0.05):
    """Whether a share is as nominal within what is tolerated and what so many draws err (99 %)."""
    low, high = max(nominal - tolerated, 0.0), min(nominal + tolerated, 1.0)
    least, most = binom.ppf(0.005, count, low), binom.ppf(0.995, count, high)
    return least <= inside <= most


@pytest.mark.proof
@pytest.mark.parametrize("two", [False, True])
@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_intervals_hold_the_truth_of_the_shop(machine, two, tmp_path):
    with threadpool_limits(1), Pool(2) as pool:
        found = pool.map(
            partial(held, machine, two, tmp_path), range(FIRST, FIRST + SEEDS), chunksize=1
        )
    inside = Counter(name for some, _ in found for name in some)
    determined = Counter(name for _, some in found for name in some)
    of = f"{machine} two feeds" if two else machine
    lines = [f"{of} {' '.join(name)}: {inside[name]} of {n}\n"
             for name, n in sorted(determined.items())]  # fmt: skip
    sys.stdout.writelines(lines)
    names = [(method, k) for method in ("waveform", "mean force") for k in COEFFICIENTS]
    names += [("waveform", "runout")]
    names += [("force", k) for k in ("peak", "mean", "along", "across", "axial")]
    assert all(name in determined for name in names)
    off = [" ".join(n) for n in names if not within(inside[n], determined[n])]
    wider = [(f"{method} 95", k) for method, k in names if method != "force"]
    off += [" ".join(n) for n in wider if not within(inside[n], determined[n], 0.95)]
    assert not off, f"{of}: not as nominal: {', '.join(off)}"
