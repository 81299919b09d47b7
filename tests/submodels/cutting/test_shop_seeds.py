"""Intervals of the coefficients against the simulated shop's truth, over other chances.

The shop's machine is richer than the model: wear that grows over the series, tilt, a bent edge law,
teeth of different sharpness, crosstalk.  ``KERF_CUT_SEEDS=100 pytest -s`` on this file prints how
often each interval holds the truth.
"""

import os
import sys
from collections import Counter
from dataclasses import replace
from functools import partial
from multiprocessing import Pool

import pytest
import yaml
from threadpoolctl import threadpool_limits

from pipeline.parameters import structure
from pipeline.schema.identity import MachineIdentity
from pipeline.shop.cutting.dynamometer import write_dynamometer
from pipeline.shop.cutting.records import dynamometer_truth
from pipeline.shop.parameters import ShopParameters
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from pipeline.stages.compose import composed
from pipeline.submodels.cases import Roles, role_of
from pipeline.submodels.cutting.coefficients import parameters
from pipeline.submodels.cutting.identify import identify_cutting_force
from pipeline.submodels.cutting.recordings import read_recordings
from pipeline.submodels.cutting.settings import CuttingFitSettings, CuttingRecords, CuttingSetup
from tests.small_project import ROOT

SEEDS = int(os.environ.get("KERF_CUT_SEEDS", "2"))
COEFFICIENTS = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
FIRST = 1000


def held(machine, folder, seed):
    """Names of the parameters whose interval holds the truth, and all that were determined."""
    values = yaml.safe_load(composed(ROOT / "conf", ("fleet=simulated",)))
    section = partial(structure, values)
    shop = replace(section(f"machine.{machine}.shop", ShopParameters), seed=seed)
    raw, signals = folder / f"raw-{seed}", folder / f"signals-{seed}"
    truth = dynamometer_truth(shop.cutting, write_dynamometer(raw, shop))
    sources = section(f"machine.{machine}.records", tuple[RecordSource, ...])
    ingest(raw, signals, list(sources), section(f"machine.{machine}.identity", MachineIdentity))
    known = section(f"machine.{machine}.cutting", CuttingSetup)
    roles = section(f"machine.{machine}.roles", Roles)
    settings = CuttingFitSettings(compare=False)
    records = section(f"machine.{machine}.cutting_records", CuttingRecords)
    recordings = read_recordings(
        signals, records, known, settings, lambda name: role_of([name], roles)
    )
    found = identify_cutting_force(recordings, known, settings)
    waveform = parameters(found.fit, found.uncertainty, settings.widest, found.mean_force)
    inside, determined = [], []
    for method, some in (("waveform", waveform), ("mean force", found.mean_force)):
        for one in some:
            if one.name not in (*COEFFICIENTS, "runout") or one.half_width is None:
                continue
            determined.append((method, one.name))
            true = truth["parameters"][one.name]
            if abs(one.value - true) <= one.half_width:
                inside.append((method, one.name))
    return inside, determined


@pytest.mark.proof
@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_intervals_hold_the_truth_of_the_shop(machine, tmp_path):
    with threadpool_limits(1), Pool(2) as pool:
        found = pool.map(partial(held, machine, tmp_path), range(FIRST, FIRST + SEEDS), chunksize=1)
    inside = Counter(name for some, _ in found for name in some)
    determined = Counter(name for _, some in found for name in some)
    lines = [f"{machine} {method} {name}: {inside[method, name]} of {n}\n" for (method, name), n in
             sorted(determined.items())]  # fmt: skip
    sys.stdout.writelines(lines)
    names = [("waveform", k) for k in COEFFICIENTS]
    assert all(name in determined for name in names)
    assert sum(inside[n] for n in names) >= 0.9 * sum(determined[n] for n in names)
