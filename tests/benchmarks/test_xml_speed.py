"""How many observations a second go from an MTConnectStreams file into Parquet, on one core."""

import os
import random
import sys
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.signals.formats import RecordSource
from pipeline.signals.mtconnect.xml_document import read
from pipeline.signals.store import write_observations

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
