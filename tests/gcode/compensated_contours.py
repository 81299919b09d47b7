"""Contours for the tests of cutter radius compensation."""

import cmath
import math
from dataclasses import dataclass

import numpy as np

from pipeline.gcode.cutter_compensation import Element

SCALE = 1000.0
"""Contours of metres: tolerances of interpreters are small beside them."""


@dataclass(frozen=True, kw_only=True)
class Contour:
    """Elements, and the blocks that a program in ``plane`` has for them."""

    elements: list[Element]
    blocks: list[str]
    plane: int


def random_contour(rng, plane=17):
    """A contour of anything: lines, arcs, circles, helices, plunges, any corner between."""
    drawing = _Drawing(rng, plane)
    for row in range(rng.integers(1, 7)):
        drawing.add(row)
    return Contour(elements=drawing.elements, blocks=drawing.blocks, plane=plane)


class _Drawing:
    def __init__(self, rng, plane):
        self.rng, self.letters = rng, "XYZIJ" if plane == 17 else "ZXYKI"
        self.at, self.height, self.heading = 0j, 0.0, rng.uniform(-math.pi, math.pi)
        self.elements, self.blocks = [], []

    def add(self, row):
        rng = self.rng
        if row:
            self.heading += self._turn()
        level = rng.random() < 0.3
        if level:
            self.height = round(rng.uniform(-5, 5), 4)
        plunge = f" {self.letters[2]}{self.height:.4f}" if level else ""
        kind = rng.choice(["line", "arc", "circle", "plunge"], p=[0.5, 0.3, 0.1, 0.1])
        if kind == "plunge" and row and level:
            self._append("G1" + plunge, self.at, row)
        elif kind in ("arc", "circle"):
            self._arc(row, plunge, full=kind == "circle" and row > 0)
        else:
            self._line(row, plunge)

    def _turn(self):
        rng = self.rng
        small, usual, any_ = rng.uniform(-0.08, 0.08), rng.normal(0, 0.6), rng.uniform(-3, 3)
        return rng.choice([0, small, usual, any_, math.pi / 2, -math.pi / 2])

    def _append(self, block, end, row, **more):
        self.blocks.append(block)
        self.elements.append(Element(start=self.at, end=end, normal=self.height, row=row, **more))
        self.at = end

    def _words(self, end):
        return f" {self.letters[0]}{end.real:.9f} {self.letters[1]}{end.imag:.9f}"

    def _line(self, row, plunge):
        end = _rounded(self.at + cmath.rect(self.rng.uniform(1, 20) * SCALE, self.heading))
        rapid = bool(self.rng.random() < 0.1)
        self._append(f"G{0 if rapid else 1}" + self._words(end) + plunge, end, row, rapid=rapid)

    def _arc(self, row, plunge, full):
        sense = int(self.rng.choice([1, -1]))
        radius, angle = self.rng.uniform(1, 15) * SCALE, self.rng.uniform(0.2, 6)
        to_centre = _rounded(cmath.rect(radius, self.heading) * 1j * sense)
        centre, turns = self.at + to_centre, 1
        end = self.at
        if full:
            angle, turns = math.tau, int(self.rng.choice([1, 2]))
        else:
            end = _rounded(centre - to_centre * cmath.exp(1j * sense * angle))
            self.heading += sense * angle
        words = "" if full else self._words(end)
        centre_words = f" {self.letters[3]}{to_centre.real:.9f} {self.letters[4]}"
        count = f" P{turns}" if turns > 1 else ""
        self._append(
            f"G{3 if sense > 0 else 2}{words}{centre_words}{to_centre.imag:.9f}{count}{plunge}",
            end, row, centre=centre, angle=sense * (angle + math.tau * (turns - 1)),
        )  # fmt: skip


def _rounded(point):
    return complex(round(point.real, 9), round(point.imag, 9))


def points(element, count=41):
    """Points along an element."""
    s = np.linspace(0, 1, count)
    if element.centre is None:
        return element.start + s * (element.end - element.start)
    return element.centre + (element.start - element.centre) * np.exp(1j * s * element.angle)


def distance(point, element):
    """From points to an element, in closed form."""
    if element.centre is None:
        along = element.end - element.start
        s = np.clip(((point - element.start) * along.conjugate()).real / abs(along) ** 2, 0, 1)
        return np.abs(point - element.start - s * along)
    radius = abs(element.start - element.centre)
    sense = math.copysign(1, element.angle)
    ratio = (point - element.centre) / (element.start - element.centre)
    swept = (sense * np.angle(ratio)) % math.tau
    ends = np.minimum(np.abs(point - element.start), np.abs(point - element.end))
    on_arc = np.abs(np.abs(point - element.centre) - radius)
    return np.where(swept <= abs(element.angle), on_arc, ends)


def signed_offset(point, element):
    """How far points lie to the left of an element's line or circle."""
    if element.centre is None:
        along = element.end - element.start
        return ((point - element.start) * along.conjugate()).imag / abs(along)
    radius = abs(element.start - element.centre)
    return math.copysign(1, element.angle) * (radius - np.abs(point - element.centre))
