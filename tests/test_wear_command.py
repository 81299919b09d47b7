"""kerf wear: wear of recordings with its interval, conditions that are given, what it refuses."""

import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.schema.store import read_json, unstructured, write_json
from pipeline.schema.verdict import Verdict
from tests.served_project import MACHINE, served_project
from tests.served_project import run as run_command
from tests.signals.wear_files import SOURCES, cut_table, wear_at, wear_records
from tests.submodels.wear.worn_tools import ROLES, build

run = partial(run_command, "wear")


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("wear")
    (root / "built").mkdir()
    built = build(root / "built")
    project = served_project(
        root / "project", built.folder, built.judged.verdict, built.signals,
        roles={"training": list(ROLES.training)}, records=unstructured(SOURCES),
        wear_records=unstructured(wear_records()),
    )  # fmt: skip
    shutil.copytree(root / "built/raw", project / f"data/raw/{MACHINE}")
    return project


def recording(path: Path, wear: float = 120.0, feed: float = 300.0, rate: float = 1000.0) -> Path:
    pq.write_table(pa.Table.from_pandas(cut_table(wear, feed, 12345, 300, rate)), path)
    return path


def test_a_recording_of_the_machine_has_its_conditions_in_the_table(project: Path) -> None:
    """T6 was held out; its fifth cut stands in lives.csv with feed and time in cut."""
    status, said = run(f"data/raw/{MACHINE}/wear/T6_004.parquet", "--json", "wear.json")
    assert status == 0, said
    assert said.startswith("rig (simulated): flank wear by ")
    told = json.loads(Path("wear.json").read_text())
    assert told["status"] == "passed" and told["unit"] == "um" and told["use_unit"] == "min"
    (one,) = told["readings"]
    truth = wear_at(4, 7, 6)
    assert one["low"] <= truth <= one["high"]
    assert one["wear"] == pytest.approx(truth, abs=15.0)
    assert one["use"] == pytest.approx(8.0)
    assert one["recording"] == "T6_004.parquet"
    assert "T6_004.parquet" in said and "90 % interval" in said


def test_an_interval_that_the_judge_calls_not_known_is_no_number(project: Path) -> None:
    path = project / f"data/champion/{MACHINE}/wear/verdict.json"
    verdict = read_json(path, Verdict)
    why = "90 % interval not known: 4 training cases"
    scores = [replace(s, unknown_interval=why) if (s.quantity, s.regime) == ("flank wear", "")
              else s for s in verdict.scores]  # fmt: skip
    write_json(replace(verdict, scores=tuple(scores)), path)
    status, said = run(f"data/raw/{MACHINE}/wear/T6_004.parquet", "--json", "wear.json")
    assert status == 0 and said.count("90 % interval") == said.count(why) == 1
    (one,) = json.loads(Path("wear.json").read_text())["readings"]
    assert (one["low"], one["high"]) == (None, None) and one["wear"] > 0


def test_conditions_of_a_new_recording_are_given(project: Path) -> None:
    path = recording(project / "new.parquet")
    status, said = run(path)
    assert status == 2
    assert "new.parquet: its cut_type is not known" in said or "its feed is not known" in said
    given = ("--set", "feed=300", "--set", "cut_type=slot")
    status, said = run(path, *given, "--json", "a.json")
    assert status == 0, said
    (one,) = json.loads(Path("a.json").read_text())["readings"]
    assert one["wear"] == pytest.approx(120.0, abs=20.0) and one["use"] is None
    assert "use of the tool is not known" in said
    status, said = run(path, *given, "--set", "time_in_cut=60")
    assert status == 0
    assert "time_in_cut of 60 min is beyond the 12 min of every training tool" in said


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("feed=900", "cut_type=slot"), "its feed is 900 mm/min, 300 to 600 mm/min were learnt"),
        (("feed=300", "cut_type=plunge"), "its cut_type is plunge, side, slot were learnt"),
        (("speed=300",), "--set speed=300 is no condition of the machine"),
        (("feed=fast",), "--set feed=fast is no number: give it in mm/min"),
    ],
)
def test_what_was_not_learnt_is_refused(project: Path, given: tuple[str, ...], words: str) -> None:
    path = recording(project / "new.parquet")
    status, said = run(path, *(part for one in given for part in ("--set", one)))
    assert status == 2
    assert words in " ".join(said.split())


def test_recordings_that_do_not_fit_are_refused(project: Path) -> None:
    given = ("--set", "feed=300", "--set", "cut_type=slot")
    slow = recording(project / "slow.parquet", rate=200.0)
    status, said = run(slow, *given)
    assert status == 2 and "slow.parquet: it is sampled at 200 Hz" in said
    table = cut_table(50.0, 300.0, 1, 300, 1000.0).drop(columns="vibration")
    pq.write_table(pa.Table.from_pandas(table), project / "less.parquet")
    status, said = run(project / "less.parquet", *given)
    assert status == 2 and "'vibration'" in said and "missing" in said
    status, said = run(project / "none.parquet", *given)
    assert status == 2 and "does not exist" in said


def test_a_model_that_did_not_pass_is_used_only_by_word(project: Path) -> None:
    path = project / f"data/champion/{MACHINE}/wear/verdict.json"
    write_json(replace(read_json(path, Verdict), status="failed", reasons=("T6: off",)), path)
    recorded = f"data/raw/{MACHINE}/wear/T6_004.parquet"
    status, said = run(recorded)
    assert status == 2 and "failed (T6: off)" in said
    status, said = run(recorded, "--anyway")
    assert status == 0 and "WARNING: the wear model failed" in said
    status, said = run(recorded, "--model", "latest")
    assert status == 0 and "with data/models/rig, not with the champion" in said
    shutil.rmtree(path.parent)
    status, said = run(recorded)
    assert status == 2 and "holds no model" in said


def test_json_does_not_replace_a_recording(project: Path) -> None:
    recorded = f"data/raw/{MACHINE}/wear/T6_004.parquet"
    status, said = run(recorded, "--json", recorded)
    assert status == 2 and recorded in said
