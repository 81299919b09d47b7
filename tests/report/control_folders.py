"""A machine's control, judged runs and part programs, as the stages before leave them."""

import json
import math
from collections import defaultdict
from pathlib import Path

import numpy as np
from report_folders import write_table

from pipeline.report.folders import MachineFolders

NONE = math.nan
RAPID = 30_000.0  # mm/min
ACCELERATION = 3e6  # mm/min/min, coarse: 0.83 m/s^2
TYPES = {"spindle": "spindle and M codes"}
WORDS = ("kind", "limit")
WHOLE = {"line": np.int32, "tool": np.int32, "plane": np.int32}


class Programmer:
    """Writes moves one after the other, with the time of a machine of mild acceleration."""

    def __init__(self, origin=(0.0, 0.0, 150.0)):
        self.origin, self.here = list(origin), list(origin)
        self.rows: list[dict] = []
        self.tool = -1

    def approach(self, **to: float):
        """Over a point of the part, then down to it."""
        self.move("rapid", **to)
        self.move("rapid", z=5.0)

    def move(self, kind: str, feed: float = NONE, angle: float = 0.0, centre=None, **to: float):
        start = self.here
        self.here = [float(to.get(axis, old)) for axis, old in zip("xyz", start, strict=True)]
        length = math.dist(start, self.here)
        if centre is not None:
            length = math.hypot(math.dist(start[:2], centre[:2]) * angle, self.here[2] - start[2])
        asked = RAPID if kind == "rapid" else feed
        reached = min(asked, math.sqrt(ACCELERATION * length)) if length else NONE
        slow = reached < asked
        limit = "rapid" if kind == "rapid" else "feed"
        if slow:
            limit = "arc" if centre is not None else "corner" if length < 2 else "acceleration"
        cx, cy, cz = (*centre, start[2]) if centre is not None else (NONE,) * 3
        self._row(kind, feed, reached, length / reached * 60 if length else 0.0, limit,
                  angle, (cx, cy, cz))  # fmt: skip

    def _row(self, kind, feed, reached, time, limit, angle=0.0, centre=(NONE,) * 3):
        x, y, z = self.here
        self.rows.append({
            "line": len(self.rows) + 1, "kind": kind, "x": x, "y": y, "z": z, "cx": centre[0],
            "cy": centre[1], "cz": centre[2], "angle": angle, "plane": 17,
            "programmed_feed": feed, "reached_feed": reached, "time": time, "tool": self.tool,
            "limit": limit,
        })  # fmt: skip

    def still(self, kind: str, seconds: float):
        self._row(kind, NONE, NONE, seconds, "nothing")

    def change(self, tool: int):
        self.move("rapid", z=150.0)
        self.tool = tool
        self.still("tool change", 6.5)
        self.still("spindle", 1.2)

    def document(self, name: str, machine: str = "mill01", origin: str = "simulated") -> dict:
        tools, types, limits = (
            defaultdict(lambda: [0.0] * 4),
            defaultdict(float),
            defaultdict(float),
        )
        here = self.origin
        for row in self.rows:
            cut = row["kind"] in ("feed", "arc")
            length = math.dist(here, (row["x"], row["y"], row["z"]))
            here = (row["x"], row["y"], row["z"])
            entry = tools[row["tool"]]
            for place, amount in enumerate(
                (row["time"], row["time"] * cut, row["time"] * (row["kind"] == "rapid"), length)
            ):
                entry[place] += amount  # fmt: skip
            types[TYPES.get(row["kind"], row["kind"])] += row["time"]
            limits[row["limit"]] += row["time"]
        return {
            "program": name, "machine": machine, "total_time_s": sum(t[0] for t in tools.values()),
            "path_length_mm": sum(t[3] for t in tools.values()), "origin_mm": self.origin,
            "cutting_time_s": sum(t[1] for t in tools.values()),
            "by_tool": [{"tool": k, "time_s": t[0], "cutting_s": t[1], "rapid_s": t[2],
                         "length_mm": t[3]} for k, t in tools.items()],
            "by_type": dict(types), "by_limit": dict(limits), "blocks": len(self.rows),
            "refused": None, "file": f"programs/{name}", "sha256": "ef" * 32,
        }  # fmt: skip


