"""Text tables: every dialect that loggers and spreadsheets write, and every way they break."""

import csv
import gzip
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorder_tables import notes, values

from pipeline.signals.formats import ColumnSource, RecordSource, TableLayout, Trace, UnreadableFile
from pipeline.signals.tables.csv_table import Lines, dialect_of, read, rows_by_arrow, rows_by_record

FORCES = {"force_x": ColumnSource(column="Fx", unit="N")}


def trace(folder: Path, data: bytes | str, **layout: Any) -> Trace:
    path = folder / "table.csv"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    layout.setdefault("columns", FORCES)
    if "rate" not in layout:
        layout.setdefault("time", "t")
    source = RecordSource(format="csv", files="*.csv", table=TableLayout(**layout))
    return read(path, source, folder)


def lines_of(result: Trace) -> list[int | None]:
    return [rejection.line for rejection in result.rejected]


@pytest.mark.parametrize(
    ("text", "layout"),
    [
        ("t,Fx\n0,1.5\n1,2\n", {}),
        ("t,Fx\n0,1.5\n1,2", {}),
        ("t,Fx\r\n0,1.5\r\n1,2\r\n", {}),
        ("t,Fx\r0,1.5\r1,2\r", {}),
        ("\ufefft,Fx\n0,1.5\n1,2\n", {}),
        ("t;Fx\n0;1,5\n1;2\n", {"decimal": ","}),
        ("t\tFx\n0\t1.5\n1\t2\n", {}),
        ("t|Fx\n0|1.5\n1|2\n", {}),
        ('"t","Fx"\n"0","1.5"\n"1","2"\n', {}),
        ("t , Fx\n 0 , +1.5\n 1, 2e0 \n", {}),
        ("t,Fx,\n0,1.5,\n1,2,\n", {}),
        ("t,Fx\n0,1.5,\n1,2,\n", {}),
        ("t,Fx,\n0,1.5\n1,2\n", {}),
        ("Recorder 7\nrate: 10\n\n;;\nt,Fx\n0,1.5\n1,2\n", {}),
        ("t,Fx\n\n0,1.5\n\n\n1,2\n\n", {}),
        ("0,1.5\n1,2\n", {"names": ("t", "Fx")}),
        ("junk\n0,1.5\n1,2\n", {"names": ("t", "Fx"), "header": 1}),
        ("old,names\nt,Fx\n0,1.5\n1,2\n", {"header": 1}),
        ("t,Fx\ns,N\n0,1.5\n1,2\n", {"units_row": True}),
        ('t,Fx,note\n0,1.5,"two\nlines"\n1,2,"a ""quote"""\n', {}),
    ],
)
def test_one_table_in_many_forms(tmp_path: Path, text: str, layout: dict[str, Any]) -> None:
    result = trace(tmp_path, text, **layout)
    assert values(result, "t") == [0.0, 1.0]
    assert values(result, "force_x") == [1.5, 2.0]
    assert result.rejected == []


@pytest.mark.parametrize("encoding", ["latin-1", "cp1252", "utf-8", "utf-16-le", "shift-jis"])
def test_encodings(tmp_path: Path, encoding: str) -> None:
    name = "力" if encoding == "shift-jis" else "T °C"
    text = f"t,{name}\n0,20.5\n".encode(encoding)
    if encoding == "utf-16-le":
        text = b"\xff\xfe" + text
    source = {"spindle_temperature": ColumnSource(column=name, unit="degC")}
    result = trace(tmp_path, text, columns=source, encoding=encoding)
    assert values(result, "spindle_temperature") == [20.5]


def test_wrong_encoding_names_byte_and_line(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile, match=r"0xb0 at line 2 is not utf-8.*'latin-1'"):
        trace(tmp_path, b"x\nt,Fx,T \xb0C\n0,1,2\n")


def test_gzip(tmp_path: Path) -> None:
    packed = gzip.compress(b"t,Fx\n0,1\n") + gzip.compress(b"1,2\n")
    assert values(trace(tmp_path, packed), "force_x") == [1.0, 2.0]
    for spoilt, reason in ((packed[:-9], "cut off"), (packed + b"more", "damaged")):
        result = trace(tmp_path, spoilt)
        assert values(result, "force_x") == [1.0, 2.0][: result.kept] and result.kept > 0
        assert lines_of(result) == [result.kept + 2] and reason in result.rejected[0].reason
    wide = gzip.compress("t,Fx\n0,1\n1,2\n2,3\n".encode("utf-16"))
    result = trace(tmp_path, wide[:-9])
    assert values(result, "force_x") == [1.0, 2.0, 3.0][: result.kept] and result.kept > 0
    with pytest.raises(UnreadableFile, match="damaged"):
        trace(tmp_path, packed[:12] + b"\xff\xff\xff" + packed[15:])


