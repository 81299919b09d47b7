"""Condition over weeks: quantities that are known come back, lines, kept reports, prognosis."""

import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pipeline.monitoring.condition import ConditionSettings, conditions_of, write_reports
from pipeline.monitoring.day_quantities import ALARMS, RECORDED, DayValues, day_values
from pipeline.monitoring.prognosis import crossing
from pipeline.parameters import read_yaml
from pipeline.schema.condition import Condition, WeekReport, week_of
from pipeline.schema.ledger import Night
from pipeline.schema.store import StoreError, read_json, write_json
from pipeline.schema.twin_state import MANIFEST, TwinState, columns, day_path, write_day
from tests.monitoring.made_state import unknown_day

LOAD = ("axis X", "axis_load", "load at {} mm/s", "%")
SETTINGS = ConditionSettings()


def table(n: int, **given: object) -> pd.DataFrame:
    """Rows of the state of a day; what is not given is not known."""
    empty = {name: pd.Series([None] * n, dtype=object if not unit else float)
             for name, unit in columns().items()}  # fmt: skip
    return pd.DataFrame({**empty, "spindle_steady": False, **given})


def day(state: pd.DataFrame, clean: pd.DataFrame, day: str = "2026-01-05") -> DayValues:
    none = pd.DataFrame({name: [] for name in ("program", "complete", "active_s", "start")})
    return day_values(day, state, clean, none, none, period_s=1.0, turning_rpm=5.0)


def test_the_load_of_an_axis_is_that_at_a_steady_speed_outside_of_cuts() -> None:
    rng = np.random.default_rng(0)
    feed = np.repeat([20.0, 0.0, 50.0, 20.3], 300)
    load = np.where(feed > 40, 30.0, 12.0) + rng.normal(0, 0.2, 1200)
    mode = np.full(1200, "air", dtype=object)
    mode[:200], load[:200] = "cut", 90.0
    one = day(table(1200, mode=mode), pd.DataFrame({"x_feedrate": feed, "x_load": load}))
    medians = {speed: value for (_, speed), ((value, _), _) in one.at_speed.items()}
    assert set(medians) == {20.0, 50.0}
    assert medians[20.0] == pytest.approx(12.0, abs=0.1)
    assert medians[50.0] == pytest.approx(30.0, abs=0.1)
    moving = one.sums["axis X", "hours", "time moving", "h"]
    assert moving == pytest.approx(900 / 3600)


def test_work_does_not_look_like_wear() -> None:
    """Twice the rise of temperature, which the champion expects, is no worse a state."""
    for rise in (5.0, 10.0):
        t = np.linspace(0, rise, 600)
        heat = {
            "spindle_temperature_estimated": 20 + t,
            "spindle_temperature_measured": 22 + 1.1 * t,
        }
        values = day(table(600, **heat), pd.DataFrame(index=range(600))).values
        assert [round(value, 3) for value, _ in values.values()] == [110.0]
    flat = {name: np.full(600, 20.0) for name in heat}
    assert not day(table(600, **flat), pd.DataFrame(index=range(600))).values


def test_a_log_that_lacks_all_says_so() -> None:
    for rows in (0, 1):
        one = day(table(rows), pd.DataFrame(index=range(rows)))
        found, missing = conditions_of([one], [], SETTINGS)
        assert len(found) == 1 + rows, "alarms of no time are no rate"
    assert [(one.component, one.kind) for one in found] == [
        ("machine", "alarms"),
        ("machine", "hours"),
    ]
    assert {"axis_load", "no_load_power", "cycle_time", "tool_life"} <= set(missing)


