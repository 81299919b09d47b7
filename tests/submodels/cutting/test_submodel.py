"""Cases of the cut: roles, conditions, what is left out, and what a sealed set keeps unread."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.schema.golden import FrozenSet, GoldenSets
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import SourceFile
from pipeline.submodels.cases import Records, Roles, conditions_of
from pipeline.submodels.contract import submodel
from pipeline.submodels.cutting.settings import CuttingRecords, StatedConditions
from pipeline.submodels.cutting.spindle_load.identify import LoadLogFile
from pipeline.submodels.cutting.submodel import SUBMODEL, Fitting
from tests.submodels.cutting.milling import Truth
from tests.submodels.cutting.recorded import RATE, SETTINGS, clean, known_of
from tests.submodels.cutting.spindle_load_logs import CUT_LOG, FREE_LOG, Bench, load_records

TRUTH = Truth(flutes=2, runout=0.003, runout_angle=0.0)
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
    (folder / "traces").mkdir()
    entries = {}
    for f_z in FEEDS:
        feed = round(f_z * 2 * 6000)
        name = f"slot-{feed}.csv"
        force = clean(TRUTH, (6000.0, f_z, 2.0, 0.0, np.pi), 0.3)
        force = force + np.random.default_rng(feed).normal(0, 1.5, force.shape)
        fields = [pa.field("t", pa.float64(), metadata={"unit": "SECOND"})]
        fields += [pa.field(f"force_{n}", pa.float64(), metadata={"unit": "NEWTON"}) for n in "xyz"]
        arrays = [np.arange(len(force)) / RATE, *force.T]
        pq.write_table(
            pa.table(arrays, schema=pa.schema(fields)), folder / f"traces/{name}.parquet"
        )
        entries[name] = {"output": f"traces/{name}.parquet", "sha256": f"of {feed}", "reason": None}
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
    learnt = conditions_of(found.of("training"))
    assert (learnt["feed per tooth"].low, learnt["feed per tooth"].high) == pytest.approx(
        (0.05, 0.1)
    )
    assert (learnt["spindle speed"].low, learnt["spindle speed"].unit) == (6000.0, "rev/min")
    assert found.cases[0].files[0].sha256.startswith("of ")


def test_a_sealed_recording_is_not_read_before_it_is_asked_for(records):
    sealed = FrozenSet(files=(SourceFile(file="slot-960.csv", sha256="of 960"),))
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
