"""Cutting conditions of a recording: from its name, from a list by pattern, or common to all."""

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from fnmatch import fnmatchcase
from math import acos, isfinite, pi
from typing import Literal

from pipeline.cutting.tool import Tool
from pipeline.schema.cutting import CutConditions

MM = 1e-3
SAME = 1e-6
"""Relative difference below which two statements agree [1]."""
Immersion = Literal["slot", "up", "down"]
IMMERSIONS = ("slot", "up", "down")


@dataclass(frozen=True, kw_only=True)
class StatedConditions:
    """Cutting conditions as a person states them; None for what is not stated.

    Parameters
    ----------
    speed_rpm, feed_mm_min, feed_per_tooth_mm, axial_depth_mm, radial_depth_mm : float, optional
        Spindle speed [1/min], feed rate [mm/min], feed per tooth and depths of cut [mm].
    immersion : {"slot", "up", "down"}, optional
        Side of the tool that cuts.
    entry_deg, exit_deg : float, optional
        Entry and exit angle of the teeth (:mod:`pipeline.cutting.engagement.engagement`) [deg], in
        place of immersion and radial depth.
    """

    speed_rpm: float | None = None
    feed_mm_min: float | None = None
    feed_per_tooth_mm: float | None = None
    axial_depth_mm: float | None = None
    radial_depth_mm: float | None = None
    immersion: Immersion | None = None
    entry_deg: float | None = None
    exit_deg: float | None = None


def stated_conditions(
    recording: str,
    pattern: str | None,
    by_pattern: Mapping[str, StatedConditions],
    all_of_them: StatedConditions,
) -> StatedConditions:
    """All that is stated about ``recording``: by its name, by the list, and for all recordings.

    Raises
    ------
    ValueError
        When the pattern is no regular expression or names what is no condition, or two sources
        contradict each other.
    """
    statements = _present(all_of_them, "cutting_records.conditions")
    for name, one in by_pattern.items():
        if fnmatchcase(recording, name):
            _add(statements, _present(one, f"cutting_records.by_pattern, {name!r}"))
    if pattern is not None:
        _add(statements, _from_name(recording, pattern))
    stated = {name: value for name, (value, _) in statements.items()}
    return StatedConditions(**stated)  # type: ignore[arg-type]


def _present(stated: StatedConditions, source: str) -> dict[str, tuple[float | str, str]]:
    return {name: (value, source) for name, value in asdict(stated).items() if value is not None}


def _add(
    statements: dict[str, tuple[float | str, str]], new: Mapping[str, tuple[float | str, str]]
) -> None:
    for name, (value, source) in new.items():
        if name in statements and not _same(statements[name][0], value):
            earlier, other = statements[name]
            raise ValueError(
                f"its {name} is {earlier} by {other} and {value} by {source}: correct one of them"
            )
        statements[name] = (value, source)


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
    names = [one.name for one in fields(StatedConditions)]
    if unknown := sorted(set(expression.groupindex) - set(names)):
        raise ValueError(
            f"cutting_records.name has the group {unknown[0]!r}, which is no condition: use "
            f"{', '.join(names)}"
        )
    match = expression.search(recording)
    if match is None:
        return {}
    statements: dict[str, tuple[float | str, str]] = {}
    for name, text in match.groupdict().items():
        if text is None:
            continue
        if name == "immersion":
            if text not in IMMERSIONS:
                raise ValueError(f"its name says the immersion {text!r}: slot, up or down")
            statements[name] = (text, "its name")
        else:
            statements[name] = (_number(name, text), "its name")
    return statements


def _number(name: str, text: str) -> float:
    try:
        return float(text.strip(".").replace(",", "."))
    except ValueError as error:
        raise ValueError(
            f"its name says {name} = {text!r}, which is no number: correct cutting_records.name"
        ) from error


def conditions_of(stated: StatedConditions, tool: Tool) -> CutConditions:
    """CutConditions in SI.

    Raises
    ------
    ValueError
        When something is missing, out of its range or contradicts the rest.
    """
    speed = _positive("speed_rpm", stated.speed_rpm) / 60
    a_p = _positive("axial_depth_mm", stated.axial_depth_mm) * MM
    phi_st, phi_ex = _arc(stated, tool)
    if stated.feed_mm_min is None and stated.feed_per_tooth_mm is None:
        raise ValueError("its feed is not known: say feed_mm_min or feed_per_tooth_mm")
    feeds = []
    if stated.feed_mm_min is not None:
        feeds.append(_positive("feed_mm_min", stated.feed_mm_min) * MM / (60 * tool.flutes * speed))
    if stated.feed_per_tooth_mm is not None:
        feeds.append(_positive("feed_per_tooth_mm", stated.feed_per_tooth_mm) * MM)
    if abs(feeds[0] - feeds[-1]) > 0.01 * feeds[0]:
        raise ValueError(
            f"its feed_mm_min = {stated.feed_mm_min:g} is {feeds[0] / MM:.4g} mm for each tooth, "
            f"its feed_per_tooth_mm {feeds[1] / MM:.4g}: correct one of them"
        )
    return CutConditions(
        speed=speed, f_z=feeds[0], a_p=a_p, phi_st=phi_st, phi_ex=phi_ex, flutes=tool.flutes
    )


def _positive(name: str, value: float | None) -> float:
    if value is None:
        raise ValueError(f"its {name} is not known: say it in cutting_records")
    if not (isfinite(value) and value > 0):
        raise ValueError(f"its {name} = {value:g} must be finite and positive")
    return value


def _arc(stated: StatedConditions, tool: Tool) -> tuple[float, float]:
    """Entry and exit angle of the teeth [rad]."""
    if stated.entry_deg is not None and stated.exit_deg is not None:
        if not 0 <= stated.entry_deg < stated.exit_deg <= 180:
            raise ValueError(
                f"its entry_deg = {stated.entry_deg:g} and exit_deg = {stated.exit_deg:g} must be "
                "from 0 to 180, the entry first"
            )
        return stated.entry_deg * pi / 180, stated.exit_deg * pi / 180
    if stated.immersion is None:
        raise ValueError("its immersion is not known: say slot, up or down, or entry and exit")
    width = stated.radial_depth_mm
    if stated.immersion == "slot":
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
    return (0.0, swept) if stated.immersion == "up" else (pi - swept, pi)
