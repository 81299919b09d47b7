"""MTConnect JSON: the three forms say the same, and the same as XML."""

import json
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import strategies as st
from mtconnect_files import NS, T0, WHEN, Rows, outcome
from proof_sizes import few_and_many

from pipeline.signals.formats import RecordSource, Rejection, UnreadableFile
from pipeline.signals.mtconnect import json_document as mtconnect_json
from pipeline.signals.mtconnect import xml_document as mtconnect_xml

SOURCE = RecordSource(format="mtconnect_json", files="*.json")


def _read(
    tree: Any, tmp_path: Path, source: RecordSource = SOURCE
) -> tuple[Rows, int, list[Rejection]]:
    path = tmp_path / "streams.json"
    path.write_bytes(tree if isinstance(tree, bytes) else json.dumps(tree).encode())
    return outcome(mtconnect_json.read, path, source)


def _own(item: str, sequence: int, **more: Any) -> dict[str, Any]:
    return {"dataItemId": item, "timestamp": WHEN, "sequence": sequence, **more}


# Section, element, attributes, and value of each observation of the document in all forms.
SAID: list[tuple[str, str, dict[str, Any], Any]] = [
    ("Samples", "Position", _own("x1", 1, name="Xact", subType="ACTUAL"), -1.5),
    ("Samples", "PathPosition", _own("p1", 2), [1, 2.5, -3]),
    ("Samples", "Load", _own("l1", 3), "UNAVAILABLE"),
    ("Samples", "AccelerationTimeSeries", _own("a1", 4, sampleCount=2, sampleRate=10), [1.5, 2]),
    ("Events", "Execution", _own("e1", 5), "ACTIVE"),
    ("Events", "Line", _own("n1", 6), 12),
    ("Events", "Message", _own("m1", 7, nativeCode="77"), "tool change"),
    ("Events", "VariableDataSet", _own("v1", 8, count=3), {"a": 1, "b": "on", "c": None}),
    ("Events", "WorkOffsetTable", _own("w1", 9, count=1), {"G54": {"X": 1.5, "N": "left"}}),
    ("Condition", "Fault", _own("c1", 10, type="SYSTEM", nativeCode="A1"), "too hot"),
    ("Condition", "Unavailable", _own("c1", 11, type="SYSTEM"), None),
]


def _body(element: str, attributes: dict[str, Any], value: Any) -> dict[str, Any]:
    if element == "VariableDataSet":
        value = {k: {"removed": True} if v is None else v for k, v in value.items()}
    return attributes if value is None else {**attributes, "value": value}


def version_1() -> dict[str, Any]:
    component: dict[str, Any] = {"component": "Linear", "componentId": "x"}
    for section, element, attributes, value in SAID:
        component.setdefault(section, []).append({element: _body(element, attributes, value)})
    stream = {"name": "mill", "uuid": "u", "ComponentStreams": [{"ComponentStream": component}]}
    return _root([{"DeviceStream": stream}])


def version_2() -> dict[str, Any]:
    component: dict[str, Any] = {"component": "Linear", "componentId": "x"}
    for section, element, attributes, value in SAID:
        group = component.setdefault(section, {}).setdefault(element, [])
        group.append(_body(element, attributes, value))
    stream = {"name": "mill", "uuid": "u", "ComponentStream": [component]}
    return _root({"DeviceStream": [stream]})


def _root(streams: Any) -> dict[str, Any]:
    header = {"instanceId": 2**64 - 1, "creationTime": WHEN}
    return {"MTConnectStreams": {"jsonVersion": 2, "Header": header, "Streams": streams}}


