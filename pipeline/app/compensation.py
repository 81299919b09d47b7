"""Correction of spindle growth as a file for a control: a table, or text that the control runs.

``csv`` is the table itself.  ``fanuc`` is a custom macro that shifts the external work zero point
along Z (variable #5203; #3001 is a clock in ms, #3000 an alarm: Fanuc 0i-F operator's manual
B-64694EN, 16.2 "System variables").  ``siemens`` is a subprogram that writes the position-independent
temperature compensation value (SD43900 $SA_TEMP_COMP_ABS_VALUE, active with bit 0 of MD32750
$MA_TEMP_COMP_TYPE, its rate limited by MD32760: SINUMERIK 840D sl Function Manual Extended Functions,
6FC5397-1BP40-3BA1, K3 "Compensations", 4.2 "Temperature compensation").  Neither maker has a public
format of a table of temperatures, so both are programs.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pipeline.app.fleet import DATA, machine_parameters
from pipeline.app.programs import model_folder
from pipeline.parameters import structure
from pipeline.schema.files import replacing
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.submodels.cases import Records
from pipeline.submodels.contract import sections
from pipeline.submodels.deformation.correction import ONE, Correction, correction
from pipeline.submodels.deformation.model import GrowthModel, load_growth_model
from pipeline.submodels.deformation.records import SPEED
from pipeline.submodels.deformation.submodel import SUBMODEL

FORMATS = ("csv", "fanuc", "siemens")
"""Kinds of file."""
UM_PER_MM = 1000.0
"""Micrometres of a millimetre [1]."""
LEAST_CALL_S = 1.0
"""Time between two calls below which a control's text does nothing [s]."""
LONGEST_CALL = 5
"""Periods between two calls from which a control's text starts anew [1]."""


@dataclass(frozen=True, kw_only=True)
class Written:
    """A correction that was written, with what its file rests on.

    Parameters
    ----------
    machine, origin : str
        Whose; where the machine's records come from.
    method : str
        That serves, for a person.
    status : str
        Of its verdict.
    found : Correction
        The correction.
    models : Path
        Folder of the model.
    """

    machine: str
    origin: str
    method: str
    status: str
    found: Correction
    models: Path

    @property
    def simulated(self) -> str:
        """Label of what rests on simulated records, with a blank before it."""
        return " (simulated)" if self.origin == "simulated" else ""


def write_compensation(
    machine: str, out: Path, kind: str = "csv", model: str = "champion", *, anyway: bool = False
) -> Written:
    """Write the correction of a machine's spindle growth; what was written.

    Parameters
    ----------
    machine : str
        As in conf/machine/.
    out : Path
        File to write, whole or not at all.
    kind : {"csv", "fanuc", "siemens"}
        Of the file.
    model : {"champion", "latest"}
        Whose model.
    anyway : bool
        Even when the model failed or was not judged.

    Raises
    ------
    ValueError
        When the machine, its model or the kind is not known, the model failed or was not judged, or
        its recordings are not there.
    """
    if kind not in FORMATS:
        raise ValueError(f"--format {kind} is not known: name csv, fanuc or siemens")
    parameters = machine_parameters(machine)
    folder = model_folder(machine, model) / SUBMODEL.name
    if not (folder / "model.json").exists():
        raise ValueError(f"{folder} holds no model: {machine} needs {SUBMODEL.needs}")
    growth = load_growth_model(folder)
    status = _judged(folder, anyway=anyway)
    file = growth.file
    done = Written(
        machine=machine, origin=file.origin, method=file.compared[file.champion].label,
        status=status, found=correction(growth, _training(machine, parameters, growth)),
        models=folder,
    )  # fmt: skip
    lines = {"csv": table_lines, "fanuc": partial(control_lines, on=FANUC),
             "siemens": partial(control_lines, on=SIEMENS)}[kind](done)  # fmt: skip
    with replacing(out) as part:
        part.write_text("\n".join(lines) + "\n", encoding="ascii", errors="replace")
    return done


def _judged(folder: Path, *, anyway: bool) -> str:
    """Status of the verdict beside a model; refused where it did not pass, unless ``anyway``."""
    path = folder / "verdict.json"
    verdict = read_json(path, Verdict) if path.exists() else None
    status = "not judged" if verdict is None else verdict.status
    if status != "passed" and not anyway:
        why = f" ({verdict.reasons[0]})" if verdict is not None and verdict.reasons else ""
        raise ValueError(
            f"the growth model in {folder} {'failed' if status == 'failed' else 'was not judged'}"
            f"{why}: mend that first, or write its correction with --anyway"
        )
    return status


