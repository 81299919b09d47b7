"""Device models of every version, namespace and form."""

from pathlib import Path

import pytest

from pipeline.signals.mtconnect.devices import data_items_table, read_devices
from pipeline.signals.records import UnreadableFile

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
