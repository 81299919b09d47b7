"""Page of spindle growth: what it says of the first hour, sensors, methods; what it draws."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.charts.sections import Figures, SubModelPage
from pipeline.charts.sources import SourceRegistry
from pipeline.charts.tables import Table
from pipeline.nets.ffnn import FuzzyFilteredNetwork
from pipeline.nets.settings import FuzzyFilteredSettings
from pipeline.schema.verdict import Fact
from pipeline.submodels.contract import Shown
from pipeline.submodels.deformation import figures
from pipeline.submodels.deformation.growth_facts import FAULT, GrowthFacts
from pipeline.submodels.deformation.model import WARMING
from pipeline.submodels.deformation.sensors import DEAD, DRIFTING, Fault
from pipeline.submodels.deformation.submodel import SUBMODEL
from tests.submodels.deformation.test_submodel import Built, build, recordings


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
    found = SUBMODEL.page(one)
    assert isinstance(found, SubModelPage)
    return found


def tables(found: SubModelPage) -> dict[str, Table]:
    return {b.caption: b for s in found.sections for b in s.blocks if isinstance(b, Table)}


def drawn(found: SubModelPage) -> list[str]:
    return [str(f.svg) for s in found.sections for b in s.blocks
            if isinstance(b, Figures) for f in b.figures]  # fmt: skip


def test_the_sentence_holds_the_largest_growth_of_a_first_hour_and_its_interval(built) -> None:
    rows = built.predictions
    rows = rows[(rows["quantity"] == "growth") & (rows["regime"] == "") & (rows["t"] <= 3600)]
    top = rows.loc[rows["predicted"].idxmax()]
    said = page(with_status(built, "passed")).verdict
    assert said is not None and said.status == "passed"
    words = said.sentence.replace("\u00a0", " ")
    assert f"grows by up to {top['predicted']:.0f} µm" in words
    assert f"interval {top['low']:.0f} to {top['high']:.0f} µm" in words


def test_an_interval_that_the_judge_calls_not_known_is_no_number(built) -> None:
    scores = tuple(
        replace(s, unknown_interval="3 training cases") if (s.quantity, s.regime) == ("growth", "")
        else s for s in built.verdict.scores
    )  # fmt: skip
    found = page(shown(built, verdict=replace(built.verdict, scores=scores, status="passed")))
    assert found.verdict is not None
    assert "(90 % interval not known)" in found.verdict.sentence
    assert any("90 % interval not known" in aside for *_, aside in found.key_figures)


def test_a_model_that_passed_offers_warming_up_or_the_correction(built) -> None:
    said = page(with_status(built, "passed")).verdict
    assert said is not None
    assert re.search(r"Warm up for \d+\smin", said.todo)
    assert "(kerf compensation --machine rig --out FILE)" in said.todo
    assert "arm up" not in said.sentence


@pytest.mark.parametrize("status, page_status", [("failed", "failed"), ("not judged", "unknown")])
def test_a_model_that_did_not_pass_offers_no_correction(built, status, page_status) -> None:
    said = page(with_status(built, status, "too little was recorded")).verdict
    assert said is not None and said.status == page_status
    assert "kerf compensation" not in said.todo and "too little was recorded" in said.sentence


def test_a_model_that_failed_promises_nothing_about_the_rest_of_the_hour(built) -> None:
    found = page(with_status(built, "failed", "too little was recorded"))
    (warm,) = (one for one in found.actions if one.where == "Spindle")
    assert "measure what it then still grows" in warm.what and "moves less than" not in warm.what
    assert "That model failed" in warm.why


def test_a_faulty_sensor_is_named_with_since_when_cost_and_what_to_do(built) -> None:
    found = page(with_status(built, "passed"))
    assert found.verdict is not None
    sensor = next(one for one in found.actions if one.where.startswith("temperature_2 ("))
    assert sensor.where == "temperature_2 (nose of the housing, sensor 2 of 5 from the front)"
    assert sensor.what == "Reconnect or replace the sensor" and sensor.who == "maintenance"
    assert sensor.why.startswith("It is dead since p10")
    assert sensor.until == "next stop" and "The model does without it." in sensor.why
    assert sensor.evidence in {section.key for section in found.sections}
    assert "(not dated)" in sensor.why and "last in p11" in sensor.why
    note = found.notes[0].replace("\u00a0", " ").replace("\u202f", "")
    assert re.search(r"temperature_2 is dead since p10, minute 4\d", note)
    costs = re.search(r"off by up to (\d+) µm; .* off by up to ([\d.]+) µm", note)
    assert costs is not None and float(costs[1]) > 2 * float(costs[2])
    row = tables(found)["Faulty temperature sensors"].rows[0]
    place = "nose of the housing, sensor 2 of 5 from the front"
    assert [cell.text for cell in row[:4]] == ["temperature_2", place, "dead", "p10"]


def test_a_drifting_sensor_is_named_with_its_side_and_the_date_of_its_recording(
    built: Built, tmp_path: Path
) -> None:
    """The sign is of the largest departure; the date is that of the recording's clock."""
    case = max(built.verdict.cases, key=lambda one: one.case)
    fault = Fault(sensor="temperature_3", kind=DRIFTING, since_s=2580.0, departure_K=-3.2)
    facts = {"faulty sensor": Fact(value=fault.sentence)}
    verdict = replace(built.verdict, status="passed", cases=(replace(case, facts=facts),))
    files = {case.case: {"first": "2026-03-02T06:00:00Z"}}
    (tmp_path / "manifest.json").write_text(json.dumps({"files": files}))
    found = page(shown(built, verdict=verdict, signals=tmp_path))
    (sensor,) = (one for one in found.actions if one.where.startswith("temperature_3"))
    words = sensor.why.replace("\u00a0", " ")
    assert "minute 43 (Mon 2 Mar 2026, 06:43 UTC), reads up to 3.2 K too low" in words


