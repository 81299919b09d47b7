"""The line of a stage: what it read, found, wrote and took."""

import io
import json
import os
import re
import time
from pathlib import Path

import pytest

from pipeline.stages import __main__ as stage_runner
from pipeline.stages.__main__ import line, place, running
from tests.small_project import ROOT


def test_a_stage_says_what_it_read_found_wrote_and_took(tmp_path: Path) -> None:
    raw, out = tmp_path / "raw", tmp_path / "model"
    raw.mkdir()
    for name in ("a.txt", "b.txt"):
        (raw / name).write_bytes(b"x" * 1_500_000)
        os.utime(raw / name, (1, 1))
    began = time.time() - 2
    out.mkdir()
    (out / "verdict.json").write_text(json.dumps({"status": "passed"}))
    said = line("judge_drive@mill01", [raw, out, tmp_path / "none"], began)
    assert re.fullmatch(
        r"judge_drive@mill01: read 2 files, 3 MB; found: passed; wrote \S+ \(1 file, 2e-05 MB\); "
        r"took \d\.\d s", said,
    ), said  # fmt: skip


def test_the_verdict_of_a_stage_before_is_not_said(tmp_path: Path) -> None:
    """A model is written into the folder that holds the verdict on the one before it."""
    (tmp_path / "verdict.json").write_text(json.dumps({"status": "failed"}))
    os.utime(tmp_path / "verdict.json", (1, 1))
    (tmp_path / "model.json").write_text("{}")
    said = line("identify_drive@mill01", [tmp_path], time.time() - 2)
    assert "found" not in said and "wrote" in said


def test_records_are_counted(tmp_path: Path) -> None:
    entries = {"a": {"read": 9, "kept": 7, "rejected": 2}, "b": {"read": 1, "kept": 1}}
    (tmp_path / "manifest.json").write_text(json.dumps({"files": entries}))
    said = line("ingest@mill01", [tmp_path], 0.0)
    assert "found: 10 records read, 8 records kept, 2 records rejected" in said


def test_a_stage_says_where_it_stands(tmp_path: Path) -> None:
    (tmp_path / "conf/fleet").mkdir(parents=True)
    (tmp_path / "conf/fleet/active.yaml").write_text("machines: [a, b]\nsubmodels: {drive: [b]}\n")
    assert place("clean@b", tmp_path) == ""
    (tmp_path / "dvc.yaml").write_text(
        "stages: {compose: {}, clean: {foreach: '${machines}'}, judge_drive: "
        "{foreach: '${submodels.drive}'}, report: {}}\n"
    )
    assert [place(one, tmp_path) for one in ("compose", "clean@b", "judge_drive@b", "report")] == [
        "(1 of 5)", "(3 of 5)", "(4 of 5)", "(5 of 5)"
    ]  # fmt: skip
    assert place("clean@c", tmp_path) == ""
    assert re.fullmatch(r"\(1 of \d\d\)", place("code", ROOT))


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_long_stage_shows_on_a_terminal_that_it_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage_runner, "SHOWN_AFTER_S", 0.0)
    terminal, file = Terminal(), io.StringIO()
    for stream in (terminal, file):
        with running("shop@mill (3 of 30)", stream):
            while stream is terminal and not terminal.getvalue():
                time.sleep(0.05)
    assert re.match(r"\rshop@mill \(3 of 30\): 1 s ", terminal.getvalue())
    assert terminal.getvalue().endswith("\r\033[K") and not file.getvalue()
