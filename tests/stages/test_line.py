"""The line of a stage: what it read, found, wrote and took."""

import json
import os
import re
import time
from pathlib import Path

from pipeline.stages._line import line


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


def test_records_are_counted(tmp_path: Path) -> None:
    entries = {"a": {"read": 9, "kept": 7, "rejected": 2}, "b": {"read": 1, "kept": 1}}
    (tmp_path / "manifest.json").write_text(json.dumps({"files": entries}))
    said = line("ingest@mill01", [tmp_path], 0.0)
    assert "found: 10 records read, 8 records kept, 2 records rejected" in said