def _training(machine: str, parameters: dict, growth: GrowthModel) -> list:  # type: ignore[type-arg]
    """States of the recordings that the model learnt from."""
    wanted = sections(SUBMODEL.judging)
    own = parameters["machine"][machine]
    settings = SUBMODEL.judging(**{
        name: structure(own if name in own else parameters, name, kind)
        for name, kind in wanted.items()
    })  # fmt: skip
    learnt = {one.case for one in growth.file.trained_on}
    cases = SUBMODEL.cases(Records(signals=DATA / "signals" / machine), settings).cases
    return [one.load().state for one in cases if one.name in learnt]


def said(done: Written, out: Path, kind: str) -> Iterator[str]:
    """What ``kerf compensation`` says."""
    found = done.found
    below, above = found.interval_um
    yield f"{done.machine}{done.simulated}: growth by {done.method}"
    if "champion" not in done.models.parts:
        yield f"with {done.models.parent.as_posix()}, not with the champion"
    if done.status != "passed":
        yield f"WARNING: the growth model {'failed' if done.status == 'failed' else 'was not judged'}"
    yield "the offset to add along +Z, away from the workpiece, is +growth"
    yield (
        f"{'exact' if found.exact else 'linearised'}: at most {found.largest_um:.2g} um from the "
        f"model over {found.recordings} training recordings, growth {found.growth_um[0]:.0f} to "
        f"{found.growth_um[1]:.0f} um"
    )
    yield f"90 % interval of the growth: -{below:.1f} to +{above:.1f} um"
    for name in found.inputs:
        one = found.ranges[name]
        yield f"  {name:<22} {one.low:>8g} to {one.high:<8g} {one.unit}"
    yield f"wrote {len(found.terms) + len(found.starts)} terms to {out} ({kind})"


# ---- the table


def _head(done: Written) -> Iterator[str]:
    """What every file says before its content, in whole lines."""
    found = done.found
    below, above = found.interval_um
    yield f"Kerf: correction of spindle growth, {done.machine}{done.simulated}"
    yield f"Method: {done.method}; verdict: {done.status}"
    yield "Offset to add along +Z (away from the workpiece, ISO 841) = +growth since the start"
    yield (
        f"{'Exact but for rounding' if found.exact else 'Linearised'}: at most "
        f"{found.largest_um:.3g} um from the model ({found.rmse_um:.3g} um RMS) over "
        f"{found.recordings} training recordings"
    )
    yield f"Growth learnt: {found.growth_um[0]:.1f} to {found.growth_um[1]:.1f} um"
    yield f"90 % interval of growth: -{below:.2f} to +{above:.2f} um, the difference included"
    yield f"Call or row every {found.period_s:g} s; growth counts from the first"
    yield "It holds for sound sensors inside these ranges only:"
    for name in found.inputs:
        one = found.ranges[name]
        yield f"  {name}: {one.low:g} to {one.high:g} {one.unit}"


def table_lines(done: Written) -> Iterator[str]:
    """The correction as CSV: a row a term.

    growth = sum of um x (input - input at the start), low-passed by the lags, for rows ``rise``
    (``speed``: the square of the speed in 1000 rev/min), plus um x input at the start x
    (1 - exp(-t / first lag)) for rows ``start``.
    """
    found = done.found
    for line in _head(done):
        yield f"# {line}"
    yield "# growth [um] = sum of um_per_unit * (input - input at start) low-passed by first_lag_s"
    yield "#   and second_lag_s (0: none), rows rise; of spindle_speed: (speed / 1000 rev/min)^2"
    yield "# + sum of um_per_unit * input at start * (1 - exp(-t / first_lag_s)), rows start"
    yield "# low-pass: lag y' = x - y, exact for x that runs straight from row to row"
    yield "kind,input,unit,first_lag_s,second_lag_s,um_per_unit,low,high,range_unit"
    for term in found.terms:
        first, second = (*term.lags_s, 0.0, 0.0)[:2]
        one = found.ranges[term.input]
        unit = "(1000 rev/min)^2" if term.input == SPEED else "K"
        yield (f"rise,{term.input},{unit},{first:g},{second:g},{term.um!r},{one.low:g},"
               f"{one.high:g},{one.unit}")  # fmt: skip
    for start in found.starts:
        constant = start.input == ONE
        span = ",,," if constant else (
            f",{found.ranges[start.input].low:g},{found.ranges[start.input].high:g},"
            f"{found.ranges[start.input].unit}"
        )  # fmt: skip
        yield (f"start,{start.input},{'1' if constant else 'degC'},{start.lag_s:g},0,{start.um!r}"
               f"{span}")  # fmt: skip


