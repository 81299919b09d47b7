"""The fast path equals the plain one on whatever is thrown at them, and on real recordings."""

import math
import os
from pathlib import Path

import pyarrow as pa
import pytest
from hypothesis import strategies as st
from proof_sizes import few_and_many
from shdr_log import (
    DEVICES,
    NAMES,
    NATIVE,
    SOURCE,
    TIME,
    UNITS,
    line_by_line,
    outcome,
    rows_of,
    scanned,
)

from pipeline.signals.formats import RecordSource


def _as_python_reads_it(tmp_path: Path, text: str) -> None:
    path = tmp_path / "log.txt"
    path.write_text(f"{TIME}|a|{text}\n")
    (row,) = rows_of(list(scanned(path, SOURCE, tmp_path)))
    try:
        expected = float(text)
    except ValueError:
        expected = math.nan
    if math.isfinite(expected):
        assert repr(row[2]) == repr(expected)
    else:
        assert row[3] == text


test_numbers_equal_pythons_bit_for_bit, test_many_numbers_equal_pythons = few_and_many(
    _as_python_reads_it, 30, 300,
    text=st.one_of(
        st.floats(allow_nan=False, allow_infinity=False).map(repr),
        st.from_regex(r"[+-]?[0-9]{0,25}(\.[0-9]{0,25})?([eE][+-]?[0-9]{1,3})?", fullmatch=True),
    ),
)  # fmt: skip


_KEYS = st.sampled_from([
    "a", "b", "Xact", "s1", "odd", "pos", "wave", "servo", "msg", "alarm", "program", "line",
    "vars", "offsets", "changed", "mill:Xact", "@ASSET@", "@UPDATE_ASSET@", "@REMOVE_ASSET@", "",
    " a", "Ö", "7",
])  # fmt: skip
_VALUES = st.one_of(
    st.sampled_from([
        "1", "-2.5", "0012", "1e3", "1e400", "1e-310", "123456789.123456789012", "UNAVAILABLE",
        "NORMAL", "fault", "WARNING", "HIGH", "", " 3 ", "1 2 3", "1.0 2 3", "AUTO",
        "a=1 b={c d} e", "A={x=1 y=2}", '"q\\|r"', "p\\|q", "--multiline--AB", "3", "2", "Öl",
        "x" * 300, "1:DAY", "+7", "9007199254740993", "\t5", "NaN", "0e999", "-0",
    ]),
    st.text("0123456789.eE+-", max_size=24),
    st.text(max_size=8),
)  # fmt: skip
_TIMES = st.one_of(
    st.sampled_from([
        TIME, TIME, TIME, "2019-05-20T10:46:18+01:00", "2019-02-29T00:00:00Z", "", "15.5",
        f"{TIME}@3", f"{TIME}@x", "2019-05-20T10:46:17", " " + TIME, "\ufeff" + TIME,
    ]),
    st.text("0123456789-T:.Z", max_size=28),
)  # fmt: skip
_LINES = st.one_of(
    st.builds(
        lambda t, pairs, end: "|".join([t, *(f"{k}|{v}" for k, v in pairs)]) + end,
        _TIMES,
        st.lists(st.tuples(_KEYS, _VALUES), min_size=1, max_size=5),
        st.sampled_from(["\n", "\n", "\n", "\r\n", "|\n", "|z\n", " \n", "||||\n", ""]),
    ).map(str.encode),
    st.sampled_from([b"\n", b"* PONG 1\n", b"--multiline--AB\n", b"\r\n", b" \n", b"\0\n",
                     b"\xff\xfe\n"]),
    st.binary(max_size=20),
)  # fmt: skip


def _alike(
    tmp_path_factory: pytest.TempPathFactory, lines: list[bytes], source: RecordSource, chunk: int
) -> None:
    folder = tmp_path_factory.getbasetemp() / "alike"
    folder.mkdir(exist_ok=True)
    (folder / "Devices.xml").write_text(DEVICES)
    path = folder / "log.txt"
    path.write_bytes(f"{TIME}|a|1\n".encode() + b"".join(lines))
    plain = outcome(line_by_line, path, source, chunk)
    assert outcome(scanned, path, source, chunk) == plain
    assert outcome(line_by_line, path, source, 1 << 20) == plain


