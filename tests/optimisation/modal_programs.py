"""Random programs full of what F and S can go wrong with: modal words, loops, cycles, subprograms.

And random answers of an optimiser for them: any feeds of blocks, any stretches of S.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pipeline.gcode.moves import Moves
from pipeline.optimisation.problem.arrays import Editable


def modal_program(rng: np.random.Generator) -> bytes:
    """A Fanuc program that can be followed, of some 20 lines and a subprogram."""
    inch = bool(rng.random() < 0.3)
    lines = [f"G{20 if inch else 21} G90 G17", "T1 M6", "S3000 M3", "G0 X0 Y0 Z5", "G1 Z0 F100."]
    for _ in range(int(rng.integers(4, 14))):
        lines += _PARTS[int(rng.integers(len(_PARTS)))](rng)
    lines += ["G94 G1 X1 F90.", "M5", "M30", "O100"]
    for _ in range(int(rng.integers(1, 5))):
        lines += _PLAIN[int(rng.integers(len(_PLAIN)))](rng)
    lines += ["M99"]
    return _set(lines, rng)


def _set(lines: list[str], rng: np.random.Generator) -> bytes:
    """As one of the posts writes it: numbered or not, with blanks or not, either line end."""
    blanks, numbered = rng.random() < 0.5, rng.random() < 0.5
    end = "\r\n" if rng.random() < 0.5 else "\n"
    text = []
    for number, line in enumerate(lines, 1):
        macro = any(sign in line for sign in "#[(")
        written = line if blanks or macro else line.replace(" ", "")
        named = numbered and line[0] not in "ON/"
        text.append(f"N{number * 10}{' ' * bool(blanks)}{written}" if named else written)
    closing = "%" if rng.random() < 0.5 else ""
    return end.join(["%", "O1", *text, closing]).encode("ascii")


def _x(rng: np.random.Generator) -> str:
    return f"{rng.uniform(-50, 50):.3f}"


def _f(rng: np.random.Generator) -> str:
    """An F word, mostly; not every one with a point."""
    if rng.random() < 0.5:
        return ""
    return f" F{rng.integers(50, 900)}{'.' if rng.random() < 0.5 else ''}"


def _s(rng: np.random.Generator) -> str:
    return f" S{rng.integers(500, 9000)}" if rng.random() < 0.15 else ""


def _drill(rng):
    lines = [f"G98 G83 X{_x(rng)} Y0 Z-9 R1 Q3{_f(rng)}", f"X{_x(rng)}{_f(rng)}", f"Y{_x(rng)}"]
    return [*lines, "G80 G1"]


def _tap(rng):
    rigid = ["M29 S400"] if rng.random() < 0.5 else []
    given = f" F{rng.integers(200, 500)}" if rng.random() < 0.7 else ""
    return [*rigid, f"G84 X{_x(rng)} Y0 Z-9 R1{given}", f"X{_x(rng)}", "G80 G1"]


def _loop(rng):
    step = [f"X#1{_f(rng)}", *_PLAIN[0](rng), "#1=#1+1"]
    return ["#1=0", "WHILE[#1LT3]DO1", "G1", *step, *(["F333"] * (rng.random() < 0.3)), "END1"]


def _jump(rng):
    number = int(rng.integers(1_000_000, 9_999_999))
    return [f"IF[1EQ{rng.integers(2)}]GOTO{number}", f"F{rng.integers(50, 900)}", f"N{number} X4"]


Part = Callable[[np.random.Generator], list[str]]
"""Lines of a program, by chance."""
_PLAIN: tuple[Part, ...] = (
    lambda rng: [f"G1 X{_x(rng)} Y{_x(rng)}{_f(rng)}{_s(rng)}"],
    lambda rng: [f"X{_x(rng)}{_f(rng)}", f"Y{_x(rng)}"],
    lambda rng: [f"G0 X{_x(rng)} Z5{_f(rng)}{_s(rng)}", f"G1 Z-1{_f(rng)}"],
    lambda rng: [f"F{rng.integers(50, 900)}"],
    lambda rng: [f"G2 I{rng.uniform(1, 9):.3f}{_f(rng)}", f"G1 X{_x(rng)}"],
    lambda rng: [f"G91 G1 X0{_f(rng)}{_s(rng)}", "G90"],
    lambda rng: [f"G1 X{_x(rng)}{_f(rng)} (F1 S1 G4)", "(G1 X5 F7)"],
    _drill,
)
_STRAIGHT: tuple[Part, ...] = (
    *_PLAIN,
    _tap,
    lambda rng: [f"G33 Z{_x(rng)}{' F2.5' if rng.random() < 0.7 else ''}", "G1 X0"],
    lambda rng: [
        f"G95 G1 X{_x(rng)} F0.{rng.integers(1, 9)}",
        f"Y{_x(rng)}",
        f"G94 X0 F{200}",
        "X1",
    ],
    lambda rng: [
        f"G93 G1 X{_x(rng)} F{rng.integers(1, 9)}",
        "X0 F2",
        f"G94 X1 F{rng.integers(9, 999)}",
    ],
    lambda rng: [*(["S2500"] if rng.random() < 0.5 else []), "M5", "G4 P500", "M3", "G1 X2"],
    lambda rng: ["G96 S120", f"G1 X{_x(rng)}{_f(rng)}", f"G97 S{rng.integers(500, 5000)}"],
    lambda rng: ["#2=123.4567891", "G1 X5 F#2", f"X{_x(rng)}", f"Y{_x(rng)}"],
)
_PARTS: tuple[Part, ...] = (
    *_STRAIGHT,
    *_PLAIN,
    _loop,
    lambda rng: [f"M98 P100 L{rng.integers(1, 4)}", f"G1 X{_x(rng)}{_f(rng)}"],
    _jump,
    lambda rng: [f"/G1 X{_x(rng)} F77", "Y3"],
)


def any_answer(
    editable: Editable, moves: Moves, rng: np.random.Generator, *, own: float = 0.3
) -> tuple[np.ndarray, np.ndarray]:
    """F and S of each row: what an optimiser may ask for.

    ``own`` is the share of blocks that keep what they have.
    """
    feeds, speeds = moves.feed.copy(), moves.speed.copy()
    chosen = editable.block >= 0
    if chosen.any():
        values = np.zeros(len(editable.line))
        values[editable.block[chosen]] = feeds[chosen]
        new = np.exp(rng.uniform(np.log(0.02), np.log(5000), len(values)))
        values = np.where(rng.random(len(values)) < own, values, new)
        feeds[chosen] = values[editable.block[chosen]]
    speed = None
    for row in range(len(moves)):
        turning = moves.direction[row] != 0 and moves.speed[row] > 0
        if turning and not editable.speed[row]:
            speed = None
        elif editable.speed[row]:
            if editable.may_start[row] and (speed is None or rng.random() < 0.2):
                speed = float(rng.uniform(500, 9000))
            assert speed is not None, "a stretch begins where no S word may stand"
            speeds[row] = speed
    return feeds, speeds


def seeds(few: int, many: int) -> list[Any]:
    """Seeds of a parametrised test: ``few`` in the ordinary suite, the rest as proof."""
    return [*range(few), *(pytest.param(k, marks=pytest.mark.proof) for k in range(few, many))]
