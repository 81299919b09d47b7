"""Sinumerik programs with cycles and subprograms, as a follower of their own follows them."""

import math
from collections import defaultdict

import numpy as np
import pytest

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Kind
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup, Tool
from tests.gcode.sinumerik import Sinumerik

POSITIONS = "X20 Y20\nX80 Y=R1\nX80 Y60\nM17\n"
SLOT = (
    "R2=-1\nBEGIN: G1 Z=R2 F150\nG1 X30 F500\nY12\nX0\nR2=R2-1.5\nREPEAT BEGIN P=3\nG0 Z20\nM17\n"
)


def number(rng, low, high, digits=1):
    return round(float(rng.uniform(low, high)), digits)


def cycle(rng):
    """One call of a drilling cycle, as a post or a hand writes it."""
    rfp, sdis, deep = number(rng, -3, 3), number(rng, 0.5, 5), number(rng, 4, 60)
    rtp, dtb = rfp + sdis + number(rng, 0, 40), number(rng, 0, 2)
    head = f"{rtp:.1f},{rfp},{sdis},"
    depth = f"{rfp - deep:.1f}," if rng.random() < 0.6 else f",{deep}"
    name = rng.choice(["81", "82", "83", "84", "85", "86", "89"])
    first, speeds = number(rng, deep / 6, deep, 2), rng.integers(200, 900, 2)
    less, wait = number(rng, 0, first / 2, 2) * rng.integers(2), number(rng, 0, 1)
    slow, out = rng.choice(["1", "0.6"]), rng.integers(2)
    more = {
        "81": "",
        "82": f",{dtb}",
        "83": f",,{first},{less},{dtb},{wait},{slow},{out},,,{number(rng, 0, 2)},{wait / 2}",
        "84": f",{dtb},3,{rng.choice(['8,', ',1.25', ',-2', '16,'])},0,{speeds[0]},{speeds[1]}",
        "85": f",{dtb},{rng.integers(50, 200)},{rng.integers(50, 900)}",
        "86": f",{dtb},3,{number(rng, -1, 1)},{number(rng, -1, 1)},{wait},45",
        "89": f",{dtb}",
    }[str(name)]
    return f"CYCLE{name}({head}{depth}{more})"


def program(rng):
    """A program of several tools: cycles alone and by MCALL, patterns, subprograms, shifts."""
    lines = ["G17 G90 G54 G710 G94", f"R1={number(rng, 10, 40)}", "S1000 M3", "G0 X0 Y0 Z100"]
    for _ in range(rng.integers(2, 6)):
        lines += [f"F{rng.integers(60, 400)}"]
        if rng.random() < 0.3:
            lines += [f"TRANS X={number(rng, -50, 50)} Y{number(rng, -9, 9)} Z=R1/8", "G0 X0 Y0"]
        alone = rng.random() < 0.3
        lines += [cycle(rng)] if alone else [f"MCALL {cycle(rng)}"]
        if not alone:
            count, step = rng.integers(1, 9), number(rng, 2, 20)
            angle = number(rng, -180, 180)
            lines += [
                [f"X{number(rng, -90, 90)} Y=R1", "X5"],
                ["L10", 'CALL "L10"'],
                [f"HOLES1({number(rng, -9, 9)},4,{angle},{step},{step},{count})"],
                [f"HOLES2(5,6,{step},{angle},{number(rng, 0, 60)},{count})"],
            ][rng.integers(4)]
            lines += ["MCALL"]
        if rng.random() < 0.4:
            lines += ["G0 X0 Y0 Z5", f"SLOT P{rng.integers(1, 4)}"]
    return "\n".join([*lines, "TRANS", "G0 Z100", "M30", ""])


