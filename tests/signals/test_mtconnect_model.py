"""Device models of MTConnect, and types of events whose values are names."""

import json
from pathlib import Path

import pytest
from mtconnect_files import T0, WHEN, Read, outcome

from pipeline.signals.formats import RecordSource, UnreadableFile
from pipeline.signals.mtconnect import json_document, xml_document
from pipeline.signals.mtconnect.devices import (
    NAME_TYPES,
    data_items_table,
    element_name,
    is_name,
    read_devices,
)
from pipeline.signals.shdr import log

ITEMS = """
  <Device id="d1" name="mill" uuid="u-1">
    <DataItems><DataItem id="avail" category="EVENT" type="AVAILABILITY"/></DataItems>
    <Components>
      <Axes id="ax"><Components><Linear id="x" name="X"><DataItems>
        <DataItem id="x1" name="Xact" category="SAMPLE" type="POSITION" subType="ACTUAL"
            units="MILLIMETER" nativeUnits="INCH" nativeScale="10"><Source>Xabs</Source></DataItem>
        <DataItem id="x2" category="SAMPLE" type="ACCELERATION" representation="TIME_SERIES"
            sampleRate="1000"/>
      </DataItems></Linear></Components></Axes>
      <v:Magazine id="m"><DataItems><v:DataItem id="m1" category="EVENT" type="v:POT"/></DataItems>
      </v:Magazine>
    </Components>
  </Device>"""
OTHER = (
    '<Device id="d2" name="lathe" uuid="u-2"><DataItems>'
    '<DataItem id="avail2" name="Xact" category="EVENT" type="AVAILABILITY"/></DataItems></Device>'
)
NAMESPACES = [
    "",
    'xmlns="urn:mtconnect.com:MTConnectDevices:1.0"',
    *(f'xmlns="urn:mtconnect.org:MTConnectDevices:{v}"' for v in ("1.1", "1.8", "2.0", "2.7")),
]


def _document(devices: str, namespace: str = "") -> str:
    return (
        f'<?xml version="1.0"?><MTConnectDevices {namespace} xmlns:v="urn:vendor">'
        f'<Header instanceId="1"/><Devices>{devices}</Devices></MTConnectDevices>'
    )


def _write(tmp_path: Path, text: str, name: str = "Devices.xml", encoding: str = "utf-8") -> Path:
    path = tmp_path / name
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize("namespace", NAMESPACES)
def test_every_version_gives_the_same_items(tmp_path: Path, namespace: str) -> None:
    model = read_devices(_write(tmp_path, _document(ITEMS, namespace)), None)
    assert [i.id for i in model.items] == ["avail", "x1", "x2", "m1"]
    x1 = model.items[1]
    assert (x1.component, x1.component_name, x1.source) == ("Linear", "X", "Xabs")
    assert (x1.units, x1.native_units, x1.native_scale) == ("MILLIMETER", "INCH", 10.0)
    assert model.items[2].representation == "TIME_SERIES"
    assert model.items[2].sample_rate == 1000
    assert model.items[3].component == "Magazine"


def test_a_template_without_a_root_is_a_device(tmp_path: Path) -> None:
    model = read_devices(_write(tmp_path, "\n\t" + ITEMS.replace("v:", "") + "\n", "t.txt"), None)
    assert [d.label for d in model.devices] == ["mill"]
    assert len(model.items) == 4


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    text = _document(ITEMS.replace('name="X"', 'name="Vorschubä"'))
    model = read_devices(_write(tmp_path, text, encoding=encoding), None)
    assert model.items[1].component_name == "Vorschubä"


def test_declared_encoding_of_single_bytes(tmp_path: Path) -> None:
    text = _document(ITEMS.replace('name="X"', 'name="Vorschubä"'))
    text = text.replace('version="1.0"', 'version="1.0" encoding="ISO-8859-1"')
    model = read_devices(_write(tmp_path, text, encoding="latin-1"), None)
    assert model.items[1].component_name == "Vorschubä"


