"""MTConnect XML: what each kind of observation becomes, and what is rejected."""

import gzip
import json
import os
from pathlib import Path

import pyarrow as pa
import pytest
from mtconnect_files import NS, T0, WHEN, Rows, outcome

from pipeline.signals.formats import RecordSource, Rejection, UnreadableFile
from pipeline.signals.mtconnect.xml_document import read

SOURCE = RecordSource(format="mtconnect_xml", files="*.xml")
STAMP = f'timestamp="{WHEN}"'

FIRST = 8
"""Line of the first observation that `_streams` writes."""


def _streams(
    body: str, device: str = "mill", root: str = "MTConnectStreams", extra: str = ""
) -> str:
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<{root} xmlns="urn:mtconnect.org:x:1.7">\n'
        '<Header creationTime="2024-03-04T10:00:00Z" instanceId="18446744073709551615"/>\n'
        f'<Streams>{extra}\n<DeviceStream name="{device}" uuid="u-{device}">\n'
        f'<ComponentStream component="Linear" name="X" componentId="x">\n{body}\n'
        f"</ComponentStream>\n</DeviceStream>\n</Streams>\n</{root}>\n"
    )


def _section(name: str, *elements: str) -> str:
    lines = "\n".join(f"  {e}" for e in elements)
    return f"<{name}>\n{lines}\n</{name}>"


def _sample(value: str = "1.5", *, item: str = "x1", sequence: int = 7, more: str = "") -> str:
    return (
        f'<Position dataItemId="{item}" {STAMP} name="Xact" sequence="{sequence}"{more}>'
        f"{value}</Position>"
    )


def _read(
    text: str | bytes, tmp_path: Path, source: RecordSource = SOURCE
) -> tuple[Rows, int, list[Rejection]]:
    path = tmp_path / "streams.xml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return outcome(read, path, source)


def test_a_sample(tmp_path: Path) -> None:
    rows, read_, rejected = _read(
        _streams(_section("Samples", _sample("-1.50", more=' subType="ACTUAL"'))), tmp_path
    )
    assert (read_, rejected) == (1, [])
    assert rows == [{
        "time": T0, "data_item": "Xact", "number": -1.5, "text": None, "sequence": 7,
        "kind": "SAMPLE", "key": None, "attributes": '{"subType":"ACTUAL"}',
        "instance": 2**64 - 1,
    }]  # fmt: skip


@pytest.mark.parametrize(
    ("text", "number", "word"),
    [
        ("ACTIVE", None, "ACTIVE"),
        ("12", 12.0, None),
        (" 3e2 ", 300.0, None),
        ("0.10000000000000001", 0.1, None),
        ("123456789012345678901234567890", 123456789012345678901234567890.0, None),
        ("179769313486231580793728971405301e277", None, "179769313486231580793728971405301e277"),
        ("nan", None, "nan"),
        ("1_0", None, "1_0"),
        ("", None, ""),
        ("UNAVAILABLE", None, None),
        ("G1 X1 &lt; 2 &amp; Y3", None, "G1 X1 < 2 & Y3"),
        ("Gänsefuß 日本", None, "Gänsefuß 日本"),
        ("<![CDATA[a<b]]>", None, "a<b"),
        ("1 2 3", None, "1 2 3"),
    ],
)
def test_events_are_numbers_when_they_read_as_such(
    tmp_path: Path, text: str, number: float | None, word: str | None
) -> None:
    event = f'<Line dataItemId="b" {STAMP} sequence="1">{text}</Line>'
    ((row,), _, rejected) = _read(_streams(_section("Events", event)), tmp_path)
    assert (row["number"], row["text"], rejected) == (number, word, [])
    assert (row["kind"], row["data_item"]) == ("EVENT", "b")


