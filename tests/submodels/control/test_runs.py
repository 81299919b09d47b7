"""Runs in a recording: when they start and end, what was held, what a log may leave out."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.submodels.control.runs import Series, activities, joined, read_runs, stopped_within
from tests.submodels.control.polled_logs import ITEMS, write_log

LINES = [(1.0, 10.0), (2.0, 11.0), (3.0, 12.0), (4.0, 13.0)]


def read(path, **said):
    return read_runs(write_log(said, path / "log.parquet"), ITEMS, "log.txt")


def test_several_runs_of_one_file_are_numbered(tmp_path):
    states = [(1.0, "ACTIVE"), (2.5, "STOPPED"), (3.0, "ACTIVE"), (5.0, "PROGRAM_COMPLETED")]
    first, second = read(tmp_path, exec=states, ln=[*LINES, (5.0, 14.0)])
    assert [first.name, second.name] == ["log.txt", "log.txt (run 2)"]
    assert first.line.value.tolist() == [10, 11]
    assert second.line.value.tolist() == [11, 12, 13, 14]


def test_the_line_left_from_the_run_before_is_no_line_of_the_next(tmp_path):
    states = [(0.0, "ACTIVE"), (2.5, "STOPPED"), (3.0, "ACTIVE"), (6.0, "PROGRAM_COMPLETED")]
    lines = [(0.5, 80.0), (1.0, 90.0), (3.5, 7.0), (4.0, 8.0)]
    assert read(tmp_path, exec=states, ln=lines)[1].line.value.tolist() == [7, 8]


def test_a_recording_without_states_is_one_run_that_was_not_completed(tmp_path):
    [run] = read(tmp_path, ln=LINES)
    assert (run.start, run.end, run.completed) == (0.0, 3.0, False)


def test_what_became_unavailable_is_no_number(tmp_path):
    states = [(0.0, "ACTIVE"), (4.0, "PROGRAM_COMPLETED")]
    [run] = read(tmp_path, exec=states, ln=[*LINES, (3.5, np.nan)], vpath=[(1.0, np.nan)])
    assert run.line.value.tolist() == [10, 11, 12, 13]
    assert len(run.feed.time) == len(run.tool.time) == len(run.rapid_override.time) == 0


@pytest.mark.parametrize("lines", [[], [(1.0, 10.0)]], ids=["no line", "one line"])
def test_a_recording_that_says_nothing_of_lines_has_no_run(tmp_path, lines):
    assert read(tmp_path, exec=[(0.0, "ACTIVE"), (4.0, "STOPPED")], ln=lines) == []


def test_an_empty_recording_has_no_run(tmp_path):
    assert read(tmp_path) == []


@pytest.mark.parametrize("signal", ["line", "execution"])
def test_a_mapping_without_what_is_needed_is_refused_in_one_sentence(tmp_path, signal):
    path = write_log({"ln": LINES}, tmp_path / "log.parquet")
    items = {name: item for name, item in ITEMS.items() if name != signal}
    with pytest.raises(ValueError, match=rf"^mapping.signals names no data item for {signal}, "):
        read_runs(path, items, "log.txt")


WORDS = st.sampled_from(
    ["ACTIVE", "FEED_HOLD", "OPTIONAL_STOP", "STOPPED", "PROGRAM_COMPLETED", "READY", ""]
)


@given(st.lists(WORDS, min_size=1, max_size=25))
def test_runs_and_holds_are_those_of_a_walk_second_by_second(words):
    """Each second is in no run, active or held, as the word in force and the run it lies in say."""
    expected, running = [], False
    for word in words:
        held = word in ("FEED_HOLD", "OPTIONAL_STOP")
        running = word == "ACTIVE" or (running and held)
        expected.append((running, running and held))
    said = [(float(k), word) for k, word in enumerate(words)]
    found = list(activities(said, float(len(words))))
    second = np.arange(len(words)) * 1.0
    within = stopped_within(joined([(a.start, a.end) for a in found]), second, second + 1)
    held = stopped_within(joined([h for a in found for h in a.held]), second, second + 1)
    assert [(bool(w), bool(h)) for w, h in zip(within, held, strict=True)] == expected
    done = [a.completed for a in found if a.end < len(words)]
    assert done == [words[int(a.end)] == "PROGRAM_COMPLETED" for a in found if a.end < len(words)]


def test_a_series_keeps_its_value_until_the_next():
    series = Series(time=np.array([1.0, 2.0]), value=np.array([5.0, 6.0]))
    times = np.array([0.9, 1.0, 1.9, 2.0, 9.0])
    assert series.at(times, before=-1.0).tolist() == [-1, 5, 5, 6, 6]
    polled = series.polled()
    assert np.allclose(np.diff(polled.time), 0.15)
    assert set(polled.value[polled.time < 2.0]) == {5.0}
