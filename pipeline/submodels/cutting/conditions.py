"""Cutting conditions of a recording: from its name, from a list by pattern, or common to all."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import acos, isfinite, pi
from typing import Any, Literal

from pipeline.cutting.tool import Tool
from pipeline.schema.cutting import CutConditions
from pipeline.schema.si import MM
from pipeline.signals.conditions import Condition, ConditionSources

SAME = 1e-6
"""Relative difference below which two statements agree [1]."""
Immersion = Literal["slot", "up", "down"]
IMMERSIONS = ("slot", "up", "down")
UNITS: Mapping[str, str | None] = {
    "speed_rpm": "rev/min", "feed_mm_min": "mm/min", "feed_per_tooth_mm": "mm",
    "axial_depth_mm": "mm", "radial_depth_mm": "mm", "immersion": None, "entry_deg": "deg",
    "exit_deg": "deg",
}  # fmt: skip
"""Fields of :class:`StatedConditions` with their units; None for a word."""


@dataclass(frozen=True, kw_only=True)
class StatedConditions:
    """Cutting conditions as a person states them; None for what is not stated."""

    speed_rpm: float | None = None
    feed_mm_min: float | None = None
    feed_per_tooth_mm: float | None = None
    axial_depth_mm: float | None = None
    radial_depth_mm: float | None = None
    """Spindle speed [1/min], feed rate [mm/min], feed per tooth and depths of cut [mm]."""
    immersion: Immersion | None = None
    """Side of the tool that cuts."""
    entry_deg: float | None = None
    exit_deg: float | None = None
    """Entry and exit angle of the teeth (:mod:`pipeline.cutting.engagement.engagement`) [deg], in
    place of immersion and radial depth."""


def condition_sources(
    name: str | None,
    by_pattern: Mapping[str, StatedConditions],
    all_of_them: StatedConditions,
) -> ConditionSources:
    """Sources of the cutting conditions of recordings for the shared reader.

    From the named groups of a regular expression on the recording's ``name``, from a list by
    pattern of the name, and those common to all.
    """
    return ConditionSources(
        everywhere=_present(all_of_them), name=name, units=UNITS, section="cutting_records",
        by_pattern={pattern: _present(one) for pattern, one in by_pattern.items()},
    )  # fmt: skip


def _present(stated: StatedConditions) -> dict[str, float | str]:
    return {name: value for name, value in asdict(stated).items() if value is not None}


def _stated(conditions: Mapping[str, Condition]) -> StatedConditions:
    """Stated conditions, others left out; ValueError when a value is none of the condition."""
    stated: dict[str, Any] = {}
    for name, unit in UNITS.items():
        one = conditions.get(name)
        if one is None:
            continue
        if unit is None and one.value not in IMMERSIONS:
            raise ValueError(f"its {name} by {one.source} is {one.value!r}: slot, up or down")
        stated[name] = one.value if unit is None or one.unit == unit else one.to(unit)
    return StatedConditions(**stated)


def conditions_of(conditions: Mapping[str, Condition], tool: Tool) -> CutConditions:
    """Conditions of a cut in SI; ValueError when they are incomplete, invalid or contradictory."""
    stated = _stated(conditions)
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
