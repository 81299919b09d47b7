"""Alarms from conditions: what ends which, where the program was, what is written."""

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.schema.identity import MachineIdentity
from pipeline.signals.cleaning.clean import clean
from pipeline.signals.cleaning.recorded import Said, alarms
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.signals.columns import OBSERVATIONS
from pipeline.signals.contracts import check
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest

SECOND = 1_000_000_000


def said(*rows):
    return [
        Said(t * SECOND, item, level, code, f"M{code}" if code else "")
        for t, item, level, code in rows
    ]


def state(**columns):
    return pd.DataFrame({"time": pd.Series([], dtype="datetime64[ns, UTC]")} | columns)


def told(rows, known=None):
    found = alarms(said(*rows), state() if known is None else known)
    check("alarms", found)
    zero = pd.Timestamp(0, tz="UTC")
    return [
        (row.data_item, row.level, row.code, (row.start - zero).seconds,
         None if pd.isna(row.end) else (row.end - zero).seconds, row.ended)
        for row in found.itertuples()
    ]  # fmt: skip


def test_normal_with_a_code_ends_that_one_and_without_all_of_the_item():
    rows = [
        (1, "a", "WARNING", "7"), (2, "a", "FAULT", "8"), (2, "b", "WARNING", "7"),
        (3, "a", "NORMAL", "7"), (5, "a", "NORMAL", ""),
    ]  # fmt: skip
    assert told(rows) == [
        ("a", "warning", "7", 1, 3, "cleared"),
        ("a", "fault", "8", 2, 5, "cleared"),
        ("b", "warning", "7", 2, None, "open"),
    ]


def test_a_warning_that_becomes_a_fault_ends_and_what_is_repeated_does_not_begin_again():
    rows = [
        (1, "a", "WARNING", "7"), (1, "a", "WARNING", "7"), (4, "a", "FAULT", "7"),
        (6, "a", "", ""), (7, "a", "NORMAL", "9"),
    ]  # fmt: skip
    assert told(rows) == [
        ("a", "warning", "7", 1, 4, "changed"),
        ("a", "fault", "7", 4, 6, "unavailable"),
    ]


def test_program_and_line_are_those_of_the_last_second_before():
    times = pd.to_datetime([2, 3, 10], unit="s", utc=True)
    known = pd.DataFrame({"time": times, "program": ["O1", "O2", None], "line": [5.0, 6.0, 7.0]})
    rows = [(t, "a", "FAULT", str(t)) for t in (1, 4, 12)]
    found = alarms(said(*rows), known)
    assert found["program"].tolist() == [None, "O2", None]
    assert found["line"].fillna(-1).tolist() == [-1, 6.0, 7.0]


def test_without_conditions_there_is_an_empty_table():
    assert told([]) == []


def observations(folder, day, rows):
    """One file of an agent: conditions of one item, and what the control runs beside them."""
    begin = pd.Timestamp(day, tz="UTC").value
    every = [
        (begin + t * SECOND, name, value, kind, key, attributes)
        for t, name, value, kind, key, attributes in [
            *((t, "servo", level, "CONDITION", code, text) for t, level, code, text in rows),
            *((t, "program", f"O{t}", "EVENT", None, None) for t in range(0, 60, 7)),
            *((t, "execution", "ACTIVE", "EVENT", None, None) for t in range(60)),
        ]
    ]
    every.sort(key=lambda row: row[0])
    time, item, text, kind, key, attributes = zip(*every, strict=True)
    n = len(every)
    columns = [
        time, item, [None] * n, text, range(1, n + 1), kind, key, attributes, [None] * n,
    ]  # fmt: skip
    table = pa.table([pa.array(list(column)) for column in columns], names=OBSERVATIONS.names).cast(
        OBSERVATIONS
    )
    path = folder / f"observations/{day}.parquet"
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)


def test_cleaning_writes_the_alarms_and_a_later_file_ends_what_was_open(tmp_path):
    machine = CleanMachine(signals={"program": "program", "execution": "execution"})
    signals, out = tmp_path / "signals", tmp_path / "clean"
    words = '{"message": "FOLLOWING ERROR", "qualifier": "HIGH"}'
    observations(signals, "2024-03-04", [
        (1, "NORMAL", None, None), (20, "FAULT", "417", words), (25, "NORMAL", "417", None),
        (40, "Warning", "9", "no JSON"),
    ])  # fmt: skip
    clean(signals, out, machine=machine)
    first = pq.read_table(out / "alarms.parquet").to_pandas()
    assert first[["level", "code", "message", "ended", "program"]].to_numpy().tolist() == [
        ["fault", "417", "FOLLOWING ERROR HIGH", "cleared", "O14"],
        ["warning", "9", "", "open", "O35"],
    ]
    observations(signals, "2024-03-05", [(2, "Normal", None, None)])
    clean(signals, out, machine=machine)
    again = pq.read_table(out / "alarms.parquet").to_pandas()
    assert again["ended"].tolist() == ["cleared", "cleared"]
    assert str(again["end"][1]) == "2024-03-05 00:00:02+00:00"
    check("alarms", again)


STREAMS = """<MTConnectStreams xmlns="urn:mtconnect.org:MTConnectStreams:1.3"><Header
 creationTime="2024-03-04T10:01:00Z" instanceId="1" nextSequence="9" firstSequence="1"
 lastSequence="8"/><Streams><DeviceStream name="m" uuid="u"><ComponentStream component="Path"
 name="p" componentId="p"><Condition>{rows}</Condition></ComponentStream></DeviceStream></Streams>
</MTConnectStreams>"""


def test_conditions_of_a_document_several_at_once_and_without_text(tmp_path):
    """Two alarms of one data item are active together; an empty one ends with all of them."""
    rows = [
        ("Normal", 0, "", ""), ("Warning", 5, ' nativeCode="7"', "DOOR OPEN"),
        ("Fault", 6, ' nativeCode="8" nativeSeverity="90" qualifier="HIGH"', ""),
        ("Normal", 9, ' nativeCode="7"', ""), ("Normal", 20, "", ""), ("Warning", 30, "", ""),
    ]  # fmt: skip
    said = "".join(
        f'<{level} dataItemId="servo" name="servo" type="ACTUATOR" sequence="{n}" '
        f'timestamp="2024-03-04T10:00:{second:02d}Z"{more}>{text}</{level}>'
        for n, (level, second, more, text) in enumerate(rows, 1)
    )
    raw = tmp_path / "raw"
    raw.mkdir()
    (raw / "sample.xml").write_text(STREAMS.format(rows=said))
    source = RecordSource(format="mtconnect_xml", files="*.xml")
    identity = MachineIdentity(name="m", description="m", origin="recorded")
    ingest(raw, tmp_path / "signals", [source], identity)
    clean(tmp_path / "signals", tmp_path / "clean", machine=CleanMachine(signals={}))
    found = pq.read_table(tmp_path / "clean/alarms.parquet").to_pandas()
    assert found[["level", "code", "message", "ended"]].to_numpy().tolist() == [
        ["warning", "7", "DOOR OPEN", "cleared"],
        ["fault", "8", "HIGH", "cleared"],
        ["warning", "", "", "open"],
    ]
    lasted = (found["end"] - found["start"]).dt.total_seconds()
    assert lasted[:2].tolist() == [4.0, 14.0] and found["end"].isna().tolist() == [0, 0, 1]