@pytest.mark.parametrize("text", ["ON", "", "1,5", "nan", "INF", "1 2", "0x10", "1e999"])
def test_a_sample_that_is_no_number_is_rejected_with_its_line(tmp_path: Path, text: str) -> None:
    rows, read_, rejected = _read(_streams(_section("Samples", _sample(), _sample(text))), tmp_path)
    assert (len(rows), read_) == (1, 2)
    assert rejected[0].line == FIRST + 1
    assert repr(text) in rejected[0].reason
    assert rejected[0].excerpt.startswith("<Position")


def test_conditions(tmp_path: Path) -> None:
    body = _section(
        "Condition",
        f'<Normal dataItemId="c" {STAMP} sequence="1" type="SYSTEM"/>',
        f'<Warning dataItemId="c" {STAMP} sequence="2" type="SYSTEM" nativeCode="A1"'
        ' qualifier="HIGH" nativeSeverity="3">Too hot</Warning>',
        f'<Fault dataItemId="c" {STAMP} sequence="3" type="SYSTEM" nativeCode="A2"'
        ' conditionId="7">Door &amp; lock</Fault>',
        f'<Unavailable dataItemId="c" {STAMP} sequence="4" type="SYSTEM"/>',
        f'<Sulking dataItemId="c" {STAMP} sequence="5" type="SYSTEM"/>',
    )
    rows, read_, rejected = _read(_streams(body), tmp_path)
    assert [r["text"] for r in rows] == ["NORMAL", "WARNING", "FAULT", None]
    assert [r["key"] for r in rows] == [None, "A1", "7", None]
    assert json.loads(rows[1]["attributes"]) == {
        "type": "SYSTEM", "qualifier": "HIGH", "nativeSeverity": "3", "message": "Too hot",
    }  # fmt: skip
    assert json.loads(rows[2]["attributes"])["message"] == "Door & lock"
    assert all(r["number"] is None and r["kind"] == "CONDITION" for r in rows)
    assert read_ == 5
    assert "'Sulking'" in rejected[0].reason


def test_data_sets_and_tables_give_a_row_for_each_entry(tmp_path: Path) -> None:
    body = _section(
        "Events",
        f'<VariableDataSet dataItemId="v" {STAMP} sequence="1" count="3"><Entry key="a">1</Entry>'
        '<Entry key="b">on</Entry><Entry key="c" removed="true"/></VariableDataSet>',
        f'<WorkOffsetTable dataItemId="w" {STAMP} sequence="2" count="1"><Entry key="G54">'
        '<Cell key="X">1.5</Cell><Cell key="N">UNAVAILABLE</Cell></Entry></WorkOffsetTable>',
        f'<VariableDataSet dataItemId="v" {STAMP} sequence="3" count="0">UNAVAILABLE'
        "</VariableDataSet>",
        f'<VariableDataSet dataItemId="v" {STAMP} sequence="4" count="0"/>',
        f'<VariableDataSet dataItemId="v" {STAMP} sequence="5"><Row key="a"/></VariableDataSet>',
        f'<Block dataItemId="b" {STAMP} sequence="6">after</Block>',
    )
    rows, read_, rejected = _read(_streams(body), tmp_path)
    said = [(r["kind"], r["key"], r["number"], r["text"]) for r in rows]
    assert said == [
        ("DATA_SET", "a", 1.0, None),
        ("DATA_SET", "b", None, "on"),
        ("DATA_SET", "c", None, None),
        ("TABLE", "G54/X", 1.5, None),
        ("TABLE", "G54/N", None, None),
        ("DATA_SET", None, None, None),
        ("DATA_SET", None, None, None),
        ("EVENT", None, None, "after"),
    ]
    assert json.loads(rows[2]["attributes"]) == {"count": "3", "removed": True}
    assert read_ == 6
    assert "<Row>" in rejected[0].reason


