"""Programs optimised with a margin of stability do not chatter where they are cut.

The shop's mill cuts them tooth by tooth with a tool that gives way, by code of its own.
``KERF_CHATTER_PROGRAMS=100 pytest -s -m proof`` cuts as many and prints what came out.
"""

import os
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest

from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.stability.tip_dynamics import Mode, TipDynamics
from pipeline.cutting.tool import Tool
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.methods.blockwise import blockwise_optimum
from pipeline.optimisation.settings import Grouping
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.optimisation.text.rewrite import rewrite
from pipeline.schema.limits import CutLimit
from pipeline.shop.cutting.parameters import EndMill, Workpiece
from pipeline.shop.trial.cutting import Chance
from pipeline.shop.trial.job import TrialJob
from pipeline.shop.trial.trials import prepare
from tests.cutting.chatter import depth_limits, regenerative_cut
from tests.optimisation.problem_parts import NO_MARGINS, cut_on, problem_on
from tests.shop.test_trial_chatter import CHATTER, STEADY
from tests.shop.tip_chatter import TipMode, unrepeated

PROGRAMS = int(os.environ.get("KERF_CHATTER_PROGRAMS", "100"))
K_T, K_R = 796.0, 169.0
LAW = ForceLaw.linear(K_tc=K_T, K_rc=K_R)
WORK = Workpiece(
    tangential=K_T, radial=K_R, axial=0.0, exponent=0.0, edge_tangential=0.0, edge_radial=0.0,
    edge_axial=0.0,
)  # fmt: skip
MARGIN = 0.1


@dataclass(frozen=True)
class Job:
    """A random program of one pass along a wall, its tool and tip."""

    text: str
    tool: Tool
    modes: tuple[Mode, ...]
    speeds: tuple[float, float]


def job(seed: int) -> Job:
    """Any engagement, teeth, speed and tip; as deep as a speed near the programmed one allows."""
    rng = np.random.default_rng(seed)
    diameter, flutes = float(rng.choice([8.0, 10.0, 12.0])), int(rng.integers(1, 5))
    helix = float(rng.choice([0.0, 30.0]))
    tool = Tool(kind="flat", diameter_mm=diameter, flutes=flutes, helix_deg=helix, stickout_mm=30.0)
    modes = tuple(
        Mode(
            direction=way, natural_frequency_Hz=float(rng.uniform(600, 1500)),
            damping=float(rng.uniform(0.02, 0.05)), stiffness_N_m=float(rng.uniform(3e6, 1e7)),
        )
        for way in "xy"
    )  # fmt: skip
    share = float(np.exp(rng.uniform(np.log(0.05), 0.0)))
    width = share * diameter
    left = bool(rng.random() < 0.5)
    arc = float(np.arccos(1 - 2 * share))
    entry, exit = (0.0, arc) if left else (np.pi - arc, np.pi)
    speed = float(np.round(rng.uniform(4000, 12_000) / 50) * 50)
    speeds = (0.7 * speed, 1.4 * speed)
    cut = regenerative_cut(LAW, tool, entry=entry, exit=exit)
    limit = depth_limits(modes, cut, np.linspace(*speeds, 25) / 60, highest=9e-3).depth_limit
    depth = 0.85 * float(np.minimum(limit, 9e-3).max()) / (1 + MARGIN) * 1e3
    y = width - diameter / 2 if left else 50 - width + diameter / 2
    feed = round(0.02 * flutes * speed)
    text = (
        f"G21 G90\nT1 M6\nG0 X-20 Y{y:.4f} S{speed:g} M3\nZ5\nG1 Z{-depth:.4f} F2000\n"
        f"X80 F{feed}\nG0 Z5\nM30\n"
    )
    return Job(text=text, tool=tool, modes=modes, speeds=speeds)


def optimised(of: Job) -> str:
    """The program with the answer's words."""
    cut = cut_on(of.text, tools={1: of.tool}, laws={1: LAW}, resolution=0.25)
    program = parse_program(of.text.encode(), "part.nc")
    moves = cut.plan.path.moves
    editable = editable_blocks(program, moves)
    limits = CutLimit(
        load_N=1e5, chip_um=(2.0, 20.0), speed_rpm=of.speeds,
        margins=replace(NO_MARGINS, stability=MARGIN),
    )  # fmt: skip
    tips = TipDynamics(source="made up", every=of.modes)
    problem = problem_on(cut, limits, editable=editable, dynamics=tips)
    found = blockwise_optimum(problem, "time", Grouping())
    new = rewrite(program, moves, editable, found.row_feeds, found.row_speeds, Setup())
    return new.text.decode()


def shares(of: Job, text: str) -> dict[int, float]:
    """What differs from tooth to tooth in each line, on the shop's mill."""
    tool = EndMill(
        number=1, diameter=of.tool.diameter_mm, flutes=of.tool.flutes, helix=of.tool.helix_deg,
        runout=0.0, tilt=0.0, sharpness=(1.0,) * of.tool.flutes, break_in=0.0, wear_rate=0.0,
    )  # fmt: skip
    modes = [
        TipMode(
            direction=m.direction, frequency=m.natural_frequency_Hz, damping=m.damping,
            stiffness=m.stiffness,
        )
        for m in of.modes
    ]  # fmt: skip
    trial = TrialJob(
        blank=(0.0, 60.0, 0.0, 50.0, -10.0, 0.0), limit_load_N=1e5, tools={1: tool},
        workpiece=WORK, lengths={1: 0.0},
    )  # fmt: skip
    its = prepare(text, "part.nc", trial, STEADY)
    part = Chance(
        workpiece=WORK, tools={1: tool}, used={1: 0.0}, deeper={1: 0.0}, speed_error=0.0, angle=0.3
    )
    return unrepeated(its.track, its.swept, part, STEADY, {1: modes}, np.random.default_rng(0))


def outcome(seed: int) -> tuple[float, float] | None:
    """Worst share before and after; None where no answer or nothing steady was cut."""
    of = job(seed)
    try:
        text = optimised(of)
    except ValueError as none:
        if "stab" in str(none) or "limit" in str(none):
            return None
        raise
    before, after = shares(of, of.text), shares(of, text)
    return (max(before.values()), max(after.values())) if before and after else None


def test_an_optimised_program_does_not_chatter() -> None:
    found = outcome(5)
    assert found is not None and found[1] < CHATTER < found[0]


@pytest.mark.proof
@pytest.mark.slow
def test_none_of_many_optimised_programs_chatters() -> None:
    found = [outcome(seed) for seed in range(PROGRAMS)]
    judged = np.array([one for one in found if one is not None])
    sys.stdout.write(
        f"\n{PROGRAMS} programs, {len(judged)} with an answer and a steady cut; chatter before: "
        f"{(judged[:, 0] > CHATTER).sum()}, after: {(judged[:, 1] > CHATTER).sum()}, worst "
        f"{judged[:, 1].max():.3f}"
    )
    assert len(judged) > 0.6 * PROGRAMS
    assert (judged[:, 0] > CHATTER).sum() > 0.1 * PROGRAMS
    assert (judged[:, 1] < CHATTER).all()
