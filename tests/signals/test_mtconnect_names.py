"""The same record gives the same row whatever file it stood in; names stay text in each."""

import json
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pytest

from pipeline.signals.mtconnect import json_document
from pipeline.signals.mtconnect.text import content
from pipeline.signals.mtconnect.xml_document import asked_of, documents
from pipeline.signals.names import WORDS, element_name, is_name
from pipeline.signals.records import Batch, RecordSource
from pipeline.signals.shdr import log

WHEN = "2024-03-04T10:00:00.5Z"

Said = tuple[str, float | None, str | None, str, str | None, int]
"""Item, number, text, kind, key and time of a row."""


def _devices(category: str, kind: str) -> str:
    return (
        '<MTConnectDevices><Header/><Devices><Device id="d" name="mill" uuid="u"><DataItems>'
        f'<DataItem id="i" name="item" category="{category}" type="{kind}"/>'
        "</DataItems></Device></Devices></MTConnectDevices>"
    )


def _xml(section: str, element: str, value: str) -> str:
    vendor = ' xmlns:x="urn:vendor:shop"' if ":" in element else ""
    return (
        f'<MTConnectStreams{vendor}><Header instanceId="1"/><Streams><DeviceStream name="mill" '
        f'uuid="u"><ComponentStream component="Path"><{section}><{element} dataItemId="i" '
        f'name="item" timestamp="{WHEN}" sequence="1">{value}</{element}></{section}>'
        "</ComponentStream></DeviceStream></Streams></MTConnectStreams>"
    )


def _json(version: int, section: str, element: str, value: str) -> str:
    said = {"dataItemId": "i", "name": "item", "timestamp": WHEN, "sequence": 1, "value": value}
    one = version == 1
    component = {section: [{element: said}] if one else {element: [said]}}
    inside = [{"ComponentStream": component}] if one else [component]
    stream = {"name": "mill", "ComponentStreams" if one else "ComponentStream": inside}
    streams = [{"DeviceStream": stream}] if one else {"DeviceStream": [stream]}
    root = {"jsonVersion": version, "Header": {"instanceId": 1}, "Streams": streams}
    return json.dumps({"MTConnectStreams": root})


def _rows(batches: Iterator[Batch]) -> list[Said]:
    rows: list[Said] = []
    for batch in batches:
        assert not batch.rejected
        table = batch.observations
        table = table.set_column(0, "time", table["time"].cast(pa.int64()))
        names = ("data_item", "number", "text", "kind", "key", "time")
        rows += zip(*(table[name].to_pylist() for name in names), strict=True)
    return rows


def _read_everywhere(
    folder: Path, category: str, kind: str, value: str, *, model: bool, field: str | None = None
) -> dict[str, list[Said]]:
    """Rows of one record by each reader; ``field`` is what a log says after the item's name."""
    section = "Samples" if category == "SAMPLE" else "Events"
    prefix, colon, own = kind.rpartition(":")
    element = f"{prefix}{colon}{element_name(own)}"
    (folder / "Devices.xml").write_text(_devices(category, kind))
    devices = "Devices.xml" if model else None
    found: dict[str, list[Said]] = {}
    path = folder / "streams.xml"
    path.write_text(_xml(section, element, value))
    source = RecordSource(format="mtconnect_xml", files="*", devices=devices)
    for quick in (True, False):
        whole = content(path)
        asked = asked_of(whole, source, folder)
        found[f"XML, quick {quick}"] = _rows(documents(whole, asked, quick=quick))
    source = RecordSource(format="mtconnect_json", files="*", devices=devices)
    for version in (1, 2):
        path = folder / f"{version}.json"
        path.write_text(_json(version, section, element, value))
        found[f"JSON {version}"] = _rows(json_document.read(path, source, folder))
    path = folder / "log.txt"
    path.write_text(f"{WHEN}|item|{field or value}\n")
    source = RecordSource(format="shdr", files="*", devices="Devices.xml")
    found["log"] = _rows(log.read(path, source, folder))
    return found


@pytest.mark.parametrize("model", [True, False], ids=["with a device document", "without"])
@pytest.mark.parametrize(
    ("category", "kind", "value", "number", "text"),
    [
        ("EVENT", "PROGRAM", "0012", None, "0012"),
        ("EVENT", "TOOL_ID", "7", None, "7"),
        ("EVENT", "x:TOOL_ID", "7e1", None, "7e1"),
        ("EVENT", "PART_ID", "P-1", None, "P-1"),
        ("EVENT", "PROGRAM", "UNAVAILABLE", None, None),
        ("EVENT", "BLOCK", "12", None, "12"),
        ("EVENT", "ASSET_CHANGED", "0012", None, "0012"),
        ("EVENT", "LINE_NUMBER", "0012", 12.0, None),
        ("EVENT", "x:PROGRAMS", "0012", 12.0, None),
        ("EVENT", "EXECUTION", "ACTIVE", None, "ACTIVE"),
        ("SAMPLE", "POSITION", "0012", 12.0, None),
    ],
)
def test_a_record_gives_the_same_row_whatever_it_is_read_from(
    tmp_path: Path, category: str, kind: str, value: str, number: float | None,
    text: str | None, model: bool,
) -> None:  # fmt: skip
    found = _read_everywhere(tmp_path, category, kind, value, model=model)
    row = ("item", number, text, category, None, 1_709_546_400_500_000_000)
    assert found == {reader: [row] for reader in found}
    assert len(found) == 5


@pytest.mark.parametrize(("kind", "field"), [("MESSAGE", "|0012"), ("ALARM", "||||0012")])
def test_the_text_of_messages_and_alarms_is_no_number(
    tmp_path: Path, kind: str, field: str
) -> None:
    found = _read_everywhere(tmp_path, "EVENT", kind, "0012", model=True, field=field)
    row = ("item", None, "0012", "MESSAGE", None, 1_709_546_400_500_000_000)
    assert found == {reader: [row] for reader in found}


def test_a_device_document_knows_a_name_that_its_element_hides(tmp_path: Path) -> None:
    (tmp_path / "Devices.xml").write_text(_devices("EVENT", "PROGRAM"))
    path = tmp_path / "one.json"
    path.write_text(json.dumps({"dataItemId": "i", "timestamp": WHEN, "value": "0012"}))
    source = RecordSource(format="mtconnect_json", files="*", devices="Devices.xml")
    ((item, number, text, kind, *_),) = _rows(json_document.read(path, source, tmp_path))
    assert (item, number, text, kind) == ("item", None, "0012", "EVENT")


def test_types_and_elements_are_told_to_be_names_alike() -> None:
    for kind in WORDS:
        element = element_name(kind)
        for form in (kind, element, f"x:{kind}", f"x:{element}", f"{element}Discrete"):
            assert is_name(form)
    for other in ("LINE_NUMBER", "Line", "Discrete", "program", "", None):
        assert not is_name(other)