def test_the_timestamp_of_a_time_series_is_that_of_its_last_value(tmp_path: Path) -> None:
    series = (
        f'<AccelerationTimeSeries dataItemId="a" {STAMP} sequence="1" sampleCount="3"'
        ' sampleRate="100">1 2 3.5</AccelerationTimeSeries>'
    )
    rows, read_, _ = _read(_streams(_section("Samples", series)), tmp_path)
    assert read_ == 1
    assert [r["time"] for r in rows] == [T0 - 20_000_000, T0 - 10_000_000, T0]
    assert [r["key"] for r in rows] == ["1", "2", "3"]
    assert [r["number"] for r in rows] == [1.0, 2.0, 3.5]
    wrong = series.replace('sampleCount="3"', 'sampleCount="4"')
    _, _, rejected = _read(_streams(_section("Samples", wrong)), tmp_path)
    assert "3 values, its sampleCount is 4" in rejected[0].reason


def test_a_position_in_space_gives_three_rows(tmp_path: Path) -> None:
    body = _section("Samples", _sample("1 -2.5 3"), _sample("1 2"), _sample("4"))
    rows, read_, rejected = _read(_streams(body), tmp_path)
    assert [(r["key"], r["number"]) for r in rows] == [
        ("X", 1.0), ("Y", -2.5), ("Z", 3.0), (None, 4.0),
    ]  # fmt: skip
    assert (read_, len(rejected)) == (3, 1)


def test_messages_keep_their_code_and_stay_text(tmp_path: Path) -> None:
    body = _section(
        "Events",
        f'<Message dataItemId="m" {STAMP} sequence="1" nativeCode="77">12</Message>',
        f'<AssetChanged dataItemId="ac" {STAMP} sequence="2" assetType="CuttingTool">T1'
        "</AssetChanged>",
    )
    rows, _, _ = _read(_streams(body), tmp_path)
    assert [(r["kind"], r["key"], r["text"]) for r in rows] == [
        ("MESSAGE", "77", "12"), ("EVENT", None, "T1"),
    ]  # fmt: skip
    assert rows[1]["attributes"] == '{"assetType":"CuttingTool"}'


