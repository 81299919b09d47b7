"""Postprocessor: text of a part program (Fanuc, mm, XY plane) and the steps of each line."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import atan2, inf, tau
from typing import Any, Literal

Kind = Literal["rapid", "line", "arc", "home", "tool", "spindle", "code", "dwell", "end"]
Point = tuple[float, float, float]

SAFE = 50.0
"""Height above the workpiece before the return to the reference position [mm]."""


@dataclass(frozen=True, kw_only=True)
class Tool:
    """One tool: diameter and length [mm], speed [rev/min], feeds of cut and plunge [mm/min]."""

    number: int
    name: str
    diameter: float
    speed: int
    feed: float
    plunge: float
    length: float = 100.0


@dataclass(frozen=True, kw_only=True)
class Step:
    """Motion or event of one line, or of a part of a canned cycle."""

    kind: Kind
    """Kind of the step; ``home`` goes to the reference position of Z."""
    line: int
    """Line of the program's text, from 1."""
    end: Point
    """Programmed X Y Z after it [mm]; an infinite Z is that of the reference position."""
    centre: tuple[float, float] = (0.0, 0.0)
    turn: float = 0.0
    """Centre of an arc in X and Y [mm], angle swept anticlockwise [rad]; 0 for none."""
    feed: float = 0.0
    """Feed [mm/min]."""
    number: int = 0
    """Number of the tool, of the M code, or the spindle's speed [rev/min]."""
    seconds: float = 0.0
    """Seconds of a dwell."""


@dataclass(frozen=True, kw_only=True)
class PartProgram:
    """A program as text and as steps."""

    name: str
    text: str
    steps: tuple[Step, ...]
    tools: tuple[Tool, ...]

    @property
    def lines(self) -> int:
        """Number of lines of the text."""
        return self.text.count("\n")

    @property
    def lengths(self) -> dict[int, float]:
        """Length of each tool by its number [mm]."""
        return {tool.number: tool.length for tool in self.tools}


def word(letter: str, value: float) -> str:
    """A word with a decimal point, as controls require it: ``X12.5``, ``Z-3.``."""
    return f"{letter}{round(value, 3) + 0.0:.3f}".rstrip("0")


