"""What is stored of a control: true numbers, how each was found, nothing where nothing is known."""

import hashlib
import json
import re
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pipeline.identification.control.document import FITTED, NOT_DETERMINED, TOLD, control_document

from pipeline.signals.ingest import MachineIdentity
from pipeline.submodels.control.fit import ControlFitSettings, identify_control
from pipeline.submodels.control.programs import Match
from pipeline.submodels.control.segments import observe
from pipeline.twin.control import read_controls
from tests.submodels.control.part_programs import (
    change,
    long_cuts,
    moves_of,
    rapids,
    start,
    truth,
)
from tests.submodels.control.polled_logs import logged_runs, polled_log

IDENTITY = MachineIdentity(name="mill", origin="simulated")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """The document of a control whose runs say nothing of arcs; with a run that did not fit."""
    folder = tmp_path_factory.mktemp("control")
    text = [
        line for tool in range(1, 7)
        for line in (*change(tool, 4000), *long_cuts((900, 1500)), *rapids((400, 300)))
    ]  # fmt: skip
    moves = moves_of(["%", "G21 G90 G94", *text, "M30", "%"], folder)
    rng = np.random.default_rng(9)
    runs = [
        logged_runs(folder / f"{k}.parquet", polled_log(moves, truth(), rng))[0] for k in range(2)
    ]
    settings = ControlFitSettings()
    fit = identify_control(
        [observe(run, "part", moves, "", settings.shortest_s) for run in runs], start(), settings
    )
    matches = [
        Match(run=runs[0], program="part"),
        Match(run=runs[1], program=None, reason="log.txt: no program of the machine fits"),
    ]
    log = folder / "a.txt"
    log.write_bytes(b"1|2|3\n")
    return fit, control_document(IDENTITY, fit, matches, [log])


def test_it_is_json_without_infinite_or_missing_numbers(made):
    once = json.dumps(made[1], allow_nan=False)
    assert json.dumps(json.loads(once), allow_nan=False) == once


def test_what_is_not_determined_has_no_number_but_a_remedy(made):
    fit, document = made
    assert not fit.determined.all()
    for one, known in zip(fit.free, fit.determined, strict=True):
        stored = document["parameters"][one.name]
        assert stored["determined"] is bool(known)
        if known:
            assert stored["low"] <= stored["value"] <= stored["high"]
            assert stored["remedy"] is None
        else:
            assert (stored["value"], stored["low"], stored["high"]) == (None, None, None)
            assert stored["how"] == NOT_DETERMINED
            assert stored["remedy"].startswith("log ")
        assert stored["unit"] == one.unit
    assert not document["parameters"]["arc_acceleration XYZ"]["determined"]


def test_each_parameter_says_how_it_was_found(made):
    parameters = made[1]["parameters"]
    assert parameters["rapid_speed X"]["how"] == TOLD == "steady speeds in rapids"
    assert parameters["tool_change"]["how"] == FITTED
    known = [name for name, stored in parameters.items() if stored["determined"]]
    assert {parameters[name]["how"] for name in known} == {TOLD, FITTED}


def test_correlations_are_of_what_was_fitted(made):
    document = made[1]
    correlation = document["fit"]["correlation"]
    fitted = [n for n, p in document["parameters"].items() if p["how"] == FITTED]
    assert correlation["names"] == fitted
    assert np.array(correlation["values"]).shape == (len(fitted), len(fitted))
    np.testing.assert_array_equal(np.diag(correlation["values"]), 1.0)


def test_the_control_is_read_back_as_it_was_found(made, tmp_path):
    fit, document = made
    path = tmp_path / "control.json"
    path.write_text(json.dumps(document, allow_nan=False))
    assert read_controls(path) == fit.control


def test_it_says_which_runs_and_which_bytes_it_was_found_from(made):
    runs = made[1]["runs"]
    assert runs["training"] == [{"run": "log.txt", "program": "part"}]
    assert runs["left_out"] == [
        {"run": "log.txt", "reason": "log.txt: no program of the machine fits"}
    ]
    assert made[1]["found_from"] == {"a.txt": hashlib.sha256(b"1|2|3\n").hexdigest()}
    assert (made[1]["machine"], made[1]["origin"]) == ("mill", "simulated")


LEAVES = st.none() | st.booleans() | st.floats() | st.text(max_size=3)
KEYS = st.sampled_from(["control", "", "axes", "X", "auxiliary", "corner"])
DOCUMENTS = st.recursive(
    LEAVES, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3)
)


@given(DOCUMENTS.map(json.dumps) | st.text(max_size=20))
def test_another_file_is_no_identified_control(text):
    with TemporaryDirectory() as folder:
        path = Path(folder) / "control.json"
        path.write_text(text, encoding="utf-8")
        try:
            controls = read_controls(path)
        except ValueError as error:
            assert re.search(r"control.json is no identified control \(\w+\): run", str(error))
        else:
            assert controls == {}  # a document without a machine


def test_a_file_that_is_not_there_is_no_identified_control(tmp_path):
    with pytest.raises(ValueError, match=r"none.json is no identified control \(FileNotFound"):
        read_controls(tmp_path / "none.json")
