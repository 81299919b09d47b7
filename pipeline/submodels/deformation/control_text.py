"""Correction of spindle growth as a file for a control: a table, or a macro.

``csv`` is the table itself.  ``fanuc`` is a custom macro that shifts the external work zero point
along Z (variable #5203; #3001 is a clock in ms, #3000 an alarm: Fanuc 0i-F operator's manual
B-64694EN, 16.2 "System variables").  ``siemens`` is a subprogram that writes the
position-independent temperature compensation value (SD43900 $SA_TEMP_COMP_ABS_VALUE, active with
bit 0 of MD32750 $MA_TEMP_COMP_TYPE, its rate limited by MD32760: SINUMERIK 840D sl Function Manual
Extended Functions, 6FC5397-1BP40-3BA1, K3 "Compensations", 4.2 "Temperature compensation").
We know of no public format of a table of temperatures of either maker, so both are programs.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.submodels.deformation.records import GROWTH as QUANTITY
from pipeline.submodels.deformation.records import SPEED
from pipeline.submodels.deformation.thermal_growth import ONE, Correction

UM_PER_MM = 1000.0
"""Micrometres of a millimetre [1]."""
LEAST_CALL_S = 1.0
"""Time between two calls below which a control's text does nothing [s]."""
LONGEST_CALL = 5
"""Periods between two calls from which a control's text starts anew [1]."""


@dataclass(frozen=True, kw_only=True)
class Written:
    """A correction that was written, with what its file rests on."""

    machine: str
    origin: str
    """Name of the machine, and where its records come from."""
    method: str
    """Method that serves, for a person."""
    status: str
    """Status of its verdict."""
    correction: Correction
    """The correction."""
    models: Path
    """Folder of the model."""
    unknown: str = ""
    """Reason for no interval of the growth, from the judge."""

    @property
    def simulated(self) -> str:
        """Label of what rests on simulated records, with a blank before it."""
        return " (simulated)" if self.origin == "simulated" else ""


def _head(done: Written) -> Iterator[str]:
    correction = done.correction
    below, above = correction.interval_um
    yield f"Kerf: correction of spindle growth, {done.machine}{done.simulated}"
    yield f"Method: {done.method}; verdict: {done.status}"
    yield "Offset to add along +Z (away from the workpiece, ISO 841) = +growth since the start"
    yield (
        f"{'Exact but for rounding' if correction.exact else 'Linearised'}: at most "
        f"{correction.largest_um:.3g} um from the model ({correction.rmse_um:.3g} um RMS) over "
        f"{correction.recordings} training recordings"
    )
    yield f"Growth learnt: {correction.growth_um[0]:.1f} to {correction.growth_um[1]:.1f} um"
    interval = f"-{below:.2f} to +{above:.2f} um, the difference included"
    yield f"90 % interval of growth: {'not known' if done.unknown else interval}"
    yield f"Call or row every {correction.period_s:g} s; growth counts from the first"
    yield "It holds for sound sensors inside these ranges only:"
    for name in correction.ranges:
        one = correction.ranges[name]
        yield f"  {name}: {one.low:g} to {one.high:g} {one.unit}"


def table_lines(done: Written) -> Iterator[str]:
    """The correction as CSV: a row a term.

    growth = sum of um x (input - input at the start), low-passed by the lags, for rows ``rise``
    (``speed``: the square of the speed in 1000 rev/min), plus um x input at the start x
    (1 - exp(-t / first lag)) for rows ``start``.
    """
    correction = done.correction
    for line in _head(done):
        yield f"# {line}"
    yield "# growth [um] = sum of um_per_unit * (input - input at start) low-passed by first_lag_s"
    yield "#   and second_lag_s (0: none), rows rise; of spindle_speed: (speed / 1000 rev/min)^2"
    yield "# + sum of um_per_unit * input at start * (1 - exp(-t / first_lag_s)), rows start"
    yield "# low-pass: lag y' = x - y, exact for x that runs straight from row to row"
    yield "kind,input,unit,first_lag_s,second_lag_s,um_per_unit,low,high,range_unit"
    for term in correction.terms:
        first, second = (*term.lags_s, 0.0, 0.0)[:2]
        one = correction.ranges[term.input]
        unit = "(1000 rev/min)^2" if term.input == SPEED else "K"
        yield (f"rise,{_quoted(term.input)},{unit},{first:g},{second:g},{term.um!r},{one.low:g},"
               f"{one.high:g},{one.unit}")  # fmt: skip
    for start in correction.starts:
        constant = start.input == ONE
        span = ",,," if constant else (
            f",{correction.ranges[start.input].low:g},{correction.ranges[start.input].high:g},"
            f"{correction.ranges[start.input].unit}"
        )  # fmt: skip
        yield (f"start,{_quoted(start.input)},{'1' if constant else 'degC'},{start.lag_s:g},0,"
               f"{start.um!r}{span}")  # fmt: skip


def _quoted(name: str) -> str:
    return name if not set(name) & set(',"') else '"' + name.replace('"', '""') + '"'


