"""A follower of its own for Sinumerik programs: what the cycles' manual says, hole by hole.

It shares nothing with ``pipeline``: text to lengths by regular expressions and Python's own
arithmetic.  It knows G0, G1, F, S, M3 to M5, MCALL, CYCLE81 to CYCLE86, CYCLE89, HOLES1, HOLES2, R
parameters, TRANS, L and named subprograms with P, REPEAT, in absolute coordinates.

Source: Sinumerik 840D sl, Programming Manual Cycles and Job Planning.
"""

import math
import re
from collections import defaultdict

NAMES = {
    "CYCLE81": "RTP RFP SDIS DP DPR",
    "CYCLE82": "RTP RFP SDIS DP DPR DTB",
    "CYCLE83": "RTP RFP SDIS DP DPR FDEP FDPR DAM DTB DTS FRF VARI AXN MDEP VRT DTD DIS1",
    "CYCLE84": "RTP RFP SDIS DP DPR DTB SDAC MPIT PIT POSS SST SST1",
    "CYCLE85": "RTP RFP SDIS DP DPR DTB FFR RFF",
    "CYCLE86": "RTP RFP SDIS DP DPR DTB SDIR RPA RPO RPAP POSS",
    "CYCLE89": "RTP RFP SDIS DP DPR DTB",
}
ISO_COARSE = {3: 0.5, 4: 0.7, 5: 0.8, 6: 1, 8: 1.25, 10: 1.5, 12: 1.75, 16: 2, 20: 2.5}