def part(chords: int = 400, passes: int = 3) -> Programmer:
    """Facing, a contour with round corners, a pocket of helices, drilling, a surface of chords."""
    p = Programmer()
    p.change(1)
    for i in range(8):
        y = 12.0 * i
        p.approach(x=-20.0 if i % 2 == 0 else 180.0, y=y)
        p.move("feed", 800.0, z=0.0)
        p.move("feed", 3200.0, x=180.0 if i % 2 == 0 else -20.0)
    p.change(2)
    p.approach(x=10.0, y=-6.0)
    for i in range(passes):
        z = -4.0 * (i + 1)
        p.move("feed", 400.0, z=z)
        contour(p, z, 1600.0)
    p.change(3)
    for i in range(2 * passes):
        p.approach(x=60.0, y=45.0)
        p.move("feed", 300.0, z=-2.0 * i)
        for ring in range(1, 9):
            r = 3.0 * ring
            p.move("feed", 2400.0, x=60.0 + r)
            p.move("arc", 2400.0, angle=2 * math.pi, centre=(60.0, 45.0), x=60.0 + r,
                   z=-2.0 * (i + 1))  # fmt: skip
        p.move("rapid", z=5.0)
    p.change(4)
    for i in range(12):
        p.approach(x=12.0 + 13.0 * i, y=80.0 if i % 2 else 10.0)
        p.move("feed", 150.0, z=-20.0)
        p.move("rapid", z=5.0)
    p.change(5)
    for row in range(6):
        y = 20.0 + 10 * row
        p.approach(x=100.0, y=y)
        for i in range(1, chords + 1):
            x = 100.0 + 60.0 * i / chords
            p.move("feed", 2000.0, x=x, y=y + 2 * math.sin(x / 4), z=-6 - 4 * math.cos(x / 9))
        p.move("rapid", z=5.0)
    p.still("dwell", 2.0)
    return p


def contour(p: Programmer, z: float, feed: float, r: float = 10.0) -> None:
    """Once around a plate of 160 x 90 mm with round corners, anticlockwise."""
    x0, y0, x1, y1 = 0.0, -6.0, 160.0, 84.0
    quarter = math.pi / 2
    p.move("feed", feed, x=x1 - r, y=y0)
    p.move("arc", feed, angle=quarter, centre=(x1 - r, y0 + r), x=x1, y=y0 + r)
    p.move("feed", feed, y=y1 - r)
    p.move("arc", feed, angle=quarter, centre=(x1 - r, y1 - r), x=x1 - r, y=y1)
    p.move("feed", feed, x=x0 + r)
    p.move("arc", feed, angle=quarter, centre=(x0 + r, y1 - r), x=x0, y=y1 - r)
    p.move("feed", feed, y=y0 + r)
    p.move("arc", feed, angle=quarter, centre=(x0 + r, y0 + r), x=x0 + r, y=y0)


def write_program(folders: MachineFolders, stem: str, written: Programmer, **other) -> Path:
    path = folders.models / "programs" / f"{stem}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    document = written.document(f"{stem}.nc", folders.name, folders.origin)
    path.write_text(json.dumps({**document, **other}))
    columns = {k: [row[k] for row in written.rows] for k in (written.rows or [{}])[0]}
    typed = {k: v if k in WORDS else np.array(v, WHOLE.get(k, float)) for k, v in columns.items()}
    if typed:
        write_table(path.with_suffix(".parquet"), typed)
    return path


def write_refused(folders: MachineFolders, stem: str, why: str) -> None:
    path = folders.models / "programs" / f"{stem}.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"program": f"{stem}.nc", "machine": folders.name, "refused": why,
                                "origin": folders.origin, "sha256": "0a" * 32}))  # fmt: skip


def parameter(value: float | None, unit: str, spread: float = 0.03, remedy: str | None = None):
    return {
        "value": value, "unit": unit, "determined": value is not None, "remedy": remedy,
        "low": None if value is None else value * (1 - spread),
        "high": None if value is None else value * (1 + spread),
        "how": "bounded least squares over the stretches between polled lines",
    }  # fmt: skip


