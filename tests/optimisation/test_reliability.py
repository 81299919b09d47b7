"""Feeds that keep a limit with a given certainty; forces of each tool with their intervals."""

from dataclasses import asdict, replace
from itertools import product
from unittest import mock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, norm

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.profile_kernel import look_up
from pipeline.cutting.force.waveform import profile_waveform
from pipeline.cutting.tool import Tool
from pipeline.optimisation.reliability.chance_constraint import (
    PartLoads,
    aimed_share,
    chance_constrained_feeds,
    clopper_pearson,
    exceedance,
    quantiles,
    share_above,
)
from pipeline.optimisation.reliability.part_loads import (
    _sobol,
    critical,
    cut_ranges,
    deeper,
    draws_of,
    force_intervals,
    nodes_between,
    responses,
)
from pipeline.optimisation.reliability.uncertainty import uncertainty
from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.schema.program_cut import ForceInterval
from pipeline.twin.cut.coefficients import ToolCoefficients
from pipeline.twin.cut.loads import Cut
from tests.twin.cut_parts import SLOT, cut_of, pocket

LIMIT = 100.0
ONLY = ForceLaw(K_tc=1.2e9, K_rc=0.0)
EDGES = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=15.0, K_re=12.0, K_ae=2.0)
SURE = ReliabilitySettings(runout_um=0.0, depth_um=0.0, model=0.0, measured_elsewhere=0.0)
TWO = SLOT.replace("M30", "T2 M6\nG0 X-10 Y10 S8000 M3\nG1 Z-2 F300\nX70\nG0 Z5\nM30")
HELICAL = Tool(kind="flat", diameter_mm=10.0, flutes=3, helix_deg=30.0)


def known(cut, certainty, *, kind="measured", sources=None):
    laws = {
        number: ToolCoefficients(
            law=law, kind=kind, source="one" if sources is None else sources[number]
        )
        for number, law in zip(cut.numbers, cut.force_laws, strict=True)
    }
    tools = dict(zip(cut.numbers, cut.tools, strict=True))
    return uncertainty(laws, tools, None, None, certainty)


def of_all(cut, limit=LIMIT):
    """One load limit for all tools."""
    return np.full(len(cut.tools), limit)


def feeds(cut, certainty, limit=LIMIT, **others):
    known_of = known(cut, certainty, **others)
    return chance_constrained_feeds(cut, of_all(cut, limit), 0.0, known_of, certainty)


def risk(cut, f_z, certainty, seed, limit=LIMIT):
    """Probability of passing the limit at feeds for each tooth (M,)."""
    return exceedance(cut, f_z, of_all(cut, limit), known(cut, certainty), certainty, seed)


def slot_of(cut) -> int:
    """The row of the slot itself."""
    return int(np.argmax(cut.block_loads.peak))


@pytest.fixture(scope="module")
def slot():
    return cut_of(SLOT, laws={1: ONLY, 2: ONLY})


@pytest.fixture(scope="module")
def milled():
    return cut_of(pocket(), tools={1: HELICAL}, laws={1: EDGES})