# ---- text of a control


@dataclass(frozen=True, kw_only=True)
class Control:
    """How a control's text is written.

    Parameters
    ----------
    comment, variable, label, jump : str
        Templates of a comment, a variable by number, a label and a jump to it on a condition.
    first, last : int
        Numbers of the variables that may be used [1].
    brackets : str
        Around an expression.
    less, more : str
        Comparisons.
    clock_s : str
        Expression of a clock [s].
    head, foot, alarm, offset : tuple of str
        Lines before and after; where an input is out of range; that write the offset {value} [mm].
    longest : int
        Letters of a comment [1].
    """

    comment: str
    variable: str
    label: str
    jump: str
    first: int
    last: int
    brackets: str
    less: str
    more: str
    clock_s: str
    head: tuple[str, ...]
    foot: tuple[str, ...]
    alarm: tuple[str, ...]
    offset: tuple[str, ...]


FANUC = Control(
    comment="({})", variable="#{}", label="N{}", jump="IF [{}] GOTO {}", first=500, last=999,
    brackets="[]", less="LT", more="GT", clock_s="#3001/1000",
    head=("%", "O9100", "(CALL: G65 P9100; #5203 IS THE EXTERNAL WORK ZERO POINT OFFSET OF Z IN MM)",
          "(AN OFFSET THAT STANDS IN #5203 ALREADY IS REPLACED)"),
    foot=("M99", "%"),
    alarm=("#3000=101(KERF: BEYOND THE LEARNT RANGE)",),
    offset=("#5203={value}",),
)  # fmt: skip
SIEMENS = Control(
    comment="; {}", variable="R{}", label="KERF{}:", jump="IF {} GOTOF KERF{}", first=100, last=999,
    brackets="()", less="<", more=">", clock_s="$AN_POWERON_TIME*60",
    head=("; SUBPROGRAM KERF_COMP.SPF; MD28050 $MC_MM_NUM_R_PARAM MUST REACH ITS LAST R PARAMETER",
          "; SD43900 IS ACTIVE WITH BIT 0 OF MD32750 $MA_TEMP_COMP_TYPE[Z] = 1",
          "; R99 = 1 OR -1: TRY IT WITH A DIAL GAUGE, R99 MUST BE SUCH THAT A POSITIVE VALUE OF",
          "; GROWTH MOVES THE SPINDLE AWAY FROM THE WORKPIECE; ANY OTHER VALUE ENDS IN THE ALARM",
          "IF (R99<>1) AND (R99<>-1) GOTOF KERF900"),
    foot=("M17",),
    alarm=("SETAL(65101)",),
    offset=("$SA_TEMP_COMP_ABS_VALUE[Z]=R99*{value}",),
)  # fmt: skip
RUNNING, LAST, ELAPSED, GROWTH, SUM, STEP, PART, DECAY, YOUNGER, OLDER = range(10)
"""Places of the text's own variables after the first."""
OWN = 10
"""Number of these [1]."""


