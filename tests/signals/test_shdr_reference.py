"""SHDR logs, by the scanner and line by line: forms of records, lines, times and bytes."""

import gzip
from datetime import UTC, datetime
from pathlib import Path

import pytest
from shdr_log import NATIVE, NS, SOURCE, TIME, UNITS, Log, line_by_line, said, scanned

from pipeline.signals.formats import UnreadableFile
from pipeline.signals.mtconnect.observations import iso_ns
from pipeline.signals.shdr.lines import LONGEST, fields_of
from pipeline.signals.shdr.record_forms import entries_of


@pytest.fixture(params=[pytest.param(line_by_line, marks=pytest.mark.proof), scanned])
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Log:
    return Log(request.param, tmp_path)


# Values -------------------------------------------------------------------------------------------


def test_pairs_of_a_line(log: Log) -> None:
    rows = log.rows(f"{TIME}|Xact|1.5|mode|AUTOMATIC\r\n{TIME}|Yact|-3e2\r\n")
    assert rows == [
        (NS, "Xact", 1.5, None, 1, "UNKNOWN", None, None, None),
        (NS, "mode", None, "AUTOMATIC", 2, "UNKNOWN", None, None, None),
        (NS, "Yact", -300.0, None, 3, "UNKNOWN", None, None, None),
    ]


def test_unavailable_and_empty(log: Log) -> None:
    assert log.values("a|UNAVAILABLE\na|Unavailable|b|unavailable\nc|\nd||e|1") == [
        ("a", None, None, None), ("a", None, None, None), ("b", None, None, None),
        ("c", None, "", None), ("d", None, "", None), ("e", 1.0, None, None),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text", ["nan", "inf", "1e999", "1_0", "0x1F", "1,5", "٣", "1 2", "-", "."]
)
def test_what_is_no_finite_decimal_number_is_text(log: Log, text: str) -> None:
    assert log.values(f"a|{text}") == [("a", None, text, None)]


def test_device_prefix_is_kept_without_a_document_and_resolved_with_one(log: Log) -> None:
    assert log.values("mill:Xact|1") == [("mill:Xact", 1.0, None, None)]
    assert log.values("mill:Xact|1", UNITS) == [("Xact", 1.0, None, None)]


def test_escaped_pipes() -> None:
    assert fields_of(r'a|"x\|y"|b\|c|"q"| "z\"" ') == ["a", "x|y", "b|c", "q", 'z"']
    assert fields_of(r'a|"not closed|b') == ["a", '"not closed', "b"]
    assert fields_of(r"a|C:\NC\1") == ["a", r"C:\NC\1"]


def test_escaped_pipes_in_lines(log: Log) -> None:
    assert log.values('note|x\\|y|z\na|x\\|y\nb|"u\\|v"|c|1\nd|C:\\p') == [
        ("note", None, "z", "x|y"), ("a", None, "x|y", None), ("b", None, "u|v", None),
        ("c", 1.0, None, None), ("d", None, "C:\\p", None),
    ]  # fmt: skip


# Conditions, messages, assets, sets ---------------------------------------------------------------


def test_conditions(log: Log) -> None:
    rows = log.rows(
        f"{TIME}|servo|fault|417|90|HIGH|ALARM, AXIS X\n"
        f"{TIME}|servo|NORMAL||||\n{TIME}|servo|Unavailable||||\n{TIME}|a|NORMAL|b|1|c|2\n"
    )
    assert [(r[1], r[3], r[5], r[6]) for r in rows] == [
        ("servo", "FAULT", "CONDITION", "417"),
        ("servo", "NORMAL", "CONDITION", None),
        ("servo", None, "CONDITION", None),
        ("a", "NORMAL", "UNKNOWN", None),
        ("b", None, "UNKNOWN", None),
        ("c", None, "UNKNOWN", None),
    ]
    assert said(rows[0]) == {"severity": "90", "qualifier": "HIGH", "message": "ALARM, AXIS X"}


def test_conditions_of_the_document(log: Log) -> None:
    data = f"{TIME}|servo|WARNING|700:7a|2||Door\n{TIME}|servo|NORMAL\n{TIME}|servo|BAD||||\n"
    rows = log.rows(data, UNITS)
    assert [(r[3], r[6]) for r in rows] == [("WARNING", "7a"), ("NORMAL", None)]
    assert said(rows[0])["nativeCode"] == "700"
    assert [(r.line, "BAD" in r.reason) for r in log.rejected(data, UNITS)] == [(3, True)]