def test_bad_rows_are_rejected_with_the_files_own_line(tmp_path: Path) -> None:
    text = "header\n\nt,Fx\n0,1\n1,x7\n\n2,3,4\n3\nnow,5\n,6\n6,inf\n7,\n8,NaN\n9,UNAVAILABLE\n"
    result = trace(tmp_path, text)
    assert values(result, "t") == [0.0, 7.0, 8.0, 9.0]
    assert values(result, "force_x") == [1.0, None, None, None]
    assert lines_of(result) == [5, 7, 8, 9, 10, 11]
    reasons = [rejection.reason for rejection in result.rejected]
    assert "'Fx' holds 'x7'" in reasons[0]
    assert "3 cells" in reasons[1] and "2 columns" in reasons[1]
    assert "'t' holds 'now'" in reasons[3]
    assert "'t' holds nothing" in reasons[4]
    assert result.rejected[0].excerpt == "1,x7"


def test_lines_after_a_quoted_line_end_keep_their_number(tmp_path: Path) -> None:
    result = trace(tmp_path, 't,Fx,n\n0,1,"a\nb\nc"\n1,?,d\n2,2,e\n')
    assert lines_of(result) == [5]
    assert values(result, "t") == [0.0, 2.0]


def test_a_stray_quote_costs_one_row(tmp_path: Path) -> None:
    rows = "".join(f"{k},{k},ok\n" for k in range(2, 200))
    result = trace(tmp_path, 't,Fx,n\n0,0,"open\n1,1,a 5" tool\n' + rows)
    assert lines_of(result) == [2]
    assert result.kept == 199


def test_short_rows_are_filled_on_request(tmp_path: Path) -> None:
    result = trace(tmp_path, "t,a,Fx\n0,1,2\n1,1\n2,1,4,9\n", ragged="fill")
    assert values(result, "force_x") == [2.0, None]
    assert lines_of(result) == [4]


def test_a_number_cut_off_at_the_end_is_no_value(tmp_path: Path) -> None:
    result = trace(tmp_path, "t,Fx\n0,1.250\n1,2.125\n2,3.1")
    assert values(result, "force_x") == [1.25, 2.125]
    assert lines_of(result) == [4]
    whole = trace(tmp_path, "t,Fx\n0,1.250\n1,2.125\n2,3.125")
    assert values(whole, "force_x") == [1.25, 2.125, 3.125]
    assert notes(whole)["last_line_without_end"] == 4


def test_repeated_names_are_told_apart(tmp_path: Path) -> None:
    text = "t,Fx,Fx,\n0,1,2,3\n"
    with pytest.raises(UnreadableFile, match=r"'Fx' missing.*'Fx#1', 'Fx#2'"):
        trace(tmp_path, text)
    for place, value in (("Fx#1", 1.0), ("Fx#2", 2.0), ("#4", 3.0)):
        columns = {"force_x": ColumnSource(column=place, unit="N")}
        assert values(trace(tmp_path, text, columns=columns), "force_x") == [value]


def test_thousands_of_columns(tmp_path: Path) -> None:
    names = ",".join(f"c{k}" for k in range(5000))
    row = ",".join(str(k / 8) for k in range(5000))
    columns = {"force_x": ColumnSource(column="c4999", unit="kN")}
    result = trace(tmp_path, f"{names}\n{row}\n{row}\n", columns=columns, time="c8")
    assert values(result, "force_x") == [624875.0, 624875.0]
    assert result.table.num_columns == 2
    everything = trace(tmp_path, f"{names}\n{row}\n", columns=columns, time="c8", rest=True)
    assert everything.table.num_columns == 5000


def test_the_rest_is_kept_on_request(tmp_path: Path) -> None:
    text = "t,Fx,Acc,State,x_position\ns,N,g_0,,mm\n0,1,2,Prep,7\n1,2,,End,8\n"
    result = trace(tmp_path, text, rest=True, units_row=True)
    assert result.table.schema.names == ["t", "force_x", "Acc", "State", "raw_x_position"]
    assert values(result, "Acc") == [2 * 9806.65, None]
    assert result.table.schema.field("Acc").metadata[b"unit"] == b"MILLIMETER/SECOND^2"
    assert values(result, "State") == ["Prep", "End"]
    left = notes(trace(tmp_path, text, units_row=True))["columns_left_out"]
    assert left == ["Acc", "State", "x_position"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        (bytes(range(128)) * 20, "binary"),
        (b"\x89HDF\r\n\x1a\n\x00\x00", "not utf-8"),
        (b"t,fx [N]\n0,1\n", "'Fx' missing.*'fx .N.'"),
        (b"a,b\n0,1\n", "'t', 'Fx' missing"),
        (b"t,Fx\n0,a\n1,b\n", "no row of 2.*line 2.*holds 'a'"),
    ],
)
def test_unreadable_files_say_why(tmp_path: Path, text: bytes, message: str) -> None:
    with pytest.raises(UnreadableFile, match=message):
        trace(tmp_path, text)


