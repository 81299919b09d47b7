"""Actions from a machine's records and models, as rows of one table on the lead's page."""

from collections.abc import Iterator
from typing import get_args

from pipeline.charts.sections import Action, Role
from pipeline.charts.sources import shown
from pipeline.report.facts import MachineFacts, already
from pipeline.report.folders import RECORDS, evidence_page, link
from pipeline.report.optimised.tables import AIMS
from pipeline.report.part_programs import PartProgram, loadable, refused
from pipeline.report.scorecard import counting_figure
from pipeline.report.states import NOW, ActionRow
from pipeline.report.submodel_pages import ModelledPart
from pipeline.report.texts import Texts
from pipeline.schema.days import day_of

STOP, REPORT, USE, OPEN = "stop", "report", "use", "open"
"""Deadlines beside :data:`NOW`, by their key in the texts."""
RECURS_DAYS = 3
"""Days below which an alarm does not recur."""
ORDER: tuple[str, ...] = get_args(Role)
"""Readers of the table, those at the machine first."""


def machine_actions(
    facts: MachineFacts, grave: list[tuple[str, str]], trusted: bool, say: Texts
) -> list[ActionRow]:
    """Everything that is to be done about a machine, what is urgent first.

    ``grave`` are faults that make its judgement doubtful, each with what mends it; only of a twin
    that is ``trusted`` as a whole optimised programs are proposed.
    """
    rows = [
        *_alarms(facts, say), *_sensors(facts, say), *_of_submodels(facts, say),
        *_records(facts, grave, say), *_models(facts, say), *_programs(facts, trusted, say),
    ]  # fmt: skip
    rows.sort(key=lambda row: (row.action.until != NOW, ORDER.index(row.action.who)))
    return [*_absent(facts, say), *rows]


