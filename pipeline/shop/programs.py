"""Part programs as sequences of operations: the cuts of a small job shop.

Speeds, feeds and powers are those of catalogue cutting data (Sandvik, Walter) for aluminium and
quenched steel on a 15 kW spindle; 1/15 of the rated power is 1 kW.
"""

from dataclasses import dataclass
from typing import Literal

Motion = Literal["mill", "drill", "finish", "contour", "run"]


@dataclass(frozen=True, kw_only=True)
class Operation:
    """One tool's work: ``power`` is a share of the rated power, ``feed`` in mm/s.

    ``motion`` says how axes move; in ``contour`` the spindle is a C axis under position control and
    does not turn; ``run`` turns the spindle only (warm-up).
    """

    tool: int
    motion: Motion
    speed: float
    duration: int
    power: float = 0.0
    feed: float = 0.0
    length: float = 150.0
    coolant: bool = True


@dataclass(frozen=True, kw_only=True)
class Program:
    """``held`` leaves the spindle in position control after the end, as programs often do."""

    name: str
    operations: tuple[Operation, ...]
    held: bool = False


def _op(
    tool: int, motion: Motion, speed: float, duration: int, power: float, feed: float, length: float
) -> Operation:
    return Operation(
        tool=tool, motion=motion, speed=speed, duration=duration, power=power, feed=feed,
        length=length,
    )  # fmt: skip


WARM_UP = Program(
    name="O9001",
    operations=tuple(
        Operation(tool=0, motion="run", speed=s, duration=d, coolant=False)
        for s, d in ((1500.0, 180), (3000.0, 180), (6000.0, 240), (9000.0, 240), (12000.0, 180))
    ),
)

PROGRAMS: dict[str, Program] = {
    p.name: p
    for p in (
        Program(  # aluminium housing
            name="O1101",
            operations=(
                _op(1, "mill", 6000, 110, 0.42, 50.0, 320),
                _op(3, "mill", 12000, 240, 0.30, 66.0, 240),
                _op(5, "drill", 8000, 120, 0.18, 20.0, 38),
                _op(8, "drill", 900, 80, 0.06, 15.0, 22),
                _op(11, "finish", 12000, 300, 0.05, 40.0, 210),
            ),
        ),
        Program(  # steel bracket
            name="O2040",
            operations=(
                _op(2, "mill", 1250, 260, 0.40, 8.0, 180),
                _op(4, "mill", 2400, 520, 0.40, 14.0, 220),
                _op(6, "drill", 3100, 180, 0.17, 6.0, 45),
                _op(7, "mill", 4200, 200, 0.22, 16.0, 120),
                _op(9, "finish", 7500, 320, 0.06, 20.0, 160),
            ),
        ),
        Program(  # mould insert, finished with a ball nose
            name="O3307",
            operations=(
                _op(4, "mill", 3000, 420, 0.33, 18.0, 160),
                _op(12, "finish", 9000, 780, 0.08, 45.0, 90),
                _op(14, "finish", 11500, 1500, 0.04, 55.0, 70),
            ),
        ),
        Program(  # shaft: turned and engraved with the spindle as C axis
            name="O4410",
            operations=(
                _op(21, "contour", 0, 380, 0.0, 4.0, 90),
                _op(6, "drill", 4000, 140, 0.15, 9.0, 30),
                _op(22, "contour", 0, 460, 0.0, 2.5, 60),
                _op(7, "mill", 5200, 160, 0.18, 20.0, 80),
            ),
            held=True,
        ),
    )
}


def programs(names: tuple[str, ...], c_axis: bool) -> list[Program]:
    """The programs called ``names``; those that need a C axis only if there is one.

    Raises
    ------
    ValueError
        When a name is unknown or nothing is left; the message lists the known names.
    """
    unknown = [n for n in names if n not in PROGRAMS]
    if unknown:
        raise ValueError(f"part program {unknown[0]!r} is unknown; known are {sorted(PROGRAMS)}")
    chosen = [PROGRAMS[n] for n in names]
    if not c_axis:
        chosen = [p for p in chosen if all(o.motion != "contour" for o in p.operations)]
    if not chosen:
        raise ValueError(f"none of the programs {list(names)} can run without a C axis")
    return chosen
