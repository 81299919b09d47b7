"""Documents of optimised programs, made by hand: as many groups of blocks as a test wants."""

import math
from typing import Any

from pipeline.schema.part import BlockGroup, OptimisedPart, part_of
from pipeline.schema.structure import structured

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


def method(name: str, time: float, cost: float, evaluations: int, feasible: bool = True) -> dict:
    """A row of the methods."""
    return {"method": name, "time_s": time, "cost": cost, "energy_kWh": 0.01 * time / 30,
            "tool_life_share": 0.02, "feasible": feasible, "evaluations": evaluations}  # fmt: skip


def front(many: int) -> list[dict[str, Any]]:
    """Time against cost on a hyperbola, with the knee in its middle."""
    return [
        {"time_s": 23.0 + 6.0 * u, "cost": 70.0 + 6.0 / (0.2 + u) * 2, "energy_kWh": 0.008,
         "tool_life_share": 0.02 - 0.01 * u, "knee": k == many // 3, "no_worse": False}
        for k in range(many) if (u := k / max(many - 1, 1)) is not None
    ]  # fmt: skip


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
    }  # fmt: skip


def part(document: dict[str, Any]) -> OptimisedPart:
    """A document as its type."""
    return part_of(document)


def blocks(rows: list[dict[str, Any]]) -> tuple[BlockGroup, ...]:
    """Groups of blocks as their type."""
    return structured(rows, tuple[BlockGroup, ...], "groups")
