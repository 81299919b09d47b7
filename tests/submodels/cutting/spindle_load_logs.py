"""A machine that cuts slots while its spindle's load is logged: program, motion, meter, adapter.

Written independently of what reads it: the place of the tool is known at every millisecond, and
the log holds changes only, seen at polls that come when they come.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.tool import Tool
from pipeline.submodels.cutting.settings import LoadCut, LoadItems, SpindleLoadRecords
from tests.submodels.control.polled_logs import Said, write_log

DRIVE = SpindleDrive(
    rated_power_kW=12.0, base_speed_rpm=3000.0, top_speed_rpm=12000.0, efficiency=0.9
)
NO_LOAD = (40.0, 1.5, 0.02)  # at the nose; W, W s, W s^2 of n in rev/s
K_TC, K_TE = 900e6, 25e3  # N/m^2, N/m
TOOL = Tool(kind="flat", diameter_mm=12.0, flutes=3)
RADIUS, LENGTH, CLEAR = 6.0, 150.0, 5.0  # mm; of the blank, and before it
PITCH, MARGIN = 16.0, 9.0  # mm, from slot to slot, to the first
DT = 1e-3
PROGRAM, CUT_LOG, FREE_LOG = "cutting/O1.nc", "cutting/O1-run1.txt", "cutting/no-load-run1.txt"
SPEEDS = (1500.0, 3000.0, 4500.0, 6000.0, 7500.0, 9000.0)


@dataclass(frozen=True)
class Slot:
    """A slot: rev/min, mm/min, mm; what the operator's override makes of the feed."""

    speed: float
    feed: float
    depth: float
    override: float = 1.0


