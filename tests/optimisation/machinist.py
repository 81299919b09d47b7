"""Programs as a process engineer writes them, optimised by ``kerf optimise``, read by a machinist.

F and S are those that stand in the two texts, row by row, not what the control reaches.  The
machines are those of conf/ before anything was identified.
"""

import json
import re
import shutil
from dataclasses import dataclass, field
from functools import cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from pipeline.cutting.tool import Tool, ToolTable
from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.parameters import structure
from pipeline.schema.arrays import Floats
from tests.small_project import ROOT
from tests.test_cli import kerf

PROGRAMS = Path(__file__).with_name("programs")
MOVING = (Kind.RAPID, Kind.FEED, Kind.ARC, Kind.PROBE, Kind.THREAD)
AT_FEED = (Kind.FEED, Kind.ARC)


@dataclass(frozen=True, kw_only=True)
class Order:
    """A program with its blank, material, machine, load limit [N] and resolution [mm].

    Without ``dynamics`` those of the machine's tips are left out.
    """

    name: str
    machine: str
    stock: str
    material: str
    limit_load: float
    resolution: float
    dynamics: bool = False


BRACKET = Order(
    name="bracket", machine="mill02", stock="box:0,120,0,80,-25,1",
    material="steel_medium_carbon", limit_load=2500.0, resolution=0.5,
)  # fmt: skip
ALUMINIUM = Order(
    name="aluminium", machine="mill01", stock="box:0,80,0,50,-20,0", material="A6061",
    limit_load=600.0, resolution=0.25,
)  # fmt: skip


