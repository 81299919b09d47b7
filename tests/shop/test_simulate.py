"""The same bytes each time, other bytes for another seed, and its parameters are checked."""

import json
import subprocess
import sys

import pytest

from pipeline.shop.cutting.records import write_cutting
from pipeline.shop.drives.feed_records import write_feed
from pipeline.shop.growth.parameters import Growth
from pipeline.shop.growth.records import write_growth
from pipeline.shop.parameters import (
    LoggerParameters,
    ShiftParameters,
    ShopParameters,
    SpindleParameters,
)
from pipeline.shop.simulate import simulate
from pipeline.shop.trial.job import write_parts
from pipeline.shop.wear.records import write_wear

from .conftest import (
    NO_CUTS,
    NO_DRIVES,
    NO_GROWTH,
    NO_WEAR,
    digests,
    run,
    shop_parameters,
)

PLAIN = NO_CUTS | NO_DRIVES | NO_GROWTH | NO_WEAR
"""Changes by which the control and the spindle alone write records."""

one_machine = pytest.mark.parametrize(
    "week", ["mill01", pytest.param("mill02", marks=pytest.mark.proof)], indirect=True
)
"""One machine in the ordinary suite, the other one as proof."""


@pytest.mark.proof
@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_a_week_with_all_records_has_the_bytes_of_its_parts(machine, tmp_path):
    """Twice all records, then the cutting tests alone and the week without them."""
    first, again = (run(tmp_path / name, machine, weeks=1) for name in ("first", "again"))
    whole = digests(first.folder)
    assert digests(again.folder) == whole and again.truth == first.truth
    week = run(tmp_path / "week", machine, weeks=1, **NO_CUTS)
    cuts = json.loads(json.dumps(write_cutting(tmp_path / "cuts", first.parameters)))
    write_parts(tmp_path / "cuts", first.parameters)
    assert digests(week.folder) | digests(tmp_path / "cuts") == whole
    different = {k for k in first.truth if first.truth[k] != week.truth[k]}
    assert different == {"cutting", "parameters"} and first.truth["cutting"] == cuts


@one_machine
def test_the_same_bytes_every_time(week, plain_week):
    """Once more, without the servo tool, which none of the other records knows of."""
    whole = digests(week.folder)
    others = {n: h for n, h in whole.items() if not n.startswith(("servo/", "motor/", "shaft/"))}
    assert digests(plain_week.folder) == others and len(whole) == len(others) + 22
    assert plain_week.truth["drives"] == {} and plain_week.truth["shafts"] == []
    different = {k for k in week.truth if plain_week.truth[k] != week.truth[k]}
    assert different == {"drives", "shafts", "parameters"}


@pytest.mark.proof
@pytest.mark.parametrize("compute", ["threads", "processes"])
def test_kinds_beside_each_other_write_the_same_bytes(compute, tmp_path):
    """Kinds of records share no state: where each is written changes neither them nor the truth."""
    some = {"growth": {"numbers": [3]}, "wear": {"most": 2}}
    short = shop_parameters("mill01", weeks=1, **some, **NO_CUTS, **NO_DRIVES)
    for where in ("serial", compute):
        simulate(tmp_path / where, tmp_path / f"{where}.json", short, where)
    assert digests(tmp_path / "serial") == digests(tmp_path / compute)
    assert (tmp_path / "serial.json").read_bytes() == (tmp_path / f"{compute}.json").read_bytes()


@one_machine
@pytest.mark.parametrize(
    "parts",
    [PLAIN, pytest.param({}, marks=pytest.mark.proof)],
    ids=["plain", "all"],
)
def test_another_seed_is_another_week(parts, week, plain_week, tmp_path):
    machine = week.parameters.machine
    other = run(tmp_path / "other", machine, weeks=1, seed=3, **parts)
    same_parts = run(tmp_path / "ours", machine, weeks=1) if not parts else plain_week
    ours, theirs = digests(same_parts.folder), digests(other.folder)
    # tools last otherwise, and have as many recordings
    lives = {name for name in ours.keys() ^ theirs.keys() if name.startswith("wear/T")}
    assert ours.keys() ^ theirs.keys() == lives
    same = {name for name in ours.keys() & theirs.keys() if ours[name] == theirs[name]}
    # an adapter has the same to say of every weekend
    assert same <= {"Devices.xml", "agent/2026-01-10.txt", "agent/2026-01-11.txt"}


def test_truth_does_not_stand_among_the_records(tmp_path):
    with pytest.raises(ValueError, match="must not stand among the records"):
        simulate(tmp_path, tmp_path / "truth.json", shop_parameters("mill01"))


@pytest.mark.parametrize(
    ("write", "changes"),
    [(write_wear, NO_WEAR), (write_growth, NO_GROWTH), (write_cutting, NO_CUTS),
     (write_feed, NO_DRIVES)],
)  # fmt: skip
def test_nothing_is_written_of_what_is_not_recorded(write, changes, tmp_path):
    assert write(tmp_path, shop_parameters("mill01", **changes)) == {}
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: ShopParameters(machine="m", weeks=0),
            "ShopParameters.weeks = 0 must lie from 1 to 104",
        ),
        (lambda: ShopParameters(machine="m", first_day="2026-01-06"), "must be a Monday"),
        (lambda: ShopParameters(machine="m", programs=()), "at least one part program"),
        (
            lambda: LoggerParameters(interval=0),
            "LoggerParameters.interval = 0 s must lie from 1 to 3600",
        ),
        (lambda: Growth(numbers=()), "Growth.numbers = .* must be one or more from 1 to 26"),
        (lambda: Growth(numbers=(1, 27)), "Growth.numbers = .1, 27. must be one or more"),
        (lambda: ShiftParameters(start_earliest=8.0), "start_latest"),
        (lambda: SpindleParameters(viscosity_100=30.0), "oil gets thinner"),
    ],
)
def test_values_out_of_range_are_named(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_unknown_programs_are_named(tmp_path):
    p = shop_parameters("mill01", programs=["O7777"], weeks=1, **PLAIN)
    with pytest.raises(ValueError, match="O7777"):
        simulate(tmp_path / "raw", tmp_path / "truth.json", p)


def test_only_c_axis_programs_and_no_c_axis_is_an_error(tmp_path):
    p = shop_parameters("mill02", programs=["O4410"], weeks=1, **PLAIN)
    with pytest.raises(ValueError, match="without a C axis"):
        simulate(tmp_path / "raw", tmp_path / "truth.json", p)


def test_the_room_starts_without_numba():
    code = "import sys, pipeline.shop.parameters; print('numba' in sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert said.stdout.strip() == "False"
