"""Random programs in LinuxCNC's dialect that use what moves: made to be followed twice."""

import re

import numpy as np

GROUPS = (
    ("G<0|1> <axes>",), ("G<0|1> <axes>",), ("G<0|1> <axes>",), ("G90 G53 G<0|1> <axes>",),
    ("G17 G90 G1 @<1..20> ^<-180..180>",),
    ("G17 G91 G<2|3> X<-5..5> Y<1..5> Z<-1..1> R<6..20>\nG90",
     "G17 G91 G<2|3> X<-5..5> Y<1..5> Z<-1..1> R<-20..-6>\nG90"),
    *[("G10 L2 P<0|1|2|3|4|5|6|7|8|9> <axes>", "G10 L20 P<0|1|2|3|4|5|6|7|8|9> <axes>",
       "G<54|55|56|57|58|59|59.1|59.2|59.3>", "G54")] * 2,
    # no tool change: rs274 asks where it stands after one, and forgets the tool length
    ("G43 H<1|2|3>", "G43.1 Z<-5..5> X<-1..1>", "G43.2 H<1|2|3>", "G49",
     "G10 L1 P<1|2|3> Z<-5..5>", "G10 L1 P<1|2|3> X<-5..5> Y<-5..5>", "G10 L10 P<1|2|3> Z<-5..5>",
     "G10 L10 P<1|2|3> X<-5..5>"),
    ("G<28|30>", "G<28|30> <axes>", "G<28|30>.1", "G91 G<28|30> Z1\nG90"),
    # units change without a tool length, which rs274 2.9~pre1 does not convert
    *[("G49\nG20", "G49\nG21", "G90", "G91", "G64 P0.01", "G61", "G4 P0.25", "F300", "G40")] * 2,
    ("M3 S100\nG33 Z<-9..9> K1.5\nG33.1 Z<-9..9> K1",),
    ("<arc>",), ("<cycle>",),
)  # fmt: skip
"""Groups of lines, one of each group: ``<a..b>`` is a number, ``<a|b>`` one of the words."""
ROTATION = ("G10 L2 P<1|2|3> X<-5..5> R<-90..90>",)
SHIFT = ("G92 <axes>", "G52 <axes>", "G92.1", "G92.2", "G92.3")


def filled(rng: np.random.Generator, text: str) -> str:
    """A template with its gaps drawn."""

    def drawn(gap: re.Match[str]) -> str:
        if gap[1] in MADE:
            return filled(rng, MADE[gap[1]](rng))
        if ".." in gap[1]:
            low, high = map(float, gap[1].split(".."))
            return f"{rng.uniform(low, high):.4f}"
        return str(rng.choice(gap[1].split("|")))

    return re.sub(r"<([^>]+)>", drawn, text)


def _axes(rng: np.random.Generator) -> str:
    chosen = [letter for letter in "XYZ" if rng.random() < 0.6] or ["X"]
    chosen += ["<A|B|C>"] * (rng.random() < 0.1)
    return " ".join(f"{letter}<-20..20>" for letter in chosen)


def _arc(rng: np.random.Generator) -> str:
    """Start and end on one circle: from (10, 0) about the origin, in a plane that is chosen."""
    planes = [(17, *"XYZIJ"), (18, *"ZXYKI"), (19, *"YZXJK")]
    plane, first, second, normal, i, j = planes[rng.integers(0, 3)]
    angle = rng.uniform(-np.pi, np.pi)
    end = f"{first}{10 * np.cos(angle):.9f} {second}{10 * np.sin(angle):.9f}"
    pitch = f" {normal}<-5..5>" if rng.random() < 0.5 else ""
    turns = " P<1|2|3>" if rng.random() < 0.3 else ""
    centre = f"{i}-10" if rng.random() < 0.7 else f"{i}-10 {j}0"
    head, kind = f"G{plane} G90 G1 {first}10 {second}0", rng.random()
    if kind < 0.3:
        return f"{head}\nG90.1 G<2|3> {end}{pitch} {i}0 {j}0{turns}\nG91.1 G17"
    if kind < 0.44:
        return f"{head}\nG<2|3> {centre}{pitch}{turns}\nG17"
    return f"{head}\nG<2|3> {end}{pitch} {centre}{turns}\nG17"


def _cycle(rng: np.random.Generator) -> str:
    """A series of holes, above and below where the tool stands."""
    code = rng.choice([73, 81, 82, 83, 85, 86, 89])
    plane = str(rng.choice(["G17", "G17", "G18", "G19"]))
    u, v, w = {"G17": "XYZ", "G18": "ZXY", "G19": "YZX"}[plane]
    repeat = " L<1|2|3>" if rng.random() < 0.3 else ""
    extra = " Q<0.3..3>" if code in (73, 83) else " P0.1" if code in (82, 86, 89) else ""
    distance, most = ("G91", 1) if rng.random() < 0.4 else ("G90", 5)
    reference = f"{rng.uniform(-2, most):.4f}"
    lines = [
        f"{plane} G<98|99> {distance} M3 S100",
        f"G{code} {u}<-9..9> {v}<-9..9> {w}<-9..-3> R{reference}{extra}{repeat}",
        *[f"{u}<-9..9>"] * int(rng.integers(0, 3)),
    ]
    if rng.random() < 0.3:
        lines.append(f"G<98|99> {v}<-9..9> R{reference}")
    return "\n".join([*lines, "G80 G90 G17"])


MADE = {"axes": _axes, "arc": _arc, "cycle": _cycle}


def random_program(seed: int, blocks: int) -> str:
    """Text of a program of ``blocks`` groups of lines.

    It rotates or shifts (G92, G52), not both: rs274 2.9~pre1 loses its position where a rotation
    changes under a shift.
    """
    rng = np.random.default_rng(seed)
    groups = (*GROUPS, (ROTATION, SHIFT)[rng.integers(2)])
    lines = ["G21 G90 G17 G40 G49 G94 F100 T<1|2|3> M6"]
    lines += [str(rng.choice(groups[rng.integers(len(groups))])) for _ in range(blocks)]
    return filled(rng, "\n".join([*lines, "M2", ""]))