class TestClosedForms:
    """One thing is uncertain, and a load is proportional to it."""

    @pytest.mark.parametrize("epsilon", [0.2, 0.05, 0.01, 0.003])
    @pytest.mark.parametrize("what", ["measured_elsewhere", "model"])
    def test_a_coefficient_or_the_model(self, slot, what: str, epsilon: float):
        """f_z = limit / (a_p K (1 + s q)), q the quantile of a normal distribution."""
        row, spread, many = slot_of(slot), 0.1, 4096
        found = feeds(slot, replace(SURE, epsilon=epsilon, draws=many, **{what: spread}))
        q = norm.ppf(1 - aimed_share(epsilon, many))
        chance = np.sqrt(epsilon * (1 - epsilon) / many) / norm.pdf(q)  # of a sample's quantile
        assert found.f_z[row] / found.nominal[row] == pytest.approx(
            1 / (1 + spread * q), rel=3 * chance * spread
        )
        # a tooth that stands 2.5 degrees beside a bin's middle
        assert found.nominal[row] == pytest.approx(LIMIT / (2e-3 * ONLY.K_tc), rel=2e-3)

    def test_the_depth(self, slot):
        """a_p + d in place of a_p, as the forces of a slot without edge terms are."""
        row = slot_of(slot)
        found = feeds(slot, replace(SURE, depth_um=100.0))
        assert found.f_z[row] / found.nominal[row] == pytest.approx(
            1 / (1 + 0.1 / 2.0 * norm.ppf(1 - aimed_share(0.01, 1024))), rel=0.01
        )

    def test_runout_of_two_teeth_in_a_slot(self, slot):
        """Across the feed one tooth takes f_z + 2 r |cos|, up to 2 f_z where the other misses.

        With both across at once the greatest chip is f_z + 2 |x|, x the offset's part along them,
        normal of 3 um.
        """
        row = slot_of(slot)
        found = feeds(slot, replace(SURE, runout_um=3.0, epsilon=0.05))
        f_z = found.nominal[row] - 2 * 3e-6 * norm.ppf(1 - aimed_share(0.05, 1024) / 2)
        assert found.f_z[row] == pytest.approx(f_z, rel=0.02)

    def test_independent_tools_share_the_risk(self):
        """Two slots, each of its own source: (1 - e)^2 of the draws may pass in neither."""
        both = cut_of(TWO, laws={1: ONLY, 2: ONLY})
        spread = replace(SURE, measured_elsewhere=0.1, epsilon=0.05, draws=4096)
        apart = feeds(both, spread, sources={1: "one", 2: "other"})
        share = aimed_share(0.05, 4096)
        assert apart.level == pytest.approx(np.sqrt(1 - share), abs=4e-3)
        # of one source both are too high in the same draws, but for a fifth of the variance
        together = feeds(both, spread)
        assert 1 - share <= together.level < apart.level
        assert (together.f_z >= apart.f_z).all()

    def test_twice_the_limit_of_a_tool_is_twice_its_feed(self):
        """Loads are proportional to the feed: each over its limit is as likely as before."""
        both = cut_of(TWO, laws={1: ONLY, 2: ONLY})
        spread = replace(SURE, measured_elsewhere=0.1, epsilon=0.05, draws=1024)
        drawn = known(both, spread)
        one, two, free = (
            chance_constrained_feeds(both, LIMIT * np.array([1.0, times]), 0.0, drawn, spread).f_z
            for times in (1.0, 2.0, np.inf)
        )
        first, second = (both.tool == index for index in (0, 1))
        assert two[first] == pytest.approx(one[first], rel=1e-3)
        assert two[second] == pytest.approx(2 * one[second], rel=1e-3)
        assert np.isinf(free[second]).all() and (free[first] >= one[first]).all()
        limits = LIMIT * np.array([1.0, 2.0])
        risk = exceedance(both, np.where(np.isinf(two), 0.0, two), limits, drawn, spread, 7)
        assert risk.interval_95[0] <= 0.05 <= 2 * risk.interval_95[1]


@pytest.mark.parametrize("epsilon", [0.02, pytest.param(0.1, marks=pytest.mark.proof)])
def test_the_share_of_draws_that_pass_is_epsilon_at_most(milled, epsilon: float):
    """Judged by other draws; all of coefficients, runout, depth and model are uncertain."""
    certainty = ReliabilitySettings(epsilon=epsilon)
    found = feeds(milled, certainty)
    other = risk(milled, found.f_z, replace(certainty, draws=4096), 77)
    assert other.interval_95[0] <= epsilon
    assert other.probability > epsilon / 3  # and no more is given away than draws leave open
    assert found.share <= epsilon
    assert other.interval_95[0] <= other.probability <= other.interval_95[1]
    assert other.peak_quantiles[0.5] < LIMIT
    if epsilon < 0.05:
        assert other.peak_quantiles[0.95] < LIMIT


@pytest.mark.parametrize(
    ("seeds", "draws", "most"), [(3, 2048, 1), pytest.param(12, 8192, 2, marks=pytest.mark.proof)]
)
def test_epsilon_is_kept_whatever_the_seed(milled, seeds: int, draws: int, most: int):
    """Of 20 seeds one may pass it; aiming at epsilon itself, eight of the first twelve did."""
    certainty = ReliabilitySettings(epsilon=0.05, draws=128)
    judge = replace(certainty, draws=draws)
    passed = [
        risk(milled, feeds(milled, replace(certainty, seed=seed)).f_z, judge, 77).probability
        for seed in range(seeds)
    ]
    assert (np.array(passed) > certainty.epsilon).sum() <= most


