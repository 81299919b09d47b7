"""Programs in the style of other people's posts: every move is the one that they mean."""

import numpy as np
import pytest

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import FeedMode, Kind
from pipeline.gcode.setup import Tool
from tests.gcode.following import MOVING, follow
from tests.gcode.posts import DIAMETERS, EXTENDED, LENGTHS, REFERENCE, WORK, Job, made

SAME = 1e-6
MIDDLE = 5e-3
"""The middle of an arc, whose end lies beside its circle by the post's last digit [mm]."""


def setup(job: Job) -> dict:
    """Choices of Setup: the control as the posts know it."""
    return {
        "dialect": "fanuc" if job.fanuc else job.style,
        "work_offsets": {n: (*v, 0.0, 0.0, 0.0) for n, v in {**WORK, **EXTENDED}.items()},
        "tools": {n: Tool(length=LENGTHS[n], diameter=DIAMETERS[n]) for n in LENGTHS},
        "tool_names": {"END_MILL": 1, "DRILL 6": 2, "T3": 3},
        "references": {"G28": (*REFERENCE, 0.0, 0.0, 0.0)} if job.fanuc else {},
        "decimal": "increment" if job.increments else "calculator",
    }


def moved(moves):
    """Rapid, end, middle, length, feed [mm/min] of each row that goes somewhere."""
    start, length = moves.start, moves.length
    rows = np.flatnonzero(np.isin(moves.kind, MOVING) & (length > 1e-9))
    middle = (start[rows, :3] + moves.end[rows, :3]) / 2
    for i, row in enumerate(rows):
        if moves.kind[row] == Kind.ARC:
            u, v = {17: (0, 1), 18: (2, 0), 19: (1, 2)}[int(moves.plane[row])]
            arm = start[row, [u, v]] - moves.centre[row, [u, v]]
            a = moves.angle[row] / 2
            middle[i, u] = moves.centre[row, u] + arm[0] * np.cos(a) - arm[1] * np.sin(a)
            middle[i, v] = moves.centre[row, v] + arm[0] * np.sin(a) + arm[1] * np.cos(a)
    factor = {FeedMode.PER_REVOLUTION: moves.speed, FeedMode.INVERSE_TIME: length}
    feed = moves.feed.copy()
    for mode, by in factor.items():
        feed = np.where(moves.feed_mode == mode, feed * by, feed)
    rapid = moves.kind[rows] == Kind.RAPID
    return rapid, moves.end[rows, :3], middle, length[rows], feed[rows], moves.line[rows]


def disagreement(job: Job) -> str:
    """The first move of a job's text as followed that is another than the job means; or ""."""
    try:
        moves = follow("\n".join([*job.lines, ""]), **setup(job))
    except GcodeError as error:
        return f"refused: {error}"
    rapid, end, middle, length, feed, line = moved(moves)
    truth = [one for one in job.truth if one.length > 1e-9]
    for i, one in enumerate(truth):
        if i >= len(end):
            return f"move {i} of {len(truth)} is missing"
        said = f"move {i} line {line[i]} {job.lines[line[i] - 1]!r}"
        if not np.allclose(end[i], one.end, atol=SAME, rtol=0):
            return f"{said}: ends at {end[i]}, means {one.end}"
        if rapid[i] != one.rapid:
            return f"{said}: rapid {rapid[i]}"
        if abs(length[i] - one.length) > MIDDLE + 1e-4 * one.length:
            return f"{said}: {length[i]} mm, means {one.length}"
        if not np.allclose(middle[i], one.middle, atol=10 * MIDDLE, rtol=0):
            return f"{said}: by {middle[i]}, means {one.middle}"
        if not one.rapid and not np.isclose(feed[i], one.feed, rtol=1e-6):
            return f"{said}: F {feed[i]}, means {one.feed}"
    if len(end) > len(truth):
        return f"a move too many, line {line[len(truth)]}"
    dwell = moves.value[(moves.kind == Kind.DWELL) & (moves.code == 0)].sum()
    if abs(dwell - job.dwell) > 1e-6:
        return f"dwells {dwell}, means {job.dwell}"
    return ""


PROGRAMS = {"fanuc": 60, "haas": 40, "siemens": 60}
"""Style -> programs of the proof."""


@pytest.mark.parametrize("style", PROGRAMS)
@pytest.mark.parametrize("share", [0.1, pytest.param(1.0, marks=pytest.mark.proof)])
def test_every_move_is_the_one_that_the_post_means(style, share):
    """None is refused either: what a post of these controls writes every day is followed."""
    found = {seed: disagreement(made(seed, style)) for seed in range(int(share * PROGRAMS[style]))}
    assert {seed: one for seed, one in found.items() if one} == {}
