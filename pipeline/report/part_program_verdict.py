"""What the head of a machine's page says of its optimised programs."""

from pipeline.charts.numbers import NARROW, TOGETHER, counted, number, signed
from pipeline.charts.sources import shown
from pipeline.report.optimise_verdict import AIMS
from pipeline.report.part_program_facts import PartProgram, PartPrograms

WORTH = 1.0  # percent less: below it nobody changes a program that runs
SURE = 0.05  # chance of a load above its limit: with more nobody is told to load a program


def loading_words(found: PartPrograms) -> str:
    """Which optimised programs are worth loading, the greatest gain first; empty without any."""
    worth = sorted(
        (one for one in found.programs if is_worth_loading(one)), key=lambda one: -(one.gain or 0.0)
    )
    if not worth:
        return ""
    first, *rest = worth
    more = f", and {counted(len(rest), 'more program')} below" if rest else ""
    return f"Load {shown(first.program)}: {gain_words(first)} inside its limits{more}."


def is_worth_loading(one: PartProgram) -> bool:
    """Whether it gains enough, is proved, inside its limits, and no trial cut speaks against it."""
    sure = one.proved and not one.overloaded and (one.epsilon or 0.0) <= SURE
    return sure and one.inside and (one.gain or 0.0) >= WORTH


def gain_words(one: PartProgram) -> str:
    """``18 % faster``."""
    _, _, less = AIMS.get(str(one.document.get("objective")), AIMS["time"])
    gain = one.gain or 0.0
    said = number(gain, 2) if gain < 9.95 else f"{gain:.0f}"
    return f"{said}{TOGETHER}% {less}"


def warning_words(found: PartPrograms) -> list[str]:
    """Programs that must not be loaded, and why."""
    said = []
    for one in found.programs:
        cuts = one.cuts()
        if not one.proved:
            said.append(
                f"Do not load {shown(one.program)}: it is not proved to make the same moves."
            )
        elif one.overloaded and cuts is not None:
            said.append(
                f"Do not load {shown(one.program)}: on the simulated shop floor {cuts[0]} of "
                f"{cuts[1]} cuts passed the limit of {number(one.limit)}{NARROW}N."
            )
    return said


def part_key_figures(found: PartPrograms) -> list[tuple[str, str, str]]:
    """By how much all programs together are shorter; nothing without any."""
    seconds = found.seconds
    if seconds is None or not seconds[0]:
        return []
    change = 100 * (seconds[1] / seconds[0] - 1)
    return [("Time of part programs", f"{signed(change)} %",
             f"predicted, of {counted(len(found.programs), 'program')}")]  # fmt: skip


def part_changes(found: PartPrograms) -> dict[str, float | int | None]:
    """What goes into ``report.json``; nothing for a machine without any."""
    if not found.programs:
        return {}
    before, after = found.seconds or (None, None)
    return {"parts": len(found.programs), "parts_before_s": before, "parts_after_s": after}
