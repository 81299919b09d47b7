"""Documents of optimised programs, made by hand: as many groups of blocks as a test wants."""

import math
from typing import Any

from pipeline.schema.part import BlockGroup, OptimisedPart
from pipeline.schema.store import structured

HASHES = ("a1" * 32, "b2" * 32, "c3" * 32)
BINDS = ("load limit", "spindle torque", "greatest chip", None)


def group(k: int) -> dict[str, Any]:
    """One group of two lines; what it says follows from its place."""
    feed, speed = 220.0 + 40.0 * (k % 5), 3000.0 + 500.0 * (k % 3)
    before, after = 1.0 + 0.2 * (k % 4), 0.8 + 0.15 * (k % 4)
    return {
        "first_line": 5 + 2 * k, "last_line": 6 + 2 * k, "tool": 1 + k // max(20, 1) % 2,
        "feed_before": 200.0, "feed_after": feed, "feed_unit": "mm/min",
        "speed_before": 2500.0, "speed_after": speed,
        "time_before_s": before, "time_after_s": after,
        "cost_before": 4.0 * before, "cost_after": 3.0 * after,
        "peak_load_before_N": 40.0 + 6.0 * (k % 6), "peak_load_after_N": 52.0 + 1.2 * (k % 6),
        "binds": BINDS[k % 4],
    }  # fmt: skip


