"""Dynamometer recordings: conditions, forces, why one is left out; and the cases made of them."""

import json
import re
from math import acos, pi

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.cutting.tool import Tool
from pipeline.schema.golden import FrozenSet, GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import SourceFile
from pipeline.submodels.cases import Records, Roles, role_of
from pipeline.submodels.cases import conditions_of as cases_conditions
from pipeline.submodels.contract import submodel
from pipeline.submodels.cutting.recordings import conditions_of, read_recordings
from pipeline.submodels.cutting.settings import (
    CuttingRecords,
    CuttingSetup,
    Dynamometer,
    StatedConditions,
)
from pipeline.submodels.cutting.spindle_load.identify import LoadLogFile
from pipeline.submodels.cutting.submodel import SUBMODEL, Fitting
from tests.submodels.cutting.recorded import RATE, SETTINGS, Truth, clean, known_of
from tests.submodels.cutting.spindle_load_logs import CUT_LOG, FREE_LOG, Bench, load_records

TOOL = Tool(kind="flat", diameter_mm=12.0, flutes=3)
NAME = (
    r"(?P<immersion>slot|up|down)-n(?P<speed_rpm>\d+)f(?P<feed_mm_min>\d+)"
    r"ap(?P<axial_depth_mm>[\d.]+)(?:ae(?P<radial_depth_mm>[\d.]+))?"
)


def conditions_by(
    name: str,
    said: StatedConditions = StatedConditions(),  # noqa: B008 - it is frozen
    **patterns: StatedConditions,
):
    records = CuttingRecords(recordings="*", name=NAME, by_pattern=patterns, conditions=said)
    return conditions_of(records.sources.of(name), TOOL)


def test_a_name_tells_all():
    found = conditions_by("down-n4000f600ap1.5ae6.csv")
    assert found.speed == pytest.approx(4000 / 60)
    assert found.f_z == pytest.approx(0.6 / (3 * 4000))  # 600 mm/min over teeth a minute
    assert found.a_p == pytest.approx(1.5e-3)
    assert (found.phi_st, found.phi_ex) == pytest.approx((pi - acos(0.0), pi))


def test_up_and_down_milling_lie_mirrored():
    up, down = conditions_by("up-n4000f600ap1ae3"), conditions_by("down-n4000f600ap1ae3")
    assert up.phi_st == 0.0
    assert up.phi_ex - up.phi_st == pytest.approx(down.phi_ex - down.phi_st)
    assert down.phi_ex == pytest.approx(pi)


def test_feed_by_tooth_and_by_minute_agree_or_are_refused():
    same = conditions_by("slot-n4000f600ap1", StatedConditions(feed_per_tooth_mm=0.05))
    assert same.f_z == pytest.approx(5e-5)
    with pytest.raises(ValueError, match=r"0\.05 mm for each tooth, its feed_per_tooth_mm 0\.06"):
        conditions_by("slot-n4000f600ap1", StatedConditions(feed_per_tooth_mm=0.06))


@pytest.mark.parametrize(
    ("name", "said", "message"),
    [
        ("run7.csv", StatedConditions(), "speed_rpm is not known"),
        ("slot-n0f600ap1", StatedConditions(), "speed_rpm = 0 must be finite and positive"),
        ("up-n4000f600ap1", StatedConditions(), "radial_depth_mm is not known"),
        (
            "up-n4000f600ap1ae13",
            StatedConditions(),
            "radial_depth_mm = 13 is more than the diameter",
        ),
        ("slot-n4000f600ap1ae6", StatedConditions(), "radial_depth_mm = 6 is not the diameter"),
        ("slot-n4000f600ap1", StatedConditions(speed_rpm=5000), "speed_rpm is 5000"),
        ("slot-n4000f600ap1.2.3", StatedConditions(), r"axial_depth_mm = '1\.2\.3'"),
        (
            "run7",
            StatedConditions(speed_rpm=100, axial_depth_mm=1, immersion="slot"),
            "its feed is not known",
        ),
        (
            "run7",
            StatedConditions(speed_rpm=100, axial_depth_mm=1, feed_mm_min=9),
            "immersion is not known",
        ),
        (
            "r",
            StatedConditions(speed_rpm=1, axial_depth_mm=1, entry_deg=90, exit_deg=20),
            "entry_deg = 90",
        ),
    ],
)
def test_what_is_missing_or_contradicts_is_one_sentence(name, said, message):
    with pytest.raises(ValueError, match=message):
        conditions_by(name, said)