@pytest.mark.parametrize(
    ("units", "message"),
    [
        ("ms,N", "'t' is in 'ms' by the file and in 's' by the layout"),
        ("s,kN", "'Fx' is in 'kN' by the file and in 'N' by the layout"),
    ],
)
def test_a_files_own_units_are_not_overruled(tmp_path: Path, units: str, message: str) -> None:
    with pytest.raises(UnreadableFile, match=message):
        trace(tmp_path, f"t,Fx\n{units}\n0,1\n", units_row=True)


cell = st.one_of(
    st.floats(allow_nan=False, allow_infinity=False, width=64).map(repr),
    st.integers(-(10**6), 10**6).map(str),
    st.sampled_from(["", "NaN", "x", "1e999", '5"', "-", " 7 "]),
)


@st.composite
def sheets(draw: st.DrawFn) -> list[list[str]]:
    width = draw(st.integers(2, 5))
    return draw(st.lists(st.lists(cell, min_size=width, max_size=width), min_size=1, max_size=20))


@settings(deadline=None, max_examples=50)
@given(rows=sheets(), delimiter=st.sampled_from(",;\t|"), crlf=st.booleans())
def test_what_the_csv_module_writes_is_read_back(
    tmp_path_factory: pytest.TempPathFactory,
    rows: list[list[str]],
    delimiter: str,
    crlf: bool,
) -> None:
    """An independent reading of each cell by Python's float tells what must be kept."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter=delimiter, lineterminator="\r\n" if crlf else "\n")
    names = ["time_s", "F_x", *(f"c{k}" for k in range(len(rows[0]) - 2))]
    writer.writerows([names, *rows])
    columns = {"force_x": ColumnSource(column="F_x", unit="N")}
    expected = [(_float(row[0]), _float(row[1])) for row in rows]
    kept = [(t, f) for t, f in expected if t not in ("bad", None) and f != "bad"]
    folder = tmp_path_factory.mktemp("sheet")
    data = text.getvalue().encode()
    if not kept:
        with pytest.raises(UnreadableFile):
            trace(folder, data, columns=columns, time="time_s")
        return
    result = trace(folder, data, columns=columns, time="time_s")
    assert values(result, "t") == [t for t, _ in kept]
    assert values(result, "force_x") == [f for _, f in kept]
    bad = [k + 2 for k, (t, f) in enumerate(expected) if t in ("bad", None) or f == "bad"]
    assert lines_of(result) == bad


def _float(text: str) -> float | str | None:
    if text.strip() in ("", "NaN", "-"):
        return None
    try:
        value = float(text)
    except ValueError:
        return "bad"
    return value if np.isfinite(value) else "bad"


@settings(deadline=None, max_examples=50)
@given(st.lists(st.lists(cell.filter(lambda c: '"' not in c), min_size=0, max_size=4), max_size=20))
def test_both_parsers_give_the_same_rows(rows: Sequence[Sequence[str]]) -> None:
    text = "a,b,c\n" + "".join(",".join(row) + "\n" for row in rows)
    lines = Lines(text.encode())
    layout = TableLayout(columns={}, time="a", names=(), rest=True, header=0)
    dialect = dialect_of(lines, layout)
    needed = list(dialect.names)
    if dialect.first >= len(lines) or not text[6:].strip("\n"):
        return
    fast = rows_by_arrow(lines, dialect, needed)
    slow = rows_by_record(lines, dialect, needed, fill=False)
    assert {n: c.to_pylist() for n, c in fast[0].items()} == {
        n: c.to_pylist() for n, c in slow[0].items()
    }
    assert fast[1].tolist() == slow[1].tolist()
    assert [r.line for r in fast[2]] == [r.line for r in slow[2]]


@settings(deadline=None, max_examples=100)
@given(
    st.one_of(
        st.binary(max_size=200),
        st.text(alphabet='tFx01,;.\n\r" e-\0é', max_size=80).map(
            lambda body: b"t,Fx\n" + body.encode()
        ),
    ),
    st.sampled_from(["utf-8", "latin-1"]),
)
def test_noise_is_unreadable_or_rejected(
    tmp_path_factory: pytest.TempPathFactory, data: bytes, encoding: str
) -> None:
    folder = tmp_path_factory.mktemp("noise")
    try:
        trace(folder, data, encoding=encoding)
    except UnreadableFile as error:
        assert str(error)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 400))
def test_a_file_cut_anywhere_keeps_only_what_was_written(
    tmp_path_factory: pytest.TempPathFactory, length: int
) -> None:
    """Times have fixed decimals, so that a cut number shows."""
    rows = [(k / 1000, k * 1.5) for k in range(30)]
    text = "t,Fx\n" + "".join(f"{t:.3f},{f:.2f}\n" for t, f in rows)
    folder = tmp_path_factory.mktemp("cut")
    try:
        result = trace(folder, text[:length])
    except UnreadableFile:
        assert length < len("t,Fx\n0.000,0.00\n")
        return
    complete = text[:length].count("\n") - 1
    if result.kept > 2:
        assert result.kept in (complete, complete + 1)
        assert values(result, "force_x") == [f for _, f in rows[: result.kept]]