def trace(columns: int, level: float) -> dict[str, Any]:
    """Loads around ``level`` with air in every ninth column."""
    load = [
        None if k % 9 == 8 else round(level * (0.8 + 0.2 * math.sin(k / 7)), 2)
        for k in range(columns)
    ]
    return {"total_mm": 4.0 * columns, "way_mm": [4.0 * k for k in range(columns)], "load_N": load,
            "line": [5 + k // 4 for k in range(columns)]}  # fmt: skip


def totals(time: float, cost: float, energy: float, life: float, peak: float, beyond: int) -> dict:
    """What stands under ``before`` and ``after``."""
    return {"time_s": time, "cost": cost, "energy_kWh": energy, "tool_life_share": life,
            "peak_load_N": peak, "peak_line": 12, "beyond": beyond}  # fmt: skip


def method(
    name: str, time: float, cost: float, evaluations: int, feasible: bool = True,
    limits: str = "certain",
) -> dict:  # fmt: skip
    """A row of the methods."""
    return {"method": name, "limits": limits, "time_s": time, "cost": cost,
            "energy_kWh": 0.01 * time / 30, "tool_life_share": 0.02, "feasible": feasible,
            "evaluations": evaluations}  # fmt: skip


def front(many: int) -> list[dict[str, Any]]:
    """Time against cost on a hyperbola, with the knee in its middle."""
    return [
        {"time_s": 23.0 + 6.0 * u, "cost": 70.0 + 6.0 / (0.2 + u) * 2, "energy_kWh": 0.008,
         "tool_life_share": 0.02 - 0.01 * u, "knee": k == many // 3, "no_worse": False}
        for k in range(many) if (u := k / max(many - 1, 1)) is not None
    ]  # fmt: skip


def tool_use(number: int, name: str, before: float, after: float) -> dict[str, Any]:
    """A tool whose feed per tooth may be 0.02 to 0.1 mm."""

    def cut(f_z: float) -> dict[str, Any]:
        return {
            "tool": number, "name": name, "blocks": 9, "time_s": 12.0, "at_feed_s": 9.0,
            "in_material_s": 8.0, "air_share": 0.1, "highest_removal_rate_cm3_min": 4.0,
            "cost": None, "feed_per_tooth_mm": f_z, "chip_thickness_mm": f_z,
            "cutting_speed_m_min": 157.08, "axial_depth_mm": 2.0, "radial_depth_mm": 10.0,
            "peak_load_N": 400.0 * f_z, "mean_load_N": 200.0 * f_z, "axial_force_N": 9.0,
            "torque_Nm": 4.0 * f_z, "peak_torque_Nm": 6.0 * f_z, "power_kW": 9.0 * f_z,
            "drive_share": 0.2, "deflection_um": 4.0, "stability_margin": 0.3, "volume_cm3": 2.0,
            "removal_rate_cm3_min": 3.0, "tool_life_share": 0.02, "energy_kWh": None,
        }  # fmt: skip

    return {
        "tool": number, "name": name, "before": cut(before), "after": cut(after),
        "feed_per_tooth_range_mm": [0.02, 0.1], "cutting_speed_range_m_min": None,
        "range_source": "tool table", "kept": None, "binds": "load limit",
    }  # fmt: skip


def change(k: int) -> dict[str, Any]:
    """One change of F 200 to more or less by its place; S stays."""
    feed = (100.0, 220.0, 300.0, 500.0)[k % 4]
    return {
        "first_line": 5 + 2 * k, "last_line": 6 + 2 * k, "tool": 1, "operation": "",
        "feed_unit": "mm/min", "feed_before": 200.0, "feed_after": feed, "speed_before": 2500.0,
        "speed_after": 2500.0, "feed_per_tooth_before_mm": 0.04,
        "feed_per_tooth_after_mm": 0.04 * feed / 200.0, "binds": BINDS[k % 4],
    }  # fmt: skip


def line(number: int, name: str) -> dict[str, Any]:
    """A line of the program; every other one has another F."""
    changed, feed = number % 2 == 1, f"{(100, 220, 300, 500)[(number - 5) // 2 % 4]}."
    return {
        "line": number, "before": f"G1 X{number}. F200. ({name} F7)",
        "after": f"G1 X{number}. F{feed} ({name} F7)" if changed else None,
        "feed_before": 200.0, "feed_after": float(feed), "speed_before": 2500.0,
        "speed_after": 2500.0,
    }  # fmt: skip


def path(columns: int) -> dict[str, Any]:
    """A zigzag over a blank of 60 x 40 x 10 mm, a point for each column."""
    return {
        "frame": "G54", "x_mm": [60.0 * (k % 20) / 19 for k in range(columns)],
        "y_mm": [40.0 * k / columns for k in range(columns)], "z_mm": [-2.0] * columns,
        "starts": [0], "column": list(range(columns)), "line": [5 + k // 4 for k in range(columns)],
        "blank_low_mm": [0.0, 0.0, -10.0], "blank_high_mm": [60.0, 40.0, 0.0],
        "round_blank": False,
    }  # fmt: skip


def setup(name: str) -> dict[str, Any]:
    """A sheet of one tool, one offset and one warning."""
    return {
        "tools": [{"tool": 1, "name": name, "kind": "flat", "diameter_mm": 10.0,
                   "stickout_mm": 32.0, "flutes": 2, "length_mm": 127.711, "time_s": 24.51,
                   "in_material_s": 16.0, "life_share": 0.0152}],
        "offsets": [{"name": "G54", "position_mm": [-410.0, -235.0, -470.0]},
                    {"name": "G55", "position_mm": None}],
        "blank_offset": "G54",
        "warnings": [{"what": "rapids go through the material", "do": "Retract further.",
                      "lines": [7, 8, 9, 21], "blocks": 4, "grave": True}],
    }  # fmt: skip


def optimised(groups: int = 24, columns: int = 300, members: int = 30, name: str = "SLOT") -> dict:
    """A whole document; ``name`` stands wherever a person's words do."""
    return {
        "program": name, "machine": "mill01", "origin": "simulated", "control": "identified",
        "objective": "cost", "currency": "KRW", "stock": "box:0,60,0,40,-10,0",
        "material": f"A6061 {name}", "tool_table": "sim2023",
        "limits": {"load_N": 60.0, "feed_mm_min": [100.0, 500.0], "speed_rpm": [1000.0, 8000.0],
                   "power_share": 1.0, "margins": {"load": 0.0, "power": 0.05}},
        "certainty": {
            "epsilon": 0.01, "exceedance": 0.0071, "interval_95": [0.003, 0.014], "draws": 4096,
            "peaks": [{"share": 0.5, "load_N": 52.0}, {"share": 0.99, "load_N": 59.4}],
            "nominal": {"time_s": 23.8, "cost": 72.0},
            "price": {"time_s": 0.7, "time_percent": 2.9, "cost": 4.4, "cost_percent": 6.1},
            "uncertain": [
                {"what": "cutting coefficients of T1", "value": "K_tc 1230 N/mm²",
                 "spread": "± 10 %", "source": "measured on another machine"},
                {"what": "runout of T1", "value": "0 µm", "spread": "3 µm", "source": name},
            ],
        },
        "before": totals(29.48, 120.1, 0.0101, 0.021, 71.2, 3)
        | {"beyond_of": {"load": 2, "stability": 1}},
        "after": totals(24.51, 76.4, 0.0088, 0.0152, 57.9, 0),
        "gain": {"time_percent": -16.86, "cost_percent": -36.39, "energy_percent": -12.9,
                 "tool_life_percent": -27.6},
        "methods": [
            method("as programmed", 29.48, 120.1, 1, feasible=False),
            method("direct", 24.6, 76.9, 1),
            method("this answer", 24.51, 76.4, 1921),
            method("genetic, random start, 10 generations", 25.9, 88.0, 481),
            method("best of 5000 evaluations", 24.55, 76.5, 5000),
            method("direct", 23.8, 72.0, 1, limits="nominal"),
            method("this answer", 23.7, 71.8, 1921, limits="nominal"),
        ],
        "front": front(members),
        "groups": [group(k) for k in range(groups)],
        "binding": [{"limit": "load limit", "blocks": 9, "time_s": 14.2},
                    {"limit": "greatest chip", "blocks": 4, "time_s": 3.1}],
        "held": [{"reason": "threads keep their feed", "rows": 3, "first": f"{name}.nc:9"}],
        "words": {"F_changed": 12, "F_added": 8, "S_changed": 1, "S_added": 5},
        "proof": {"same": True, "sha256": HASHES[0], "moves": 212, "before_sha256": HASHES[1],
                  "after_sha256": HASHES[2], "first": None},
        "trace": {"before": trace(columns, 66.0), "after": trace(columns, 55.0),
                  "tools": [[1, 0.0, 0.6], [2, 0.6, 1.0]]},
        "verified": {"peak_load_N": 58.4, "peak_line": 12, "following_um": {"X": 4.1, "Y": 3.2},
                     "full_evaluations": 7, "tightened": 2},
        "interrupted": False,
        "not_known": [{"what": "stability", "why": "the machine’s file has no section dynamics"}],
        "notes": ["Forces: catalogue values are off by 20 to 30 %."],
        "tools": [tool_use(1, name, 0.05, 0.0833), tool_use(2, name, 0.05, 0.2)],
        "changes": [change(k) for k in range(groups)],
        "lines": [line(5 + k, name) for k in range(2 * groups)],
        "path": path(columns), "setup": setup(name),
    }  # fmt: skip


def part(document: dict[str, Any]) -> OptimisedPart:
    """A document as its type."""
    return structured(document, OptimisedPart, "$")


def blocks(rows: list[dict[str, Any]]) -> tuple[BlockGroup, ...]:
    """Groups of blocks as their type."""
    return structured(rows, tuple[BlockGroup, ...], "groups")
