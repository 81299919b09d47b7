"""Corrected commands on the shop's axes: shares that are left, tables that cannot be driven."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pipeline.shop.drives.axis import follow
from pipeline.shop.drives.records import Move, circles, travel
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.trials import CommandedPath, Commands, _driven, corrected_trials
from pipeline.stages.__main__ import run
from pipeline.twin.command_correction import corrected_command
from pipeline.twin.program_axes import between
from tests.small_project import inside
from tests.twin.shop_drives import shop_drives
from tests.twin.test_command_correction import CIRCLE, STROKE, T, reference, rms

from .conftest import CONF, shop_parameters

SHOP = shop_parameters("mill01")
MACHINES = {"mill01": SHOP, "mill02": shop_parameters("mill02")}
STEP = 0.002
Columns = dict[str, np.ndarray]


def drive_corrected(table: Path, shop: ShopParameters, seed: int) -> dict[str, Any]:
    return _driven(Commands.of(table, shop), shop, seed)


def write(path: Path, columns: Columns) -> Path:
    rows = np.stack(list(columns.values()), axis=1)
    words = "# a note\n# and another\n" + ",".join(columns) + "\n"
    path.write_text(words + "".join(",".join(f"{v:.6f}" for v in row) + "\n" for row in rows))
    return path


def circle(machine: str, share: float) -> Columns:
    """A circle, and ``share`` of what the axes lacked of it when they were driven once."""
    shop = MACHINES[machine]
    frequency = shop.drives.x.cascade.position_frequency
    ways = circles(20.0, (30.0,), 1.25, shop.control.path_bounds, frequency)
    every = round(frequency * STEP)
    columns = {"t": np.arange(len(ways[0][::every])) * STEP}
    for letter, way in zip("XY", ways, strict=True):
        axis, command = shop.drives.axes[letter], way - 300.0
        out = follow(axis, command * 1e-3, np.random.default_rng(1))
        lacking = command - out.measured * 1e3
        columns[letter] = command[::every]
        columns[f"{letter}_corrected"] = (command + share * lacking)[::every]
    return columns


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_without_a_correction_all_is_left(machine, tmp_path):
    """The same noise before and after: not a bit of difference."""
    table = write(tmp_path / "a.csv", circle(machine, 0.0))
    found = drive_corrected(table, MACHINES[machine], 1)
    assert found["axes"].keys() == {"X", "Y"}
    for one in (*found["axes"].values(), found["path"]):
        for place in ("measured", "carriage"):
            assert one[place]["share_left"] == 1.0
            assert one[place]["before"] == one[place]["after"]
            assert 0 < one[place]["before"]["rms_um"] < one[place]["before"]["max_um"]


@pytest.mark.parametrize("machine", ["mill01", "mill02"])
def test_what_the_axes_lack_is_taken_back(machine, tmp_path):
    """The lag of a constant speed goes away; added twice it comes back with the other sign."""
    shop = MACHINES[machine]
    for share, least, most in ((1.0, 0.0, 0.2), (2.0, 0.8, 1.2), (-1.0, 1.8, 2.2)):
        found = drive_corrected(write(tmp_path / "a.csv", circle(machine, share)), shop, 1)
        for one in found["axes"].values():
            assert least < one["measured"]["share_left"] < most
            ratio = one["measured"]["after"]["rms_um"] / one["measured"]["before"]["rms_um"]
            assert one["measured"]["share_left"] == pytest.approx(ratio, rel=1e-9)
    speed, c = 30.0, shop.drives.x.cascade
    lag = speed * (1 - c.velocity_feedforward) / (c.position_gain * c.position_scale) * 1e3
    assert found["axes"]["X"]["measured"]["before"]["max_um"] == pytest.approx(lag, rel=0.1)


def test_the_carriage_is_where_a_scale_shows_it_and_a_motor_does_not(tmp_path):
    """The play of the sibling's screw stands between its motor's encoder and the carriage."""
    for machine, least in (("mill01", 0.0), ("mill02", 1.0)):
        found = drive_corrected(
            write(tmp_path / "a.csv", circle(machine, 1.0)), MACHINES[machine], 1
        )
        one = found["axes"]["X"]
        apart = one["carriage"]["after"]["rms_um"] - one["measured"]["after"]["rms_um"]
        assert least <= abs(apart) < least + (0.1 if least == 0 else 20)


def test_a_single_axis_has_no_path_and_the_table_is_driven_at_any_rate(tmp_path):
    """4 ms between rows and 2 ms between rows are the same smooth motion."""
    way = travel([Move(length=20.0, speed=25.0)], SHOP.control.path_bounds, 2000) - 250
    found = []
    for every in (4, 8):
        x = way[::every]
        columns = {"t": 7.0 + np.arange(len(x)) * every / 2000, "Z": x, "Z_corrected": x + 0.01}
        found.append(drive_corrected(write(tmp_path / "a.csv", columns), SHOP, 2))
        assert found[-1].keys() == {"axes"} and found[-1]["axes"].keys() == {"Z"}
    one, other = (f["axes"]["Z"]["measured"] for f in found)
    assert one["before"]["rms_um"] == pytest.approx(other["before"]["rms_um"], rel=0.01)


def test_distance_from_a_path_counts_across_it_alone():
    angle = np.linspace(0, np.pi, 2000)
    path = 10 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    path = np.concatenate([path[:1], path, path[-1:]])  # standstill before and after
    later = angle[5:-5] + 0.01
    place = 10.003 * np.stack([np.cos(later), np.sin(later)], axis=1)[:-10]
    assert CommandedPath(path).distance(place) == pytest.approx(
        np.full(len(place), 0.003), abs=1e-5
    )
    assert CommandedPath(path).distance(np.array([[13.0, -4.0]])) == pytest.approx([5.0])
    alone = CommandedPath(np.array([[1.0, 0.0]]))
    assert alone.distance(np.array([[1.0, 3.0]])) == pytest.approx([3.0])


def test_over_seeds_each_number_has_a_spread(tmp_path):
    table = write(tmp_path / "a.csv", circle("mill01", 0.5))
    found = corrected_trials(table, SHOP, range(2))
    alone = [drive_corrected(table, SHOP, seed)["path"]["measured"] for seed in range(2)]
    rms = [one["before"]["rms_um"] for one in alone]
    told = found["path"]["measured"]["before"]["rms_um"]
    assert found["seeds"] == 2 and rms[0] != rms[1]
    assert told == pytest.approx({"mean": np.mean(rms), "min": min(rms), "max": max(rms)}, abs=1e-4)
    with pytest.raises(ValueError, match="one seed or more"):
        corrected_trials(table, SHOP, [])


GOOD: Columns = {
    "t": np.arange(4) * STEP, "X": np.zeros(4), "X_corrected": np.zeros(4),
}  # fmt: skip


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"t": GOOD["t"]}, "has the columns t: give t .* and, for each of the axes X, Y, Z"),
        ({"t": GOOD["t"], "X": GOOD["X"]}, "has the columns t, X: give"),
        ({"X": GOOD["X"], "X_corrected": GOOD["X"]}, "has the columns X, X_corrected: give"),
        (GOOD | {"A": GOOD["X"], "A_corrected": GOOD["X"]}, "give t .* of the axes X, Y, Z"),
        ({k: v[:1] for k, v in GOOD.items()}, "has 1 rows: two or more"),
        (GOOD | {"t": GOOD["t"] * [1, 1, 1, 1.1]}, r"row 4: t goes from 0.004 to 0.0066 s"),
        (GOOD | {"t": -GOOD["t"]}, "give even times that rise"),
        (GOOD | {"X": np.array([0, np.nan, 0, 0])}, "row 2: X = nan must be finite"),
        (GOOD | {"X_corrected": np.array([0, 0, np.inf, 0])}, "row 3: X_corrected = inf"),
    ],
)
def test_a_table_that_cannot_be_driven_is_one_sentence(columns, words, tmp_path):
    with pytest.raises(ValueError, match=words) as error:
        drive_corrected(write(tmp_path / "a.csv", columns), SHOP, 1)
    assert "a.csv" in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has the columns none"),
        ("t,X,X_corrected\n0,0,0\n0.1,a,0\n", "no table of numbers: could not convert .*'a'"),
        ("t,X,X_corrected\n0,0,0\n0.1,0\n", "no table of numbers"),
        ("t,X,X_corrected\n0,0\n0.1,0\n", "has 3 names and 2 columns"),
        ("t;X;X_corrected\n0;0;0\n0,1;0;0\n", "has the columns t;X;X_corrected"),
    ],
)
def test_a_text_that_is_no_table_is_one_sentence(text, words, tmp_path):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(ValueError, match=words):
        drive_corrected(tmp_path / "a.csv", SHOP, 1)


def test_the_stage_drives_every_table_of_a_folder(tmp_path):
    machine = yaml.safe_load((CONF / "mill01.yaml").read_text())
    (tmp_path / "params.yaml").write_text(
        yaml.safe_dump({"machine": {"mill01": {"shop": machine}}})
    )
    (tmp_path / "in").mkdir()
    with inside(tmp_path):
        with pytest.raises(ValueError, match=r"in holds no \*.csv"):
            run("trial_command_correction@mill01", "in", "out/mill01.json")
        for name, share in (("O1-part1", 1.0), ("O1-part2", 0.0)):
            write(Path("in") / f"{name}.csv", circle("mill01", share))
        run("trial_command_correction@mill01", "in", "out/mill01.json")
    told = json.loads((tmp_path / "out/mill01.json").read_text())
    assert (told["machine"], told["origin"]) == ("mill01", "simulated")
    assert told["programs"].keys() == {"O1-part1", "O1-part2"}
    one, two = (told["programs"][f"O1-part{k}"] for k in (1, 2))
    assert one["seeds"] == SHOP.trial_drives
    assert one["axes"]["X"]["measured"]["share_left"]["max"] < 0.2
    assert two["path"]["carriage"]["share_left"] == {"mean": 1.0, "min": 1.0, "max": 1.0}


MACHINE = ShopParameters(machine="mill77")
DRIVES = shop_drives(MACHINE.drives)


@pytest.mark.parametrize("letter", DRIVES)
@pytest.mark.parametrize("text", [STROKE, CIRCLE], ids=["stroke", "circle"])
def test_a_corrected_command_takes_the_following_error_of_a_machine_away(
    letter, text, record_property
):
    wanted, axis = reference(text), MACHINE.drives.axes[letter]
    ticks = round(axis.cascade.position_frequency * T)

    def error(command):
        """Of the scale and of the carriage, with torsion, cogging, bristles and quantisation."""
        found = follow(axis, between(command, ticks), np.random.default_rng(0))
        return wanted - found.measured[::ticks], wanted - found.carriage[::ticks]

    corrected = corrected_command(letter, wanted, T, DRIVES[letter]).corrected
    for name, before, after in zip(("scale", "carriage"), error(wanted), error(corrected),
                                   strict=True):  # fmt: skip
        record_property(f"{name}_um", f"{rms(before) * 1e6:.1f} -> {rms(after) * 1e6:.1f}")
        assert rms(after) < 0.015 * rms(before)
        assert np.abs(after).max() < 0.04 * np.abs(before).max()
