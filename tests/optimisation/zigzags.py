"""Programs of many short blocks at changing depths, where blocks act on each other."""

import numpy as np

from pipeline.gcode.program import parse_program
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.schema.limits import CutLimit
from tests.optimisation.problem_parts import cut_on, problem_on
from tests.twin.cut_parts import CONTROL

PAPER = CutLimit(load_N=60.0, feed_mm_min=(100.0, 1500.0), speed_rpm=(1000.0, 8000.0))
"""Of Sim2023, but for the greatest F, so that acceleration counts."""
FREE = CutLimit(load_N=80.0)


def zigzag(seed: int, blocks: int = 15, tools: int = 2) -> str:
    """Passes along X with each tool: blocks of 0.3 to 8 mm, some of which go deeper or higher."""
    rng = np.random.default_rng(seed)
    lines = []
    for tool in range(1, tools + 1):
        y = 20 * tool - 10
        speed, feed = 1000 * rng.integers(3, 9), 100 * rng.integers(2, 10)
        depth = rng.uniform(0.5, 3)
        lines += [f"T{tool} M6", f"G0 X-10 Y{y} S{speed} M3", "Z5", f"G1 Z-{depth:.2f} F300"]
        lines += [f"F{feed}"]
        x = -10.0
        for _ in range(blocks):
            x += rng.choice([0.3, 1.0, 3.0, 8.0])
            z = f" Z-{rng.uniform(0.5, 3):.2f}" if rng.random() < 0.2 else ""
            lines.append(f"X{x:.2f} Y{y + rng.uniform(-3, 3):.2f}{z}")
        lines.append("G0 Z5")
    return "\n".join([*lines, "M30", ""])


def zigzag_problem(seed: int, limits: CutLimit = PAPER, *, control=CONTROL, **basis) -> Problem:
    """Of one of those programs."""
    text = zigzag(seed)
    cut = cut_on(text, control=control)
    program = parse_program(text.encode(), "zigzag.nc")
    editable = editable_blocks(program, cut.plan.path.moves)
    return problem_on(cut, limits, editable=editable, **basis)
