"""MATLAB, HDF5, TDMS and WAV: files written by their own libraries, whole and damaged."""

import random
import struct
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import nptdms
import numpy as np
import pytest
import scipy.io
from recorder_tables import layout, notes, values

from pipeline.signals.formats import (
    ColumnSource,
    RecordSource,
    TableLayout,
    Trace,
    UnreadableFile,
    format_of,
)
from pipeline.signals.tables import arrays, columnar
from pipeline.signals.units import conversion

T = np.arange(50) / 1000
F = np.arange(50) * 0.5


def source(columns: dict[str, tuple[str, str | None]], **options: Any) -> RecordSource:
    options = {"time": "t"} | options
    return RecordSource(format="hdf5", files="*", table=layout(columns, **options))


FORCE = source({"force_x": ("F", "N")})


def check(result: Trace) -> None:
    assert (result.kept, result.rejected) == (50, [])
    assert values(result, "t") == T.tolist()
    assert values(result, "force_x") == F.tolist()


def write_mat(path: Path) -> None:
    scipy.io.savemat(path, {"t": T[:, None], "F": F[None, :], "gain": 35.0, "note": "abc"})


def write_h5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["t"] = T
        file["F"] = F
        file["F"].attrs["unit"] = "N"


def write_tdms(path: Path) -> None:
    channels = [nptdms.ChannelObject("g", n, v) for n, v in (("t", T), ("F", F))]
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment(channels)


@dataclass(frozen=True)
class Written:
    """A whole file of t and F, its reader and its layout."""

    read: Callable[[Path, RecordSource, Path], Trace]
    path: Path
    form: RecordSource


@pytest.fixture(params=["mat", "h5", "tdms"])
def written(request: pytest.FixtureRequest, tmp_path: Path) -> Written:
    write, read, form = {
        "mat": (write_mat, arrays.read_mat, FORCE), "h5": (write_h5, arrays.read_hdf5, FORCE),
        "tdms": (write_tdms, columnar.read_tdms, source({"force_x": ("F", "N")}, group="g")),
    }[request.param]  # fmt: skip
    write(tmp_path / "x")
    return Written(read, tmp_path / "x", form)


def test_a_file_is_read_whole_and_a_missing_channel_named(written: Written) -> None:
    check(written.read(written.path, written.form, written.path.parent))
    assert written.form.table is not None
    other = source({"force_x": ("f", "N")}, group=written.form.table.group)
    with pytest.raises(UnreadableFile, match="'f' missing; the file has 'F'"):
        written.read(written.path, other, written.path.parent)


def test_damage_is_never_another_exception(written: Written) -> None:
    """Cut anywhere, bytes overwritten anywhere: a whole trace or an unreadable file."""
    whole = written.path.read_bytes()
    chance = random.Random(7)
    damaged = [whole[: chance.randrange(len(whole))] for _ in range(30)]
    for _ in range(60):
        noisy = bytearray(whole)
        for _ in range(chance.choice((1, 4, 40))):
            noisy[chance.randrange(len(noisy))] = chance.randrange(256)
        damaged.append(bytes(noisy))
    damaged += [b"", b"\0" * 600, chance.randbytes(2000), b"t,F\n0,1\n"]
    refused = 0
    for data in damaged:
        written.path.write_bytes(data)
        try:
            written.read(written.path, written.form, written.path.parent)
        except UnreadableFile as error:
            refused += 1
            assert str(error)
    assert refused > 15


def test_constants_of_a_mat_file_are_noted(tmp_path: Path) -> None:
    write_mat(tmp_path / "x.mat")
    found = arrays.read_mat(tmp_path / "x.mat", FORCE, tmp_path)
    assert notes(found)["constants"] == {"gain": 35.0}


def test_mat_struct_matrix_and_cells(tmp_path: Path) -> None:
    words = np.array(["a", "b"] * 25, dtype=object)
    run = {"axes": {"t": T, "M": np.stack([F, 2 * F], axis=1), "state": words}}
    scipy.io.savemat(tmp_path / "x.mat", {"run": run})
    form = source(
        {"force_x": ("M[0]", "N"), "force_y": ("M[1]", "N"), "state": ("state", None)},
        group="run.axes",
        text=("state",),
    )
    result = arrays.read_mat(tmp_path / "x.mat", form, tmp_path)
    check(result)
    assert result.table.column("force_y").to_pylist() == (2 * F).tolist()
    assert result.table.column("state").to_pylist() == ["a", "b"] * 25


