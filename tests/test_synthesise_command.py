"""kerf synthesise: what it writes and says, what it refuses, the wear that explains a recording."""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from pipeline.schema.store import read_json, write_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.synthesis.model import load_synthesis
from tests.served_project import MACHINE, served_project
from tests.served_project import run as run_command
from tests.submodels.synthesis.generated_lives import once

run = partial(run_command, "synthesise")
GIVEN = ("--wear", "120", "--set", "feed=300", "--set", "cut_type=slot")


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("synthesise")
    built = once(tmp_path_factory)
    verdict = replace(built.judged().verdict, status="passed", reasons=())
    project = served_project(root / "project", built.folder, verdict)
    held = next(one for one in built.cases.cases if one.name == "T8").load().windows
    worn = held.of(held.wear >= np.sort(held.wear)[-4])
    frame = pd.DataFrame(np.concatenate(list(worn.values), axis=1).T, columns=list(worn.channels))
    frame.to_csv(project / "worn.csv", index=False)
    (project / "asked.json").write_text(json.dumps({"wear": float(worn.wear.mean())}))
    return project


def test_parquet_holds_windows_with_units_and_the_label(project: Path) -> None:
    status, said = run(*GIVEN, "--n", "7", "--out", "w.parquet")
    assert status == 0, said
    assert "rig (simulated): 7 synthetic windows at wear 120 um, feed 300 mm/min" in said
    table = pq.read_table(project / "w.parquet")
    assert table.num_rows == 7 * 100
    units = {one.name: (one.metadata or {}).get(b"unit", b"").decode() for one in table.schema}
    assert units["time"] == "s"
    assert (units["wear"], units["feed"]) == ("um", "mm/min")
    assert units["force"] and units["vibration"]
    head = json.loads(table.schema.metadata[b"kerf"])
    assert head["origin"] == "synthetic"
    assert head["trained_on"] == "simulated records of rig"
    assert head["conditions"]["cut_type"]["value"] == "slot"
    frame = table.to_pandas()
    assert frame["time"].max() == pytest.approx(0.099)
    assert (frame.groupby("window").size() == 100).all()


def test_the_windows_are_those_of_the_model(project: Path) -> None:
    run(*GIVEN, "--n", "3", "--seed", "5", "--out", "w.parquet")
    frame = pd.read_parquet(project / "w.parquet")
    served = load_synthesis(project / f"data/champion/{MACHINE}/synthesis")
    made = served.gan.sample(
        {"wear": np.full(3, 120.0), "feed": np.full(3, 300.0), "cut_type": np.full(3, "slot")},
        seed=5,
    )
    assert np.array_equal(frame["force"].to_numpy(), made[:, 0].ravel())


def test_csv_says_in_its_head_that_it_is_synthetic(project: Path) -> None:
    status, _ = run(*GIVEN, "--n", "2", "--out", "w.csv")
    assert status == 0
    lines = (project / "w.csv").read_text().splitlines()
    assert lines[0] == "# synthetic: generated, not recorded; simulated records of rig"
    assert json.loads(lines[1].removeprefix("# "))["seed"] == 0
    assert lines[2].startswith("window,sample,time [s],wear [um],feed [mm/min],cut_type,tool,force")
    assert len(lines) == 3 + 200


def test_the_same_seed_gives_the_same_bytes(project: Path) -> None:
    for name in ("a.parquet", "b.parquet"):
        run(*GIVEN, "--n", "2", "--out", name)
    assert (project / "a.parquet").read_bytes() == (project / "b.parquet").read_bytes()
    run(*GIVEN, "--n", "2", "--seed", "1", "--out", "c.parquet")
    assert (project / "a.parquet").read_bytes() != (project / "c.parquet").read_bytes()


