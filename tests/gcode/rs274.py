"""What LinuxCNC's own interpreter makes of a program: the oracle of the room's tests.

``rs274`` prints its canonical commands with four decimals.  A copy of it whose format strings ask
for hexadecimal floats instead (of the same length, so that nothing else moves) prints every bit.
"""

import math
import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np

RS274 = Path("/usr/bin/rs274")
INCH = 25.4
TIMEOUT = 60.0
AXES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
PARAMETERS = (
    *range(5161, 5170), *range(5181, 5190), *range(5210, 5221), *range(5221, 5231),
    *range(5241, 5251), *range(5261, 5271), *range(5281, 5291), *range(5301, 5311),
    *range(5321, 5331), *range(5341, 5351), *range(5361, 5371), *range(5381, 5391),
)  # fmt: skip
"""Of which it wants a value."""
_COMMAND = re.compile(r"\s*\d+ N\S+\s+([A-Z_0-9]+)\((.*)\)$")
_NUMBER = re.compile(r"-?0x[0-9a-f.]+p[-+]\d+|-?\d+")


@dataclass(frozen=True)
class Answer:
    """What the interpreter commanded.

    Parameters
    ----------
    error : str
        Its message; empty when it took the program.
    ends : (M, 6) array
        Where each move ends in the machine, tool length included [mm, deg].
    rapid : (M,) array of bool
        Traverses.
    lengths : (M,) array
        Path of X Y Z [mm].
    arcs : (A, 4) array
        Of each arc: centre in its plane (machine) [mm], angle [rad], plane.
    dwell : float
        Sum [s].
    probed : bool
        It probed: then its stand-in for a machine backs away by 0.01 inch, which none does.
    feeds : (M,) array
        Of each move [mm/min] or [mm/rev]; under G93 the speed that comes of it; NaN in traverses.
    """

    error: str
    ends: np.ndarray
    rapid: np.ndarray
    lengths: np.ndarray
    arcs: np.ndarray
    dwell: float
    probed: bool
    feeds: np.ndarray


class Oracle:
    """LinuxCNC's interpreter with a tool table and folders of subprograms.

    Parameters
    ----------
    folder : Path
        For its files.
    tools : mapping
        Number -> length, diameter [mm].
    subroutines : sequence of Path
        Searched for subprograms.
    """

    def __init__(self, folder: Path, tools=None, subroutines=()) -> None:
        self.folder = folder
        self.program = folder / "rs274"
        self.program.write_bytes(RS274.read_bytes().replace(b"%.4f", b"%  a"))
        self.program.chmod(0o755)
        # the table counts inches
        lines = [
            f"T{n} P{n} D{diameter / INCH:.15f} Z{length / INCH:+.15f}\n"
            for n, (length, diameter) in (tools or {}).items()
        ]
        (folder / "tool.tbl").write_text("".join(lines))
        # a line of the ini file has at most 255 characters: short names, wherever the folders lie
        for number, subroutine in enumerate(subroutines):
            (folder / f"s{number}").symlink_to(Path(subroutine).resolve())
        paths = ":".join(f"s{number}" for number in range(len(subroutines)))
        (folder / "rs274.ini").write_text(f"[RS274NGC]\nSUBROUTINE_PATH = {paths}\n")

    def ask(self, program: Path) -> Answer:
        """Follow a program."""
        variables = self.folder / "rs274.var"
        variables.write_text("".join(f"{number}\t0\n" for number in PARAMETERS))
        done = subprocess.run(
            [self.program, "-i", self.folder / "rs274.ini", "-t", self.folder / "tool.tbl",
             "-v", variables, "-g", program],
            capture_output=True,
            timeout=TIMEOUT,
            check=False,
            env={"HOME": str(self.folder), "PATH": os.environ["PATH"]},
            cwd=self.folder,
        )  # fmt: skip
        path = _Path()
        for line in done.stdout.decode("latin-1").splitlines():
            found = _COMMAND.match(line)
            if found is not None:
                path.command(found[1], found[2])
        said = done.stderr.decode("latin-1").replace("executing\n", "").strip()
        return Answer(
            error=said or "no reason given" if done.returncode else "",
            ends=np.array(path.ends).reshape(-1, 6), rapid=np.array(path.rapid, dtype=bool),
            lengths=np.array(path.lengths), arcs=np.array(path.arcs).reshape(-1, 4),
            dwell=path.dwell, probed=b"STRAIGHT_PROBE" in done.stdout, feeds=np.array(path.feeds),
        )  # fmt: skip

    def ask_text(self, text: str) -> Answer:
        """Follow a program given as text."""
        path = self.folder / "program.ngc"
        path.write_text(text)
        return self.ask(path)


