"""Cuts that were proposed are made on simulated mills, and the intervals narrow as promised."""

import os
import sys
from dataclasses import replace
from functools import cache, partial
from multiprocessing import Pool

import numpy as np
import pytest
import yaml
from threadpoolctl import threadpool_limits

import pipeline.shop.cutting.dynamometer as dynamometer
from pipeline.parameters import structure
from pipeline.schema.identity import MachineIdentity
from pipeline.shop.parameters import ShopParameters
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from pipeline.stages.compose import composed
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.cutting.experiments import cut_series
from pipeline.submodels.cutting.settings import CuttingFitSettings, CuttingRecords, CuttingSetup
from pipeline.submodels.cutting.submodel import SUBMODEL, Fitting
from pipeline.submodels.next_recording import by_design
from tests.small_project import ROOT
from tests.submodels.cutting.test_shop_seeds import other_mill

MACHINE = "mill01"


@cache
def _configuration():
    return yaml.safe_load(composed(ROOT / "conf", ("fleet=simulated",)))


def _tests(cuts, tool):
    """Tests of the shop's dynamometer under some conditions, each feed a name of its own."""
    found = []
    for number, cut in enumerate(cuts):
        arc = {(0, 180): "slot", (90, 180): "down", (0, 90): "up"}
        immersion = arc[round(np.degrees(cut.phi_st)), round(np.degrees(cut.phi_ex))]
        conditions = dynamometer.Conditions(
            immersion=immersion, depth=round(1e3 * cut.a_p, 3), speed=round(60 * cut.speed, -2),
            width=tool.diameter / (1 if immersion == "slot" else 2),
            feed=float(round(60e3 * cut.feed) + 1 + number),
        )  # fmt: skip
        found.append(dynamometer.CuttingTest(conditions=conditions))
    return found


def identified(folder, shop, more=()):
    """Model, design and training conditions of a mill that cut its series and some ``more``."""
    section = partial(structure, _configuration())
    own = dynamometer.series
    dynamometer.series = lambda cutting: [*own(cutting), *_tests(more, cutting.tool)]
    try:
        dynamometer.write_dynamometer(folder / "raw", shop)
    finally:
        dynamometer.series = own
    sources = section(f"machine.{MACHINE}.records", tuple[RecordSource, ...])
    identity = section(f"machine.{MACHINE}.identity", MachineIdentity)
    ingest(folder / "raw", folder / "signals", list(sources), identity)
    records = section(f"machine.{MACHINE}.cutting_records", CuttingRecords)
    roles = section(f"machine.{MACHINE}.roles", Roles)
    names = [f"dynamometer/{one.name}.csv" for one in _tests(more, shop.cutting.tool)]
    roles = replace(roles, training=(*roles.training, *names))
    settings = Fitting(
        identity=identity, roles=roles, cutting_records=replace(records, spindle=None),
        cutting=section(f"machine.{MACHINE}.cutting", CuttingSetup),
        cutting_fit=CuttingFitSettings(compare=False),
    )  # fmt: skip
    cases = SUBMODEL.cases(Records(signals=folder / "signals", raw=folder / "raw"), settings, None)
    model = SUBMODEL.fit(cases, settings, folder)
    learnt = {one.case for one in model.trained_on}
    training = [one.load().conditions for one in cases.cases if one.name in learnt]
    (design,) = SUBMODEL.designs(model, cases, settings)
    return design, training


def promised_and_reached(folder, seed):
    """Half width before, promised and reached, of the best and of the worst of the candidates."""
    shop = other_mill(structure(_configuration(), f"machine.{MACHINE}.shop", ShopParameters), seed)
    design, training = identified(folder / f"{seed}", shop)
    if not design.determined.all():
        return []
    series = dict(cut_series(training))
    after = [(design.half_width(one.information), one) for one in design.candidates]
    best, worst = min(after, key=lambda p: p[0]), max(after, key=lambda p: p[0])
    assert by_design(design)[0].record == best[1].record
    rows = []
    for name, (promise, one) in (("best", best), ("worst", worst)):
        cuts = next(cuts for words, cuts in series.items() if one.record.startswith(words))
        anew, _ = identified(folder / f"{seed}-{name}", shop, cuts)
        same = replace(anew, judged=design.judged)
        rows.append((name, seed, design.half_width(), promise, same.half_width()))
    return rows


SEEDS = tuple(map(int, os.environ.get("KERF_NEXT_SEEDS", "1000,1002").split(",")))


@pytest.mark.proof
def test_forces_narrow_on_simulated_mills_as_promised(tmp_path):
    """Mean forces of the judged cuts [N]: half width now, promised and reached, best and worst."""
    with threadpool_limits(1), Pool(2) as pool:
        found = pool.map(partial(promised_and_reached, tmp_path), SEEDS, chunksize=1)
    rows = [row for some in found for row in some]
    assert len(rows) == 2 * len(SEEDS)
    for name, seed, now, promised, reached in rows:
        sys.stdout.write(f"{seed} {name}: {now:.2f} {promised:.2f} {reached:.2f} N\n")
        if name == "best":
            assert 1 / 1.5 < reached / promised < 1.5
            assert reached < now