@pytest.mark.parametrize(("words", "said"), [
    (("--wear", "900", "--set", "feed=300"), "wear = 900 um lies outside of what was learnt, 0 to"),
    (("--wear", "120", "--set", "feed=9"), "feed = 9 mm/min lies outside .* 300 to 600 mm/min"),
    ((*GIVEN[:4], "--set", "cut_type=drill"), "cut_type = 'drill' was not learnt: .*side, slot"),
    (("--wear", "120"), "condition feed is missing: give a value from 300 to 600 mm/min"),
    (("--set", "feed=300"), "condition wear is missing"),
    ((*GIVEN, "--set", "speed=1"), "speed is no condition of this model: it has wear, feed"),
    (("--wear", "much", "--set", "feed=300"), "wear = 'much' is no number: give one from 0 to"),
    ((*GIVEN, "--set", "feed"), "'feed' is not name=value"),
    ((*GIVEN, "--set", "feed=1"), "--set feed is given twice"),
    ((*GIVEN, "--n", "0"), "0 windows are none"),
])  # fmt: skip
def test_what_was_not_learnt_is_refused_by_name_and_range(project, words, said: str) -> None:
    status, output = run(*words, "--out", "w.parquet")
    assert status == 2
    assert pd.Series([" ".join(output.split())]).str.contains(said, regex=True).all(), output
    assert not (project / "w.parquet").exists()


def test_one_of_two_uses_has_to_be_named(project: Path) -> None:
    assert "give --out for windows to make, or --explain" in run(*GIVEN)[1]
    assert "--json holds what --explain finds" in run(*GIVEN, "--out", "w.csv", "--json", "x")[1]


def test_a_model_that_failed_is_used_only_where_one_says_so(project: Path) -> None:
    path = project / f"data/champion/{MACHINE}/synthesis/verdict.json"
    failed = replace(read_json(path, Verdict), status="failed", reasons=("far off",))
    write_json(failed, path)
    status, said = run(*GIVEN, "--out", "w.csv")
    assert status == 2
    assert "failed (far off)" in " ".join(said.split())
    assert run(*GIVEN, "--n", "1", "--out", "w.csv", "--anyway")[0] == 0
    assert run(*GIVEN, "--n", "1", "--out", "w.csv", "--model", "latest")[0] == 0


def test_a_machine_without_a_generator_says_what_to_record(project: Path) -> None:
    shutil.rmtree(project / f"data/champion/{MACHINE}")
    status, said = run(*GIVEN, "--out", "w.csv")
    assert status == 2
    assert "whole tool lives" in " ".join(said.split())


def test_a_worn_recording_is_explained_by_a_high_wear(project: Path) -> None:
    words = ("--explain", "worn.csv", "--set", "feed=600", "--set", "cut_type=side")
    status, said = run(*words, "--json", "found.json")
    assert status == 0, said
    assert "rig (simulated): wear" in said
    found = json.loads((project / "found.json").read_text())
    asked = json.loads((project / "asked.json").read_text())["wear"]
    assert abs(found["wear"] - asked) < 60.0
    assert found["as_good"][0] <= found["wear"] <= found["as_good"][1]
    assert len(found["profile"]) == 11


def test_windows_that_were_made_can_be_explained(project: Path) -> None:
    run("--wear", "10", *GIVEN[2:], "--n", "2", "--out", "w.csv")
    status, said = run("--explain", "w.csv", *GIVEN[2:], "--json", "found.json")
    assert status == 0, said
    assert json.loads((project / "found.json").read_text())["wear"] < 80.0


@pytest.mark.parametrize(("text", "said"), [
    ("force\n1\n", "has no column vibration: this generator needs force, vibration"),
    ("force,vibration\n1,2\n", "has 1 rows, a window 100: record at 1000 Hz for 0.1 s or longer"),
])  # fmt: skip
def test_a_recording_that_cannot_be_explained_is_refused(project, text: str, said: str) -> None:
    (project / "r.csv").write_text(text)
    status, output = run("--explain", "r.csv", "--set", "feed=300")
    assert status == 2
    assert said in " ".join(output.split())
