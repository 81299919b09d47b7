"""Incidents from a made state: what each rule finds, what it must not, and how events join."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from pipeline.monitoring.incident_settings import DWELL_S, IncidentSettings
from pipeline.monitoring.incidents import monitored, recurring
from pipeline.monitoring.rules import RULES
from pipeline.monitoring.usual import Usual, identify_monitor
from pipeline.monitoring.windows import windows_of
from pipeline.report.texts import texts
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.incident import Incident, Monitored
from pipeline.schema.store import write_json, write_table
from pipeline.schema.twin_state import MANIFEST, QUANTITIES, StateDay, TwinState, write_day

MILL = MachineIdentity(name="mill", origin="simulated")
SETTINGS = IncidentSettings(trees=20)
HOUR, NOON = 3600, 3600
"""Seconds in an hour, and rows of a day before its second hour of four."""
Change = Callable[[dict[str, Any]], None]


def day_values(seed: int, rate_Hz: float = 1.0) -> dict[str, Any]:
    """Rows of four hours of cutting: passes of 8 s, temperature near its estimate."""
    n = int(4 * HOUR * rate_Hz)
    rng, t = np.random.default_rng(seed), np.arange(n) / rate_Hz
    cutting = t % 10 < 8
    estimated = 30 + 4 * np.sin(t / HOUR)
    off = 0.4 * np.sin(t / 700 + seed)
    return {
        "execution": np.full(n, "ACTIVE", object),
        "mode": np.where(cutting, "cut", "air").astype(object),
        "program": np.full(n, "O1", object), "tool_number": np.full(n, "4", object),
        "spindle_steady": np.full(n, True), "spindle_speed": 6000.0 + rng.normal(0, 5, n),
        "spindle_load": np.where(cutting, 40 + rng.normal(0, 3, n), 4.0),
        "path_feedrate": 20.0 + rng.normal(0, 0.5, n),
        "spindle_temperature_measured": estimated + off,
        "spindle_temperature_estimated": estimated, "spindle_temperature_low": estimated - 2,
        "spindle_temperature_high": estimated + 2, "spindle_temperature_residual": off,
    }  # fmt: skip


def made(
    folder: Path, changes: dict[str, Change | None], rate_Hz: float = 1.0,
    settings: IncidentSettings = SETTINGS,
) -> Monitored:  # fmt: skip
    """Three known-good days, then days with changes, each from six o'clock on."""
    days = {f"2026-01-0{k}": None for k in (5, 6, 7)} | changes
    roles = dict.fromkeys(list(days)[:3], "training")
    known = {}
    for k, (day, change) in enumerate(days.items()):
        values = day_values(k, rate_Hz)
        if change is not None:
            change(values)
        values["spindle_temperature_residual"] = (
            values["spindle_temperature_measured"] - values["spindle_temperature_estimated"]
        )
        n = len(values["mode"])
        time = pd.date_range(f"{day}T06:00", periods=n, freq=pd.Timedelta(seconds=1 / rate_Hz),
                             tz="UTC")  # fmt: skip
        write_day(time, values, folder / f"days/{day}.parquet")
        unknown = {name: "not logged" for name in QUANTITIES if f"{name}_residual" not in values}
        known[day] = StateDay(role=roles.get(day, "held_out"), seconds=n / rate_Hz,  # type: ignore[arg-type]
                              known_s={}, unknown=unknown)  # fmt: skip
    state = TwinState(bundle="b", submodels={}, period_s=1 / rate_Hz, days=known)
    write_json(state, folder / MANIFEST)
    usual = usual_of(state, folder, settings)
    return monitored(state, folder, folder, usual, identity=MILL, settings=settings, conditions={})


def usual_of(state: TwinState, folder: Path, settings: IncidentSettings) -> Usual:
    return identify_monitor(state, folder, folder, settings)


def only(found: Monitored) -> Incident:
    """The one incident; the others in the message."""
    assert len(found.incidents) == 1, [one.title for one in found.incidents]
    return found.incidents[0]


def put(name: str, a: int, seconds: int, value: Any) -> Change:
    def change(values: dict[str, Any]) -> None:
        values[name][a : a + seconds] = value

    return change


def both(*changes: Change) -> Change:
    def change(values: dict[str, Any]) -> None:
        for one in changes:
            one(values)

    return change


MONDAY = "2026-01-12"