@pytest.mark.parametrize(
    ("stamp", "ns"),
    [
        ("2024-02-29T23:59:59.1234567899Z", 1_709_251_199_123_456_789),
        ("2024-03-04T04:30:00.5-05:30", T0),
        ("1969-12-31T23:59:59.25Z", -NS + NS // 4),
    ],
)
def test_times_are_whole_nanoseconds(tmp_path: Path, stamp: str, ns: int) -> None:
    """Their forms are those of a log's times, which have the same reader."""
    text = _streams(_section("Samples", _sample().replace(WHEN, stamp)))
    ((row,), _, _) = _read(text, tmp_path)
    assert row["time"] == ns


@pytest.mark.parametrize(
    "change",
    [
        (STAMP, ""),
        (STAMP, 'timestamp=""'),
        (STAMP, 'timestamp="2023-02-29T00:00:00Z"'),
        ('sequence="7"', 'sequence="18446744073709551616"'),
        ('sequence="7"', 'sequence="-1"'),
        ('dataItemId="x1"', ""),
    ],
)
def test_malformed_observations_are_rejected_alone(tmp_path: Path, change: tuple[str, str]) -> None:
    bad = _sample().replace(*change).replace('name="Xact"', "")
    rows, read_, rejected = _read(
        _streams(_section("Samples", _sample("1"), bad, _sample("2"))), tmp_path
    )
    assert ([r["number"] for r in rows], read_) == ([1.0, 2.0], 3)
    assert rejected[0].line == FIRST + 1


def test_sequences_are_unsigned_64_bit_and_the_place_where_there_is_none(tmp_path: Path) -> None:
    body = _section(
        "Samples", _sample(sequence=2**64 - 1), _sample().replace('sequence="7"', ""), _sample()
    )
    rows, _, _ = _read(_streams(body), tmp_path)
    assert [r["sequence"] for r in rows] == [2**64 - 1, 2, 7]


def test_documents_follow_each_other_in_every_way(tmp_path: Path) -> None:
    one = _streams(_section("Samples", _sample("1")))
    two = _streams(_section("Samples", _sample("2"))).replace("18446744073709551615", "5")
    part = f"\r\n--boundary\r\nContent-type: text/xml\r\nContent-length: {len(two)}\r\n\r\n"
    heartbeat = _streams("").split("<Streams>")[0] + "<Streams/></MTConnectStreams>"
    for text in (one + two, part + one + part + heartbeat + part + two + "\r\n--boundary--\r\n"):
        rows, read_, rejected = _read(text, tmp_path)
        assert ([r["number"] for r in rows], read_, rejected) == ([1.0, 2.0], 2, [])
        assert [r["instance"] for r in rows] == [2**64 - 1, 5]


def test_what_stands_between_documents_is_rejected(tmp_path: Path) -> None:
    one = _streams(_section("Samples", _sample("1")))
    rows, read_, rejected = _read(one + "garbage here\n" + one, tmp_path)
    assert (len(rows), read_) == (2, 3)
    assert rejected[0].line == one.count("\n") + 1


def test_a_document_cut_in_the_middle_keeps_what_stood_before(tmp_path: Path) -> None:
    whole = _streams(_section("Samples", _sample("1"), _sample("2"), _sample("3")))
    cut = whole[: whole.index("3</Position>")]
    rows, read_, rejected = _read(cut, tmp_path)
    assert ([r["number"] for r in rows], read_) == ([1.0, 2.0], 3)
    assert rejected[0].line == FIRST + 2
    assert "breaks off" in rejected[0].reason
    # The next document is read again.
    rows, _, _ = _read(cut + "\n" + whole, tmp_path)
    assert [r["number"] for r in rows] == [1.0, 2.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    "odd",
    [
        _sample("5").replace('"', "'"),
        "<!-- a comment -->" + _sample("5"),
        _sample("<!-- within -->5"),
        _sample("5").replace("> ", ">\n"),
        _sample("5").replace(" name", "\n  name"),
        _sample("\n5\n"),
        _sample("5").replace("Position", "v:Position"),
        _sample("5").replace("</Position>", "</Position >"),
        _sample("&#53;"),
        "text" + _sample("5"),
    ],
)
def test_whatever_is_not_as_agents_write_it_is_read_as_well(tmp_path: Path, odd: str) -> None:
    body = _section("Samples", _sample("4"), odd, _sample("6"))
    rows, read_, rejected = _read(_streams(body) + _streams(body), tmp_path)
    assert ([r["number"] for r in rows], read_, rejected) == ([4.0, 5.0, 6.0] * 2, 6, [])


@pytest.mark.parametrize("broken", ["&nope;", "]]>", "a < b", "\x01", "\udcff", "</Load>"])
def test_broken_xml_ends_a_document_at_its_line(tmp_path: Path, broken: str) -> None:
    body = _section("Events", _sample("4"), _sample(broken), _sample("6"))
    text = (_streams(body) + _streams(_section("Events", _sample("7")))).encode(
        "utf-8", "surrogateescape"
    )
    rows, read_, rejected = _read(text, tmp_path)
    assert [r["number"] for r in rows] == [4.0, 7.0]
    assert (read_, rejected[0].line) == (3, FIRST + 1)


@pytest.mark.parametrize("root", ["MTConnectStreams", "m:MTConnectStreams"])
def test_elements_outside_the_sections_are_rejected(tmp_path: Path, root: str) -> None:
    text = _streams(_sample() + _section("Samples", _sample()), root=root)
    rows, read_, rejected = _read(text, tmp_path)
    assert (len(rows), read_) == (1, 2)
    assert "<Position> stands outside" in rejected[0].reason


def test_two_devices_name_their_items_apart(tmp_path: Path) -> None:
    other = f'<DeviceStream name="Agent" uuid="a">{_section("Events", _sample("1"))}</DeviceStream>'
    other = other.replace("<Events>", "<ComponentStream><Events>")
    other = other.replace("</Events>", "</Events></ComponentStream>")
    text = _streams(_section("Samples", _sample("2")), extra=other)
    rows, _, _ = _read(text, tmp_path)
    assert [r["data_item"] for r in rows] == ["Agent:Xact", "mill:Xact"]
    for name in ("mill", "u-mill"):
        chosen = RecordSource(format="mtconnect_xml", files="*", device=name)
        rows, read_, rejected = _read(text, tmp_path, chosen)
        assert [r["data_item"] for r in rows] == ["Xact"]
        assert (read_, len(rejected)) == (2, 1)
        assert "'Agent'" in rejected[0].reason


def test_a_device_document_gives_names_and_representations(tmp_path: Path) -> None:
    (tmp_path / "Devices.xml").write_text(
        '<MTConnectDevices><Devices><Device id="d" name="mill"><DataItems>'
        '<DataItem id="x1" name="Xact" category="SAMPLE" type="ACCELERATION"'
        ' representation="TIME_SERIES" sampleRate="10"/></DataItems></Device></Devices>'
        "</MTConnectDevices>"
    )
    source = RecordSource(format="mtconnect_xml", files="*", devices="Devices.xml")
    text = _streams(_section("Samples", _sample("1 2").replace('name="Xact"', "")))
    rows, _, _ = _read(text, tmp_path, source)
    assert [(r["kind"], r["data_item"], r["time"]) for r in rows] == [
        ("TIME_SERIES", "Xact", T0 - NS // 10), ("TIME_SERIES", "Xact", T0),
    ]  # fmt: skip


def test_assets_keep_their_xml(tmp_path: Path) -> None:
    asset = (
        '<CuttingTool assetId="T1" timestamp="2024-03-04T10:00:00.5Z">'
        "<x:Note>a &lt; b</x:Note></CuttingTool>"
    )
    text = (
        '<MTConnectAssets><Header creationTime="2024-03-04T10:00:00Z" instanceId="3"/><Assets>'
        f'{asset}<File assetId="F1"/><File/></Assets></MTConnectAssets>'
    )
    rows, read_, rejected = _read(text, tmp_path)
    assert [(r["kind"], r["text"], r["key"], r["time"]) for r in rows] == [
        ("ASSET", "CuttingTool", "T1", T0), ("ASSET", "File", "F1", T0 - NS // 2),
    ]  # fmt: skip
    assert json.loads(rows[0]["attributes"])["xml"] == asset
    assert (read_, len(rejected)) == (3, 1)
    ((row,), _, _) = _read(asset, tmp_path)
    assert (row["key"], row["data_item"]) == ("T1", "asset")


@pytest.mark.parametrize(
    "errors",
    [
        '<Error errorCode="OUT_OF_RANGE">too far</Error>',
        '<Errors><Error errorCode="OUT_OF_RANGE">too far</Error></Errors>',
        '<Errors><OutOfRange errorCode="OUT_OF_RANGE"><ErrorMessage>too far</ErrorMessage>'
        "<URI>/sample</URI></OutOfRange></Errors>",
    ],
)
def test_an_agents_error_is_a_rejection(tmp_path: Path, errors: str) -> None:
    rows, read_, rejected = _read(f"<MTConnectError><Header/>{errors}</MTConnectError>", tmp_path)
    assert (rows, read_) == ([], 1)
    assert rejected[0].reason == "the agent answered OUT_OF_RANGE: too far"


def test_device_documents_count_their_items(tmp_path: Path) -> None:
    items = '<Device id="d"><DataItems><DataItem id="a"/><DataItem id="b"/></DataItems></Device>'
    for text in (f"<MTConnectDevices><Devices>{items}</Devices></MTConnectDevices>", items * 2):
        rows, read_, rejected = _read(text, tmp_path)
        assert (rows, read_ % 2, rejected) == ([], 0, [])
        assert read_


BILLION = (
    '<!DOCTYPE l [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;"><!ENTITY c "&b;&b;&b;&b;">]>'
    "<MTConnectStreams>&c;</MTConnectStreams>"
)
EXTERNAL = (
    '<!DOCTYPE l [<!ENTITY a SYSTEM "file:///etc/hostname">]>'
    "<MTConnectStreams>&a;</MTConnectStreams>"
)


@pytest.mark.parametrize("text", [BILLION, EXTERNAL, '<?xml version="1.0"?>' + EXTERNAL])
def test_document_type_declarations_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(UnreadableFile, match="document type declaration"):
        _read(text, tmp_path)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "empty"),
        ("2024-01-01T00:00:00Z|a|1\n", "begins with '2024"),
        ("<html><body/></html>", "<html>"),
        ("<BrokenElement", "no XML"),
        ('<?xml version="1.0" encoding="klingon"?><MTConnectStreams/>', "'klingon'"),
    ],
)
def test_other_files_are_unreadable(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(UnreadableFile, match=reason):
        _read(text, tmp_path)


def test_huge_texts_are_rejected_without_being_kept(tmp_path: Path) -> None:
    text = _streams(_section("Events", _sample("x" * (17 << 20)), _sample("1")))
    rows, read_, rejected = _read(text, tmp_path)
    assert ([r["number"] for r in rows], read_) == ([1.0], 2)
    assert "17825792 characters" in rejected[0].reason


@pytest.mark.parametrize("n", [21_000, pytest.param(210_000, marks=pytest.mark.proof)])
def test_more_records_than_fit_a_batch(
    tmp_path: Path, n: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Many of them are of as many shapes."""
    monkeypatch.setattr("pipeline.signals.mtconnect.xml_events.CHUNK", 5 * n)
    more = "" if n < 100_000 else ' duration="{0}"'
    lines = [_sample(f"{i}", sequence=i, more=more.format(i)) for i in range(n)]
    lines[n // 2] = _sample("&#49;", item="odd", sequence=n // 2)
    path = tmp_path / "long.xml"
    path.write_text(_streams(_section("Samples", *lines)))
    batches = list(read(path, SOURCE, tmp_path))
    assert max(b.read for b in batches) < n / 2
    assert sum(b.read for b in batches) == sum(b.kept for b in batches) == n
    sequence = pa.concat_tables([b.observations for b in batches])["sequence"].to_numpy()
    assert (sequence == range(n)).all()


RECORDINGS = os.environ.get("KERF_RECORDINGS")
needs_recordings = pytest.mark.skipif(not RECORDINGS, reason="KERF_RECORDINGS names no folder")


@needs_recordings
@pytest.mark.parametrize("name", ["qdr_input001.xml", "qdr_input100.xml"])
def test_nist_documents_are_read_whole(tmp_path: Path, name: str) -> None:
    path = Path(RECORDINGS or "") / "nist_mazak01" / "xml_streams" / name
    rows, read_, rejected = _read(path.read_bytes(), tmp_path)
    assert (read_, rejected) == (path.read_text().count(" sequence="), [])
    assert {r["kind"] for r in rows} == {"SAMPLE", "EVENT", "CONDITION"}
    assert all(r["number"] is not None or r["text"] is None for r in rows if r["kind"] == "SAMPLE")


@pytest.mark.parametrize("encoding", ["rot13", "hex", "base64", "nonsense"])
def test_an_encoding_that_is_none_is_refused(tmp_path: Path, encoding: str) -> None:
    with pytest.raises(UnreadableFile, match=f"encoding '{encoding}'"):
        _read(f'<?xml version="1.0" encoding="{encoding}"?><MTConnectStreams/>', tmp_path)


def test_a_packed_document_is_the_document(tmp_path: Path) -> None:
    text = _streams(_section("Samples", *(_sample(f"{n}", sequence=n) for n in range(50)))).encode()
    packed = gzip.compress(text)
    wanted = _read(text, tmp_path)
    assert _read(packed, tmp_path) == wanted
    rows, _, rejected = _read(packed[:-60], tmp_path)
    assert 0 < len(rows) < len(wanted[0]) and len(rejected) >= 1
