"""What is written is what is read again, whole; what breaks a contract of a table is named."""

from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.signals.columns import OBSERVATIONS, REJECTED
from pipeline.signals.contracts import TABLES, check, check_files
from pipeline.signals.formats import Batch, Rejection, UnreadableFile
from pipeline.signals.store import write_observations, write_rejected

Record = tuple[int, str, float | None, str | None, int, str | None, int | None]


def table(records: list[Record]) -> pa.Table:
    """Observations of (time, item, number, text, sequence, key, instance)."""
    columns_of = zip(*records, strict=True) if records else [()] * 7
    time, item, number, text, sequence, key, instance = (list(c) for c in columns_of)
    words = {"data_item": item, "text": text, "kind": ["EVENT"] * len(item), "key": key}
    columns = {k: pa.array(v, pa.string()).dictionary_encode() for k, v in words.items()}
    columns |= {
        "time": pa.array(time, pa.timestamp("ns", tz="UTC")),
        "number": pa.array(number, pa.float64()),
        "sequence": pa.array(sequence, pa.uint64()),
        "attributes": pa.nulls(len(item), pa.string()),
        "instance": pa.array(instance, pa.uint64()),
    }
    return pa.table({name: columns[name] for name in OBSERVATIONS.names}, schema=OBSERVATIONS)


def batch(records: list[Record], rejected: int = 0) -> Batch:
    refused = [Rejection(line=i + 1, reason="odd", excerpt="x") for i in range(rejected)]
    return Batch(observations=table(records), read=len(records) + rejected, rejected=refused)


def plain(t: pa.Table) -> list[Record]:
    names = ("data_item", "number", "text", "sequence", "key", "instance")
    columns = [t["time"].cast(pa.int64()), *(t[n] for n in names)]
    return list(zip(*(c.to_pylist() for c in columns), strict=True))


def number(time: int, item: str = "a", sequence: int = 1) -> Record:
    return (time, item, float(sequence), None, sequence, None, None)


def test_counts_times_and_schema(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "o.parquet"
    second = 1_558_349_177 * 10**9
    written = write_observations(
        [batch([number(second + 5)], 2), batch([]), batch([number(second - 1, "b")], 1)], path
    )
    assert (written.kept, len(written.rejected), written.rows) == (2, 3, 2)
    assert written.first == "2019-05-20T10:46:16.999999999Z"
    assert written.last == "2019-05-20T10:46:17.000000005Z"
    assert [r.line for r in written.rejected] == [1, 2, 1]
    file = pq.ParquetFile(path)
    assert file.schema_arrow.equals(OBSERVATIONS)
    assert file.metadata.row_group(0).column(0).compression == "ZSTD"
    assert [p.name for p in path.parent.iterdir()] == ["o.parquet"]


def test_a_file_without_rows_is_whole(tmp_path: Path) -> None:
    written = write_observations([batch([], 1)], tmp_path / "o.parquet")
    assert (written.rows, written.first, written.last) == (0, None, None)
    assert pq.read_table(tmp_path / "o.parquet").schema.equals(OBSERVATIONS)


def test_what_a_reader_raises_leaves_the_old_file_alone(tmp_path: Path) -> None:
    def breaking() -> Iterator[Batch]:
        yield batch([number(2)])
        raise UnreadableFile("it breaks off")

    path = tmp_path / "o.parquet"
    write_observations([batch([number(1)])], path)
    with pytest.raises(UnreadableFile, match="breaks off"):
        write_observations(breaking(), path)
    assert plain(pq.read_table(path)) == [number(1)]
    assert [p.name for p in tmp_path.iterdir()] == ["o.parquet"]


def test_small_batches_make_large_row_groups_with_their_own_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.signals.store.GROUP", 5000)
    n = 100
    batches = [batch([number(i * n + j, f"item {i}", j) for j in range(n)]) for i in range(70)]
    write_observations(batches, tmp_path / "o.parquet")
    groups = pq.ParquetFile(tmp_path / "o.parquet").metadata
    assert groups.num_row_groups == 2 and groups.row_group(0).num_rows == 5000
    kept = pq.read_table(tmp_path / "o.parquet")
    assert plain(kept.slice(69 * n)) == [number(69 * n + j, "item 69", j) for j in range(n)]


def test_rejected(tmp_path: Path) -> None:
    path = tmp_path / "rejected.parquet"
    whole = Rejection(line=None, reason="the file is empty")
    said = {"b.txt": [Rejection(line=7, reason="no time", excerpt="x|y"), whole], "a.txt": []}
    assert write_rejected(said, path) == 2
    kept = pq.read_table(path)
    assert kept.schema.equals(REJECTED)
    assert kept.to_pylist() == [
        {"file": "b.txt", "line": 7, "reason": "no time", "excerpt": "x|y"},
        {"file": "b.txt", "line": None, "reason": "the file is empty", "excerpt": ""},
    ]
    assert write_rejected({}, path) == 0


TIME = pd.date_range("2024-03-04", periods=3, freq="s", tz="UTC")


def state(**changes):
    good = {"time": TIME, "execution": ["READY", None, "ACTIVE"], "spindle_load": [1.0, None, 3.0]}
    return pd.DataFrame(good | changes)


def test_a_good_state_table_passes_and_comes_back():
    frame = state()
    assert check("state", frame) is frame


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (state(spindle_load=[1.0, 2.0, 900.0]), "'spindle_load', row 2: 900.0.*500 PERCENT"),
        (state(spindle_load=["a", "b", "c"]), "'spindle_load' is .* where numbers belong"),
        (state(execution=[1, 2, 3]), "'execution' is int64 where words belong"),
        (state(time=TIME[::-1]), "'time', row 1: 2024-03-04.* does not follow"),
        (state(time=TIME.tz_localize(None)), "'time' is .* where times with the plant's zone"),
        (state(speed=1.0), "'speed' is not of this table"),
        (state().drop(columns="time"), "'time' is missing"),
    ],
)
def test_what_breaks_the_state_is_told_in_one_sentence(frame, words):
    with pytest.raises(ValueError, match=f"^state: column {words}") as reported:
        check("state", frame)
    assert str(reported.value).endswith("clean the machine's signals again")
    assert "\n" not in str(reported.value)


def test_a_segment_that_ends_before_it_starts():
    frame = pd.DataFrame({"start": TIME[1:2], "end": TIME[:1], "kind": ["off"]})
    with pytest.raises(ValueError, match=r"segments: column 'end', row 0: 2024-03-04 00:00:00"):
        check("segments", frame)


def test_a_word_that_is_none_of_the_list():
    frame = pd.DataFrame({"start": TIME[:1], "end": TIME[1:2], "kind": ["lunch"]})
    with pytest.raises(ValueError, match=r"'kind', row 0: 'lunch' where one of off, warm_up"):
        check("segments", frame)


def test_an_unknown_table_names_the_known_ones():
    with pytest.raises(ValueError, match=f"'stat' has no contract; name one of {TABLES[0]}"):
        check("stat", state())


def test_files_that_break_a_contract_are_named(tmp_path):
    (tmp_path / "state").mkdir()
    broken = tmp_path / "state/2026-01-05.parquet"
    pd.DataFrame({"time": ["monday"], "spindle_speed": [1.0]}).to_parquet(broken)
    with pytest.raises(ValueError, match=r"2026-01-05\.parquet: state: column 'time'"):
        check_files(tmp_path, {"state": "state/*.parquet"})
