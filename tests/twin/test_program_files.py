"""Simulated programs on disk, and programs that cannot be followed."""

import json
from hashlib import sha256

import pandas as pd
import pytest

from pipeline.twin.control import planned_program, program_moves
from pipeline.twin.simulation import simulate_files
from tests.submodels.control.part_programs import SETUP, exciting, truth


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    raw = tmp_path_factory.mktemp("raw")
    out = raw.parent / "out"
    (raw / "programs").mkdir()
    good, bad = raw / "programs/good.nc", raw / "programs/bad.nc"
    good.write_text("\n".join(exciting()) + "\n")
    bad.write_text("G21 G90\nG1 X10 F500\nG2 X20 Y0 I500 F100\nM30\n")
    simulate_files(
        {"good": good, "bad": bad}, raw, truth(), SETUP, out, machine="mill", origin="simulated"
    )
    return raw, out


def test_a_program_is_stored_with_its_times_and_the_bytes_it_was_read_from(written):
    raw, out = written
    path = raw / "programs/good.nc"
    document = json.loads((out / "good.json").read_text())
    plan = planned_program(program_moves(path, SETUP), truth())
    assert document["total_time_s"] == pytest.approx(plan.total, abs=5e-4)
    assert document["refused"] is None
    assert document["sha256"] == sha256(path.read_bytes()).hexdigest()
    assert (document["file"], document["program"]) == ("programs/good.nc", "good")
    assert (document["machine"], document["origin"]) == ("mill", "simulated")
    table = pd.read_parquet(out / "good.parquet")
    assert len(table) == document["blocks"] == len(plan.path.moves)
    assert table["time"].sum() == pytest.approx(plan.total, rel=1e-12)


def test_a_program_that_cannot_be_followed_is_refused_with_file_and_line(written):
    _, out = written
    document = json.loads((out / "bad.json").read_text())
    assert "bad.nc:3:" in document["refused"]
    assert document["total_time_s"] is None
    assert not (out / "bad.parquet").exists()
