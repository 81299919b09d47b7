"""The judge on frames whose verdict can be worked out by hand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pipeline.validation.metrics import errors
from pipeline.submodels.spindle.submodel import (SpindleLimits, judge, predictions)
from pipeline.validation.verdict import flat_metrics, verdict

from pipeline.signals.ingest import MachineIdentity
from pipeline.twin.spindle import TARGET
from pipeline.twin.spindle_model import SpindleModel
from pipeline.validation.golden import Week, freeze, write_golden
from tests.submodels.spindle.spindle_days import ONE, RECORDS, state_table

LIMITS = SpindleLimits()
STEP = 10.0
IDENTITY = MachineIdentity(name="mill", origin="simulated")


def frame(
    day: str = "2026-01-19", off: float | np.ndarray = 0.5, rise: float = 8.0, hours: int = 2
) -> pd.DataFrame:
    """A day that warms by ``rise`` K an hour; the model is off by ``off``."""
    n = hours * 360
    measured = 20 + rise * np.arange(n) / 360
    return pd.DataFrame(
        {
            "time": pd.date_range(f"{day}T06:00", periods=n, freq="10s", tz="UTC"),
            "day": day,
            "measured": measured,
            "model_window": measured + off,
            "physics_window": measured + 2 * off,
            "persistence_window": np.repeat(measured[::360], 360),
            "model_free": measured + 4 * off,
            "physics_free": measured + 4 * off,
            "day_mean": measured.mean(),
        }
    )


def test_errors_leave_out_what_is_not_known() -> None:
    found = errors(np.array([20.0, np.nan, 24.0, 9.0]), np.array([21.0, 21.0, 21.0, np.nan]))
    assert found == {"mae_K": 2.0, "rmse_K": round(5**0.5, 4), "max_K": 3.0}
    assert errors(np.array([np.nan]), np.array([1.0])) == dict.fromkeys(found)
    assert errors(np.array([]), np.array([])) == dict.fromkeys(found)


def test_a_good_model_passes_and_its_scores_are_the_ones_by_hand() -> None:
    document = judge(frame(), STEP, LIMITS)
    assert document["verdict"] == "passed"
    assert document["reasons"] == []
    (day,) = document["windows"]["days"]
    assert day["day"] == "2026-01-19"
    assert day["passed"] is True
    assert day["model"] == {"mae_K": 0.5, "rmse_K": 0.5, "max_K": 0.5}
    assert day["physics"]["mae_K"] == 1.0
    assert (day["n_seconds"], day["n_windows"]) == (7200, 2)
    # persistence: errors 0 ... 8 K over each hour, uniform
    assert day["persistence"]["mae_K"] == pytest.approx(4.0, abs=0.02)
    assert day["persistence"]["rmse_K"] == pytest.approx(8 / 3**0.5, abs=0.02)
    # from one temperature over two hours: uniform from 0 to 16 K
    free = document["free_run"]["all"]
    assert free["persistence"]["rmse_K"] == pytest.approx(16 / 3**0.5, abs=0.03)
    assert free["day_mean"]["rmse_K"] == pytest.approx(16 / 12**0.5, abs=0.03)
    assert free["model"]["mae_K"] == 2.0


@pytest.mark.parametrize(
    ("off", "words"),
    [
        (2.0, ["mean error 2.00 K is not below 2 K"]),  # a limit that is reached is not kept
        (3.5, ["mean error 3.50 K is not below 2 K", "RMSE 3.50 K is not below 3 K"]),
    ],
)
def test_a_limit_that_is_not_kept_fails_the_day(off: float, words: list[str]) -> None:
    document = judge(frame(off=off), STEP, LIMITS)
    assert document["verdict"] == "failed"
    assert document["reasons"] == [f"2026-01-19: {w}" for w in words]


def test_rmse_alone_can_fail_a_day() -> None:
    off = np.where(np.arange(720) % 10 == 0, 12.0, 0.0)  # mean 1.2 K, RMSE 3.79 K
    document = judge(frame(off=off), STEP, LIMITS)
    assert document["reasons"] == ["2026-01-19: RMSE 3.79 K is not below 3 K"]


def test_a_model_that_is_no_better_than_persistence_fails() -> None:
    document = judge(frame(off=0.5, rise=0.1), STEP, LIMITS)
    (reason,) = document["reasons"]
    assert "RMSE 0.50 K is not below that of persistence, 0.06 K" in reason
    assert document["windows"]["days"][0]["better_than_persistence"] is False


def test_one_bad_day_fails_the_week() -> None:
    week = pd.concat([frame("2026-01-19"), frame("2026-01-20", off=2.5), frame("2026-01-21")])
    document = judge(week, STEP, LIMITS)
    assert [d["passed"] for d in document["windows"]["days"]] == [True, False, True]
    assert document["windows"]["all"]["model"]["mae_K"] == pytest.approx(3.5 / 3, abs=1e-4)
    assert document["verdict"] == "failed"


def test_only_what_all_predictors_know_is_judged() -> None:
    """A measurement, a window or a start that is missing is missing for every predictor."""
    rows = frame()
    rows.loc[:99, "measured"] = np.nan
    rows.loc[100:199, ["model_window", "physics_window", "persistence_window"]] = np.nan
    rows.loc[:199, ["model_window", "model_free"]] += 1000.0
    (day,) = judge(rows, STEP, LIMITS)["windows"]["days"]
    assert day["n_seconds"] == 5200
    assert day["model"]["mae_K"] == 0.5


def test_a_day_without_a_window_is_said_to_have_none() -> None:
    rows = frame().assign(model_window=np.nan, physics_window=np.nan, persistence_window=np.nan)
    document = judge(rows, STEP, LIMITS)
    assert document["reasons"] == ["2026-01-19: no window starts from a measured temperature"]
    json.dumps(document, allow_nan=False)


def test_no_working_day_is_no_verdict() -> None:
    document = judge(pd.DataFrame(), STEP, LIMITS)
    assert document["verdict"] == "not judged"
    assert document["windows"] == {"days": [], "all": None, "length_s": 3600.0}


@pytest.mark.parametrize("name", ["window_s", "mae_K", "rmse_K", "working_day_s"])
def test_limits_are_positive(name: str) -> None:
    with pytest.raises(ValueError, match=f"spindle_limits.{name} = 0.0 must be positive"):
        SpindleLimits(**{name: 0.0})


@pytest.fixture
def week(tmp_path: Path) -> Path:
    """Three days in tmp_path/state, of which the second is too short to be a working day."""
    (tmp_path / "state").mkdir()
    for number, (day, hours) in enumerate((("19", 2.0), ("20", 0.5), ("21", 2.0))):
        table = state_table(ONE, number, f"2026-01-{day}", hours)
        table.reset_index().to_parquet(tmp_path / f"state/2026-01-{day}.parquet")
    return tmp_path


MODEL = SpindleModel(network=ONE, records=RECORDS, step_s=STEP)
GOLDEN = Week(first="2026-01-19", last="2026-01-25")
FILES = {"a.txt": {"sha256": "a" * 64, "last": "2026-01-21T08:00:00Z"}}
TRAINED_BEFORE = replace(RECORDS, training_to="2026-01-18")


def test_only_working_days_are_predicted(week: Path) -> None:
    found = predictions(MODEL, week, ["2026-01-19", "2026-01-20", "2026-01-21"], LIMITS)
    assert sorted(set(found["day"])) == ["2026-01-19", "2026-01-21"]
    shorter = SpindleLimits(working_day_s=1000.0)
    assert "2026-01-20" in set(predictions(MODEL, week, ["2026-01-20"], shorter)["day"])


def test_held_inputs_do_not_make_a_working_day(week: Path) -> None:
    path = week / "state/2026-01-19.parquet"
    table = pd.read_parquet(path)
    table.loc[1800 : len(table) - 60, "spindle_load"] = np.nan
    table.to_parquet(path)
    assert predictions(MODEL, week, ["2026-01-19"], LIMITS).empty


def test_a_long_gap_leaves_its_windows_open_and_the_free_run_going(week: Path) -> None:
    path = week / "state/2026-01-19.parquet"
    table = pd.read_parquet(path)
    table.loc[2000:4000, "spindle_load"] = np.nan
    table.to_parquet(path)
    found = predictions(MODEL, week, ["2026-01-19"], LIMITS)
    # held for 600 s, then not known until the load is back
    unknown = found["model_window"].isna().to_numpy()
    np.testing.assert_array_equal(np.flatnonzero(unknown), np.arange(260, 400))
    assert found["model_free"].notna().all()


def test_the_truth_passes(week: Path) -> None:
    model = replace(MODEL, records=TRAINED_BEFORE)
    write_golden(freeze("mill", GOLDEN, FILES), week / "mill.json")
    rows, document = verdict(model, week, week / "mill.json", FILES, IDENTITY, LIMITS)
    assert document["verdict"] == "passed"
    # only the rounding of the records to whole degrees is left: 1 / sqrt(12) K, twice at most
    assert document["windows"]["all"]["model"]["rmse_K"] < 0.6
    assert document["golden"]["from"] == "2026-01-19"
    assert (document["signal"], document["unit"]) == (TARGET, "CELSIUS")
    assert len(rows) == 2 * 720
    flat = flat_metrics(document)
    assert flat["windows.days_passed"] == flat["windows.days"] == 2
    assert flat["windows.model.rmse_K"] == round(document["windows"]["all"]["model"]["rmse_K"], 3)


@pytest.mark.parametrize("last", ["2026-01-19", "2026-01-30"])
def test_a_golden_week_that_was_learnt_from_fails(week: Path, last: str) -> None:
    model = replace(MODEL, records=replace(RECORDS, training_to=last))
    write_golden(freeze("mill", GOLDEN, FILES), week / "mill.json")
    _, document = verdict(model, week, week / "mill.json", FILES, IDENTITY, LIMITS)
    assert document["verdict"] == "failed"
    assert "overlaps the training days" in document["reasons"][0]


@pytest.mark.parametrize(
    ("files", "machine", "words"),
    [
        ({}, "mill", "a.txt of the golden week is not among the records"),
        ({"a.txt": {**FILES["a.txt"], "sha256": "b" * 64}}, "mill", "frozen was aaaaaaaaaaaa"),
        (FILES, "lathe", "is one of lathe, not of mill"),
    ],
)
def test_a_golden_week_that_is_not_what_was_frozen_fails(
    week: Path, files: dict[str, dict[str, object]], machine: str, words: str
) -> None:
    model = replace(MODEL, records=TRAINED_BEFORE)
    write_golden(freeze(machine, GOLDEN, FILES), week / "mill.json")
    _, document = verdict(model, week, week / "mill.json", files, IDENTITY, LIMITS)
    assert document["verdict"] == "failed"
    assert words in document["reasons"][0]


def test_without_a_golden_week_nothing_is_judged(week: Path) -> None:
    rows, document = verdict(MODEL, week, week / "mill.json", FILES, IDENTITY, LIMITS)
    assert rows.empty
    assert document["verdict"] == "not judged"
    assert "kerf golden mill" in document["reasons"][0]
    assert flat_metrics(document) == {
        "verdict": "not judged", "windows.days": 0, "windows.days_passed": 0
    }  # fmt: skip