def net() -> dict[str, Any]:
    component: dict[str, Any] = {"component": "Linear", "componentId": "x"}
    for section, element, attributes, value in SAID:
        said = dict(attributes)
        if section == "Condition":
            said |= {"level": element.upper()}
        else:
            said |= {"type": element.upper()}
        if element.endswith("TimeSeries"):
            said |= {"type": "ACCELERATION", "samples": [str(v) for v in value]}
        elif element == "VariableDataSet":
            entries = [
                {"key": k, "removed": True} if v is None else {"key": k, "value": str(v)}
                for k, v in value.items()
            ]
            said |= {"type": "VARIABLE", "entries": entries}
        elif element == "WorkOffsetTable":
            cells = [{"key": k, "value": str(v)} for k, v in value["G54"].items()]
            said |= {"type": "WORK_OFFSET", "entries": [{"key": "G54", "cells": cells}]}
        elif value is not None:
            text = " ".join(map(str, value)) if isinstance(value, list) else str(value)
            said["result"] = text
        component.setdefault(section.lower(), []).append(said)
    stream = {"name": "mill", "uuid": "u", "componentStream": [component]}
    return {"header": {"InstanceId": 2**64 - 1}, "streams": [stream]}


def xml() -> str:
    sections: dict[str, str] = {}
    for section, element, attributes, value in SAID:
        tag = " ".join(f'{k}="{v}"' for k, v in attributes.items())
        if element == "VariableDataSet":
            text = "".join(
                f'<Entry key="{key}" removed="true"/>'
                if word is None
                else f'<Entry key="{key}">{word}</Entry>'
                for key, word in value.items()
            )
        elif element == "WorkOffsetTable":
            cells = "".join(f'<Cell key="{k}">{v}</Cell>' for k, v in value["G54"].items())
            text = f'<Entry key="G54">{cells}</Entry>'
        else:
            words = value if isinstance(value, list) else [] if value is None else [value]
            text = " ".join(map(str, words))
        sections[section] = sections.get(section, "") + f"<{element} {tag}>{text}</{element}>"
    inside = "".join(f"<{name}>{text}</{name}>" for name, text in sections.items())
    return (
        f'<MTConnectStreams><Header instanceId="{2**64 - 1}"/><Streams><DeviceStream name="mill" '
        f'uuid="u"><ComponentStream component="Linear">{inside}</ComponentStream></DeviceStream>'
        "</Streams></MTConnectStreams>"
    )


def _loose(rows: Rows) -> Rows:
    """Rows with attributes as text, since XML has no numbers."""
    for row in rows:
        said = json.loads(row["attributes"] or "{}")
        row["attributes"] = {k: v if isinstance(v, bool) else str(v) for k, v in said.items()}
    return rows


@pytest.mark.parametrize("form", [version_1, version_2, net])
def test_each_form_says_what_xml_says(tmp_path: Path, form: Any) -> None:
    path = tmp_path / "streams.xml"
    path.write_text(xml())
    source = RecordSource(format="mtconnect_xml", files="*")
    expected, records, _ = outcome(mtconnect_xml.read, path, source)
    rows, read, rejected = _read(form(), tmp_path)
    assert (read, rejected) == (records, []) == (len(SAID), [])
    assert _loose(rows) == _loose(expected)
    assert [r["kind"] for r in rows] == (
        ["SAMPLE"] * 5 + ["TIME_SERIES"] * 2 + ["EVENT"] * 2 + ["MESSAGE"] + ["DATA_SET"] * 3
        + ["TABLE"] * 2 + ["CONDITION"] * 2
    )  # fmt: skip
    assert [r["time"] for r in rows if r["kind"] == "TIME_SERIES"] == [T0 - NS // 10, T0]


def test_a_lone_observation_is_read_by_what_it_holds(tmp_path: Path) -> None:
    lone = [
        _own("a", 1, type="EMERGENCY_STOP", result="ARMED"),
        _own("b", 2, type="SYSTEM", level="WARNING", nativeCode="9", result="low"),
        _own("c", 3, type="POSITION", sampleRate=1, samples=["1", "2"]),
        _own("d", 4, type="TOOL_OFFSET", entries=[{"key": "k", "value": "7"}]),
    ]
    text = b"\n".join(json.dumps(o).encode() for o in lone)
    for tree in (lone, text):
        rows, read, rejected = _read(tree, tmp_path)
        assert (read, rejected) == (4, [])
        assert [r["kind"] for r in rows] == [
            "UNKNOWN", "CONDITION", "TIME_SERIES", "TIME_SERIES", "DATA_SET",
        ]  # fmt: skip
        assert [r["key"] for r in rows] == [None, "9", "1", "2", "k"]


def test_broken_lines_are_rejected_with_their_number(tmp_path: Path) -> None:
    good = json.dumps(_own("a", 1, result="ARMED")).encode()
    rows, read, rejected = _read(good + b"\n{oops\n" + good, tmp_path)
    assert (len(rows), read) == (2, 3)
    assert (rejected[0].line, rejected[0].excerpt) == (2, "{oops")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"timestamp": None}, "no timestamp"),
        ({"timestamp": {"a": 1}}, "ISO 8601"),
        ({"sequence": 1.5}, "'1.5'"),
        ({"dataItemId": None}, "neither dataItemId nor name"),
        ({"value": True}, "'true'"),
        ({"value": [[1]]}, "more than numbers"),
    ],
)
def test_malformed_observations_are_rejected_alone(
    tmp_path: Path, change: dict[str, Any], reason: str
) -> None:
    good = _own("x", 1, value=1.5)
    samples = {"Samples": {"Load": [good, good | change]}}
    streams = {"DeviceStream": [{"ComponentStream": [samples]}]}
    rows, read, rejected = _read(_root(streams), tmp_path)
    assert ([r["number"] for r in rows], read) == ([1.5], 2)
    assert rejected[0].line == 2
    assert reason in rejected[0].reason


