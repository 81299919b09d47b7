"""Page of spindle growth: what it says of the first hour, sensors, methods; what it draws."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.charts.sections import SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.nets.ffnn import FuzzyFilteredNetwork
from pipeline.nets.settings import FuzzyFilteredSettings
from pipeline.schema.verdict import Fact
from pipeline.submodels.contract import Shown
from pipeline.submodels.deformation import figures
from pipeline.submodels.deformation.figures import FAULT, GrowthFacts
from pipeline.submodels.deformation.model import WARMING
from pipeline.submodels.deformation.sensors import DEAD, DRIFTING, Fault
from pipeline.submodels.deformation.submodel import SUBMODEL
from tests.submodels.deformation.test_submodel import Built, build, recordings
from tests.submodels.made_pages import drawn, held_to_golden, made, tables, words


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Built:
    found = recordings()
    found["p10"].temperatures[40:, 1] = 850.0
    found["p11"].temperatures[:, 1] = 850.0
    return build(tmp_path_factory.mktemp("page"), found)


def shown(built: Built, **changes: Any) -> Shown:
    whole: Shown = Shown(
        machine="rig", origin="simulated", shelf=SourceRegistry(), folder=built.folder,
        signals=built.signals, model=built.model, verdict=built.verdict,
        predictions=built.predictions,
    )  # fmt: skip
    return replace(whole, **changes)


def with_status(built: Built, status: str, *reasons: str) -> Shown:
    return shown(built, verdict=replace(built.verdict, status=status, reasons=reasons))


def page(one: Shown) -> SubModelPage:
    return made(SUBMODEL, one)


def test_the_page_is_the_golden_one(built):
    held_to_golden(page(with_status(built, "passed")), Path(__file__).with_name("page.txt"))


def test_the_first_hour_is_that_of_the_largest_growth_with_its_interval(built):
    rows = built.predictions
    rows = rows[(rows["quantity"] == "growth") & (rows["regime"] == "") & (rows["t"] <= 3600)]
    top = rows.loc[rows["predicted"].idxmax()]
    said = words(page(with_status(built, "passed")))
    assert f"grows by up to {top['predicted']:.0f} µm" in said
    assert f"interval {top['low']:.0f} to {top['high']:.0f} µm" in said


def test_an_interval_that_the_judge_calls_not_known_is_no_number(built):
    scores = tuple(
        replace(s, unknown_interval="3 training cases") if (s.quantity, s.regime) == ("growth", "")
        else s for s in built.verdict.scores
    )  # fmt: skip
    found = page(shown(built, verdict=replace(built.verdict, scores=scores, status="passed")))
    assert any("90 % interval not known" in aside for *_, aside in found.key_figures)


@pytest.mark.parametrize(("status", "offered"), [("passed", True), ("failed", False)])
def test_only_a_model_that_passed_offers_the_correction(built, status, offered):
    said = page(with_status(built, status, "too little was recorded")).verdict
    assert said is not None and said.status == status
    assert ("(kerf thermal-growth --machine rig --out FILE)" in said.todo) == offered
    assert bool(re.search(r"Warm up for \d+\smin", said.todo)) == offered


def test_a_model_that_failed_promises_nothing_about_the_rest_of_the_hour(built):
    found = page(with_status(built, "failed", "too little was recorded"))
    (warm,) = (one for one in found.actions if one.where == "Spindle")
    assert "measure what it then still grows" in warm.what and "moves less than" not in warm.what
    assert "That model failed" in warm.why


def test_a_faulty_sensor_has_its_minute_its_cost_and_its_place(built):
    found = page(with_status(built, "passed"))
    note = found.notes[0].replace("\u00a0", " ").replace("\u202f", "")
    assert re.search(
        r"temperature_2 is dead since an unknown date, minute 4\d of the recording p10", note
    )
    costs = re.search(r"off by up to (\d+) µm; .* off by up to ([\d.]+) µm", note)
    assert costs is not None and float(costs[1]) > 2 * float(costs[2])
    row = tables(found)["Faulty temperature sensors"][0]
    place = "nose of the housing, sensor 2 of 5 from the front"
    assert row[:4] == ["temperature_2", place, "dead", "p10"]


def test_a_drifting_sensor_is_named_with_its_side_and_the_date_of_its_recording(built, tmp_path):
    """The sign is of the largest departure; the date is that of the recording's clock."""
    case = max(built.verdict.cases, key=lambda one: one.case)
    fault = Fault(sensor="temperature_3", kind=DRIFTING, since_s=2580.0, departure_K=-3.2)
    facts = {"faulty sensor": Fact(value=fault.sentence)}
    verdict = replace(built.verdict, status="passed", cases=(replace(case, facts=facts),))
    files = {case.case: {"first": "2026-03-02T06:00:00Z"}}
    (tmp_path / "manifest.json").write_text(json.dumps({"files": files}))
    found = page(shown(built, verdict=verdict, signals=tmp_path))
    (sensor,) = (one for one in found.actions if "(temperature_3)" in one.where)
    words = sensor.why.replace("\u00a0", " ")
    assert "drifting, reads up to 3.2 K too low since Mon 2 Mar 2026, 06:43 UTC, minute 43" in words


