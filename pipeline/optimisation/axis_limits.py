"""Limits of the axes in the cut: following error, motor command, and the feeds that keep them.

A following error is proportional to the speed of its axis, so that its excess over the limit is the
share by which the feed has to fall.  A motor command holds Coulomb friction, weight and the edge
forces, which no feed changes, so that it takes more rounds.  Where a compensation network gives the
interval of a following error, the limit holds against its worst end, independent of the feed.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from pipeline.machine.control.path import where
from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.drive import AxisInCut
from pipeline.schema.limits import CutLimit, limit_words
from pipeline.twin.cut.axes import NEWTON, CutFollowing, axes_in_cut, follow_cut
from pipeline.twin.cut.loads import Cut
from pipeline.twin.drive import IdentifiedDrive
from pipeline.twin.program_axes import Residual

AMPERE = "A"
LIMITED = ("following_um", "motor_command_A")
UM = 1e6
SLACK = 1e-3
"""Excess over a limit, as a share, that counts as rounding."""
FALLING = 1e-3
"""Share by which an error falls from one position to the next where an earlier block caused it."""
LEAST = 0.5
"""Least factor of a feed in one round."""
ALIKE = 0.98
"""Factor on feeds that have to go down, for what does not fall with them."""


@dataclass(frozen=True, kw_only=True, eq=False)
class AxesCheck:
    """Axes of a cut of M rows, and the feeds by their limits."""

    axes: tuple[AxisInCut, ...]
    """Axes whose drives are known."""
    factor: Floats = field(repr=False)
    """Factor by which each row's feed has to go down, 1 where it need not; shape (M,)."""
    limit: str = ""
    """Limit that is passed most, in words; empty where all are kept."""
    why_not: str = ""
    """Limit that is passed, with its place, in one sentence."""
    reason: str = ""
    """Reason why no figures are there; empty where there are some."""


def check_axes(
    cut: Cut, drives: Mapping[str, IdentifiedDrive] | None, limits: CutLimit | None = None,
    residual: Residual | None = None,
) -> AxesCheck:  # fmt: skip
    """Follow a cut with its drives and what they leave over, and hold them against the limits."""
    free = np.ones(len(cut.plan.path))
    if not drives:
        return AxesCheck(axes=(), factor=free, reason="no drives were identified")
    try:
        followed = follow_cut(cut, drives, residual=residual)
    except ValueError as error:
        return AxesCheck(axes=(), factor=free, reason=str(error))
    if not followed.cut:
        return AxesCheck(axes=(), factor=free, reason=_unknown(drives))
    axes = axes_in_cut(followed, cut.plan.path.moves.line)
    if limits is None or not followed.load.cutting.any():
        return AxesCheck(axes=axes, factor=free)
    factor, limit, why_not = _held_against(cut, followed, drives, limits)
    return AxesCheck(axes=axes, factor=factor, limit=limit, why_not=why_not)


def check_axes_known(drives: Mapping[str, IdentifiedDrive], limits: CutLimit) -> None:
    """Refuse limits of the axes that cannot be judged."""
    for name in LIMITED:
        limit = getattr(limits, name)
        if limit is None:
            continue
        known = {a: d for a, d in drives.items() if d.servo is not None and d.force_unit == NEWTON}
        if not known:
            raise ValueError(
                f"limits.{name} = {limit:g} cannot be kept: {_unknown(drives)}: record the drives "
                "and run `dvc repro`, or leave the limit out"
            )
        other = next((a for a, d in known.items() if d.command_unit != AMPERE), None)
        if name == "motor_command_A" and other is not None:
            raise ValueError(
                f"limits.{name} = {limit:g} cannot be kept: the command of axis {other} is in "
                f"{known[other].command_unit}: leave the limit out"
            )


def _unknown(drives: Mapping[str, IdentifiedDrive]) -> str:
    if not drives:
        return "no drives were identified"
    unlisted = [a for a, d in drives.items() if d.servo is not None and d.force_unit != NEWTON]
    if unlisted:
        return f"the force constant of axis {', '.join(unlisted)} is not listed"
    return "no axis that moves has an identified servo"


def _held_against(
    cut: Cut, followed: CutFollowing, drives: Mapping[str, IdentifiedDrive], limits: CutLimit
) -> tuple[Floats, str, str]:
    """Factors of the rows' feeds, shape (M,), the limit that is passed most, and a sentence."""
    moves, kept = cut.plan.path.moves, 1.0 - limits.margins.axes
    factor, worst, words, why_not = np.ones(len(moves)), 1.0 + SLACK, "", ""
    for letter, one in followed.cut.items():
        screw = drives[letter].feed_drive
        still = (screw.friction.positive.coulomb + abs(screw.offset)) / screw.force_constant
        width = np.zeros(len(one.error)) if one.half_width is None else one.half_width * UM
        for name, values, unit, base in (
            ("following_um", np.abs(one.error) * UM + width, "um", width),
            ("motor_command_A", np.abs(one.command), one.command_unit, np.full(len(width), still)),
        ):
            limit = getattr(limits, name)
            if limit is None:
                continue
            size = np.where(followed.load.cutting, values, 0.0)
            over = size > limit * kept * (1.0 + SLACK)
            if name == "following_um":
                over &= ~_falls(size)
            if not over.any():
                continue
            rest = np.maximum(size[over] - base[over], 1e-12)
            share = 1.0 - (size[over] - limit * kept) / rest
            np.minimum.at(factor, one.row[over], np.maximum(ALIKE * share, LEAST))
            k = int(np.argmax(np.where(over, size, 0.0)))
            if size[k] / (limit * kept) > worst:
                worst = float(size[k] / (limit * kept))
                about = limit_words(name)[0].name
                words = f"limit of {limit:g} {unit} on the {about} of axis {letter}"
                what = "is behind by" if name == "following_um" else "draws"
                why_not = (
                    f"{where(moves, int(one.row[k]))}: axis {letter} {what} {size[k]:.4g} {unit} "
                    f"in the cut{_of_it(width, k, name)}, its limit of {limit:g} {unit} allows "
                    f"{limit * kept:.4g} {unit}, "
                    f"and no feed of its range keeps it: raise limits.{name} or take less depth"
                )
    return factor, words, why_not


def _of_it(width: Floats, k: int, name: str) -> str:
    """Share of a following error at sample k that half of its interval makes up, in words."""
    return f", {width[k]:.4g} um of it uncertain" if name == "following_um" and width[k] else ""


def _falls(values: Floats) -> Bools:
    falls: Bools = np.diff(values, prepend=values[:1]) < -FALLING * values
    return falls
