"""What to record next on the spindle's page and by the command."""

import json

import pytest
from typer.testing import CliRunner

from pipeline.app.commands import app
from pipeline.schema.golden import Days
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.identify import identify, judge
from pipeline.submodels.cases import Roles
from pipeline.submodels.contract import Shown
from pipeline.submodels.next_recording import COVERS, GROUPS, REMEDY
from pipeline.submodels.spindle.calibration import ForestSettings
from pipeline.submodels.spindle.days import IntervalSettings, SpindleLimits
from pipeline.submodels.spindle.fit import SpindleFitSettings
from pipeline.submodels.spindle.submodel import SUBMODEL, Fitting, Judging
from pipeline.twin.spindle import SpindleRecords
from tests.submodels.made_pages import made as page_made
from tests.submodels.made_pages import tables
from tests.submodels.spindle.test_submodel import records_of

IDENTITY = MachineIdentity(name="mill", description="a mill", origin="simulated")


def test_page_and_command_say_what_to_record_next(tmp_path, monkeypatch):
    records = records_of(tmp_path / "clean")
    folder = tmp_path / "data/models/mill/spindle"
    roles = Roles(training_days=Days(first="2026-01-05", last="2026-01-07"))
    about = {"identity": IDENTITY, "roles": roles, "spindle": SpindleRecords()}
    fitting = Fitting(
        **about, spindle_interval=IntervalSettings(folds=2),
        spindle_fit=SpindleFitSettings(
            nodes=(1,), time_constants_s=(1500.0,), step_s=60.0, compute="serial"
        ),
        residual_forest=ForestSettings(trees=2, depth=3, every_s=3600.0),
    )  # fmt: skip
    reads = {"manifest": records.manifest, "clean": records.clean}
    identify(SUBMODEL, reads, folder, settings=fitting)
    judging = Judging(**about, spindle_limits=SpindleLimits())
    judge(SUBMODEL, reads, folder, tmp_path, tmp_path / "m.json", tmp_path / "plots",
          settings=judging)  # fmt: skip
    verdict = read_json(folder / "verdict.json", Verdict)
    first = verdict.next_recordings[0]
    assert (first.method, first.minutes, first.now) == (REMEDY, None, None)
    few = [one for one in verdict.next_recordings if one.now]
    assert {one.method for one in few} == {COVERS, GROUPS}
    for one in few:  # three days say as much by chance
        assert one.gain_percent == pytest.approx(100 * (1 - one.expected / one.now), abs=0.5)
        assert 0 < one.gain_percent < one.uncertain_percent == 50.0

    shown = Shown(
        machine="mill", origin="simulated", model=read_json(folder / "model.json", SUBMODEL.model),
        verdict=verdict, predictions=None, folder=folder,
    )  # fmt: skip
    rows = tables(page_made(SUBMODEL, shown))["What to record next"]
    assert [row[0] for row in rows] == [one.proposal for one in verdict.next_recordings]
    assert all(row[0].startswith("no recording narrows it noticeably") for row in rows[1:])
    assert f"({few[0].gain_percent:g} %, it varies by chance by 50 %)" in rows[1][2]

    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf/machine").mkdir(parents=True)
    (tmp_path / "conf/machine/mill.yaml").write_text("")
    done = CliRunner().invoke(app, ["records", "-m", "mill", "--next", "--json", "next.json"])
    assert done.exit_code == 0, done.output
    assert f"spindle: {first.record}" in done.output
    stored = json.loads((tmp_path / "next.json").read_text())
    assert stored["spindle"][0]["method"] == first.method
    (folder / "verdict.json").unlink()
    failed = CliRunner().invoke(app, ["records", "-m", "mill", "--next"])
    assert failed.exit_code == 2
    assert "holds no verdict to go by" in failed.output
