"""Records of spindle growth: layout, zero, faults as the truth says them, and what ingest keeps."""

from fnmatch import fnmatchcase

import numpy as np
import pyarrow.parquet as pq
import pytest

from pipeline.shop.growth.records import write_growth

from .conftest import Read, Simulated, digests, machine_conf, read_back, shop_parameters

HEAD = 8
TORN = {"mill01": 8, "mill02": 21}


@pytest.fixture(scope="module")
def ingested(warm: Simulated, tmp_path_factory: pytest.TempPathFactory) -> Read:
    return read_back(warm, warm.folder, tmp_path_factory.mktemp("signals"), warm.truth["files"])


@pytest.fixture(scope="module")
def tables(ingested: Read) -> dict[int, np.ndarray]:
    """Rows (R, 13) of each record by its number as they are read; NaN for no value."""
    found = {f["number"]: np.column_stack(list(ingested.traces[n].values()))
             for n, f in ingested.told.items()}  # fmt: skip
    for table in found.values():
        table[:, 12] *= 1e3  # MTConnect's unit of lengths is the millimetre
    return found


def test_a_chosen_record_is_that_of_the_whole_year(warm, tmp_path):
    """Before a sensor fails, no record depends on which others are made."""
    few = shop_parameters(warm.parameters.machine, growth={"numbers": [2, 9]})
    told = write_growth(tmp_path, few)
    assert [f["number"] for f in told["files"]] == [2, 9]
    assert few.growth.instruments.drift_from > 9
    assert digests(tmp_path).items() <= digests(warm.folder).items()


def test_a_row_a_minute_in_the_declared_columns_and_blanks_where_told(warm, ingested, tables):
    names = ["t", "spindle_speed", *(f"temperature_{k}" for k in range(1, 10)),
             "ambient_temperature", "growth"]  # fmt: skip
    for file, told in ingested.told.items():
        table, blank = tables[told["number"]], {(m["row"], m["column"]) for m in told["missing"]}
        assert list(ingested.traces[file]) == names
        assert len(table) == told["rows"] and 3 * 60 <= len(table) <= 8 * 60 + 1
        np.testing.assert_array_equal(table[:, 0], 60.0 * np.arange(len(table)))
        assert int(np.isnan(table).sum()) == len({at for at in blank if at[0] < told["rows"]})


def test_both_roles_hold_all_kinds(warm):
    patterns = machine_conf(warm.parameters.machine)["roles"]["training"]
    kinds: dict[bool, list[str]] = {True: [], False: []}
    for told in warm.truth["files"]:
        training = any(fnmatchcase(told["file"], pattern) for pattern in patterns)
        assert training == (told["number"] <= 14)
        kinds[training].append(told["kind"])
    assert (len(kinds[True]), len(kinds[False])) == (14, 12)
    assert set(kinds[True]) == set(kinds[False]) and len(set(kinds[True])) == 6


def test_growth_begins_at_zero_also_of_a_warm_machine(warm, tables):
    for told in warm.truth["files"]:
        assert told["true_growth_um"][0] == 0.0
        shown = tables[told["number"]]
        assert abs(shown[0, 12]) < 2.0  # some standard deviations of the probe
        above = shown[0, 9] - shown[0, 11]  # rear bearing, above the air
        if told["kind"] == "warm-start":
            assert above > 5.0 and min(told["true_growth_um"]) < -3.0


def test_growth_is_the_true_one_with_the_probes_noise(warm, tables):
    noise = warm.parameters.growth.instruments.probe_noise
    greatest = []
    for told in warm.truth["files"]:
        shown, true = tables[told["number"]][:, 12], np.array(told["true_growth_um"])
        greatest.append(true.max())
        error = shown - true[: len(shown)]
        assert np.nanstd(error) == pytest.approx(noise, rel=0.25)
        assert abs(np.nanmean(error)) < 2 * noise  # the zero is the mean of some readings
        assert sum(told["parts_um"].values()) == pytest.approx(true[-1], abs=0.01)
    assert 40 < max(greatest) < 75


def test_sensors_drift_and_die_where_the_truth_says(warm, tables):
    truth, stand = warm.truth, warm.parameters.growth.instruments
    drifting, dead = (int(truth[k]["column"][1:]) + 1 for k in ("drifting", "dead"))
    still, beside = {}, {}
    for told in truth["files"]:
        number, table = told["number"], tables[told["number"]]
        if number >= truth["dead"]["profile"]:
            gone = table[:, 0] >= told["dead_from_s"]
            values = table[gone, dead]
            values = values[np.isfinite(values)]
            expected = {"open": 850.0, "held": values[0]}[stand.dead_as]
            np.testing.assert_array_equal(values, expected)
            if number > truth["dead"]["profile"]:
                assert gone.all()
            else:
                assert np.nanstd(table[~gone, dead]) > 1.0
        else:
            assert "dead_from_s" not in told and np.nanstd(table[:, dead]) > 0.5
        if told["kind"] != "warm-start":  # cold: all sensors are within class A of one another
            others = [k for k in range(2, 11) if k not in (drifting, dead)]
            beside[number] = table[:3, drifting].mean() - np.nanmean(table[:3, others])
            still[number] = told.get("drift_K", [0.0])[0]
    before = np.mean([beside[k] for k in beside if k < truth["drifting"]["profile"]])
    for number, offset in beside.items():
        assert offset - before == pytest.approx(
            still[number], abs=0.7
        )  # the chiller runs before the record
    last = truth["files"][-1]["drift_K"][1]
    assert abs(last) > 3.0
    assert truth["drifting"]["profile"] <= 14 >= truth["dead"]["profile"]


def test_ingest_rejects_the_torn_row_alone(warm, ingested):
    rejected = pq.read_table(ingested.signals / "rejected.parquet").to_pylist()
    torn = next(f for f in warm.truth["files"] if f["torn"])
    assert torn["number"] == TORN[warm.parameters.machine]
    assert [(r["file"], r["line"]) for r in rejected] == [(torn["file"], HEAD + torn["rows"] + 1)]
    assert "13 columns" in rejected[0]["reason"]