@pytest.mark.parametrize("departure", [None, 3.2, -3.2])
def test_faults_are_read_as_the_verdict_words_them(departure):
    kind = DEAD if departure is None else DRIFTING
    fault = Fault(sensor="front bearing", kind=kind, since_s=2580.0, departure_K=departure)
    match = FAULT.fullmatch(fault.sentence)
    assert match is not None and match["sensor"] == "front bearing" and match["kind"] == kind
    assert float(match["minute"]) == 43
    assert (match["departure"] and float(match["departure"])) == departure


def test_temperatures_growth_error_and_speed_are_drawn_below_one_another(built):
    whole = next(svg for caption, svg in drawn(page(shown(built))).items()
                 if caption.startswith("Worst recording"))  # fmt: skip
    for head in ("Growth, µm", "Predicted less measured, µm", "Temperatures, °C", "Spindle speed"):
        assert head in whole
    assert 's-band"' in whole
    alone = drawn(page(shown(built, signals=None)))
    assert not any("Temperatures" in svg for svg in alone.values())


def test_bands_of_the_network_are_those_that_it_filters_with():
    import torch

    net = FuzzyFilteredNetwork(FuzzyFilteredSettings(), 9, 3)
    net.set_bands(torch.tensor([[1.0, 0.5], [4.0, 1.5], [7.5, 3.0]], dtype=torch.float64))
    document = {"state": {"places": net.places.tolist()}}
    bands = figures.network_bands(document, 9)
    expected = net.memberships(net.bands).detach().numpy()
    assert figures.gaussian(np.arange(9.0), bands) == pytest.approx(expected)


def test_runs_of_a_regime_begin_where_it_does(built):
    rows = built.predictions
    rows = rows[(rows["regime"] == WARMING) & (rows["quantity"] == "growth")
                & (rows["role"] == "held_out")]  # fmt: skip
    runs = GrowthFacts(shown=shown(built)).runs(WARMING)
    assert runs and all(t[0] == 0 and np.allclose(np.diff(t), 60.0) for t, _ in runs)
    assert sum(len(t) for t, _ in runs) <= len(rows)


def test_errors_after_a_start_are_quantiles_of_all_starts():
    time = 60.0 * np.arange(12)
    runs = [(time, np.full(12, float(level))) for level in (-1, 0, 1)]
    found = figures.transitions(runs)
    assert found is not None and found.count == 3
    assert found.middle.tolist() == [0.0, 0.0, 0.0] and found.widest == 1.0
    assert figures.transitions(runs[:2]) is None
