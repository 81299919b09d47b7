"""A real cut: slots in aluminium on a Kistler dynamometer, two feeds.

Recordings that J. Li offers with his worked example.
"""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.commands.fleet import collect, use_fleet
from pipeline.stages.__main__ import run
from tests.small_project import ROOT, inside

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = [
    pytest.mark.skipif(
        not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings"
    ),
    pytest.mark.slow,
]  # fmt: skip
MACHINE = "kistler_slot"


@pytest.fixture(scope="module")
def documents(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded-cutting")
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    with inside(folder):
        fleet = replace(
            use_fleet("recorded"),
            machines=(MACHINE,),
            spindles=(),
            controls=(),
            drives=(),
            optimised=(),
        )
        assert [files for _, _, files in collect(fleet, Path(RECORDINGS or ""))] >= [1]
        run("compose", "conf", "params.yaml")
        signals, models = f"data/signals/{MACHINE}", f"data/models/{MACHINE}"
        for place in (signals, models, "data/metrics"):
            Path(place).mkdir(parents=True)
        run(f"ingest@{MACHINE}", f"data/raw/{MACHINE}", signals)
        raw = f"data/raw/{MACHINE}"
        run(f"identify_cutting@{MACHINE}", signals, raw, f"{models}/cutting.json")
        run(
            f"validate_cutting@{MACHINE}", signals, f"{models}/cutting.json",
            f"{models}/verdict.json", f"{models}/traces.parquet", "data/metrics/cutting.json",
        )  # fmt: skip
        return (
            json.loads(Path(f"{models}/cutting.json").read_text()),
            json.loads(Path(f"{models}/verdict.json").read_text()),
        )


def test_both_recordings_are_read(documents):
    rows = documents[0]["recordings"]
    assert [row["role"] for row in rows][:2] == ["training", "training"]
    for row in rows:
        assert row["speed_rpm"] == pytest.approx(5999.8, abs=0.5)  # lines stand at 99.997 Hz


def test_mean_forces_give_coefficients_of_aluminium(documents):
    found = documents[0]["mean_force"]
    # by hand, from the means of the two files: (171.3 - 107.1) N over 2 * 3 mm * 0.05 mm / 4
    assert found["K_tc"]["value"] == pytest.approx((171.27 - 107.14) / 0.075, rel=0.01)
    assert found["K_te"]["value"] == pytest.approx(
        (107.14 - 0.075 * found["K_tc"]["value"]) / (6 / 3.14159), rel=0.01
    )


def test_the_dynamometers_modes_are_seen(documents):
    chain = documents[0]["measuring_chain"]
    # where the lines of the spectrum stand out: between 700 and 800 Hz in x, 900 and 1000 in y
    for channel, low, high in (("x", 700, 800), ("y", 900, 1000)):
        assert low < chain[channel]["natural_frequency_Hz"]["value"] < high
    kept = next(one for one in documents[0]["terms"] if one["kept"])
    assert "modes" in kept["terms"]


def test_a_recording_is_predicted_from_the_other(documents):
    """One feed has to tell cutting from edge and is carried to twice itself or to half."""
    for row in documents[1]["cross"]:
        error = row["components"]["resultant"]["rms_error_percent"]
        assert error < 0.7 * row["plain"]["components"]["resultant"]["rms_error_percent"]
        assert error < 35


def test_training_conditions_are_told_within_the_limits(documents):
    for row in documents[1]["recordings"]:
        resultant = row["components"]["resultant"]
        for figure in ("peak", "mean", "rms"):
            assert abs(resultant[f"{figure}_error_percent"]) < 5
        assert row["how"] == "mechanics and what they leave over"
