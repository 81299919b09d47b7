"""The part programs say what is run, and the logs of the runs show it."""

import re
from collections import Counter
from datetime import date, datetime, timedelta
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipeline.shop.control.part_programs import part_programs
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.parameters import ControlParameters

from .conftest import Simulated

Log = dict[str, list[tuple[datetime, str]]]
ITEMS = {"exec", "ln", "tool", "fovr", "rovr", "S1n", "vpath"}
WORD = re.compile(r"([A-Z])(-?\d+\.?\d*)")
POLL = timedelta(seconds=0.3)  # two polls


def read(path: Path) -> tuple[Log, list[str]]:
    """Values by item, and the lines that are not ``timestamp|item|value``."""
    found: Log = {}
    torn = []
    for line in path.read_text(encoding="ascii").splitlines():
        parts = line.split("|")
        if len(parts) != 3:
            torn.append(line)
            continue
        found.setdefault(parts[1], []).append((datetime.fromisoformat(parts[0]), parts[2]))
    return found, torn


def numbers(log: Log, item: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s since the first] and values of an item."""
    rows = log.get(item, [])
    zero = min(rows[0][0] for rows in log.values())
    return (
        np.array([(t - zero).total_seconds() for t, _ in rows]),
        np.array([float(v) for _, v in rows]),
    )


@pytest.fixture(scope="module")
def runs(week: Simulated) -> list[tuple[dict[str, Any], Log, list[str]]]:
    return [(r, *read(week.folder / r["file"])) for r in week.truth["control"]["runs"]]


def programs(seed: int = 3) -> tuple[list[PartProgram], PartProgram]:
    return part_programs(ControlParameters(), np.random.default_rng(seed))


def interpreted(text: str) -> list[tuple[int, str, tuple[float, float, float], float]]:
    """Line, motion, end and feed of each line that cuts, read from the text alone."""
    at, motion, feed, cycle, found = [0.0, 0.0, 0.0], "G0", 0.0, False, []
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith(("%", "(", "O")):
            continue
        words = WORD.findall(line)
        codes = {f"G{float(v):g}" for letter, v in words if letter == "G"}
        values = {letter: float(v) for letter, v in words if letter not in "GN"}
        cycle = (cycle or bool(codes & {"G81", "G83"})) and "G80" not in codes
        motion = next((c for c in ("G0", "G1", "G2", "G3") if c in codes), motion)
        feed = values.get("F", feed)
        if cycle or "G28" in codes:
            at[:2] = [values.get("X", at[0]), values.get("Y", at[1])]
            continue
        if values.keys() & set("XYZIJ"):
            at = [values.get(axis, was) for axis, was in zip("XYZ", at, strict=True)]
            if motion != "G0":
                found.append((number, motion, (at[0], at[1], at[2]), feed))
    return found


@pytest.mark.parametrize("numbered", [True, False])
def test_the_text_says_what_is_run(numbered):
    """Another reader of the text finds the same cuts, ends and feeds as the control got."""
    made, edited = part_programs(ControlParameters(numbered=numbered), np.random.default_rng(3))
    for program in [*made, edited]:
        drilled = {
            n for n, line in enumerate(program.text.splitlines(), 1)
            if n in {s.line for s in program.steps if s.kind == "rapid"}
            and n in {s.line for s in program.steps if s.kind == "line"} and line
        }  # fmt: skip
        steps = [
            (s.line, s.kind == "arc", s.end, s.feed)
            for s in program.steps
            if s.kind in ("line", "arc") and s.line not in drilled
        ]
        read_back = [(n, g in ("G2", "G3"), end, f) for n, g, end, f in interpreted(program.text)]
        assert read_back == steps


def test_all_programs_but_the_edited_one_are_among_the_files(week):
    files = {p.stem: p for p in (week.folder / "programs").glob("*.nc")}
    told = week.truth["control"]["programs"]
    assert files.keys() == told.keys() and len(files) == 4
    for name, path in files.items():
        assert len(path.read_text().splitlines()) == told[name]["lines"]
    counts = Counter(r["program"] for r in week.truth["control"]["runs"])
    assert counts.pop(None) == 1
    assert sum(counts.values()) == 7 and counts.keys() == files.keys()


def test_logs_are_of_the_sunday_before_and_say_only_changes(week, runs):
    sunday = date.fromisoformat(week.parameters.first_day) - timedelta(days=1)
    ended = datetime.min
    for _, log, _ in runs:
        assert set(log) <= ITEMS
        times = sorted(t for rows in log.values() for t, _ in rows)
        assert {t.date() for t in times} == {sunday}
        assert times[0].replace(tzinfo=None) > ended
        ended = times[-1].replace(tzinfo=None)
        for rows in log.values():
            assert all(a[0] < b[0] and a[1] != b[1] for a, b in pairwise(rows))
    gaps = [
        np.diff(sorted({t.timestamp() for rows in log.values() for t, _ in rows}))
        for _, log, _ in runs
    ]
    typical = np.median(np.concatenate(gaps))
    assert abs(typical - week.parameters.control.poll) < 0.02


def test_a_run_lasts_as_long_as_the_truth_says(runs):
    for told, log, _ in runs:
        states = log["exec"]
        assert states[0][1] == "ACTIVE"
        assert states[-1][1] == ("PROGRAM_COMPLETED" if told["completed"] else "STOPPED")
        lasted = states[-1][0] - states[0][0]
        assert abs(lasted - timedelta(seconds=told["duration_s"])) < POLL
    assert [told["completed"] for told, _, _ in runs].count(False) == 1


def test_lines_go_through_the_program(week, runs):
    skipped = 0
    for told, log, _ in runs:
        lines = numbers(log, "ln")[1]
        assert np.all(np.diff(lines) > 0)
        assert lines[-1] <= told["lines"]
        skipped += int((np.diff(lines) > 1).sum())
        if told["program"] and told["completed"]:
            text = (week.folder / "programs" / f"{told['program']}.nc").read_text().splitlines()
            assert "M30" in text[int(lines[-1]) - 1]
    assert skipped > 100  # shorter than a poll


def test_the_feed_is_the_programmed_one_times_the_override(week, runs):
    """Wherever the log shows a steady feed in a line that cuts; rapids are much faster."""
    compared = 0
    for told, log, _ in runs:
        if not told["program"]:
            continue
        text = (week.folder / "programs" / f"{told['program']}.nc").read_text()
        feeds = {n: f / 60 for n, _, _, f in interpreted(text)}
        (t_v, v), (t_l, lines) = numbers(log, "vpath"), numbers(log, "ln")
        for k in np.flatnonzero(np.diff(t_v) > 1.0):  # unchanged for a second: steady
            line = int(lines[np.searchsorted(t_l, t_v[k], side="right") - 1])
            next_line = t_l[min(np.searchsorted(t_l, t_v[k], side="right"), t_l.size - 1)]
            if v[k] == 0 or line not in feeds or next_line < t_v[k] + 0.5:
                continue
            since = [percent for from_line, percent in told["feed_override"] if from_line <= line]
            assert v[k] == pytest.approx(feeds[line] * since[-1] / 100, abs=0.02)
            compared += 1
    assert compared > 20


def test_the_feed_override_is_not_said_before_it_is_turned(runs):
    said = {}
    for told, log, _ in runs:
        values = [float(v) for _, v in log.get("fovr", [])]
        assert bool(values) == (len(told["feed_override"]) > 1)
        if values:
            said[told["feed_override"][0][1]] = values
            begun = log["exec"][0][0]
            assert log["fovr"][0][0] > begun
    assert said[80.0] == [90.0, 100.0]
    assert said[100.0] == [110.0, 120.0, 110.0, 100.0]


def test_what_operators_do_is_seen(runs):
    holds = stops = 0
    for told, log, torn in runs:
        times, v = numbers(log, "vpath")
        zero = min(rows[0][0] for rows in log.values())
        for hold in told["feed_holds"]:
            begun = next(t for t, s in log["exec"] if s == "FEED_HOLD")
            ended = next(t for t, s in log["exec"] if s == "ACTIVE" and t > begun)
            assert timedelta(0) <= begun - datetime.fromisoformat(hold["time"]) < POLL
            assert abs(ended - begun - timedelta(seconds=hold["seconds"])) < POLL
            still = (times > (begun - zero).total_seconds() + 0.6) & (
                times < (ended - zero).total_seconds()
            )
            assert not v[still].any()
            holds += 1
        for stop in told["rapid_stops"]:
            assert "0" in [value for _, value in log["rovr"]]
            begun = datetime.fromisoformat(stop["time"]) - zero
            inside = (times > begun.total_seconds() + 0.5) & (
                times < begun.total_seconds() + stop["seconds"]
            )
            assert not v[inside].any()
            stops += 1
        assert torn == ["2026"] * told["torn_lines"]
    assert (holds, stops) == (1, 1)
    assert sum(told["torn_lines"] for told, _, _ in runs) == 1


def test_tools_are_out_of_the_spindle_during_a_change(week, runs):
    for told, log, _ in runs:
        if not (told["program"] and told["completed"]):
            continue
        text = (week.folder / "programs" / f"{told['program']}.nc").read_text()
        changes = re.findall(r"T(\d+) ?M6", text)
        values = [value for _, value in log["tool"]]
        assert values[0] == changes[-1]  # left by the run before
        assert values[1::2] == ["0"] * len(changes)
        assert values[2::2] == changes


def test_the_way_that_the_log_shows_is_that_of_the_program(week, runs):
    """Feeds times time, over the finish of the cam in its short chords."""
    told, log, _ = next(r for r in runs if r[0]["torn_lines"])
    text = (week.folder / "programs" / f"{told['program']}.nc").read_text()
    cuts = [c for c in interpreted(text) if c[1] == "G1"]
    finish = [c for c in cuts if c[0] > 100]
    ends = np.array([end for _, _, end, _ in finish])
    way = np.sqrt((np.diff(ends, axis=0) ** 2).sum(axis=1)).sum()
    (t_v, v), (t_l, lines) = numbers(log, "vpath"), numbers(log, "ln")
    first, last = (t_l[np.argmax(lines >= finish[k][0])] for k in (1, -1))
    grid = np.arange(first, last, 0.01)
    shown = v[np.searchsorted(t_v, grid, side="right") - 1].sum() * 0.01
    # polls of 0.15 s: the stops between levels are met by chance, and one value is torn
    assert shown == pytest.approx(way, rel=0.03)
