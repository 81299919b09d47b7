"""LinuxCNC's own trajectory planner as an oracle, and the programs that it is asked about.

The planner of the Debian package linuxcnc-uspace runs without a display and without real time: a
script stands in for the display, motion commands go to a sampler, and the time of a program is the
number of servo cycles from its first to its last change of position.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import cos, sin, tau
from pathlib import Path

import numpy as np

MILLTASK = Path("/usr/bin/milltask")
CYCLE = 0.001
PAUSE = 100
"""Cycles without a change between two programs; within one there are fewer."""
NEAR = 1e-6
"""Greatest distance from zero at which a program begins [mm]."""
NOBODY = 65534
"""The real-time part refuses to run as root."""
HEAD = "G21 G90 G17 G94\n"


@dataclass(frozen=True)
class Machine:
    """Limits of X, Y and Z [mm/s], [mm/s^2], of the path [mm/s], whether arcs may blend, and the
    greatest feed override [1].
    """

    speed: tuple[float, float, float]
    acceleration: tuple[float, float, float]
    path_speed: float
    arcs: bool = True
    feed_scale: float = 1.0


UNLIKE = Machine((200, 100, 60), (1500, 1000, 500), 180)
"""A machine of unlike axes."""
PARABOLIC = Machine((120, 80, 40), (800, 1200, 400), 100, arcs=False)
"""One that blends by parabolas alone."""
OVERRIDDEN = Machine((150, 150, 150), (2000, 2000, 2000), 150, feed_scale=1.5)
"""One that makes its blends for an override of 150 %."""


def _circles(radius, feed):
    return f"{HEAD}G64\nG1 X{radius} F{feed}\n" + f"G2 I-{radius}\n" * 4 + "M2\n"


def _zigzag(width, height, many, feed, mode):
    corners = [f"G1 X{(i + 1) * width:g} Y{height * (1 - i % 2):g}\n" for i in range(many)]
    return f"{HEAD}{mode}\nF{feed}\n{''.join(corners)}M2\n"


def _spiral(mode):
    turned = [(i * tau / 60, 5 + i * 0.05) for i in range(1, 301)]
    points = [f"X{r * cos(t):.4f} Y{r * sin(t):.4f}\n" for t, r in turned]
    return f"{HEAD}{mode}\nG1 X5 F4000\n{''.join(points)}M2\n"


def _pocket():
    corner = "G1 X{0} Y0\nG3 X{1} Y3 I0 J3\nG1 Y8\nG2 X{2} Y10 I2 J0\nG1 X{3}\nX{3} Y0\n"
    parts = [corner.format(x + 10, x + 13, x + 15, x + 20) for x in range(0, 120, 20)]
    return f"{HEAD}G64 P0.05\nF5000\n{''.join(parts)}M2\n"


def _chains():
    parts = [
        f"G1 X{6 * i + 3} Y0\nG2 X{6 * i + 6} Y0 I1.5 J0\nG1 X{6 * i + 6} Y-2\nX{6 * i + 6.5}\n"
        for i in range(10)
    ]
    return f"{HEAD}G64\nF6000\n{''.join(parts)}M2\n"


def _slots():
    parts = [f"G0 X{10 * i} Y{6 * (i % 2)} Z2\nG1 Z-3\nG1 X{10 * i + 5}\nG0 Z2\n" for i in range(8)]
    return f"{HEAD}G64\nF4000\n{''.join(parts)}M2\n"


PROGRAMS = {
    "lines": HEAD + "G61\nG1 X40 F6000\nX41\nX41.2\nX80.2 F9000\nX80.7\nM2\n",
    "rapids": HEAD + "G64\nG0 X60 Y80\nZ20\nX0 Y0 Z0\nX30 Y10\nX31\nM2\n",
    "circle 0.5": _circles(0.5, 6000),
    "circle 1": _circles(1, 6000),
    "circle 5": _circles(5, 6000),
    "circle 20": _circles(20, 12000),
    "zigzag 90": _zigzag(2, 2, 24, 3000, "G64"),
    "zigzag sharp": _zigzag(1, 4, 20, 6000, "G64"),
    "zigzag flat": _zigzag(4, 0.5, 20, 6000, "G64"),
    "zigzag P0.01": _zigzag(3, 3, 20, 3000, "G64 P0.01"),
    "zigzag P0.1": _zigzag(3, 3, 20, 3000, "G64 P0.1"),
    "zigzag slow": _zigzag(5, 5, 10, 1200, "G64"),
    "zigzag G61": _zigzag(3, 3, 12, 3000, "G61"),
    "spiral": _spiral("G64"),
    "spiral P0.02": _spiral("G64 P0.02"),
    "helix": HEAD + "G64\nG1 X8 F5000\n" + "".join(f"G3 I-8 Z-{k}\n" for k in range(1, 6))
    + "G0 Z5\nM2\n",
    "pocket P0.05": _pocket(),
    "slots": _slots(),
    "lines and arcs": _chains(),
    "zigzag in space": HEAD + "G64\nF6000\n"
    + "".join(f"G1 X{5 * i + 5} Y{2 * (i % 3)} Z{3 * (i % 2)}\n" for i in range(10)) + "M2\n",
    "pecks": HEAD + "G64\nF600\nG0 Z5\n"
    + "".join(f"G83 X{15 * k} Y{5 * k} Z-6 R1 Q2\n" for k in range(4)) + "G80\nM2\n",
}  # fmt: skip
WITH_OVERRIDE = ("zigzag slow", "pocket P0.05", "lines and arcs")
BY_PARABOLAS = (
    "zigzag 90", "zigzag flat", "circle 5", "helix", "lines and arcs", "zigzag P0.1", "spiral",
    "pecks",
)  # fmt: skip


def programs_of(machine: Machine) -> dict[str, str]:
    """Programs that a machine is asked about."""
    names = {UNLIKE: tuple(PROGRAMS), PARABOLIC: BY_PARABOLAS, OVERRIDDEN: WITH_OVERRIDE}
    return {name: PROGRAMS[name] for name in names[machine]}


_DRIVER = """#!/usr/bin/python3
import subprocess, sys, time
from pathlib import Path
import linuxcnc