SLOTS = (
    Slot(4500.0, 720.0, 3.0), Slot(4500.0, 1200.0, 4.0), Slot(6000.0, 720.0, 3.0),
    Slot(6000.0, 1440.0, 3.0), Slot(7500.0, 900.0, 2.0), Slot(7500.0, 1800.0, 3.0),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Bench:
    """What is cut and how it is logged: meter's step and noise [%], its lag and the polls [s]."""

    slots: Sequence[Slot] = SLOTS
    free: Sequence[float] = SPEEDS
    step: float = 0.01
    noise: float = 0.0
    lag: float = 0.2
    poll: float = 0.15
    begin: float = 0.0  # of the first poll, as a part of a period
    hold: tuple[int, float] = (-1, 0.0)  # the slot in whose middle the feed is held, how long [s]
    rest: float = 1.0  # between slots [s]
    seed: int = 0


@dataclass
class Trace:
    """What happens, millisecond by millisecond."""

    line: list[np.ndarray] = field(default_factory=list)
    speed: list[np.ndarray] = field(default_factory=list)
    feed: list[np.ndarray] = field(default_factory=list)
    engaged: list[np.ndarray] = field(default_factory=list)  # part of a slot's engagement
    depth: list[np.ndarray] = field(default_factory=list)

    def add(
        self, line: int, speed: Any, feed: Any, engaged: Any = 0.0, depth: float = 0.0,
        seconds: float = 0.0,
    ) -> None:  # fmt: skip
        many = np.size(engaged) if np.size(engaged) > 1 else round(seconds / DT)
        for name, value in (
            ("line", line), ("speed", speed), ("feed", feed), ("engaged", engaged),
            ("depth", depth),
        ):  # fmt: skip
            getattr(self, name).append(np.broadcast_to(np.asarray(value, float), many))

    def column(self, name: str) -> np.ndarray:
        return np.concatenate(getattr(self, name))


def program_and_trace(bench: Bench) -> tuple[str, Trace]:
    """The program's text, and what the machine does in it."""
    text = ["%", "O1 (SLOTS)", "G21 G17 G40 G49 G80 G90 G54", "T1 M6", "G0 Z25"]
    trace, speed = Trace(), 0.0
    trace.add(5, 0.0, 0.0, seconds=2.0)
    start, way = -RADIUS - CLEAR, LENGTH + 2 * (RADIUS + CLEAR)
    for number, slot in enumerate(bench.slots):
        text.append(f"S{slot.speed:.0f} M3")
        trace.add(len(text), np.linspace(speed, slot.speed, 500), 0.0, np.zeros(500))
        speed = slot.speed
        text.append(f"G4 P{1e3 * bench.rest:.0f}")
        trace.add(len(text), speed, 0.0, seconds=bench.rest)
        text.append(f"G0 X{start} Y{MARGIN + PITCH * number}")
        trace.add(len(text), speed, 400.0, seconds=way / 400)
        text.append(f"G1 Z-{slot.depth} F600")
        trace.add(len(text), speed, 10.0, seconds=(25 + slot.depth) / 10)
        text.append(f"G1 X{start + way} F{slot.feed:.0f}")
        feed = slot.feed * slot.override / 60
        x = start + np.arange(0.0, way, feed * DT)
        engaged = np.interp(x, [-RADIUS, 0.0, LENGTH - RADIUS, LENGTH], [0.0, 1.0, 1.0, 0.0])
        rates = np.full(len(x), feed)
        if bench.hold[0] == number:
            held = round(bench.hold[1] / DT)
            engaged = np.insert(engaged, [len(x) // 2] * held, 1.0)
            rates = np.insert(rates, [len(x) // 2] * held, 0.0)
        trace.add(len(text), speed, rates, engaged, slot.depth)
        text.append("G0 Z25")
        trace.add(len(text), speed, 400.0, seconds=(25 + slot.depth) / 400)
    text += ["M5", "M30", "%"]
    return "\n".join(text) + "\n", trace


def free_trace(bench: Bench) -> Trace:
    """The spindle at each speed for 8 s, without a cut."""
    trace, speed = Trace(), 0.0
    for number, wanted in enumerate(bench.free):
        trace.add(number + 1, np.linspace(speed, wanted, 500), 0.0, np.zeros(500))
        trace.add(number + 1, wanted, 0.0, seconds=8.0)
        speed = wanted
    return trace


def cutting_power(trace: Trace) -> np.ndarray:
    """K_tc Q + K_te w of slots, in closed form; teeth that rub without feed take nothing here."""
    D, n, v, a_p = 2e-3 * RADIUS, trace.column("speed") / 60, trace.column("feed") / 1e3, 1e-3
    a_p = a_p * trace.column("depth") * trace.column("engaged")
    edge = np.where(v > 0, TOOL.flutes * n * a_p * np.pi * D / 2, 0.0)
    power: np.ndarray = K_TC * D * a_p * v + K_TE * edge
    return power


def said(trace: Trace, bench: Bench) -> Said:
    """What an adapter writes: changes, as polls see them."""
    random = np.random.default_rng(bench.seed)
    rpm, cut = trace.column("speed"), cutting_power(trace)
    n = rpm / 60
    power = np.polynomial.polynomial.polyval(n, NO_LOAD) + cut
    power = power + 2e4 * np.maximum(np.gradient(n), 0.0)  # running up
    full = 12e3 * np.minimum(1.0, np.maximum(rpm, 10.0) / 3000)
    shown, share = 100 * np.where(rpm > 0, power, 0.0) / 0.9 / full, 1 - np.exp(-DT / bench.lag)
    load = lfilter([share], [1.0, share - 1.0], shown)
    polls = np.arange(bench.begin * bench.poll, len(load) * DT, bench.poll)
    polls = np.unique(np.clip(polls + 0.02 * random.standard_normal(len(polls)), 0, None).round(3))
    polls = polls[polls < len(load) * DT - DT]
    at = np.floor(polls / DT).astype(int)
    seen = load[at] + bench.noise * random.standard_normal(len(at))
    items = {
        "line": trace.column("line")[at], "speed": np.round(rpm[at]),
        "feed": np.round(trace.column("feed")[at], 2),
        "load": np.round(np.maximum(seen, 0) / bench.step) * bench.step,
    }  # fmt: skip
    told: Said = {"exec": [(float(polls[0]), "ACTIVE"), (float(polls[-1]), "READY")]}
    return told | {
        name: [
            (float(t), float(v))
            for t, v, new in zip(polls, values, np.append(True, np.diff(values) != 0), strict=True)
            if new
        ]
        for name, values in items.items()
    }


def write_bench(folder: Path, bench: Bench, **logs: Said) -> tuple[Path, Path]:
    """Folders ``signals`` and ``raw`` of the machine; ``logs`` are more or other logs."""
    signals, raw = folder / "signals", folder / "raw"
    text, trace = program_and_trace(bench)
    (raw / "cutting").mkdir(parents=True)
    (raw / PROGRAM).write_text(text)
    (signals / "observations").mkdir(parents=True)
    files = {}
    every = {"O1-run1": said(trace, bench), **logs}
    if bench.free:
        every = {"no-load-run1": said(free_trace(bench), bench), **every}
    for name, what in every.items():
        output = f"observations/{name}.parquet"
        write_log(what, signals / output)
        files[f"cutting/{name}.txt"] = {"output": output, "sha256": f"of {name}", "reason": None}
    (signals / "manifest.json").write_text(json.dumps({"files": files}))
    return signals, raw


def stock(bench: Bench) -> str:
    """The blank."""
    return f"box:0,{LENGTH},0,{2 * MARGIN + PITCH * (len(bench.slots) - 1)},-20,0"


def load_records(bench: Bench, **changes: Any) -> SpindleLoadRecords:
    """What a machine's file would say."""
    values: dict[str, Any] = {
        "items": LoadItems(line="line", speed="speed", load="load", feed="feed"),
        "drive": DRIVE,
        "no_load": (FREE_LOG,),
        "cuts": (LoadCut(log=CUT_LOG, program=PROGRAM, stock=stock(bench), tools={1: TOOL}),),
        "scale_error": 0.0,
        "settle_s": 1.2,
        **changes,
    }
    return SpindleLoadRecords(**values)
