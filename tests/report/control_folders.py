"""A machine's control, judged runs and part programs, as the stages before leave them."""

import math
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from report_folders import parameter, write_table

from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from pipeline.report.folders import MachineFolders
from pipeline.schema.model import Correlation, LeftOut, SourceFile, Training
from pipeline.schema.program_cut import SimulatedProgram, ToolTime
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Fact, JudgedCase, Score, Verdict
from pipeline.twin.control import ControlFitFacts, ControlModelFile

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

    def summary(
        self, name: str, machine: str = "mill01", origin: str = "simulated"
    ) -> SimulatedProgram:
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
                entry[place] += finite(amount)
            types[TYPES.get(row["kind"], row["kind"])] += finite(row["time"])
            limits[row["limit"]] += finite(row["time"])
        by_tool = tuple(
            ToolTime(tool=k, time_s=t[0], cutting_s=t[1], rapid_s=t[2], length_mm=t[3])
            for k, t in tools.items()
        )
        x, y, z = self.origin
        return SimulatedProgram(
            program=name, machine=machine, origin=origin, file=f"programs/{name}",
            sha256="ef" * 32, total_time_s=sum(t.time_s for t in by_tool),
            cutting_time_s=sum(t.cutting_s for t in by_tool),
            path_length_mm=sum(t.length_mm for t in by_tool), origin_mm=(x, y, z),
            by_tool=by_tool, by_type=dict(types), by_cause=dict(limits), blocks=len(self.rows),
        )  # fmt: skip


def finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


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
    path = folders.programs / f"{stem}.json"
    summary = written.summary(f"{stem}.nc", folders.name, folders.origin)
    write_json(replace(summary, **other), path)
    columns = {k: [row[k] for row in written.rows] for k in (written.rows or [{}])[0]}
    typed = {k: v if k in WORDS else np.array(v, WHOLE.get(k, float)) for k, v in columns.items()}
    if typed:
        write_table(path.with_suffix(".parquet"), typed)
    return path


def write_refused(folders: MachineFolders, stem: str, why: str) -> None:
    refused = SimulatedProgram(program=f"{stem}.nc", machine=folders.name, refused=why,
                               origin=folders.origin, sha256="0a" * 32)  # fmt: skip
    write_json(refused, folders.programs / f"{stem}.json")


def log_of(name: str) -> SourceFile:
    return SourceFile(file=f"control/{name}.txt", sha256="12" * 32)


def write_control(folders: MachineFolders) -> None:
    method = "bounded least squares over the stretches between polled lines"
    axis = AxisParameters(
        rapid_speed=30_000.0,
        cutting_speed=15_000.0,
        rapid_acceleration=4200.0,
        cutting_acceleration=2900.0,
        arc_acceleration=1500.0,
        corner_jump=310.0,
    )
    found = {
        "rapid_speed XY": parameter(30_000.0, "mm/min", 0.03, method),
        "rapid_acceleration": parameter(4200.0, "mm/s^2", 0.03, method),
        "cutting_acceleration": parameter(2900.0, "mm/s^2", 0.08, method),
        "arc_acceleration XYZ": parameter(1500.0, "mm/s^2", 0.2, method),
        "corner_jump": parameter(310.0, "mm/min", 0.12, method),
        "settle_time": parameter(0.042, "s", 0.05, method),
        "tool_change": parameter(6.5, "s", 0.01, method),
        "jerk": parameter(None, "mm/s^3", remedy="run a program of 5 mm blocks at 10 m/min"),
    }
    write_json(ControlModelFile(
        submodel="control", machine=folders.name, origin=folders.origin, parameters={"": found},
        trained_on=tuple(Training(case=n, group=n, files=(log_of(n),))
                         for n in ("run-01", "run-03")),
        left_out=(LeftOut(case="run-07", reason="no program of the machine fits"),),
        control={"": ControlParameters(axes={letter: axis for letter in "XYZ"})},
        fit=ControlFitFacts(
            rmse_s=0.118, segments=412, condition=38.0,
            correlation=Correlation(
                names=("corner_jump", "settle_time", "arc_acceleration"),
                values=((1.0, -0.81, 0.2), (-0.81, 1.0, 0.1), (0.2, 0.1, 1.0)),
            ),
        ),
        programs={"run-01": "plate.nc", "run-03": "cover.nc"},
    ), folders.models / "control" / "model.json")  # fmt: skip


