"""A known control is found from polled logs; what a program does not excite is not made up."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.gcode.moves import Kind
from pipeline.submodels.control.fit import ControlFitSettings, identify_control, planned
from pipeline.submodels.control.parameters import BY_UNIT, control_of, expected, free_parameters
from pipeline.submodels.control.segments import observe, rapid_rates
from tests.submodels.control.part_programs import (
    axis,
    change,
    circles,
    exciting,
    long_cuts,
    moves_of,
    rapids,
    start,
    truth,
)
from tests.submodels.control.polled_logs import ALONE, Operated, logged_runs, polled_log

SETTINGS = ControlFitSettings()
TWICE = (ALONE, ALONE)
"""Every program is run twice, as shops do."""


@pytest.fixture(scope="module")
def part(tmp_path_factory):
    return moves_of(exciting(), tmp_path_factory.mktemp("programs"))


def logged(moves, folder, seed, plays=TWICE, control=None, unit=""):
    """Segments of runs of one program."""
    rng = np.random.default_rng(seed)
    found = []
    for play in plays:
        log = polled_log(moves, control or truth(), rng, play, begin=3.0)
        [run] = logged_runs(folder / "log.parquet", log)
        found.append(observe(run, "part", moves, unit, SETTINGS.shortest_s))
    return found


def true_values(fit, control=None):
    units = {unit for one in fit.free for unit in one.units}
    return np.array([f.start for f in free_parameters(control or truth(), sorted(units))])


def named(fit):
    """Value, low, high by name, of what was determined."""
    rows = zip(fit.free, fit.values, fit.low, fit.high, fit.determined, strict=True)
    return {one.name: (v, low, high) for one, v, low, high, known in rows if known}


@pytest.fixture(scope="module")
def found(part, tmp_path_factory):
    return identify_control(logged(part, tmp_path_factory.mktemp("log"), 0), start(), SETTINGS)


@pytest.mark.parametrize(
    ("name", "share"),
    [
        ("rapid_speed X", 0.002), ("rapid_speed Y", 0.002), ("rapid_speed Z", 0.002),
        ("rapid_acceleration XY", 0.3), ("rapid_acceleration Z", 0.3),
        ("cutting_acceleration XYZ", 0.1), ("arc_acceleration XYZ", 0.15),
        ("corner_jump XYZ", 0.1), ("tool_change", 0.02), ("m_code", 0.1), ("stop", 0.1),
        ("spindle_acceleration", 0.1), ("spindle_deceleration", 0.1), ("spindle_base_speed", 0.15),
    ],
)  # fmt: skip
def test_a_known_control_is_found(found, name, share):
    """Shares are twice what a poll's error over the 270 segments leaves, from 20 repetitions."""
    place = [one.name for one in found.free].index(name)
    value, low, high = named(found)[name]
    assert value == pytest.approx(true_values(found)[place], rel=share)
    assert low < value < high


def test_the_residuals_are_those_of_polling(found):
    """Two ends, each late by a uniform share of 0.15 s: sqrt(2 / 12) x 0.15 = 0.061 s."""
    assert found.rmse_s == pytest.approx(0.061, rel=0.15)
    assert found.determined.all() and covered(found).mean() >= 0.8
    assert [one.key for one, told in zip(found.free, found.from_speeds, strict=True) if told] == [
        "rapid_speed"
    ] * 3


def test_the_times_of_a_run_that_was_not_learnt_from_are_predicted(found, part, tmp_path):
    [other] = logged(part, tmp_path, 77, [Operated(feed={0: 70.0}, rapid={0: 50.0})])
    predicted = planned(other, found.control[""]).sum()
    assert predicted == pytest.approx(other.measured.sum(), rel=0.003)
    known = [i for i, one in enumerate(found.free) if not one.axes]
    assert np.isfinite(found.values[known]).all()


def covered(fit):
    """Of the determined parameters, those whose interval holds the truth."""
    return ((fit.low <= true_values(fit)) & (true_values(fit) <= fit.high))[fit.determined]


