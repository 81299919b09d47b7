"""Drilling cycles and patterns of holes of a Sinumerik 840D, as the blocks that they consist of.

The tool stands over the hole.  It goes to the reference plane RFP and the safety distance SDIS
above it by G0, cuts to the depth DP (or DPR below RFP), and leaves to the retraction plane RTP.

Source: Sinumerik 840D sl, Programming Manual Cycles, "Drilling cycles" and "Drilling patterns"
(lengths that the cycles choose themselves are those of the manual, in mm).
"""

import math
from collections.abc import Iterator, Sequence

from pipeline.gcode.statements import Binary, Expression, Number, constant

Words = tuple[tuple[str, Expression], ...]
"""Letters and values of a block, coordinates absolute."""
_DEPTHS = ("RTP", "RFP", "SDIS", "DP", "DPR")
ARGUMENTS: dict[str, tuple[str, ...]] = {
    "CYCLE81": _DEPTHS,
    "CYCLE82": (*_DEPTHS, "DTB"),
    "CYCLE83": (*_DEPTHS, "FDEP", "FDPR", "DAM", "DTB", "DTS", "FRF", "VARI", "_AXN", "_MDEP",
                "_VRT", "_DTD", "_DIS1"),
    "CYCLE84": (*_DEPTHS, "DTB", "SDAC", "MPIT", "PIT", "POSS", "SST", "SST1", "_AXN", "_PITA",
                "_TECHNO", "_VARI", "_DAM", "_VRT"),
    "HOLES1": ("SPCA", "SPCO", "STA1", "FDIS", "DBH", "NUM"),
    "HOLES2": ("CPA", "CPO", "RAD", "STA1", "INDA", "NUM"),
}  # fmt: skip
"""Cycle -> its arguments."""
PATTERNS = ("HOLES1", "HOLES2")
ALONG_Z = (0.0, 3.0)
"""Values of _AXN that drill along Z."""
MOST_STROKES, MOST_HOLES = 10_000, 10_000
SHORT_HOLE, AHEAD, MOST_AHEAD = 30.0, 0.6, 7.0
"""Depth up to which CYCLE83 stops 0.6 mm above the depth reached, beyond it depth / 50 [mm]."""
CHIP_RETRACT = 1.0
"""What CYCLE83 retracts by to break chips [mm]."""
COARSE_PITCH = {
    3: 0.5, 4: 0.7, 5: 0.8, 6: 1.0, 8: 1.25, 10: 1.5, 12: 1.75, 14: 2.0, 16: 2.0, 18: 2.5, 20: 2.5,
    22: 2.5, 24: 3.0, 27: 3.0, 30: 3.5, 33: 3.5, 36: 4.0, 39: 4.0, 42: 4.5, 45: 4.5, 48: 5.0,
}  # fmt: skip
"""Metric thread -> pitch of its coarse series (ISO 261) [mm]."""


class CycleError(ValueError):
    """A call that is not followed, with the reason."""


def hole(
    name: str, arguments: Sequence[Expression], *, unit: float, feed: Expression, speed: Expression
) -> list[Words]:
    """Blocks of one hole by CYCLE81 to CYCLE84, whose ``arguments`` are as the call gives them.

    ``unit``: millimetres in the program's unit of length; ``feed`` and ``speed``: F and S in force.

    Raises
    ------
    CycleError
        An argument that is missing, or that is not followed.
    """
    names = ARGUMENTS[name]
    if not 4 <= len(arguments) <= len(names):
        raise CycleError(
            f"{name} is known as ({', '.join(names)}): write the first four at least, and no more"
        )
    given = dict.fromkeys(names, Number(0.0)) | dict(zip(names, arguments, strict=False))
    relative = constant(given["DPR"])
    if relative is None:
        raise CycleError("DPR is followed as a number: write it so, or the depth as DP")
    bottom = Binary("-", given["RFP"], Number(abs(relative))) if relative else given["DP"]
    above = Binary("+", given["RFP"], given["SDIS"])
    if name in ("CYCLE81", "CYCLE82"):
        wait = _number(given, "DTB") if "DTB" in given else 0.0
        cut = [_feed(bottom), *_dwell("DTB", wait)]
    elif name == "CYCLE83":
        cut = list(_pecked(given, unit, feed))
    else:
        cut = list(_tapped(given, bottom, above, unit, speed))
    return [_rapid(above), *cut, _rapid(given["RTP"])]


def places(
    name: str, arguments: Sequence[Expression], here: tuple[float | None, float | None]
) -> list[tuple[float, float]]:
    """X and Y of each hole of a pattern, in the order in which they are drilled.

    A row of holes begins at its end that is nearer to ``here``, where the tool stands.

    Raises
    ------
    CycleError
        An argument that is missing or no number.
    """
    names = ARGUMENTS[name]
    if len(arguments) != len(names):
        raise CycleError(f"{name} is known as ({', '.join(names)}): write all of them")
    given = dict(zip(names, arguments, strict=True))
    x, y, third, fourth, step, number = (_number(given, one) for one in names)
    count = round(number)
    if count != number or not 1 <= count <= MOST_HOLES:
        raise CycleError(f"NUM is {number:g}: give how many holes there are")
    if name == "HOLES2":
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