def test_items_are_named_by_name_else_id(tmp_path: Path) -> None:
    model = read_devices(_write(tmp_path, _document(ITEMS)), None)
    assert [model.item_name(i) for i in model.items] == ["avail", "Xact", "x2", "m1"]
    assert all(model.find(key) is model.items[1] for key in ("Xact", "x1", "Xabs"))
    assert model.find("nobody") is None


def test_several_devices_name_their_items_apart(tmp_path: Path) -> None:
    path = _write(tmp_path, _document(ITEMS + OTHER))
    model = read_devices(path, None)
    assert [model.item_name(i) for i in model.items][1::3] == ["mill:Xact", "lathe:Xact"]
    assert model.find("lathe:Xact") is model.items[4]
    for called in ("lathe", "u-2", "d2"):
        chosen = read_devices(path, called)
        assert [chosen.item_name(i) for i in chosen.items] == ["Xact"]


def test_unknown_device_is_named_with_those_there_are(tmp_path: Path) -> None:
    path = _write(tmp_path, _document(ITEMS + OTHER))
    with pytest.raises(UnreadableFile, match=r"'robot'.*mill, lathe"):
        read_devices(path, "robot")


def test_devices_that_share_a_name_are_told_apart_by_uuid(tmp_path: Path) -> None:
    path = _write(tmp_path, _document(ITEMS + OTHER.replace("lathe", "mill")))
    assert [d.label for d in read_devices(path, None).devices] == ["mill", "u-2"]
    assert [i.id for i in read_devices(path, "u-2").items] == ["avail2"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty"),
        ("no xml", "no device"),
        ("<MTConnectStreams><Header/></MTConnectStreams>", "MTConnectStreams"),
        (_document(ITEMS)[:-60], "breaks off at line 1"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><MTConnectDevices/>', "document type declaration"),
        ('{"MTConnectStreams": {}}', "no device"),
        ("{", "no JSON"),
    ],
)
def test_unreadable(tmp_path: Path, text: str, reason: str) -> None:
    # The document type declaration stands behind an XML declaration, as it may.
    with pytest.raises(UnreadableFile, match=reason):
        read_devices(_write(tmp_path, text), None)


def test_missing_file_is_unreadable(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile, match="cannot be opened"):
        read_devices(tmp_path / "none.xml", None)


JSON = {
    "cppagent 1": """{"MTConnectDevices": {"Devices": [{"Device": {"id": "d1", "name": "mill",
        "Components": [{"Axes": {"id": "ax", "Components": [{"Linear": {"id": "x", "name": "X",
        "DataItems": [{"DataItem": {"id": "x1", "name": "Xact", "category": "SAMPLE",
        "type": "POSITION", "units": "MILLIMETER", "Source": {"value": "Xabs"}}}]}}]}}]}}]}}""",
    "cppagent 2": """{"MTConnectDevices": {"jsonVersion": 2, "Devices": {"Device": [{"id": "d1",
        "name": "mill", "Components": {"Axes": [{"id": "ax", "Components": {"Linear": [{"id": "x",
        "name": "X", "DataItems": {"DataItem": [{"id": "x1", "name": "Xact", "category": "SAMPLE",
        "type": "POSITION", "units": "MILLIMETER", "Source": {"value": "Xabs"}}]}}]}}]}}]}}}""",
    "MTConnect.NET": """{"devices": [{"id": "d1", "name": "mill", "components": [{"id": "ax",
        "type": "Axes", "components": [{"id": "x", "name": "X", "type": "Linear", "dataItems":
        [{"id": "x1", "name": "Xact", "category": "SAMPLE", "type": "POSITION",
        "units": "MILLIMETER", "source": {"value": "Xabs"}}]}]}]}]}""",
}


@pytest.mark.parametrize("form", JSON)
def test_json_forms(tmp_path: Path, form: str) -> None:
    (item,) = read_devices(_write(tmp_path, JSON[form], "d.json"), None).items
    assert (item.id, item.component, item.component_name) == ("x1", "Linear", "X")
    assert (item.source, item.units, item.device) == ("Xabs", "MILLIMETER", "mill")