def test_devices_are_told_apart_or_chosen(tmp_path: Path) -> None:
    streams = [
        {"name": name, "uuid": f"u-{name}", "componentStream": [
            {"events": [_own("avail", 1, type="AVAILABILITY", result="AVAILABLE")]}]}
        for name in ("agent", "mill")
    ]  # fmt: skip
    rows, _, _ = _read({"streams": streams}, tmp_path)
    assert [r["data_item"] for r in rows] == ["agent:avail", "mill:avail"]
    chosen = RecordSource(format="mtconnect_json", files="*", device="u-mill")
    rows, read, rejected = _read({"streams": streams}, tmp_path, chosen)
    assert ([r["data_item"] for r in rows], read) == (["avail"], 2)
    assert "'agent'" in rejected[0].reason


@pytest.mark.parametrize(
    "assets",
    [
        {"CuttingTool": [{"assetId": "T1", "timestamp": WHEN}], "File": [{"assetId": "F1"}]},
        [{"CuttingTool": {"assetId": "T1", "timestamp": WHEN}}, {"File": {"assetId": "F1"}}],
        [{"type": "CuttingTool", "assetId": "T1", "timestamp": WHEN},
         {"type": "File", "assetId": "F1"}],
    ],
)  # fmt: skip
def test_assets(tmp_path: Path, assets: Any) -> None:
    tree = {"MTConnectAssets": {"Header": {"creationTime": WHEN}, "Assets": assets}}
    rows, read, rejected = _read(tree, tmp_path)
    assert [(r["text"], r["key"], r["time"], r["kind"]) for r in rows] == [
        ("CuttingTool", "T1", T0, "ASSET"), ("File", "F1", T0, "ASSET"),
    ]  # fmt: skip
    assert (read, rejected) == (2, [])
    assert json.loads(rows[0]["attributes"])["json"]["assetId"] == "T1"


@pytest.mark.parametrize(
    "errors",
    [
        {"Errors": [{"Error": {"errorCode": "OUT_OF_RANGE", "value": "too far"}}]},
        {"Errors": {"Error": [{"errorCode": "OUT_OF_RANGE", "value": "too far"}]}},
        {"Errors": {"OutOfRange": [{"errorCode": "OUT_OF_RANGE", "ErrorMessage": "too far",
                                    "URI": "/sample"}]}},
        {"Errors": [{"OutOfRange": {"errorCode": "OUT_OF_RANGE",
                                    "ErrorMessage": {"value": "too far"}, "URI": "/sample"}}]},
    ],
)  # fmt: skip
def test_an_agents_error_is_a_rejection(tmp_path: Path, errors: dict[str, Any]) -> None:
    rows, read, rejected = _read({"MTConnectError": {"Header": {}, **errors}}, tmp_path)
    assert (rows, read) == ([], 1)
    assert rejected[0].reason == "the agent answered OUT_OF_RANGE: too far"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "empty"),
        (b"<xml/>", "no JSON"),
        (b"{", "no JSON"),
        (b"12", "none of MTConnect"),
        (b'{"a": 1}', "none of MTConnect"),
        (b"[" * 2000, "no JSON"),
    ],
)
def test_other_files_are_unreadable(tmp_path: Path, text: bytes, reason: str) -> None:
    with pytest.raises(UnreadableFile, match=reason):
        _read(text, tmp_path)


