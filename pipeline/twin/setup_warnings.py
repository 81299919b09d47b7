"""Warnings on the set-up of a cut: sizes of tools, their hand, cutter radii of 0, idle tools."""

from collections.abc import Iterator

import numpy as np

from pipeline.cutting.tool_sizes import odd_sizes
from pipeline.gcode.moves import CutterRadius
from pipeline.machine.spindle import CUTTING
from pipeline.schema.program_cut import CutWarning
from pipeline.twin.cut import Cut
from pipeline.twin.preflight import contact_violations, preflight_warnings


def setup_warnings(cut: Cut, table: str) -> tuple[CutWarning, ...]:
    """What of tools and registers does not fit the program that is cut with them.

    ``table`` is the tool table as it was named.
    """
    return (
        *_odd_sizes(cut, table),
        *_backwards(cut),
        *_without_radius(cut),
        *_cutting_nothing(cut),
        *_not_listed(cut),
        *_contacts(cut),
    )


def _odd_sizes(cut: Cut, table: str) -> Iterator[CutWarning]:
    """Sizes of tools that another unit would explain."""
    for number, tool in zip(cut.numbers, cut.tools, strict=True):
        for odd in odd_sizes(tool):
            yield CutWarning(
                what=f"T{number} in the tool table {table}: {odd.field} = {odd.value:g} is "
                f"{odd.reason}",
                do=odd.remedy,
            )


def _backwards(cut: Cut) -> Iterator[CutWarning]:
    """Right-hand tools that cut while M4 turns them; a tap backs out with M4."""
    moves, back = cut.plan.path.moves, cut.plan.path.moves.direction < 0
    for index, (number, tool) in enumerate(zip(cut.numbers, cut.tools, strict=True)):
        lines = moves.line[back & (cut.tool == index)]
        if len(lines) and tool.helix_deg >= 0 and tool.role != "tap":
            yield CutWarning(
                what=f"T{number} cuts while M4 turns it, and is a right-hand tool in the tool "
                "table: its edges run backwards",
                do="Write M3, or a negative helix_deg for a left-hand tool.",
                lines=tuple(dict.fromkeys(lines.tolist())),
            )


def _without_radius(cut: Cut) -> Iterator[CutWarning]:
    """G41 and G42 whose register holds no radius, of tools that have a diameter in the table."""
    tools = dict(zip(cut.numbers, cut.tools, strict=True))
    alike: dict[tuple[int, int], list[CutterRadius]] = {}
    for one in cut.plan.path.moves.cutter_radii:
        if one.radius == 0 and one.tool in tools:
            alike.setdefault((one.register, one.tool), []).append(one)
    for (register, number), found in alike.items():
        words = " and ".join(dict.fromkeys(one.word for one in found))
        size = f"{tools[number].diameter_mm:g}"
        yield CutWarning(
            what=f"{words} of T{number} takes D{register}, which is 0 or not given: the path is "
            f"followed as if the tool had no radius, and the tool table says {size} mm",
            do=f"Enter {size} mm as the diameter of D{register} in the machine’s file (setup); "
            "leave it where the program holds the path of the tool’s centre.",
            lines=tuple(dict.fromkeys(one.line for one in found)),
        )


def _cutting_nothing(cut: Cut) -> Iterator[CutWarning]:
    """Tools that turn and are fed through the blank's surroundings and never meet it."""
    moves, pieces = cut.plan.path.moves, cut.path.pieces
    if not (cut.tool >= 0).any():
        return  # the blank as a whole is missed, which is said of it
    rows = np.unique(pieces.block[pieces.feed & (pieces.length > 0)])
    rows = rows[cut.plan.spindle_speed[rows] > 0]
    cutting = set(moves.tool[cut.tool >= 0].tolist())
    for number in dict.fromkeys(moves.tool[rows].tolist()):
        if number in cutting:
            continue
        lines = moves.line[rows[moves.tool[rows] == number]]
        yield CutWarning(
            what=f"T{number} is fed and cuts nothing",
            do="Check the blank, the work offset, the tool’s length and the cutter radius.",
            lines=tuple(dict.fromkeys(lines.tolist())),
        )


def _not_listed(cut: Cut) -> Iterator[CutWarning]:
    """Tools that work and are not in the tool table; those that mill without it are refused."""
    moves = cut.plan.path.moves
    working = np.isin(moves.kind, CUTTING) & (moves.length > 0) & (moves.tool >= 0)
    working &= ~np.isin(moves.tool, cut.numbers)
    for number in dict.fromkeys(moves.tool[working].tolist()):
        lines = moves.line[working & (moves.tool == number)]
        yield CutWarning(
            what=f"T{number} is not in the tool table: nothing of it is judged",
            do="Add it to the tool table.",
            lines=tuple(dict.fromkeys(lines.tolist())),
        )


def _contacts(cut: Cut) -> tuple[CutWarning, ...]:
    """Shanks and holders that meet the part."""
    tools = dict(zip(cut.numbers, cut.tools, strict=True))
    moves = cut.plan.path.moves
    return preflight_warnings(contact_violations(moves, cut.path, tools, cut.blank))
