"""Records of a log are read as they say, by both paths."""

from pathlib import Path

import pytest
from shdr_log import NATIVE, NS, SOURCE, TIME, UNITS, Log, said

from pipeline.signals.shdr.fields import entries_of, fields_of
from pipeline.signals.shdr.log import read_fast, read_plain


@pytest.fixture(params=[read_plain, read_fast], ids=["plain", "fast"])
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
        ("a", None, None, None),
        ("a", None, None, None),
        ("b", None, None, None),
        ("c", None, "", None),
        ("d", None, "", None),
        ("e", 1.0, None, None),
    ]


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
        ("note", None, "z", "x|y"),
        ("a", None, "x|y", None),
        ("b", None, "u|v", None),
        ("c", 1.0, None, None),
        ("d", None, "C:\\p", None),
    ]


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
        ("vars", 1.0, None, "a"),
        ("vars", None, "x y", "b"),
        ("vars", None, None, "c"),
        ("vars", None, None, "d"),
        ("vars", None, "q r", "e"),
    ]
    assert log.values("offsets|G54={X=1 Y=2} G55", UNITS) == [
        ("offsets", 1.0, None, "G54/X"),
        ("offsets", 2.0, None, "G54/Y"),
        ("offsets", None, None, "G55"),
    ]
    rows = log.rows(f"{TIME}|vars|:MANUAL a=1\n", UNITS)
    assert said(rows[0]) == {"resetTriggered": "MANUAL"}
    assert "not closed" in log.rejected(f"{TIME}|vars|a={{1\n{TIME}|line|1\n", UNITS)[0].reason


def test_data_set_needs_keys() -> None:
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
        ]  # fmt: skip
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
