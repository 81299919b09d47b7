"""Days of a spindle in parts, with intervals: starts and cooling, regimes, what is known when."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from pipeline.schema.model import AdaptiveSettings, Band
from pipeline.submodels.cases import Case
from pipeline.submodels.spindle.calibration import ForestSettings, Recipe, calibrated, days_left_out
from pipeline.submodels.spindle.days import (
    APART,
    FREE_RUN,
    WINDOWS,
    IntervalSettings,
    SpindleLimits,
    after_starts,
    cooling,
    horizon_words,
    predicted_day,
    runs_of,
    state_words,
)
from pipeline.submodels.spindle.fit import SpindleFitSettings
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import SpindleIntervals, SpindleModel, spindle_stretches
from tests.submodels.spindle.spindle_days import ONE, RECORDS, state_table

BANDS = {"": Band(lower=1.0, upper=2.0, n=10, groups=10)}
INTERVALS = SpindleIntervals(
    windows_horizons_s=(600.0,), free_run_horizons_s=(3600.0,), windows=BANDS, free_run=BANDS,
    follow=AdaptiveSettings(step=0.05, delay_s=3600.0),
)  # fmt: skip
MODEL = SpindleModel(network=ONE, records=RECORDS, step_s=10.0)
LIMITS = SpindleLimits()


def turning(*spans: tuple[int, int], minutes: int = 300) -> pd.DataFrame:
    """A stretch of one-minute steps in which the spindle turns over some spans."""
    turns = np.zeros(minutes)
    for first, last in spans:
        turns[first:last] = 1.0
    return pd.DataFrame({"bearing_friction": turns, "position_hold": 0.0})


def case(day: str, table: pd.DataFrame) -> Case:
    return Case(name=day, group=day, role="held_out", files=(), load=lambda: table)


def test_the_first_hour_begins_where_a_spindle_that_rested_turns():
    frame = turning((20, 40), (60, 90), (200, 230))
    found = np.flatnonzero(after_starts(frame, 60.0, 3600.0))
    # a pause of 20 minutes is no rest; from minute 90 to 200 it rested
    assert found.tolist() == [*range(20, 80), *range(200, 260)]


def test_cooling_is_a_spindle_that_stood_for_a_while_after_it_had_turned():
    frame = turning((20, 40), (45, 90))
    found = np.flatnonzero(cooling(frame, 60.0, 600.0))
    assert found.tolist() == list(range(89 + 11, 300))
    held = frame.assign(position_hold=1.0)  # held in position it is heated
    assert not cooling(held, 60.0, 600.0).any()


def test_a_state_is_known_from_the_past_alone():
    physics = np.concatenate([np.full(60, 20.0), 20 + np.arange(60) / 60, np.full(60, 21.0)])
    how = SpindleIntervals(trend_s=600.0, steady_K_h=0.5)
    words = state_words(physics, 60.0, how)
    assert set(words[:61]) == {"steady"} and set(words[70:120]) == {"warming"}
    assert set(words[135:]) == {"steady"}
    assert set(state_words(-physics, 60.0, how)[70:120]) == {"cooling"}
    np.testing.assert_array_equal(state_words(physics[:100], 60.0, how), words[:100])


def test_a_horizon_that_is_not_known_has_no_word():
    assert horizon_words(np.array([0.0, np.nan]), (60.0,)).tolist() == ["up to 1 min", ""]


def test_the_parts_are_rows_of_the_whole_and_the_interval_is_around_every_prediction():
    table = state_table(ONE, 3, "2026-01-05")
    found = predicted_day(MODEL, case("2026-01-05", table), LIMITS, INTERVALS).frame
    assert set(found["regime"]) <= {WINDOWS, FREE_RUN, *APART}
    whole = found[found["regime"] == WINDOWS].set_index("t")
    part = found[found["regime"] == APART[0]].set_index("t")
    assert 0 < len(part) < len(whole)
    columns = ["measured", "predicted", "low", "high"]
    pd.testing.assert_frame_equal(part[columns], whole.loc[part.index, columns])
    free = found[found["regime"] == FREE_RUN]
    np.testing.assert_allclose(free["high"] - free["predicted"], 2.0)
    np.testing.assert_allclose(free["predicted"] - free["low"], 1.0)


def test_an_interval_in_windows_knows_nothing_of_the_last_hour():
    table = state_table(ONE, 3, "2026-01-05")
    later = table.index >= table.index[0] + pd.Timedelta(hours=2)
    wrong = table.assign(spindle_temperature=table["spindle_temperature"] + np.where(later, 9.0, 0))
    one, other = (
        predicted_day(MODEL, case("2026-01-05", t), LIMITS, INTERVALS).frame.query(
            "regime == @WINDOWS"
        )
        for t in (table, wrong)
    )
    widths = [frame["high"] - frame["predicted"] for frame in (one, other)]
    start = one["t"].iloc[0]
    same = one["t"] < start + 3 * 3600
    np.testing.assert_allclose(widths[0][same], widths[1][same])
    assert not np.allclose(widths[0][~same], widths[1][~same])


def training(days: int, noise: float = 0.0) -> list[Case]:
    found = []
    for number in range(days):
        day = f"2026-01-{5 + number:02d}"
        table = state_table(ONE, number, day, 3.0)
        shift = noise * np.random.default_rng(number).normal()
        table["spindle_temperature"] += shift * np.linspace(0, 1, len(table))
        found.append(case(day, table))
    return found


def pieces_of(cases: list[Case], step: float = 60.0):
    return [
        piece
        for one in cases
        for piece in spindle_stretches(
            one.load(), one.name, RECORDS, step=step, bridge_s=600.0, shortest_s=3600.0
        )
    ]


RECIPE = Recipe(
    records=RECORDS, network=SpindleFitSettings(step_s=60.0, compute="serial"),
    forest=ForestSettings(trees=3), whole=ONE,
)  # fmt: skip


def test_intervals_are_of_models_that_did_not_see_the_day(monkeypatch):
    cases = training(6, noise=2.0)
    pieces = pieces_of(cases)
    seen: list[set[str]] = []
    plain = Recipe.model_of

    def watched(self: Recipe, some) -> SpindleModel:
        seen.append({piece.day for piece in some})
        return plain(self, some)

    monkeypatch.setattr(Recipe, "model_of", watched)
    settings = IntervalSettings(folds=3)
    runs = days_left_out(cases, pieces, RECIPE, settings)
    found = calibrated(runs, settings, 3600.0, forest_used=False)
    assert found is not None
    days = {one.name for one in cases}
    assert [len(days - fitted) for fitted in seen] == [2, 2, 2]
    assert set.union(*(days - fitted for fitted in seen)) == days
    assert found.windows[""].groups == 6
    # errors that grow over a day count where the temperature was measured once only
    assert found.free_run[""].upper > found.windows[""].upper


def test_one_day_leaves_nothing_to_calibrate_on():
    cases = training(1)
    runs = days_left_out(cases, pieces_of(cases), RECIPE, IntervalSettings())
    assert calibrated(runs, IntervalSettings(), 3600.0, forest_used=False) is None


def test_intervals_are_those_of_the_forest_where_it_is_used_and_of_the_network_else():
    cases, settings = training(3, noise=2.0), IntervalSettings(folds=3)
    small = ForestSettings(trees=2, depth=2, every_s=1800.0, sample_s=600.0)
    runs = days_left_out(cases, pieces_of(cases), replace(RECIPE, forest=small), settings)
    for used, name in ((True, "predicted"), (False, "physics")):
        found = calibrated(runs, settings, 3600.0, forest_used=used)
        errors = [
            np.abs(run.windows.measured - getattr(run.windows, name)) for run in runs.values()
        ]
        pooled = np.nanquantile(np.concatenate(errors), 0.9)
        worst = max(np.nanquantile(error, 0.9) for error in errors)
        assert found is not None and pooled < found.windows[""].upper < worst


def test_a_day_without_records_gives_no_run():
    table = state_table(ONE, 3, "2026-01-05", 1.0)
    empty = table.assign(spindle_speed=np.nan)
    how = {"window_s": 3600.0, "bridge_s": 0.0, "intervals": INTERVALS}
    assert runs_of(MODEL, empty, "2026-01-05", **how) is None


def test_a_coolant_sink_is_a_column_that_has_to_be_there(tmp_path):
    records = replace(RECORDS, coolant=True)
    table = state_table(ONE, 3, "2026-01-05", 1.0)
    with pytest.raises(ValueError, match="coolant_temperature"):
        list(
            spindle_stretches(table, "2026-01-05", records, step=60.0, bridge_s=0.0, shortest_s=0.0)
        )
    network = SpindleThermalParameters(heating={}, cooling_rate=1e-9, coolant_rate=1 / 300)
    model = SpindleModel(network=network, records=records, step_s=10.0)
    found = model.predict(table.assign(coolant_temperature=35.0), 20.0)
    assert found["spindle_temperature"].iloc[-1] == pytest.approx(35.0, abs=0.01)