@dataclass(frozen=True, kw_only=True)
class Control:
    """Syntax of a control's text."""

    comment: str
    variable: str
    label: str
    jump: str
    """Templates of a comment, a variable by number, a label and a jump to it on a condition."""
    first: int
    last: int
    """Numbers of the variables that may be used [1]."""
    brackets: tuple[str, str]
    """Brackets of an expression."""
    less: str
    more: str
    """Comparisons."""
    clock_s: str
    """Expression of a clock [s]."""
    head: tuple[str, ...]
    foot: tuple[str, ...]
    alarm: tuple[str, ...]
    offset: tuple[str, ...]
    """Lines before and after; out of an input's range; that write the offset {value} [mm]."""


FANUC = Control(
    comment="({})", variable="#{}", label="N{}", jump="IF [{}] GOTO {}", first=500, last=999,
    brackets=("[", "]"), less="LT", more="GT", clock_s="#3001/1000",
    head=("%", "O9100", "(CALL: G65 P9100; #5203 IS THE EXTERNAL WORK ZERO OFFSET OF Z IN MM)",
          "(AN OFFSET THAT STANDS IN #5203 ALREADY IS REPLACED)"),
    foot=("M99", "%"),
    alarm=("#3000=101(KERF: BEYOND THE LEARNT RANGE)",),
    offset=("#5203={value}",),
)  # fmt: skip
SIEMENS = Control(
    comment="; {}", variable="R{}", label="KERF{}:", jump="IF {} GOTOF KERF{}", first=100, last=999,
    brackets=("(", ")"), less="<", more=">", clock_s="$AN_POWERON_TIME*60",
    head=("; SUBPROGRAM KERF_COMP.SPF; MD28050 $MC_MM_NUM_R_PARAM MUST REACH ITS LAST R PARAMETER",
          "; SD43900 IS ACTIVE WITH BIT 0 OF MD32750 $MA_TEMP_COMP_TYPE[Z] = 1",
          "; R99 = 1 OR -1: TRY IT WITH A DIAL GAUGE, R99 MUST BE SUCH THAT A POSITIVE VALUE OF",
          "; GROWTH MOVES THE SPINDLE AWAY FROM THE WORKPIECE; ANY OTHER VALUE ENDS IN THE ALARM",
          "IF (R99<>1) AND (R99<>-1) GOTOF KERF900"),
    foot=("M17",),
    alarm=("SETAL(65101)",),
    offset=("$SA_TEMP_COMP_ABS_VALUE[Z]=R99*{value}",),
)  # fmt: skip
CONTROLS = {"fanuc": FANUC, "siemens": SIEMENS}
"""Controls by the kind of file."""
RUNNING, LAST, ELAPSED, GROWTH, SUM, STEP, PART, DECAY, YOUNGER, OLDER = range(10)
"""Places of the text's own variables after the first."""
OWN = 10
"""Number of these [1]."""


def control_lines(done: Written, on: Control) -> Iterator[str]:
    """The correction as text that a control runs: every call works out the offset anew."""
    text = _Text(correction=done.correction, on=on, names=_names(done.correction, on))
    yield from on.head
    for line in _head(done):
        yield on.comment.format(_plain(line, on))
    yield from text.refusals()
    yield from text.clock()
    yield f"{text.own(GROWTH)}=0"
    for number, chain in enumerate(done.correction.chains):
        yield from text.chain(number, chain)
    for constant in sorted({one.lag_s for one in done.correction.starts}):
        yield from text.relaxation(constant)
    if QUANTITY in done.correction.ranges:
        yield text.less(text.own(GROWTH), done.correction.ranges[QUANTITY].low, 900)
        yield text.more(text.own(GROWTH), done.correction.ranges[QUANTITY].high, 900)
    yield on.label.format(300)
    value = text.inside(f"{text.own(GROWTH)}/{_decimal(UM_PER_MM)}")
    yield from (line.format(value=value) for line in on.offset)
    yield on.label.format(400)
    yield on.foot[0]
    yield on.label.format(900)
    yield from on.alarm
    yield from on.foot


