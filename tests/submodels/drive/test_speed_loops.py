"""Trial of speed loops: measures, ramps, equal search for both kinds, the notebook's result."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import nbformat
import numpy as np
import pytest

from pipeline.machine.axis.three_loop import servo_axis, servo_motor
from pipeline.schema.si import RPM
from pipeline.submodels.drive.speed_loops import (
    TUNED,
    SpeedTrial,
    compare_speed_loops,
    published,
    ramp,
    ramp_error,
    settling_time,
    step_response,
    tuned,
    with_speed_loop,
)
from tests.small_project import ROOT
from tests.test_notebooks import executed, images

TRIAL = SpeedTrial()
SHORT = SpeedTrial(duration=0.02, feeds=(0.05,), stroke=0.005)


@dataclass
class Corner:
    """A search that asks for both corners and the middle and takes the cheapest."""

    asked: int = 0

    def __call__(self, costs, low, high):
        tried = np.array([low, (low + high) / 2, high])
        found = costs(tried)
        self.asked += found.size
        self.x = tried[np.argmin(found)]
        return self


def test_settling_time_is_the_last_time_outside() -> None:
    time = np.array([1.0, 1.5, 2.0, 2.5, 3.0])
    assert settling_time(time, np.array([1.0, 0.1, -0.3, 0.1, 0.0]), 0.2) == 1.5
    assert settling_time(time, np.zeros(5), 0.2) == 0
    assert np.isnan(settling_time(time, np.array([0.0, 0.0, 0.0, 0.0, 0.3]), 0.2))
    assert np.isnan(settling_time(time, np.full(5, np.nan), 0.2))


@pytest.mark.parametrize("feed", [0.025, 0.05, 5.0])
def test_a_ramp_keeps_feed_and_acceleration_and_covers_its_way(feed: float) -> None:
    x, h = ramp(feed, TRIAL), TRIAL.period
    v, a = np.diff(x) / h, np.diff(x, 2) / h**2
    peak = min(feed, np.sqrt(0.1))
    assert x[0] == 0 and x[-1] == pytest.approx(0.1, rel=1e-12)
    assert v.max() == pytest.approx(peak, abs=1.0 * h) and v.min() > -1e-9
    assert np.abs(a).max() < 1 + 1e-3
    moving = np.argmax(x > 0.1 - 1e-12) * h
    assert moving == pytest.approx(0.1 / peak + peak / 1.0, abs=0.002)


def test_an_axis_of_three_thousandths_and_a_motor_of_its_catalogue() -> None:
    axis, motor = servo_axis(), servo_motor()
    assert motor.inertia + axis.transmission.load_inertia == pytest.approx(0.003, rel=1e-3)
    # rated and greatest torque of the catalogue at 12.7 and 42 effective amperes; within 10 %
    for effective, rated in ((12.7, 6.36), (42 * 0.84, 19.1)):
        assert motor.torque_constant * effective * 2**0.5 == pytest.approx(rated, rel=0.1)


def test_no_speed_loop_beats_the_torque_limit() -> None:
    """98 % of the speed takes at least J w / T_max, whatever the gains."""
    fastest = 0.98 * 0.003 * TRIAL.speed / 19.1
    for values in ([0.5, 40], [5, 400], [10, 4000]):
        found = step_response(with_speed_loop(servo_axis(rigid=True), "PI", values), TRIAL)
        assert not found.settling_2 < fastest


def test_both_kinds_are_asked_as_often_and_hold_the_cheapest() -> None:
    axis = servo_axis(rigid=True)
    for kind in TUNED:
        search = Corner()
        loop = tuned(axis, kind, SHORT, search).speed_loop
        assert search.asked == 3
        bounds = list(TUNED[kind].values())
        assert loop.proportional == pytest.approx(10 ** search.x[0])
        assert bounds[1][0] <= loop.integral * (1 + 1e-12) <= bounds[1][1] * (1 + 1e-9)
        assert (loop.fuzzy is None) == (kind == "PI")
        # nothing but the speed loop has changed
        assert replace(tuned(axis, kind, SHORT, search), speed_loop=axis.speed_loop) == axis


def test_published_gains_fill_the_rules_inputs() -> None:
    axis = servo_axis(rigid=True)
    assert published(axis, "PI", TRIAL).tolist() == [0.5, 40]
    fuzzy = with_speed_loop(axis, "fuzzy PI", published(axis, "fuzzy PI", TRIAL)).speed_loop.fuzzy
    assert fuzzy.error_scale * 1000 * RPM == pytest.approx(10)
    # 19.1 N m on 0.003 kg m^2
    assert fuzzy.change_scale * 19.1 / 0.003 == pytest.approx(10, rel=1e-3)


def test_the_speed_loop_does_not_show_in_the_error_without_feed_forward() -> None:
    """v / K_v is the position loop's: no tuning of what stands inside it changes that."""
    axis = servo_axis()
    for kind in TUNED:
        drive = with_speed_loop(axis, kind, published(axis, kind, TRIAL))
        for feed in TRIAL.feeds:
            error = ramp_error(drive, feed, TRIAL, feedforward=0.0, direction=1)
            assert error == pytest.approx(feed / 40, rel=2e-3)


def test_the_table_has_a_row_for_each_and_says_its_units() -> None:
    table = compare_speed_loops(servo_axis(rigid=True), SHORT)
    assert list(table.index) == [
        ("Feed2025", kind, direction) for kind in ("PI", "fuzzy PI") for direction in (-1, 1)
    ]
    assert all(name.endswith("]") for name in table.columns)
    assert "error at 3000 mm/min, feed-forward 1 [mm]" in table.columns
    one = step_response(servo_axis(rigid=True), SHORT)
    assert table.loc[("Feed2025", "PI", 1), "overshoot [%]"] == 100 * one.overshoot


NAME = "02_does_a_fuzzy_speed_loop_help.ipynb"
SAID = (
    "[table['cost [mrad s]'].groupby(level=['gains', 'speed loop']).sum().to_list(),"
    " change.loc['error at 1500 mm/min, feed-forward 0 [mm]'].to_list(), 1e3 * fastest]"
)


BUDGET = "population=16, generations=10"
"""The notebook's search; a shorter one stands in its place in the ordinary suite."""


def assert_no_difference(costs: list[float], lag: list[float], fastest: float) -> None:
    pi, fuzzy, tuned_pi, tuned_fuzzy = costs
    assert tuned_pi < 0.5 * pi and tuned_fuzzy < 0.5 * fuzzy
    assert tuned_fuzzy == pytest.approx(tuned_pi, rel=0.05)
    assert lag == pytest.approx([0, 0], abs=0.2)
    # J w / T_max by hand: 0.003 kg m^2, 104.72 rad/s, 19.1 N m
    assert fastest == pytest.approx(16.45, abs=0.05)


def test_the_notebooks_cells_find_no_difference_once_both_are_tuned() -> None:
    plt.switch_backend("agg")
    cells = nbformat.read(ROOT / "notebooks" / NAME, as_version=4).cells
    source = "\n".join(cell.source for cell in cells if cell.cell_type == "code")
    assert BUDGET in source
    names: dict[str, Any] = {}
    exec(source.replace(BUDGET, "population=6, generations=3"), names)
    figures = plt.get_fignums()
    plt.close("all")
    assert len(figures) == 1
    assert_no_difference(*eval(SAID, names))


@pytest.mark.proof
def test_the_notebook_finds_no_difference_once_both_are_tuned(tmp_path: Path) -> None:
    outputs, found = executed(tmp_path, NAME, SAID)
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
    assert images(outputs) == 1
    assert_no_difference(*found)
