"""Pockets of a Sinumerik 840D, as blocks, milled from the centre outwards, level by level.

A control's own path in POCKET3 and POCKET4 may differ.  Source: Sinumerik 840D sl, Programming
Manual Cycles, "Milling cycles".
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.gcode.dialects.siemens_cycles import CycleCall, CycleError, Words, feed_to, rapid_to

MOST_PASSES = 200
WIDTH = 0.8
"""Width of a pass in diameters of the tool, where MIDA gives none [1]."""


def _counted(share: float, what: str) -> int:
    """Equal steps of which none is more than one ``share``."""
    if not 0 <= share <= MOST_PASSES:
        raise CycleError(f"{what} makes {share:g} levels or passes: correct it")
    return max(math.ceil(share - 1e-9), 1)


Ring = tuple[float, float, float]
"""Half length, half width and corner radius of a closed pass of the tool's centre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pocket:
    """POCKET3 or POCKET4 with a tool of some ``radius``, in the pocket's own axes."""

    call: CycleCall
    radius: float
    """Radius of the tool in the program's unit."""

    def blocks(self) -> Iterator[Words]:
        """Blocks that mill it: from the centre outwards (VARI 1), or edge and base (VARI 2)."""
        given = self.call.given
        yield rapid_to(given["RTP"])
        yield (("G", 0.0), *self.at(0.0, 0.0))
        yield rapid_to(self.call.above)
        yield from self._rough() if given["VARI"] % 10 == 1 else self._finish()
        yield rapid_to(given["RTP"])
        yield (("G", 0.0), *self.at(0.0, 0.0))
        if self.call.feed:
            yield (("F", self.call.feed),)

    def check(self) -> None:
        """Refuse what is not followed, before anything moves."""
        given = self.call.given
        kind, tens = given["VARI"] % 10, given["VARI"] // 10
        longest = 3 if "PRAD" not in given else 2
        for wrong, reason in (
            (kind not in (1, 2) or not 0 <= tens <= longest,
             f"VARI is followed from 1 to {longest}2"),
            (given["CDIR"] not in (0.0, 1.0, 2.0, 3.0), "CDIR is followed from 0 to 3"),
            (any(given.get(name) for name in ("AP1", "AP2", "AD")),
             "a pocket milled before (AP1, AP2, AD) is not followed: write 0"),
            (min(given["FFP1"], given["FFD"]) <= 0, "give FFP1 and FFD above 0"),
            (given["DP"] >= given["RFP"], "DP lies below RFP: correct them"),
            (min(self.wall(given["FAL"])[:2]) < 0,
             f"the tool of radius {self.radius:g} does not go into the pocket"),
            (min(given[one] for one in ("MID", "FAL", "FALD", "MIDA", "SDIS")) < 0,
             "MID, FAL, FALD, MIDA and SDIS have no sign: delete it"),
            (tens == 2 and not 0 < given["RAD1"] <= min(self.wall(given["FAL"])[:2]),
             "the helix needs a radius RAD1 that goes into the pocket: correct it"),
            (tens == 2 and given["DP1"] <= 0, "the helix needs DP1, its pitch: give it"),
            (tens == 3 and not (0 < given["RAD1"] < 90 and self.swing > 0),
             "going in to and fro needs an angle RAD1 below 90 and room: correct it"),
        ):  # fmt: skip
            if wrong:
                raise CycleError(reason)

    def wall(self, allowance: float) -> Ring:
        """The pass that leaves an allowance on the edge."""
        given, less = self.call.given, self.radius + allowance
        if "PRAD" in given:
            return (given["PRAD"] - less,) * 3
        corner = max(given["CRAD"] - less, 0.0)
        return given["LENG"] / 2 - less, given["WID"] / 2 - less, corner

    @property
    def swing(self) -> float:
        """Half of the path to and fro, along the middle line."""
        a, b, _ = self.wall(self.call.given["FAL"])
        return a - b if a > b else min(a, self.radius)

    @property
    def way(self) -> int:
        """1 anticlockwise, -1 clockwise; climb milling (CDIR 0) with M3 is anticlockwise."""
        return 1 if self.call.given["CDIR"] in (0.0, 3.0) else -1

    def at(self, x: float, y: float, *, vector: bool = False) -> Words:
        """X and Y of a point, or I and J of a vector, turned by STA about the centre."""
        given, y = self.call.given, y * self.way
        angle = math.radians(given.get("STA", 0.0))
        u = x * math.cos(angle) - y * math.sin(angle)
        v = x * math.sin(angle) + y * math.cos(angle)
        return (("I", u), ("J", v)) if vector else (("X", given["PA"] + u), ("Y", given["PO"] + v))

    def arc(self, x: float, y: float, i: float, j: float, *more: tuple[str, float]) -> Words:
        """An arc in the direction of the passes, to a point about the start and I J."""
        code = ("G", 2.5 + self.way / 2)
        return (code, ("G", 91.1), *self.at(x, y), *self.at(i, j, vector=True), *more)

    def levels(self) -> list[float]:
        """Depths of equal steps, none more than MID, down to FALD above the bottom."""
        given = self.call.given
        depth = given["RFP"] - given["DP"] - given["FALD"]
        count = _counted(depth / (given["MID"] or depth or 1.0), f"MID {given['MID']:g}")
        return [given["RFP"] - depth * (i + 1) / count for i in range(count)]

    def surface(self, allowance: float) -> Iterator[Words]:
        """Passes from the middle line outwards, none wider than MIDA or the tool."""
        a, b, c = self.wall(allowance)
        width = min(self.call.given["MIDA"] or WIDTH * 2 * self.radius, 2 * self.radius)
        count = _counted(min(a, b) / width, f"MIDA {width:g}")
        yield (("F", self.call.given["FFP1"]),)
        for step in range(count + 1):
            less = min(a, b) * (1 - step / count)
            yield from self.ring((a - less, b - less, max(c - less, 0.0)))

    def ring(self, ring: Ring) -> Iterator[Words]:
        """A closed pass, from the middle of its end and back to it."""
        a, b, c = ring
        yield (("G", 1.0), *self.at(a, 0.0))
        here = (a, 0.0)
        for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
            ends = (x * a, y * (b - c)), (x * (a - c), y * b)
            begin, end = ends if x == y else ends[::-1]
            if begin != here:
                yield (("G", 1.0), *self.at(*begin))
            if c > 0:
                yield self.arc(*end, x * (a - c) - begin[0], y * (b - c) - begin[1])
            here = end
        if here != (a, 0.0):
            yield (("G", 1.0), *self.at(a, 0.0))

    def _rough(self) -> Iterator[Words]:
        given, top = self.call.given, self.call.above
        for level in self.levels():
            yield from self._enter(top, level)
            yield from self.surface(given["FAL"])
            top = level + given["SDIS"]
            yield rapid_to(top)
            yield (("G", 0.0), *self.at(0.0, 0.0))

    def _enter(self, top: float, level: float) -> Iterator[Words]:
        """At the centre by G0 or G1, on a helix of RAD1 and DP1, or to and fro at RAD1 degrees."""
        given, kind = self.call.given, self.call.given["VARI"] // 10
        size = given["RAD1"]
        yield (("F", given["FFD"]),)
        if kind == 2:
            turns = math.ceil((top - level) / given["DP1"] - 1e-9)
            yield (("G", 1.0), *self.at(size, 0.0))
            yield self.arc(size, 0.0, -size, 0.0, ("Z", level), ("P", float(turns)))
            yield self.arc(size, 0.0, -size, 0.0)
        elif kind == 3:
            each = 2 * self.swing * math.tan(math.radians(size))
            count = _counted((top - level) / each, f"RAD1 {size:g}")
            for i in range(count + 1):
                z = top + (level - top) * i / count
                yield (("G", 1.0), *self.at(self.swing * (-1) ** i, 0.0), ("Z", z))
        else:
            yield feed_to(level) if kind else rapid_to(level)

    def _finish(self) -> Iterator[Words]:
        """The edge where FAL is left on it, on and off it by quarter circles; then the base."""
        given, top = self.call.given, self.call.above
        if not (given["FAL"] or given["FALD"]):
            raise CycleError("nothing is left to finish: give FAL or FALD as the roughing did")
        a, b, c = self.wall(0.0)
        r = min(self.radius, a, b)
        if not r > 0:
            raise CycleError(f"the tool of radius {self.radius:g} fills the pocket")
        for level in self.levels() if given["FAL"] else ():
            yield (("G", 0.0), *self.at(a - r, -r))
            yield rapid_to(top)
            yield (("F", given["FFD"]),)
            yield feed_to(level)
            yield (("F", given["FFP1"]),)
            yield self.arc(a, 0.0, 0.0, r)
            yield from self.ring((a, b, c))
            yield self.arc(a - r, r, -r, 0.0)
            top = level + given["SDIS"]
            yield rapid_to(top)
        if given["FALD"]:
            yield (("G", 0.0), *self.at(0.0, 0.0))
            yield (("F", given["FFD"]),)
            yield feed_to(given["DP"])
            yield from self.surface(0.0)
