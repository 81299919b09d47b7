"""Modal state before a line of a part program, for a restart of the control there."""

from collections.abc import Iterator
from dataclasses import dataclass

from pipeline.gcode.modal import CANCELLED, SIEMENS, g_code
from pipeline.gcode.moves import AXES, INCH, FeedMode, Kind, PathMode
from pipeline.gcode.run import Run

COOLANT = {7: "M7", 8: "M8", 9: "M9", 13: "M13", 14: "M14"}
"""M codes that switch coolant; 13 and 14 of a Fanuc with the spindle."""

LENGTHS = "RZQIJ"
"""Words of a canned cycle that are lengths."""


@dataclass(frozen=True, kw_only=True)
class Restart:
    """The state in force before a line, as words of the program's dialect."""

    line: int
    """Line of the program, the first time that it is reached."""
    words: dict[str, str]
    """State in force, by its name."""
    program: tuple[float, ...]
    machine: tuple[float, ...]
    """X Y Z A B C in program and in machine coordinates [mm, deg], lengths of ``program`` in the
    program's unit."""
    warnings: tuple[str, ...] = ()
    """Reasons why the program cannot simply go on from here."""


def restart_of(run: Run, line: int, *, inside: bool, modal: str = "") -> Restart:
    """State in force before a line, ``inside`` a subprogram or not; ``modal``: cycle of MCALL."""
    state = run.state
    return Restart(
        line=line,
        words=dict(_words(run)),
        program=tuple(
            round(value / (state.unit if axis < 3 else 1.0), 6)
            for axis, value in enumerate(run.point)
        ),
        machine=tuple(round(value, 6) for value in state.position),
        warnings=tuple(_warnings(run, inside, modal)),
    )


def _words(run: Run) -> Iterator[tuple[str, str]]:
    state = run.state
    siemens, inch = state.dialect == SIEMENS, state.unit == INCH
    metric, imperial = ("G71", "G70") if siemens else ("G21", "G20")
    yield "units", f"{imperial} (inch)" if inch else f"{metric} (mm)"
    yield "plane", f"G{state.plane}"
    yield "distance mode", "G90" if state.absolute else "G91"
    yield "work offset", list(run.frames)[state.frame].name
    yield "tool", "none yet" if state.tool < 0 else f"T{state.tool}"
    if state.selected >= 0 and state.selected != state.tool:
        yield "next tool", f"T{state.selected}"
    length = f" H{run.length_number}" if run.length_number and run.length_mode != 490 else ""
    yield "tool length", f"{g_code(run.length_mode)}{length}"
    radius = f" D{run.radius_number}" if state.compensation and run.radius_number else ""
    yield "cutter radius", f"G{state.compensation or 40}{radius}"
    turning = {1: "M3", -1: "M4"}.get(state.direction, "M5")
    surface = "G96 " if state.constant_surface_speed else ""
    yield "spindle", f"{surface}S{state.speed:g} {turning}"
    feed = state.feed if state.feed_mode == FeedMode.INVERSE_TIME else state.feed / state.unit
    yield "feed", f"G{state.feed_mode} F{feed:g}"
    yield "coolant", _coolant(run)
    yield "path", "G64" if state.path_mode == PathMode.CONTINUOUS else "G61"
    if run.cycle.code != CANCELLED:
        words = " ".join(
            f"{letter}{value / (state.unit if letter in LENGTHS else 1.0):g}"
            for letter, value in run.cycle.words.items()
        )
        yield "cycle", f"{g_code(run.cycle.code)} {'G99' if run.retract_to_r else 'G98'} {words}"
    elif state.motion != CANCELLED:
        yield "motion", g_code(state.motion)


def _coolant(run: Run) -> str:
    rows = run.rows.arrays
    found: set[str] = set()
    kinds, codes = rows["kind"][: run.rows.count], rows["code"][: run.rows.count]
    for code in codes[kinds == Kind.M_CODE].tolist():
        if code == 9:
            found.clear()
        elif code in COOLANT:
            found.add(COOLANT[code])
    return " ".join(sorted(found)) or "M9"


def _warnings(run: Run, inside: bool, modal: str) -> Iterator[str]:
    if run.state.compensation:
        yield "cutter radius compensation is on: restart before the line that begins it"
    if run.cycle.code != CANCELLED:
        yield "a canned cycle is in force: give all of its words again"
    if modal:
        yield f"MCALL {modal} is in force: call it again with its values"
    if run.modal_call is not None:
        yield "a modal macro call is in force: restart before it"
    if not run.state.absolute:
        yield "G91 is in force: move to the position in G90 first"
    if inside:
        yield "the line stands in a subprogram: its caller is not returned to from here"


def restart_lines(restart: Restart) -> Iterator[str]:
    """The state in words, a line of text each."""
    for warning in restart.warnings:
        yield f"warning: {warning}"
    yield f"in force before line {restart.line}:"
    for name, words in restart.words.items():
        yield f"  {name:<16} {words}"
    for name, point in (("position", restart.program), ("machine position", restart.machine)):
        moved = [(a, v) for i, (a, v) in enumerate(zip(AXES, point, strict=True)) if i < 3 or v]
        unit = " (mm)" if name != "position" else ""
        yield f"  {name:<16} {' '.join(f'{axis}{value:g}' for axis, value in moved)}{unit}"