SHARES = {
    "rapid": (60.0, 1.0), "feed": (400.0, None), "arc": (120.0, None), "tool change": (40.0, -0.5),
    "spindle and M codes": (20.0, 3.0), "dwell": (2.0, 0.0),
}  # fmt: skip
"""Measured time [s] of each type of block, and its error [%]; None for that of the whole run."""


Run = tuple[JudgedCase, list[Score]]


def run(
    name: str, program: str, error: float | None, role: str = "held_out", completed: bool = True
) -> Run:
    """One run whose prediction is wrong by ``error`` percent, with its scores by type of block."""
    measured = sum(m for m, _ in SHARES.values())
    known = error is not None
    facts = {
        "program": Fact(value=program), "measured": Fact(value=measured, unit="s"),
        "predicted": Fact(value=measured * (1 + error / 100) if known else None, unit="s"),
        "error": Fact(value=error, unit="%"), "stops": Fact(value=14.0, unit="s"),
        "path over programmed feed": Fact(value=measured * 0.71, unit="s"),
        "error of path over programmed feed": Fact(value=-29.0 + error if known else None),
        "error of recorded override only": Fact(value=error + 9.0 if known else None, unit="%"),
        "completed": Fact(value="yes" if completed else "no"),
        "feed read from speeds": Fact(value=0.87, unit="1"),
    }  # fmt: skip
    counts = known and role == "held_out" and completed
    status = "not judged" if not counts else "passed" if abs(error) <= 5 else "failed"
    scores = [
        Score(quantity="run time", unit="s", group=name, regime=regime, role=role, n=1,
              bias=m * e / 100, mean_percent=e, relative_percent=abs(e),
              limits={"relative_percent": 5.0} if regime == "whole run" else {},
              status=status if regime == "whole run" else "not judged")
        for regime, (m, e) in (
            {"whole run": (measured, error)}
            | {t: (m, error if e is None else e) for t, (m, e) in SHARES.items()}
        ).items()
        if e is not None
    ]  # fmt: skip
    return JudgedCase(case=name, group=name, role=role, facts=facts), scores


def write_validation(folders: MachineFolders, runs: list[Run], left_out: str = "run-07") -> None:
    scores = tuple(score for _, some in runs for score in some)
    failed = any(score.status == "failed" for score in scores)
    judged = any(score.status == "passed" for score in scores)
    write_json(Verdict(
        submodel="control", machine=folders.name, origin=folders.origin,
        status="failed" if failed else "passed" if judged else "not judged",
        reasons=("a run is beyond the limit",) if failed else (), judged_role="held_out",
        golden=None, scores=scores, cases=tuple(case for case, _ in runs),
        left_out=(LeftOut(case=left_out, reason="no program of the machine fits"),),
    ), folders.models / "control" / "verdict.json")  # fmt: skip


RUNS = (
    ("run-01", "plate.nc", 0.4, "training"), ("run-02", "plate.nc", 1.8, "held_out"),
    ("run-03", "cover.nc", -0.9, "training"), ("run-04", "cover.nc", -3.1, "held_out"),
    ("run-05", "box.nc", 4.2, "held_out"),
)  # fmt: skip


def with_control(folders: MachineFolders, runs=RUNS) -> MachineFolders:
    """The same machine with a control, judged runs, two programs and one that is refused."""
    write_control(folders)
    write_validation(folders, [run(n, p, e, role) for n, p, e, role in runs])
    write_program(folders, "plate", part())
    write_program(folders, "cover", part(chords=40, passes=1))
    write_refused(folders, "odd", "odd.nc line 14: G12.1 is not known; post it without polar mode")
    return replace(folders, submodels=(*folders.submodels, "control"))
