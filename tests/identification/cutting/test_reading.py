"""Recordings of a dynamometer from the Parquet of a folder; what cannot be used says why."""

import json
import re

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.identification.cutting.conditions import Said
from pipeline.identification.cutting.known import CuttingKnown, Dynamometer
from pipeline.identification.cutting.records import CuttingRecords, read_recordings
from tests.identification.cutting.milling import Truth
from tests.identification.cutting.recorded import RATE, SETTINGS, clean, known_of

TRUTH = Truth(flutes=2, runout=0.003, runout_angle=0.0)
TEST = (6000.0, 0.08, 2.0, 0.0, np.pi)
RECORDS = CuttingRecords(
    recordings="*.csv", training=("slot*",),
    conditions=Said(speed_rpm=6000, feed_per_tooth_mm=0.08, axial_depth_mm=2, immersion="slot"),
)  # fmt: skip


def cut(seed=0):
    force = clean(TRUTH, TEST, 0.3)
    return force + np.random.default_rng(seed).normal(0, 1.5, force.shape)


def write(folder, files, unit="NEWTON", names="xyz", time=None):
    (folder / "traces").mkdir(exist_ok=True)
    entries = {}
    for name, values in files.items():
        t = np.arange(len(values)) / RATE if time is None else time
        fields = [pa.field("t", pa.float64(), metadata={"unit": "SECOND"})]
        fields += [pa.field(f"force_{n}", pa.float64(), metadata={"unit": unit}) for n in names]
        arrays = [t, *[values[:, k] for k in range(len(names))]]
        pq.write_table(
            pa.table(arrays, schema=pa.schema(fields)), folder / f"traces/{name}.parquet"
        )
        digest = str(hash(values.tobytes()))
        entries[name] = {"output": f"traces/{name}.parquet", "sha256": digest, "reason": None}
    (folder / "manifest.json").write_text(json.dumps({"files": entries}))


def read(folder, records=RECORDS, known=None):
    return read_recordings(folder, records, known or known_of(TRUTH), SETTINGS)


def test_roles_and_copies(tmp_path):
    write(tmp_path, {"a.csv": cut(), "slot.csv": cut(1), "slot-copy.csv": cut(1), "z.csv": cut(1)})
    found = {one.name: one for one in read(tmp_path)}
    assert {name: one.role for name, one in found.items()} == {
        "a.csv": "judged", "slot-copy.csv": "training", "slot.csv": "left out", "z.csv": "left out",
    }  # fmt: skip
    assert found["z.csv"].reason == "it is a copy of slot-copy.csv: record another"


def test_directions_and_signs_are_those_of_the_file(tmp_path):
    """The same cut on a dynamometer that is turned, and under the workpiece."""
    write(tmp_path, {"slot.csv": cut()})
    straight = read(tmp_path)[0].cut[1].lines
    write(tmp_path, {"slot.csv": cut()[:, [1, 0, 2]] * [1, -1, -1]})
    other = Dynamometer(feed="-y", normal="x", axial="-z")
    turned = read(tmp_path, known=CuttingKnown(tool=known_of(TRUTH).tool, dynamometer=other))
    assert turned[0].cut[1].lines == pytest.approx(straight)


def test_kilonewtons_are_newtons(tmp_path):
    write(tmp_path, {"slot.csv": cut()})
    newton = read(tmp_path)[0].cut[1].lines
    write(tmp_path, {"slot.csv": cut() / 1e3}, unit="KILONEWTON")
    assert read(tmp_path)[0].cut[1].lines == pytest.approx(newton)


def lost(force):
    force[:, 1] *= 0.004
    return force


def clipped(force):
    return np.clip(force, -120.0, 120.0)


def holed(force):
    force[1000:1010] = np.nan
    return force


def drifting(force):
    return force + np.linspace(0, 60, len(force))[:, None]


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lost, "channel y shows next to nothing"),
        (clipped, r"channel [xy] stands at -?120 N for \d+ samples"),
        (holed, "10 of its rows lack a force"),
        (drifting, "drifts by"),
        (lambda force: force[:300], "6 are the least"),
        (lambda force: 0 * force, "there is no cut in it"),
        (lambda force: force[:0], "no row with all three forces"),
    ],
)
def test_what_cannot_be_used_is_left_out_with_its_reason(tmp_path, change, reason):
    write(tmp_path, {"slot.csv": change(cut())})
    found = read(tmp_path)[0]
    assert found.role == "left out"
    assert re.search(reason, found.reason), found.reason


def test_rows_without_a_value_at_the_end_are_cut_off(tmp_path):
    force = cut()
    force[-50:, 2] = np.nan
    write(tmp_path, {"slot.csv": force})
    found = read(tmp_path)[0]
    assert found.role == "training"
    assert found.notes == ("50 rows without a value at its ends left out",)


def test_a_missing_channel_unit_or_time_is_said(tmp_path):
    write(tmp_path, {"slot.csv": cut()}, names="xy")
    assert "no channel 'force_z'" in read(tmp_path)[0].reason
    write(tmp_path, {"slot.csv": cut()}, unit="AMPERE")
    assert "is in AMPERE" in read(tmp_path)[0].reason
    time = np.arange(4000) / RATE
    time[2000:] += 0.1
    write(tmp_path, {"slot.csv": cut()}, time=time)
    assert "its time" in read(tmp_path)[0].reason


def test_a_pattern_without_recordings_is_an_error(tmp_path):
    write(tmp_path, {"slot.csv": cut()})
    other = CuttingRecords(recordings="*.txt", training=("*",))
    with pytest.raises(ValueError, match=r"cutting_records\.recordings = '\*\.txt'"):
        read(tmp_path, other)
    (tmp_path / "manifest.json").unlink()
    with pytest.raises(ValueError, match="cannot be read: run `dvc repro`"):
        read(tmp_path)


@pytest.mark.parametrize("channels", [("x", "x", "z"), ("x", "y", "w"), ("--x", "y", "z")])
def test_a_dynamometer_has_three_channels(channels):
    with pytest.raises(ValueError, match="name x, y and z, each once"):
        Dynamometer(feed=channels[0], normal=channels[1], axial=channels[2])
