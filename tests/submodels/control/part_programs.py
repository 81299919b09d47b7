"""Part programs for the tests of the control's identification, and controls to run them."""

from pathlib import Path

import numpy as np

from pipeline.gcode.moves import Moves
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import (
    AuxiliaryParameters,
    AxisParameters,
    ControlParameters,
)
from pipeline.twin.control import program_moves

SETUP = Setup(initial_position=(0.0, 0.0, 200.0, 0.0, 0.0, 0.0))


def moves_of(lines: list[str], folder: Path, name: str = "part") -> Moves:
    """Moves of a program of these lines."""
    path = folder / f"{name}.nc"
    path.write_text("\n".join(lines) + "\n")
    return program_moves(path, SETUP)


def change(tool: int, speed: float) -> list[str]:
    """Tool and spindle."""
    return ["M5", "M9", "G0 Z150", f"T{tool} M6", f"S{speed:g} M3", "M8", "M1"]


def rapids(lengths: tuple[float, ...]) -> list[str]:
    """Along each axis alone, there and back."""
    return [
        line
        for length in lengths
        for axis, home in (("X", 0.0), ("Y", 0.0), ("Z", 100.0))
        for line in (f"G0 {axis}{home + length:g}", f"G0 {axis}{home:g}")
    ]


def zigzag(feed: float, step: float, degrees: float, count: int) -> list[str]:
    """Cuts that turn by so much at each corner, left and right."""
    half = np.radians(degrees) / 2
    lines = ["G0 X0 Y0", f"G1 Z50 F{feed:g}"]
    for k in range(1, count + 1):
        y = step * np.sin(half) * (k % 2)
        lines.append(f"G1 X{k * step * np.cos(half):.3f} Y{y:.3f}")
    return lines


def circles(radius: float, feeds: tuple[float, ...]) -> list[str]:
    """Full circles about one point."""
    return ["G0 X0 Y0", *(f"G2 X0 Y0 I{radius:g} F{feed:g}" for feed in feeds)]


def long_cuts(feeds: tuple[float, ...], length: float = 120.0) -> list[str]:
    """Straight cuts on which every feed is reached."""
    return [
        line
        for k, feed in enumerate(feeds)
        for line in (f"G1 X{length if k % 2 == 0 else 0:g} F{feed:g}", f"G1 Y{10 * k + 10:g}")
    ]


def exciting(speeds: tuple[float, ...] = (1500, 6000, 9000, 3000, 11000, 7500)) -> list[str]:
    """All that determines a control: rapids, corners, circles, tools and spindle speeds."""
    work = [
        [*rapids((20, 400, 5, 250)), *circles(2, (600, 2400, 4800))],
        [*zigzag(6000, 4, 90, 60), *rapids((60, 250, 8, 140))],
        [*circles(10, (3000, 6000)), *zigzag(4000, 8, 40, 40), *long_cuts((800, 1500))],
        [*rapids((10, 120, 500, 5, 40)), *zigzag(9000, 12, 90, 15)],
        [*circles(5, (1500, 4500, 9000)), *long_cuts((2500, 5000))],
        [*zigzag(8000, 2, 20, 150), *rapids((35, 180, 350, 90))],
    ]
    body = [
        line
        for tool, (speed, cuts) in enumerate(zip(speeds, work, strict=True), start=1)
        for line in (*change(tool, speed), *cuts)
    ]
    return ["%", "G21 G90 G94", *body, "M5", "M9", "M30", "%"]


def axis(**limits: float) -> AxisParameters:
    """Like the other axes but for ``limits``."""
    usual = {
        "rapid_speed": 24000.0, "cutting_speed": 15000.0, "rapid_acceleration": 2500.0,
        "cutting_acceleration": 700.0, "arc_acceleration": 400.0, "corner_jump": 240.0,
    }  # fmt: skip
    return AxisParameters(**(usual | limits))


def truth() -> ControlParameters:
    """The control that ran the programs."""
    return ControlParameters(
        axes={
            "X": axis(), "Y": axis(rapid_speed=20000.0),
            "Z": axis(rapid_speed=15000.0, rapid_acceleration=1600.0),
        },
        settle_time=0.08,
        auxiliary=AuxiliaryParameters(
            tool_change=4.6, m_code=0.35, stop=0.6, spindle_acceleration=4000.0,
            spindle_deceleration=3000.0, spindle_base_speed=4500.0,
        ),
    )  # fmt: skip


def start() -> ControlParameters:
    """What a person who knows the machine's brochure would write."""
    guess = axis(
        rapid_speed=30000.0, rapid_acceleration=4000.0, cutting_acceleration=1200.0,
        arc_acceleration=800.0, corner_jump=500.0,
    )  # fmt: skip
    return ControlParameters(
        axes={"X": guess, "Y": guess, "Z": guess},
        auxiliary=AuxiliaryParameters(
            tool_change=6.0, stop=0.1, spindle_acceleration=2500.0, spindle_deceleration=2500.0,
            spindle_base_speed=3000.0,
        ),
    )  # fmt: skip