def test_quiet_days_over_a_weekend_and_off_are_no_incident(tmp_path: Path) -> None:
    def off(values: dict[str, Any]) -> None:  # the agent says unavailable for three hours
        for name, one in values.items():
            one[NOON : NOON + 2 * HOUR] = None if one.dtype == object else np.nan if (
                one.dtype.kind == "f") else "idle" if name == "mode" else False  # fmt: skip

    found = made(tmp_path, {"2026-01-08": None, "2026-01-09": off, MONDAY: None})
    assert not found.incidents
    assert found.rules["temperature_outside"].assessed_s >= 16 * HOUR


@pytest.mark.parametrize(
    ("rule", "change", "short"),
    [
        ("load_over_limit", put("spindle_load", NOON, 60, 140.0),
         put("spindle_load", NOON, 20, 140.0)),
        ("load_without_feed", both(put("spindle_load", NOON, 60, 80.0),
                                   put("path_feedrate", NOON, 60, 0.0)),
         both(put("spindle_load", NOON, 20, 80.0), put("path_feedrate", NOON, 20, 0.0))),
        ("temperature_slope", put("spindle_temperature_measured", NOON, 90,
                                  31 + np.arange(90) / 6),
         put("spindle_temperature_measured", NOON, 20, 31 + np.arange(20) / 6)),
        ("cut_load_low", put("spindle_load", NOON, 600, 4.0), put("spindle_load", NOON, 40, 4.0)),
        ("cut_load_high", put("spindle_load", NOON, 600, 62.0),
         put("spindle_load", NOON, 30, 62.0)),
        ("temperature_outside", put("spindle_temperature_measured", NOON, HOUR, 45.0),
         put("spindle_temperature_measured", NOON, 240, 35.0)),
        ("sensor_silent", put("spindle_temperature_measured", NOON, HOUR, np.nan),
         put("spindle_temperature_measured", NOON, 300, np.nan)),
        ("sensor_stuck", put("spindle_temperature_measured", NOON, int(2.5 * HOUR), 30.2),
         put("spindle_temperature_measured", NOON, HOUR // 2, 30.2)),
    ],
)  # fmt: skip
def test_a_rule_finds_its_fault_and_nothing_shorter_than_its_dwell(
    tmp_path: Path, rule: str, change: Change, short: Change
) -> None:
    settings = replace(SETTINGS, residuals=False)
    found = made(tmp_path / "long", {MONDAY: change}, settings=settings)
    events = {event.rule for one in found.incidents for event in one.events}
    assert rule in events
    assert all(one.start.startswith(MONDAY) for one in found.incidents)
    brief = made(tmp_path / "short", {MONDAY: short}, settings=settings)
    assert brief.rules[rule].events == 0


def test_records_that_begin_in_a_run_say_nothing_of_the_temperature_at_first(
    tmp_path: Path,
) -> None:
    hot = put("spindle_temperature_measured", 0, HOUR, 45.0 + np.arange(HOUR) / HOUR)
    assert not made(tmp_path / "run", {MONDAY: hot}).incidents
    off = both(hot, put("execution", 0, 60, "READY"))
    assert made(tmp_path / "rest", {MONDAY: off}).incidents


@pytest.mark.parametrize("mode", ["tool_change", "warm_up", "run-up"])
def test_masked_states_count_for_no_load(tmp_path: Path, mode: str) -> None:
    hidden = put("spindle_steady", NOON, 120, False) if mode == "run-up" else (
        put("mode", NOON, 120, mode))  # fmt: skip
    found = made(tmp_path, {MONDAY: both(put("spindle_load", NOON, 120, 150.0), hidden)})
    assert not found.incidents
    assert found.rules["load_over_limit"].events == 0


def test_events_of_days_on_end_are_one_incident_with_evidence(tmp_path: Path) -> None:
    hot = put("spindle_temperature_measured", NOON, 2 * HOUR, 46.0)
    one = only(made(tmp_path, {MONDAY: hot, "2026-01-13": hot}))
    assert (one.component, one.severity, one.who) == ("spindle temperature", "act", "maintenance")
    assert one.start.startswith(MONDAY) and one.end.startswith("2026-01-13")
    first = next(event for event in one.events if event.rule == "temperature_outside")
    assert first.words["program"] == "O1" and first.values["temperature"] == pytest.approx(46.0)
    assert first.value > first.limit >= SETTINGS.interval
    assert one.found.startswith("spindle temperature, tool 4, program O1: ")
    assert "1.53 × half interval, limit 1.5" in one.found and "Sensor" in one.check


def test_a_fault_on_another_component_is_another_incident(tmp_path: Path) -> None:
    change = both(put("spindle_load", 3 * HOUR, 600, 4.0),
                  put("spindle_temperature_measured", NOON, HOUR, 46.0))  # fmt: skip
    found = made(tmp_path, {MONDAY: change})
    assert {one.component for one in found.incidents} == {"tool and cut", "spindle temperature"}


def test_the_forest_names_what_is_furthest_from_usual(tmp_path: Path) -> None:
    """A load, speed and feed that never were break no rule."""
    odd = both(put("path_feedrate", NOON, 600, 400.0), put("spindle_speed", NOON, 600, 900.0),
               put("spindle_load", NOON, 600, 90.0))  # fmt: skip
    one = only(made(tmp_path, {MONDAY: odd}))
    assert (one.component, one.severity) == ("machine", "watch")
    assert {"feed", "speed", "load"} == set(one.events[0].words["furthest from usual"].split(", "))


def test_the_id_stays_when_more_days_come(tmp_path: Path) -> None:
    hot = put("spindle_temperature_measured", NOON, 2 * HOUR, 46.0)
    now = only(made(tmp_path / "a", {MONDAY: hot}))
    later = only(made(tmp_path / "b", {MONDAY: hot, "2026-01-13": hot}))
    assert now.id == later.id and now.count < later.count


def test_ten_rows_a_second_give_the_incidents_of_one(tmp_path: Path) -> None:
    jam = [both(put("spindle_load", NOON * k, 120 * k, 150.0)) for k in (1, 10)]
    slow = made(tmp_path / "1", {MONDAY: jam[0]})
    fast = made(tmp_path / "10", {MONDAY: jam[1]}, rate_Hz=10.0)
    assert [(one.title, one.start) for one in slow.incidents] == [
        (one.title, one.start) for one in fast.incidents
    ]


def test_what_is_not_recorded_is_not_assessed_with_its_reason(tmp_path: Path) -> None:
    state = TwinState(bundle="", submodels={}, period_s=1.0, days={})
    found = monitored(
        state, tmp_path, tmp_path, usual_of(state, tmp_path, SETTINGS), identity=MILL,
        settings=SETTINGS, conditions={},
    )  # fmt: skip
    assert not found.incidents and all(one.not_assessed for one in found.rules.values())
    assert "roles" in found.rules["temperature_outside"].not_assessed
    some = made(tmp_path, {})
    assert some.rules["x_following_error"].not_assessed == "not logged"
    assert some.rules["load_over_limit"].not_assessed == ""
    assert "no condition of the control" in some.rules["alarm"].not_assessed


def test_vibration_of_the_clean_table_is_a_feature_where_it_is_wanted(tmp_path: Path) -> None:
    made(tmp_path, {MONDAY: None})
    for path in (tmp_path / "days").iterdir():
        n = 4 * HOUR
        unit = pa.field("spindle_vibration", pa.float64(), metadata={"unit": "MILLIMETER/SECOND"})
        table = pa.table([np.full(n, 1.0)], schema=pa.schema([unit]))
        write_table(table, tmp_path / "state" / path.name)
    for wanted in (True, False):
        settings = replace(SETTINGS, vibration=wanted)
        windows = windows_of(tmp_path, tmp_path, [MONDAY], settings)
        assert ("spindle_vibration" in windows.values) == wanted


def alarms(folder: Path, *rows: tuple[str, str, str, float]) -> list[Incident]:
    """Incidents of alarms (item, level, day and time, minutes)."""
    start = [pd.Timestamp(one[2], tz="UTC") for one in rows]
    end = [a + pd.Timedelta(minutes=one[3]) for a, one in zip(start, rows, strict=True)]
    frame = pd.DataFrame({
        "data_item": [one[0] for one in rows], "level": [one[1] for one in rows], "code": "101",
        "message": None, "start": pd.to_datetime(start).as_unit("ns"),
        "end": pd.to_datetime(end).as_unit("ns"),
    })  # fmt: skip
    frame.to_parquet(folder / "alarms.parquet")
    kinds = {"x": ("Linear X", "POSITION"), "s": ("Controller", "SYSTEM")}
    return recurring(folder / "alarms.parquet", MILL, SETTINGS, kinds)


def test_an_alarm_three_times_in_a_fortnight_is_an_incident_to_act_on(tmp_path: Path) -> None:
    days = ("2026-01-05T08:00", "2026-01-08T09:00", "2026-01-09T07:00")
    (one,) = alarms(tmp_path, *(("x", "fault", day, 2.0) for day in days))
    assert one.component == "Linear X (x)" and one.severity == "act" and one.count == 3
    assert "3 times on 3 days" in one.title and one.seconds == 360.0
    assert one.found == "Linear X (x), 101, up to 2 min"
    assert one.check.startswith("Where the axis stood")


@pytest.mark.parametrize(
    ("item", "execution", "mode", "severity"),
    [("s", "STOPPED", "MANUAL", "note"), ("s", "ACTIVE", "MANUAL_DATA_INPUT", "note"),
     ("s", "ACTIVE", "AUTOMATIC", "act"), ("s", "ACTIVE", None, "act"),
     ("s", None, "MANUAL", "act"), ("x", "STOPPED", "MANUAL", "act")],
)  # fmt: skip
def test_an_alarm_of_the_control_that_never_comes_while_a_program_runs_is_of_operation(
    tmp_path: Path, item: str, execution: str | None, mode: str | None, severity: str
) -> None:
    """The last alarm, of one second, stops what the machine does two seconds before."""
    zone, days = "America/New_York", ("2026-01-05", "2026-01-08", "2026-01-09")
    for k, day in enumerate(days):
        time = pd.date_range(f"{day}T22:00", periods=600, freq="s", tz=zone)
        rows = pd.DataFrame({"time": time.as_unit("ns"), "execution": "READY",
                             "controller_mode": "AUTOMATIC"})  # fmt: skip
        if k == 2:
            rows.loc[:299, "execution"], rows.loc[:299, "controller_mode"] = execution, mode
        if execution is None:
            rows["execution"] = None
        (tmp_path / "state").mkdir(exist_ok=True)
        write_table(pa.Table.from_pandas(rows), tmp_path / "state" / f"{day}.parquet")
    at = [f"{pd.Timestamp(f'{day}T22:05:01', tz=zone).tz_convert('UTC'):%Y-%m-%dT%H:%M:%S}"
          for day in days]  # fmt: skip
    (one,) = alarms(tmp_path, *((item, "fault", time, 1 / 60) for time in at))
    assert one.severity == severity
    assert ("never while a program ran" in one.title) == (severity == "note")
    assert (one.who == "maintenance") == (item == "x")


def test_days_are_those_of_the_plant(tmp_path: Path) -> None:
    """An evening in New York goes on after midnight of UTC."""
    time = pd.date_range("2026-01-05T12:00", periods=9 * HOUR, freq="s", tz="America/New_York")
    rows = pa.table({"time": pa.array(time.as_unit("ns"))})
    write_table(rows, tmp_path / "state" / "2026-01-05.parquet")
    (one,) = alarms(tmp_path, *(("x", "fault", f"2026-01-0{at}:30", 2.0)
                                for at in ("5T22", "5T23", "6T01")))  # fmt: skip
    assert "3 times on one day" in one.title and one.severity == "watch"
    found = Monitored(machine="mill", origin="simulated", known_good=(), worked_s=0.0, rules={},
                      days=("2026-01-05", "2026-01-06"), incidents=(one,),
                      time_zone="America/New_York")  # fmt: skip
    assert not found.recent("watch") and found.since("2026-01-05") == [one]
    assert replace(found, time_zone="UTC").recent("watch") == [one]


def test_alarms_that_are_rare_or_of_another_item_do_not_recur(tmp_path: Path) -> None:
    rows = [("x", "2026-01-05"), ("x", "2026-01-12"), ("y", "2026-01-13"), ("x", "2026-02-20")]
    assert not alarms(tmp_path, *((item, "fault", day, 1.0) for item, day in rows))
    assert not recurring(tmp_path / "none.parquet", MILL, SETTINGS, {})


def test_an_alarm_of_more_minutes_than_in_the_week_before_is_one(tmp_path: Path) -> None:
    rows = [("x", "warning", "2026-01-05T08:00", 3.0), ("x", "warning", "2026-01-13T08:00", 40.0)]
    (one,) = alarms(tmp_path, *rows)
    assert "40 min in its last 7 days, 3 min in the 7 before" in one.title
    assert one.severity == "watch"


def test_settings_name_each_rule() -> None:
    with pytest.raises(ValueError, match=r"incidents\.dwell_s names .*: give one time to each of"):
        IncidentSettings(dwell_s={"forest": 60.0})
    with pytest.raises(ValueError, match=r"incidents\.slope_s = 30.0 s must lie from 60"):
        IncidentSettings(slope_s=30.0)
    assert set(IncidentSettings().dwell_s) == set(DWELL_S)


def test_each_rule_has_a_german_title() -> None:
    german = texts("de")
    for name, rule in RULES.items():
        if not name.endswith("following_error"):
            assert german.given(rule.title) != rule.title
