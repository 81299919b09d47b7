"""Conditions of a recorded cut: from its name, from a list by pattern, or the same for all."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from fnmatch import fnmatchcase
from math import acos, isfinite, pi
from typing import Literal

from pipeline.cutting.tool import Tool

MM = 1e-3
SAME = 1e-6
"""Relative; values that differ by less are the same."""

Immersion = Literal["slot", "up", "down"]
IMMERSIONS = ("slot", "up", "down")


@dataclass(frozen=True, kw_only=True)
class Said:
    """What is said of a cut; nothing of what is None.

    Parameters
    ----------
    speed_rpm, feed_mm_min, feed_per_tooth_mm, axial_depth_mm, radial_depth_mm : float, optional
        [1/min], [mm/min], [mm].
    immersion : {"slot", "up", "down"}, optional
        Side of the tool that cuts.
    entry_deg, exit_deg : float, optional
        Angles where teeth enter and leave (:mod:`pipeline.cutting.engagement.engagement`) [deg], in place of
        immersion and radial depth.
    """

    speed_rpm: float | None = None
    feed_mm_min: float | None = None
    feed_per_tooth_mm: float | None = None
    axial_depth_mm: float | None = None
    radial_depth_mm: float | None = None
    immersion: Immersion | None = None
    entry_deg: float | None = None
    exit_deg: float | None = None


@dataclass(frozen=True, kw_only=True)
class Conditions:
    """Conditions of a cut.

    Parameters
    ----------
    speed : float
        n [rev/s].
    f_z : float
        Feed for each tooth [m].
    a_p : float
        Axial depth [m].
    phi_st, phi_ex : float
        Where teeth enter and leave [rad].
    flutes : int
        N.
    """

    speed: float
    f_z: float
    a_p: float
    phi_st: float
    phi_ex: float
    flutes: int

    @property
    def feed(self) -> float:
        """[m/s]."""
        return self.f_z * self.flutes * self.speed


def said_of(
    recording: str, pattern: str | None, by_pattern: Mapping[str, Said], all_of_them: Said
) -> Said:
    """All that is said of ``recording``, by its name, the list and for all of them.

    Raises
    ------
    ValueError
        When the pattern is no regular expression or names what is no condition, or two sources
        contradict each other.
    """
    found = _present(all_of_them, "cutting_records.conditions")
    for name, one in by_pattern.items():
        if fnmatchcase(recording, name):
            _add(found, _present(one, f"cutting_records.by_pattern, {name!r}"))
    if pattern is not None:
        _add(found, _from_name(recording, pattern))
    return Said(**{name: value for name, (value, _) in found.items()})  # type: ignore[arg-type]


def _present(said: Said, source: str) -> dict[str, tuple[float | str, str]]:
    return {name: (value, source) for name, value in asdict(said).items() if value is not None}


def _add(
    found: dict[str, tuple[float | str, str]], new: Mapping[str, tuple[float | str, str]]
) -> None:
    for name, (value, source) in new.items():
        if name in found and not _same(found[name][0], value):
            raise ValueError(
                f"its {name} is {found[name][0]} by {found[name][1]} and {value} by {source}: "
                "correct one of them"
            )
        found[name] = (value, source)


def _same(one: float | str, other: float | str) -> bool:
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    return abs(one - other) <= SAME * max(abs(one), abs(other))


def _from_name(recording: str, pattern: str) -> dict[str, tuple[float | str, str]]:
    try:
        expression = re.compile(pattern)
    except re.error as error:
        raise ValueError(
            f"cutting_records.name = {pattern!r} is no regular expression: {error}"
        ) from error
    known = [one.name for one in fields(Said)]
    if strange := sorted(set(expression.groupindex) - set(known)):
        raise ValueError(
            f"cutting_records.name has the group {strange[0]!r}, which is no condition: use "
            f"{', '.join(known)}"
        )
    match = expression.search(recording)
    if match is None:
        return {}
    found: dict[str, tuple[float | str, str]] = {}
    for name, text in match.groupdict().items():
        if text is None:
            continue
        if name == "immersion":
            if text not in IMMERSIONS:
                raise ValueError(f"its name says the immersion {text!r}: slot, up or down")
            found[name] = (text, "its name")
        else:
            found[name] = (_number(name, text), "its name")
    return found


def _number(name: str, text: str) -> float:
    try:
        return float(text.strip(".").replace(",", "."))
    except ValueError as error:
        raise ValueError(
            f"its name says {name} = {text!r}, which is no number: correct cutting_records.name"
        ) from error


def conditions_of(said: Said, tool: Tool) -> Conditions:
    """Conditions in SI.

    Raises
    ------
    ValueError
        When something is missing, out of its range or contradicts the rest.
    """
    speed = _positive("speed_rpm", said.speed_rpm) / 60
    a_p = _positive("axial_depth_mm", said.axial_depth_mm) * MM
    phi_st, phi_ex = _arc(said, tool)
    if said.feed_mm_min is None and said.feed_per_tooth_mm is None:
        raise ValueError("its feed is not known: say feed_mm_min or feed_per_tooth_mm")
    found = []
    if said.feed_mm_min is not None:
        found.append(_positive("feed_mm_min", said.feed_mm_min) * MM / (60 * tool.flutes * speed))
    if said.feed_per_tooth_mm is not None:
        found.append(_positive("feed_per_tooth_mm", said.feed_per_tooth_mm) * MM)
    if abs(found[0] - found[-1]) > 0.01 * found[0]:
        raise ValueError(
            f"its feed_mm_min = {said.feed_mm_min:g} is {found[0] / MM:.4g} mm for each tooth, its "
            f"feed_per_tooth_mm {found[1] / MM:.4g}: correct one of them"
        )
    return Conditions(
        speed=speed, f_z=found[0], a_p=a_p, phi_st=phi_st, phi_ex=phi_ex, flutes=tool.flutes
    )


def _positive(name: str, value: float | None) -> float:
    if value is None:
        raise ValueError(f"its {name} is not known: say it in cutting_records")
    if not (isfinite(value) and value > 0):
        raise ValueError(f"its {name} = {value:g} must be finite and positive")
    return value


def _arc(said: Said, tool: Tool) -> tuple[float, float]:
    """Where teeth enter and leave [rad]."""
    if said.entry_deg is not None and said.exit_deg is not None:
        if not 0 <= said.entry_deg < said.exit_deg <= 180:
            raise ValueError(
                f"its entry_deg = {said.entry_deg:g} and exit_deg = {said.exit_deg:g} must be "
                "from 0 to 180, the entry first"
            )
        return said.entry_deg * pi / 180, said.exit_deg * pi / 180
    if said.immersion is None:
        raise ValueError("its immersion is not known: say slot, up or down, or entry and exit")
    width = said.radial_depth_mm
    if said.immersion == "slot":
        if width is not None and abs(width / tool.diameter_mm - 1) > 0.01:
            raise ValueError(
                f"its radial_depth_mm = {width:g} is not the diameter of the tool, "
                f"{tool.diameter_mm:g}, as in a slot: correct one of them"
            )
        return 0.0, pi
    width = _positive("radial_depth_mm", width)
    if width > tool.diameter_mm * (1 + SAME):
        raise ValueError(
            f"its radial_depth_mm = {width:g} is more than the diameter of the tool, "
            f"{tool.diameter_mm:g}: correct one of them"
        )
    swept = acos(max(1 - 2 * width / tool.diameter_mm, -1.0))
    return (0.0, swept) if said.immersion == "up" else (pi - swept, pi)