@dataclass(frozen=True, kw_only=True)
class _Text:
    correction: Correction
    on: Control
    names: Mapping[str, str]

    def own(self, place: int) -> str:
        return _variable(self.on, place)

    def inside(self, expression: str) -> str:
        return f"{self.on.brackets[0]}{expression}{self.on.brackets[1]}"

    def less(self, left: str, right: float, label: int, *, than: str = "") -> str:
        word = than or self.on.less
        return self.on.jump.format(f"{left}{_spaced(word)}{_decimal(right)}", label)

    def more(self, left: str, right: float, label: int) -> str:
        return self.less(left, right, label, than=self.on.more)

    def refusals(self) -> Iterator[str]:
        """Comments on the inputs, and the alarm where one is out of its range."""
        for each in self.correction.inputs:
            words = (
                f"{self.names[each]} = {each}, {self.correction.ranges[each].unit}, set by the PLC"
            )
            yield self.on.comment.format(_plain(words, self.on))
        yield self.on.comment.format(f"{self.own(RUNNING)} = 0 STARTS ANEW: GROWTH IS ZERO THERE")
        for each in self.correction.inputs:
            yield self.less(self.names[each], self.correction.ranges[each].low, 900)
            yield self.more(self.names[each], self.correction.ranges[each].high, 900)

    def clock(self) -> Iterator[str]:
        """Time since the last call; a restart after a step back or a long pause."""
        own, clock = self.own, self.on.clock_s
        yield f"{own(STEP)}={clock}-{own(LAST)}"
        yield self.less(own(STEP), 0.0, 100)
        yield self.more(own(STEP), LONGEST_CALL * self.correction.period_s, 100)
        yield self.more(own(RUNNING), 0.0, 200)
        yield self.on.label.format(100)
        yield from (f"{own(RUNNING)}=1", f"{own(LAST)}={clock}", f"{own(ELAPSED)}=0",
                    f"{own(GROWTH)}=0")  # fmt: skip
        for each in self.correction.inputs:
            yield f"{self.names[f'start {each}']}={self.names[each]}"
        yield from (f"{where}=0" for key, where in self.names.items() if key.startswith("lag "))
        yield self.more(own(RUNNING), 0.0, 300)
        yield self.on.label.format(200)
        yield self.less(own(STEP), LEAST_CALL_S, 400)
        yield f"{own(LAST)}={own(LAST)}+{own(STEP)}"
        yield f"{own(ELAPSED)}={own(ELAPSED)}+{own(STEP)}"

    def chain(self, number: int, chain: tuple[float, ...]) -> Iterator[str]:
        """Terms with the same lags: their sum, low-passed, added to growth."""
        total = self.own(SUM)
        yield f"{total}=0"
        for term in self.correction.terms:
            if term.lags_s == chain:
                now, start = self.names[term.input], self.names[f"start {term.input}"]
                rise = f"{now}-{start}"
                if term.input == SPEED:
                    rise = self.inside(f"{now}*{now}-{start}*{start}") + "/1000000"
                yield f"{total}={total}+{self.inside(_decimal(term.um))}*{self.inside(rise)}"
        for stage, constant in enumerate(chain):
            yield from self.lagged(f"lag {number} {stage}", constant)
        yield f"{self.own(GROWTH)}={self.own(GROWTH)}+{total}"

    def lagged(self, state: str, constant: float) -> Iterator[str]:
        """A first-order lag of the sum, exact for what runs straight from call to call."""
        own, total = self.own, self.own(SUM)
        before, answer = self.names[f"{state} x"], self.names[f"{state} y"]
        part, decay, younger, older = own(PART), own(DECAY), own(YOUNGER), own(OLDER)
        yield f"{part}={own(STEP)}/{_decimal(constant)}"
        yield f"{decay}=EXP{self.inside(f'0-{part}')}"
        yield f"{younger}=1-{self.inside(f'1-{decay}')}/{part}"
        yield f"{older}=1-{decay}-{younger}"
        yield f"{answer}={decay}*{answer}+{older}*{before}+{younger}*{total}"
        yield f"{before}={total}"
        yield f"{total}={answer}"

    def relaxation(self, constant: float) -> Iterator[str]:
        """Terms of the start with the same lag, added to growth."""
        total = self.own(SUM)
        yield f"{total}=0"
        for one in self.correction.starts:
            if one.lag_s == constant:
                times = "" if one.input == ONE else f"*{self.names[f'start {one.input}']}"
                yield f"{total}={total}+{self.inside(_decimal(one.um))}{times}"
        decay = f"EXP{self.inside(f'0-{self.own(ELAPSED)}/{_decimal(constant)}')}"
        yield f"{self.own(GROWTH)}={self.own(GROWTH)}+{total}*{self.inside(f'1-{decay}')}"


def _variable(on: Control, place: int) -> str:
    return on.variable.format(on.first + place)


def _names(correction: Correction, on: Control) -> dict[str, str]:
    """Variable of each input, of its value at the start, and of each lag."""
    keys = [*correction.inputs, *(f"start {one}" for one in correction.inputs)]
    for number, chain in enumerate(correction.chains):
        keys += [f"lag {number} {stage} {what}" for stage in range(len(chain)) for what in "xy"]
    if on.first + OWN + len(keys) - 1 > on.last:
        raise ValueError(
            f"the correction needs {OWN + len(keys)} variables, the control has "
            f"{on.last - on.first + 1}: use --format csv"
        )
    return {key: _variable(on, OWN + k) for k, key in enumerate(keys)}


def _decimal(value: float) -> str:
    """A number without an exponent, which macros do not read."""
    text = f"{value:.9f}".rstrip("0").rstrip(".")
    return "0" if text in ("", "-0") else text


def _plain(line: str, on: Control) -> str:
    """A comment in letters that every control reads; a percent sign ends a Fanuc's program."""
    line = line.replace("(", "").replace(")", "").replace("%", "percent")
    line = line.encode("ascii", "replace").decode()
    return line.replace("_", " ").upper() if on.comment.startswith("(") else line


def _spaced(word: str) -> str:
    return f" {word} " if word.isalpha() else word
