"""The part programs of a mill's control: four of its own, written by a postprocessor.

Cutting data of catalogues (Sandvik, Walter) for aluminium.
"""

from dataclasses import replace

import numpy as np

from pipeline.shop.control_parameters import ControlParameters
from pipeline.shop.cuts import (
    Curve,
    Work,
    bolt_circle,
    chords,
    contour,
    drilling,
    facing,
    grid,
    pocket,
    trochoidal_slot,
)
from pipeline.shop.post import PartProgram, Post, Tool

TOOLS = (
    Tool(number=1, name="50MM FACE MILL", diameter=50, speed=5000, feed=2200, plunge=800),
    Tool(number=2, name="16MM ENDMILL", diameter=16, speed=6000, feed=1500, plunge=500),
    Tool(number=4, name="12MM ENDMILL", diameter=12, speed=8000, feed=2200, plunge=600),
    Tool(number=5, name="10MM ENDMILL", diameter=10, speed=9500, feed=2600, plunge=700),
    Tool(number=9, name="8MM FINISH ENDMILL", diameter=8, speed=11500, feed=3000, plunge=800),
    Tool(number=11, name="10MM SPOTDRILL", diameter=10, speed=4500, feed=400, plunge=400),
    Tool(number=12, name="6.8MM DRILL", diameter=6.8, speed=5200, feed=650, plunge=650),
    Tool(number=14, name="5MM DRILL", diameter=5, speed=6500, feed=600, plunge=600),
)


def part_programs(
    control: ControlParameters, random: np.random.Generator
) -> tuple[list[PartProgram], PartProgram]:
    """The four programs of a machine, and the third as it was edited at the control.

    Dimensions and feeds are drawn once; the edited program has the finish of one level more.
    """
    lengths = {t.number: round(float(random.uniform(85, 165)), 3) for t in TOOLS}
    pace = {t.number: round(float(random.uniform(0.85, 1.15)), 2) for t in TOOLS}
    tools = {
        t.number: replace(
            t, length=lengths[t.number], feed=round(t.feed * pace[t.number] / 10) * 10.0
        )
        for t in TOOLS
    }
    work = Work(x=float(random.integers(110, 140)), y=float(random.integers(80, 100)))
    curve = Curve(
        centre=work.middle, radius=float(random.uniform(29, 33)),
        harmonics=((3, float(random.uniform(2.0, 3.2))), (7, float(random.uniform(0.7, 1.1)))),
        wave=float(random.uniform(0.2, 0.6)),
    )  # fmt: skip
    levels = int(random.integers(9, 11))
    programs = [
        _plate(control, tools, work), _pockets(control, tools, work),
        _cam(control, tools, work, curve, levels), _manifold(control, tools, work),
    ]  # fmt: skip
    return programs, _cam(control, tools, work, curve, levels + 1)


def _plate(control: ControlParameters, tools: dict[int, Tool], work: Work) -> PartProgram:
    post, name = _begun(control, 1, "BASE PLATE", [tools[k] for k in (1, 2, 11, 12)])
    post.take(tools[1])
    facing(post, work, 1.0)
    post.take(tools[2])
    contour(post, work, [4.0, 8.0, 12.0], springs=1)
    holes = grid(work, 4, 3, 14.0)
    post.take(tools[11])
    drilling(post, holes, 3.2)
    post.take(tools[12])
    drilling(post, holes, 16.0, peck=4.0)
    return post.end(name)


def _pockets(control: ControlParameters, tools: dict[int, Tool], work: Work) -> PartProgram:
    post, name = _begun(control, 2, "BEARING HOUSING", [tools[k] for k in (1, 4, 5)])
    post.take(tools[1])
    facing(post, work, 0.5)
    post.take(tools[4])
    pocket(post, (work.x * 0.33, work.y / 2), 26.0, 9.0)
    post.take(tools[5])
    trochoidal_slot(post, (work.x * 0.62, work.y / 2), 34.0, 6.0)
    return post.end(name)


def _cam(
    control: ControlParameters, tools: dict[int, Tool], work: Work, curve: Curve, levels: int
) -> PartProgram:
    post, name = _begun(control, 3, "CAM", [tools[k] for k in (4, 9)])
    post.take(tools[4])
    pocket(post, work.middle, 21.0, 6.0)
    post.take(tools[9])
    chords(post, curve, levels, 0.6, 0.6)
    return post.end(name)


def _manifold(control: ControlParameters, tools: dict[int, Tool], work: Work) -> PartProgram:
    post, name = _begun(control, 4, "VALVE BLOCK", [tools[k] for k in (11, 14, 12, 2)])
    small, large = bolt_circle(work.middle, 26.0, 10), grid(work, 3, 2, 12.0)
    post.take(tools[11])
    drilling(post, small + large, 2.6)
    post.take(tools[14])
    drilling(post, small, 14.0, peck=3.5)
    post.take(tools[12])
    drilling(post, large, 20.0, peck=5.0)
    post.take(tools[2])
    contour(post, work, [3.0])
    return post.end(name)


def _begun(
    control: ControlParameters, number: int, title: str, tools: list[Tool]
) -> tuple[Post, str]:
    name = f"O{control.first_program + number}"
    post = Post(
        numbered=control.numbered, spaced=not control.numbered,
        peck_clearance=control.peck_clearance,
    )  # fmt: skip
    post.begin(name, title, tuple(tools), control.work_offset)
    return post, name