def write_control(folders: MachineFolders) -> None:
    folders.models.mkdir(parents=True, exist_ok=True)
    (folders.models / "control.json").write_text(json.dumps({
        "model": "control", "machine": folders.name, "origin": folders.origin,
        "parameters": {
            "rapid_speed XY": parameter(30_000.0, "mm/min"),
            "rapid_acceleration": parameter(4200.0, "mm/s^2"),
            "cutting_acceleration": parameter(2900.0, "mm/s^2", 0.08),
            "arc_acceleration XYZ": parameter(1500.0, "mm/s^2", 0.2),
            "corner_jump": parameter(310.0, "mm/min", 0.12),
            "settle_time": parameter(0.042, "s", 0.05),
            "tool_change": parameter(6.5, "s", 0.01),
            "jerk": parameter(None, "mm/s^3", remedy="run a program of 5 mm blocks at 10 m/min"),
        },
        "runs": {
            "training": [{"run": "run-01", "program": "plate.nc"},
                         {"run": "run-03", "program": "cover.nc"}],
            "left_out": [{"run": "run-07", "reason": "no program of the machine fits"}],
        },
        "fit": {"rmse_s": 0.118, "segments": 412, "condition": 38.0,
                "correlation": {"names": ["corner_jump", "settle_time", "arc_acceleration"],
                                "values": [[1, -0.81, 0.2], [-0.81, 1, 0.1], [0.2, 0.1, 1]]}},
        "found_from": {"control/run-01.txt": "12" * 32, "programs/plate.nc": "34" * 32},
    }))  # fmt: skip


def run(name: str, program: str, error: float, role: str = "judged", **other) -> dict:
    """One run whose prediction is wrong by ``error`` percent."""
    shares = {
        "rapid": (60.0, 1.0),
        "feed": (400.0, error),
        "arc": (120.0, error),
        "tool change": (40.0, -0.5),
        "spindle and M codes": (20.0, 3.0),
        "dwell": (2.0, 0),
    }
    measured = sum(m for m, _ in shares.values())
    return {
        "run": name, "program": program, "role": role, "completed": True, "measured_s": measured,
        "stops_s": 14.0, "predicted_s": measured * (1 + error / 100), "error_percent": error,
        "naive_s": measured * 0.71, "naive_error_percent": -29.0 + error,
        "recorded_override_only_error_percent": error + 9.0, "feed_read_share": 0.87,
        "by_type": {t: {"measured_s": m, "predicted_s": m * (1 + e / 100), "error_percent": e}
                    for t, (m, e) in shares.items()},
        **other,
    }  # fmt: skip


def write_validation(folders: MachineFolders, runs: list[dict], **other) -> None:
    folders.models.mkdir(parents=True, exist_ok=True)
    (folders.models / "control_validation.json").write_text(json.dumps({
        "machine": folders.name, "origin": folders.origin, "limit_percent": 5.0, "runs": runs,
        "passed": all(abs(r["error_percent"]) <= 5 for r in runs),
        "left_out": [{"run": "run-07", "reason": "no program of the machine fits"}], **other,
    }))  # fmt: skip


RUNS = (
    ("run-01", "plate.nc", 0.4, "training"), ("run-02", "plate.nc", 1.8, "judged"),
    ("run-03", "cover.nc", -0.9, "training"), ("run-04", "cover.nc", -3.1, "judged"),
    ("run-05", "box.nc", 4.2, "judged"),
)  # fmt: skip


def with_control(folders: MachineFolders, runs=RUNS) -> MachineFolders:
    """The same machine with a control, judged runs, two programs and one that is refused."""
    write_control(folders)
    write_validation(folders, [run(n, p, e, role) for n, p, e, role in runs])
    write_program(folders, "plate", part())
    write_program(folders, "cover", part(chords=40, passes=1))
    write_refused(folders, "odd", "odd.nc line 14: G12.1 is not known; post it without polar mode")
    return folders
