"""`kerf interpret` and `kerf simulate`, as a process engineer uses them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.app.simulate import simulate_program
from pipeline.machine.control.parameters import ControlParameters
from pipeline.machine.control.planner import Plan
from pipeline.schema.model import Band, Correlation
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Verdict
from pipeline.twin.control import WHOLE, ControlFitFacts, ControlModelFile
from tests.small_project import ROOT, inside
from tests.test_cli import kerf, refused

PART = """%
O1000(TWO SLOTS)
N10 G21 G17 G90 G40
N20 T1 M6
N30 G0 G54 X0. Y0. S6000 M3
N40 Z5.
N50 G1 Z-1. F300.
N60 X100. F1200.
N70 G3 X100. Y40. I0. J20.
N80 G1 X0.
N90 G0 Z50.
N100 M30
%
"""
SIMULATE = ("simulate", "part.nc", "--machine", "hurco")


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("KERF_RECORDINGS", raising=False)
    folder = tmp_path / "project"
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    (folder / "part.nc").write_text(PART)
    return folder


def test_interpret_writes_a_row_a_move_in_mm(project: Path) -> None:
    done = kerf(project, "interpret", "part.nc", "--out", "moves.csv")
    assert done.exit_code == 0
    moves = pd.read_csv(project / "moves.csv")
    arc = moves[moves["type"] == "arc"].iloc[0]
    assert (arc["x_mm"], arc["y_mm"], arc["z_mm"]) == (100.0, 40.0, -1.0)
    assert (arc["centre_x_mm"], arc["centre_y_mm"]) == (100.0, 20.0)
    assert arc["length_mm"] == pytest.approx(np.pi * 20, abs=1e-9)
    assert arc["angle_deg"] == pytest.approx(180.0, abs=1e-9)
    assert (arc["block"], arc["tool"], arc["feed"], arc["speed"]) == (9, 1, 1200.0, 6000.0)
    assert f"{len(moves)} moves" in done.stdout


def test_simulate_says_how_far_the_axes_are_behind(project: Path) -> None:
    """Where drives were identified; without, nothing is said of them."""
    assert "behind" not in kerf(project, *SIMULATE).stdout
    way = {"coulomb": 100.0, "static": 120.0, "stribeck_velocity": 0.005, "viscous": 300.0}
    axis = {
        "command_unit": "A", "force_unit": "N",
        "fit": {"samples": 1, "relative_error_percent": None, "bandwidth_Hz": None,
                "condition": None, "rank": 1, "correlation": {}},
        "servo": {"position_gain": 40.0, "velocity_gain": 600.0, "integral_gain": 30000.0},
        "feed_drive": {"mass": 800.0, "force_constant": 400.0,
                       "friction": {"positive": way, "negative": way}},
    }  # fmt: skip
    model = {"submodel": "drive", "machine": "hurco", "origin": "recorded", "parameters": {},
             "trained_on": []}  # fmt: skip
    folder = project / "data/champion/hurco/drive"
    folder.mkdir(parents=True)
    (folder / "model.json").write_text(json.dumps(model | {"axes": {"X": axis}}))
    done = kerf(project, *SIMULATE, "--json", "times.json")
    assert done.exit_code == 0, done.output
    (told,) = json.loads((project / "times.json").read_text())["axes"]
    # X moves at 1200 mm/min, in no rapid: speed over loop gain
    assert told["max_following_um"] == pytest.approx(1200e3 / 60 / 40, rel=0.01)
    assert told["at_line"] in (8, 9, 10)
    assert told["axis"] == "X" and told["command_unit"] == "A" and told["max_command"] > 0
    assert "X behind by up to" in done.stdout
    bare = axis | {"servo": None, "servo_reason": "no reference"}
    (folder / "model.json").write_text(json.dumps(model | {"axes": {"X": bare}}))
    done = kerf(project, *SIMULATE)
    assert "X not followed: no reference" in done.stdout
    (folder / "model.json").write_text("{")
    said = refused(project, *SIMULATE)
    assert "model.json holds no identified drives" in said and "dvc repro" in said


def test_inch_programs_and_offsets_end_in_machine_millimetres(project: Path) -> None:
    text = PART.replace("G21", "G20").replace("N30 G0", "N25 G10 L2 P1 X1.\nN30 G0")
    (project / "inch.nc").write_text(text)
    assert kerf(project, "interpret", "inch.nc", "--out", "moves.csv").exit_code == 0
    arc = pd.read_csv(project / "moves.csv").query("type == 'arc'").iloc[0]
    assert arc["x_mm"] == pytest.approx(101 * 25.4) and arc["y_mm"] == pytest.approx(40 * 25.4)


def test_simulate_says_how_long_and_writes_what_is_asked(project: Path) -> None:
    done = kerf(project, *SIMULATE, "--json", "times.json", "--out", "trace.parquet")
    assert done.exit_code == 0 and "as in conf/machine/hurco.yaml" in done.stdout
    document = json.loads((project / "times.json").read_text())
    blocks = document["blocks"]
    assert {"line", "type", "time_s", "length_mm", "reached_feed_mm_min", "limit"} <= set(blocks[0])
    assert sum(b["time_s"] for b in blocks) == pytest.approx(document["total_time_s"], abs=1e-3)
    assert sum(b["length_mm"] for b in blocks) == pytest.approx(document["path_length_mm"])
    slot = next(b for b in blocks if b["line"] == 8)
    assert slot["limit"] == "feed" and slot["reached_feed_mm_min"] == pytest.approx(1200.0)
    assert slot["time_s"] > 100 / 1200 * 60  # it must speed up and slow down
    trace = pq.read_table(project / "trace.parquet").to_pandas()
    assert trace["time"].iloc[-1] == pytest.approx(document["total_time_s"], abs=2e-3)
    assert tuple(trace[["x", "y", "z"]].iloc[-1]) == pytest.approx((0.0, 40.0, 50.0), abs=1e-9)


def control_model(**units: ControlParameters) -> ControlModelFile:
    """A control as it is stored, by unit."""
    fit = ControlFitFacts(rmse_s=0.0, segments=1, condition=1.0, correlation=Correlation())
    return ControlModelFile(
        submodel="control", machine="hurco", origin="recorded", parameters={}, trained_on=(),
        control=units, fit=fit, programs={},
    )  # fmt: skip


def test_an_identified_control_goes_before_the_one_in_conf(project: Path) -> None:
    with inside(project):
        before = simulate_program(Path("part.nc"), "hurco", None, lambda done: None)
    control = before.plan.path.control
    slow = replace(control, auxiliary=replace(control.auxiliary, tool_change=16.0))
    model = control_model(hurco02=control, hurco04=slow)
    write_json(model, project / "data/champion/hurco/control/model.json")
    done = kerf(project, *SIMULATE)
    assert "control identified" in done.stdout
    assert f"{before.plan.total + 10:.1f} s" in done.stdout
    words = (*SIMULATE, "--unit", "hurco02", "--json", "o.json")
    other = kerf(project, *words)
    told = json.loads((project / "o.json").read_text())
    assert told["unit"] == "hurco02" and told["total_time_s_on_other_units"] == {}
    default = kerf(project, *SIMULATE, "--json", "d.json")
    document = json.loads((project / "d.json").read_text())
    assert document["unit"] == "hurco04"
    assert document["total_time_s_on_other_units"] == {"hurco02": told["total_time_s"]}
    assert "warning: on unit hurco04, the default one, which matters here" in default.stdout
    assert f"with --unit: hurco02 {told['total_time_s']:.1f} s" in default.stdout
    assert f"{before.plan.total:.1f} s" in other.stdout
    assert "'hurco99'" in refused(project, *SIMULATE, "--unit", "hurco99")


def test_the_champion_is_used_and_the_latest_only_where_it_is_named(project: Path) -> None:
    words = (*SIMULATE, "--json", "times.json")
    said = refused(project, *words, "--model", "latest")
    assert "data/models/hurco does not exist: run `dvc repro`" in said
    assert "not one of 'champion', 'latest'" in refused(project, *words, "--model", "newest")
    with inside(project):
        before = simulate_program(Path("part.nc"), "hurco", None, lambda done: None)
    control = before.plan.path.control
    for place, longer in (("champion", 10.0), ("models", 20.0)):
        changer = replace(control.auxiliary, tool_change=control.auxiliary.tool_change + longer)
        model = control_model(hurco02=control, hurco04=replace(control, auxiliary=changer))
        write_json(model, project / f"data/{place}/hurco/control/model.json")
    for option, longer in (
        ((), 10.0),
        (("--model", "champion"), 10.0),
        (("--model", "latest"), 20),
    ):
        done = kerf(project, *words, *option)
        assert done.exit_code == 0, done.output
        total = json.loads((project / "times.json").read_text())["total_time_s"]
        assert total == pytest.approx(before.plan.total + longer, abs=1e-3)
        warned = "with data/models/hurco, not with the champion" in done.stdout
        assert warned == ("latest" in option)


def test_a_control_that_did_not_pass_is_named(project: Path) -> None:
    with inside(project):
        plan = simulate_program(Path("part.nc"), "hurco", None, lambda done: None).plan
    control, folder = plan.path.control, project / "data/champion/hurco/control"
    write_json(control_model(hurco02=control, hurco04=control), folder / "model.json")
    for status in ("passed", "failed", "not judged"):
        verdict = Verdict(
            submodel="control", machine="hurco", origin="recorded", status=status, reasons=(),
            judged_role=None, golden=None, scores=(),
        )  # fmt: skip
        write_json(verdict, folder / "verdict.json")
        done = kerf(project, *SIMULATE, "--json", "times.json")
        assert done.exit_code == 0, done.output
        document = json.loads((project / "times.json").read_text())
        assert next(iter(document)) == "verdicts"  # before all figures
        first = document["verdicts"][0 if status != "passed" else -1]
        assert (first["submodel"], first["status"]) == ("control", status)
        spread = {"passed": "0", "failed": "10", "not judged": "25"}[status]
        assert (
            f"control {status}; times count with a standard deviation of {spread} %" in done.stdout
        )
        assert (f"WARNING: control {status}" in done.stdout) == (status != "passed")


def test_a_control_without_a_verdict_is_not_judged_and_one_in_conf_not_identified(
    project: Path,
) -> None:
    done = kerf(project, *SIMULATE)
    assert "control not identified: its values are those of conf/machine" in done.stdout
    with inside(project):
        plan = simulate_program(Path("part.nc"), "hurco", None, lambda done: None).plan
    model = control_model(hurco02=plan.path.control, hurco04=plan.path.control)
    write_json(model, project / "data/champion/hurco/control/model.json")
    done = kerf(project, *SIMULATE)
    assert "WARNING: control not judged: no verdict.json stands beside its model" in done.stdout


def test_a_control_that_is_broken_is_one_sentence(project: Path) -> None:
    path = project / "data/champion/hurco/control/model.json"
    path.parent.mkdir(parents=True)
    for text, said in (("{", "is no JSON"), ("{}", "is not what this version stores")):
        path.write_text(text)
        whole = refused(project, *SIMULATE)
        assert f"data/champion/hurco/control/model.json {said}" in whole and "dvc repro" in whole


def test_results_of_a_simulated_machine_are_labelled(project: Path) -> None:
    assert "(simulated)" in kerf(project, "simulate", "part.nc", "--machine", "mill01").stdout


@pytest.mark.parametrize(
    ("text", "words", "said"),
    [
        ("G1 X10.\nM30\n", SIMULATE, "part.nc:1"),
        ("M98 P77\nM30\n", SIMULATE, "77"),
        ("GOTO 7\nM30\n", SIMULATE, "7"),
        ("G83 Z-50. R2. Q0.00001 F100.\nM30\n", SIMULATE, "pecks"),
        ("G1 F100. U5.\nM30\n", SIMULATE, "U5."),
        ("\x00\xff\nM30\n", SIMULATE, "part.nc:1"),
        ("%\n%\n", (*SIMULATE, "--json", "times.json"), "holds no block"),
        ("G21 G1 X99999999. F100.\nM30\n", (*SIMULATE, "--out", "t.parquet"), "positions"),
        (PART, (*SIMULATE, "--unit", "hurco99"), "hurco02, hurco04"),
        (PART, (*SIMULATE, "--json", "."), "is a folder"),
        (PART, (*SIMULATE, "--json", "nowhere/m.csv"), "does not exist"),
        (PART, (*SIMULATE[:3], "mazak01"), "no section control"),
        (PART, (*SIMULATE[:3], "lathe9"), "known machines"),
        (PART, ("interpret", "none.nc", "--out", "m.csv"), "does not exist"),
        (PART, ("interpret", "part.nc", "--out", "."), "is a folder"),
        (PART, ("interpret", "part.nc", "--out", "nowhere/m.csv"), "does not exist"),
        (PART, ("interpret", "part.nc"), "--out is missing"),
        (PART, ("interpret", "part.nc", "--out", "m.csv", "--json", "m.json"), "without --at"),
    ],
)
def test_what_cannot_be_done_is_one_sentence_and_writes_nothing(
    project: Path, text: str, words: tuple[str, ...], said: str
) -> None:
    (project / "part.nc").write_bytes(text.encode("latin-1"))
    before = sorted(project.iterdir())
    assert said in refused(project, *words)
    assert sorted(project.iterdir()) == before


def test_a_loop_without_an_end_is_one_sentence(project: Path) -> None:
    machine = project / "conf/machine/hurco.yaml"
    text = machine.read_text()
    assert "\nsetup:\n" in text
    machine.write_text(text.replace("\nsetup:\n", "\nsetup:\n  block_limit: 500\n"))
    (project / "part.nc").write_text("N1\nGOTO 1\nM30\n")
    said = refused(project, *SIMULATE)
    assert "part.nc:2" in said and "does not come to its end" in said and "block_limit" in said


def test_a_program_that_only_ends_takes_no_time(project: Path) -> None:
    (project / "part.nc").write_text("M30\n")
    done = kerf(project, *SIMULATE, "--json", "times.json")
    assert done.exit_code == 0
    assert json.loads((project / "times.json").read_text())["total_time_s"] == 0


def test_a_program_is_never_written_over(project: Path) -> None:
    before = (project / "part.nc").read_bytes()
    for words in (["interpret", "--out"], ["simulate", "--machine", "hurco", "--json"],
                  ["simulate", "--machine", "hurco", "--out"]):  # fmt: skip
        assert "the program itself" in refused(
            project, words[0], "part.nc", *words[1:], "../project/part.nc"
        )
    one, two = ["part.nc"], ["part.nc", "part.nc"]
    for words in (["preflight", *one, "--machine", "hurco"], ["check", *two],
                  ["interpret", *one, "--at", "3"]):  # fmt: skip
        assert "part.nc is read" in refused(project, *words, "--json", "part.nc")
    assert (project / "part.nc").read_bytes() == before


@pytest.mark.parametrize("name", ["agent.log", "champions.json", "dvc.lock"])
def test_json_replaces_no_record_and_no_file_of_the_project(name: str, project: Path) -> None:
    (project / name).write_text("kept")
    said = refused(project, "preflight", "part.nc", "--machine", "hurco", "--json", name)
    assert name in said and ("name a .json file" in said or "the project's own" in said)
    assert (project / name).read_text() == "kept"


def test_words_that_are_passed_over_are_told_on_screen(project: Path) -> None:
    (project / "part.nc").write_text(PART.replace("N90 ", "POPEN\nN90 "))
    for words in (("interpret", "part.nc", "--out", "moves.csv"),
                  ("simulate", "part.nc", "--machine", "mill01")):  # fmt: skip
        said = " ".join(kerf(project, *words).stdout.split())
        assert "part.nc: POPEN is passed over (line 11)" in said, words


def test_what_is_done_in_no_time_is_told(project: Path) -> None:
    machine = project / "conf/machine/hurco.yaml"
    known = kerf(project, *SIMULATE)
    assert "in 0 s" not in known.output
    lines, inside_section = [], False
    for line in machine.read_text().splitlines():
        inside_section = line == "  auxiliary:" or (inside_section and line.startswith("    "))
        if not inside_section:
            lines.append(line)
    machine.write_text("\n".join(lines) + "\n")
    done = kerf(project, *SIMULATE, "--json", "p.json")
    assert "1 tool change(s) are done in 0 s, since their time is not known" in done.output
    assert "control.auxiliary.spindle_acceleration in conf/machine/hurco.yaml" in done.output
    told = json.loads((project / "p.json").read_text())["without_time"]
    assert told == {"tool_change": 1, "spindle_acceleration": 1}


def test_a_control_that_reads_linuxcnc_blends_corners_where_its_file_says_nothing(
    project: Path,
) -> None:
    machine = project / "conf/machine/hurco.yaml"
    machine.write_text(machine.read_text().replace("\nsetup:\n", "\nsetup:\n  dialect: linuxcnc\n"))
    zigzag = "\n".join(f"X{x} Y{x % 2}" for x in range(1, 21))
    times = []
    for word in ("G61", "G64 P0.01", "G64 P0.1"):
        (project / "zigzag.ngc").write_text(f"G21 G90 F3000\n{word}\nG1 X0 Y0\n{zigzag}\nM2\n")
        done = kerf(project, "simulate", "zigzag.ngc", "--machine", "hurco", "--json", "z.json")
        assert done.exit_code == 0, done.output
        times.append(json.loads((project / "z.json").read_text())["total_time_s"])
        (project / "z.json").unlink()
    assert times[0] > 1.02 * times[1] > 1.02 * 1.02 * times[2]


def test_a_restart_is_said_without_a_file_of_moves(project: Path) -> None:
    done = kerf(project, "interpret", "part.nc", "--at", "8")
    assert done.exit_code == 0
    for words in ("in force before line 8", "T1", "S6000 M3", "G94 F300", "X0 Y0 Z-1"):
        assert words in done.stdout
    found = json.loads(kerf(project, "interpret", "part.nc", "--at", "8", "--json", "-").stdout)
    assert found["program"][:3] == [0.0, 0.0, -1.0] and found["words"]["plane"] == "G17"


BEYOND = "G21 G90 G54\nT4 M6\nS30000 M3\nG0 X5000 Y0 Z5\nG1 Z-1 F99000\nM30\n"


def test_a_program_that_leaves_the_machine_is_said_before_anything_else(project: Path) -> None:
    (project / "part.nc").write_text(BEYOND)
    done = kerf(project, "simulate", "part.nc", "--machine", "mill01", "--json", "times.json")
    lines = done.stdout.splitlines()
    for line, word, value, limit in (
        (3, "S", "30000 rev/min", "12000"), (4, "X", "4590 mm", "-800 to 0"),
        (5, "F", "99000 mm/min", "15000"),
    ):  # fmt: skip
        (said,) = [one for one in lines[:3] if one.startswith(f"warning: line {line}: {word} ")]
        assert value in said and limit in said
    assert (
        lines[3] == "warning: part.nc leaves the limits of mill01 3 times: do not run it as it is"
    )
    stored = json.loads((project / "times.json").read_text())["preflight"]["violations"]
    assert [(one["line"], one["what"]) for one in stored] == [(3, "S"), (4, "X"), (5, "F")]


def test_preflight_ends_with_1_where_the_machine_cannot_do_it(project: Path) -> None:
    done = kerf(project, "preflight", "part.nc", "--machine", "mill01")
    assert done.exit_code == 0 and "stays inside" in done.stdout, done.output
    (project / "part.nc").write_text(BEYOND)
    done = kerf(project, "preflight", "part.nc", "--machine", "mill01", "--json", "-")
    assert done.exit_code == 1
    found = json.loads(done.stdout)
    assert [one["value"] for one in found["violations"]] == [30000.0, 4590.0, 99000.0]
    done = kerf(project, "preflight", "part.nc", "--machine", "hurco")
    assert "not listed in conf/machine/hurco.yaml, not checked: travel of X, Z" in done.stdout


def test_a_dwell_is_sure_to_the_controls_tick(project: Path) -> None:
    """Its time is programmed: the share by which motion is missed is none of the dwell's."""
    control = replace(simulate_in(project).path.control, interpolation_period=0.004)
    model = replace(
        control_model(hurco02=control, hurco04=control),
        intervals={WHOLE: Band(lower=0.05, upper=0.1, n=9, groups=9)},
    )
    write_json(model, project / "data/champion/hurco/control/model.json")
    (project / "dwell.nc").write_text("G21 G90\nG4 P3600000\nG4 X1.5\nM30\n")
    kerf(project, "simulate", "dwell.nc", "--machine", "hurco", "--json", "times.json")
    found = json.loads((project / "times.json").read_text())
    assert found["total_time_90_s"] == [3601.492, 3601.508]
    (project / "both.nc").write_text("G21 G90\nG4 P3600000\nG1 X100 F100\nM30\n")
    kerf(project, "simulate", "both.nc", "--machine", "hurco", "--json", "times.json")
    found = json.loads((project / "times.json").read_text())
    motion = found["total_time_s"] - 3600
    low, high = 3600 + 0.95 * motion - 0.004, 3600 + 1.1 * motion + 0.004
    assert found["total_time_90_s"] == [pytest.approx(low, abs=1e-3), pytest.approx(high, abs=1e-3)]


def test_a_simulation_says_one_interval_of_a_time(project: Path) -> None:
    """What is no interval of this time is named for what it is, without a ±."""
    control = simulate_in(project).path.control
    model = replace(
        control_model(hurco02=control, hurco04=control),
        intervals={WHOLE: Band(lower=0.05, upper=0.1, n=9, groups=9)},
    )
    write_json(model, project / "data/champion/hurco/control/model.json")
    text = kerf(project, *SIMULATE).stdout
    assert text.count("90 % interval") == 1 and "±" not in text
    assert "times count with a standard deviation of 25 %" in text


def simulate_in(project: Path) -> Plan:
    with inside(project):
        return simulate_program(Path("part.nc"), "hurco", None, lambda done: None).plan