def test_at_nominal_feeds_half_of_the_draws_or_more_pass(milled):
    certainty = ReliabilitySettings(runout_um=0.0)
    nominal = feeds(milled, replace(certainty, epsilon=0.5)).nominal
    assert risk(milled, nominal, certainty, 3).probability > 0.45


def test_epsilon_of_a_half_is_the_nominal_feed(milled):
    found = feeds(milled, ReliabilitySettings(epsilon=0.5))
    cutting = np.isfinite(found.nominal)
    assert np.array_equal(found.f_z, found.nominal)
    assert found.level == 0.5
    # where the table says the limit
    loads = milled.table.peaks(np.where(cutting, found.nominal, 0.0))
    assert loads[cutting] == pytest.approx(np.full(cutting.sum(), LIMIT))
    assert np.array_equal(cutting, milled.block_loads.peak > 1.0)  # the plunge is balanced


def test_without_anything_uncertain_feeds_are_nominal(milled):
    found = feeds(milled, SURE)
    assert found.f_z == pytest.approx(found.nominal, rel=1e-6)


def test_more_certainty_is_less_feed(milled):
    each = [feeds(milled, ReliabilitySettings(epsilon=e)).f_z for e in (0.4, 0.1, 0.01, 0.001)]
    for more, less in zip(each[1:], each[:-1], strict=True):
        assert (more <= less).all()


def test_a_margin_is_a_lower_limit(milled):
    certainty = ReliabilitySettings()
    one = chance_constrained_feeds(milled, of_all(milled), 0.2, known(milled, certainty), certainty)
    assert np.array_equal(one.f_z, feeds(milled, certainty, limit=0.8 * LIMIT).f_z)


def test_a_limit_below_the_edge_forces_leaves_no_feed(milled):
    found = feeds(milled, ReliabilitySettings(), limit=5.0)
    cutting = np.isfinite(found.nominal)
    assert cutting.any() and not found.f_z[cutting].any()
    still = risk(milled, found.f_z, ReliabilitySettings(), 1, limit=5.0)
    assert still.probability == 0.0 and still.interval_95[0] == 0.0


def test_feeds_that_other_limits_allow(milled):
    """Rows that cannot come near to the limit are not drawn; those that reach it stay as they are.

    What a row cannot reach does not count: the others may have a little more.
    """
    certainty = ReliabilitySettings()
    found = feeds(milled, certainty)
    bound = np.isfinite(found.f_z) & (found.f_z > 0)
    known_of = known(milled, certainty)
    half = np.where(np.arange(len(bound)) % 2, 0.5, 2.0) * np.where(bound, found.f_z, 1e-4)
    for greatest, same in ((np.full(len(bound), 1.0), 1e-12), (half, 0.15)):
        other = chance_constrained_feeds(
            milled, of_all(milled), 0.0, known_of, certainty, greatest=greatest
        )
        reached = bound & (found.f_z < greatest)
        assert reached.any()
        assert other.f_z[reached] == pytest.approx(found.f_z[reached], rel=same)
        assert (other.f_z[bound & ~reached] >= greatest[bound & ~reached] * (1 - 1e-9)).all()
        at = np.minimum(other.f_z, greatest)
        assert risk(milled, at, certainty, 5).interval_95[0] <= certainty.epsilon
    none = chance_constrained_feeds(
        milled, of_all(milled), 0.0, known_of, certainty, greatest=np.full(len(bound), 1e-9)
    )
    assert np.array_equal(none.f_z, none.nominal)


def test_rows_that_are_not_drawn_do_not_count(milled, monkeypatch):
    """The part's peaks are those of all rows, whichever are left out of the draws."""
    certainty = ReliabilitySettings(draws=256)
    at = np.minimum(0.9 * feeds(milled, certainty).f_z, 1e-4)
    few = risk(milled, at, certainty, 3)
    monkeypatch.setattr("pipeline.optimisation.reliability.chance_constraint.FAR", 1e12)
    assert asdict(risk(milled, at, certainty, 3)) == asdict(few)


def test_few_draws_do_not_fail(milled):
    for many in (16, 80, 100):  # 80: halves of 40, whose tail begins where they are settled
        found = feeds(milled, ReliabilitySettings(draws=many))
        assert (found.f_z <= found.nominal).all()


