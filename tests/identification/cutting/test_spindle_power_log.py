"""A log's rows: which count, what their loads mean, and what is refused."""

import numpy as np
import pytest

from pipeline.identification.cutting.spindle_power_log import LoadLog, LoadScale, load_levels

SCALE = LoadScale(rated_power_kW=10.0, base_speed_rpm=3000.0, efficiency=0.9)


def log(**changes: object) -> LoadLog:
    times = np.arange(0, 12, 0.5)
    values = {
        "times": times, "speed": np.full(24, 50.0), "load": np.where(times < 6, 20.0, 40.0),
        "cut": np.where(times < 6, 0, 1), "removal": np.where(times < 6, 1e-6, 2e-6),
        "edge": np.zeros(24), **changes,
    }  # fmt: skip
    return LoadLog(**values)  # type: ignore[arg-type]


def test_rows_just_after_a_cut_began_do_not_count() -> None:
    """Their load is still on its way: 90 % of 2 kW and 4 kW come out without it."""
    late = np.where(np.arange(24) == 12, 25.0, log().load)
    found = load_levels(log(load=late), SCALE, settle_s=1.0)
    np.testing.assert_allclose(found.power, [1800.0, 3600.0])
    np.testing.assert_allclose(found.removal, [1e-6, 2e-6])
    assert found.samples.tolist() == [10, 10]  # of 12, two are within the first second
    np.testing.assert_allclose(found.deviation, 0.9 * 10e3 * 0.01 / np.sqrt(12))  # whole percents


def test_loads_not_known_do_not_count_and_a_free_spindle_needs_no_cuts() -> None:
    free = log(cut=None, removal=None, edge=None, load=np.full(24, 20.0))
    found = load_levels(free, SCALE)
    assert len(found) == 1 and found.removal[0] == 0.0
    holes = np.where(np.arange(24) % 2, np.nan, 20.0)
    assert load_levels(log(load=holes), SCALE).samples.tolist() == [5, 5]
    assert len(load_levels(log(speed=np.zeros(24)), SCALE)) == 0


def test_the_scale_is_said_in_words() -> None:
    assert SCALE.words == (
        "load is a percentage of the power available at its speed; 10 kW from 3000 rpm, "
        "efficiency 0.9"
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"load": np.zeros(3)}, "a column of the log has not the 24 rows"),
        ({"times": -np.arange(24.0)}, "do not rise: sort its rows"),
        ({"edge": None}, "needs the removal rate and the edge rate"),
    ],
)
def test_logs_that_do_not_fit_together_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        log(**changes)


def test_scales_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match=r"load_scale\.efficiency = 1\.2 is out of its range"):
        LoadScale(rated_power_kW=10.0, base_speed_rpm=3000.0, efficiency=1.2)
    with pytest.raises(ValueError, match=r"load_scale\.base_speed_rpm = 0\.0"):
        LoadScale(rated_power_kW=10.0, base_speed_rpm=0.0)