command, status = linuxcnc.command(), linuxcnc.stat()

def wait(ready):
    for _ in range(30000):
        status.poll()
        if ready():
            return
        time.sleep(0.01)

def idle():
    return status.interp_state == linuxcnc.INTERP_IDLE and status.inpos

def mode(wanted):
    command.mode(wanted)
    command.wait_complete()

for state in (linuxcnc.STATE_ESTOP_RESET, linuxcnc.STATE_ON):
    command.state(state)
    command.wait_complete()
mode(linuxcnc.MODE_MANUAL)
command.home(-1)
wait(lambda: all(status.homed[:3]))
recorder = subprocess.Popen(["halsampler", "-t", "record.txt"])
for program in sorted(Path().glob("*.ngc")):
    mode(linuxcnc.MODE_MDI)
    command.mdi("G53 G0 X0 Y0 Z0")
    command.wait_complete(60)
    wait(idle)
    mode(linuxcnc.MODE_AUTO)
    command.program_open(str(program.resolve()))
    command.wait_complete()
    time.sleep(0.2)
    command.auto(linuxcnc.AUTO_RUN, 0)
    command.wait_complete()
    time.sleep(0.1)
    wait(idle)
    time.sleep(0.2)
time.sleep(0.5)
recorder.terminate()
recorder.wait()
"""
_HAL = """loadrt [KINS]KINEMATICS
loadrt [EMCMOT]EMCMOT servo_period_nsec=[EMCMOT]SERVO_PERIOD num_joints=[KINS]JOINTS
loadrt sampler depth=60000 cfg=fff
addf motion-command-handler servo-thread
addf motion-controller servo-thread
addf sampler.0 servo-thread
net x joint.0.motor-pos-cmd => joint.0.motor-pos-fb sampler.0.pin.0
net y joint.1.motor-pos-cmd => joint.1.motor-pos-fb sampler.0.pin.1
net z joint.2.motor-pos-cmd => joint.2.motor-pos-fb sampler.0.pin.2
net stop iocontrol.0.user-enable-out iocontrol.0.emc-enable-in
net prepare iocontrol.0.tool-prepare iocontrol.0.tool-prepared
net change iocontrol.0.tool-change iocontrol.0.tool-changed
"""
_INI = """[EMC]
VERSION = 1.1
[DISPLAY]
DISPLAY = ./driver.py
[TASK]
TASK = milltask
CYCLE_TIME = 0.001
[RS274NGC]
PARAMETER_FILE = variables.var
[EMCMOT]
EMCMOT = motmod
COMM_TIMEOUT = 1.0
SERVO_PERIOD = 1000000
[EMCIO]
EMCIO = io
CYCLE_TIME = 0.1
TOOL_TABLE = tools.tbl
[HAL]
HALFILE = machine.hal
[KINS]
KINEMATICS = trivkins coordinates=XYZ
JOINTS = 3
[TRAJ]
COORDINATES = X Y Z
LINEAR_UNITS = mm
ANGULAR_UNITS = degree
NO_FORCE_HOMING = 1
"""


def _sections(machine: Machine) -> str:
    text = f"MAX_LINEAR_VELOCITY = {machine.path_speed}\nARC_BLEND_ENABLE = {int(machine.arcs)}\n"
    for joint, letter in enumerate("XYZ"):
        v, a = machine.speed[joint], machine.acceleration[joint]
        range_ = "MIN_LIMIT = -1000\nMAX_LIMIT = 1000\n"
        text += f"[AXIS_{letter}]\nMAX_VELOCITY = {v}\nMAX_ACCELERATION = {a}\n{range_}"
        text += (
            f"[JOINT_{joint}]\nTYPE = LINEAR\nHOME = 0\nHOME_SEARCH_VEL = 0\nHOME_SEQUENCE = 0\n"
            f"MAX_VELOCITY = {2 * v}\nMAX_ACCELERATION = {4 * a}\nFERROR = 50\n{range_}"
        )
    return text


@contextmanager
def _folder() -> Iterator[Path]:
    """A folder that nobody, as whom the planner runs for root, may enter."""
    folder = Path(tempfile.mkdtemp(prefix="planner", dir="/tmp"))
    try:
        yield folder
    finally:
        shutil.rmtree(folder)


def planned_times(machine: Machine, programs: Mapping[str, str]) -> dict[str, float]:
    """Time that LinuxCNC takes for programs that stand still only where they must [s]."""
    with _folder() as folder:
        files = {f"{number:03d}.ngc": text for number, text in enumerate(programs.values())}
        shown = f"[DISPLAY]\nMAX_FEED_OVERRIDE = {machine.feed_scale}"
        settings = _INI.replace("[DISPLAY]", shown) + _sections(machine)
        files |= {"machine.ini": settings, "machine.hal": _HAL}
        files |= {"driver.py": _DRIVER, "tools.tbl": "", "variables.var": "5220\t1\n"}
        for name, text in files.items():
            (folder / name).write_text(text)
        (folder / "driver.py").chmod(0o755)
        command = ["linuxcnc", "-r", "machine.ini"]
        if os.getuid() == 0:
            for path in (folder, *folder.iterdir()):
                os.chown(path, NOBODY, NOBODY)
            command = [
                "setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups", *command
            ]  # fmt: skip
        environment = {"HOME": str(folder), "PATH": "/usr/bin:/bin", "DISPLAY": ""}
        subprocess.run(command, cwd=folder, env=environment, capture_output=True, check=True)
        position = np.loadtxt(folder / "record.txt", usecols=(1, 2, 3))
    moved = np.flatnonzero((np.diff(position, axis=0) != 0).any(axis=1))
    begins = moved[np.diff(moved, prepend=-np.inf) > PAUSE]
    ends = moved[np.diff(moved, append=np.inf) > PAUSE]
    from_zero = np.abs(position[begins]).max(axis=1) < NEAR
    cycles = (ends - begins + 1)[from_zero]
    return {name: round(CYCLE * int(many), 3) for name, many in zip(programs, cycles, strict=True)}


if __name__ == "__main__":
    for asked in (UNLIKE, PARABOLIC, OVERRIDDEN):
        json.dump(planned_times(asked, programs_of(asked)), sys.stdout, indent=1)