def _pecked(given: dict[str, Expression], unit: float, feed: Expression) -> Iterator[Words]:
    """CYCLE83: stroke by stroke, out to SDIS after each (VARI 1) or a little back (VARI 0)."""
    names = [name for name in ARGUMENTS["CYCLE83"] if name != "RTP"]
    value = {name: _number(given, name) for name in names}
    top, bottom = value["RFP"], value["DP"]
    if value["DPR"]:
        bottom = top - abs(value["DPR"])
    first = top - abs(value["FDPR"]) if value["FDPR"] else value["FDEP"]
    if value["_AXN"] not in ALONG_Z or value["VARI"] not in (0.0, 1.0):
        raise CycleError("CYCLE83 is followed along Z, with VARI 0 or 1: post single moves")
    ahead = AHEAD if (top - bottom) * unit <= SHORT_HOLE else (top - bottom) * unit / 50
    ahead = value["_DIS1"] or min(ahead, MOST_AHEAD) / unit
    back = value["_VRT"] or CHIP_RETRACT / unit
    depths = strokes(top, bottom, first, value["DAM"], value["_MDEP"])
    for index, depth in enumerate(depths):
        slow = index == 0 and value["FRF"] not in (0.0, 1.0)
        if slow:
            yield (("F", Number(_known(feed, "F") * value["FRF"])),)
        yield _feed(Number(depth))
        if slow:
            yield (("F", feed),)
        last = index == len(depths) - 1
        named = "_DTD" if last and value["_DTD"] else "DTB"
        yield from _dwell(named, value[named])
        if not last and value["VARI"]:
            yield _rapid(Number(top + value["SDIS"]))
            yield from _dwell("DTS", value["DTS"])
            yield _rapid(Number(depth + ahead))
        elif not last:
            yield _feed(Number(depth + back))


def strokes(top: float, bottom: float, first: float, less: float, least: float) -> list[float]:
    """Depths that CYCLE83 reaches one after the other, the bottom last.

    Each stroke is the one before less DAM; strokes of DAM follow, of which the last two halve what
    is left.  A negative DAM is a factor, with strokes of ``least`` at least.
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


def _tapped(
    given: dict[str, Expression], bottom: Expression, above: Expression, unit: float,
    speed: Expression,
) -> Iterator[Words]:  # fmt: skip
    """CYCLE84: in at SST, out at SST1 with the spindle reversed, then SDAC at the speed before."""
    names = ("DTB", "SDAC", "MPIT", "PIT", "SST", "SST1", "_AXN", "_PITA", "_TECHNO", "_VARI")
    value = {name: _number(given, name) for name in names}
    plain = value["_AXN"] in ALONG_Z and value["_PITA"] in (0.0, 1.0) and not value["_VARI"]
    if not plain or value["SDAC"] not in (3.0, 4.0, 5.0):
        raise CycleError(
            "CYCLE84 is followed along Z, with SDAC 3, 4 or 5, the pitch in the program's unit and "
            "in one stroke (_VARI 0): post single moves"
        )
    pitch = value["PIT"] or math.copysign(1.0, value["MPIT"]) * (
        COARSE_PITCH.get(round(abs(value["MPIT"])), 0.0) / unit
    )
    if not pitch:
        raise CycleError("CYCLE84 has no pitch: give PIT, or MPIT as a size from M3 to M48")
    into = value["SST"] or _known(speed, "S")
    ways = (3.0, 4.0) if pitch > 0 else (4.0, 3.0)
    lead = ("G", Number(33.0)), ("K", Number(abs(pitch)))
    yield (("S", Number(into)), ("M", Number(ways[0])))
    yield (*lead, ("Z", bottom))
    yield from _dwell("DTB", value["DTB"])
    yield (("S", Number(value["SST1"] or into)), ("M", Number(ways[1])))
    yield (*lead, ("Z", above))
    yield (("S", Number(_known(speed, "S"))), ("M", Number(value["SDAC"])))


def _number(given: dict[str, Expression], name: str) -> float:
    value = constant(given[name])
    if value is None:
        raise CycleError(f"{name} is followed as a number: write it so")
    return value


def _known(value: Expression, letter: str) -> float:
    number = constant(value)
    if not number:
        raise CycleError(f"the {letter} before the cycle is not known: write it as a number")
    return number


def _rapid(level: Expression) -> Words:
    return (("G", Number(0.0)), ("Z", level))


def _feed(level: Expression) -> Words:
    return (("G", Number(1.0)), ("Z", level))


def _dwell(name: str, seconds: float) -> list[Words]:
    if seconds < 0:
        raise CycleError(f"{name} is {seconds:g}: it is followed as seconds, of 0 or more")
    return [(("G", Number(4.0)), ("P", Number(seconds)))] if seconds else []