def test_a_pattern_adds_to_a_name():
    found = conditions_by(
        "slot-n4000f600ap1",
        StatedConditions(),
        **{"slot-*": StatedConditions(radial_depth_mm=12.0)},
    )
    assert found.phi_ex == pytest.approx(pi)
    with pytest.raises(ValueError, match="by_pattern, 'slot"):
        conditions_by(
            "slot-n4000f600ap1",
            StatedConditions(),
            **{"slot-*": StatedConditions(axial_depth_mm=2.0)},
        )


@pytest.mark.parametrize("pattern", ["(?P<speed>", "(?P<revs>x)"])
def test_a_wrong_expression_is_named(pattern):
    with pytest.raises(ValueError, match=r"cutting_records\.name"):
        CuttingRecords(recordings="*", name=pattern).sources.of("x")


TRUTH = Truth(flutes=2, runout=0.003, runout_angle=0.0)
TEST = (6000.0, 0.08, 2.0, 0.0, np.pi)
RECORDS = CuttingRecords(
    recordings="*.csv",
    conditions=StatedConditions(
        speed_rpm=6000, feed_per_tooth_mm=0.08, axial_depth_mm=2, immersion="slot"
    ),
)


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
    return entries


def read(folder, records=RECORDS, known=None):
    """All recordings of a folder; those named slot are learnt from."""
    return read_recordings(
        folder, records, known or known_of(TRUTH), SETTINGS,
        lambda name: role_of([name], Roles(training=("slot*",))),
    )  # fmt: skip


def test_roles_and_copies(tmp_path):
    write(tmp_path, {"a.csv": cut(), "slot.csv": cut(1), "slot-copy.csv": cut(1), "z.csv": cut(1)})
    found = {one.name: one for one in read(tmp_path)}
    assert {name: one.role for name, one in found.items() if not one.reason} == {
        "a.csv": "held_out", "slot-copy.csv": "training",
    }  # fmt: skip
    assert found["z.csv"].reason == "it is a copy of slot-copy.csv: record another"


def test_directions_and_signs_are_those_of_the_file(tmp_path):
    """The same cut on a dynamometer that is turned, and under the workpiece."""
    write(tmp_path, {"slot.csv": cut()})
    straight = read(tmp_path)[0].cut[1].lines
    write(tmp_path, {"slot.csv": cut()[:, [1, 0, 2]] * [1, -1, -1]})
    other = Dynamometer(feed="-y", normal="x", axial="-z")
    turned = read(tmp_path, known=CuttingSetup(tool=known_of(TRUTH).tool, dynamometer=other))
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
        (lambda force: force[:0], "it has no rows: record it again"),
    ],
)
def test_what_cannot_be_used_is_left_out_with_its_reason(tmp_path, change, reason):
    write(tmp_path, {"slot.csv": change(cut())})
    found = read(tmp_path)[0]
    assert found.revolution is None
    assert re.search(reason, found.reason), found.reason


def test_rows_without_a_value_at_the_end_are_cut_off(tmp_path):
    force = cut()
    force[-50:, 2] = np.nan
    write(tmp_path, {"slot.csv": force})
    found = read(tmp_path)[0]
    assert found.is_training
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
    other = CuttingRecords(recordings="*.txt")
    with pytest.raises(ValueError, match=r"cutting_records\.recordings = '\*\.txt'"):
        read(tmp_path, other)
    (tmp_path / "manifest.json").unlink()
    with pytest.raises(ValueError, match=r"manifest\.json cannot be read: run `dvc repro`"):
        read(tmp_path)


@pytest.mark.parametrize("channels", [("x", "x", "z"), ("x", "y", "w"), ("--x", "y", "z")])
def test_a_dynamometer_has_three_channels(channels):
    with pytest.raises(ValueError, match="name x, y and z, each once"):
        Dynamometer(feed=channels[0], normal=channels[1], axial=channels[2])


