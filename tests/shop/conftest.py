"""One simulated week of each machine, made once, and a plain reader of its log."""

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import cattrs
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from pipeline.parallel import Compute
from pipeline.schema.identity import MachineIdentity
from pipeline.shop.cutting.records import write_cutting
from pipeline.shop.drives.feed_records import write_feed
from pipeline.shop.growth.records import write_growth
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.simulate import simulate
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from tests.shared import made_once

CONF = Path(__file__).parents[2] / "conf" / "shop"


@dataclass(frozen=True)
class Record:
    line: int
    time: datetime
    name: str
    fields: tuple[str, ...]


@dataclass(frozen=True)
class LogFile:
    lines: list[str]
    records: list[Record]
    rejected: list[str]
    out_of_order: int


@dataclass(frozen=True)
class Simulated:
    folder: Path
    truth: dict[str, Any]
    parameters: ShopParameters

    def log(self, name: str) -> LogFile:
        return read_log(self.folder / name)


@dataclass(frozen=True)
class Read:
    """Records as the machine's own file in conf/ has them read: traces and units by raw file."""

    made: Simulated
    signals: Path
    conf: dict[str, Any]
    manifest: dict[str, dict[str, Any]]
    traces: dict[str, dict[str, np.ndarray]]
    units: dict[str, dict[str, str]]
    told: dict[str, dict[str, Any]]


def machine_conf(machine: str) -> dict[str, Any]:
    """The machine's own file in conf/."""
    found: dict[str, Any] = yaml.safe_load((CONF.parent / f"machine/{machine}.yaml").read_text())
    return found


def read_back(made: Simulated, folder: Path, signals: Path, told: list[dict[str, Any]]) -> Read:
    """Read what stands in ``folder`` by the machine's file; ``told``: what is true of each file."""
    conf = machine_conf(made.parameters.machine)
    rooms = tuple(f"{path.name}/" for path in folder.iterdir())
    sources = [r for r in conf["records"] if r["files"].startswith(rooms)]
    strict = cattrs.Converter(forbid_extra_keys=True)
    ingest(folder, signals, strict.structure(sources, list[RecordSource]),
           MachineIdentity(**conf["identity"]))  # fmt: skip
    manifest = json.loads((signals / "manifest.json").read_text())["files"]
    tables = {n: pq.read_table(signals / entry["output"]) for n, entry in manifest.items()}
    return Read(
        made=made, signals=signals, conf=conf, manifest=manifest,
        traces={n: {c: t[c].to_numpy() for c in t.column_names} for n, t in tables.items()},
        units={n: {f.name: f.metadata[b"unit"].decode() for f in t.schema if f.metadata}
               for n, t in tables.items()},
        told={f["file"]: f for f in told},
    )  # fmt: skip


def read_log(path: Path) -> LogFile:
    """An independent reader: splits at bars, knows nothing of how the file was written."""
    records, rejected, old, latest = [], [], 0, datetime.min
    lines = path.read_text(encoding="utf-8").splitlines()
    for number, line in enumerate(lines, 1):
        parts = line.split("|")
        try:
            time = datetime.fromisoformat(parts[0].removesuffix("Z"))
        except ValueError:
            rejected.append(line)
            continue
        if len(parts) < 3:
            rejected.append(line)
            continue
        old += time < latest
        latest = max(latest, time)
        if parts[1].endswith(("_c", "travel")):
            records.append(Record(number, time, parts[1], tuple(parts[2:])))
            assert len(parts) == 7, f"condition with {len(parts)} fields: {line}"
            continue
        assert len(parts) % 2 == 1, f"a name without a value: {line}"
        for name, value in zip(parts[1::2], parts[2::2], strict=True):
            records.append(Record(number, time, name, (value,)))
    return LogFile(lines, records, rejected, old)


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of each file below a folder."""
    return {
        str(f.relative_to(folder)): hashlib.sha256(f.read_bytes()).hexdigest()
        for f in sorted(folder.rglob("*"))
        if f.is_file()
    }


def shop_parameters(machine: str, **changes: Any) -> ShopParameters:
    section = yaml.safe_load((CONF / f"{machine}.yaml").read_text(encoding="utf-8"))
    return cattrs.Converter(forbid_extra_keys=True).structure(
        merged(section, changes), ShopParameters
    )


def merged(section: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    """``section`` with ``changes``, which name of a section inside it only what they change."""
    inner = {
        key: merged(section.get(key, {}), value)
        for key, value in changes.items()
        if isinstance(value, dict)
    }
    return section | changes | inner


def run(root: Path, machine: str, compute: Compute = "serial", **changes: Any) -> Simulated:
    parameters = shop_parameters(machine, **changes)
    truth = root / "truth" / f"{machine}.json"
    simulate(root / "raw" / machine, truth, parameters, compute)
    return Simulated(root / "raw" / machine, json.loads(truth.read_text()), parameters)


NO_CUTS, NO_DRIVES = {"cutting": {"recorded": False}}, {"drives": {"recorded": False}}
NO_FEED, NO_GROWTH = {"drives": {"feed": {"recorded": False}}}, {"growth": {"recorded": False}}
NO_WEAR = {"wear": {"recorded": False}}
"""Changes by which the cutting tests, the servo tool (as a whole, or of feeds), the growth's logger
and the records of tool lives write nothing."""


MACHINES = ["mill01", pytest.param("mill02", marks=pytest.mark.proof)]


@pytest.fixture(scope="session", params=MACHINES)
def week(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """Without cutting tests, feeds, spindle growth and tool lives, which have their own."""
    machine, changes = request.param, {**NO_CUTS, **NO_FEED, **NO_GROWTH, **NO_WEAR}
    root = made_once(
        tmp_path_factory, f"week-{machine}", lambda folder: run(folder, machine, weeks=1, **changes)
    )
    truth = json.loads((root / f"truth/{machine}.json").read_text())
    return Simulated(root / "raw" / machine, truth, shop_parameters(machine, weeks=1, **changes))


@pytest.fixture(scope="session")
def plain_week(week: Simulated, tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """The same week once more, without the servo tool, its kinds of records beside each other."""
    machine = week.parameters.machine
    changes = {**NO_CUTS, **NO_DRIVES, **NO_GROWTH, **NO_WEAR}
    folder = tmp_path_factory.mktemp(f"{machine}-plain")
    return run(folder, machine, compute="threads", weeks=1, **changes)


def recorded(
    factory: pytest.TempPathFactory, machine: str, write: Callable[[Path, ShopParameters], Any]
) -> Simulated:
    """Records of one kind alone; ``truth`` is their section of it."""

    def make(folder: Path) -> None:
        (folder / "raw").mkdir()
        (folder / "truth.json").write_text(json.dumps(write(folder / "raw", parameters)))

    parameters = shop_parameters(machine)
    root = made_once(factory, f"{write.__name__}-{machine}", make)
    return Simulated(root / "raw", json.loads((root / "truth.json").read_text()), parameters)


@pytest.fixture(scope="session", params=MACHINES)
def cuts(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """The cutting tests of each machine."""
    return recorded(tmp_path_factory, request.param, write_cutting)


@pytest.fixture(scope="session", params=MACHINES)
def feeds(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """The feeds of each machine."""
    return recorded(tmp_path_factory, request.param, write_feed)


@pytest.fixture(scope="session", params=MACHINES)
def warm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Simulated:
    """The growth records of each machine."""
    return recorded(tmp_path_factory, request.param, write_growth)