@dataclass(kw_only=True)
class Post:
    """A program that is being written."""

    numbered: bool
    spaced: bool
    """Whether lines have N words, and blanks between words."""
    peck_clearance: float
    """Height above the last depth at which G83 ends its rapid [mm]."""
    lines: list[str] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    tools: list[Tool] = field(default_factory=list)
    at: Point = (0.0, 0.0, inf)
    motion: str = ""  # modal G0 to G3
    feed: float = 0.0  # modal F

    def begin(self, name: str, title: str, tools: Sequence[Tool], offset: Point) -> None:
        """Write the head: name, set-up, safe state."""
        self.lines += ["%", f"{name}({title})"]
        self.comment("G54 " + " ".join(word(a, v) for a, v in zip("XYZ", offset, strict=True)))
        for tool in tools:
            self.comment(f"T{tool.number}|{tool.name}|H{tool.number}|L{tool.length:.3f}")
        self.words("G21")
        self.words("G0", "G17", "G40", "G49", "G80", "G90")

    def blank(self, size: Sequence[float], material: str) -> None:
        """Write a box, x y z from and to [mm], and what it is made of."""
        box = (word(letter, edge) for letter, edge in zip("XXYYZZ", size, strict=True))
        self.comment("BLANK BOX " + " ".join(box))
        self.comment(f"MATERIAL {material.upper()}")

    def take(self, tool: Tool) -> None:
        """Change to ``tool``; what follows begins with :meth:`approach`."""
        if self.tools:
            self.words("M1")
            self._add("code", number=1)
        self.tools.append(tool)
        self.words(f"T{tool.number}", "M6")
        self._add("tool", number=tool.number)
        self.motion, self.feed = "", 0.0

    def approach(self, x: float, y: float, z: float) -> None:
        """Approach the workpiece with the spindle started; coolant on."""
        tool = self.tools[-1]
        x, y, z = round(x, 3), round(y, 3), round(z, 3)
        self.words("G0", "G90", "G54", word("X", x), word("Y", y), f"S{tool.speed}", "M3")
        self._add("spindle", number=tool.speed)
        self._add("rapid", (x, y, self.at[2]))
        self.words("G43", word("Z", z), f"H{tool.number}")
        self._add("rapid", (x, y, z))
        self.words("M8")
        self._add("code", number=8)
        self.motion = "G0"

    def rapid(self, x: float | None = None, y: float | None = None, z: float | None = None) -> None:
        """Move at rapid without cutting."""
        end = self._point(x, y, z)
        if words := self._changed(end):
            self.words(self._modal("G0"), *words)
            self._add("rapid", end)

    def line(
        self, x: float | None = None, y: float | None = None, z: float | None = None,
        feed: float | None = None,
    ) -> None:  # fmt: skip
        """Cut along a line."""
        end = self._point(x, y, z)
        if words := self._changed(end):
            self.words(self._modal("G1"), *words, self._feed(feed))
            self._add("line", end, feed=self.feed)

    def arc(
        self, x: float, y: float, centre: tuple[float, float], anticlockwise: bool = True,
        z: float | None = None, feed: float | None = None,
    ) -> None:  # fmt: skip
        """Cut along an arc, a full circle when it ends where it begins, a helix with ``z``."""
        end = self._point(x, y, z)
        i, j = round(centre[0] - self.at[0], 3), round(centre[1] - self.at[1], 3)
        middle = (self.at[0] + i, self.at[1] + j)
        swept = atan2(end[1] - middle[1], end[0] - middle[0]) - atan2(-j, -i)
        swept = swept % tau if anticlockwise else -(-swept % tau)
        if end[:2] == self.at[:2]:
            swept = tau if anticlockwise else -tau
        words = self._changed(end)
        self.words(
            self._modal("G3" if anticlockwise else "G2"), *words, word("I", i), word("J", j),
            self._feed(feed),
        )  # fmt: skip
        self._add("arc", end, centre=middle, turn=swept, feed=self.feed)

    def drill(
        self, holes: list[tuple[float, float]], top: float, depth: float, peck: float = 0.0
    ) -> None:
        """Drill ``holes`` from R level ``top`` to ``depth``: G81, or G83 with ``peck`` [mm]."""
        tool, initial = self.tools[-1], self.at[2]
        cycle = ["G98", "G83" if peck else "G81"]
        depths = [word("Z", depth), word("R", top), word("Q", peck) if peck else ""]
        for k, (x, y) in enumerate(holes):
            place = [word("X", x), word("Y", y)]
            head = [*cycle, *place, *depths, word("F", tool.plunge)] if k == 0 else place
            self.words(*head)
            self._hole(round(x, 3), round(y, 3), top, depth, peck, initial)
        self.words("G80")
        self.motion, self.feed = "", tool.plunge

    def turn(self, speed: int) -> None:
        """Change the speed of the spindle [rev/min], or stop it."""
        self.words(*((f"S{speed}", "M3") if speed else ("M5",)))
        self._add("spindle", number=speed)

    def dwell(self, milliseconds: int) -> None:
        """Wait for a time [ms]."""
        self.words("G4", f"P{milliseconds}")
        self._add("dwell", seconds=milliseconds / 1e3)

    def retract(self) -> None:
        """Coolant off, to the reference position of Z, spindle off."""
        self.rapid(z=SAFE)
        self.words("M9")
        self._add("code", number=9)
        self.words("G91", "G28", "Z0.")
        self._add("home", (*self.at[:2], inf))
        self.words("M5")
        self._add("spindle", number=0)

    def end(self, name: str) -> PartProgram:
        """Write the last line; the program."""
        self.words("G90")
        self.words("M30")
        self._add("end", number=30)
        self.lines.append("%")
        text = "\n".join(self.lines) + "\n"
        return PartProgram(name=name, text=text, steps=tuple(self.steps), tools=tuple(self.tools))

    def comment(self, text: str) -> None:
        """Write a comment."""
        self.lines.append(f"({text})")

    def words(self, *words: str) -> None:
        """Write a line of words; empty ones are left out."""
        block = [f"N{10 * len(self.lines)}"] if self.numbered else []
        block += [w for w in words if w]
        self.lines.append((" " if self.spaced else "").join(block))

    def _add(self, kind: Kind, end: Point | None = None, **more: Any) -> None:
        self.at = self.at if end is None else end
        self.steps.append(Step(kind=kind, line=len(self.lines), end=self.at, **more))

    def _hole(
        self, x: float, y: float, top: float, depth: float, peck: float, initial: float
    ) -> None:
        self._add("rapid", (x, y, initial))
        self._add("rapid", (x, y, top))
        reached = top
        while reached > depth:
            if reached < top:
                self._add("rapid", (x, y, top))
                self._add("rapid", (x, y, round(reached + self.peck_clearance, 6)))
            reached = max(round(reached - peck, 6), depth) if peck else depth
            self._add("line", (x, y, reached), feed=self.tools[-1].plunge)
        self._add("rapid", (x, y, initial))

    def _point(self, x: float | None, y: float | None, z: float | None) -> Point:
        a, b, c = self.at
        return (
            a if x is None else round(x, 3),
            b if y is None else round(y, 3),
            c if z is None else round(z, 3),
        )

    def _changed(self, end: Point) -> list[str]:
        return [
            word(letter, v) for letter, v, was in zip("XYZ", end, self.at, strict=True) if v != was
        ]

    def _modal(self, code: str) -> str:
        written, self.motion = "" if code == self.motion else code, code
        return written

    def _feed(self, feed: float | None) -> str:
        feed = self.tools[-1].feed if feed is None else feed
        written, self.feed = "" if feed == self.feed else word("F", feed), feed
        return written
