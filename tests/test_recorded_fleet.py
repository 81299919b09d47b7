"""The main job on the recordings of a real machine: judged, reported, and built again by parts."""

import json
import os
import shutil
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from pipeline.app.fleet import collect, use_fleet
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.stages.__main__ import run
from pipeline.twin.spindle import SpindleModelFile
from tests.browser import foreign, look, needs_browser, requests
from tests.small_project import ROOT, inside, leave, with_conf

RECORDINGS = os.environ.get("KERF_RECORDINGS")
pytestmark = pytest.mark.skipif(
    not RECORDINGS, reason="KERF_RECORDINGS names no folder of real recordings"
)
MODEL = "data/models/mazak01/spindle"


def build(project: Path) -> None:
    """Every stage of the recorded fleet, in the order of dvc.yaml."""
    with inside(project):
        run("ingest@mazak01", "data/raw/mazak01", "data/signals/mazak01")
        run("clean@mazak01", "data/signals/mazak01", "data/clean/mazak01")
        reads = ("data/signals/mazak01/manifest.json", "data/clean/mazak01", MODEL)
        run("identify_spindle@mazak01", *reads, "data/golden")
        run("judge_spindle@mazak01", *reads, "data/golden", "data/metrics/mazak01_spindle.json",
            "data/plots/mazak01_spindle")  # fmt: skip
        places = ("signals", "clean", "models", "champion", "golden", "truth", "programs", "parts",
                  "trials", "history", "ledger", "twin_state", "condition", "incidents",
                  "settings/sections")  # fmt: skip
        run("report", *(f"data/{p}" for p in places),
            "reports", "data/metrics/report.json")  # fmt: skip


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Path:
    folder = with_conf(tmp_path_factory.mktemp("recorded"))
    leave(folder, "recorded", "mazak01")
    shutil.copytree(ROOT / "data/golden", folder / "data/golden")
    with inside(folder):
        found = collect(use_fleet("recorded"), Path(RECORDINGS or ""))
        assert [files for _, _, files in found] == [15]
        run("compose", "conf", "params.yaml", "data/settings")
    build(folder)
    return folder


@pytest.mark.proof
def test_every_recording_of_the_fleet_is_collected(tmp_path):
    shutil.copytree(ROOT / "conf", tmp_path / "conf")
    with inside(tmp_path):
        found = collect(use_fleet("recorded"), Path(RECORDINGS or ""))
        assert {machine: files for machine, _, files in found} == {
            "mazak01": 15,
            "hurco": 23,
            "emps": 1,
            "umich_mill": 14,
            "kistler_slot": 2,
            "fanuc_millturn": 1,
            "uniwear": 1,
        }


def test_nothing_is_lost_or_rejected(project):
    files = json.loads((project / "data/signals/mazak01/manifest.json").read_text())["files"]
    assert len(files) == 14
    for name, entry in files.items():
        lines = (project / "data/raw/mazak01" / name).read_bytes().count(b"\n")
        assert entry["read"] == entry["kept"] + entry["rejected"] == lines, name
        assert entry["rejected"] == 0, name


def test_every_golden_day_is_within_the_limits_and_better_than_persistence(project):
    verdict = read_json(project / MODEL / "verdict.json", Verdict)
    assert verdict.status == "passed", verdict.reasons
    scores = verdict.of("spindle_temperature", role="golden")
    days = [s for s in scores if s.regime == "windows" and s.group != "all"]
    assert [s.group for s in days] == ["2019-05-20", "2019-05-21", "2019-05-22"]
    for day in days:
        assert day.mae < 2.0
        assert day.rmse < 3.0
        assert day.rmse < day.baselines["persistence"].rmse
    metrics = json.loads((project / "data/metrics/mazak01_spindle.json").read_text())
    (total,) = [s for s in scores if s.regime == "windows" and s.group == "all"]
    assert metrics["status"] == "passed" and metrics["cases_judged"] == len(days)
    assert metrics["spindle_temperature, windows"]["mae"] == total.mae


def test_the_forest_that_does_not_help_is_not_used(project):
    about = read_json(project / MODEL / "model.json", SpindleModelFile).forest
    helps = about.rmse_days_left_out_K < about.rmse_without_K
    assert not about.used or helps


@needs_browser
def test_the_report_opens_without_an_error_or_a_request(project, browser):
    page = project / "reports/mazak01.html"
    look(browser, page, 1280, "light")
    assert foreign(requests(browser)) == []
    assert browser.get_log("browser") == []
    assert "mazak01" in browser.find_element("tag name", "h1").text
    assert "public domain" in browser.find_element("tag name", "body").text


@pytest.mark.proof
def test_one_new_day_is_read_alone_and_gives_what_a_build_from_nothing_gives(project, tmp_path):
    raw = "data/raw/mazak01/week_2019-05-20/Mazak01-20190522-20190523.txt"
    grown, whole = tmp_path / "grown", project
    for part in ("conf", "data/golden", "data/raw", "data/settings"):
        shutil.copytree(whole / part, grown / part)
    shutil.copy(whole / "params.yaml", grown)
    (grown / raw).unlink()
    with inside(grown):
        run("ingest@mazak01", "data/raw/mazak01", "data/signals/mazak01")
        run("clean@mazak01", "data/signals/mazak01", "data/clean/mazak01")
        shutil.copy(whole / raw, raw)
        before = {p: p.stat().st_mtime_ns for p in Path("data/signals").rglob("*.txt.parquet")}
        run("ingest@mazak01", "data/raw/mazak01", "data/signals/mazak01")
        run("clean@mazak01", "data/signals/mazak01", "data/clean/mazak01")
        now = {p: p.stat().st_mtime_ns for p in Path("data/signals").rglob("*.txt.parquet")}
    read = [p.name for p, at in now.items() if before.get(p) != at]
    assert read == ["week_2019-05-20__Mazak01-20190522-20190523.txt.parquet"]
    for folder in ("data/signals/mazak01", "data/clean/mazak01"):
        files = sorted(p.relative_to(whole) for p in (whole / folder).rglob("*.parquet"))
        assert files == sorted(p.relative_to(grown) for p in (grown / folder).rglob("*.parquet"))
        for file in files:
            assert pq.read_table(whole / file).equals(pq.read_table(grown / file)), file
