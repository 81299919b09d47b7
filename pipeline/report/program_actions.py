"""Why an optimised program is proposed or refused: gain, tool life, speed, origin of its forces."""

from pipeline.report.optimised.tables import AIMS
from pipeline.report.part_programs import PartProgram
from pipeline.report.texts import Texts

COEFFICIENTS = "coefficients"
"""Beginning of the uncertain quantities whose source is another's measurement or a catalogue."""
OWN = "identified on this machine"
"""Source of coefficients that the machine's own recordings give."""
FORCES = "cutting"
"""Sub-model of the forces."""
WHOLE_FROM = 9.95
"""Gain [%] from which it is written without decimals."""


def gain(one: PartProgram, say: Texts) -> str:
    """What an optimised program saves, what it asks for beside it, and what it rests on."""
    beside = []
    before, after = one.part.before.tool_life_share, one.part.after.tool_life_share
    if before and after is not None:
        beside.append(say("gain.life", factor=say.number(after / before, 2)))
    speeds = [(b.speed_before, b.speed_after) for b in one.part.groups]
    raised = [(a, b) for a, b in speeds if a is not None and b is not None and b != a]
    if raised:
        a, b = max(raised, key=lambda pair: abs(pair[1] / pair[0] - 1))
        beside.append(say("gain.speed", before=say.number(round(a)), after=say.number(round(b))))
    said = say("gain.predicted", gain=_less(one, say))
    if beside:
        said = say("gain.predicted_beside", gain=_less(one, say), beside=say.joined(beside))
    doubtful = sum(used.doubtful for used in one.part.verdicts)
    rests = [say("gain.rests", count=doubtful)] if doubtful else []
    return " ".join([said, *_forces(one, say), *rests])


def _less(one: PartProgram, say: Texts) -> str:
    """``18 % less time``."""
    change = one.gain or 0.0
    percent = say.number(change, 2) if change < WHOLE_FROM else f"{change:.0f}"
    aim = one.part.objective if one.part.objective in AIMS else "time"
    return say(f"gain.{aim}", percent=percent)


def _forces(one: PartProgram, say: Texts) -> list[str]:
    """Where the forces behind the loads come from; nothing where the document does not say it."""
    drawn = () if one.part.certainty is None else one.part.certainty.uncertain
    others = [q.source.partition(",")[0] for q in drawn if q.what.startswith(COEFFICIENTS)]
    own = any(q.source == OWN for q in drawn)
    sources = say.joined(list(dict.fromkeys(others)))
    if others:
        return [say(f"gain.forces_{'both' if own else 'others'}", sources=sources)]
    status = next((used.status for used in one.part.verdicts if used.submodel == FORCES), None)
    if own or status not in (None, "not identified"):
        return [say("gain.forces_own")]
    return [] if status is None else [say("gain.forces_assumed")]


def refusal(one: PartProgram, say: Texts) -> str:
    """Why a program must not be loaded."""
    cuts = one.cuts()
    if not one.proved or cuts is None:
        return say("action.not_proved")
    above, of = cuts
    return say("action.overloaded", above=above, cuts=of, limit=say.number(one.limit))
