"""Drilling cycles, patterns of holes and pockets of a Sinumerik 840D, as blocks.

The tool stands over the hole.  It goes to the reference plane RFP and the safety distance SDIS
above it by G0, cuts to the depth DP (or DPR below RFP), and leaves to the retraction plane RTP.
Pockets are milled from the centre outwards, level by level; a control's own path in POCKET3 and
POCKET4 may differ.  Source: Sinumerik 840D sl, Programming Manual Cycles, "Drilling cycles",
"Drilling patterns" and "Milling cycles" (lengths that the cycles choose themselves are those of the
manual, in mm).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from pipeline.gcode.moves import INCH

Words = tuple[tuple[str, float], ...]
"""Letters and values of a block; coordinates are absolute, increments where + stands before."""
_DEPTHS = ("RTP", "RFP", "SDIS", "DP", "DPR")
_MODES = ("_GMODE", "_DMODE", "_AMODE")
_MILLED = ("MID", "FAL", "FALD", "FFP1", "FFD", "CDIR", "VARI", "MIDA", "AP1")
_ENTRY = ("AD", "RAD1", "DP1", "_UMODE", "_FS", "_ZFS", *_MODES)
ARGUMENTS: dict[str, tuple[str, ...]] = {
    "CYCLE81": (*_DEPTHS, "DTB", *_MODES),
    "CYCLE82": (*_DEPTHS, "DTB", *_MODES),
    "CYCLE83": (*_DEPTHS, "FDEP", "FDPR", "DAM", "DTB", "DTS", "FRF", "VARI", "_AXN", "_MDEP",
                "_VRT", "_DTD", "_DIS1", *_MODES),
    "CYCLE84": (*_DEPTHS, "DTB", "SDAC", "MPIT", "PIT", "POSS", "SST", "SST1", "_AXN", "_PITA",
                "_TECHNO", "_VARI", "_DAM", "_VRT", "_PITM", "_PTAB", "_PTABA", *_MODES),
    "CYCLE85": (*_DEPTHS, "DTB", "FFR", "RFF", *_MODES),
    "CYCLE86": (*_DEPTHS, "DTB", "SDIR", "RPA", "RPO", "RPAP", "POSS", *_MODES),
    "CYCLE89": (*_DEPTHS, "DTB", *_MODES),
    "HOLES1": ("SPCA", "SPCO", "STA1", "FDIS", "DBH", "NUM"),
    "HOLES2": ("CPA", "CPO", "RAD", "STA1", "INDA", "NUM"),
    "POCKET3": (*_DEPTHS[:4], "LENG", "WID", "CRAD", "PA", "PO", "STA", *_MILLED, "AP2", *_ENTRY),
    "POCKET4": (*_DEPTHS[:4], "PRAD", "PA", "PO", *_MILLED, *_ENTRY),
}  # fmt: skip
"""Cycle -> its arguments."""
LEAST = {"HOLES1": 6, "HOLES2": 6, "POCKET3": 17, "POCKET4": 14}
"""Arguments that a call has at least, 4 where nothing is said."""
PATTERNS = ("HOLES1", "HOLES2")
POCKETS = ("POCKET3", "POCKET4")
ALONG_Z = (0.0, 3.0)
"""Values of _AXN that drill along Z."""
MOST_STROKES, MOST_HOLES = 10_000, 10_000
SHORT_HOLE, AHEAD, MOST_AHEAD = 30.0, 0.6, 7.0
"""Depth up to which CYCLE83 stops 0.6 mm above the depth reached, beyond it depth / 50 [mm]."""
CHIP_RETRACT = 1.0
"""Retract of CYCLE83 and CYCLE84 to break chips [mm]."""
COARSE_PITCH = {
    3: 0.5, 4: 0.7, 5: 0.8, 6: 1.0, 8: 1.25, 10: 1.5, 12: 1.75, 14: 2.0, 16: 2.0, 18: 2.5, 20: 2.5,
    22: 2.5, 24: 3.0, 27: 3.0, 30: 3.5, 33: 3.5, 36: 4.0, 39: 4.0, 42: 4.5, 45: 4.5, 48: 5.0,
}  # fmt: skip
"""Metric thread -> pitch of its coarse series (ISO 261) [mm]."""


class CycleError(ValueError):
    """A call that is not followed, with the reason."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CycleCall:
    """A call of a cycle, its lengths in the program's unit."""

    given: dict[str, float]
    """Arguments by name; a missing one is 0."""
    unit: float
    """Millimetres in the program's unit of length."""
    feed: float
    speed: float
    """F and S in force, 0 before the first."""

    def mode(self, place: int) -> int:
        """Digit of _AMODE, counted from the right."""
        return int(self.given.get("_AMODE", 0.0) / 10**place) % 10

    @property
    def above(self) -> float:
        """Height at which the feed begins."""
        return self.given["RFP"] + self.given["SDIS"]

    @property
    def bottom(self) -> float:
        """DP, or DPR below RFP; the units of _AMODE choose, where it is not 0."""
        relative = self.given["DPR"] if self.mode(0) != 2 else 0.0
        return self.given["RFP"] - abs(relative) if relative else self.given["DP"]

    def dwell(self, name: str) -> list[Words]:
        """G4 of seconds, or of revolutions where the value is negative or _AMODE says so."""
        time = self.given[name]
        if time < 0 or (time and self.mode(("DTB", "DTS", "_DTD").index(name) + 1) == 2):
            time = abs(time) * 60 / self.known(self.speed, "S")
        return [(("G", 4.0), ("P", time))] if time else []

    @staticmethod
    def known(value: float, letter: str) -> float:
        """F or S in force, or CycleError before the first."""
        if not value:
            raise CycleError(f"the {letter} before the cycle is not known: write it as a number")
        return value


