"""The report of one machine takes at most ten seconds and 3 MB, that of twenty a minute.

``KERF_BUILT`` is a folder where a fleet was built.
"""

import os
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import pytest

from pipeline.fleet import Fleet
from pipeline.parameters import read_params, structure
from pipeline.report.folders import FleetInfo, MachineFolders
from pipeline.report.pages import write_report
from pipeline.stages.report import machines_of

BUILT = os.environ.get("KERF_BUILT", "")
pytestmark = pytest.mark.skipif(not BUILT, reason="KERF_BUILT names no built fleet")
MOST_S, MOST_MB = {1: 10.0, 20: 60.0}, 3.0


@pytest.fixture
def built(monkeypatch: pytest.MonkeyPatch) -> MachineFolders:
    monkeypatch.chdir(BUILT)
    fleet = structure(read_params(), "fleet", Fleet)
    names = ("signals", "clean", "models", "champion", "golden", "truth", "programs", "parts",
             "trials", "history", "ledger", "twin_state", "condition", "incidents",
             "settings/sections")  # fmt: skip
    return machines_of([Path("data") / name for name in names], fleet)[0]


@pytest.mark.parametrize("machines", MOST_S)
def test_a_report_is_there_in_time(built: MachineFolders, tmp_path: Path, machines: int) -> None:
    fleet = [replace(built, name=f"m{k:02d}") for k in range(machines)]
    begin = perf_counter()
    pages = write_report(fleet, FleetInfo(), None, tmp_path)
    took, size = perf_counter() - begin, max(page.stat().st_size for page in pages) / 1e6
    found = f"{machines} machines: {took:.1f} s, {len(pages)} pages, largest {size:.2f} MB"
    assert took <= MOST_S[machines] and size <= MOST_MB, found
