"""What the tests of logs share: a small Devices document, a log made of text, all that was read."""

import json
from functools import partial
from math import inf
from pathlib import Path

import pyarrow as pa

from pipeline.signals.formats import Batch, RecordSource, Rejection, UnreadableFile
from pipeline.signals.shdr.log import read

SOURCE = RecordSource(format="shdr", files="*.txt")
TIME = "2019-05-20T10:46:17.123456Z"
NS = 1_558_349_177_123_456_000
NAMES = ("time", "data_item", "number", "text", "sequence", "kind", "key", "attributes", "instance")

DEVICES = """<?xml version="1.0"?>
<MTConnectDevices xmlns="urn:mtconnect.org:MTConnectDevices:1.7"><Header/><Devices>
<Device id="d" name="mill" uuid="u"><DataItems>
<DataItem id="x1" name="Xact" category="SAMPLE" type="POSITION" units="MILLIMETER"
  nativeUnits="INCH"/>
<DataItem id="s1" category="SAMPLE" type="ROTARY_VELOCITY" units="REVOLUTION/MINUTE"
  nativeUnits="REVOLUTION/MINUTE" nativeScale="10"/>
<DataItem id="odd" name="odd" category="SAMPLE" type="LOAD" units="PERCENT" nativeUnits="INCH"/>
<DataItem id="p1" name="pos" category="SAMPLE" type="PATH_POSITION" units="MILLIMETER_3D"/>
<DataItem id="w1" name="wave" category="SAMPLE" type="ACCELERATION" representation="TIME_SERIES"
  units="MILLIMETER/SECOND^2" sampleRate="10"/>
<DataItem id="c1" name="servo" category="CONDITION" type="ACTUATOR"/>
<DataItem id="m1" name="msg" category="EVENT" type="MESSAGE"/>
<DataItem id="al" name="alarm" category="EVENT" type="ALARM"/>
<DataItem id="pr" name="program" category="EVENT" type="PROGRAM"/>
<DataItem id="l1" name="line" category="EVENT" type="LINE_NUMBER"/>
<DataItem id="v1" name="vars" category="EVENT" type="VARIABLE" representation="DATA_SET"/>
<DataItem id="t1" name="offsets" category="EVENT" type="WORK_OFFSETS" representation="TABLE"/>
<DataItem id="ac" name="changed" category="EVENT" type="ASSET_CHANGED"/>
</DataItems></Device></Devices></MTConnectDevices>
"""
UNITS = RecordSource(format="shdr", files="*.txt", devices="Devices.xml")
NATIVE = RecordSource(format="shdr", files="*.txt", devices="Devices.xml", values="native")


line_by_line = partial(read, small=inf)
"""A log without the scanner: the meaning that it has to equal."""
scanned = partial(read, small=0)


def rows_of(batches: list[Batch]) -> list[tuple[object, ...]]:
    rows: list[tuple[object, ...]] = []
    for batch in batches:
        table = batch.observations
        table.validate(full=True)
        columns = [table["time"].cast(pa.int64()), *(table[n] for n in NAMES[1:])]
        rows += zip(*(column.to_pylist() for column in columns), strict=True)
    return rows


def outcome(reader, path: Path, source: RecordSource, chunk: int) -> tuple[object, ...]:  # type: ignore[no-untyped-def]
    """All that a path says of a file: rows, rejections, count; or why it is unreadable."""
    try:
        batches = list(reader(path, source, path.parent, chunk))
    except UnreadableFile as error:
        return (str(error),)
    rejected = [r for b in batches for r in b.rejected]
    # NaN never stands in a log; repr keeps 0.0 and -0.0 apart.
    return [repr(r) for r in rows_of(batches)], rejected, sum(b.read for b in batches)


class Log:
    """Reads text as a log by one path."""

    def __init__(self, reader, folder: Path) -> None:  # type: ignore[no-untyped-def]
        self.reader, self.folder = reader, folder
        (folder / "Devices.xml").write_text(DEVICES)

    def batches(self, data: str | bytes, source: RecordSource = SOURCE) -> list[Batch]:
        path = self.folder / "log.txt"
        path.write_bytes(data.encode() if isinstance(data, str) else data)
        return list(self.reader(path, source, self.folder))

    def rows(self, data: str | bytes, source: RecordSource = SOURCE) -> list[tuple[object, ...]]:
        return rows_of(self.batches(data, source))

    def values(self, data: str, source: RecordSource = SOURCE) -> list[tuple[object, ...]]:
        """Item, number, text, key of each row."""
        lines = "".join(f"{TIME}|{line}\n" for line in data.splitlines())
        return [(r[1], r[2], r[3], r[6]) for r in self.rows(lines, source)]

    def rejected(self, data: str | bytes, source: RecordSource = SOURCE) -> list[Rejection]:
        return [r for b in self.batches(data, source) for r in b.rejected]


def said(row: tuple[object, ...]) -> dict[str, object]:
    return json.loads(str(row[7]))