@pytest.mark.parametrize(
    "seed", [*range(6), *(pytest.param(seed, marks=pytest.mark.proof) for seed in range(6, 400))]
)
def test_cycles_and_subprograms_follow_the_manual(seed, tmp_path):
    """Length at each feed, of threads at each pitch and speed, of rapids; dwells; every bottom."""
    text = program(np.random.default_rng(seed))
    (tmp_path / "L10.SPF").write_text(POSITIONS)
    (tmp_path / "slot.spf").write_text(SLOT)
    own = Sinumerik({"L10": POSITIONS, "SLOT": SLOT})
    own.run(text)
    made = interpret(
        parse_program(text.encode(), "test.mpf"), Setup(dialect="siemens", folders=(tmp_path,))
    )
    cut, threads = defaultdict(float), defaultdict(float)
    for kind, length, feed, speed in zip(
        made.kind, made.length, made.feed, made.speed, strict=True
    ):
        if kind == Kind.FEED:
            cut[feed] += length
        elif kind == Kind.THREAD:
            threads[feed, speed] += length
    assert {k: v for k, v in cut.items() if v} == pytest.approx(
        {k: v for k, v in own.cut.items() if v}
    )
    assert dict(threads) == pytest.approx(dict(own.threads))
    assert made.length[made.kind == Kind.RAPID].sum() == pytest.approx(own.rapid)
    assert made.value[made.kind == Kind.DWELL].sum() == pytest.approx(own.waited)
    ends = made.end[np.isin(made.kind, (Kind.FEED, Kind.THREAD)), :3]
    for bottom in own.holes:
        assert np.abs(ends - bottom).max(axis=1).min() < 1e-9


def pocket(call, radius=5.0):
    setup = Setup(dialect="siemens", tools={1: Tool(diameter=2 * radius)})
    text = f"T1 M6\nG90 G17 G710 S1000 M3\nG0 Z50\n{call}\nM30\n"
    return interpret(parse_program(text.encode(), "test.mpf"), setup)


def points(made, rows, step=0.5):
    """Points along straight lines and circles, in the order of the rows."""
    start, found = made.start, []
    for row in rows:
        count = max(int(made.length[row] / step), 1)
        share = np.linspace(0, 1, count + 1)[:, None]
        line = start[row, :3] + share * (made.end[row, :3] - start[row, :3])
        if made.kind[row] == Kind.ARC:
            arm = start[row, :2] - made.centre[row, :2]
            turn = share[:, 0] * made.angle[row]
            line[:, 0] = made.centre[row, 0] + arm[0] * np.cos(turn) - arm[1] * np.sin(turn)
            line[:, 1] = made.centre[row, 1] + arm[0] * np.sin(turn) + arm[1] * np.cos(turn)
        found.append(line)
    return np.vstack(found)


@pytest.mark.parametrize("vari", [1, 11, 21])
@pytest.mark.parametrize(("prad", "mid", "fal", "fald", "mida"), [
    (20, 3, 0.5, 0.2, 6), (12.5, 2, 0, 0, 4), (30, 0, 0.3, 0, 0), (8, 5, 0, 1, 8),
])  # fmt: skip
def test_circular_pocket_has_the_length_of_its_circles(vari, prad, mid, fal, fald, mida):
    """Circles 2 π r and the steps between them at FFP1, the way down at FFD, level by level."""
    made = pocket(
        f"POCKET4(10,0,2,-7,{prad},50,40,{mid},{fal},{fald},300,100,0,{vari},{mida},,,2,1.5)"
    )
    wall, levels = prad - 5 - fal, math.ceil((7 - fald) / (mid or 7))
    count = math.ceil(wall / (mida or 8))
    circles = sum(2 * math.pi * wall * (i + 1) / count for i in range(count))
    into = 2.0 if vari == 21 else 0.0
    feeds = np.isin(made.kind, (Kind.FEED, Kind.ARC))
    surface = made.length[feeds & (made.feed == 300)].sum()
    assert surface == pytest.approx(levels * (circles + wall + into))
    down, depth = made.length[feeds & (made.feed == 100)].sum(), (7 - fald) / levels
    if vari == 11:
        assert down == pytest.approx(depth * levels + 2 * levels)
    elif vari == 21:
        turns = math.ceil((depth + 2) / 1.5)
        helix = math.hypot(turns * 2 * math.pi * 2, depth + 2)
        assert down == pytest.approx(levels * (2 + helix + 4 * math.pi))
    assert made.notices
    assert "approximate" in made.notices[0]


