"""Records of feeds are read as the machine's file says, and hold what the truth says."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.planner import HOME
from pipeline.shop.drives.feed_records import write_feed
from pipeline.shop.drives.parameters import FeedRecords
from pipeline.shop.drives.records import commanded

from .conftest import Read, Simulated, digests, read_back, shop_parameters

RATE = 500


@pytest.fixture(scope="module")
def read(feeds: Simulated, tmp_path_factory: pytest.TempPathFactory) -> Read:
    signals = tmp_path_factory.mktemp("feed-signals")
    return read_back(feeds, feeds.folder, signals, feeds.truth["files"])


def row_of(read: Read, name: str) -> np.ndarray:
    """Row of the full table in which each sample of a file stands."""
    clock = 1 + read.made.parameters.drives.tool.clock_error * 1e-6
    return np.round(read.traces[name]["t"] / clock * RATE).astype(int)


def test_every_file_is_read_whole_and_they_are_not_large(read):
    assert read.manifest.keys() == read.told.keys() and len(read.told) == 3 * 9 + 8
    for name, entry in read.manifest.items():
        assert (entry["reason"], entry["rejected"]) == (None, 0)
        assert entry["kept"] == read.told[name]["rows"]
        letters = read.told[name].get("axis", "XYZ").lower()
        quantities = ("position_command", "position", "current")
        assert set(read.traces[name]) == {"t"} | {f"{a}_{q}" for a in letters for q in quantities}
    assert sum(p.stat().st_size for p in read.made.folder.rglob("*")) < 13e6


def test_strokes_go_there_and_back_from_places_of_their_own(read):
    """100 mm twice at the feed, from standstill to standstill, in the machine's frame."""
    strokes = {n: f for n, f in read.told.items() if "axis" in f}
    for name, told in strokes.items():
        axis = told["axis"].lower()
        command = read.traces[name][f"{axis}_position_command"]
        far = told["start_mm"] + 100
        assert command.min() == pytest.approx(told["start_mm"], abs=1e-4)
        assert command.max() == pytest.approx(far, abs=1e-4)
        up = np.flatnonzero(np.diff((command > told["start_mm"] + 50).astype(int)) == 1)
        assert len(up) == 2
        assert np.all(command[:100] == command[0]) and np.all(command[-100:] == command[0])
        row = row_of(read, name)
        speed = (command[50:] - command[:-50]) / (row[50:] - row[:-50]) * RATE * 60
        fast = np.abs(speed) > 0.99 * told["feed_mm_min"]
        assert np.median(np.abs(speed[fast])) == pytest.approx(told["feed_mm_min"], rel=1e-3)
        assert fast.mean() > 0.6
        behind = np.abs(command - read.traces[name][f"{axis}_position"]).max()
        assert behind < told["feed_mm_min"] / 60 / 20  # the loops' gains are above 20 1/s
    assert {(f["feed_mm_min"], f["run"]) for f in strokes.values()} == {
        (500, 1), (1000, 1), (1500, 1), (1500, 2), (2000, 1), (3000, 1), (3000, 2), (4500, 1),
        (6000, 1),
    }  # fmt: skip
    lead = read.made.parameters.drives.x.lead
    phases = [f["start_mm"] / lead % 1 for f in strokes.values() if f["axis"] == "X"]
    assert len({round(p, 3) for p in phases}) == 9 and np.ptp(phases) > 0.3


def test_stretches_are_cut_out_of_their_program(read):
    """Commands are those of the program from that moment on; in each an axis moves."""
    shop = read.made.parameters
    frequency = shop.drives.x.cascade.position_frequency
    programs, _ = part_programs(shop.control, shop.generator("part programs"))
    position = {p.name: commanded(p, shop, frequency, HOME) for p in programs}
    parts = {n: f for n, f in read.told.items() if "program" in f}
    assert [f["program"] for f in parts.values()] == [
        programs[k].name for k in (0, 0, 1, 1, 2, 2, 2, 3)
    ]
    ends: dict[str, float] = {}
    for name, told in parts.items():
        row, trace = row_of(read, name), read.traces[name]
        assert told["seconds"] == 12 and ends.get(told["program"], 0) <= told["start_s"]
        ends[told["program"]] = told["start_s"] + 12
        whole = position[told["program"]][:: frequency // RATE]
        sent = whole[round(told["start_s"] * RATE) + row]
        kept = np.concatenate([[True], np.diff(row) > 0])  # of a repeated stamp the row is unknown
        travelled = np.zeros(3)
        for k, axis in enumerate("xyz"):
            command = trace[f"{axis}_position_command"]
            assert command[kept] == pytest.approx(sent[kept, k], abs=6e-5)
            # the loops' gains are above 20 1/s; what friction leaves is below 50 um
            speed = np.abs(np.diff(whole[:, k])).max() * RATE
            assert np.abs(command - trace[f"{axis}_position"]).max() < speed / 20 + 0.05
            travelled[k] = np.abs(np.diff(command)).sum()
        assert travelled.max() > 20
        # not from standstill at the stretch's beginning, but as the program has brought them there
        moving = np.abs(np.diff(whole[:, 0]))[round(told["start_s"] * RATE)] * RATE > 5
        if moving:
            assert abs(trace["x_position_command"][0] - trace["x_position"][0]) > 0.01


def test_the_same_bytes_every_time_and_others_for_another_seed(tmp_path):
    few = {"feeds": ((6000.0, 1),), "stretches": (0, 0, 1, 0)}
    for name, changes in {"one": {}, "again": {}, "other": {"seed": 3}}.items():
        write_feed(tmp_path / name, shop_parameters("mill02", drives={"feed": few}, **changes))
    one, again, other = (digests(tmp_path / name) for name in ("one", "again", "other"))
    assert one == again and len(one) == 4
    assert one.keys() == other.keys() and not set(one.values()) & set(other.values())


def test_a_program_too_short_for_its_stretches_is_named(tmp_path):
    shop = shop_parameters("mill01")
    feed = replace(shop.drives.feed, feeds=((6000.0, 1),), stretches=(0, 0, 40, 0))
    with pytest.raises(ValueError, match=r"asks for 40 of 12 s of O5103, which moves in \d+ such"):
        write_feed(tmp_path, replace(shop, drives=replace(shop.drives, feed=feed)))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"rate": 300}, "rate = 300 .* must divide 1000"),
        ({"feeds": ()}, "must be pairs of a feed from 10 to 15000 mm/min"),
        ({"feeds": ((5.0, 1),)}, "must be pairs of a feed"),
        ({"stretches": (1, -1, 1, 1)}, "must lie from 0 to 100"),
        ({"seconds": 1.0}, "seconds = 1.0 s must lie from 2 to 600"),
    ],
)
def test_settings_out_of_range_are_named(changes, words):
    with pytest.raises(ValueError, match=words):
        FeedRecords(**changes)