class _Path:
    """Follows canonical commands; everything in mm and degrees."""

    def __init__(self) -> None:
        self.point = np.zeros(6)
        self.g5x, self.g92, self.tool = np.zeros(6), np.zeros(6), np.zeros(6)
        self.angle = self.dwell = 0.0
        self.unit = 1.0
        self.plane = 17
        self.ends: list[np.ndarray] = []
        self.rapid: list[bool] = []
        self.lengths: list[float] = []
        self.feeds: list[float] = []
        self.feed = 0.0
        self.arcs: list[tuple[float, ...]] = []

    def command(self, name: str, text: str) -> None:
        if name == "USE_LENGTH_UNITS":
            self.unit = INCH if "INCHES" in text else 1.0
        elif name == "SELECT_PLANE":
            self.plane = {"XY": 17, "XZ": 18, "YZ": 19}[text[-2:]]
        elif name in _HANDLERS:
            numbers = [float.fromhex(n) if "x" in n else float(n) for n in _NUMBER.findall(text)]
            _HANDLERS[name](self, numbers)

    def machine(self, point: np.ndarray) -> np.ndarray:
        shifted = point + self.g92
        x, y = shifted[:2]
        c, s = math.cos(self.angle), math.sin(self.angle)
        shifted[:2] = c * x - s * y, s * x + c * y
        return shifted + self.g5x + self.tool

    def _offset(self, name: str, value) -> None:
        """Offsets change, the machine stands still."""
        before = self.machine(self.point)
        setattr(self, name, value)
        shifted = before - self.g5x - self.tool
        x, y = shifted[:2]
        c, s = math.cos(self.angle), math.sin(self.angle)
        shifted[:2] = c * x + s * y, -s * x + c * y
        self.point = shifted - self.g92

    def _mm(self, numbers: list[float]) -> np.ndarray:
        vector = np.array(numbers[:6])
        vector[:3] *= self.unit
        return vector

    def set_g5x(self, numbers: list[float]) -> None:
        self._offset("g5x", self._mm(numbers[1:]))

    def set_g92(self, numbers: list[float]) -> None:
        self._offset("g92", self._mm(numbers))

    def set_rotation(self, numbers: list[float]) -> None:
        self._offset("angle", math.radians(numbers[0]))

    def set_tool(self, numbers: list[float]) -> None:
        self._offset("tool", self._mm(numbers))

    def dwelt(self, numbers: list[float]) -> None:
        self.dwell += numbers[0]

    def set_feed(self, numbers: list[float]) -> None:
        self.feed = numbers[0] * self.unit

    def straight(self, numbers: list[float]) -> None:
        end = self._mm(numbers)
        self._moved(end, float(np.linalg.norm((end - self.point)[:3])))

    def traverse(self, numbers: list[float]) -> None:
        self.straight(numbers)
        self.rapid[-1], self.feeds[-1] = True, math.nan

    def tap(self, numbers: list[float]) -> None:
        there = np.array(numbers[:3]) * self.unit
        depth = float(np.linalg.norm(there - self.point[:3]))
        self._moved(np.array([*there, *self.point[3:]]), depth)
        self._moved(self.point_before, depth)

    def _moved(self, end: np.ndarray, length: float) -> None:
        self.point_before, self.point = self.point, end
        self.lengths.append(length)
        self.rapid.append(False)
        self.feeds.append(self.feed)
        self.ends.append(self.machine(end))

    def arc(self, numbers: list[float]) -> None:
        first_end, second_end, first, second, turns, axial, *rest = numbers
        u, v, w = AXES[self.plane]
        end = np.array([0.0, 0.0, 0.0, *rest])
        end[[u, v, w]] = np.array([first_end, second_end, axial]) * self.unit
        centre = np.array([first, second]) * self.unit
        start_arm, end_arm = self.point[[u, v]] - centre, end[[u, v]] - centre
        way = 1 if turns > 0 else -1
        angle = way * (math.atan2(*end_arm[::-1]) - math.atan2(*start_arm[::-1]))
        while angle <= 1e-12:
            angle += 2 * math.pi
        angle += 2 * math.pi * (abs(turns) - 1)
        middle = self.point.copy()
        middle[[u, v]] = centre
        middle = self.machine(middle)
        self.arcs.append((middle[u], middle[v], way * angle, self.plane))
        radii = np.linalg.norm(start_arm), np.linalg.norm(end_arm)
        self._moved(end, _spiral(*radii, angle, end[w] - self.point[w]))


def _spiral(r_0: float, r_1: float, angle: float, pitch: float) -> float:
    """Length where radius and height go linearly with the angle, by Simpson's rule."""
    if r_0 == r_1:
        return math.hypot(r_0 * angle, pitch)
    count = 200
    r = np.linspace(r_0, r_1, count + 1)
    speed = np.sqrt((r * angle) ** 2 + (r_1 - r_0) ** 2 + pitch**2)
    weights = np.full(count + 1, 2.0)
    weights[1::2], weights[[0, -1]] = 4.0, 1.0
    return float(speed @ weights) / (3 * count)


_HANDLERS = {
    "SET_G5X_OFFSET": _Path.set_g5x,
    "SET_G92_OFFSET": _Path.set_g92,
    "SET_XY_ROTATION": _Path.set_rotation,
    "USE_TOOL_LENGTH_OFFSET": _Path.set_tool,
    "SET_FEED_RATE": _Path.set_feed,
    "DWELL": _Path.dwelt,
    "STRAIGHT_TRAVERSE": _Path.traverse,
    "STRAIGHT_FEED": _Path.straight,
    "STRAIGHT_PROBE": _Path.straight,
    "RIGID_TAP": _Path.tap,
    "ARC_FEED": _Path.arc,
}