def test_messages_and_alarms(log: Log) -> None:
    assert log.values("note|7|Door open") == [("note", None, "Door open", "7")]
    rows = log.rows(f"{TIME}|msg|7|Door|line|3\n{TIME}|alarm|C|417|9|ACTIVE|Axis\n", UNITS)
    assert [(r[1], r[2], r[3], r[5], r[6]) for r in rows] == [
        ("msg", None, "Door", "MESSAGE", "7"),
        ("line", 3.0, None, "EVENT", None),
        ("alarm", None, "Axis", "MESSAGE", "417"),
    ]


def test_assets(log: Log) -> None:
    rows = log.rows(
        f"{TIME}|@ASSET@|T1|CuttingTool|<a>|</a>\n"
        f"{TIME}|@ASSET@|T2|CuttingTool|--multiline--AB\n<tool>\n a|b\n</tool>\n--multiline--AB\n"
        f"{TIME}|@UPDATE_ASSET@|T1|OverallToolLength|99|Location|1\n"
        f"{TIME}|@REMOVE_ASSET@|T1\n{TIME}|@REMOVE_ALL_ASSETS@|CuttingTool\n{TIME}|a|1\n"
    )
    assert [(r[1], r[3], r[4], r[6]) for r in rows] == [
        ("asset", "CuttingTool", 1, "T1"),
        ("asset", "CuttingTool", 2, "T2"),
        ("asset", "", 3, "T1"),
        ("asset", None, 4, "T1"),
        ("asset", None, 5, None),
        ("a", None, 6, None),
    ]
    assert said(rows[0])["xml"] == "<a>|</a>"
    assert said(rows[1])["xml"] == "<tool>\n a|b\n</tool>"
    assert said(rows[2])["changes"] == {"OverallToolLength": "99", "Location": "1"}


def test_a_block_without_end_is_rejected_and_the_lines_after_it_are_read(log: Log) -> None:
    data = f"{TIME}|@ASSET@|T|Tool|--multiline--A\n<x>\n{TIME}|a|1\n"
    assert [r[1] for r in log.rows(data)] == ["a"]
    assert [r.line for r in log.rejected(data)] == [1, 2]


def test_adapter_commands_are_kept_without_rows(log: Log) -> None:
    (batch,) = log.batches(f"* PONG 10000\n* shdrVersion: 2.0\n{TIME}|a|1\n")
    assert (batch.read, batch.kept, len(batch.observations)) == (3, 3, 1)
    assert batch.observations["sequence"].to_pylist() == [3]


def test_data_sets_and_tables(log: Log) -> None:
    assert log.values("vars|a=1 b={x y} c d= e='q r'", UNITS) == [
        ("vars", 1.0, None, "a"), ("vars", None, "x y", "b"), ("vars", None, None, "c"),
        ("vars", None, None, "d"), ("vars", None, "q r", "e"),
    ]  # fmt: skip
    assert log.values("offsets|G54={X=1 Y=2} G55", UNITS) == [
        ("offsets", 1.0, None, "G54/X"), ("offsets", 2.0, None, "G54/Y"),
        ("offsets", None, None, "G55"),
    ]  # fmt: skip
    rows = log.rows(f"{TIME}|vars|:MANUAL a=1\n", UNITS)
    assert said(rows[0]) == {"resetTriggered": "MANUAL"}
    assert "not closed" in log.rejected(f"{TIME}|vars|a={{1\n{TIME}|line|1\n", UNITS)[0].reason
    with pytest.raises(ValueError, match="no key at character 3"):
        entries_of("a =1")


def test_time_series_end_at_the_time_of_the_record(log: Log) -> None:
    for source, line in (
        (UNITS, "wave|3||1 2 3"),
        (UNITS, "wave|3|10|1 2 3"),
        (SOURCE, "w|3|10|1 2 3"),
    ):
        rows = log.rows(f"{TIME}|{line}\n", source)
        assert [(r[0] - NS, r[2], r[5], r[6]) for r in rows] == [
            (-200_000_000, 1.0, "TIME_SERIES", "1"),
            (-100_000_000, 2.0, "TIME_SERIES", "2"),
            (0, 3.0, "TIME_SERIES", "3"),
        ]
    assert "has 2" in log.rejected(f"{TIME}|wave|3||1 2\n{TIME}|line|1\n", UNITS)[0].reason


