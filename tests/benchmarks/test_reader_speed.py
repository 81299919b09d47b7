"""Observations a second from a log and from MTConnect XML into Parquet, on one core."""

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.signals.formats import RecordSource
from pipeline.signals.mtconnect.xml_document import read
from pipeline.signals.store import write_observations

MEGABYTES = int(os.environ.get("KERF_BENCHMARK_MB", "150"))

CONVERT = """
import resource, sys, time
from pathlib import Path
from pipeline.signals.formats import RecordSource
from pipeline.signals.shdr.log import read
from pipeline.signals.store import write_observations
log, out = Path(sys.argv[1]), Path(sys.argv[2])
source = RecordSource(format="shdr", files="*.txt")
write_observations(read(log.with_name("warm.txt"), source, log.parent), out)
begin, cpu = time.perf_counter(), time.process_time()
written = write_observations(read(log, source, log.parent), out)
took, cpu = time.perf_counter() - begin, time.process_time() - cpu
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
print(written.rows, written.rejected, took, cpu, peak)
"""


def write_log(path: Path, megabytes: int) -> None:
    """A log as an agent writes it: 60 items on change, positions with 1 to 7 decimals, words,
    conditions, items that come and go; blocks of it repeat with later times.
    """
    rng = np.random.default_rng(7)
    words = [f"O{n:04d}.NC" for n in range(40)] + ["ACTIVE", "READY", "INTERRUPTED"]
    lines = []
    for _ in range(200_000):
        item = int(rng.integers(60))
        if item < 45:
            value = f"{rng.normal(0, 300):.{item % 7 + 1}f}"
        elif item < 52:
            value = str(rng.integers(1, 100_000_000))
        elif item < 59:
            value = words[rng.integers(len(words))]
        else:
            value = "UNAVAILABLE"
        lines.append(f"|item_{item:02d}|{value}\n")
    lines[1000::2000] = ["|servo|FAULT|417|90||SERVO ALARM, AXIS X\n"] * len(lines[1000::2000])
    at = datetime(2019, 5, 20)
    size = 0
    with path.open("w", encoding="ascii") as file:
        while size < megabytes * 1_000_000:
            stamps = [at + timedelta(microseconds=3217 * i) for i in range(len(lines))]
            text = "".join(
                f"{s:%Y-%m-%dT%H:%M:%S.%f}Z{line}" for s, line in zip(stamps, lines, strict=True)
            )
            file.write(text)
            size += len(text)
            at = stamps[-1]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("log")
    write_log(folder / "log.txt", MEGABYTES)
    write_log(folder / "warm.txt", 1)
    return folder / "log.txt"


def test_log_to_parquet(log: Path, benchmark, capsys) -> None:  # type: ignore[no-untyped-def]
    results = []

    def convert() -> None:
        told = subprocess.run(
            [sys.executable, "-c", CONVERT, str(log), str(log.with_suffix(".parquet"))],
            check=True, capture_output=True, text=True,
        )  # fmt: skip
        results.append([float(word) for word in told.stdout.split()])

    benchmark.pedantic(convert, rounds=3, iterations=1)
    rows, rejected, took, cpu, peak = min(results, key=lambda r: r[2])
    with capsys.disabled():
        size = log.stat().st_size / 1e6
        sys.stdout.write(
            f"\n{size:.0f} MB, {rows:.0f} observations: {rows / took / 1e6:.2f} million/s "
            f"({rows / cpu / 1e6:.2f} a CPU second), peak {peak:.0f} MiB\n"
        )
    assert rejected == 0
    assert rows / cpu > 1e6  # far below what is reached, to be sure only of the order of magnitude
    assert peak < 1024


SOURCE = RecordSource(format="mtconnect_xml", files="*.xml")
BYTES = int(os.environ.get("KERF_XML_BENCHMARK_BYTES", 100_000_000))
HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<MTConnectStreams xmlns="urn:mtconnect.org:MTConnectStreams:1.7">\n'
    '  <Header creationTime="2024-03-04T10:00:00Z" sender="shop" instanceId="1709546400" '
    'version="1.7.0.3" bufferSize="131072" nextSequence="{next}" firstSequence="1" '
    'lastSequence="{next}"/>\n  <Streams>\n    <DeviceStream name="mill" uuid="mill-1">\n'
)
TAIL = "    </DeviceStream>\n  </Streams>\n</MTConnectStreams>\n"
AXES = "XYZ"


def _component(rng: random.Random, axis: str, first: int, n: int) -> Iterator[str]:
    yield f'      <ComponentStream component="Linear" name="{axis}" componentId="{axis.lower()}">\n'
    yield "        <Samples>\n"
    for sequence in range(first, first + n):
        tag, item, sub = (
            ("Position", f"{axis}act", ' subType="ACTUAL"')
            if rng.random() < 0.8
            else ("Load", f"{axis}load", "")
        )
        second = sequence // 50
        stamp = (
            f"2024-03-{4 + second // 86400:02}T{second // 3600 % 24:02}:{second // 60 % 60:02}"
            f":{second % 60:02}.{sequence % 50 * 20000:06}Z"
        )
        value = "UNAVAILABLE" if rng.random() < 0.001 else f"{rng.gauss(0, 200):.5f}"
        yield (
            f'          <{tag} dataItemId="{item}_1" timestamp="{stamp}" name="{item}" '
            f'sequence="{sequence}"{sub}>{value}</{tag}>\n'
        )
    yield "        </Samples>\n      </ComponentStream>\n"


@pytest.fixture(scope="module")
def streams(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """A file of about BYTES bytes of documents with 30 000 observations each, and their number."""
    path = tmp_path_factory.mktemp("streams") / "samples.xml"
    rng = random.Random(7)
    count = 0
    with path.open("w") as file:
        while file.tell() < BYTES:
            file.write(HEAD.format(next=count + 30_000))
            for axis in AXES:
                file.writelines(_component(rng, axis, count + 1, 10_000))
                count += 10_000
            file.write(TAIL)
    return path, count


def _to_parquet(path: Path, out: Path) -> int:
    pa.set_cpu_count(1)
    return write_observations(read(path, SOURCE, path.parent), out).rows


def test_observations_a_second(streams: tuple[Path, int], tmp_path: Path, benchmark) -> None:
    path, count = streams
    out = tmp_path / "out.parquet"
    rows = benchmark.pedantic(_to_parquet, args=(path, out), rounds=3)
    assert rows == count == pq.read_metadata(out).num_rows
    rate = count / benchmark.stats.stats.min
    sys.stdout.write(f"\n{rate / 1e6:.2f} million observations a second\n")
    benchmark.extra_info["observations_a_second"] = rate
