"""State of the twin: forces, powers, temperatures and vibration that are known come back."""

import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from pipeline.monitoring.budget import MonitoringSettings
from pipeline.monitoring.day_estimates import (
    POWERS,
    day_state,
    following_errors,
    spindle_power,
    with_drift,
)
from pipeline.monitoring.nightly import serving_models
from pipeline.monitoring.recorded_state import _trend
from pipeline.parameters import read_params
from pipeline.schema.bundle import (
    Champion,
    Champions,
    bundle_of,
    copy_bundle,
)
from pipeline.schema.model import Parameter
from pipeline.schema.store import StoreError, read_json, write_json
from pipeline.schema.twin_state import (
    DAYS,
    MANIFEST,
    MODES,
    QUANTITIES,
    TwinState,
    columns,
    day_path,
    read_day,
    write_day,
)
from pipeline.schema.verdict import Verdict
from pipeline.signals.wear_windows import WearWindows
from pipeline.stages.__main__ import run
from pipeline.submodels.cases import Records
from pipeline.submodels.spindle.days import FREE_RUN
from tests import bundled_project
from tests.monitoring.made_state import DIAMETER, POWER, day_rows, estimators, load_of, no_load
from tests.small_project import inside


def milling(seed: int, n: int = 4000) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """A day of cuts of 100 s at one speed each, and their tangential force [N]."""
    rng = np.random.default_rng(seed)
    rpm = np.repeat(rng.uniform(1500, 11000, n // 100).round(), 100)
    force = np.repeat(rng.uniform(100, 900, n // 100), 100)
    cutting = force * np.pi * DIAMETER * rpm / 60
    words = {"execution": np.full(n, "ACTIVE"), "tool_number": np.full(n, "T4")}
    numbers = {"spindle_speed": rpm, "spindle_load": load_of(rpm, cutting),
               "path_feedrate": np.full(n, 20.0)}  # fmt: skip
    return words | numbers, force


@pytest.mark.parametrize("seed", range(3))
def test_the_force_of_a_cut_comes_back_from_whole_percents_of_load(seed: int) -> None:
    rows, force = milling(seed)
    values, _ = day_state(day_rows(rows, "cut"), estimators())
    low, high = values["tangential_force_low"], values["tangential_force_high"]
    known = np.isfinite(low)
    assert known.mean() > 0.9, "all but the seconds after a change of speed"
    assert ((low <= force) & (force <= high))[known].mean() >= 0.9
    assert np.abs(values["tangential_force_estimated"] / force - 1)[known].max() < 0.5
    power = force * np.pi * DIAMETER * rows["spindle_speed"] / 60
    inside = (values["cutting_power_low"] <= power) & (power <= values["cutting_power_high"])
    assert inside[known].mean() >= 0.9


def test_a_force_is_null_where_it_is_not_defined() -> None:
    rows, _ = milling(0, 600)
    rows["spindle_speed"] = rows["spindle_speed"].astype(float)
    rows["spindle_speed"][:100] = 200.0  # below the minimum speed
    rows["spindle_speed"][200:300] = np.linspace(2000, 9000, 100)  # run-up
    rows["spindle_speed"][500:] = 12000 * 1.1  # beyond the no-load power
    rows["tool_number"] = np.array(["T4"] * 400 + ["T99"] * 100 + ["T4"] * 100)
    values, _ = day_state(day_rows(rows, "cut"), estimators())
    force, power = values["tangential_force_estimated"], values["cutting_power_estimated"]
    known = np.isfinite(force)
    for part in (slice(0, 100), slice(203, 297), slice(400, 600)):
        assert not known[part].any()
    assert known[105:195].all() and np.isfinite(power[405:495]).all()
    for number, why in (("T99", "tool of a tool table"), ("T4", "that cuts")):
        rows["tool_number"] = np.full(600, number)
        slow = rows | ({"spindle_speed": np.full(600, 200.0)} if number == "T4" else {})
        values, reasons = day_state(day_rows(slow, "cut"), estimators())
        assert np.isfinite(values["cutting_power_estimated"]).any() == (number == "T99")
        assert why in reasons["tangential_force"]
    idle = replace(estimators(), idle={"cutting": "failed"})
    values, reasons = day_state(day_rows(milling(0)[0], "air"), idle)
    assert not {f"{name}_estimated" for name in POWERS} & values.keys()
    assert reasons["cutting_power"] == "the champion’s cutting does not serve: failed"
    assert (np.array(values["mode"]) == "cut").mean() > 0.9, "cuts are told from air all the same"
    none, why = day_state(day_rows(rows, "cut"), estimators(power=None))
    assert "cutting_power_estimated" not in none
    assert why["cutting_power"] == "no model with a no-load power serves"


def test_a_heavy_cut_that_the_log_calls_air_is_a_cut_and_no_rise_of_friction() -> None:
    rows, _ = milling(1, 1000)
    values, _ = day_state(day_rows(rows, "air"), estimators())
    modes = np.array(values["mode"])
    assert (modes == "cut").mean() > 0.9
    assert not np.isfinite(values["no_load_power_measured"]).any(), "something is fed throughout"


def test_friction_that_rises_shows_in_the_power_without_load() -> None:
    rpm = np.full(2000, 9000.0)
    for share in (1.0, 2.5):
        load = load_of(rpm, (share - 1) * no_load(rpm))
        free = {"spindle_speed": rpm, "spindle_load": load, "path_feedrate": np.zeros(2000)}
        values, _ = day_state(day_rows(free, "air"), estimators())
        over = values["no_load_power_measured"] > values["no_load_power_high"]
        assert over[5:-5].all() == (share > 1) and over.any() == (share > 1)


def test_the_load_of_a_run_up_and_the_rows_after_a_gap_are_no_power_without_load() -> None:
    """Load and speed of a row may be a row apart: the run-up's load stands beside held speeds."""
    n, up, gap = 600, 300, 450
    rpm = np.where(np.arange(n) < up, 3000.0, 9000.0)
    load = load_of(rpm, np.zeros(n))
    load[up - 2 : up + 2] = 130.0
    load[gap] = 130.0
    free = {"spindle_speed": rpm, "spindle_load": load, "path_feedrate": np.zeros(n)}
    rows = day_rows(free, "air")
    rows = replace(rows, frame=rows.frame.drop(rows.frame.index[gap - 20 : gap]))
    values, _ = day_state(rows, estimators())
    known = np.isfinite(values["no_load_power_measured"])
    assert known.sum() > 550 and np.nanmax(values["no_load_power_measured"]) < 1000
    assert not known[gap - 20 : gap - 18].any(), "after a gap"


def test_without_a_feed_a_cut_is_not_taken_for_friction() -> None:
    rpm = np.full(400, 9000.0)
    load = {"spindle_speed": rpm, "spindle_load": load_of(rpm, 3 * no_load(rpm))}
    values, reasons = day_state(day_rows(load, "air"), estimators())
    assert not np.isfinite(values["no_load_power_measured"]).any()
    assert "no feed is logged" in reasons["no_load_power"]
    assert (np.array(values["mode"]) == "air").all()
    axes = {f"{axis}_feedrate": np.zeros(400) for axis in "xyz"}
    values, _ = day_state(day_rows(load | axes, "air"), estimators())
    assert np.isfinite(values["no_load_power_measured"]).any(), "no axis moves"


def test_a_heavy_cut_in_a_warm_up_ends_it() -> None:
    rows, _ = milling(1, 1000)
    values, _ = day_state(day_rows(rows, "warm_up"), estimators())
    assert (np.array(values["mode"]) == "cut").mean() > 0.9


def test_what_the_no_load_power_drifts_by_on_training_days_widens_its_interval() -> None:
    rpm = np.full(500, 9000.0)

    def day(drift: float, name: str) -> object:
        free = {"spindle_speed": rpm, "spindle_load": load_of(rpm, drift * no_load(rpm)),
                "path_feedrate": np.zeros(500)}  # fmt: skip
        rows = day_rows(free, "air")
        shift = pd.Timestamp(name) - pd.Timestamp(rows.day)
        return replace(rows, day=name, frame=rows.frame.set_index(rows.frame.index + shift))

    def drift(*days: object) -> float:
        power = with_drift(estimators(), days).power  # type: ignore[arg-type]
        return power.drift if power else -1.0

    assert drift(day(0.0, "2026-01-05"), day(0.0, "2026-01-06")) < 0.05
    assert 0.5 < drift(day(0.0, "2026-01-05"), day(1.0, "2026-01-06")) < 1.0
    assert drift(day(1.0, "2026-01-05")) == POWER.drift, "one day says nothing of another"
    none = replace(POWER, curve=tuple(replace(one, power_W=0.0) for one in POWER.curve))
    two = day(0.0, "2026-01-05"), day(0.0, "2026-01-06")
    found = with_drift(estimators(power=none), two).power  # type: ignore[arg-type]
    assert found is not None and found.drift == 0.0, "a load of 0 % without a cut has no share"


def test_a_curve_without_the_load_that_it_is_of_estimates_nothing() -> None:
    model = SimpleNamespace(spindle=SimpleNamespace(curve=POWER.curve))
    for records, known in ((None, False), (POWER.records, True)):
        judging = SimpleNamespace(cutting_records=SimpleNamespace(spindle=records))
        found = spindle_power(SimpleNamespace(model=model, judging=judging))  # type: ignore[arg-type]
        assert (found is not None) == known


def test_ten_rows_a_second_are_a_period_that_divides_a_day() -> None:
    rows, force = milling(0, 2000)
    values, _ = day_state(day_rows(rows, "cut", 0.1), estimators())
    known = np.isfinite(values["tangential_force_estimated"])
    assert known.mean() > 0.6, "all but a second and a half after a change of speed"
    assert np.abs(values["tangential_force_estimated"] / force - 1)[known].max() < 0.5


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize(
    "rows",
    [
        {"spindle_speed": np.full(1, 3000.0), "spindle_load": np.full(1, 10.0)},
        {"path_feedrate": np.full(50, 1.0)},
        {"spindle_speed": np.full(50, np.nan), "spindle_load": np.full(50, np.nan),
         "tool_number": np.full(50, None), "execution": np.full(50, None)},
        {"spindle_speed": np.r_[np.full(25, -3e3), np.full(25, 65535.0)],
         "spindle_load": np.r_[np.full(25, -5.0), np.full(25, 1e9)]},
        {"spindle_speed": np.full(48, 3e3), "spindle_load": np.full(48, 3.5),
         "tool_number": np.tile(["probe", "T", "", "99999999999"], 12)},
    ],
    ids=["one row", "no spindle", "nothing known", "glitches", "tools without a number"],
)  # fmt: skip
def test_rows_of_any_kind_are_written(rows: dict[str, np.ndarray], tmp_path: Path) -> None:
    day = day_rows(rows, "cut")
    values, _ = day_state(day, estimators())
    write_day(day.frame.index, values, day_path(tmp_path, day.day))
    assert read_day(tmp_path, day.day).num_rows == len(day.seconds)
    assert not np.isfinite(values["tangential_force_estimated"]).any()


def test_a_tool_change_is_where_the_spindle_stands_about_the_new_number() -> None:
    rpm = np.array([5000.0] * 100 + [0.0] * 200 + [6000.0] * 100)
    rows = {"execution": np.full(400, "ACTIVE"), "spindle_speed": rpm,
            "spindle_load": np.zeros(400), "path_feedrate": np.zeros(400),
            "tool_number": np.array(["1"] * 110 + ["2"] * 290)}  # fmt: skip
    mode = day_rows(rows, "air").modes()
    change = np.flatnonzero(mode == MODES.index("tool_change"))
    assert change.min() == 100 and 128 <= change.max() <= 131
    unknown = day_rows(rows | {"spindle_speed": np.full(400, np.nan)}, "air").modes()
    assert MODES.index("tool_change") not in unknown, "whether it stands is not known"
    assert (day_rows(rows, "off").modes()[350:] == -1).all(), "a machine that is off has no mode"
    silent = day_rows(rows | {"execution": np.full(400, None)}, "air").modes()
    assert MODES.index("tool_change") not in silent, "whether a program runs is not known"


def test_the_following_error_at_constant_feed_is_speed_over_loop_gain() -> None:
    t = np.arange(300.0)
    v = np.where(t < 150, 20.0, -50.0)
    command = np.cumsum(v)
    rows = day_rows({"x_commanded_position": command, "x_position": command - v / 40.0}, "air")

    gain = Parameter(value=40.0, unit="1/s", interval_95=(39.0, 41.0), determined=True, method="")
    model = SimpleNamespace(parameters={"X": {"loop_gain": gain}})
    values, reasons = following_errors(rows, SimpleNamespace(model=model))  # type: ignore[arg-type]
    known = np.isfinite(values["x_following_error_estimated"])
    assert known[5:145].all() and not known[148:151].all()
    assert np.abs(values["x_following_error_residual"][known]).max() < 1e-9
    assert (values["x_following_error_high"] >= values["x_following_error_low"])[known].all()
    assert "not logged, and no model" in reasons["y_following_error"]
    serving = SimpleNamespace(model=SimpleNamespace(parameters={"X": {}, "Y": {"loop_gain": gain}}))
    _, why = following_errors(rows, serving)  # type: ignore[arg-type]
    assert why["x_following_error"] == "no model with its loop gain"
    assert why["y_following_error"] == "commanded position not logged"


def cuts(seed: int, dead: int = -1) -> tuple[WearWindows, np.ndarray]:
    """Cuts of eight tools in two kinds, whose vibration grows by half with 100 um of wear."""
    rng = np.random.default_rng(seed)
    tool = np.repeat([f"T{k}" for k in range(8)], 20)
    kind = np.tile(["slot", "side"], 80)
    wear = np.tile(np.linspace(20, 200, 20), 8)
    speed = np.repeat(rng.uniform(3000, 5000, 8), 20)
    level = np.repeat(rng.normal(0, 0.5, 16), 10).reshape(8, 2, 10).transpose(0, 2, 1).ravel()
    rms = np.exp(level + wear / 200 + 0.3 * (kind == "slot") + rng.normal(0, 0.05, 160))
    rms[dead] = rms[dead] if dead < 0 else 0.0
    n = len(tool)
    windows = WearWindows(
        values=np.zeros((n, 1, 8), np.float32), channels=("vibration_x",), units=("m/s^2",),
        rate_Hz=5000.0, wear=wear, wear_unit="um", measured=np.ones(n, bool),
        conditions={"speed": speed, "cut": kind}, condition_units={"speed": "rev/min"}, tool=tool,
        recording=np.array([f"{k:03d}" for k in range(n)]), time=np.zeros(n),
        progress=np.tile(np.arange(20.0), 8), progress_unit="1",
    )  # fmt: skip
    return windows, rms


@pytest.mark.parametrize("seed", range(3))
def test_vibration_follows_wear_at_the_level_of_the_tool(seed: int) -> None:
    windows, rms = cuts(seed)
    table, check = _trend(windows, rms, "vibration_x", "m/s^2")
    assert check.correlation is not None and check.correlation_new_tool is not None
    assert check.correlation > 0.97 > check.correlation_new_tool, "a tool's level is its own"
    inside = (table["low"] <= rms) & (rms <= table["high"])
    assert inside[table["predicted"].notna()].mean() >= 0.88
    first = table.groupby(["group", "regime"]).head(2)
    assert first["predicted"].isna().all(), "two cuts of a kind say a tool's level"


def test_a_condition_that_is_0_in_some_cuts_leaves_them() -> None:
    windows, rms = cuts(0)
    given = {"coolant": (np.arange(160) // 3 % 2).astype(float)}
    units = {**windows.condition_units, "coolant": "1"}
    windows = replace(windows, conditions={**windows.conditions, **given}, condition_units=units)
    _, check = _trend(windows, rms, "vibration_x", "m/s^2")
    assert check.recordings == 128 and check.correlation is not None


def test_a_dead_sensor_and_two_tools_say_nothing_of_a_trend() -> None:
    windows, rms = cuts(0, dead=30)
    table, check = _trend(windows, rms, "vibration_x", "m/s^2")
    assert check.correlation is not None and check.correlation > 0.95
    assert np.isfinite(table["predicted"].drop(30)).sum() > 120
    few = np.isin(windows.tool, ["T0", "T1"])
    _, none = _trend(windows.of(few), rms[few], "vibration_x", "m/s^2")
    assert none.correlation is None and "tools" in none.reason


DRIFTS = "2026-01-21"
"""Day on which the sensor of the spindle drifts by 15 K."""
SHORT, LACKING = "2026-01-19", "2026-01-22"
"""Day of one row, and day whose log has a gap and no load of the spindle."""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A project whose state was written by its stage."""
    root = bundled_project.project(tmp_path_factory.mktemp("state"), sealed=True)
    models = bundled_project.spindle(root)
    machine = bundled_project.MACHINE
    copy_bundle(models, bundle_of(models, machine, ["spindle"]), root / f"data/champion/{machine}")
    clean = root / f"data/clean/{machine}"
    day = pd.read_parquet(clean / f"state/{DRIFTS}.parquet")
    day["spindle_temperature"] += np.linspace(0, 15, len(day))
    day.to_parquet(clean / f"state/{DRIFTS}.parquet")
    pd.read_parquet(clean / f"state/{SHORT}.parquet").iloc[:1].to_parquet(
        clean / f"state/{SHORT}.parquet"
    )
    gaps = pd.read_parquet(clean / f"state/{LACKING}.parquet").drop(columns="spindle_load")
    gaps.drop(gaps.index[1000:5000]).to_parquet(clean / f"state/{LACKING}.parquet")
    kinds = {"start": "datetime64[ns, UTC]", "end": "datetime64[ns, UTC]", "kind": object}
    pd.DataFrame({name: [] for name in kinds}).astype(kinds).to_parquet(clean / "segments.parquet")
    (root / "data/raw" / machine).mkdir(parents=True)
    with (root / "params.yaml").open("a") as file:
        file.write("cleaning: {}\nmapping: {}\ntool: {}\n")
    gone = root / f"data/twin_state/{machine}" / DAYS / "2020-01-01.parquet"
    gone.parent.mkdir(parents=True)
    gone.write_bytes(b"of a day that is gone")
    with inside(root):
        folders = [f"data/{name}/{machine}" for name in ("champion", "raw", "signals", "clean")]
        run(f"state@{machine}", folders[0], "champions.json", *folders[1:], "data/golden",
            f"data/twin_state/{machine}")  # fmt: skip
    return root


def test_the_stage_writes_every_row_and_says_why_a_value_is_null(written: Path) -> None:
    out = written / f"data/twin_state/{bundled_project.MACHINE}"
    state = read_json(out / MANIFEST, TwinState)
    assert list(state.days) == list(bundled_project.DAYS)
    assert {path.stem for path in (out / DAYS).iterdir()} == set(state.days)
    assert list(state.submodels) == ["spindle"] and state.force is None
    for day, one in state.days.items():
        table = read_day(out, day)
        assert table.column_names == ["time", *columns()]
        clean = written / f"data/clean/{bundled_project.MACHINE}/state/{day}.parquet"
        assert table["time"].to_pylist() == pq.read_table(clean)["time"].to_pylist()
        for name in QUANTITIES:
            known = table.num_rows - table[f"{name}_estimated"].null_count
            assert one.known_s[name] == known
            assert (name in one.unknown) == (one.known_s[name] == 0)
        sealed = day == bundled_project.SEALED
        assert (one.role == "sealed") == sealed
        unknown = sealed or day in (SHORT, LACKING)
        assert (one.known_s["spindle_temperature"] == 0) == unknown
        assert table["spindle_temperature_measured"].null_count < table.num_rows
        if sealed:
            assert one.unknown["spindle_temperature"] == "sealed: not looked at"
    assert "no working day" in state.days[SHORT].unknown["spindle_temperature"]
    assert "spindle_load" in state.days[LACKING].unknown["spindle_temperature"]
    assert table.schema.field("tangential_force_low").metadata == {b"unit": b"NEWTON"}
    assert "two training days" in state.temperature_interval_unknown
    with pytest.raises(StoreError, match=r"2026-02-01\.parquet does not exist"):
        read_day(out, "2026-02-01")


def test_a_submodel_that_does_not_serve_estimates_nothing(written: Path, tmp_path: Path) -> None:
    root, machine = tmp_path / "project", bundled_project.MACHINE
    shutil.copytree(written, root)
    path = root / f"data/models/{machine}/spindle/verdict.json"
    write_json(replace(read_json(path, Verdict), status="failed"), path)
    bundle = bundle_of(path.parents[1], machine, ["spindle"])
    copy_bundle(path.parents[1], bundle, root / f"data/champion/{machine}")
    out = root / f"data/twin_state/{machine}"

    def state() -> TwinState:
        folders = [f"data/{name}/{machine}" for name in ("raw", "signals", "clean")]
        with inside(root):
            run(f"state@{machine}", f"data/champion/{machine}", "champions.json", *folders,
                "data/golden", f"data/twin_state/{machine}")  # fmt: skip
        return read_json(out / MANIFEST, TwinState)

    found = state()
    assert (found.submodels, found.idle) == ({"spindle": "failed"}, ("spindle",))
    for day in found.days.values():
        assert day.unknown["spindle_temperature"] == "the champion’s spindle does not serve: failed"
    own = Champion(version=1, bundle=bundle.sha256, since="", by="", why="", serving=("spindle",))
    write_json(Champions(machines={machine: own}), root / "champions.json")
    assert state().days[DRIFTS].known_s["spindle_temperature"] > 0, "somebody let it serve"


def test_a_slow_fault_is_not_taken_for_the_truth(written: Path) -> None:
    out = written / f"data/twin_state/{bundled_project.MACHINE}"
    whole = read_day(out, DRIFTS)["spindle_temperature_residual"].to_numpy()
    assert np.nanmedian(whole[-3600:]) > 10, "the free run follows the fault"
    assert np.nanmedian(np.abs(read_day(out, "2026-01-20")["spindle_temperature_residual"])) < 2


def test_the_state_is_what_the_nights_are_scored_by(written: Path) -> None:
    machine = bundled_project.MACHINE
    with inside(written):
        data, champion = Path("data"), Path(f"data/champion/{machine}")
        one = serving_models(champion, read_params(), MonitoringSettings())["spindle"]
        cases = one.one.cases(Records.of_machine(data, machine, champion), one.judging).cases
        case = next(case for case in cases if case.name == DRIFTS)
        frame = one.predictor(case).frame
    free = frame[frame["regime"] == FREE_RUN]
    table = read_day(written / f"data/twin_state/{machine}", DRIFTS)
    seconds = table["time"].cast(pa.int64()).to_numpy() / 1e9 % 86400
    at = np.searchsorted(seconds, free["t"].to_numpy())
    stored = table["spindle_temperature_estimated"].to_numpy()[at]
    np.testing.assert_array_equal(stored, free["predicted"].to_numpy(np.float32))