def test_a_tool_of_which_nothing_is_said_is_named(milled):
    nothing = replace(known(milled, ReliabilitySettings()), tools={})
    with pytest.raises(ValueError, match="tool T1 cuts and nothing is said"):
        chance_constrained_feeds(milled, of_all(milled), 0.0, nothing, ReliabilitySettings())


def test_a_program_that_cuts_air_has_no_limit():
    air = cut_of(SLOT.replace("Z-2.0", "Z3"))
    found = feeds(air, ReliabilitySettings())
    assert np.isinf(found.f_z).all()
    assert risk(air, found.f_z, SURE, 0).probability == 0.0


def waveform_peak(cut, station: int, f_z: float, drawn, d: int) -> float:
    """Of one draw, by the waveform of a tool with that runout at that depth."""
    engagement, offset = cut.engagement, drawn.offsets[d]
    tool = replace(
        cut.tools[engagement.tool[station]], runout_um=float(np.hypot(*offset)) * 1e6,
        runout_deg=float(np.degrees(np.arctan2(offset[1], offset[0]))),
    )  # fmt: skip
    names = ("K_tc", "K_rc", "K_ac", "K_te", "K_re", "K_ae")
    law = ForceLaw(**dict(zip(names, drawn.coefficients[d].tolist(), strict=True)))
    lower, upper = (
        one.astype(np.float64) for one in (engagement.lower[station], engagement.upper[station])
    )
    lower, upper = deeper(lower, upper, float(drawn.depth[d]))
    forces = profile_waveform(law, tool, f_z=f_z, lower=lower, upper=upper,
                              angles=np.arange(360) * np.pi / 180)  # fmt: skip
    return float(np.hypot(forces[:, 0], forces[:, 1]).max())


def test_loads_of_draws_are_those_of_the_waveforms_of_all_stations(milled):
    """Everything is drawn at once; no classes, tables, or ratios in what it is compared with."""
    f_z = np.where(milled.tool >= 0, 5e-5, 0.0)
    f_z[milled.block_loads.peak < 1.0] = 0.0
    found, certainty = critical(milled), ReliabilitySettings(draws=16, depth_um=50.0)
    draws = draws_of(known(milled, certainty), 16, 11)
    nodes = nodes_between(*np.full((2, found.classes), 5e-5))
    part = PartLoads(candidates=found, limit=LIMIT, most=f_z[found.row],
                     responses=responses(milled, found, nodes, draws))  # fmt: skip
    peaks = part.peaks(f_z[found.row], slice(0, 16))
    fed = np.flatnonzero((f_z[milled.engagement.block] > 0) & milled.engagement.feed)
    _, first = np.unique(milled.table.station[fed], return_index=True)
    true = [
        max(waveform_peak(milled, s, 5e-5, draws.tools[1], d) for s in fed[first].tolist())
        * draws.model[d] for d in range(16)
    ]  # fmt: skip
    # 3 % is what a class may differ by from its representative, teeth from their angles
    assert peaks == pytest.approx(np.array(true), rel=0.03)
    assert peaks.std() > 0.08 * peaks.mean()


def test_nominal_draws_are_the_load_table(milled):
    """Candidates, one for each class, hold the peak of every row at any feed."""
    found = critical(milled)
    for f_z in (1e-6, 2e-5, 1e-4):
        loads, greatest = np.zeros((1, len(found))), np.zeros(found.rows)
        look_up(np.full((1, len(found)), f_z), found.curve, found.scale, found.exponent, loads)
        np.maximum.at(greatest, found.row, loads[0])
        assert greatest == pytest.approx(milled.table.peaks(np.full(found.rows, f_z)))


def lognormal(many: int, spread: float = 0.1):
    """At equal shares, where the k-th of n draws is expected, k / (n + 1)."""
    return np.exp(spread * norm.ppf((np.arange(many) + 1) / (many + 1)))


@pytest.mark.parametrize("level", [0.0, 1.0, 2.0, 2.5, 3.0, 4.0])
def test_quantiles_of_a_lognormal_go_on_beyond_its_draws(level: float):
    """512 of them end at 3.1 deviations."""
    found = quantiles(lognormal(512)[None, None], level)
    assert found[0, 0] == pytest.approx(np.exp(0.1 * level), rel=5e-3)


