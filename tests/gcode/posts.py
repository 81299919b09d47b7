"""Programs as the posts of a Fanuc, a Haas and a Siemens write them, with their moves.

Each job writes its text and follows itself: it knows where the tool is in the program's coordinates
and maps that to the machine by a matrix of its own, so that no line of the interpreter is used.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

INCH = 25.4
PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
PLANE_CHOICES = [17, 17, 18, 19]
ARC_POINTS = 2001
GAP = 0.254
"""What G83 and G73 keep to the depth reached [mm], as set."""
STYLES = ("fanuc", "haas", "siemens")
REFERENCE = (0.0, 0.0, 300.0)
WORK = {"G54": (100.0, -50.0, 20.0), "G55": (-30.0, 12.5, 5.0), "G56": (7.0, 8.0, -9.0),
        "G57": (1.0, -2.0, 3.0)}  # fmt: skip
EXTENDED = {"G54.1 P2": (11.0, 22.0, 33.0), "G54.1 P17": (-4.0, 5.0, -6.0)}
LENGTHS = {1: 80.0, 2: 61.25, 3: 120.5}
DIAMETERS = {1: 10.0, 2: 6.0, 3: 1.5}


@dataclass(frozen=True)
class Segment:
    """A move as the job makes it: rapid or not, end and middle in the machine, length, feed."""

    rapid: bool
    end: np.ndarray
    middle: np.ndarray
    length: float
    feed: float


class Job:
    """One program of a style, and what it moves."""

    def __init__(self, seed: int, style: str) -> None:
        self.rng, self.style = np.random.default_rng([seed, STYLES.index(style)]), style
        self.fanuc = style in ("fanuc", "haas")
        self.inch = bool(self.rng.random() < 0.3)
        self.unit = INCH if self.inch else 1.0
        self.digits = 4 if self.inch else 3
        self.increments = bool(style == "fanuc" and self.rng.random() < 0.3)
        self.blanks, self.zeros = self.rng.random() < 0.7, self.rng.random() < 0.4
        self.numbered, self.count = self.rng.random() < 0.5, 0
        self.lines: list[str] = []
        self.locals: list[str] = []
        self.tail: list[str] = []
        self.truth: list[Segment] = []
        self.dwell = 0.0
        self.here = np.zeros(3)  # of the machine
        self.matrix, self.shift = np.eye(3), np.zeros(3)  # of G51, G68, G52, G92
        self.work, self.length, self.tool = np.zeros(3), 0.0, 0
        self.offsets = {name: np.array(v) for name, v in WORK.items()}
        self.absolute, self.plane, self.feed, self.motion = True, 17, 0.0, ""
        self.per_turn, self.speed, self.next_program = False, 1000, 100
        self.planes = PLANE_CHOICES

    # --- writing -------------------------------------------------------------------------------

    def say(self, *words: str) -> None:
        """One block."""
        plain = all(re.fullmatch(r"[A-Z][-+.\d]*", word) for word in words)
        gap = " " if self.blanks or (self.style == "siemens" and not plain) else ""
        text = gap.join(words)
        if self.numbered:
            self.count += 10
            text = f"N{self.count}{gap}{text}"
        if self.rng.random() < 0.05:
            text += " (G91 X99.)" if self.fanuc else " ; set G91"
        self.lines.append(text)

    def g(self, code: float) -> str:
        """A G word."""
        return f"G{code:02.0f}" if self.zeros and code == int(code) else f"G{code:g}"

    def n(self, value: float) -> str:
        """A length as the post writes it."""
        if self.increments:
            return f"{round(value * 10**self.digits)}"
        text = f"{value:.{self.digits}f}"
        kept = text.rstrip("0") if self.rng.random() < 0.6 else text
        if kept.startswith("0.") and self.rng.random() < 0.3 and kept != "0.":
            kept = kept[1:]
        elif kept.startswith("-0.") and self.rng.random() < 0.3 and kept.strip("-0.") != "":
            kept = "-" + kept[2:]
        if not self.fanuc and self.rng.random() < 0.5:
            kept = kept.rstrip(".") or "0"
        return kept

    def grid(self, value: float) -> float:
        """The nearest number that the post can write."""
        return round(float(value), self.digits)

    def between(self, low: float, high: float) -> float:
        """A length of the program's unit in a range [mm]."""
        return self.grid(self.rng.uniform(low, high) / self.unit)

    def coin(self, share: float = 0.5) -> bool:
        return bool(self.rng.random() < share)

    # --- moving --------------------------------------------------------------------------------

    @property
    def point(self) -> np.ndarray:
        """Where the tool is in the program's coordinates [unit]."""
        shift = self.work + np.array([0, 0, self.length]) + self.shift
        return np.linalg.solve(self.matrix, self.here - shift) / self.unit

    def machine(self, point: np.ndarray) -> np.ndarray:
        shift = self.work + np.array([0, 0, self.length]) + self.shift
        return self.matrix @ (np.asarray(point) * self.unit) + shift

    def go(self, rapid: bool, end: np.ndarray) -> None:
        """Straight in program coordinates."""
        self.go_machine(rapid, self.machine(end))

    def rapid(self, **values: float) -> None:
        """A rapid in absolute coordinates, of the axes that are named."""
        self.say(*self.mode(True), *self.moded(0), *self.axes(values))
        end = self.point.copy()
        end[["XYZ".index(letter) for letter in values]] = list(values.values())
        self.go(True, end)

    def go_machine(self, rapid: bool, end: np.ndarray) -> None:
        length = float(np.linalg.norm(end - self.here))
        if length > 1e-9:
            feed = math.nan if rapid else self.feed
            self.truth.append(Segment(rapid, end, (end + self.here) / 2, length, feed))
        self.here = end

    def turn(self, centre: np.ndarray, angle: float, rise: float) -> None:
        """An arc in the plane about ``centre`` [unit], from where the tool is."""
        u, v, w = PLANES[self.plane]
        arm = self.point - centre
        t = np.linspace(0, 1, ARC_POINTS)
        points = np.tile(centre.astype(float), (len(t), 1))
        c, s = np.cos(angle * t), np.sin(angle * t)
        points[:, u] += arm[u] * c - arm[v] * s
        points[:, v] += arm[u] * s + arm[v] * c
        points[:, w] = self.point[w] + rise * t
        path = np.array([self.machine(p) for p in points])
        step = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        chord = abs(angle) / (ARC_POINTS - 1)
        length = step * (chord / 2) / math.sin(chord / 2) if rise == 0 else step
        self.truth.append(Segment(False, path[-1], path[ARC_POINTS // 2], length, self.feed))
        self.here = path[-1]

    # --- words ---------------------------------------------------------------------------------

    def moded(self, code: float) -> list[str]:
        """The motion's G word, left out now and then where it is in force."""
        word = self.g(code)
        if self.motion == word and self.coin(0.6):
            return []
        self.motion = word
        return [word]

    def axes(self, values: dict[str, float]) -> list[str]:
        return [f"{letter}{self.n(value)}" for letter, value in values.items()]

    def at(self, place: Sequence[float]) -> list[str]:
        """X, Y and Z where they are given."""
        return self.axes(dict(zip("XYZ", place, strict=False)))

    def fed(self, always: bool = False) -> list[str]:
        """F, where it changes or comes again."""
        if not always and self.feed and self.coin(0.7):
            return []
        value = float(self.rng.integers(2, 60) * (2 if self.inch else 20))
        if self.per_turn:
            value = float(self.grid(self.rng.uniform(0.05, 0.4) / self.unit))
            self.feed = value * self.unit * self.speed
        else:
            self.feed = value * self.unit
        text = f"{value:g}"
        return [f"F{text}" + ("." if self.fanuc and "." not in text else "")]

    def mode(self, absolute: bool) -> list[str]:
        if absolute == self.absolute:
            return []
        self.absolute = absolute
        return [self.g(90 if absolute else 91)]


def header(job: Job) -> None:
    """Start of the program: units, plane, work offset, tool."""
    if job.fanuc:
        job.lines += ["%", f"O{job.rng.integers(1000, 9000)} (PART 12.5 X 3)"]
        job.say(job.g(20 if job.inch else 21))
        job.say(job.g(17), job.g(40), job.g(49), job.g(80), job.g(90), job.g(94))
    else:
        job.lines += ["; PART", 'MSG("PART 12.5 X 3")']
        job.say("G700" if job.inch else "G710")
        job.say("G17", "G40", "G90", "G94", "G60" if job.coin() else "G64")
        job.say("SOFT")
        job.say("FFWON")
    tool(job)


def tool(job: Job) -> None:
    """A tool comes into the spindle, and a work offset in force."""
    names = list(WORK) + (list(EXTENDED) if job.fanuc else [])
    name = str(job.rng.choice(names))
    job.tool = int(job.rng.integers(1, 4))
    if job.style == "siemens":
        named = {1: "END_MILL", 2: "DRILL 6", 3: "T3"}
        job.say(f'T="{named[job.tool]}"' if job.coin() else f"T{job.tool}")
        job.say("M6")
        job.say(name, "D1", f"S{job.speed}", "M3")
        job.length = LENGTHS[job.tool]
    else:
        job.say(f"T{job.tool}", "M6" if job.coin() else "M06")
        word = name.replace("G54.1", "G154") if job.style == "haas" else name
        job.say(*word.split(), f"S{job.speed}", "M3")
    job.work = EXTENDED[name] if name in EXTENDED else job.offsets[name]
    job.work = np.array(job.work)
    x, y, z = (job.between(-40, 40) for _ in range(3))
    job.motion = ""
    if job.style != "siemens":
        job.rapid(X=x, Y=y)
        # the length comes with a move in Z: the axis goes to the level, wherever it was
        job.length = LENGTHS[job.tool]
        job.say(job.g(43), f"H{job.tool}", f"Z{job.n(z)}")
        job.go(True, np.array([x, y, z]))
    else:
        job.rapid(X=x, Y=y, Z=z)


def lines(job: Job) -> None:
    """Straight moves in some of the axes, absolute or incremental."""
    for _ in range(job.rng.integers(1, 5)):
        rapid = job.coin(0.3)
        letters = [x for x in "XYZ" if job.coin(0.6)] or ["X"]
        absolute = job.coin(0.7)
        values = {x: job.between(-40, 40) for x in letters}
        end = job.point.copy()
        for letter, value in values.items():
            axis = "XYZ".index(letter)
            end[axis] = value if absolute else end[axis] + value
        own = job.style == "siemens" and job.absolute and not absolute
        head = [] if own else job.mode(absolute)
        words = job.axes(values)
        if own:
            words = [f"{w[0]}=IC({w[1:]})" for w in words]
        job.say(*head, *job.moded(0 if rapid else 1), *words, *([] if rapid else job.fed()))
        job.go(rapid, end)
    job.say(*(job.mode(True) or [job.g(90)]))


def arc(job: Job) -> None:
    """A circle's part by centre or radius, a helix, a full circle, in a plane."""
    plane = int(job.rng.choice(job.planes))
    u, v, w = PLANES[plane]
    names, centres = "XYZ", "IJK"
    if plane != job.plane:
        job.say(job.g(plane))
        job.plane = plane
    full = job.coin(0.2)
    clockwise = job.coin()
    radius = job.between(3, 20)
    # begin on the grid, centre on the grid, end anywhere on the circle within the grid
    start = np.array([job.between(-20, 20) for _ in range(3)])
    job.say(*job.mode(True), *job.moded(job.rng.integers(0, 2)), *job.at(start),
            *job.fed(always=True))  # fmt: skip
    job.go(job.motion in ("G0", "G00"), start)
    a = job.rng.uniform(-math.pi, math.pi)
    offset = np.zeros(3)
    offset[u], offset[v] = job.grid(radius * math.cos(a)), job.grid(radius * math.sin(a))
    centre = start + offset
    sign = -1 if clockwise else 1
    sweep = 2 * math.pi if full else job.rng.uniform(0.2, 6.0)
    helix = job.between(-5, 5) if job.coin(0.3) else 0.0
    arm = -offset
    begin = math.atan2(arm[v], arm[u])
    end = start.copy()
    r = math.hypot(arm[u], arm[v])
    by_radius = not full and job.coin(0.4) and abs(sweep - math.pi) > 0.3
    if not full:
        end[u] = job.grid(centre[u] + r * math.cos(begin + sign * sweep))
        end[v] = job.grid(centre[v] + r * math.sin(begin + sign * sweep))
    end[w] += helix
    values = {} if full and job.coin() else {names[u]: end[u], names[v]: end[v]}
    if helix:
        values[names[w]] = end[w]
    code = job.moded(2 if clockwise else 3)
    relative = job.coin(0.3) and not full
    if relative:
        values = {k: job.grid(x - start["XYZ".index(k)]) for k, x in values.items()}
    head = job.mode(not relative)
    if by_radius:
        word = "CR=" if job.style == "siemens" else "R"
        size = job.grid(r) * (1 if sweep < math.pi else -1)
        job.say(*head, *code, *job.axes(values), f"{word}{job.n(size)}")
        half = (end - start) / 2
        half[w] = 0
        chord = np.linalg.norm(half)
        height = math.sqrt(max(size**2 - chord**2, 0))
        normal = np.zeros(3)
        normal[u], normal[v] = -half[v] / chord, half[u] / chord
        side = sign * (1 if sweep < math.pi else -1)
        centre = start + half + side * height * normal
    else:
        written = [f"{centres[i]}{job.n(offset[i])}" for i in (u, v)]
        job.say(*head, *code, *job.axes(values), *written)
    if not full:
        a_0 = math.atan2(*(start - centre)[[v, u]])
        a_1 = math.atan2(*(end - centre)[[v, u]])
        sweep = (sign * (a_1 - a_0)) % (2 * math.pi)
    _arc_to(job, centre, sign * sweep, end, helix)
    job.say(*(job.mode(True) or [job.g(90)]), job.g(17))
    job.plane = 17


def _arc_to(job: Job, centre: np.ndarray, angle: float, end: np.ndarray, rise: float) -> None:
    """The arc, then exactly at its end (the circle misses it by the grid)."""
    job.turn(centre, angle, rise)
    last = job.truth[-1]
    exact = job.machine(end)
    assert np.linalg.norm(exact - last.end) < 3 * 10.0**-job.digits * job.unit
    job.truth[-1] = Segment(False, exact, last.middle, last.length, last.feed)
    job.here = exact


def holes(job: Job) -> None:
    """A canned cycle at a few places."""
    code = int(job.rng.choice([81, 82, 83, 73, 85, 86, 89, 84, 76]))
    to_r = job.coin()
    level = job.grid(job.between(10, 20))
    job.rapid(Z=level)
    relative = job.coin(0.25)
    plane_r, depth = job.between(1, 4), job.between(-12, -4)
    words = {"Z": depth, "R": plane_r}
    if relative:
        words = {"Z": job.grid(depth - plane_r), "R": job.grid(plane_r - level)}
    extra = []
    q = job.between(1, 4) if code in (73, 83, 76) else 0.0
    if q:
        extra.append(f"Q{job.n(q)}")
    pause = 0.5 if code in (82, 89) else 0.0
    if pause:
        extra.append("P500")
    first = {"X": job.between(-30, 30), "Y": job.between(-30, 30)}
    begin = job.point
    repeat = int(job.rng.integers(2, 4)) if relative and job.coin() else 1
    count = [f"{'K' if job.style == 'fanuc' and job.coin() else 'L'}{repeat}"] * (repeat > 1)
    job.say(*job.mode(not relative), job.g(99 if to_r else 98), job.g(code), *job.axes(first),
            *job.axes(words), *extra, *count, *job.fed(always=True))  # fmt: skip
    job.motion = ""
    bottom = np.array([plane_r, depth])
    if relative:  # as written
        bottom = np.array([level + words["R"], level + words["R"] + words["Z"]])

    def drill(x: float, y: float) -> None:
        job.go(True, np.array([x, y, job.point[2]]))
        _hole(job, code, *bottom, level, q, to_r)
        job.dwell += pause

    x, y = begin[:2]
    for _ in range(repeat):
        x, y = (x + first["X"], y + first["Y"]) if relative else (first["X"], first["Y"])
        drill(x, y)
    for _ in range(job.rng.integers(0, 4)):
        letter = "XY"[job.rng.integers(0, 2)]
        value = job.between(-30, 30)
        job.say(f"{letter}{job.n(value)}")
        if letter == "X":
            x = x + value if relative else value
        else:
            y = y + value if relative else value
        drill(x, y)
    job.say(job.g(80))
    job.say(*job.mode(True))
    if job.lines[-1] == "" or not job.lines[-1].strip():
        job.lines.pop()


def _hole(job: Job, code: int, plane_r, depth, level, q, to_r) -> None:
    x, y = job.point[:2]

    def z(value, rapid=True):
        job.go(rapid, np.array([x, y, value]))

    out = plane_r if to_r else level
    z(plane_r)
    if code in (73, 83):
        at = plane_r
        while at - q > depth + 1e-9:
            at -= q
            z(at, False)
            if code == 83:
                z(plane_r)
            z(at + GAP / job.unit)
        z(depth, False)
    elif code == 76:
        z(depth, False)
        job.go(True, np.array([x, y - q, depth]))
        job.go(True, np.array([x, y - q, out]))
        job.go(True, np.array([x, y, out]))
        return
    else:
        z(depth, False)
        if code in (84, 85, 89):  # back out by feed
            z(plane_r, False)
    z(out)


def local(job: Job) -> None:
    """A shift of the program's origin, and moves in it."""
    shift = np.array([job.between(-20, 20), job.between(-20, 20), job.between(-5, 5)])
    if job.style == "siemens":
        job.say("TRANS", *job.at(shift))
        if job.coin():
            more = job.between(-5, 5)
            job.say("ATRANS", f"X{job.n(more)}")
            shift[0] += more
        job.shift = shift * job.unit
        _within(job)
        job.say("TRANS")
    elif job.coin(0.5):
        job.say(job.g(52), *job.at(shift))
        job.shift = shift * job.unit
        _within(job)
        job.say(job.g(52), "X0", "Y0", "Z0")
    else:
        job.say(job.g(92), *job.at(shift))
        job.shift = (job.point - shift) * job.unit
        _within(job)
        job.say("G92.1", *(["X0", "Y0", "Z0"] if job.fanuc else []))
    job.shift = np.zeros(3)
    place(job)


def place(job: Job) -> None:
    """A rapid in every axis, where a frame has changed."""
    job.rapid(**{letter: job.between(-40, 40) for letter in "XYZ"})


def _within(job: Job) -> None:
    place(job)
    acts = [lines, arc, holes] if job.fanuc else [lines, arc]
    for act in job.rng.choice(acts, size=int(job.rng.integers(1, 3))):
        act(job)


def _flat(job: Job) -> None:
    """Moves in the plane only."""
    place(job)
    job.planes = [17]
    for _ in range(job.rng.integers(1, 3)):
        (lines if job.coin() else arc)(job)
    job.planes = PLANE_CHOICES


def _about(matrix: np.ndarray, centre: np.ndarray) -> np.ndarray:
    return centre - matrix @ centre


def rotated(job: Job) -> None:
    """G68 of a Fanuc."""
    x, y, angle = job.between(-20, 20), job.between(-20, 20), float(job.rng.integers(-90, 180))
    text = f"{angle:.3f}" if not job.increments else f"{round(angle * 1000)}"
    job.say(job.g(68), *job.axes({"X": x, "Y": y}), f"R{text}")
    a = math.radians(angle)
    turn = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    job.matrix, job.shift = turn, _about(turn, np.array([x, y, 0]) * job.unit)
    _flat(job)
    job.say(job.g(69))
    job.matrix, job.shift = np.eye(3), np.zeros(3)
    place(job)


def scaled(job: Job) -> None:
    """G51 of a Fanuc, G51.1 for a mirror."""
    centre = np.array([job.between(-20, 20), job.between(-20, 20), 0.0])
    if job.coin():
        factor = float(job.rng.choice([0.5, 2.0, 1.25]))
        text = f"P{factor:g}" + "." * (factor == 2.0)
        if job.style == "fanuc":
            text = f"P{round(factor * 1000)}"
        job.say(job.g(51), *job.at(centre), text)
        job.matrix = np.eye(3) * factor
        end = [job.g(50)]
    else:
        axis = int(job.rng.integers(0, 2))
        if job.style == "haas":
            job.say("G101", f"{'XY'[axis]}0")
            end, centre = ["G100", f"{'XY'[axis]}0"], np.zeros(3)
        else:
            job.say("G51.1", f"{'XY'[axis]}{job.n(centre[axis])}")
            end = ["G50.1", f"{'XY'[axis]}0"]
        job.matrix = np.eye(3)
        job.matrix[axis, axis] = -1.0
        centre[1 - axis] = 0.0
    job.shift = _about(job.matrix, centre * job.unit)
    _flat(job)
    job.say(*end)
    job.matrix, job.shift = np.eye(3), np.zeros(3)
    place(job)


def polar(job: Job) -> None:
    """G16: radius and angle."""
    place(job)
    job.say(job.g(17), job.g(90), job.g(16))
    for _ in range(job.rng.integers(1, 4)):
        radius, angle = job.between(5, 30), float(job.rng.integers(-180, 180))
        text = f"{angle:.1f}"
        job.say(*job.moded(1), f"X{job.n(radius)}", f"Y{text}", *job.fed())
        a = math.radians(angle)
        job.go(False, np.array([radius * math.cos(a), radius * math.sin(a), job.point[2]]))
    job.say(job.g(15))
    place(job)


def subprogram(job: Job) -> None:
    """Steps that are called a few times."""
    number, count = job.next_program, int(job.rng.integers(1, 4))
    job.next_program += 1
    steps = [(job.coin(0.4), job.between(-5, 5), job.between(-5, 5), job.between(-1, 1))
             for _ in range(job.rng.integers(1, 4))]  # fmt: skip
    feed = [] if all(step[0] for step in steps) else job.fed(always=True)
    body = [
        " ".join([f"G91 G{0 if rapid else 1}", *job.axes({"X": x, "Y": y, "Z": z}),
                  *([] if rapid else feed)])
        for rapid, x, y, z in steps
    ]  # fmt: skip
    if job.style == "haas" and job.coin():
        local = 7000 + number
        job.say(f"M97 P{local} L{count}")
        job.locals += [f"N{local}", *body, "M99"]
    else:
        call = f"M98 P{number} L{count}"
        if job.style == "fanuc" and count > 1 and job.coin():
            call = f"M98 P{count}{number:04d}"
        job.say(call)
        job.tail += [f"O{number:04d} (STEPS)", *body, "M99"]
    for _ in range(count):
        for rapid, x, y, z in steps:
            job.go(rapid, job.point + np.array([x, y, z]))
    job.absolute, job.motion = False, ""
    job.say(*job.mode(True))


def macro(job: Job) -> None:
    """A row of steps counted by variables, as a macro, a loop or R parameters."""
    count, step = int(job.rng.integers(2, 6)), job.between(1, 5)
    job.fed(always=True)
    value = float(job.rng.integers(2, 60) * 10)
    job.feed = value * job.unit
    fed = f"F{value:g}." if job.fanuc else f"F{value:g}"
    start = job.point
    if job.fanuc and job.coin():
        number = job.next_program
        job.next_program += 1
        text = f"{step:.{job.digits}f}"
        job.say(f"G65 P{number} A{count}. B{text} {fed}")
        job.tail += [f"O{number:04d}", "#10=0", "WHILE[#10LT#1]DO1", "#10=#10+1",
                     "G91G1X#2F#9", "IF[#10EQ2]GOTO5", "Y[#2/2]", "N5", "END1", "G90",
                     "M99"]  # fmt: skip
        for i in range(1, count + 1):
            job.go(False, job.point + np.array([step, 0, 0]))
            if i != 2:
                job.go(False, job.point + np.array([0, step / 2, 0]))
    elif job.fanuc:
        job.lines += [f"#100={step:.{job.digits}f}", "#101=0", f"G90 G1 {fed}",
                      f"WHILE [#101 LT {count}] DO1",
                      "#101=#101+1", "G91 Y[#100*COS[60.]] Z[FIX[2.7]*#100]", "END1"]  # fmt: skip
        for _ in range(count):
            job.go(False, job.point + np.array([0, step * 0.5, 2 * step]))
        job.absolute = False
    else:
        job.lines += [f"R1={step:.{job.digits}f} R2=0", f"G90 G1 {fed}",
                      f"FOR R3=1 TO {count}", "G91 X=R1 Y=R1*COS(60)", "R2=R2+1", "ENDFOR",
                      f"IF R2=={count}", "Z=IC(R1)", "ELSE", "Z=IC(-99)", "ENDIF"]  # fmt: skip
        for _ in range(count):
            job.go(False, job.point + np.array([step, step * 0.5, 0]))
        job.go(False, job.point + np.array([0, 0, step]))
        job.absolute = False
    assert (job.point != start).any()
    job.motion = ""
    job.say(*job.mode(True) or [job.g(90)])


def pocket(job: Job) -> None:
    """A rectangle inside which the tool goes with G41: the rectangle less its radius."""
    place(job)
    x, y = job.between(-20, 20), job.between(-20, 20)
    a, b = job.grid(job.between(20, 30)), job.grid(job.between(20, 30))
    z = job.point[2]
    r = DIAMETERS[job.tool] / 2 / job.unit
    job.rapid(X=x, Y=y)
    left = job.coin()
    d = [] if job.style == "siemens" else [f"D{job.tool}"]
    # from the middle to the lower side, then round: anticlockwise with the tool to the left
    sign = 1 if left else -1
    corners = [(0, -b / 2), (sign * a / 2, -b / 2), (sign * a / 2, b / 2), (-sign * a / 2, b / 2),
               (-sign * a / 2, -b / 2), (0, -b / 2)]  # fmt: skip
    corners = [(job.grid(x + u), job.grid(y + v)) for u, v in corners]
    job.say(job.g(41 if left else 42), *d, *job.moded(1), *job.at(corners[0]),
            *job.fed(always=True))  # fmt: skip
    for corner in corners[1:]:
        job.say(*job.moded(1), *job.at(corner))
    inside = []
    (x_0, y_0), (x_1, y_1) = np.min(corners, axis=0), np.max(corners, axis=0)
    for u, v in corners:
        inside.append((min(max(u, x_0 + r), x_1 - r), min(max(v, y_0 + r), y_1 - r)))
    for u, v in inside:
        job.go(False, np.array([u, v, z]))
    job.say(job.g(40), *job.moded(1), *job.axes({"X": x, "Y": y}))
    job.go(False, np.array([x, y, z]))


def corner(job: Job) -> None:
    """,R and ,C of a Fanuc at a square corner."""
    x, y, a = job.between(-20, 20), job.between(-20, 20), job.between(10, 20)
    size = job.between(1, 4)
    z = job.point[2]
    job.rapid(X=x, Y=y)
    rounded = job.coin()
    far, up = job.grid(x + a), job.grid(y + a)
    job.say(*job.moded(1), f"X{job.n(far)}", f",{'R' if rounded else 'C'}{job.n(size)}",
            *job.fed(always=True))  # fmt: skip
    job.say(f"Y{job.n(up)}")
    job.go(False, np.array([far - size, y, z]))
    if rounded:
        job.turn(np.array([far - size, y + size, z]), math.pi / 2, 0.0)
    else:
        job.go(False, np.array([far, y + size, z]))
    job.go(False, np.array([far, up, z]))


def pause(job: Job) -> None:
    """A dwell."""
    if job.style == "siemens":
        job.say("G4", "F1.5")
    else:
        job.say(job.g(4), str(job.rng.choice(["P1500", "X1.5", "P1.5"]))
                if not job.increments else "P1500")  # fmt: skip
    job.dwell += 1.5


def home(job: Job) -> None:
    """To the reference, or to a place of the machine."""
    if job.style == "siemens":
        z = job.grid(250 / job.unit)
        job.say("SUPA", "G0", f"Z{job.n(z)}", "D0")
        job.motion = "G0"
        job.go_machine(True, np.array([*job.here[:2], z * job.unit]))
        job.length = 0.0
        job.say("D1")
        job.length = LENGTHS[job.tool]
    elif job.coin():
        job.say(job.g(91), job.g(28), "Z0" if job.increments else "Z0.")
        job.say(job.g(90))
        job.go_machine(True, np.array([*job.here[:2], REFERENCE[2]]))
    else:
        z = job.grid(250 / job.unit)
        job.say(job.g(53), job.g(0), f"Z{job.n(z)}")
        job.motion = job.g(0)
        job.go_machine(True, np.array([*job.here[:2], z * job.unit]))
    place(job)


def written_offset(job: Job) -> None:
    """G10 L2: a work offset of the program."""
    values = [job.between(-50, 50) for _ in range(3)]
    job.say(job.g(10), "L2", "P3", *job.at(values))
    job.offsets["G56"] = np.array(values) * job.unit
    job.say("G56")
    job.work = job.offsets["G56"]
    place(job)


def turned(job: Job) -> None:
    """Feed per revolution, and back."""
    job.say(job.g(95))
    job.per_turn, job.feed = True, 0.0
    value = float(job.rng.choice([0.1, 0.25])) if not job.inch else 0.01
    job.feed = value * job.unit * job.speed
    end = job.point + np.array([job.between(1, 5), 0, 0])
    end[0] = job.grid(end[0])
    job.say(*job.mode(True), job.g(1), f"X{job.n(end[0])}", f"F{value:g}")
    job.motion = job.g(1)
    job.go(False, end)
    job.per_turn, job.feed = False, 0.0
    job.say(job.g(94), *job.fed(always=True))


def inverse_time(job: Job) -> None:
    """G93: F is one over the minutes of each block."""
    job.say(job.g(93))
    place = job.point
    for _ in range(2):
        step = np.array([job.between(1, 9), job.between(1, 9), 0.0])
        minutes = float(job.rng.choice([0.5, 0.25, 0.1]))
        job.feed = float(np.linalg.norm(step)) * job.unit / minutes
        place = job.point + step
        job.say(*job.mode(False), job.g(1), *job.axes({"X": step[0], "Y": step[1]}),
                f"F{1 / minutes:g}" + "." * (job.fanuc and minutes != 0.4))  # fmt: skip
        job.go(False, place)
    job.motion, job.feed = job.g(1), 0.0
    job.say(job.g(94), *job.mode(True), *job.fed(always=True))


def modal_macro(job: Job) -> None:
    """G66: a macro after each move, and G67."""
    number, step = job.next_program, job.between(1, 3)
    job.next_program += 1
    place = [(job.between(-20, 20), job.between(-20, 20)) for _ in range(2)]
    feed = float(job.rng.integers(2, 60) * 10)
    job.feed = feed * job.unit
    job.tail += [f"O{number:04d}", f"G91 G1 Z-#2 F{feed:g}.", "G0 Z#2", "G90", "M99"]
    job.say(job.g(90), job.g(0))
    job.absolute = True
    job.say(f"G66 P{number} B{step:.{job.digits}f}")
    for x, y in place:
        job.say(job.g(0), *job.axes({"X": x, "Y": y}))
        job.go(True, np.array([x, y, job.point[2]]))
        job.go(False, job.point - np.array([0, 0, step]))
        job.go(True, job.point + np.array([0, 0, step]))
    job.say(job.g(67))
    job.motion = ""


def nested(job: Job) -> None:
    """A subprogram that calls another, in a loop, that leaves by M99 and by its last line."""
    outer, inner = job.next_program, job.next_program + 1
    job.next_program += 2
    x, y, times = job.between(1, 4), job.between(1, 4), int(job.rng.integers(1, 4))
    job.say(f"M98 P{outer} L{times}")
    job.tail += [f"O{outer:04d}", f"G91 G0 X{job.n(x)}", f"M98 P{inner}", "M99", f"O{inner:04d}",
                 f"G91 G0 Y{job.n(y)}", "IF[#500EQ#0]GOTO7", "X99.", "N7 M99"]  # fmt: skip
    for _ in range(times):
        job.go(True, job.point + np.array([x, 0, 0]))
        job.go(True, job.point + np.array([0, y, 0]))
    job.absolute, job.motion = False, ""
    job.say(*job.mode(True))


def outline(job: Job) -> None:
    """A rectangle round which the tool goes with G41: at the corners an arc, or lines that meet."""
    place(job)
    x, y = job.between(-20, 20), job.between(-20, 20)
    a, b = job.between(20, 30), job.between(20, 30)
    z, r = job.point[2], DIAMETERS[job.tool] / 2 / job.unit
    far = job.grid(30 / job.unit)
    job.rapid(X=x, Y=job.grid(y - far), Z=z)
    # clockwise with the tool to the left: up the left side, and round
    right, up = job.grid(x + a), job.grid(y + b)
    corners = [(x, y), (x, up), (right, up), (right, y), (x, y)]
    d = [] if job.style == "siemens" else [f"D{job.tool}"]
    job.say(job.g(41), *d, *job.moded(1), *job.at(corners[0]), *job.fed(always=True))
    for corner in corners[1:]:
        job.say(*job.moded(1), *job.at(corner))
    off = np.array([[-r, 0], [0, r], [r, 0], [0, -r]])
    job.go(False, np.array([x - r, y, z]))
    for i, corner in enumerate(corners[1:]):
        here, after = np.array(corner), off[(i + 1) % 4]
        last = i == 3
        ahead = here + off[i]
        if job.fanuc and not last:
            job.go(False, np.array([*(here + off[i] + after), z]))  # the lines meet
            continue
        job.go(False, np.array([*ahead, z]))
        if not last:
            job.turn(np.array([*here, z]), -math.pi / 2, 0.0)
    leave = np.array([job.grid(right + far), y, z])
    job.say(job.g(40), *job.moded(0), *job.at(leave))
    job.go(True, leave)


def added_rotation(job: Job) -> None:
    """G68 with R that adds up under G91, and a mirrored, shifted frame inside of G52."""
    x, y = job.between(-10, 10), job.between(-10, 10)
    first, second = (float(job.rng.integers(5, 60)) for _ in range(2))
    shift = np.array([job.between(-20, 20), job.between(-20, 20), 0.0])
    job.say(job.g(52), *job.at(shift))
    job.say(*job.mode(True), job.g(68), *job.at((x, y)), f"R{first:.3f}")
    a = math.radians(first + second)
    job.say(*job.mode(False), job.g(68), *job.at((x, y)), f"R{second:.3f}")
    job.say(*job.mode(True))
    turn = np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    job.matrix = turn
    job.shift = _about(turn, np.array([x, y, 0]) * job.unit) + shift * job.unit
    _flat(job)
    job.say(job.g(69))
    job.say(job.g(52), "X0", "Y0", "Z0")
    job.matrix, job.shift = np.eye(3), np.zeros(3)
    place(job)


def centre_of_its_own(job: Job) -> None:
    """An arc of a Sinumerik whose centre counts from the origin, with turns of a helix."""
    place(job)
    start = job.point
    radius, rise = job.between(3, 9), job.between(-5, 5)
    turns = int(job.rng.integers(0, 3))
    centre = np.array([job.grid(start[0] + radius), start[1], start[2]])
    end = np.array([start[0], start[1], job.grid(start[2] + rise)])
    more = [f"TURN={turns}"] if turns else []
    job.say(*job.moded(3), *job.at(end), f"I=AC({job.n(centre[0])})", f"J=AC({job.n(centre[1])})",
            *more, *job.fed(always=True))  # fmt: skip
    _arc_to(job, centre, 2 * math.pi * (turns + 1), end, end[2] - start[2])


def skipped(job: Job) -> None:
    """Blocks that a switch leaves out, and comments."""
    job.lines += ["/ G0 X99. Y99.", "(G0 X99. #1=3)" if job.fanuc else "; G0 X99. R1=3"]
    job.motion = ""  # the switch is off: the block runs
    job.go(True, np.array([99.0, 99.0, job.point[2]]))


COMMON = (lines, lines, arc, arc, local, macro, pocket, pause, home, inverse_time, outline, turned,
          skipped, tool)  # fmt: skip
OF_FANUC = (*COMMON, holes, holes, subprogram, modal_macro, nested, rotated, scaled, written_offset)
OPERATIONS: dict[str, Sequence[Callable[[Job], None]]] = {
    "fanuc": (*OF_FANUC, added_rotation, polar, corner), "haas": OF_FANUC,
    "siemens": (*COMMON, centre_of_its_own),
}  # fmt: skip


def made(seed: int, style: str, count: int = 8) -> Job:
    """A program of a style with ``count`` operations."""
    job = Job(seed, style)
    header(job)
    for index in job.rng.integers(len(OPERATIONS[style]), size=count).tolist():
        OPERATIONS[style][index](job)
    job.say("M30")
    job.lines += [*job.locals, *job.tail]
    if job.fanuc:
        job.lines.append("%")
    return job
