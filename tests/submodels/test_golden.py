"""The golden week is frozen by hash, and nothing that changes it goes unsaid."""

import json
from pathlib import Path
from typing import Any

import pytest

from pipeline.validation.golden import (
    GoldenWeek,
    Week,
    changes,
    freeze,
    read_golden,
    write_golden,
)

WEEK = Week(first="2026-01-19", last="2026-01-25")


def manifest() -> dict[str, dict[str, Any]]:
    return {
        "b.txt": {"sha256": "b" * 64, "first": "2026-01-01T00:00:00Z", "last": "2026-01-25T23:59Z"},
        "a.txt": {"sha256": "a" * 64, "last": "2026-01-19T00:00:00Z"},
        "before.txt": {"sha256": "c" * 64, "last": "2026-01-18T23:59:59Z"},
        "after.txt": {"sha256": "d" * 64, "last": "2026-01-26T00:00:00Z"},
        "empty.txt": {"sha256": "e" * 64, "last": None},
    }


def test_the_files_that_reach_into_the_week_are_frozen_in_order() -> None:
    golden = freeze("mill", WEEK, manifest())
    assert [f.file for f in golden.files] == ["a.txt", "b.txt"]
    assert golden.files[1].sha256 == "b" * 64
    assert changes(golden, manifest()) == []


def test_it_comes_back_from_disk(tmp_path: Path) -> None:
    golden = freeze("mill", WEEK, manifest())
    write_golden(golden, tmp_path / "golden/mill.json")
    assert read_golden(tmp_path / "golden/mill.json") == golden


def test_its_hash_is_of_names_and_contents() -> None:
    golden = freeze("mill", WEEK, manifest())
    changed = manifest()
    changed["a.txt"]["sha256"] = "f" * 64
    renamed = manifest()
    renamed["z.txt"] = renamed.pop("a.txt")
    hashes = {golden.sha256, freeze("mill", WEEK, changed).sha256}
    hashes.add(freeze("mill", WEEK, renamed).sha256)
    assert len(hashes) == 3
    elsewhere = {k: v for k, v in manifest().items() if k != "after.txt"}
    assert freeze("mill", WEEK, elsewhere).sha256 == golden.sha256


def test_every_change_is_said() -> None:
    golden = freeze("mill", WEEK, manifest())
    later = manifest()
    del later["a.txt"]
    later["b.txt"]["sha256"] = "0123456789abcdef"
    later["late.txt"] = {"sha256": "9" * 64, "last": "2026-01-20T12:00:00Z"}
    gone, other, new = changes(golden, later)
    assert gone == "a.txt of the golden week is not among the records"
    assert "b.txt" in other
    assert "0123456789ab" in other
    assert "frozen was bbbbbbbbbbbb" in other
    assert new == "late.txt reaches into the golden week and was not frozen with it"


def test_a_week_without_records_is_refused() -> None:
    with pytest.raises(ValueError, match="mill has no record from 2027-01-04 to 2027-01-10"):
        freeze("mill", Week(first="2027-01-04", last="2027-01-10"), manifest())


@pytest.mark.parametrize(
    ("first", "last", "words"),
    [
        ("2026-01-25", "2026-01-19", "ends 2026-01-19, before it begins 2026-01-25"),
        ("19.1.2026", "2026-01-25", "first day '19.1.2026'"),
        ("2026-01-19", "2026-1-25", "last day '2026-1-25'"),
    ],
)
def test_a_week_is_two_days_in_order(first: str, last: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Week(first=first, last=last)


def test_a_file_that_is_no_frozen_week_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "mill.json"
    with pytest.raises(ValueError, match=r"mill\.json does not exist: .*kerf golden mill --first"):
        read_golden(path)
    path.write_text("{")
    with pytest.raises(ValueError, match=r"mill\.json is no frozen week"):
        read_golden(path)
    path.write_text(json.dumps({"machine": "mill", "files": []}))
    with pytest.raises(ValueError, match=r"mill\.json is no frozen week"):
        read_golden(path)


def test_the_weeks_in_the_repository_are_frozen_weeks() -> None:
    paths = sorted((Path(__file__).parents[2] / "data/golden").glob("*.json"))
    assert paths
    for path in paths:
        golden: GoldenWeek = read_golden(path)
        assert golden.machine == path.stem
        assert all(len(f.sha256) == 64 for f in golden.files)
