"""`kerf simulate --corrected` and the stage that writes corrected commands."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from pipeline.app.simulate import correction_lines
from pipeline.gcode.setup import Setup
from pipeline.schema.bundle import bundle_of
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.correct_programs import correct_programs
from pipeline.submodels.following_residual import model as residual_model
from pipeline.submodels.following_residual.model import residual_of
from pipeline.twin.command_correction import CommandCorrectionSettings
from pipeline.twin.control import ControlRecords
from pipeline.twin.program_axes import commanded_positions
from tests.small_project import ROOT, inside, with_conf
from tests.test_cli import kerf, refused
from tests.test_program_commands import PART, control_model, simulate_program

WORDS = ("simulate", "part.nc", "--machine", "hurco", "--corrected", "corrected.csv")
NONE = "none: no residual model of this machine passed"


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("KERF_RECORDINGS", raising=False)
    folder = with_conf(tmp_path / "project")
    (folder / "part.nc").write_text(PART)
    return folder


def drive_axis() -> dict[str, object]:
    way = {"coulomb": 100.0, "static": 120.0, "stribeck_velocity": 0.005, "viscous": 300.0}
    return {
        "command_unit": "A", "force_unit": "N",
        "fit": {"samples": 1, "relative_error_percent": None, "bandwidth_Hz": None,
                "condition": None, "rank": 1, "correlation": {}},
        "servo": {"position_gain": 40.0, "velocity_gain": 600.0, "integral_gain": 30000.0},
        "feed_drive": {"mass": 800.0, "force_constant": 400.0,
                       "friction": {"positive": way, "negative": way}},
    }  # fmt: skip


def with_drives(project: Path, machine: str = "hurco", **axes: dict[str, object]) -> Path:
    """A champion with drives; its folder."""
    model = {"submodel": "drive", "machine": machine, "origin": "recorded", "parameters": {},
             "trained_on": [], "axes": axes}  # fmt: skip
    folder = project / "data/champion" / machine
    (folder / "drive").mkdir(parents=True)
    (folder / "drive/model.json").write_text(json.dumps(model))
    write_json(judged("drive", "passed"), folder / "drive/verdict.json")
    return folder


def judged(submodel: str, status: str) -> Verdict:
    return Verdict(submodel=submodel, machine="hurco", origin="recorded", status=status,
                   reasons=(), judged_role=None, golden=None, scores=())  # fmt: skip


def read(path: Path) -> tuple[list[str], pd.DataFrame]:
    """Comments and table of a corrected command."""
    head = [line for line in path.read_text().splitlines() if line.startswith("#")]
    return head, pd.read_csv(path, comment="#")


def test_the_file_holds_commanded_and_corrected_positions_in_the_machines_frame(project) -> None:
    folder = with_drives(project, X=drive_axis(), Y=drive_axis(), Z=drive_axis())
    done = kerf(project, *WORDS, "--json", "times.json")
    assert done.exit_code == 0, done.output
    head, table = read(project / "corrected.csv")
    assert list(table) == [
        "t",
        "X",
        "X_corrected",
        "Y",
        "Y_corrected",
        "Z",
        "Z_corrected",
        "cutting",
    ]
    cut = table["cutting"].to_numpy()
    assert set(cut) == {0, 1} and not cut[0] and not cut[-1]
    assert "machine's frame" in " ".join(head) and f"# residual network: {NONE}" in head
    with inside(project):
        plan = simulate_program(Path("part.nc"), "hurco", None, lambda done: None).plan
    commanded = commanded_positions(plan)
    now = table[(table["t"] > -1e-4) & (table["t"] < commanded.time[-1] + 1e-4)]
    np.testing.assert_allclose(now["t"], commanded.time, atol=0.6e-6)
    for i, letter in enumerate("XYZ"):
        np.testing.assert_allclose(now[letter], commanded.position[:, i] * 1e3, atol=0.6e-6)
        assert np.ptp(table[f"{letter}_corrected"] - table[letter]) > 0.1
    # a steady feed of 1200 mm/min needs a lead of speed over loop gain
    speed = np.gradient(table["X"], table["t"]) / (1200 / 60)
    steady = np.convolve(np.abs(speed - 1) < 1e-3, np.ones(801), "same") == 801
    lead = (table["X_corrected"] - table["X"])[steady]
    assert len(lead) > 1000
    np.testing.assert_allclose(lead, 1200 / 60 / 40, rtol=0.01)
    found = json.loads((project / "times.json").read_text())["correction"]
    assert "rapids are commanded as planned" in " ".join(done.stdout.split())
    assert found["file"] == "corrected.csv" and found["residual"] == NONE
    assert "holds no bundle.json" in found["champion"]
    for axis in found["axes"]:
        # Z is at its limit just before it cuts: not all of its lag can be made up by then
        least = 0.4 if axis["axis"] == "Z" else 0.1
        assert axis["cut_rms_after_um"] < least * axis["cut_rms_before_um"]
        assert axis["half_width_90_um"] is None
        assert f"{axis['rms_before_um']:.1f}" in done.stdout
        assert f"{axis['rms_after_um']:.1f}" in " ".join(head)
    write_json(bundle_of(folder, "hurco", ["drive"]), folder / "bundle.json")
    assert kerf(project, *WORDS).exit_code == 0
    head, _ = read(project / "corrected.csv")
    sha = bundle_of(folder, "hurco", ["drive"]).sha256
    assert f"champion: bundle {sha[:12]} (drive passed)" in " ".join(head)
    entry = {"version": 7, "bundle": sha, "since": "", "by": "a person", "why": "better"}
    (project / "champions.json").write_text(json.dumps({"machines": {"hurco": entry}}))
    assert kerf(project, *WORDS).exit_code == 0
    assert f"champion: version 7, bundle {sha[:12]}" in (project / "corrected.csv").read_text()


def test_an_axis_without_a_servo_has_no_columns_and_none_is_one_sentence(project) -> None:
    assert "hurco/drive/model.json does not exist" in refused(project, *WORDS)
    bare = drive_axis() | {"servo": None, "servo_reason": "no reference"}
    with_drives(project, X=bare, Y=drive_axis())
    assert kerf(project, *WORDS).exit_code == 0
    assert list(read(project / "corrected.csv")[1]) == ["t", "Y", "Y_corrected", "cutting"]
    (project / "part.nc").write_text("G21 G90 G94\nG1 X30 F500\nM30\n")
    (project / "corrected.csv").unlink()
    said = refused(project, *WORDS)
    assert "no linear axis with an identified servo moves in the program" in said
    assert not (project / "corrected.csv").exists()
    assert "the program itself" in refused(project, *WORDS[:-1], "part.nc")


def test_a_residual_is_used_where_its_model_passed(project, monkeypatch) -> None:
    folder = with_drives(project, X=drive_axis(), Y=drive_axis(), Z=drive_axis())

    def residual(letter, reference, modelled_error, modelled_command, period):
        return np.full(len(reference), 7e-6), np.full(len(reference), 3e-6)

    loaded = SimpleNamespace(residual=residual)
    monkeypatch.setattr(residual_model, "load_residual", lambda found: loaded)
    write_json({}, folder / "following_residual/model.json")
    for status in ("failed", "not judged"):
        write_json(judged("following_residual", status), folder / "following_residual/verdict.json")
        assert residual_of(folder) == (None, NONE)
    write_json(judged("following_residual", "passed"), folder / "following_residual/verdict.json")
    done = kerf(project, *WORDS, "--json", "times.json")
    assert done.exit_code == 0, done.output
    found = json.loads((project / "times.json").read_text())["correction"]
    assert found["residual"].startswith("residual network ")
    assert [axis["half_width_90_um"] for axis in found["axes"]] == [3.0] * 3
    _, table = read(project / "corrected.csv")
    still = (table["cutting"] == 1) & (np.gradient(table["Y"], table["t"]) == 0)
    added = (table["Y_corrected"] - table["Y"])[still]
    assert np.median(added) == pytest.approx(7e-3, abs=1e-3)
    rapid = table["t"] < 0  # before the program nothing is asked for
    np.testing.assert_array_equal(table["Y_corrected"][rapid], table["Y"][rapid])


def test_simulate_adds_the_residual_of_a_model_that_passed(project, monkeypatch) -> None:
    words = ("simulate", "part.nc", "--machine", "hurco", "--json", "times.json")
    assert "hurco/drive/model.json does not exist" in refused(project, *words, "--residual")
    folder = with_drives(project, X=drive_axis(), Y=drive_axis(), Z=drive_axis())
    said = refused(project, *words, "--residual")
    assert "hurco/following_residual holds no residual model that passed" in said

    def residual(letter, reference, modelled_error, modelled_command, period):
        width = np.nan if letter == "Z" else 3e-6
        return 0.5 * modelled_error * (letter != "Z"), np.full(len(reference), width)

    loaded = SimpleNamespace(residual=residual)
    monkeypatch.setattr(residual_model, "load_residual", lambda found: loaded)
    write_json({}, folder / "following_residual/model.json")
    write_json(judged("following_residual", "failed"), folder / "following_residual/verdict.json")
    assert "that passed" in refused(project, *words, "--residual")
    write_json(judged("following_residual", "passed"), folder / "following_residual/verdict.json")
    assert kerf(project, *words).exit_code == 0
    bare = json.loads((project / "times.json").read_text())
    assert "residual" not in bare
    assert all(one["half_width_90_um"] is None for one in bare["axes"])  # a drive without interval
    done = kerf(project, *words, "--residual")
    assert done.exit_code == 0, done.output
    found = json.loads((project / "times.json").read_text())
    assert found["residual"].startswith("residual network ") and found["residual"] in done.stdout
    more = {"X": 1.5, "Y": 1.5, "Z": 1.0}
    for before, after in zip(bare["axes"], found["axes"], strict=True):
        expected = more[after["axis"]] * before["max_following_um"]
        assert after["max_following_um"] == pytest.approx(expected, abs=2e-3)
        assert after["half_width_90_um"] == (None if after["axis"] == "Z" else 3.0)
    assert (
        done.stdout.count("± 3.0 um in line") == 2
        and done.stdout.count("(interval not learnt)") == 1
    )


def test_the_stage_writes_a_file_a_program(project) -> None:
    folder = with_drives(project, X=drive_axis(), Y=drive_axis())
    with inside(project):
        plan = simulate_program(Path("part.nc"), "hurco", None, lambda done: None).plan
    model = control_model(hurco02=plan.path.control)
    write_json(model, folder / "control/model.json")
    raw, written = project / "raw", project / "data/corrected/hurco"
    (raw / "programs").mkdir(parents=True)
    (raw / "programs/good.nc").write_text(PART)
    (raw / "programs/bad.nc").write_text("G21 G90\nG2 X20 Y0 I500 F100\nM30\n")
    records = ControlRecords(
        logs="*.txt", programs="programs/*.nc", units={"hurco02": "*"}, default_unit="hurco02"
    )
    correct_programs(
        raw, folder, written, identity=MachineIdentity(name="hurco"), setup=Setup(),
        control_records=records, command_correction=CommandCorrectionSettings(longest_s=12.0),
    )  # fmt: skip
    head, table = read(written / "good.csv")
    assert list(table) == ["t", "X", "X_corrected", "Y", "Y_corrected", "cutting"]
    assert table["t"].iloc[-1] == pytest.approx(12.0) and "only the first 12 s" in " ".join(head)
    assert "program: good; origin: recorded" in " ".join(head)
    said = (written / "bad.csv").read_text()
    assert said.startswith("# Kerf: no corrected command of bad: ") and "bad.nc:2" in said
    assert len(said.splitlines()) == 1


def test_the_section_of_conf_is_that_of_the_settings() -> None:
    from pipeline.parameters import read_params, structure

    section = structure(
        read_params(ROOT / "params.yaml"), "command_correction", CommandCorrectionSettings
    )
    assert section == CommandCorrectionSettings()


def test_what_becomes_of_rapids_is_told() -> None:
    axis = {
        "axis": "X", "rms_before_um": 9.0, "rms_after_um": 1.0, "max_before_um": 90.0,
        "max_after_um": 41.7, "cut_rms_before_um": 8.0, "cut_rms_after_um": 0.5,
        "half_width_90_um": None, "limited_percent": 0.0,
    }  # fmt: skip
    last = list(correction_lines({"file": "f.csv", "residual": NONE, "axes": [axis]}))[-1]
    assert "rapids are commanded as planned" in last and "stays behind by up to 42 um" in last