@pytest.mark.parametrize("departure", [None, 3.2, -3.2])
def test_faults_are_read_as_the_verdict_words_them(departure: float | None) -> None:
    kind = DEAD if departure is None else DRIFTING
    fault = Fault(sensor="front bearing", kind=kind, since_s=2580.0, departure_K=departure)
    match = FAULT.fullmatch(fault.sentence)
    assert match is not None and match["sensor"] == "front bearing" and match["kind"] == kind
    assert float(match["minute"]) == 43
    assert (match["departure"] and float(match["departure"])) == departure


def test_all_methods_stand_in_one_table_the_least_error_first(built) -> None:
    found = page(shown(built))
    rows = tables(found)["All methods on whole recordings that their fit did not see"].rows
    assert len(rows) == len(built.model.compared)
    errors = [float(row[1].text) for row in rows]
    assert errors == sorted(errors)
    serving = built.model.compared[built.model.champion].label
    assert [row[0].text for row in rows if "(serves)" in row[0].text] == [f"{serving} (serves)"]
    for row in rows:
        assert (row[2].status == "passed") == (float(row[2].text) < 6.0)


def test_it_is_said_when_another_method_than_the_network_wins(built) -> None:
    section = next(s for s in page(shown(built)).sections if s.key == "growth-methods")
    facts = GrowthFacts(shown=shown(built))
    best = next(iter(facts.methods))
    assert best != "ffnn_projection"  # the made rod is linear
    assert "on these recordings it does not win" in section.text[0]
    assert "Goals (FFNN2015)" in section.text[1] and re.search("met|missed", section.text[1])


def test_temperatures_growth_error_and_speed_are_drawn_with_words_for_them(built) -> None:
    svgs = drawn(page(shown(built)))
    first = svgs[0]
    for head in ("Temperatures, °C", "Growth, µm", "Model less measured, µm", "Spindle speed"):
        assert head in first
    assert 's-band"' in first and all('role="img" aria-label="' in one for one in svgs)
    assert any("Membership in the network" in one for one in svgs)


def test_without_signals_the_growth_is_drawn_alone(built) -> None:
    first = drawn(page(shown(built, signals=None)))[0]
    assert "Growth, µm" in first and "Temperatures" not in first


def test_what_is_absent_is_said(built) -> None:
    nothing = page(shown(built, model=None, verdict=None, predictions=None))
    assert nothing.verdict is None
    assert "there is no" in nothing.sections[0].text[0]
    unjudged = page(shown(built, verdict=None, predictions=None))
    assert unjudged.verdict is not None and unjudged.verdict.status == "unknown"


def test_bands_of_the_network_are_those_that_it_filters_with() -> None:
    import torch

    net = FuzzyFilteredNetwork(FuzzyFilteredSettings(), 9, 3)
    net.set_bands(torch.tensor([[1.0, 0.5], [4.0, 1.5], [7.5, 3.0]], dtype=torch.float64))
    document = {"state": {"places": net.places.tolist()}}
    bands = figures.network_bands(document, 9)
    expected = net.memberships(net.bands).detach().numpy()
    assert figures.gaussian(np.arange(9.0), bands) == pytest.approx(expected)


def test_runs_of_a_regime_begin_where_it_does(built) -> None:
    rows = built.predictions
    rows = rows[(rows["regime"] == WARMING) & (rows["quantity"] == "growth")
                & (rows["role"] == "held_out")]  # fmt: skip
    runs = GrowthFacts(shown=shown(built)).runs(WARMING)
    assert runs and all(t[0] == 0 and np.allclose(np.diff(t), 60.0) for t, _ in runs)
    assert sum(len(t) for t, _ in runs) <= len(rows)


def test_errors_after_a_start_are_quantiles_of_all_starts() -> None:
    time = 60.0 * np.arange(12)
    runs = [(time, np.full(12, float(level))) for level in (-1, 0, 1)]
    found = figures.transitions(runs)
    assert found is not None and found.count == 3
    assert found.middle.tolist() == [0.0, 0.0, 0.0] and found.widest == 1.0
    assert figures.transitions(runs[:2]) is None


def test_the_page_is_the_same_every_time(built: Built, tmp_path: Path) -> None:
    assert drawn(page(shown(built))) == drawn(page(shown(built)))