@pytest.mark.parametrize("call", [
    "POCKET3(10,0,2,-6,60,40,8,50,40,30,3,0.5,0.2,300,100,0,11,6)",
    "POCKET3(10,0,2,-6,60,40,8,50,40,-70,3,0.5,0.2,300,100,1,31,7,0,0,0,5)",
    "POCKET3(10,0,2,-6,30,70,0,50,40,0,2,0,0,300,100,2,21,,,,,4,1)",
    "POCKET3(10,0,2,-6,60,40,8,50,40,30,3,0.5,0.2,300,100,0,2,6)",
    "POCKET3(10,0,2,-6,60,40,5,50,40,30,3,0,0.2,300,100,3,12,6)",
])  # fmt: skip
def test_rectangular_pocket_stays_inside_and_leaves_only_its_allowance(call):
    made = pocket(call)
    given = [float(one or 0) for one in call[8:-1].split(",")]
    leng, wid, turned, fal, fald = *given[4:6], given[9], given[11], given[12]
    finish = given[16] % 10 == 2
    less, bottom = (0, 0) if finish else (fal, fald)
    rows = np.flatnonzero(np.isin(made.kind, (Kind.FEED, Kind.ARC)))
    path = points(made, rows)
    w = math.radians(turned)
    u = (path[:, 0] - 50) * math.cos(w) + (path[:, 1] - 40) * math.sin(w)
    v = -(path[:, 0] - 50) * math.sin(w) + (path[:, 1] - 40) * math.cos(w)
    half = np.array([leng / 2 - less - 5, wid / 2 - less - 5])
    assert np.abs(u).max() == pytest.approx(half[0])
    assert np.abs(v).max() == pytest.approx(half[1])
    assert path[:, 2].min() == pytest.approx(-6 + bottom)
    # all of the floor but what the corners keep lies under the tool
    if not (finish and not fald):
        floor = path[:, 2] < -6 + bottom + 1e-9
        a, b = np.meshgrid(np.linspace(-half[0], half[0], 20), np.linspace(-half[1], half[1], 20))
        gap = np.hypot(a.ravel()[:, None] - u[floor], b.ravel()[:, None] - v[floor]).min(axis=1)
        assert gap.max() < 5.0
    turning = made.angle[rows][made.kind[rows] == Kind.ARC]
    assert (np.sign(turning) == (1 if given[15] in (0, 3) else -1)).all()
    assert set(made.feed[rows]) == {300.0, 100.0}
    assert made.end[-1, :3].tolist() == [50, 40, 10]


@pytest.mark.parametrize(("call", "said"), [
    ("POCKET4(10,0,2,-6,4,0,0,3,0,0,300,100,0,11)", "does not go into the pocket"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,21)", "needs a radius RAD1"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,21,,,,16,1)", "goes into the pocket"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,31,,,,3)", "VARI is followed from 1 to 22"),
    ("POCKET3(10,0,2,-6,10,30,0,0,0,0,3,0,0,300,100,0,31,,,,,3)", "and room"),
    ("POCKET3(10,0,2,-6,60,30,0,0,0,0,3,0,0,300,100,0,31,,,,,0.00001)", "RAD1 1e-05 makes"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,7,300,100,0,11)", "MID 3 makes"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,11,-5)", "no sign"),
    ("POCKET4(10,0,2,6,20,0,0,3,0,0,300,100,0,11)", "DP lies below RFP"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,21,,,,3)", "DP1"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,2)", "nothing is left to finish"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,13)", "VARI"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,11,,10)", "milled before"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,0,100,0,11)", "FFP1"),
    ("POCKET4(10,0,2,-6,20,0,0,0.0001,0,0,300,100,0,11)", "levels"),
    ("POCKET3(10,0,2,-6,20,30)", "the first 17 at least"),
    ("POCKET4(10,0,2,-6,20,0,0,3,0,0,300,100,0,11,,,,,,1)", "leave them out"),
])  # fmt: skip
def test_pockets_that_are_not_followed_say_why(call, said):
    with pytest.raises(ValueError, match=said):
        pocket(call)