@given(many=st.integers(8, 200), level=st.floats(-3, 6), seed=st.integers(0, 1000))
def test_a_higher_level_is_never_less(many: int, level: float, seed: int):
    ordered = np.sort(np.random.default_rng(seed).random((2, many)), axis=1)
    # where draws end and the tail begins it goes on from the same value
    assert (quantiles(ordered, level + 1e-3) >= quantiles(ordered, level) - 1e-12).all()
    assert np.isfinite(quantiles(ordered, level)).all()


def test_constants_are_their_quantiles():
    assert quantiles(np.full((1, 16), 3.0), 5.0) == pytest.approx(3.0)
    assert quantiles(np.zeros((1, 16)), 5.0) == pytest.approx(0.0)


@pytest.mark.parametrize("share", [0.3, 0.02, 1e-3])
def test_the_share_above_a_limit_is_that_of_the_distribution(share: float):
    found = share_above(lognormal(1024), np.exp(0.1 * norm.ppf(1 - share)))
    # Blom's places lie between k / (n + 1) and the medians: a hundredth of a deviation
    assert found == pytest.approx(share, rel=0.1)


def test_a_share_is_never_less_than_what_is_counted():
    """Two far outliers are no lognormal's tail, but they are there."""
    ordered = np.sort(np.concatenate([lognormal(1022), [5.0, 5.0]]))
    assert share_above(ordered, 4.9) >= 2 / 1024
    assert share_above(np.zeros(100), 1.0) == 0.0


@pytest.mark.parametrize("share", [0.3, 0.05, 0.01, 0.002])
def test_a_share_that_was_aimed_at_is_rarely_that_of_a_greater_probability(share: float):
    """1 sample in 20; random ones err more than Sobol's, and counts are of whole draws."""
    random, limit = np.random.default_rng(1), np.exp(0.1 * norm.ppf(1 - share))
    samples = np.exp(0.1 * np.sort(random.standard_normal((400, 512)), axis=1))
    aimed = aimed_share(share, 512)
    found = np.array([share_above(one, limit) for one in samples])
    assert 0 < aimed < share
    assert (found <= aimed).mean() < 0.1


@given(many=st.integers(1, 2000), part=st.floats(0, 1))
def test_an_interval_is_where_the_count_is_not_unlikely(many: int, part: float):
    """At each end what was counted, or more extreme, has a probability of 2.5 %."""
    passed = round(part * many)
    low, high = clopper_pearson(passed, many)
    assert low <= passed / many <= high
    if passed > 0:
        assert binom.sf(passed - 1, many, low) == pytest.approx(0.025, rel=1e-6)
    if passed < many:
        assert binom.cdf(passed, many, high) == pytest.approx(0.025, rel=1e-6)


def test_points_are_kept_and_drawn_again_where_what_is_kept_is_broken(tmp_path, monkeypatch):
    monkeypatch.setenv("KERF_CACHE", str(tmp_path))
    drawn = _sobol(5, 100, seed=3)
    assert drawn.shape == (100, 5) and drawn.min() > 0 and drawn.max() < 1
    with mock.patch("scipy.stats.qmc.Sobol", side_effect=AssertionError):
        assert np.array_equal(_sobol(5, 100, seed=3), drawn)
        assert np.array_equal(_sobol(5, 70, seed=3), drawn[:70])  # of the same power of two
    (kept,) = (tmp_path / "sobol").iterdir()
    for broken in (kept.read_bytes()[:-8], bytes(8 * 5 * 128 - 1) + b"\x7f"):  # short; beyond 1
        kept.write_bytes(broken)
        assert np.array_equal(_sobol(5, 100, seed=3), drawn)
    assert not np.array_equal(_sobol(5, 100, seed=4), drawn)