def test_positions(log: Log) -> None:
    for source in (SOURCE, UNITS):
        assert log.values("pos|1.5 2 -3", source) == [
            ("pos", 1.5, None, "X"),
            ("pos", 2.0, None, "Y"),
            ("pos", -3.0, None, "Z"),
        ]


# Units and kinds of the document ------------------------------------------------------------------


def test_native_values_become_units(log: Log) -> None:
    assert log.values("Xact|2\ns1|1250\nline|7", NATIVE) == [
        ("Xact", 50.8, None, None),
        ("s1", 125.0, None, None),
        ("line", 7.0, None, None),
    ]
    assert log.values("Xact|2", UNITS) == [("Xact", 2.0, None, None)]
    why = log.rejected(f"{TIME}|odd|2\n{TIME}|line|1\n", NATIVE)
    assert [r.line for r in why] == [1] and "INCH" in why[0].reason


def test_a_sample_that_is_no_number_is_rejected(log: Log) -> None:
    data = f"{TIME}|line|1\n{TIME}|Xact|ON\n{TIME}|Xact|\n{TIME}|Xact|1:DAY\n{TIME}|Xact|1|line|2\n"
    rejected = log.rejected(data, UNITS)
    assert [(r.line, r.excerpt) for r in rejected] == [(2, "Xact|ON"), (3, "Xact|")]
    assert "'ON'" in rejected[0].reason
    assert [(r[1], r[2], r[4]) for r in log.rows(data, UNITS)] == [
        ("line", 1.0, 1),
        ("Xact", 1.0, 4),
        ("Xact", 1.0, 5),
        ("line", 2.0, 6),
    ]


def test_program_names_stay_words(log: Log) -> None:
    assert log.values("program|0012\nprogram|UNAVAILABLE", UNITS) == [
        ("program", None, "0012", None),
        ("program", None, None, None),
    ]


# Times --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("2019-05-20T10:46:17Z", "2019-05-20T10:46:17+00:00"),
        ("2019-05-20T10:46:17.5", "2019-05-20T10:46:17.5+00:00"),
        ("2019-05-20T10:46:17.1234567Z", "2019-05-20T10:46:17.123456+00:00"),
        ("2019-05-20T12:46:17+02:00", "2019-05-20T10:46:17+00:00"),
        ("2019-05-20T04:16:17-0630", "2019-05-20T10:46:17+00:00"),
        ("2016-12-31T23:59:60Z", "2017-01-01T00:00:00+00:00"),
        ("2000-02-29 00:00:00Z", "2000-02-29T00:00:00+00:00"),
        ("1999-12-31T23:59:59.999Z", "1999-12-31T23:59:59.999+00:00"),
    ],
)
def test_iso_times(log: Log, text: str, expected: str) -> None:
    at = datetime.fromisoformat(expected) - datetime(1970, 1, 1, tzinfo=UTC)
    micro = (at.days * 86400 + at.seconds) * 10**6 + at.microseconds
    assert int(log.rows(f"{text}|a|1\n")[0][0]) // 1000 == micro  # type: ignore[call-overload]
    # nanoseconds are kept, and further digits cut
    assert log.rows("2019-05-20T10:46:17.1234567899Z|a|1\n")[0][0] == NS + 789


@pytest.mark.parametrize("text", [
    "2019-02-29T00:00:00Z", "2019-13-01T00:00:00Z", "2019-05-20T24:00:00Z", "1677-12-31T00:00:00Z",
    "2262-01-01T00:00:00Z", "2019-05-20T10:46:17.Z", "2019-05-20T10:46:17X", "20190520T104617Z",
])  # fmt: skip
def test_times_that_are_none_are_rejected(log: Log, text: str) -> None:
    rejected = log.rejected(f"{TIME}|a|1\n{text}|a|1\n")
    assert [(r.line, text in r.reason) for r in rejected] == [(2, True)]
    assert iso_ns(text) is None


