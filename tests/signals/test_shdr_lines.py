"""Times, lines and bytes of a log: what is read, what is rejected, what is no log."""

import gzip
from datetime import UTC, datetime
from pathlib import Path

import pytest
from shdr_log import NS, SOURCE, TIME, Log, rows_of, said

from pipeline.signals.records import UnreadableFile
from pipeline.signals.shdr.fields import iso_ns
from pipeline.signals.shdr.log import read, read_fast, read_plain
from pipeline.signals.shdr.source import LONGEST


@pytest.fixture(params=[read_plain, read_fast], ids=["plain", "fast"])
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Log:
    return Log(request.param, tmp_path)


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


def test_nanoseconds_are_kept_and_further_digits_cut(log: Log) -> None:
    rows = log.rows("2019-05-20T10:46:17.1234567899Z|a|1\n")
    assert rows[0][0] == NS + 789


@pytest.mark.parametrize(
    "text",
    [
        "2019-02-29T00:00:00Z",
        "2019-13-01T00:00:00Z",
        "2019-05-20T24:00:00Z",
        "1677-12-31T00:00:00Z",
        "2262-01-01T00:00:00Z",
        "2019-05-20T10:46:17.Z",
        "2019-05-20T10:46:17X",
        "20190520T104617Z",
    ],
)
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


def test_the_first_line_needs_a_time(log: Log) -> None:
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
        (b"a\n" * 300_000, "has the form of a log"),
    ],
    ids=["empty", "blank", "code", "table", "noise", "gzip", "long"],
)
def test_what_is_no_log_is_unreadable(log: Log, data: bytes, reason: str) -> None:
    with pytest.raises(UnreadableFile, match=reason):
        log.batches(data)


def test_read_is_one_of_the_two(tmp_path: Path) -> None:
    for size in (10, 20_000):
        path = tmp_path / f"{size}.txt"
        path.write_text("".join(f"{TIME}|a{i % 7}|{i}|b|W{i % 5}\n" for i in range(size)))
        assert rows_of(list(read(path, SOURCE, tmp_path))) == rows_of(
            list(read_plain(path, SOURCE, tmp_path))
        )