BEGIN = "T1 M6\nG0 X15 Y25 S6000 M3\nZ1\n"
PROGRAMS = {
    "slot": BEGIN + "G1 Z-2 F200\nX45 F600\nG0 Z5\nM30\n",
    "ramp": BEGIN + "G1 Z0 F200\nX45 Z-2 F600\nX15 Z-4\nG0 Z5\nM30\n",
    "steep ramp": BEGIN + "G1 Z0 F200\nX20 Z-6 F300\nG0 Z5\nM30\n",
    "upwards": BEGIN + "G1 Z-4 F200\nX45 Z-1 F600\nG0 Z5\nM30\n",
    "helix": BEGIN + "G1 Z0 F200\n" + "".join(
        f"G3 X15 Y25 I5 J0 Z-{z} F600\n" for z in (1, 2, 3)) + "G0 Z5\nM30\n",
    "plunge": BEGIN + "G1 Z-6 F200\nG0 Z5\nM30\n",
}  # fmt: skip
MILL = Tool(kind="flat", diameter_mm=10.0, flutes=3, helix_deg=30.0)
TOOLS = {
    "flat": MILL,
    "flat, 6 flutes, known runout": replace(MILL, flutes=6, runout_um=8.0),
    "flat, 1 flute": replace(MILL, flutes=1),
    "bull nose": replace(MILL, kind="bull_nose", corner_radius_mm=2.0, flutes=2),
    "ball": replace(MILL, kind="ball", flutes=4),
    "drill": Tool(kind="drill", diameter_mm=8.0, flutes=2, point_angle_deg=118.0),
    "drill, known runout": Tool(kind="drill", diameter_mm=8.0, flutes=2, runout_um=10.0),
    "chamfer mill": Tool(kind="drill", role="chamfer_mill", diameter_mm=10.0, flutes=4,
                         point_angle_deg=90.0),
}  # fmt: skip


def interval(cut: Cut, certainty: ReliabilitySettings) -> ForceInterval:
    laws = {1: ToolCoefficients(law=EDGES, kind="measured", source="one")}
    uncertain = uncertainty(laws, {1: cut.tools[0]}, None, None, certainty, ranges=cut_ranges(cut))
    (found,) = force_intervals(cut, uncertain, laws, None, seed=0)
    return found


SOME = {
    ("flat", "helix"), ("flat", "plunge"), ("flat, 6 flutes, known runout", "ramp"),
    ("flat, 1 flute", "plunge"), ("bull nose", "steep ramp"), ("ball", "upwards"),
    ("drill", "plunge"), ("drill, known runout", "plunge"), ("chamfer mill", "slot"),
}  # fmt: skip
"""Cases of the ordinary suite; the others are proof."""


@pytest.mark.parametrize(("name", "program"), [
    pytest.param(*case, marks=() if case in SOME else pytest.mark.proof)
    for case in product(TOOLS, PROGRAMS)
])  # fmt: skip
def test_no_load_of_any_tool_on_any_slope_is_outside_of_its_interval(name: str, program: str):
    """In order, and where runout alone is uncertain between the loads without it and with much."""
    cut, far = (
        cut_of(PROGRAMS[program], tools={1: one}, laws={1: EDGES}, resolution=1.0)
        for one in (TOOLS[name], replace(TOOLS[name], runout_um=12.0))
    )
    for certainty in (ReliabilitySettings(), replace(SURE, runout_um=3.0)):
        found = interval(cut, certainty)
        low, peak, high = found.peak_load_low_N, found.peak_load_N, found.peak_load_high_N
        means = found.mean_load_low_N, found.mean_load_N, found.mean_load_high_N
        assert 0.0 <= low <= peak <= high
        assert 0.0 <= means[0] <= means[1] <= means[2]
        assert means[1] <= peak
    assert high <= 1.02 * far.station_loads.peak.max()  # Rayleigh's of 3 um is seldom above 7
    if not TOOLS[name].runout:
        assert low >= 0.98 * cut.station_loads.peak.max()


def test_a_drill_has_the_runout_of_its_draws() -> None:
    """Lips that balance have no load but for runout, which is in the load and in its interval."""
    cut = cut_of(PROGRAMS["plunge"], tools={1: TOOLS["drill"]}, laws={1: EDGES}, resolution=1.0)
    assert cut.station_loads.peak.max() == 0.0
    found = interval(cut, ReliabilitySettings())
    assert found.peak_load_low_N < found.peak_load_N < found.peak_load_high_N
    assert found.runout == "not known, Rayleigh's scale 3 um"
    still = interval(cut, ReliabilitySettings(runout_um=0.0))
    assert (still.peak_load_low_N, still.peak_load_N, still.mean_load_high_N) == (0.0, 0.0, 0.0)