def cycle_call(
    name: str, values: Sequence[float | None], *, unit: float, feed: float, speed: float
) -> CycleCall:
    """Call of a cycle with its ``values`` as given, None where one is not known.

    Raises CycleError for an argument that is missing, or that is not supported.
    """
    names, least = ARGUMENTS[name], LEAST.get(name, 4)
    if not least <= len(values) <= len(names):
        some = f"the first {'four' if least == 4 else least} at least, and no more"
        wanted = "all of them" if name in PATTERNS else some
        raise CycleError(f"{name} is known as ({', '.join(names)}): write {wanted}")
    given = dict.fromkeys(names, 0.0)
    for one, value in zip(names, values, strict=False):
        if value is None:
            raise CycleError(f"{one} is followed as a number: write it so")
        given[one] = value
    call = CycleCall(given=given, unit=unit, feed=feed, speed=speed)
    if name in POCKETS and any(given[one] for one in ("_UMODE", *_MODES[::2])):
        raise CycleError(f"{name} with _UMODE, _GMODE or _AMODE is not followed: leave them out")
    if given.get("_GMODE") or given.get("_DMODE", 0.0) % 10 > 1 or call.mode(5):
        raise CycleError(
            f"{name} is followed with _GMODE 0, under G17 and without percents: post so"
        )
    return call


def hole(name: str, call: CycleCall) -> list[Words]:
    """Blocks of one hole by a drilling cycle; CycleError for an unsupported argument."""
    return [rapid_to(call.above), *_HOLES[name](call), rapid_to(call.given["RTP"])]


