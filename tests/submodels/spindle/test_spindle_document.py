"""What is stored of an identified spindle."""

import json
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from pipeline.submodels.spindle.fit import (SpindleFitSettings, fit_network)
from pipeline.submodels.spindle.submodel import (REMEDY, spindle_document, training_stretches)

from pipeline.signals.ingest import MachineIdentity
from pipeline.thermal.network import SOURCES
from pipeline.twin.spindle import SpindleRecords
from pipeline.twin.spindle_model import network_from
from tests.submodels.spindle.spindle_days import ONE, RECORDS, days_of, state_table

SETTINGS = SpindleFitSettings(step_s=60.0, time_constants_s=(1500.0,), nodes=(1,))
IDENTITY = MachineIdentity(name="mill", description="a mill", origin="simulated", credit="")


def test_every_source_has_a_remedy() -> None:
    assert set(REMEDY) == set(SOURCES)


def test_what_is_not_determined_is_null_and_says_what_to_record() -> None:
    days = days_of(ONE, 4, 4, excited=("speed",), noise_K=0.3)
    fit = fit_network(days, RECORDS, SETTINGS, 1)
    document = spindle_document(IDENTITY, RECORDS, SETTINGS, fit, {}, days, [])
    copper = document["parameters"]["copper"]
    assert copper["value"] is None
    assert copper["interval_95"] is None
    assert copper["determined"] is False
    assert copper["unit"] == "K/s"
    assert copper["how"] == f"the records never excite it; {REMEDY['copper']}"
    # this machine has no C axis: the source is not even listed
    assert "position_hold" not in document["parameters"]


def test_intervals_hold_their_value_and_the_truth_in_the_stated_unit() -> None:
    days = days_of(ONE, 1, 5, noise_K=0.2)
    fit = fit_network(days, RECORDS, SETTINGS, 1)
    found = spindle_document(IDENTITY, RECORDS, SETTINGS, fit, {1: 0.5}, days, [])["parameters"]
    truth = {"cooling_rate": ONE.cooling_rate, "ambient": ONE.ambient, **ONE.heating}
    for name, value in truth.items():
        low, high = found[name]["interval_95"]
        assert low < found[name]["value"] < high
        # a quarter beyond the interval: the test is of the unit, not of luck
        assert low - (high - low) / 4 < value < high + (high - low) / 4
    assert found["cooling_rate"]["unit"] == "1/s"
    assert found["ambient"]["unit"] == "CELSIUS"
    assert found["bearing_friction"]["unit"] == "K/s/(rad/s)^(5/3)"


def test_too_short_records_are_plain_json_all_the_same() -> None:
    """Infinite intervals and conditions are no JSON: they are null."""
    days = days_of(ONE, 2, 1, hours=2.0)
    fit = fit_network(days, RECORDS, SETTINGS, 1)
    document = spindle_document(IDENTITY, RECORDS, SETTINGS, fit, {}, days, [])
    text = json.dumps(document, allow_nan=False)
    found = json.loads(text)["parameters"]
    assert all(entry["value"] is None for entry in found.values())
    assert network_from(json.loads(text)) == fit.parameters


def test_the_documents_network_is_the_one_that_was_found(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.mkdir()
    records = SpindleRecords(training_from="2026-01-06", training_to="2026-01-07")
    for number, day in enumerate(("2026-01-05", "2026-01-06", "2026-01-07", "2026-01-08")):
        table = state_table(ONE, number, day).reset_index()
        table.to_parquet(folder / f"{day}.parquet")
    pieces, files = training_stretches(tmp_path, records, SETTINGS)
    assert [p.day for p in pieces] == ["2026-01-06", "2026-01-07"]
    fit = fit_network(pieces, records, SETTINGS, 1)
    document = json.loads(
        json.dumps(spindle_document(IDENTITY, records, SETTINGS, fit, {}, pieces, files))
    )
    assert network_from(document) == fit.parameters
    assert document["training_days"] == ["2026-01-06", "2026-01-07"]
    assert document["fit"]["seconds"] == pytest.approx(2 * 4 * 3600, abs=120)
    by_hand = sha256((folder / "2026-01-06.parquet").read_bytes()).hexdigest()
    assert document["found_from"][0] == {"file": "state/2026-01-06.parquet", "sha256": by_hand}
    # the table is in percent and rpm: a factor forgotten would put this far off
    assert fit.parameters.heating["copper"] == pytest.approx(ONE.heating["copper"], rel=0.2)
    assert np.isfinite(document["fit"]["rmse_K"])
