"""A real cut: slots in aluminium on a Kistler dynamometer, two feeds.

Recordings that J. Li offers with his worked example.
"""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.app.fleet import collect, use_fleet
from pipeline.schema.cutting import COEFFICIENTS, MAGNITUDE, OTHERS, PLAIN, PLANE, CuttingModel
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.__main__ import run
from tests.small_project import inside, with_conf

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = [
    pytest.mark.skipif(not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings"),
    pytest.mark.slow,
]
MACHINE = "kistler_slot"


@pytest.fixture(scope="module")
def documents(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded-cutting")
    with_conf(folder, "recorded")
    with inside(folder):
        fleet = replace(
            use_fleet("recorded"),
            machines=(MACHINE,),
            submodels={},
            optimised=(),
        )
        assert [files for _, _, files in collect(fleet, Path(RECORDINGS or ""))] >= [1]
        run("compose", "conf", "params.yaml", "data/settings")
        signals, models = f"data/signals/{MACHINE}", f"data/models/{MACHINE}"
        run(f"ingest@{MACHINE}", f"data/raw/{MACHINE}", signals)
        raw, folder = f"data/raw/{MACHINE}", f"{models}/cutting"
        run(f"identify_cutting@{MACHINE}", signals, raw, folder, "data/golden")
        run(
            f"judge_cutting@{MACHINE}", signals, raw, folder, "data/golden",
            f"data/metrics/{MACHINE}_cutting.json", f"data/plots/{MACHINE}_cutting",
        )  # fmt: skip
        return (
            read_json(Path(folder) / "model.json", CuttingModel),
            read_json(Path(folder) / "verdict.json", Verdict),
        )


def test_both_recordings_are_read(documents):
    rows = documents[0].recordings
    assert [row.role for row in rows][:2] == ["training", "training"]
    for row in rows:
        assert row.speed_rpm == pytest.approx(5999.8, abs=0.5)  # lines stand at 99.997 Hz


def test_mean_forces_give_coefficients_of_aluminium(documents):
    found = documents[0].mean_force
    # by hand, from the means of the two files: (171.3 - 107.1) N over 2 * 3 mm * 0.05 mm / 4
    # the laws that bend have a line over wider feeds than the recorded ones, steeper from lower
    assert found["K_tc"].value == pytest.approx((171.27 - 107.14) / 0.075, rel=0.015)
    low, high = found["K_tc"].interval_95
    waveform = documents[0].coefficients["K_tc"]
    assert (
        waveform.determined and waveform.interval_95[0] <= low and high <= waveform.interval_95[1]
    )
    # two means leave more of the edge open than the waveforms do
    edge = documents[0].parameters[COEFFICIENTS]["K_te"]
    assert edge.determined and 10 < edge.value < 40


def test_the_dynamometers_modes_are_seen(documents):
    channels = documents[0].channels
    # where the lines of the spectrum stand out: between 700 and 800 Hz in x, 900 and 1000 in y
    for channel, low, high in (("x", 700, 800), ("y", 900, 1000)):
        assert low < channels[channel]["natural_frequency_Hz"].value < high
    kept = next(one for one in documents[0].terms if one.kept)
    assert "modes" in kept.terms


def test_a_recording_is_predicted_from_the_other(documents):
    """One feed has to tell cutting from edge and is carried to twice itself or to half."""
    crossed = [s for s in documents[1].of(PLANE) if s.regime == OTHERS and s.group != "all"]
    assert len(crossed) == 2
    for score in crossed:
        assert score.relative_percent < 0.7 * score.baselines[PLAIN].relative_percent
        assert score.relative_percent < 35


def test_training_conditions_are_predicted_within_the_limits(documents):
    verdict = documents[1]
    for quantity, names in ((PLANE, ["relative"]), (MAGNITUDE, ["peak", "mean"])):
        for score in verdict.of(quantity, role="training"):
            if score.regime == "":
                assert all(abs(getattr(score, f"{name}_percent")) < 5 for name in names)
    for case in verdict.cases:
        assert case.facts["predicted by"].value == "mechanics and what they leave over"
