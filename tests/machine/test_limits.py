"""On random programs no axis passes its limits, no corner its tolerance, and every end is met.

Assessed by finite differences of the sampled positions: a mean of the true derivative over a few
periods cannot be greater than its bound.
"""

import numpy as np
import pytest

from pipeline.gcode.moves import Kind
from pipeline.machine.control.interpolate import trace
from pipeline.machine.control.planner import limited_path, plan
from tests.machine.random_programs import PERIOD, bounds, deviation, random_control, random_moves

ROUNDING = 1e-6  # third differences of positions: 1e-17 m / PERIOD^3 against jerks of 100 m/s^3


def filtered_acceleration(bound, filters):
    return bound.acceleration + bound.jump / max(filters)


def filtered_jerk(bound, filters):
    return 2 * filtered_acceleration(bound, filters) / min(filters)


class SampledProgram:
    """A sampled program: derivatives of X, Y, Z in SI, and where rapids may still show."""

    def __init__(self, seed, *, corner, profile="trapezoid", filters=True, spirals=False):
        rng = np.random.default_rng(seed)
        self.control = random_control(rng, corner=corner, profile=profile, filters=filters)
        self.moves = random_moves(rng, spirals=spirals)
        self.plan = plan(limited_path(self.moves, self.control))
        self.trace = trace(self.plan, period=PERIOD)
        self.speed = np.diff(self.trace.position[:, :3], axis=0) / PERIOD
        self.filters = self.control.cutting_filter, self.control.rapid_filter
        self.limits = bounds(self.control, rapid=False), bounds(self.control, rapid=True)
        self.lag = int(max(map(sum, self.filters)) / PERIOD) + 5

    def rapid(self, window=0):
        """Samples in which a rapid may show, by the filters or a window before them."""
        rapid = (self.moves.kind == Kind.RAPID)[self.trace.row]
        return np.convolve(rapid, np.ones(self.lag + window))[: len(rapid)] > 0.5

    def limit(self, of, window=0):
        cutting, rapid = (of(b, f) for b, f in zip(self.limits, self.filters, strict=True))
        return np.where(self.rapid(window)[:, None], np.maximum(cutting, rapid), cutting)

    def check_end(self):
        end = self.moves.end[-1] * ([1e-3] * 3 + [np.pi / 180] * 3)
        # the last period may cut the filters' tail, a p^2 of some nanometres
        assert np.abs(self.trace.position[-1] - end).max() < 1e-9
        assert np.abs(self.trace.programmed[-1] - end).max() < 1e-12

    def check_speed(self):
        assert (np.abs(self.speed) <= self.limit(lambda b, f: b.speed)[1:] * (1 + ROUNDING)).all()

    def check_acceleration(self):
        found = np.abs(np.diff(self.speed, axis=0)) / PERIOD
        assert (found <= self.limit(filtered_acceleration)[2:] * (1 + ROUNDING)).all()

    def check_jerk(self):
        if min(*self.filters[0], *self.filters[1]) > 0:
            found = np.abs(np.diff(self.speed, n=2, axis=0)) / PERIOD**2
            assert (found <= self.limit(filtered_jerk)[3:] * (1 + ROUNDING)).all()

    def check_jumps(self):
        """Without filters: over any window the speed changes by a T + dV at most."""
        for samples in (1, 7, 40, 200):
            change = np.abs(self.speed[samples:] - self.speed[:-samples])
            window = samples * PERIOD
            allowed = self.limit(
                lambda b, _, window=window: b.acceleration * window + b.jump, samples
            )
            assert (change <= allowed[1 + samples :] * (1 + ROUNDING)).all()

    def check_tolerance(self):
        keep = np.ones(len(self.trace), bool)
        if self.control.rapid_mode == "independent":
            keep = ~self.rapid()  # these do not follow a line
        points = self.trace.position[keep, :3][::3] * 1e3
        if len(points):
            # the straight line between samples cuts arcs by v^2 kappa p^2 / 8 < 0.02 um
            assert deviation(points, self.moves).max() <= self.control.tolerance + 2e-5


def check_limits(seeds, **options):
    for seed in seeds:
        program = SampledProgram(seed, **options)
        try:
            program.check_end()
            program.check_speed()
            if options.get("filters", True):
                program.check_acceleration()
                program.check_jerk()
            else:
                program.check_jumps()
            if options["corner"] == "tolerance":
                program.check_tolerance()
        except AssertionError as error:
            raise AssertionError(f"program {seed}, {options}: {error}") from error


def few_and_many(few, many):
    """Some programs in the ordinary suite, all the others as proof."""
    return pytest.mark.parametrize(
        "seeds",
        [
            pytest.param(range(few), id="few"),
            pytest.param(range(few, many), id="many", marks=pytest.mark.proof),
        ],
    )


@few_and_many(12, 120)
@pytest.mark.parametrize("profile", ["trapezoid", "s_curve"])
@pytest.mark.parametrize("corner", ["jump", "tolerance"])
def test_filtered_commands_keep_all_limits(corner, profile, seeds):
    check_limits(seeds, corner=corner, profile=profile)


@few_and_many(15, 200)
@pytest.mark.parametrize("profile", ["trapezoid", "s_curve"])
def test_without_filters_jumps_stay_within_their_budget(profile, seeds):
    check_limits(seeds, corner="jump", filters=False, profile=profile)


@few_and_many(12, 100)
def test_helices_and_spirals_keep_the_axes_limits(seeds):
    check_limits(seeds, corner="jump", spirals=True)
    check_limits(seeds, corner="jump", spirals=True, filters=False)


@pytest.mark.slow
@pytest.mark.proof
@pytest.mark.parametrize("part", range(5))
def test_ten_thousand_programs(part):
    each = range(part * 500, (part + 1) * 500)
    check_limits(each, corner="tolerance")
    check_limits(each, corner="tolerance", profile="s_curve")
    check_limits(each, corner="jump")
    check_limits(each, corner="jump", filters=False)
