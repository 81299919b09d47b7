"""Random programs in LinuxCNC's dialect that use what moves: made to be followed twice."""

import numpy as np


def _number(rng: np.random.Generator, low: float, high: float) -> str:
    return f"{rng.uniform(low, high):.4f}"


def _axes(rng: np.random.Generator, letters: str = "XYZ") -> str:
    chosen = [letter for letter in letters if rng.random() < 0.6] or [letters[0]]
    if rng.random() < 0.1:
        chosen.append(str(rng.choice(["A", "B", "C"])))
    return " ".join(f"{letter}{_number(rng, -20, 20)}" for letter in chosen)


def _line(rng):
    return f"G{rng.integers(0, 2)} {_axes(rng)}"


def _machine(rng):
    return f"G90 G53 G{rng.integers(0, 2)} {_axes(rng)}"


def _polar(rng):
    return f"G17 G90 G1 @{_number(rng, 1, 20)} ^{_number(rng, -180, 180)}"


def _arc_by_centre(rng):
    """Start and end on one circle: from (10, 0) about the origin, in a plane that is chosen."""
    plane, first, second, normal, i, j = [
        (17, "X", "Y", "Z", "I", "J"),
        (18, "Z", "X", "Y", "K", "I"),
        (19, "Y", "Z", "X", "J", "K"),
    ][rng.integers(0, 3)]
    angle = rng.uniform(-np.pi, np.pi)
    u, v = 10 * np.cos(angle), 10 * np.sin(angle)
    pitch = f" {normal}{_number(rng, -5, 5)}" if rng.random() < 0.5 else ""
    turns = f" P{rng.integers(1, 4)}" if rng.random() < 0.3 else ""
    centre = f"{i}-10" if rng.random() < 0.7 else f"{i}-10 {j}0"
    head = f"G{plane} G90 G1 {first}10 {second}0"
    if rng.random() < 0.3:
        end = f"{first}{u:.9f} {second}{v:.9f}{pitch} {i}0 {j}0{turns}"
        return f"{head}\nG90.1 G{rng.integers(2, 4)} {end}\nG91.1 G17"
    if rng.random() < 0.2:
        return f"{head}\nG{rng.integers(2, 4)} {centre}{pitch}{turns}\nG17"
    end = f"{first}{u:.9f} {second}{v:.9f}{pitch} {centre}{turns}"
    return f"{head}\nG{rng.integers(2, 4)} {end}\nG17"


def _arc_by_radius(rng):
    radius = rng.uniform(6, 20) * rng.choice([-1, 1])
    return (
        f"G17 G91 G{rng.integers(2, 4)} X{_number(rng, -5, 5)} Y{_number(rng, 1, 5)} "
        f"Z{_number(rng, -1, 1)} R{radius:.4f}\nG90"
    )


def _offset(rng):
    return str(
        rng.choice(
            [
                f"G10 L2 P{rng.integers(0, 10)} {_axes(rng)}",
                f"G10 L20 P{rng.integers(0, 10)} {_axes(rng)}",
                f"G{rng.choice([54, 55, 56, 57, 58, 59, 59.1, 59.2, 59.3]):g}",
                "G54",
            ]
        )
    )


def _rotation(rng):
    return f"G10 L2 P{rng.integers(1, 4)} X{_number(rng, -5, 5)} R{_number(rng, -90, 90)}"


def _shift(rng):
    return str(rng.choice([f"G92 {_axes(rng)}", f"G52 {_axes(rng)}", "G92.1", "G92.2", "G92.3"]))


def _length(rng):
    """No tool change: rs274 asks where it stands after one, and forgets the tool length."""
    return str(
        rng.choice(
            [
                f"G43 H{rng.integers(1, 4)}",
                f"G43.1 Z{_number(rng, -5, 5)} X{_number(rng, -1, 1)}",
                f"G43.2 H{rng.integers(1, 4)}",
                "G49",
                f"G10 L1 P{rng.integers(1, 4)} Z{_number(rng, -5, 5)}",
                f"G10 L1 P{rng.integers(1, 4)} X{_number(rng, -5, 5)} Y{_number(rng, -5, 5)}",
                f"G10 L10 P{rng.integers(1, 4)} Z{_number(rng, -5, 5)}",
                f"G10 L10 P{rng.integers(1, 4)} X{_number(rng, -5, 5)}",
            ]
        )
    )


def _cycle(rng):
    """A series of holes, above and below where the tool stands."""
    code = rng.choice([73, 81, 82, 83, 85, 86, 89])
    plane = rng.choice(["G17", "G17", "G18", "G19"])
    u, v, w = {"G17": "XYZ", "G18": "ZXY", "G19": "YZX"}[str(plane)]
    repeat = f" L{rng.integers(1, 4)}" if rng.random() < 0.3 else ""
    extra = f" Q{_number(rng, 0.3, 3)}" if code in (73, 83) else ""
    extra += " P0.1" if code in (82, 86, 89) else ""
    distance, reference, depth = "G90", _number(rng, -2, 5), _number(rng, -9, -3)
    if rng.random() < 0.4:
        distance, reference, depth = "G91", _number(rng, -2, 1), _number(rng, -9, -3)
    lines = [
        f"{plane} G{rng.choice([98, 99])} {distance} M3 S100",
        f"G{code} {u}{_number(rng, -9, 9)} {v}{_number(rng, -9, 9)} {w}{depth} R{reference}"
        f"{extra}{repeat}",
    ]
    lines += [f"{u}{_number(rng, -9, 9)}" for _ in range(rng.integers(0, 3))]
    if rng.random() < 0.3:
        lines.append(f"G{rng.choice([98, 99])} {v}{_number(rng, -9, 9)} R{reference}")
    return "\n".join([*lines, "G80 G90 G17"])


def _reference(rng):
    code = rng.choice([28, 30])
    return str(
        rng.choice([f"G{code}", f"G{code} {_axes(rng)}", f"G{code}.1", f"G91 G{code} Z1\nG90"])
    )


def _mode(rng):
    """Units change without a tool length, which rs274 2.9~pre1 does not convert."""
    return str(
        rng.choice(
            ["G49\nG20", "G49\nG21", "G90", "G91", "G64 P0.01", "G61", "G4 P0.25", "F300", "G40"]
        )
    )


def _thread(rng):
    return f"M3 S100\nG33 Z{_number(rng, -9, 9)} K1.5\nG33.1 Z{_number(rng, -9, 9)} K1"


CHOICES = (
    _line, _line, _line, _machine, _polar, _arc_by_centre, _arc_by_radius, _offset, _offset,
    _length, _cycle, _reference, _mode, _mode, _thread,
)  # fmt: skip


def random_program(seed: int, blocks: int) -> str:
    """Text of a program of ``blocks`` groups of lines.

    It rotates or shifts (G92, G52), not both: rs274 2.9~pre1 loses its position where a rotation
    changes under a shift.
    """
    rng = np.random.default_rng(seed)
    choices = (*CHOICES, rng.choice([_rotation, _shift]))
    lines = [f"G21 G90 G17 G40 G49 G94 F100 T{rng.integers(1, 4)} M6"]
    lines += [str(choices[rng.integers(len(choices))](rng)) for _ in range(blocks)]
    return "\n".join([*lines, "M2", ""])