SLOTS = Order(
    name="slots", machine="mill02", stock="box:0,80,0,60,-15,0", material="steel_medium_carbon",
    limit_load=2500.0, resolution=0.5, dynamics=True,
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """Rows that move, in the order of the program; R of them, before and after."""

    line: np.ndarray
    tool: np.ndarray
    """Line of the program, from 1; tool in the spindle; shape (R,)."""
    at_feed: np.ndarray
    in_cut: np.ndarray
    """G1, G2, G3; whether the tool is in the material; shape (R,)."""
    drop: Floats
    length: Floats
    """Height lost, above 0 in plunges and ramps, and length [mm]; shape (R,)."""
    feed: Floats
    speed: Floats
    """F [mm/min] and S [rev/min]; shape (2, R)."""
    f_z: Floats
    v_c: Floats
    """Feed per tooth [mm], cutting speed at the full diameter [m/min], NaN at rest; (2, R)."""

    @property
    def in_air(self) -> np.ndarray:
        """Moves at feed that do not cut; a repeated point is no move."""
        return self.at_feed & ~self.in_cut & (self.length > 0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Read:
    """A program before and after, and its document."""

    before: tuple[str, ...]
    after: tuple[str, ...]
    rows: Rows
    document: dict[str, Any] = field(repr=False)

    def section(self, comment: str) -> range:
        """Lines from the comment to the next comment or ``M1``, counted from 1."""
        first = next(k for k, line in enumerate(self.before) if line.startswith(f"({comment}"))
        ends = (
            k for k in range(first + 1, len(self.before))
            if self.before[k].startswith("(") or self.before[k] in ("M1", "M30")
        )  # fmt: skip
        return range(first + 1, next(ends) + 1)

    def of_tool(self, number: int) -> range:
        """Lines from ``T<number> M6`` to the last before the next tool change, from 1."""
        changes = [k for k, line in enumerate(self.before) if re.search(r"\bT\d+ M6\b", line)]
        for first, after in pairwise([*changes, len(self.before)]):
            if self.before[first].startswith(f"T{number} "):
                return range(first + 1, after + 1)
        raise ValueError(f"T{number} is not in the program")

    def among(self, lines: range) -> np.ndarray:
        """Rows of those lines, shape (R,) of bool."""
        return np.isin(self.rows.line, lines)

    def changed_words(self, letter: str) -> list[tuple[int, str]]:
        """Line and value of each ``letter`` word of the program after that differs or is new."""
        return [
            (k, value)
            for k, (old, new) in enumerate(zip(self.before, self.after, strict=True), 1)
            if (value := _word(new, letter)) is not None and value != _word(old, letter)
        ]

    def new_words(self, letter: str) -> list[int]:
        """Lines that have a word ``letter`` only after."""
        return [k for k, _ in self.changed_words(letter)
                if _word(self.before[k - 1], letter) is None]  # fmt: skip


def _word(line: str, letter: str) -> str | None:
    found = re.search(rf"{letter}([\d.]+)", re.sub(r"\([^)]*\)", "", line))
    return None if found is None else found[1]


def optimised(order: Order, *options: str, edit: tuple[tuple[str, str], ...] = ()) -> Read:
    """The program of ``order`` optimised with more ``options``; ``edit`` replaces text in it.

    Raises ValueError when the command refuses it.
    """
    found = _once(order, options, edit)
    if isinstance(found, str):
        raise ValueError(found)
    return found


@cache
def _once(order: Order, options: tuple[str, ...], edit: tuple[tuple[str, str], ...]) -> Read | str:
    """The program read, or the sentence with which the command refuses it."""
    with TemporaryDirectory() as folder:
        project = new_project(Path(folder) / "project", order)
        path = project / f"{order.name}.nc"
        text = path.read_text()
        for old, new in edit:
            if old not in text:
                raise ValueError(f"{path.name} holds no {old!r}")
            text = text.replace(old, new)
        path.write_text(text)
        given = cut_of(order)
        done = kerf(project, "optimise", path.name, *given, "--objective", "time", "--limit-load",
                    str(order.limit_load), "--out", "o.nc", "--json", "o.json",
                    *options)  # fmt: skip
        if done.exit_code != 0:
            return done.stderr
        simulated = kerf(project, "simulate", path.name, *given, "--json", "s.json")
        if simulated.exit_code != 0:
            raise ValueError(simulated.stderr)
        cut = {
            block["row"] for block in json.loads((project / "s.json").read_text())["cut"]["blocks"]
        }
        before, after = path.read_text(), (project / "o.nc").read_text()
        return Read(
            before=tuple(before.splitlines()), after=tuple(after.splitlines()),
            rows=_rows(before, after, cut, order),
            document=json.loads((project / "o.json").read_text()),
        )  # fmt: skip


def new_project(folder: Path, order: Order) -> Path:
    """A project with the program and its tools, that searches as tests do."""
    shutil.copytree(ROOT / "conf", folder / "conf", symlinks=True)
    config = folder / "conf/config.yaml"
    config.write_text(config.read_text().replace("budget: default", "budget: quick"))
    search = folder / "conf/optimisation/default.yaml"
    search.write_text(search.read_text().replace("draws: 1024", "draws: 64"))
    for path in () if order.dynamics else (folder / "conf/machine").glob("mill*.yaml"):
        # usual values of 40-taper spindles, by which each slot in steel would chatter
        text = re.sub(r"^dynamics:.*\n(?:  .*\n)+", "", path.read_text(), flags=re.MULTILINE)
        path.write_text(re.sub(r"^  dynamics: \$\{.*\n", "", text, flags=re.MULTILINE))
    for end in ("nc", "yaml"):
        shutil.copy(PROGRAMS / f"{order.name}.{end}", folder)
    return folder


def cut_of(order: Order) -> list[str]:
    """Options of the cut, of ``kerf simulate`` and ``kerf optimise``."""
    return ["--machine", order.machine, "--stock", order.stock, "--tool-table",
            f"{order.name}.yaml", "--material", order.material, "--resolution",
            str(order.resolution)]  # fmt: skip


def tools_of(name: str) -> dict[int, Tool]:
    """The tools of a program."""
    values = yaml.safe_load((PROGRAMS / f"{name}.yaml").read_text())
    return structure({"it": values}, "it", ToolTable).tools


def moves_of(text: str) -> Moves:
    """Moves of a program, offsets and lengths of tools left out."""
    return interpret(parse_program(text.encode(), "P.nc"), Setup())


def _rows(before: str, after: str, cut: set[int], order: Order) -> Rows:
    both = [moves_of(text) for text in (before, after)]
    rows = [np.flatnonzero(np.isin(moves.kind, MOVING)) for moves in both]
    moves, moving = both[0], rows[0]
    feed = np.stack([m.feed[r] for m, r in zip(both, rows, strict=True)])
    turning = np.stack([m.direction[r] != 0 for m, r in zip(both, rows, strict=True)])
    speed = np.stack([m.speed[r] for m, r in zip(both, rows, strict=True)])
    tools = tools_of(order.name)
    tool = moves.tool[moving]
    teeth = np.array([tools[t].flutes if t in tools else np.nan for t in tool.tolist()])
    diameter = np.array([tools[t].diameter_mm if t in tools else np.nan for t in tool.tolist()])
    spun = np.where(turning & (speed > 0), speed, np.nan)
    height = np.concatenate([[moves.origin[2]], moves.end[:, 2]])
    return Rows(
        line=moves.line[moving], tool=tool, at_feed=np.isin(moves.kind[moving], AT_FEED),
        in_cut=np.isin(moving, list(cut)), drop=(height[:-1] - height[1:])[moving],
        length=moves.length[moving], feed=feed, speed=speed,
        f_z=feed / (spun * teeth), v_c=np.pi * diameter * spun * 1e-3,
    )  # fmt: skip
