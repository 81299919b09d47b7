"""Hashes of the recordings that the sections of a machine name: each changes with its own alone."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from pipeline.schema.golden import Days, FrozenSet, GoldenSets
from pipeline.schema.model import SourceFile
from pipeline.schema.store import write_json
from pipeline.stages.__main__ import load_stage, run
from pipeline.stages.index import FROZEN, TIMED, index, is_named, texts
from tests.small_project import inside, with_conf

SECTIONS = {
    "identity": {"name": "mill"},
    "records": [{"format": "csv", "files": "*/*.csv"}],
    "roles": {"training": ["servo/*", "cuts/*"]},
    "drive_records": {"recordings": "servo/*.csv", "motor": {"recordings": "motor/*.csv"}},
    "cutting_records": {"spindle": {"cuts": [{"log": "cuts/*.txt", "program": "cuts/O1.nc"}]}},
    "drive": {"axes": {"X": {"lead": 10.0}}},
}
FILES: dict[str, dict[str, Any]] = {
    "agent/2026-01-05.txt": {"sha256": "a", "last": "2026-01-05T16:00:00Z"},
    "cuts/O1-run1.txt": {"sha256": "b", "last": "2026-01-06T16:00:00Z"},
    "cuts/O1.nc": {"sha256": "c", "last": None},
    "motor/X.csv": {"sha256": "d", "last": None},
    "servo/X.csv": {"sha256": "e", "last": None, "made_from": {"parameters": "p"}},
}


def hashes(root: Path, files: dict[str, dict[str, Any]]) -> dict[str, str]:
    (root / "manifest.json").write_text(json.dumps({"files": files}))
    (root / "mill.json").write_text(json.dumps(SECTIONS))
    index(root / "manifest.json", root / "mill.json", root / "golden", root / "index.json",
          root / "models/mill/machine.json")  # fmt: skip
    found: dict[str, str] = json.loads((root / "index.json").read_text())
    return found


@pytest.mark.parametrize(
    ("file", "entry", "changed"),
    [
        ("agent/2026-01-07.txt", {"sha256": "f", "last": "2026-01-07T16:00:00Z"}, {TIMED}),
        ("servo/Y.csv", {"sha256": "f", "last": None}, {"drive_records"}),
        ("servo/X.csv", {**FILES["servo/X.csv"], "sha256": "f"}, {"drive_records"}),
        ("servo/X.csv", {**FILES["servo/X.csv"], "made_from": {}}, {"drive_records"}),
        ("motor/X.csv", {"sha256": "f", "last": None}, {"drive_records"}),
        ("cuts/O1.nc", {"sha256": "f", "last": None}, {"cutting_records"}),
        ("cuts/O1-run2.txt", {"sha256": "f", "last": "2026-01-07T16:00:00Z"},
         {TIMED, "cutting_records"}),
        ("growth/1.csv", {"sha256": "f", "last": None}, set()),
    ],
)  # fmt: skip
def test_a_recording_changes_the_hashes_of_what_reads_it(
    tmp_path: Path, file: str, entry: dict[str, Any], changed: set[str]
) -> None:
    before, after = hashes(tmp_path, FILES), hashes(tmp_path, {**FILES, file: entry})
    assert {name for name in before if before[name] != after[name]} == changed


def test_a_frozen_set_is_held_against_the_records(tmp_path: Path) -> None:
    none = hashes(tmp_path, FILES)[FROZEN]
    days = Days(first="2026-01-05", last="2026-01-06")
    files = tuple(
        SourceFile(file=name, sha256=FILES[name]["sha256"])
        for name in ("agent/2026-01-05.txt", "cuts/O1-run1.txt")
    )
    sets = GoldenSets(machine="mill", golden=FrozenSet(files=files, days=days))
    write_json(sets, tmp_path / "golden/mill.json")
    whole = hashes(tmp_path, FILES)[FROZEN]
    assert whole != none
    late = {"sha256": "f", "last": "2026-01-06T17:00:00Z"}  # reaches into the frozen days
    assert hashes(tmp_path, {**FILES, "agent/2026-01-06.txt": late})[FROZEN] != whole
    write_json(GoldenSets(machine="mill", golden=FrozenSet(files=files[:1], days=days)),
                 tmp_path / "golden/mill.json")  # fmt: skip
    assert hashes(tmp_path, FILES)[FROZEN] not in (none, whole)  # another set
    write_json(sets, tmp_path / "golden/mill.json")
    write_json(sets, tmp_path / "golden/lathe.json")  # another machine's
    later = {"sha256": "f", "last": "2026-01-07T17:00:00Z"}
    assert hashes(tmp_path, {**FILES, "agent/2026-01-07.txt": later})[FROZEN] == whole


MACHINE = "mill00"
SECTION = {
    "control": "control_records", "drive": "drive_records", "cutting": "cutting_records",
    "deformation": "deformation_records", "following_residual": "following_residual_records",
    "wear": "wear_records",
}  # fmt: skip


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Records of the first fleet's mill, read."""
    folder = with_conf(tmp_path_factory.mktemp("index") / "project", "demo")
    with inside(folder):
        run("compose", "conf", "params.yaml", "data/settings")
        run(f"shop@{MACHINE}", f"data/raw/{MACHINE}", f"data/truth/{MACHINE}.json")
        run(f"ingest@{MACHINE}", f"data/raw/{MACHINE}", f"data/signals/{MACHINE}")
    return folder


@pytest.mark.proof
@pytest.mark.parametrize("name", SECTION)
def test_a_fit_reads_no_recordings_but_those_of_its_hash(
    recorded: Path, tmp_path: Path, name: str
) -> None:
    """The same model comes out where all other recordings are gone."""
    raw, signals = f"data/raw/{MACHINE}", f"data/signals/{MACHINE}"
    alone = tmp_path / "alone"
    shutil.copytree(recorded, alone)
    files = json.loads((alone / signals / "manifest.json").read_text())["files"]
    settings = json.loads((alone / f"data/settings/machine/{MACHINE}.json").read_text())
    mine = [one for one in files if is_named(one, texts(settings[SECTION[name]]))]
    assert 0 < len(mine) < len(files)
    for one in set(files) - set(mine):
        (alone / raw / one).unlink()
        if files[one]["output"]:
            (alone / signals / files[one]["output"]).unlink()
    stage = load_stage(f"identify_{name}")
    places = {"raw": raw, "signals": signals, "drive": "data/none", "folder": "model",
              "golden": "data/golden"}  # fmt: skip
    for folder in (recorded, alone):
        with inside(folder):
            run(f"identify_{name}@{MACHINE}", *(places[one] for one in stage.paths))
    model = Path("model/model.json")
    assert (recorded / model).read_bytes() == (alone / model).read_bytes()