def weeks(level: Callable[[int], float], many: int, noise: float = 0.2) -> list[DayValues]:
    """Four days a week of the load of an axis, which is ``level`` of the week."""
    rng = np.random.default_rng(1)
    days = [str(one.date()) for one in pd.date_range("2026-01-05", periods=7 * many)]
    loads = [level(k // 7) + rng.normal(0, noise) for k in range(len(days))]
    return [DayValues(day=one, sums={RECORDED: 8.0}, at_speed={(LOAD, 20.0): ((load, 0.1), 99.0)})
            for one, load in zip(days, loads, strict=True)
            if date.fromisoformat(one).weekday() < 4]  # fmt: skip


def axis(days: list[DayValues]) -> Condition:
    found, _ = conditions_of(days, [], SETTINGS)
    return next(one for one in found if one.kind == "axis_load")


def test_friction_that_rises_is_watched_then_acted_on_and_its_time_is_known_before() -> None:
    """Four percent of the reference a week: the alarm line, 40 % above it, in week 11.5."""
    states = {}
    for many in range(1, 14):
        one = axis(weeks(lambda week: 10 + 0.4 * max(week - 0.5, 0.0), many))
        states[many] = one.state
        if many < 3:
            assert one.reason == f"{many} of 3 weeks needed" and one.alarm is None
        elif many < 5:
            assert one.reason == f"time to the line: {many} of 5 weeks needed"
        elif many in (7, 9):
            left = 10.5 + 0.5 - (many - 1)
            assert one.to_alarm is not None and one.to_alarm.median is not None
            assert one.to_alarm.low is not None and one.to_alarm.high is not None
            assert one.to_alarm.low <= left <= one.to_alarm.high
            assert abs(one.to_alarm.median - left) < 2
    assert [states[k] for k in (2, 4, 9, 13)] == ["not assessed", "fine", "watch", "act"]


def test_an_axis_that_stays_as_it_is_never_asks_for_anything() -> None:
    for many in range(3, 14):
        one = axis(weeks(lambda week: 10.0, many, noise=0.5))
        assert one.state == "fine"
        assert one.to_alarm is None or one.to_alarm.median is None


def test_one_odd_day_of_a_week_is_no_alarm() -> None:
    days = weeks(lambda week: 10.0, 4)
    odd = replace(days[-1], at_speed={(LOAD, 20.0): ((40.0, 0.1), 99.0)})
    one = axis([*days[:-1], odd])
    assert one.value is not None and one.alarm is not None and one.value > one.alarm
    assert one.state == "fine"


def test_a_week_is_that_of_the_calendar_and_a_speed_that_is_not_moved_at_is_not_known() -> None:
    assert [week_of(one) for one in ("2025-12-28", "2025-12-29", "2026-01-04")] == [
        "2025-W52", "2026-W01", "2026-W01"
    ]  # fmt: skip
    days = weeks(lambda week: 10.0, 3)
    other = DayValues(
        day="2026-01-26", sums={RECORDED: 8.0}, at_speed={(LOAD, 99.0): ((50.0, 0.1), 999.0)}
    )
    one = axis([*days, other])
    assert one.value is None and one.reason == "not known this week, last in 2026-W04"


def test_alarms_have_the_interval_of_a_count_and_a_night_its_share_of_the_budget() -> None:
    days = [DayValues(day=f"2026-01-{d:02d}", sums={ALARMS: 3.0 if d < 19 else 30.0, RECORDED: 5.0})
            for d in (5, 6, 12, 13, 19, 20)]  # fmt: skip
    night = Night(
        night="2026-01-20", bundle="b", model="m", submodel="drive", quantity="x_error", regime="",
        unit="mm", records="r", n=9, share=0.9, result="within",
    )  # fmt: skip
    found, _ = conditions_of(days, [night], SETTINGS)
    alarms, budget = (next(one for one in found if one.kind == kind)
                      for kind in ("alarms", "error_budget"))  # fmt: skip
    assert alarms.value == 60 and alarms.state == "act" and alarms.reference == 6
    assert alarms.low == pytest.approx(47.9, abs=0.1) and alarms.high == pytest.approx(
        74.4, abs=0.1
    )
    assert (budget.value, budget.state, budget.alarm) == (90.0, "watch", 100.0)
    quiet, _ = conditions_of(days[:4], [night], SETTINGS)
    assert not any(one.kind == "error_budget" for one in quiet), "a night that was yet to come"


def project(root: Path, days: list[str]) -> Path:
    """State and clean tables of some days, an hour each, without any alarm."""
    (root / "clean/state").mkdir(parents=True)
    for name in days:
        time = pd.date_range(f"{name}T08:00", periods=600, freq="s", tz="UTC").as_unit("ns")
        values = {"mode": np.full(600, "air", dtype=object), "spindle_steady": np.ones(600, bool),
                  "spindle_speed": np.full(600, 3e3), "spindle_load": np.full(600, 4)}  # fmt: skip
        write_day(time, values, day_path(root / "state", name))
        clean = pd.DataFrame({"time": time, "x_load": 9.0})
        clean.to_parquet(root / f"clean/state/{name}.parquet")
    begun = {"start": pd.DatetimeIndex([], tz="UTC"), "active_s": [], "program": [], "complete": []}
    for name in ("cycles", "alarms"):
        pd.DataFrame(begun).to_parquet(root / f"clean/{name}.parquet")
    return root


def write(root: Path, days: list[str], bundle: str = "one") -> dict[str, WeekReport]:
    state = TwinState(bundle=bundle, submodels={}, period_s=1.0,
                      days={name: unknown_day(600.0) for name in days})  # fmt: skip
    write_json(state, root / "state" / MANIFEST)
    write_reports(root / "state", root / "clean", root / "none.jsonl", root / "out",
                  settings=SETTINGS, turning_rpm=5.0)  # fmt: skip
    return {path.stem: read_json(path, WeekReport) for path in (root / "out").glob("*.json")}


def test_a_report_is_kept_until_the_records_of_its_week_change(tmp_path: Path) -> None:
    days = ["2026-01-05", "2026-01-06", "2026-01-13"]
    root = project(tmp_path, days)
    first = write(root, days)
    assert list(first) and {name: one.days for name, one in first.items()} == {
        "2026-W02": tuple(days[:2]), "2026-W03": (days[2],)
    }  # fmt: skip
    again = write(root, days, bundle="two")
    assert again["2026-W02"] == first["2026-W02"], "what was said stays"
    assert again["2026-W03"].bundle == "two", "the newest week goes on"
    pd.read_parquet(root / "clean/state/2026-01-06.parquet").iloc[:300].assign(
        x_load=8.0).to_parquet(root / "clean/state/2026-01-06.parquet")  # fmt: skip
    time = pd.date_range("2026-01-06T08:00", periods=300, freq="s", tz="UTC").as_unit("ns")
    write_day(time, {}, day_path(root / "state", "2026-01-06"))
    assert write(root, days, bundle="two")["2026-W02"].bundle == "two"
    (root / "out/2026-W02.json").write_text("{}")
    with pytest.raises(StoreError, match=r"2026-W02\.json"):
        write(root, days)


def test_conf_holds_the_defaults() -> None:
    text = (Path(__file__).parents[2] / "conf/condition/default.yaml").read_text()
    assert ConditionSettings(**read_yaml(text)) == SETTINGS
    with pytest.raises(ValueError, match=r"condition\.alarm = -5"):
        ConditionSettings(alarm={"alarms": -5.0})


def wear_out(rng: np.random.Generator, shape: str) -> tuple[np.ndarray, float]:
    """Weekly level without noise from 100 to the line at 130, and the week of the crossing."""
    life = rng.uniform(10, 40)
    share = np.arange(int(life) + 1.0) / life
    power = {"steady": 1.0, "speeding up": 1.5, "square": 2.0}.get(shape)
    rise = share**power if power else np.expm1(3 * share) / np.expm1(3)
    return 100 + 30 * rise, life


SHAPES = ("steady", "speeding up", "square", "exponential")


@pytest.mark.proof
@pytest.mark.parametrize("noise", [0.5, 1.5, 3.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_the_time_to_the_line_holds_on_simulated_wear_out(shape: str, noise: float) -> None:
    """Coverage of the 90 % interval, and alpha-lambda at 20 % of life (Saxena et al. 2008)."""
    inside, near = [], {share: list[bool]() for share in (0.5, 0.7, 0.9)}
    for seed in range(1000, 1100):
        rng = np.random.default_rng(seed)
        level, life = wear_out(rng, shape)
        measured, known = level + rng.normal(0, noise, len(level)), rng.random(len(level)) > 0.1
        for share, hits in near.items():
            t = np.flatnonzero(known & (np.arange(len(level)) <= share * life)).astype(float)[-12:]
            if len(t) < SETTINGS.least_weeks:
                continue
            one = crossing(t, measured[t.astype(int)], 130.0, horizon=26.0, confidence=0.9)
            left = life - t[-1]
            inside.append(one.low <= (left if left <= 26 else np.inf) <= one.high)
            if left <= 26:
                hits.append(abs(one.median - left) <= 0.2 * life)
    shares = {share: float(np.mean(hits)) for share, hits in near.items()}
    sys.stdout.write(
        f"{shape}, noise {noise}: inside {np.mean(inside):.2f}, within 20 % of life {shares}\n"
    )
    assert np.mean(inside) >= 0.8
    assert shares[0.9] >= 0.9 and shares[0.7] >= (0.4 if shape == "exponential" else 0.7)


@pytest.mark.proof
def test_a_machine_that_does_not_wear_is_hardly_ever_said_to() -> None:
    said = []
    for seed in range(1000, 1300):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(5, 13))
        one = crossing(np.arange(float(n)), 100 + rng.normal(0, 2.0, n), 130.0, horizon=26.0,
                       confidence=0.9)  # fmt: skip
        said.append(np.isfinite(one.median))
    sys.stdout.write(f"said to wear: {np.mean(said):.3f}\n")
    assert np.mean(said) <= 0.1