test_the_fast_path_equals_the_reference, test_both_paths_are_equal_on_many_logs = few_and_many(
    _alike, 40, 400,
    lines=st.lists(_LINES, max_size=12), source=st.sampled_from([SOURCE, UNITS, NATIVE]),
    chunk=st.integers(16, 300),
)  # fmt: skip


def _refused_alike(tmp_path_factory: pytest.TempPathFactory, data: bytes, packed: bool) -> None:
    path = tmp_path_factory.getbasetemp() / "bytes.txt"
    path.write_bytes(b"\x1f\x8b" + data if packed else data)
    assert outcome(scanned, path, SOURCE, 64) == outcome(line_by_line, path, SOURCE, 64)


test_any_bytes_are_read_or_refused_with_a_reason, test_many_bytes_are_refused = few_and_many(
    _refused_alike, 40, 300, data=st.binary(max_size=400), packed=st.booleans()
)


def _equal_with_many_words(path: Path, names: int) -> None:
    lines = [f"{TIME}|k{i}|v{i}\n" for i in range(names)]  # more than the scanner takes in
    path.write_text("".join(lines * 2))
    assert outcome(scanned, path, SOURCE, 1 << 20) == outcome(line_by_line, path, SOURCE, 1 << 20)


def test_many_names_and_many_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.signals.shdr.log.KEYS", 1 << 10)
    _equal_with_many_words(tmp_path / "log.txt", 1_100)


@pytest.mark.proof
def test_as_many_names_as_the_scanner_holds(tmp_path: Path) -> None:
    _equal_with_many_words(tmp_path / "log.txt", 70_000)


def _recordings() -> Path:
    folder = os.environ.get("KERF_RECORDINGS")
    if not folder:
        pytest.skip("KERF_RECORDINGS names no folder of real recordings")
    return Path(folder)


def _equal_days(paths: list[Path], root: Path) -> None:
    source = RecordSource(format="shdr", files="*", devices="Devices.xml", device="Mazak01")
    for path in paths:
        for batches in zip(
            scanned(path, source, root), line_by_line(path, source, root), strict=True
        ):
            fast, plain = batches
            assert fast.read == plain.read and fast.rejected == plain.rejected == []
            for name in NAMES:
                decoded = [b.observations[name].combine_chunks() for b in batches]
                words = [
                    d.dictionary_decode() if pa.types.is_dictionary(d.type) else d for d in decoded
                ]
                assert words[0].equals(words[1]), (path.name, name)


def test_recorded_days_begin_and_end_alike(tmp_path: Path) -> None:
    root = _recordings() / "nist_mazak01"
    for path in sorted(root.glob("week_*/*")):
        lines = path.read_bytes().splitlines(keepends=True)
        (tmp_path / path.name).write_bytes(b"".join([*lines[:800], *lines[-800:]]))
    _equal_days(sorted(tmp_path.iterdir()), root)


@pytest.mark.proof
def test_recorded_weeks_are_read_whole_and_alike() -> None:
    root = _recordings() / "nist_mazak01"
    _equal_days(sorted(root.glob("week_*/*")), root)


def _every_text_is_read_or_refused(compared: int) -> None:
    """Texts of up to ``compared`` bytes are read by both paths."""
    root = _recordings()
    logs = sorted(root.glob("nist_box/*/*")) + sorted(root.glob("mtconnect_docs/*.[tc][xs][tv]"))
    assert len(logs) > 60
    readable = set()
    for path in logs:
        found = outcome(scanned, path, SOURCE, 1 << 20)
        if path.stat().st_size <= compared:
            assert found == outcome(line_by_line, path, SOURCE, 1 << 20)
        if len(found) == 3:
            readable.add(path.name)
    # Exactly the logs are logs: not the programs, the lists of settings, the bits of XML.
    assert {n for n in readable if "Hurco" not in n} == {
        "cppagent-cuttingtool_scenario.txt",
        "cppagent-simple_scenario_1.txt",
        "mtconnecttoolbox-out.txt",
        "mtconnecttoolbox-telent_DMG.txt",
    }
    assert len([n for n in readable if "Hurco" in n]) == 15


def test_every_text_of_the_recordings_is_read_or_refused() -> None:
    _every_text_is_read_or_refused(20_000)


@pytest.mark.proof
def test_long_texts_of_the_recordings_are_read_alike() -> None:
    _every_text_is_read_or_refused(1 << 40)