def control_lines(done: Written, on: Control) -> Iterator[str]:
    """The correction as text that a control runs: every call works out the offset anew.

    Raises
    ------
    ValueError
        When it needs more variables than the control has.
    """
    found, name = done.found, _names(done.found, on)
    o, c = on.brackets
    var = partial(_variable, on)
    yield from on.head
    for line in _head(done):
        yield on.comment.format(_plain(line, on))
    for each in found.inputs:
        unit = found.ranges[each].unit
        yield on.comment.format(_plain(f"{name[each]} = {each}, {unit}, put there by the PLC", on))
    yield on.comment.format(f"{var(RUNNING)} = 0 STARTS ANEW: GROWTH IS ZERO THERE")
    for each in found.inputs:
        low, high = found.ranges[each].low, found.ranges[each].high
        yield on.jump.format(f"{name[each]}{_spaced(on.less)}{_decimal(low)}", 900)
        yield on.jump.format(f"{name[each]}{_spaced(on.more)}{_decimal(high)}", 900)
    yield f"{var(STEP)}={on.clock_s}-{var(LAST)}"
    # a clock that went back, or a long pause: what the lags held is not known any more
    longest = _decimal(LONGEST_CALL * found.period_s)
    yield on.jump.format(f"{var(STEP)}{_spaced(on.less)}0", 100)
    yield on.jump.format(f"{var(STEP)}{_spaced(on.more)}{longest}", 100)
    yield on.jump.format(f"{var(RUNNING)}{_spaced(on.more)}0", 200)
    yield on.label.format(100)
    yield f"{var(RUNNING)}=1"
    yield f"{var(LAST)}={on.clock_s}"
    yield f"{var(ELAPSED)}=0"
    yield f"{var(GROWTH)}=0"
    for each in found.inputs:
        yield f"{name['start ' + each]}={name[each]}"
    for key, variable in name.items():
        if key.startswith("lag "):
            yield f"{variable}=0"
    yield on.jump.format(f"{var(RUNNING)}{_spaced(on.more)}0", 300)
    yield on.label.format(200)
    yield on.jump.format(f"{var(STEP)}{_spaced(on.less)}{_decimal(LEAST_CALL_S)}", 400)
    yield f"{var(LAST)}={var(LAST)}+{var(STEP)}"
    yield f"{var(ELAPSED)}={var(ELAPSED)}+{var(STEP)}"
    yield f"{var(GROWTH)}=0"
    for number, chain in enumerate(found.chains):
        yield f"{var(SUM)}=0"
        for term in found.terms:
            if term.lags_s == chain:
                now, start = name[term.input], name["start " + term.input]
                rise = f"{now}-{start}"
                if term.input == SPEED:
                    rise = f"{o}{now}*{now}-{start}*{start}{c}/1000000"
                yield f"{var(SUM)}={var(SUM)}+{o}{_decimal(term.um)}{c}*{o}{rise}{c}"
        for stage, constant in enumerate(chain):
            yield from _lagged(on, name[f"lag {number} {stage} x"], name[f"lag {number} {stage} y"],
                               constant)  # fmt: skip
        yield f"{var(GROWTH)}={var(GROWTH)}+{var(SUM)}"
    for constant in sorted({one.lag_s for one in found.starts}):
        yield f"{var(SUM)}=0"
        for term in found.starts:
            if term.lag_s == constant:
                times = "" if term.input == ONE else f"*{name['start ' + term.input]}"
                yield f"{var(SUM)}={var(SUM)}+{o}{_decimal(term.um)}{c}{times}"
        decay = f"EXP{o}0-{var(ELAPSED)}/{_decimal(constant)}{c}"
        yield f"{var(GROWTH)}={var(GROWTH)}+{var(SUM)}*{o}1-{decay}{c}"
    yield on.label.format(300)
    for line in on.offset:
        yield line.format(value=f"{o}{var(GROWTH)}/{_decimal(UM_PER_MM)}{c}")
    yield on.label.format(400)
    yield on.foot[0]
    yield on.label.format(900)
    yield from on.alarm
    yield from on.foot


def _lagged(on: Control, before: str, answer: str, constant: float) -> Iterator[str]:
    """A first-order lag of the sum, exact for what runs straight from call to call."""
    o, c = on.brackets
    var = partial(_variable, on)
    yield f"{var(PART)}={var(STEP)}/{_decimal(constant)}"
    yield f"{var(DECAY)}=EXP{o}0-{var(PART)}{c}"
    yield f"{var(YOUNGER)}=1-{o}1-{var(DECAY)}{c}/{var(PART)}"
    yield f"{var(OLDER)}=1-{var(DECAY)}-{var(YOUNGER)}"
    yield f"{answer}={var(DECAY)}*{answer}+{var(OLDER)}*{before}+{var(YOUNGER)}*{var(SUM)}"
    yield f"{before}={var(SUM)}"
    yield f"{var(SUM)}={answer}"


def _variable(on: Control, place: int) -> str:
    return on.variable.format(on.first + place)


def _names(found: Correction, on: Control) -> dict[str, str]:
    """Variable of each input, of its value at the start, and of each lag."""
    keys = [*found.inputs, *(f"start {one}" for one in found.inputs)]
    for number, chain in enumerate(found.chains):
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
    """A comment in letters that every control reads."""
    line = line.upper() if on.comment.startswith("(") else line
    return line.replace("(", "").replace(")", "")


def _spaced(word: str) -> str:
    return f" {word} " if word.isalpha() else word
