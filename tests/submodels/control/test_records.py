"""Runs and programs of a machine's folders: which serve for what, and what cannot be followed."""

import json

import numpy as np
import pytest

from pipeline.submodels.control.programs import read_matches, read_programs
from pipeline.twin.control import ControlRecords
from tests.submodels.control.part_programs import (
    SETUP,
    change,
    long_cuts,
    moves_of,
    truth,
)
from tests.submodels.control.polled_logs import ITEMS, polled_log, write_log

RECORDS = ControlRecords(
    logs="control/*.txt", programs="programs/*.nc",
    units={"left": "*-left.txt", "right": "*-right.txt"}, default_unit="left",
    simulate=("programs/one*",),
)  # fmt: skip
TEXTS = {
    "one": ["G21 G90 G94", *change(1, 3000), *long_cuts((600, 900)), "M30"],
    "two": ["G21 G90 G94", *change(2, 3000), *long_cuts((500, 700, 900)), "M30"],
    "bad": ["G21 G90", "G1 X10 F500", "G2 X20 Y0 I500 F100", "M30"],
}


def files_of(signals):
    return json.loads((signals / "manifest.json").read_text())["files"]


@pytest.fixture
def machine(tmp_path):
    """Raw programs, and signals of two logs and of a recording of another kind."""
    raw, signals = tmp_path / "raw", tmp_path / "signals"
    (raw / "programs").mkdir(parents=True)
    (signals / "observations").mkdir(parents=True)
    moves = {}
    for name, lines in TEXTS.items():
        path = raw / "programs" / f"{name}.nc"
        path.write_text("\n".join(lines) + "\n")
        if name != "bad":
            moves[name] = moves_of(lines, tmp_path, name)
    files = {"agent/week.txt": {"output": None}}
    for file, name in {"control/b-left.txt": "one", "control/a-right.txt": "two"}.items():
        log = polled_log(moves[name], truth(), np.random.default_rng(1))
        output = f"observations/{file.replace('/', '__')}.parquet"
        write_log(log, signals / output)
        files[file] = {"output": output}
    files["agent/other.txt"] = files["control/b-left.txt"]
    (signals / "manifest.json").write_text(json.dumps({"files": files}))
    return raw, signals


def test_programs_are_read_and_what_cannot_be_followed_is_kept_with_its_reason(machine):
    raw, _ = machine
    programs = read_programs(raw, RECORDS, SETUP)
    assert list(programs.moves) == ["programs/one.nc", "programs/two.nc"]
    assert list(programs.refused) == ["programs/bad.nc"]
    assert "bad.nc:3:" in programs.refused["programs/bad.nc"]


def test_runs_are_those_of_the_logs_in_order_of_their_names(machine):
    raw, signals = machine
    programs = read_programs(raw, RECORDS, SETUP).moves
    matches = read_matches(signals, files_of(signals), RECORDS, ITEMS, programs)
    assert [(m.run.name, m.program) for m in matches] == [
        ("control/a-right.txt", "programs/two.nc"),
        ("control/b-left.txt", "programs/one.nc"),
    ]
    assert [RECORDS.unit(m.run.recording) for m in matches] == ["right", "left"]


def test_a_run_without_its_program_has_no_segments_but_a_reason(machine):
    raw, signals = machine
    programs = read_programs(raw, RECORDS, SETUP).moves
    only = {"programs/one.nc": programs["programs/one.nc"]}
    matches = read_matches(signals, files_of(signals), RECORDS, ITEMS, only)
    assert [bool(m.reason) for m in matches] == [True, False]


def test_a_pattern_says_what_is_shown(machine):
    raw, _ = machine
    assert {name: path.name for name, path in RECORDS.shown(raw).items()} == {"one": "one.nc"}


def test_a_recording_of_no_unit_is_refused_in_one_sentence():
    with pytest.raises(ValueError, match=r"^recording control/c.txt fits no pattern .*left\.txt"):
        RECORDS.unit("control/c.txt")
    alone = ControlRecords(logs="*", programs="*")
    assert alone.unit("control/c.txt") == ""


def test_a_default_unit_that_is_none_is_refused():
    with pytest.raises(ValueError, match=r"default_unit is 'middle': name one of its units, left"):
        ControlRecords(logs="*", programs="*", units={"left": "*"}, default_unit="middle")


def test_programs_of_one_name_are_told_apart_by_their_folder(tmp_path):
    for place in ("a/one.nc", "b/one.nc", "b/two.nc"):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        (tmp_path / place).write_text("M30\n")
    shown = ControlRecords(logs="*.txt", programs="*/*.nc").shown(tmp_path)
    assert list(shown) == ["a_one.nc", "b_one.nc", "two"]