class Sinumerik:
    """Follows a program; ``programs`` are the texts of its subprograms by name.

    ``cut`` is the length by feed [mm/min], ``threads`` by pitch and speed, ``rapid`` the length of
    rapids, ``waited`` the seconds of dwells, ``holes`` where the bottoms are.
    """

    def __init__(self, programs: dict[str, str]) -> None:
        self.programs = programs
        self.at, self.shift = [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
        self.feed = self.speed = self.rapid = self.waited = 0.0
        self.code, self.modal = 0, None
        self.cut, self.threads = defaultdict(float), defaultdict(float)
        self.holes: list[tuple[float, float, float]] = []
        self.r: dict[str, float] = defaultdict(float)

    def run(self, text: str) -> None:
        lines = [re.sub(r";.*", "", line).strip() for line in text.splitlines()]
        self.lines(lines, 0, len(lines))

    def lines(self, lines: list[str], first: int, stop: int) -> None:
        for index in range(first, stop):
            line = re.sub(r"^N\d+\s*", "", lines[index])
            if repeat := re.fullmatch(r"REPEAT (\w+) P=(\d+)", line):
                begin = next(i for i, one in enumerate(lines) if one.startswith(repeat[1] + ":"))
                for _ in range(int(repeat[2])):
                    self.lines(lines, begin, index)
            elif line in ("M17", "M30", "RET"):
                return
            else:
                self.block(re.sub(r"^\w\w+:\s*", "", line))

    def value(self, text: str) -> float:
        known = re.sub(r"\bR(\d+)", lambda found: f"({self.r[found[1]]!r})", text)
        return float(eval(known, {"__builtins__": {}}))

    def block(self, line: str) -> None:
        call = re.fullmatch(r'(?:CALL ")?([A-Z_]{2}\w*|L\d+)"?(?: P=?(\d+))?', line)
        if call and call[1] in self.programs:
            for _ in range(int(call[2] or 1)):
                self.run(self.programs[call[1]])
        elif line.startswith("MCALL"):
            self.modal = self.cycle(line[5:].strip()) if line[5:].strip() else None
        elif line.startswith(("HOLES1", "HOLES2")):
            for x, y in self.pattern(*self.arguments(line)):
                self.go(0, [x + self.shift[0], y + self.shift[1], self.at[2]])
                self.drill(self.modal)
        elif line.startswith("CYCLE"):
            self.drill(self.cycle(line))
        elif line.startswith("TRANS"):
            given = dict(re.findall(r"([XYZ])=?([^ ]+)", line[5:]))
            self.shift = [self.value(given.get(axis, "0")) for axis in "XYZ"]
        elif sets := re.findall(r"\bR(\d+)=([^ ]+)", line):
            for name, text in sets:
                self.r[name] = self.value(text)
        elif line:
            self.words(dict(re.findall(r"([GXYZFS])=?([-+*/.()\dR]+)", line)), line)

    def words(self, words: dict[str, str], line: str) -> None:
        self.feed = self.value(words["F"]) if "F" in words else self.feed
        self.speed = self.value(words["S"]) if "S" in words else self.speed
        for code in re.findall(r"\bG([01])\b", line):
            self.code = int(code)
        end = [
            self.value(words[axis]) + shift if axis in words else here
            for axis, here, shift in zip("XYZ", self.at, self.shift, strict=True)
        ]
        if set("XYZ") & set(words):
            self.go(self.code, end)
            if self.modal:
                self.drill(self.modal)

    def arguments(self, line: str) -> tuple[str, list[float]]:
        name, inner = re.fullmatch(r"(\w+)\((.*)\)", line).groups()
        return name, [self.value(one) if one.strip() else 0.0 for one in inner.split(",")]

    def cycle(self, line: str) -> tuple[str, dict[str, float]]:
        name, values = self.arguments(line)
        given = defaultdict(float, zip(NAMES[name].split(), values, strict=False))
        given["bottom"] = given["RFP"] - given["DPR"] if given["DPR"] else given["DP"]
        return name, given

    def pattern(self, name: str, values: list[float]) -> list[tuple[float, float]]:
        a, b, c, d, e, count = values
        if name == "HOLES2":
            step = e or 360 / count
            angles = [math.radians(d + step * i) for i in range(int(count))]
            return [(a + c * math.cos(w), b + c * math.sin(w)) for w in angles]
        w = math.radians(c)
        row = [
            (a + (d + e * i) * math.cos(w), b + (d + e * i) * math.sin(w))
            for i in range(int(count))
        ]
        here = [self.at[0] - self.shift[0], self.at[1] - self.shift[1]]
        return min((row, row[::-1]), key=lambda one: math.dist(here, one[0]))

    def go(self, code: int, end: list[float]) -> None:
        length = math.dist(self.at, end)
        if code:
            self.cut[self.feed] += length
        else:
            self.rapid += length
        self.at = list(end)

    def to(self, code: int, level: float, feed: float = 0.0) -> None:
        feed, self.feed = self.feed, feed or self.feed
        self.go(code, [self.at[0], self.at[1], level + self.shift[2]])
        self.feed = feed

    def drill(self, call: tuple[str, dict[str, float]]) -> None:
        name, g = call
        above = g["RFP"] + g["SDIS"]
        self.to(0, above)
        self.holes.append((self.at[0], self.at[1], g["bottom"] + self.shift[2]))
        if name == "CYCLE83":
            self.peck(g, above)
        elif name == "CYCLE84":
            pitch = abs(g["PIT"]) or ISO_COARSE[int(abs(g["MPIT"]))]
            for level, speed in ((g["bottom"], g["SST"]), (above, g["SST1"] or g["SST"])):
                self.threads[pitch, speed] += abs(self.at[2] - self.shift[2] - level)
                self.at[2] = level + self.shift[2]
            self.waited += g["DTB"]
        else:
            self.to(1, g["bottom"], g["FFR"])
            self.waited += g["DTB"]
        if name in ("CYCLE85", "CYCLE89"):
            self.to(1, above, g["RFF"])
        if name == "CYCLE86":
            x, y, z = self.at
            self.go(0, [x + g["RPA"], y + g["RPO"], z + g["RPAP"]])
            self.to(0, above)
            self.go(0, [x, y, g["RTP"] + self.shift[2]])
        self.to(0, g["RTP"])

    def peck(self, g: dict[str, float], above: float) -> None:
        whole = g["RFP"] - g["bottom"]
        infeed, reached, slow = g["FDPR"] or g["RFP"] - g["FDEP"], 0.0, g["FRF"] or 1.0
        ahead = g["DIS1"] or (0.6 if whole <= 30 else min(whole / 50, 7.0))
        while True:
            rest = whole - reached
            if g["DAM"] > 0 and reached and infeed == g["DAM"] and infeed < rest < 2 * infeed:
                infeed = rest / 2
            reached = min(reached + infeed, whole)
            self.to(1, g["RFP"] - reached, self.feed * slow)
            slow = 1.0
            if whole - reached < 1e-9:
                self.waited += g["DTD"] or g["DTB"]
                return
            self.waited += g["DTB"]
            if g["VARI"]:
                self.to(0, above)
                self.waited += g["DTS"]
                self.to(0, g["RFP"] - reached + ahead)
            else:
                self.to(1, g["RFP"] - reached + (g["VRT"] or 1.0))
            infeed = max(infeed - g["DAM"], g["DAM"]) if g["DAM"] else infeed
