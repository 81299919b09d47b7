"""Windows of the simulated shop's tool lives: its wear and mean forces, without sensors."""

from collections.abc import Sequence
from dataclasses import replace
from fnmatch import fnmatchcase
from functools import cache
from math import pi
from pathlib import Path
from typing import Any

import cattrs
import numpy as np
import yaml

from pipeline.shop.cutting.force import Motion, X, Y
from pipeline.shop.parameters import ShopParameters, Wear
from pipeline.shop.wear.parameters import PlannedLife
from pipeline.shop.wear.records import Course, course
from pipeline.shop.wear.teeth import cut_forces, workpiece
from pipeline.signals.wear_windows import WearWindows
from pipeline.submodels.wear.life import WearLifeSettings

CONF = Path(__file__).parents[3] / "conf"
TURNS = 180
"""Steps of a turn of which the mean force is taken."""
SAMPLES = 4


@cache
def machine(name: str) -> dict[str, Any]:
    """The machine's file."""
    found: dict[str, Any] = yaml.safe_load((CONF / f"machine/{name}.yaml").read_text())
    return found


def life_settings(name: str) -> WearLifeSettings:
    """Section ``wear_life`` of a mill."""
    return cattrs.structure(machine(name)["wear_life"], WearLifeSettings)


@cache
def parameters(name: str, seed: int) -> ShopParameters:
    """The mill with another seed, and no more records than lives need."""
    section = yaml.safe_load((CONF / f"shop/{name}.yaml").read_text())
    p = cattrs.structure(section | {"seed": seed}, ShopParameters)
    return replace(p, wear=replace(p.wear, most=36))


def is_training(name: str, tool: str) -> bool:
    """Whether models are fitted on a tool."""
    return any(
        fnmatchcase(f"wear/{tool}_001.parquet", p) for p in machine(name)["roles"]["training"]
    )


@cache
def followed(name: str, seed: int, tool: str) -> Course:
    """The life of a tool as the shop has it."""
    p = parameters(name, seed)
    plan = next(one for one in p.wear.lives if one.tool == tool)
    return course(p.wear, plan, p.generator(f"wear {tool}"))


def tools(name: str, *, training: bool) -> list[str]:
    """Tools of a mill that models are fitted on, or not."""
    lives = parameters(name, 1).wear.lives
    return [one.tool for one in lives if is_training(name, one.tool) == training]


def windows(
    name: str, seed: int, some: Sequence[str], *, forces: bool = False, every: int = 1,
    upto: int | None = None,
) -> WearWindows:  # fmt: skip
    """One window a record of ``some`` tools, with readings interpolated as the reader does it.

    With ``forces`` the mean force is that of each record's cut, with the depth and the hardness
    that it happened to have.
    """
    p = parameters(name, seed)
    found = []
    for plan in (one for one in p.wear.lives if one.tool in some):
        life = followed(name, seed, plan.tool)
        rows = np.arange(life.times.size)[:upto:every]
        found.append(_windows(p.wear, plan, life, rows, forces, p.generator(f"test {plan.tool}")))
    return WearWindows.joined(found)


def _windows(
    wear: Wear, plan: PlannedLife, life: Course, rows: np.ndarray, forces: bool,
    random: np.random.Generator,
) -> WearWindows:  # fmt: skip
    there = np.isfinite(life.measured)
    read = np.interp(life.times, life.times[there], life.measured[there])
    told = [life.cuts[k % len(life.cuts)] for k in rows]
    values = np.zeros((rows.size, 2, SAMPLES), np.float32)
    for place, k in enumerate(rows if forces else ()):
        values[place] = -mean_force(wear, life, int(k), random)[:, None]
    words = {"tool_type": plan.cutter, "cut_type": None}
    conditions: dict[str, Any] = {
        "spindle_speed": np.array([c.speed for c in told]),
        "feed": np.array([c.feed for c in told]),
        "axial_depth": np.array([c.depth for c in told]),
        "radial_depth": np.array([c.width for c in told]),
        "tool_type": np.full(rows.size, words["tool_type"]),
        "cut_type": np.array([life.names[k % len(life.names)] for k in rows]),
    }
    name = np.array([f"wear/{plan.tool}_{k + 1:03d}.parquet" for k in rows])
    return WearWindows(
        values=values, channels=("force_x", "force_y"), units=("N", "N"), rate_Hz=5000.0,
        wear=read[rows], wear_unit="um", measured=there[rows], conditions=conditions,
        condition_units={"spindle_speed": "rev/min", "feed": "mm/min", "axial_depth": "mm",
                         "radial_depth": "mm"},
        tool=np.full(rows.size, plan.tool), recording=name, time=np.zeros(rows.size),
        progress=life.times[rows], progress_unit="min",
    )  # fmt: skip


def mean_force(wear: Wear, life: Course, k: int, random: np.random.Generator) -> np.ndarray:
    """Mean force on the tool over a turn in the record ``k``, shape (2,) [N]."""
    c = life.cuts[k % len(life.cuts)]
    true = replace(c, depth=c.depth * (1 + random.normal(0, wear.depth_error)))
    angle = np.arange(TURNS) / TURNS * 2 * pi
    x = 0.05 + angle * c.feed / 60e3 / (c.speed * pi / 30)
    material = workpiece(wear.workpiece, float(life.hardness[k]))
    motion = Motion(angle=angle, x=x)
    force = cut_forces(true, life.tool.mill, material, life.land[k], motion, 120.0)
    return np.asarray(force.mean(axis=0)[[X, Y]])