def places(call: CycleCall, here: tuple[float | None, float | None]) -> list[tuple[float, float]]:
    """X and Y of each hole of a pattern, in the order in which they are drilled.

    A row of holes begins at its end that is nearer to ``here``, where the tool stands.  Raises
    CycleError for a number of holes that is none, or a row without a known begin.
    """
    x, y, third, fourth, step, number = call.given.values()
    count = round(number)
    if count != number or not 1 <= count <= MOST_HOLES:
        raise CycleError(f"NUM is {number:g}: give how many holes there are")
    if "RAD" in call.given:
        turns = [math.radians(fourth + i * (step or 360.0 / count)) for i in range(count)]
        return [(x + third * math.cos(a), y + third * math.sin(a)) for a in turns]
    along = math.cos(math.radians(third)), math.sin(math.radians(third))
    row = [
        (x + (fourth + i * step) * along[0], y + (fourth + i * step) * along[1])
        for i in range(count)
    ]
    u, v = here
    if u is None or v is None:
        raise CycleError(
            "HOLES1 begins at the end of the row that is nearer, and where the tool stands is not "
            "known: give X and Y as numbers, under G90, in a block before"
        )
    ahead, back = math.dist((u, v), row[0]), math.dist((u, v), row[-1])
    return row[::-1] if back < ahead else row


def _drilled(call: CycleCall) -> Iterator[Words]:
    """CYCLE81, and CYCLE82 with a dwell."""
    yield feed_to(call.bottom)
    yield from call.dwell("DTB")


def _pecked(call: CycleCall) -> Iterator[Words]:
    """CYCLE83: stroke by stroke, out to SDIS after each (VARI 1) or a little back (VARI 0)."""
    given, top, bottom, unit = call.given, call.given["RFP"], call.bottom, call.unit
    relative = given["FDPR"] if call.mode(4) != 2 else 0.0
    first = top - abs(relative) if relative else given["FDEP"]
    if given["_AXN"] not in ALONG_Z or given["VARI"] not in (0.0, 1.0):
        raise CycleError("CYCLE83 is followed along Z, with VARI 0 or 1: post single moves")
    ahead = AHEAD if (top - bottom) * unit <= SHORT_HOLE else (top - bottom) * unit / 50
    ahead = given["_DIS1"] or min(ahead, MOST_AHEAD) / unit
    back = given["_VRT"] or CHIP_RETRACT / unit
    slow = given["FRF"] not in (0.0, 1.0)
    if slow:
        yield (("F", call.known(call.feed, "F") * given["FRF"]),)
    for depth in strokes(top, bottom, first, given["DAM"], given["_MDEP"]):
        yield feed_to(depth)
        if slow:
            yield (("F", call.feed),)
            slow = False
        last = depth == bottom
        yield from call.dwell("_DTD" if last and given["_DTD"] else "DTB")
        if not last and given["VARI"]:
            yield rapid_to(call.above)
            yield from call.dwell("DTS")
            yield rapid_to(depth + ahead)
        elif not last:
            yield feed_to(depth + back)


def strokes(top: float, bottom: float, first: float, less: float, least: float) -> list[float]:
    """Depths that CYCLE83 reaches one after the other, the bottom last.

    Each stroke is the one before less DAM; strokes of DAM follow, of which the last two halve the
    rest. A negative DAM is a factor, with strokes of ``least`` at least.
    """
    stroke, depths = top - first, []
    if not stroke > 0 or bottom >= top:
        raise CycleError(
            f"CYCLE83 has its first depth at {first:g}, RFP at {top:g} and DP at {bottom:g}: the "
            "first depth (FDEP or FDPR) lies below RFP, and DP too"
        )
    left = top - bottom
    while left > stroke + 1e-9:
        left -= stroke
        depths.append(bottom + left)
        stroke = max(stroke * -less, least) if less < 0 else max(stroke - less, less) or stroke
        if 0 < less == stroke < left < 2 * less:
            stroke = left / 2
        if len(depths) > MOST_STROKES or stroke <= 0:
            raise CycleError("CYCLE83 comes to no end: give _MDEP, or a DAM of 0 or more")
    return [*depths, bottom]