FEEDS = (0.05, 0.08, 0.1, 0.12)
ROLES = Roles(training=("slot-600.csv", "slot-1200.csv", "cutting/*"))


def settings(**changes):
    values = {
        "identity": MachineIdentity(name="m", description="", origin="simulated"),
        "roles": ROLES,
        "cutting": known_of(TRUTH),
        "cutting_records": CuttingRecords(
            recordings="*.csv", name=r"slot-(?P<feed_mm_min>\d+)",
            conditions=StatedConditions(speed_rpm=6000, axial_depth_mm=2, immersion="slot"),
        ),
        "cutting_fit": SETTINGS,
        **changes,
    }  # fmt: skip
    return Fitting(**values)


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    """Four slots with their feed [mm/min] in the name, a copy, one without a feed, and logs."""
    folder = tmp_path_factory.mktemp("signals")
    slots = {}
    for f_z in FEEDS:
        feed = round(f_z * 2 * 6000)
        force = clean(TRUTH, (6000.0, f_z, 2.0, 0.0, np.pi), 0.3)
        noise = np.random.default_rng(feed).normal(0, 1.5, force.shape)
        slots[f"slot-{feed}.csv"] = force + noise
    entries = write(folder, slots)
    for name in slots:
        entries[name]["sha256"] = f"of {name}"
    entries["slot-copy-600.csv"] = entries["slot-600.csv"]
    entries["other.csv"] = {"output": "traces/other.parquet", "sha256": "o", "reason": None}
    for name in (FREE_LOG, CUT_LOG):
        entries[name] = {"output": "observations/x.parquet", "sha256": name, "reason": None}
    (folder / "manifest.json").write_text(json.dumps({"files": entries}))
    return Records(signals=folder, raw=folder)


def test_the_submodel_has_its_place():
    assert submodel("cutting") is SUBMODEL
    assert [one.name for one in SUBMODEL.inputs][:2] == ["speed_rpm", "feed_per_tooth_mm"]


def test_cases_have_roles_conditions_and_files(records):
    found = SUBMODEL.cases(records, settings())
    assert {case.name: case.role for case in found.cases} == {
        "slot-600.csv": "training", "slot-960.csv": "held_out", "slot-1200.csv": "training",
        "slot-1440.csv": "held_out",
    }  # fmt: skip
    reasons = {one.case: one.reason for one in found.left_out}
    assert set(reasons) == {"slot-copy-600.csv", "other.csv"}
    assert "is a copy of slot-600.csv" in reasons["slot-copy-600.csv"]
    assert "its feed is not known" in reasons["other.csv"]
    learnt = cases_conditions(found.of("training"))
    assert (learnt["feed per tooth"].low, learnt["feed per tooth"].high) == pytest.approx(
        (0.05, 0.1)
    )
    assert (learnt["spindle speed"].low, learnt["spindle speed"].unit) == (6000.0, "rev/min")
    assert found.cases[0].files[0].sha256.startswith("of ")


def test_a_sealed_recording_is_not_read_before_it_is_asked_for(records):
    sealed = FrozenSet(files=(SourceFile(file="slot-960.csv", sha256="of slot-960.csv"),))
    sets = GoldenSets(machine="m", sealed=sealed)
    found = SUBMODEL.cases(records, settings(), sets)
    (case,) = found.of("sealed")
    assert case.name == "slot-960.csv" and "feed per tooth" in case.conditions
    assert case.load().revolution is not None


def test_logs_of_the_load_are_cases_that_are_not_predicted(records):
    wanted = CuttingRecords(spindle=load_records(Bench()))
    found = SUBMODEL.cases(records, settings(cutting_records=wanted))
    assert [case.name for case in found.cases] == [FREE_LOG, CUT_LOG]
    assert {case.role for case in found.cases} == {"training"}
    assert isinstance(found.cases[0].load(), LoadLogFile)


def test_the_records_that_are_read_have_to_be_named(records):
    with pytest.raises(ValueError, match="signals and the raw folder"):
        SUBMODEL.cases(Records(signals=records.signals), settings())