@pytest.mark.proof
def test_intervals_cover_the_truth(part, tmp_path):
    """Of 20 seeds x 15 parameters nine in ten at least: 95 % intervals, less a margin of chance."""
    held = np.concatenate([
        covered(identify_control(logged(part, tmp_path, seed), start(), SETTINGS))
        for seed in range(20)
    ])  # fmt: skip
    assert len(held) >= 0.95 * 20 * 15
    assert held.mean() >= 0.9


UNEXCITED = {
    "rapids alone": (
        [*rapids((20, 300, 60, 500)), *rapids((150, 40))],
        {"corner_jump XYZ", "arc_acceleration XYZ", "cutting_acceleration XYZ", "tool_change",
         "spindle_acceleration", "spindle_base_speed", "m_code", "stop"},
    ),
    "one spindle speed": (
        [line for tool in range(1, 8) for line in (*change(tool, 4000), *long_cuts((900, 1500)))],
        {"spindle_base_speed", "arc_acceleration XYZ"},
    ),
    "no corner": (
        [*change(1, 3000), *circles(10, (1500, 3000, 6000)), *rapids((100, 300))],
        {"corner_jump XYZ"},
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "case",
    ["rapids alone", pytest.param("one spindle speed", marks=pytest.mark.proof), "no corner"],
)
def test_what_a_program_does_not_excite_is_not_determined(case, tmp_path):
    text, not_excited = UNEXCITED[case]
    moves = moves_of(["%", "G21 G90 G94", *text, "M30", "%"], tmp_path)
    fit = identify_control(logged(moves, tmp_path, 4), start(), SETTINGS)
    assert not not_excited & named(fit).keys()
    begin = {one.name: one.start for one in fit.free}
    places = [i for i, one in enumerate(fit.free) if one.name in not_excited]
    assert np.isnan(fit.low[places]).all() and np.isnan(fit.high[places]).all()
    unfelt = [i for i in places if fit.free[i].name != "spindle_base_speed"]
    for i in unfelt:
        assert fit.values[i] == pytest.approx(begin[fit.free[i].name], rel=0.5, abs=1e-9)


def of_kind(**limits):
    """A mill like the others of its kind but for ``limits`` of its axes."""
    return replace(truth(), axes={a: replace(x, **limits) for a, x in truth().axes.items()})


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """Programs of a minute: one with arcs and tools, one of rapids and tools."""
    folder = tmp_path_factory.mktemp("few")
    idle = [*change(1, 6000), *rapids((30, 300, 60, 150))]
    cuts = [*circles(4, (2400, 4800, 9000) * 8), *long_cuts((900, 4000, 2000, 6000))]
    text = {"cuts": [*idle, *cuts] * 4, "idle": idle * 8}
    return {
        name: moves_of(["%", "G21 G90 G94", *lines, "M30", "%"], folder, name)
        for name, lines in text.items()
    }


def test_what_units_share_is_found_by_unit_where_they_differ_or_one_does_not_excite_it(
    few, tmp_path
):
    """Arcs at 400 and 1000 mm/s^2, and a third mill that cuts nothing."""
    other = of_kind(arc_acceleration=1000.0, rapid_speed=12000.0)
    fit = identify_control(
        [
            *logged(few["cuts"], tmp_path, 1, [ALONE], unit="one"),
            *logged(few["cuts"], tmp_path, 2, [ALONE], control=other, unit="two"),
            *logged(few["idle"], tmp_path, 3, [ALONE], unit="three"),
        ],
        start(), replace(SETTINGS, scales_s=(0.2,), evaluations=3),
    )  # fmt: skip
    values = {name: one[0] for name, one in named(fit).items()}
    assert values["rapid_speed X@one"] == pytest.approx(24000, rel=0.002)
    assert values["rapid_speed X@two"] == pytest.approx(12000, rel=0.002)
    assert values["arc_acceleration XYZ@one"] == pytest.approx(400, rel=0.15)
    assert values["arc_acceleration XYZ@two"] == pytest.approx(1000, rel=0.15)
    assert "tool_change" in values
    lent = [one.name for one in fit.free].index("arc_acceleration XYZ@three")
    assert not fit.determined[lent]
    assert fit.lenders(lent) == ["one", "two"]
    # between those of the others, and as uncertain as machines of a kind are unlike
    slow, fast = (end.axes["X"].arc_acceleration for end in fit.ends["three"])
    assert slow < 400 < fit.control["three"].axes["X"].arc_acceleration < 1000 < fast


@pytest.mark.proof
def test_pairs_that_differ_in_one_shared_parameter_are_found_so(part, tmp_path):
    """By unit in 9 of 10 pairs, within two half widths of the truth in as many; 9 of 10 alike stay.

    Two, since the weak pull to the start counts where a unit is four times slower than that.
    """
    rng = np.random.default_rng(11)
    keys = ("cutting_acceleration", "arc_acceleration", "rapid_acceleration")
    found, inside, together = 0, 0, 0
    for seed in range(18):
        key, factor = keys[seed % 3], float(rng.choice([0.4, 2.5]))
        other = of_kind(**{key: factor * getattr(truth().axes["X"], key)})
        own = logged(part, tmp_path, seed, unit="one")
        pair = identify_control(
            [*own, *logged(part, tmp_path, 90 + seed, control=other, unit="two")],
            start(), SETTINGS,
        )  # fmt: skip
        mine = [k for k, one in enumerate(pair.free) if one.key == key and one.units == ("two",)]
        found += bool(mine)
        true = getattr(other.axes["X"], key)
        if mine and pair.determined[mine[0]]:
            value, low, high = (float(x[mine[0]]) for x in (pair.values, pair.low, pair.high))
            inside += value * (low / value) ** 2 < true < value * (high / value) ** 2
        else:
            inside += bool(mine)
        alike = identify_control(
            [*own, *logged(part, tmp_path, 50 + seed, unit="two")], start(), SETTINGS
        )
        together += not [one for one in alike.free if one.units and one.key not in BY_UNIT]
    assert found >= 16
    assert inside >= 16
    assert together >= 16


@pytest.mark.proof
@pytest.mark.parametrize("seed", range(6))
def test_a_mill_that_cut_nothing_takes_cutting_from_the_other(part, few, tmp_path, seed):
    fit = identify_control(
        [
            *logged(part, tmp_path, seed, unit="one"),
            *logged(few["idle"], tmp_path, 70 + seed, control=of_kind(arc_acceleration=900.0),
                    unit="two"),
        ],
        start(), SETTINGS,
    )  # fmt: skip
    for name in ("arc_acceleration XYZ", "cutting_acceleration XYZ"):
        lent = [one.name for one in fit.free].index(f"{name}@two")
        assert not fit.determined[lent]
        assert fit.lenders(lent) == ["one"]
    slow, fast = (end.axes["X"].arc_acceleration for end in fit.ends["two"])
    assert slow < fit.control["one"].axes["X"].arc_acceleration < 900 < fast


def test_rapid_rates_are_read_at_any_override(part, tmp_path):
    for percent in (25.0, 50.0, 100.0):
        told = rapid_rates(logged(part, tmp_path, 6, [Operated(rapid={0: percent})]))
        for letter, rate in told.items():
            true = truth().axes[letter].rapid_speed
            assert rate.low <= true <= rate.high
        assert "X" in told


def test_a_line_of_several_rapids_tells_no_rate(tmp_path):
    """Drilling: over the hole, then down to R, in one line; no poll tells which of them it saw."""
    holes = [f"G81 X{400 * (k % 2)} Z-5 R100 F5000" for k in range(1, 9)]
    moves = moves_of(["G21 G90 G94 G98", *holes, "G80", "M30"], tmp_path)
    assert (np.bincount(moves.line[moves.kind == Kind.RAPID]) > 1).any()
    assert rapid_rates(logged(moves, tmp_path, 3)) == {}


def test_waits_that_the_log_does_not_tell_are_outliers(found, part, tmp_path):
    """Half a minute in each of three stretches, while the control says that it is active."""
    clean = logged(part, tmp_path, 0)
    waited = clean[0].measured.copy()
    waited[[20, 60, 100]] += 30.0
    fit = identify_control([replace(clean[0], measured=waited), clean[1]], start(), SETTINGS)
    undisturbed = named(found)
    assert named(fit).keys() >= undisturbed.keys() - {"rapid_acceleration XY"}
    for name in ("tool_change", "m_code", "cutting_acceleration XYZ", "spindle_acceleration"):
        value, low, high = undisturbed[name]
        assert abs(named(fit)[name][0] - value) < high - low


def test_a_parameter_that_no_machine_has_is_not_determined(part, tmp_path):
    """Slower than what the search allows: it ends at its bound, which is no value."""
    lame = replace(
        truth(), axes={a: replace(x, cutting_acceleration=12.0) for a, x in truth().axes.items()}
    )
    fit = identify_control(logged(part, tmp_path, 1, control=lame), start(), SETTINGS)
    assert "cutting_acceleration XYZ" not in named(fit)


def test_without_a_run_there_is_one_sentence(part, tmp_path):
    with pytest.raises(ValueError, match=r"^no run of a program is there .*: put logs"):
        identify_control([], start(), SETTINGS)


def test_runs_that_determine_nothing_are_told_so(tmp_path):
    moves = moves_of(["G21 G94 G90", "G1 X10 F600", "G1 X20", "M30"], tmp_path)
    with pytest.raises(ValueError, match=r"^\d+ stretches of 1 runs determine no parameter"):
        identify_control(logged(moves, tmp_path, 8, [ALONE]), start(), SETTINGS)


def test_free_parameters_and_their_values_make_the_control_again():
    free = free_parameters(truth(), ["a", "b"])
    values = np.array([one.start for one in free])
    lost = replace(start(), axes={letter: axis() for letter in "XYZ"}, settle_time=1.0)
    again = control_of(lost, free, values, "a")
    assert again.axes == truth().axes
    assert again.settle_time == truth().settle_time
    for name in ("tool_change", "m_code", "stop", "spindle_acceleration", "spindle_base_speed"):
        assert getattr(again.auxiliary, name) == getattr(truth().auxiliary, name)
    assert all(one.coordinate(one.value(0.3)) == pytest.approx(0.3) for one in free)
    assert all(one.low <= one.start <= one.high for one in free)


def test_a_lathe_without_y_has_no_y_to_find():
    two = replace(truth(), axes={"X": axis(), "Z": axis()})
    names = [one.name for one in free_parameters(two, [""])]
    assert "rapid_speed X" in names and "rapid_acceleration X" in names
    assert not any("Y" in name for name in names)
    assert "corner_jump XZ" in names


@pytest.mark.parametrize(
    ("name", "value"),
    [("step", 0.0), ("loose_s", -1.0), ("evaluations", 0), ("shortest_s", float("nan")),
     ("widest", 0.0), ("scales_s", (0.2, 0.0)), ("scales_s", ())],
)  # fmt: skip
def test_settings_out_of_range_are_refused_by_name(name, value):
    with pytest.raises(ValueError, match=rf"^control_fit.{name} "):
        ControlFitSettings(**{name: value})


def test_what_is_not_determined_lies_near_what_is_of_its_kind():
    """A rapid that one machine has not shown, beside 27, 29 and 30 m/min and a brochure's 30."""
    free = free_parameters(start(), ["one", "two"])
    names = [one.name for one in free]
    values = np.array([one.start for one in free])
    determined = np.zeros(len(free), dtype=bool)
    for name, value in (
        ("rapid_speed X@one", 27000.0), ("rapid_speed Y@one", 29000.0),
        ("rapid_speed Z@two", 30000.0), ("corner_jump XYZ@one", 80.0),
    ):  # fmt: skip
        values[names.index(name)], determined[names.index(name)] = value, True
    centre, half_width = expected(free, values, determined)
    rapid, jump = names.index("rapid_speed Y@two"), names.index("corner_jump XYZ@two")
    assert np.exp(centre[rapid]) == pytest.approx((27e3 * 29e3 * 30e3 * 30e3) ** 0.25)
    assert half_width[rapid] < 0.2  # four that lie within 10 % of each other
    assert np.exp(centre[jump]) == pytest.approx(np.sqrt(80 * 500))  # that and the start's
    assert half_width[jump] == 1.0  # a factor e of two