TREES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=8),
    lambda inside: st.lists(inside, max_size=3)
    | st.dictionaries(
        st.sampled_from(
            ["Streams", "DeviceStream", "ComponentStream", "Samples", "Condition", "value",
             "dataItemId", "timestamp", "sequence", "name", "entries", "Assets", "assetId", "level",
             "Errors", "Devices", "DataItems", "removed", "key", "cells", "sampleRate", "Header"]
        ),
        inside, max_size=3,
    ),
    max_leaves=12,
)  # fmt: skip


def _tree_is_read_or_refused(tmp_path: Path, replaced: Any, at: int, form: Any) -> None:
    tree = json.loads(json.dumps(form()))
    nodes = [tree]
    for node in nodes:
        inside = node.values() if isinstance(node, dict) else node
        nodes += [v for v in inside if isinstance(v, (dict, list))]
    node = nodes[at % len(nodes)]
    place = next(iter(node)) if isinstance(node, dict) and node else 0
    if node:
        node[place] = replaced
    for changed in (tree, replaced):
        try:
            _read(changed, tmp_path)
        except UnreadableFile as error:
            assert str(error)


test_any_tree_is_read_or_refused, test_many_trees_are_read_or_refused = few_and_many(
    _tree_is_read_or_refused, 50, 300,
    replaced=TREES, at=st.integers(0, 60), form=st.sampled_from([version_1, version_2, net]),
)  # fmt: skip


def _bytes_are_read_or_refused(tmp_path: Path, text: bytes) -> None:
    try:
        _read(text, tmp_path)
    except UnreadableFile as error:
        assert str(error)


test_any_bytes_are_read_or_refused, test_many_bytes_are_read_or_refused = few_and_many(
    _bytes_are_read_or_refused, 40, 200,
    text=st.binary(max_size=100) | st.builds(
        lambda cut, insert: json.dumps(version_1()).encode()[:cut] + insert,
        st.integers(0, 3000), st.binary(max_size=5),
    ),
)  # fmt: skip


def test_nesting_that_nobody_means_is_rejected(tmp_path: Path) -> None:
    deep: Any = {"value": 1}
    for _ in range(900):
        deep = {"a": deep}
    tree = [_own("x", 1, value=1), _own("y", 2, value=deep), _own("z", 3, more=deep, value=1)]
    rows, read, rejected = _read(tree, tmp_path)
    assert (read, len(rows) + len(rejected)) == (3, 3)


RECORDINGS = os.environ.get("KERF_RECORDINGS")


@pytest.mark.skipif(not RECORDINGS, reason="KERF_RECORDINGS names no folder")
def test_documents_of_other_agents(tmp_path: Path) -> None:
    folder = Path(RECORDINGS or "") / "mtconnect_docs"
    for name in ("trakhound-Streams.json", "trakhound-MTConnectStreamsResponseDocument.json"):
        text = (folder / name).read_bytes().removeprefix(b"\xef\xbb\xbf")
        _, read, rejected = _read(text, tmp_path)
        assert (read, rejected) == (text.count(b'"sequence"'), [])


def test_a_condition_with_entries_is_rejected(tmp_path: Path) -> None:
    tree = _own("c1", 1, level="FAULT", entries=[{"key": "a", "value": "1"}])
    rows, read, rejected = _read(tree, tmp_path)
    assert (rows, read) == ([], 1) and "condition has entries" in rejected[0].reason