def test_mat_73_is_read_with_its_512_bytes_of_header(tmp_path: Path) -> None:
    path = tmp_path / "x.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["run/t"] = T[None, :]
        file["run/F"] = F[:, None]
        file["#refs#/a"] = T
    with path.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(128))
    check(arrays.read_mat(path, source({"force_x": ("F", "N")}, group="run"), tmp_path))


def test_hdf5_compound_and_own_units(tmp_path: Path) -> None:
    rows = np.zeros(50, dtype=[("t", "f8"), ("F", "f4"), ("tag", "S4")])
    rows["t"], rows["F"], rows["tag"] = T, F, b"mill"
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["log/rows"] = rows
        file["kilo"] = F
        file["kilo"].attrs["unit"] = "kN"
        file["t"] = T
    form = source({"force_x": ("F", "N"), "tag": ("tag", None)}, group="log/rows", text=("tag",))
    result = arrays.read_hdf5(tmp_path / "x.h5", form, tmp_path)
    check(result)
    assert set(result.table.column("tag").to_pylist()) == {"mill"}
    kilo = arrays.read_hdf5(tmp_path / "x.h5", source({"force_x": ("kilo", None)}), tmp_path)
    assert kilo.table.column("force_x").to_pylist() == (F * 1000).tolist()


def test_channels_of_two_rates_are_refused(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["t"], file["F"] = T, F[:40]
    with pytest.raises(UnreadableFile, match="'t' has 50 samples and 'F' has 40"):
        arrays.read_hdf5(tmp_path / "x.h5", FORCE, tmp_path)


def test_tdms_states_its_own_rate_start_and_unit(tmp_path: Path) -> None:
    facts = {
        "wf_increment": 0.0001,
        "wf_start_time": np.datetime64("2024-05-17T08:00:00.000001"),
        "wf_start_offset": 0.0,
        "unit_string": "kN",
    }
    with nptdms.TdmsWriter(tmp_path / "x.tdms") as writer:
        writer.write_segment([nptdms.ChannelObject("g", "F", F, properties=facts)])
    form = source({"force_x": ("F", None)}, group="g", time=None)
    result = columnar.read_tdms(tmp_path / "x.tdms", form, tmp_path)
    time = result.table.column("time").cast("int64").to_pylist()
    assert time[:2] == [1_715_932_800_000_001_000, 1_715_932_800_000_101_000]
    assert values(result, "force_x") == (F * 1000).tolist()


def test_a_cut_tdms_file_says_so(tmp_path: Path) -> None:
    path = tmp_path / "x.tdms"
    form = source({"force_x": ("F", "N")}, group="g", rate=1000.0, time=None)
    with nptdms.TdmsWriter(path) as writer:
        writer.write_segment([nptdms.ChannelObject("g", "F", F)])
    path.write_bytes(path.read_bytes()[:-80])  # ten samples of eight bytes
    result = columnar.read_tdms(path, form, tmp_path)
    assert values(result, "force_x") == F[:40].tolist()
    assert [rejection.line for rejection in result.rejected] == [41]


def test_without_nptdms_the_remedy_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_tdms(tmp_path / "x.tdms")
    monkeypatch.setitem(sys.modules, "nptdms", None)  # what an import finds when it is missing
    with pytest.raises(UnreadableFile, match=r"pip install -e '\.\[tdms\]'"):
        columnar.read_tdms(tmp_path / "x.tdms", FORCE, tmp_path)


WAV_RATE = 25_600
SHARES = np.round(np.linspace(-1, 127 / 128, 256) * 128) / 128
"""Shares of full scale that counts of any width hold exactly [1]."""


def wav_bytes(bits: int, *columns: np.ndarray, kind: int = 1) -> bytes:
    """A WAV file of ``kind`` 1 (counts) or 3 (floats), its header by hand."""
    table = np.column_stack(columns)
    if kind == 3:
        data = table.astype(f"<f{bits // 8}").tobytes()
    else:
        counts = np.round(table * 2.0 ** (bits - 1)).astype("<i8")
        data = counts.view(np.uint8).reshape(*table.shape, 8)[:, :, : bits // 8].tobytes()
    frame = table.shape[1] * bits // 8
    form = struct.pack(
        "<IHHIIHH", 16, kind, table.shape[1], WAV_RATE, WAV_RATE * frame, frame, bits
    )
    chunks = b"fmt " + form + b"bext" + struct.pack("<I", 3) + b"abc\0"  # a chunk of odd length
    chunks += b"data" + struct.pack("<I", len(data)) + data
    return b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WAVE" + chunks


def wav_source(**columns: Any) -> RecordSource:
    found = {name: ColumnSource(**one) for name, one in columns.items()}
    return RecordSource(format="wav", files="*.wav", table=TableLayout(columns=found))


G_50 = {"column": "#2", "unit": "g_0", "full_scale": -50.0}


@pytest.mark.parametrize(("bits", "kind"), [(16, 1), (24, 1), (32, 1), (32, 3), (64, 3)])
def test_wav_counts_are_shares_of_full_scale(tmp_path: Path, bits: int, kind: int) -> None:
    path = tmp_path / "x.wav"
    path.write_bytes(wav_bytes(bits, SHARES, SHARES[::-1], kind=kind))
    assert format_of(path) == "wav"
    form = wav_source(share={"column": "#1", "unit": ""}, head_acceleration=G_50)
    result = columnar.read_wav(path, form, tmp_path)
    table = result.table
    assert table["t"].to_numpy() == pytest.approx(np.arange(len(SHARES)) / WAV_RATE)
    assert table["share"].to_pylist() == SHARES.tolist()
    unit = table.schema.field("head_acceleration").metadata[b"unit"].decode()
    one_g = conversion("g_0", unit)[0]
    assert table["head_acceleration"].to_numpy() == pytest.approx(-50 * one_g * SHARES[::-1])


def test_a_wav_that_is_cut_compressed_or_without_a_scale_is_refused(tmp_path: Path) -> None:
    path, whole = tmp_path / "x.wav", wav_bytes(16, SHARES, SHARES)
    form = wav_source(force_x={"column": "#1", "unit": "N", "full_scale": 100.0})
    path.write_bytes(whole)
    assert columnar.read_wav(path, form, tmp_path).kept == len(SHARES)
    for cut in (0, 3, 11, 20, 40, len(whole) - 1, len(whole) - 101, len(whole) - 1024):
        path.write_bytes(whole[:cut])
        with pytest.raises(UnreadableFile, match="no whole WAV file"):
            columnar.read_wav(path, form, tmp_path)
    path.write_bytes(wav_bytes(16, SHARES, kind=2))
    with pytest.raises(UnreadableFile, match="ADPCM"):
        columnar.read_wav(path, form, tmp_path)
    path.write_bytes(whole)
    with pytest.raises(UnreadableFile, match="'#1' holds counts: give full_scale"):
        columnar.read_wav(path, wav_source(force_x={"column": "#1", "unit": "N"}), tmp_path)
    with pytest.raises(UnreadableFile, match="'#3' missing; the file has '#1', '#2'"):
        columnar.read_wav(path, wav_source(x={"column": "#3", "unit": ""}), tmp_path)
    with pytest.raises(ValueError, match="full_scale of 'force_x' is of a WAV"):
        columnar.read_wav(path, replace(form, format="tdms"), tmp_path)


@pytest.mark.parametrize("packed", [False, True])
def test_mat5_reads_what_scipy_reads(tmp_path: Path, packed: bool) -> None:
    """SciPy's reader is the oracle on whole files."""
    kinds = ("f8", "f4", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
    saved: dict[str, Any] = {f"v_{kind}": np.arange(6, dtype=kind).reshape(2, 3) for kind in kinds}
    saved |= {"z": np.array([1 + 2j, 3]), "word": "Spindel 20 °C", "empty": np.zeros((0, 3))}
    saved["cube"] = np.arange(24.0).reshape(2, 3, 4)
    path = tmp_path / "x.mat"
    scipy.io.savemat(path, saved, do_compression=packed)
    found = dict(arrays.level_5_arrays(path.read_bytes()))
    expected = scipy.io.loadmat(path)
    assert set(found) == set(saved)
    for name in saved:
        assert np.array_equal(found[name], expected[name]), name
        assert found[name].dtype.kind == expected[name].dtype.kind


def test_mat_level_4(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "x.mat", {"t": T, "F": F}, format="4")
    check(arrays.read_mat(tmp_path / "x.mat", FORCE, tmp_path))