def test_duration_relative_and_missing_times(log: Log) -> None:
    rows = log.rows(f"{TIME}@0.25|a|1\n1500.5|a|2\n|a|3\n{TIME}|a|4\n|a|5\n")
    assert [r[0] for r in rows] == [NS, 1_500_500_000, 1_500_500_000, NS, NS]
    assert [said(r) if r[7] else None for r in rows] == [
        {"duration": 0.25},
        {"time": "milliseconds"},
        {"time": "of the line before"},
        None,
        {"time": "of the line before"},
    ]
    assert [r.line for r in log.rejected(f"|a|3\n{TIME}|a|4\n")] == [1]


# Lines and bytes ----------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", ["prose", TIME, f"{TIME}|", f"{TIME}|a", f"{TIME}||v"])
def test_lines_without_item_and_value_are_rejected(log: Log, bad: str) -> None:
    rejected = log.rejected(f"{TIME}|a|1\n\n{bad}\n{TIME}|a|1\n")
    assert [r.line for r in rejected] == [3]


def test_a_pipe_too_many_at_the_end_is_none(log: Log) -> None:
    assert log.values("a|1|") == [("a", 1.0, None, None)]


def test_bom_nul_and_latin1(log: Log) -> None:
    data = b"\xef\xbb\xbf" + f"{TIME}|a|1\n".encode()
    data += b"\0\0" + f"{TIME}|a|2\n{TIME}|a|1\0 2\n".encode() + b"\0\0\0\n"
    data += f"{TIME}|note|".encode() + b"K\xfchlmittel\n" + f"{TIME}|note|Öl\n".encode()
    rows = log.rows(data)
    assert [(r[2], r[3]) for r in rows] == [
        (1, None),
        (2, None),
        (None, "Kühlmittel"),
        (None, "Öl"),
    ]
    assert said(rows[1]) == {"nulBytes": 2} and said(rows[2]) == {"encoding": "latin-1"}
    assert [r.line for r in log.rejected(data)] == [3, 4]


def test_utf16(log: Log) -> None:
    assert log.rows(f"{TIME}|note|Öl\r\n".encode("utf-16"))[0][3] == "Öl"


def test_long_lines(log: Log) -> None:
    text = "x" * 2_000_000
    assert log.values(f"a|{text}")[0][2] == text
    data = f"{TIME}|a|1\n{TIME}|a|{'y' * (3 * LONGEST)}\n{TIME}|a|{'y' * LONGEST}\n{TIME}|a|2\n"
    assert [r[2] for r in log.rows(data)] == [1.0, 2.0]
    assert [(r.line, len(r.excerpt)) for r in log.rejected(data)] == [(2, 200), (3, 200)]


def test_gzip_whole_and_cut(log: Log) -> None:
    data = "".join(f"{TIME}|a|{i / 7}\n" for i in range(20_000)).encode()
    packed = gzip.compress(data[:1000]) + gzip.compress(data[1000:])
    whole = log.rows(packed)
    assert [r[2] for r in whole] == [i / 7 for i in range(20_000)]
    cut = packed[: len(packed) // 2]
    some = log.rows(cut)
    (rejection,) = log.rejected(cut)
    assert some == whole[: len(some)] and 5000 < len(some) < 20_000
    assert rejection.line == len(some) + 1 and "cut off" in rejection.reason
    broken = bytearray(packed)
    broken[len(packed) // 2] ^= 0xFF
    assert "damaged" in log.rejected(bytes(broken))[-1].reason


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "holds no record"),
        (b"\n\r\n  \n", "holds no record"),
        (b"int main(void) {\n  return a | b;\n}\n", "has the form of a log"),
        (b"| a | table |\n| in | prose |\n", "has the form of a log"),
        (bytes(range(256)) * 50, "has the form of a log"),
        (b"\x1f\x8b" + b"\x00" * 40, "has the form of a log"),
        (b"a\n" * 20_000, "has the form of a log"),
    ],
    ids=["empty", "blank", "code", "table", "noise", "gzip", "long"],
)
def test_what_is_no_log_is_unreadable(
    log: Log, data: bytes, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.signals.shdr.log.PATIENCE", 10_000)
    with pytest.raises(UnreadableFile, match=reason):
        log.batches(data)