def test_table_of_items(tmp_path: Path) -> None:
    table = data_items_table(read_devices(_write(tmp_path, _document(ITEMS)), None))
    row = table.to_pylist()[1]
    assert row["data_item"] == "Xact"
    assert (row["category"], row["sub_type"], row["native_scale"]) == ("SAMPLE", "ACTUAL", 10.0)
    assert {"id", "type", "units", "native_units", "component"} <= set(table.column_names)


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


def _rows(read: Read, path: Path, source: RecordSource) -> list[Said]:
    rows, _, rejected = outcome(read, path, source)
    assert not rejected
    names = ("data_item", "number", "text", "kind", "key", "time")
    return [tuple(row[name] for name in names) for row in rows]  # type: ignore[misc]


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
    found["XML"] = _rows(xml_document.read, path, source)
    source = RecordSource(format="mtconnect_json", files="*", devices=devices)
    for version in (1, 2):
        path = folder / f"{version}.json"
        path.write_text(_json(version, section, element, value))
        found[f"JSON {version}"] = _rows(json_document.read, path, source)
    path = folder / "log.txt"
    path.write_text(f"{WHEN}|item|{field or value}\n")
    source = RecordSource(format="shdr", files="*", devices="Devices.xml")
    found["log"] = _rows(log.read, path, source)
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
    row = ("item", number, text, category, None, T0)
    assert found == {reader: [row] for reader in found}
    assert len(found) == 4


@pytest.mark.parametrize(("kind", "field"), [("MESSAGE", "|0012"), ("ALARM", "||||0012")])
def test_the_text_of_messages_and_alarms_is_no_number(
    tmp_path: Path, kind: str, field: str
) -> None:
    found = _read_everywhere(tmp_path, "EVENT", kind, "0012", model=True, field=field)
    row = ("item", None, "0012", "MESSAGE", None, T0)
    assert found == {reader: [row] for reader in found}


def test_a_device_document_knows_a_name_that_its_element_hides(tmp_path: Path) -> None:
    (tmp_path / "Devices.xml").write_text(_devices("EVENT", "PROGRAM"))
    path = tmp_path / "one.json"
    path.write_text(json.dumps({"dataItemId": "i", "timestamp": WHEN, "value": "0012"}))
    source = RecordSource(format="mtconnect_json", files="*", devices="Devices.xml")
    ((item, number, text, kind, *_),) = _rows(json_document.read, path, source)
    assert (item, number, text, kind) == ("item", None, "0012", "EVENT")


def test_types_and_elements_are_told_to_be_names_alike() -> None:
    for kind in NAME_TYPES:
        element = element_name(kind)
        for form in (kind, element, f"x:{kind}", f"x:{element}", f"{element}Discrete"):
            assert is_name(form)
    for other in ("LINE_NUMBER", "Line", "Discrete", "program", "", None):
        assert not is_name(other)


@pytest.mark.parametrize("around", ["<Devices>{}</Devices>", "<x><MTConnectDevices><Devices>{}"
                                    "</Devices></MTConnectDevices></x>"])  # fmt: skip
def test_devices_are_read_wherever_they_stand(tmp_path: Path, around: str) -> None:
    model = read_devices(_write(tmp_path, around.format(ITEMS.replace("v:", ""))), None)
    assert [item.id for item in model.items] == ["avail", "x1", "x2", "m1"]


def test_items_of_a_composition_are_of_its_device(tmp_path: Path) -> None:
    pump = """<Compositions><Composition id="p" type="PUMP"><DataItems>
      <DataItem id="p1" category="SAMPLE" type="PRESSURE" units="PASCAL"/></DataItems>
      </Composition></Compositions></Device>"""
    model = read_devices(_write(tmp_path, ITEMS.replace("v:", "").replace("</Device>", pump)), None)
    (item,) = (one for one in model.items if one.id == "p1")
    assert (item.component, item.component_name, item.device) == ("Composition", "p", "mill")