def _tapped(call: CycleCall) -> Iterator[Words]:
    """CYCLE84: in at SST, out at SST1 with the spindle reversed, then SDAC at the speed before.

    _VARI 1 breaks chips at each _DAM, 2 goes out to SDIS.
    """
    given, speed = call.given, call.known(call.given["SST"] or call.speed, "S")
    plain = given["_AXN"] in ALONG_Z and given["_VARI"] in (0.0, 1.0, 2.0)
    if not plain or given["SDAC"] not in (3.0, 4.0, 5.0):
        raise CycleError(
            "CYCLE84 is followed along Z, with SDAC 3, 4 or 5 and _VARI 0, 1 or 2: post single "
            "moves"
        )
    lead = _pitch(call)
    ways = (3.0, 4.0) if lead > 0 and call.mode(3) != 2 else (4.0, 3.0)
    top, back = given["RFP"], given["_VRT"] or CHIP_RETRACT / call.unit
    peck = given["_VARI"] and given["_DAM"]
    depths = strokes(top, call.bottom, top - given["_DAM"], 0, 0) if peck else [call.bottom]
    after = call.known(call.speed, "S")
    for depth in depths:
        last = depth == call.bottom
        yield (("S", speed), ("M", ways[0]))
        yield (("G", 33.0), ("K", abs(lead)), ("Z", depth))
        yield from call.dwell("DTB") if last else ()
        yield (("S", given["SST1"] or speed), ("M", ways[1]))
        out = call.above if last or given["_VARI"] == 2 else depth + back
        yield (("G", 33.0), ("K", abs(lead)), ("Z", out))
    yield (("S", after), ("M", given["SDAC"]))


def _pitch(call: CycleCall) -> float:
    """Pitch in the program's unit, negative of a left-hand thread."""
    pitch, size, named = call.given["PIT"], call.given["MPIT"], call.given["_PITA"]
    millimetres = {0.0: pitch * call.unit, 1.0: pitch, 3.0: pitch * INCH}
    if pitch:
        millimetres[2.0] = INCH / pitch
    elif abs(size) in COARSE_PITCH:
        millimetres = {named: math.copysign(COARSE_PITCH[int(abs(size))], size)}
    if not millimetres.get(named):
        raise CycleError("CYCLE84 has no pitch: give PIT, or MPIT as a size from M3 to M48")
    return millimetres[named] / call.unit


def _reamed(call: CycleCall) -> Iterator[Words]:
    """CYCLE85: in at FFR, out at RFF; CYCLE89: both at the F in force."""
    feed = call.given.get("FFR") or call.known(call.feed, "F")
    yield (("F", feed),)
    yield feed_to(call.bottom)
    yield from call.dwell("DTB")
    yield (("F", call.given.get("RFF") or feed),)
    yield feed_to(call.above)
    yield (("F", call.feed or feed),)


def _bored(call: CycleCall) -> Iterator[Words]:
    """CYCLE86: the spindle stands at POSS when the tool leaves the wall by RPA, RPO and RPAP."""
    given = call.given
    if given["SDIR"] not in (3.0, 4.0):
        raise CycleError(f"SDIR is {given['SDIR']:g}: give 3 or 4, as the spindle turns")
    yield (("M", given["SDIR"]),)
    yield feed_to(call.bottom)
    yield from call.dwell("DTB")
    yield (("M", 19.0),)
    x, y, up = given["RPA"], given["RPO"], given["RPAP"]
    yield (("G", 0.0), ("+X", x), ("+Y", y), ("Z", call.bottom + up))
    yield rapid_to(call.above)
    yield (("G", 0.0), ("+X", -x), ("+Y", -y), ("Z", given["RTP"]))


_HOLES: dict[str, Callable[[CycleCall], Iterator[Words]]] = {
    "CYCLE81": _drilled, "CYCLE82": _drilled, "CYCLE83": _pecked, "CYCLE84": _tapped,
    "CYCLE85": _reamed, "CYCLE86": _bored, "CYCLE89": _reamed,
}  # fmt: skip


def rapid_to(level: float) -> Words:
    """G0 to a level."""
    return (("G", 0.0), ("Z", level))


def feed_to(level: float) -> Words:
    """G1 to a level."""
    return (("G", 1.0), ("Z", level))


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