def _absent(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Data items that the machine's file names and no record has."""
    for item, like in facts.absent.items():
        why = say("action.absent_none")
        if like:
            why = say("action.absent_like", items=say.joined(like))
        yield ActionRow(
            action=Action(what=say("action.absent"), where=item, why=why, until=NOW,
                          who="process engineer"),
            href=link(facts.folders.name, RECORDS, "records"),
        )  # fmt: skip


def _alarms(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    for same in facts.alarms.kinds:
        last = same[-1]
        if any(one.ended == "open" for one in same):
            why = say(
                "action.clear_why", alarm=last.text or last.item, moment=say.moment(last.start)
            )
            clear = say(f"action.clear_{'fault' if last.level == 'fault' else 'warning'}")
            yield ActionRow(
                action=Action(what=clear, where=last.where or last.item, why=why, until=NOW,
                              who="maintenance"),
                href="#alarms",
            )  # fmt: skip
            continue
        days = {day_of(one.start, facts.work.time_zone) for one in same}
        worked = len(facts.work.worked_days)
        if len(days) >= RECURS_DAYS and len(days) > worked / 2:
            why = say("action.recurs_why", alarm=last.text or last.item, count=len(same),
                      days=len(days), all=worked, moment=say.moment(last.start))  # fmt: skip
            yield ActionRow(
                action=Action(what=say("action.recurs"), where=last.where or last.item, why=why,
                              until=STOP, who="maintenance"),
                href="#alarms",
            )  # fmt: skip


def _sensors(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Data items whose values cleaning had to remove so often that the sensor is in doubt."""
    days = max(1, len(facts.work.worked_days))
    for one in facts.doubtful_items:
        words = say(f"rule.{one.rule}") if say.has(f"rule.{one.rule}") else one.rule
        a_day, last = say.number(round(one.count / days)), say.moment(one.last)
        why = say("action.sensor_why", count=one.count, rule=words, a_day=a_day, moment=last)
        where = f"{one.where} ({one.item})" if one.where else one.item
        yield ActionRow(
            action=Action(what=say("action.sensor"), where=where, why=why, until=STOP,
                          who="maintenance"),
            href=link(facts.folders.name, RECORDS, "records"),
        )  # fmt: skip


def _of_submodels(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Actions of the sub-models, and those that may not be used as they are."""
    machine = facts.folders.name
    for one in facts.models:
        keys = {section.key for section in one.page.sections}
        for action in one.page.actions:
            at = action.evidence if action.evidence in keys else ""
            yield ActionRow(
                action=action, href=link(machine, one.name, at), english=("what", "why")
            )
        verdict = one.page.verdict
        if verdict is not None and verdict.status != "passed":
            why, own = _why(one, say)
            action = Action(
                what=verdict.todo.rstrip("."),
                where=say("where.twin_of", title=say.given(one.title)), why=why,
                until=USE, who="ML engineer",
            )  # fmt: skip
            english = ("what",) if own else ("what", "why")
            yield ActionRow(action=action, href=link(machine, one.name), english=english)


def _why(one: ModelledPart, say: Texts) -> tuple[str, bool]:
    """Key figure beyond its limit, or the verdict's first sentence; True for the page's words."""
    figure, verdict = counting_figure(one, say), one.page.verdict
    if verdict is None or verdict.status != "failed" or not figure.passed_limit:
        first, _, rest = ("" if verdict is None else verdict.sentence).partition(". ")
        return (f"{first}." if rest else first), False
    what = f"{figure.what[:1].upper()}{figure.what[1:]}"
    return say("action.beyond", figure=what, value=figure.value, limit=figure.limit), True


def _records(facts: MachineFacts, grave: list[tuple[str, str]], say: Texts) -> Iterator[ActionRow]:
    """Defects of the records themselves."""
    records = link(facts.folders.name, RECORDS, "records")
    for why, what in grave:
        yield _data(what, say("where.records"), why, NOW, records)
    silent, log = facts.silence, say("where.log")
    if silent is not None:
        why = say("action.silent_why", duration=say.duration(silent))
        yield _data(say("action.silent"), log, why, REPORT, "#last-records")
    if facts.work.surprising_days:
        why = say("action.logger_why", days=say.day_list(facts.work.surprising_days))
        yield _data(say("action.logger"), log, why, STOP, records)


def _data(what: str, where: str, why: str, until: str, href: str) -> ActionRow:
    action = Action(what=what, where=where, why=why, until=until, who="data engineer")
    return ActionRow(action=action, href=href)


def _models(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """A champion that is not the latest; nothing that was judged at all."""
    name = facts.folders.name
    if facts.serving is not None and facts.serving.older:
        titles = facts.titles(facts.serving.older, say.given)
        yield ActionRow(
            action=Action(
                what=say("action.champion"), where=say("where.champion"),
                why=say("action.champion_why", titles=titles), until=OPEN, who="ML engineer",
            ),
            href=link(name, RECORDS, "provenance"),
        )  # fmt: skip
    if any(one.page.verdict is not None for one in facts.models):
        return
    if facts.records.files is None:
        yield _data(say("action.first_records"), say("where.records"), say("twin.nothing_read"),
                    NOW, evidence_page(name, RECORDS))  # fmt: skip
    elif facts.known:
        yield _data(say("action.repro"), say("where.twin"), say("action.repro_why"), USE, "")
    nearest = sorted(facts.folders.missing, key=lambda one: -len(already(one[1], facts.logged)))
    for what, record in nearest[:1]:
        held, wanted = already(record, facts.logged), say.given(record.rstrip("."))
        ask, why = say("action.record", record=wanted), say("action.record_why")
        if held:
            ask = say("action.record_rest", record=wanted)
            why = say("action.record_why_logged", signals=say.joined(held))
        yield _data(ask, say("where.twin_of", title=say.given(what)), why, OPEN,
                    link(name, RECORDS, "missing"))  # fmt: skip


def _programs(facts: MachineFacts, trusted: bool, say: Texts) -> Iterator[ActionRow]:
    """Optimised programs that gain something, and those that must not be loaded."""
    rows = [(one, "action.refuse", refusal(one, say), NOW) for one in refused(facts.parts)]
    if trusted:
        rows += [
            (one, "action.review", gain(one, say), OPEN) for one in loadable(facts.parts)
        ]  # fmt: skip
    for one, what, why, until in rows:
        where = say("where.program", label=one.label)
        yield ActionRow(
            action=Action(what=say(what, program=shown(one.program)), where=where, why=why,
                          until=until, who="process engineer"),
            href=facts.program_files[one.label],
        )  # fmt: skip


COEFFICIENTS = "coefficients"
"""Beginning of the uncertain quantities whose source is another's measurement or a catalogue."""
OWN = "identified on this machine"
"""Source of coefficients that the machine's own recordings give."""
FORCES = "cutting"
"""Sub-model of the forces."""
WHOLE_FROM = 9.95
"""Gain [%] from which it is written without decimals."""


def gain(one: PartProgram, say: Texts) -> str:
    """Savings of an optimised program, its requirements, and their basis."""
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
    change = one.gain or 0.0
    percent = say.number(change, 2) if change < WHOLE_FROM else f"{change:.0f}"
    aim = one.part.objective if one.part.objective in AIMS else "time"
    return say(f"gain.{aim}", percent=percent)


def _forces(one: PartProgram, say: Texts) -> list[str]:
    """Source of the forces behind the loads; nothing where the document does not name it."""
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
