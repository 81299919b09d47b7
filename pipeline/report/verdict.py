"""State of a machine and of its twin: two lines, actions in one table, further observations.

The twin is what its judge says of its sub-models.  The machine's own condition is another thing: it
is that of its worst component in the newest week of records.
"""

from collections.abc import Iterator
from dataclasses import replace

from pipeline.charts.sections import NOW, Action, PartVerdict, Role
from pipeline.charts.sources import shown
from pipeline.report.components import (
    ComponentState,
    alarm_of,
    component_states,
    condition_since,
    days_of_incident,
    week_incidents,
    weeks_worked,
)
from pipeline.report.drift import drift_actions
from pipeline.report.facts import (
    AT_MACHINE,
    ActionRow,
    MachineFacts,
    MachineVerdict,
    ModelledPart,
    StateLine,
    Status,
    already,
    first_action,
    passed_words,
)
from pipeline.report.folders import RECORDS, evidence_page, link
from pipeline.report.incidents import INCIDENTS
from pipeline.report.optimised.tables import AIMS
from pipeline.report.part_programs import PartProgram, loadable, refused
from pipeline.report.records import WHOLE, Gap
from pipeline.report.scorecard import counting_figure, uses_words
from pipeline.report.texts import ENGLISH, Texts
from pipeline.schema.days import day_of, day_of_text
from pipeline.schema.history import served
from pipeline.schema.incident import Incident

STOP, REPORT, USE, OPEN = "stop", "report", "use", "open"
"""Deadlines beside :data:`NOW`, by their key in the texts."""
DUE = {NOW: 0, STOP: 2, "next stop": 2, REPORT: 3, USE: 4, OPEN: 5}
"""Order of the deadlines; one in minutes of cutting comes after what is due now."""
FORTNIGHT = 14
ENGINEERS: dict[str, Role] = {"cycle_time": "process engineer", "error_budget": "ML engineer"}
"""Who looks at a kind of condition that is not maintenance's."""


def machine_actions(
    facts: MachineFacts, grave: list[tuple[str, str]], trusted: bool, say: Texts
) -> list[ActionRow]:
    """Everything that is to be done about a machine, by risk, then by its deadline.

    ``grave`` are faults that make its judgement doubtful, each with what mends it; only of a twin
    that is ``trusted`` as a whole optimised programs are proposed.
    """
    rows = [
        *_absent(facts, say), *_incidents(facts, say), *_alarms(facts, say),
        *_of_submodels(facts, say), *_conditions(facts, say), *_sensors(facts, say),
        *drift_actions(facts, say), *_records(facts, grave, say), *_models(facts, say),
        *_programs(facts, trusted, say),
    ]  # fmt: skip
    return sorted(rows, key=lambda row: (-row.risk, DUE.get(row.action.until, 1)))


def _absent(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Data items that the machine's file names and no record has."""
    for item, like in facts.absent.items():
        why = say("action.absent_none")
        if like:
            why = say("action.absent_like", items=say.joined(like))
        yield ActionRow(
            action=Action(what=say("action.absent"), where=item, why=why, until=NOW,
                          who="process engineer"),
            href=link(facts.folders.name, RECORDS, "records"), risk=2,
        )  # fmt: skip


def _incidents(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Incidents of the newest week; what a rule holds to be grave is due now."""
    zone = facts.work.time_zone
    for one in week_incidents(facts):
        name = alarm_of(one)
        act, check = one.severity == "act", say.given(one.check.rstrip("."))
        why, what = say("action.incident_why", title=say.given(one.title)), check
        if name is not None:
            often = one.title.partition(" comes again: ")[2]
            why = say("action.incident_why", title=often) if often else why
            what = say("action.recurs", alarm=name, check=f"{check[:1].lower()}{check[1:]}")
        elif one.found:
            why = f"{why} {one.found}."
        yield ActionRow(
            action=Action(what=what, where=one.component.partition(" (")[0], why=why,
                          until=NOW if act and name is None else STOP, who=one.who),
            href=link(facts.folders.name, INCIDENTS, "incidents"),
            english=("what", "why"), risk=2 if act else 1, since=day_of_text(one.start, zone),
            course=() if name is None else _by_day(facts, one),
        )  # fmt: skip


def _by_day(facts: MachineFacts, one: Incident) -> tuple[float, ...]:
    """How often an incident's alarm came on each day of a fortnight up to the newest."""
    happened = days_of_incident(facts, one)
    return tuple(float(happened[day.day]) for day in facts.work.worked_days[-FORTNIGHT:])


def _alarms(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Alarms that are still active at the end of the records."""
    for same in facts.alarms.kinds:
        last, grave = same[-1], same[-1].level == "fault"
        if any(one.ended == "open" for one in same):
            why = say(
                "action.clear_why", alarm=last.text or last.item, moment=say.moment(last.start)
            )
            yield ActionRow(
                action=Action(what=say(f"action.clear_{'fault' if grave else 'warning'}"),
                              where=last.where or last.item, why=why, until=NOW,
                              who="maintenance"),
                href="#alarms", risk=2 if grave else 1,
                since=day_of(last.start, facts.work.time_zone),
            )  # fmt: skip


def _conditions(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Quantities of the newest week that are beyond a line."""
    weeks = weeks_worked(facts)
    newest = next((one for one in facts.weeks if weeks and one.week == weeks[-1]), None)
    for one in () if newest is None else newest.conditions:
        act = one.state == "act"
        line = one.alarm if act else one.alert
        if one.state not in ("act", "watch") or one.value is None or line is None:
            continue
        kept = [{c.key: c.value for c in week.conditions}.get(one.key) for week in facts.weeks]
        sizes = (f"{say.number(size)} {one.unit.removesuffix('1')}" for size in (one.value, line))
        value, limit = (size.replace(" %", "\u202f%").rstrip() for size in sizes)
        name = say("action.line_alarm" if act else "action.line_alert")
        yield ActionRow(
            action=Action(
                what=say("action.condition", what=say.given(one.what)), where=one.component,
                why=say("action.condition_why", value=value, line=name, limit=limit), until=STOP,
                who=ENGINEERS.get(one.kind, "maintenance"),
            ),
            href=link(facts.folders.name, RECORDS, "condition"), risk=2 if act else 1,
            since=condition_since(facts.weeks, one.key, one.state),
            course=tuple(float("nan") if size is None else size for size in kept),
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
            href=link(facts.folders.name, RECORDS, "records"), risk=1,
        )  # fmt: skip


def _of_submodels(facts: MachineFacts, say: Texts) -> Iterator[ActionRow]:
    """Actions of the sub-models, and those that may not be used as they are."""
    machine = facts.folders.name
    for one in facts.models:
        keys = {section.key for section in one.page.sections}
        for action in one.page.actions:
            at = action.evidence if action.evidence in keys else ""
            yield ActionRow(
                action=action, href=link(machine, one.name, at), english=("what", "why"),
                risk=2 if action.until == NOW else 1 if action.who in AT_MACHINE else 0,
            )  # fmt: skip
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
        yield replace(_data(what, say("where.records"), why, NOW, records), risk=2)
    silent, log = facts.silence, say("where.log")
    if silent is not None:
        why = say("action.silent_why", duration=say.duration(silent))
        yield replace(_data(say("action.silent"), log, why, REPORT, "#last-records"), risk=1)
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
        rows += [(one, "action.review", gain(one, say), OPEN) for one in loadable(facts.parts)]
    for one, what, why, until in rows:
        where = say("where.program", label=one.label)
        yield ActionRow(
            action=Action(what=say(what, program=shown(one.program)), where=where, why=why,
                          until=until, who="process engineer"),
            href=facts.program_files[one.label], risk=2 if until == NOW else 0,
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


NOT_PASSED = ("failed", "attention", "unknown")
"""Status of sub-models that the line of the twin names, the gravest first."""
REJECTED_SHARE = 0.01  # of the records: above it a reader or the recording needs a look
NIGHT_S = 4 * 3600.0  # a shorter loss over midnight is not a night switched off
LONG_LOSS_S = 600.0  # a loss of the whole record; shorter ones are in the tables
STOPPED_SHARE = 0.25  # of a day's working time in feed hold or interrupted
WORKED_S = 3600.0  # a day with less work than this says nothing about its stops


BESIDE = frozenset({"synthesis"})
"""Sub-models that no other figure of a machine rests on: they do not decide about the twin."""

Judged = tuple[ModelledPart, PartVerdict]


def machine_verdict(facts: MachineFacts, say: Texts = ENGLISH) -> MachineVerdict:
    """The head of one machine's page, made from its facts alone."""
    grave = _grave(facts, say)
    repaired = [(sentence, repair) for sentence, repair in grave if repair]
    counting, beside = _judged(facts)
    twin = _twin(facts, counting, beside, [sentence for sentence, _ in grave], say)
    actions = machine_actions(facts, repaired, trusted=twin.status == "passed", say=say)
    passed = sum(v.status == "passed" for _, v in [*counting, *beside])
    components = component_states(facts, say)
    condition = _condition(facts, components, say)
    return MachineVerdict(
        condition=condition,
        twin=twin,
        actions=actions,
        passed=(passed, len(counting) + len(beside)) if counting else None,
        read=(*condition.sentences, _first(actions, say), uses_words(facts, say)),
    )


def _condition(facts: MachineFacts, parts: list[ComponentState], say: Texts) -> StateLine:
    """The machine is as its worst component is."""
    names: dict[Status, list[str]] = {
        status: [say(f"component.{one.key}") for one in parts if one.status == status]
        for status in LOOKS
    }
    status: Status = next((one for one in LOOKS if names[one]), "unknown")
    others = {one.status for one in parts if one.key != "sensors"}
    if status == "passed" and others == {"unknown"}:  # readings that are sound say nothing of it
        status, names["passed"] = "unknown", []
    alone = [one for one in parts if one.word == say("component.no_alarm")]
    for one in alone:  # nothing but its alarms was assessed
        names["passed"].remove(say(f"component.{one.key}"))
        names["unknown"].append(say(f"component.{one.key}"))
    acts, watched, fine, rest = map(say.joined, names.values())
    key = "both" if acts and watched else "act" if acts else "watch" if watched else "nothing"
    if key == "nothing" and fine:
        key = "quiet_but" if rest else "quiet"
    said = [say(f"read.{key}", act=acts, watch=watched, fine=fine, rest=rest)]
    if facts.silence is not None:
        said.append(say("condition.silent", duration=say.duration(facts.silence)))
    return StateLine(status=status, word=say(f"condition.{LOOKS[status]}"), sentences=said)


LOOKS: dict[Status, str] = {
    "failed": "act", "attention": "watch", "passed": "quiet", "unknown": "word",
}  # fmt: skip
"""Word of a machine by the worst state of its components."""


def _first(actions: list[ActionRow], say: Texts) -> str:
    """What comes first, in a sentence."""
    if not actions:
        return say("actions.none")
    one = first_action(actions)
    return say("read.first", what=one.action.what.rstrip(".?"), where=one.where(say),
               until=one.until(say), who=one.who(say))  # fmt: skip


def _judged(facts: MachineFacts) -> tuple[list[Judged], list[Judged]]:
    """Sub-models that decide about the twin, and those beside it, with their verdicts."""
    judged = [(one, one.page.verdict) for one in facts.models if one.page.verdict is not None]
    counting = [(one, v) for one, v in judged if one.name not in BESIDE]
    beside = [(one, v) for one, v in judged if one.name in BESIDE]
    return (counting, beside) if counting else (judged, [])


def _twin(
    facts: MachineFacts, counting: list[Judged], beside: list[Judged], grave: list[str], say: Texts
) -> StateLine:
    """Number of trusted sub-models, and those that may not be trusted."""
    if not counting:
        known = "no_verdict" if facts.models else "no_submodel"
        unread = "nothing_read" if facts.records.files is None else known
        return StateLine(
            status="unknown", word=say("twin.not_judged"), sentences=[*grave, say(f"twin.{unread}")]
        )
    rest = [
        say("twin.beside", title=say.title(one.title), verdict=say(f"verdict.{v.status}"))
        for one, v in beside if v.status != "passed"
    ]  # fmt: skip
    return StateLine(
        status=_twin_status([v for _, v in counting], grave),
        word=_twin_word([*counting, *beside], say),
        sentences=[*grave, *_not_passed(counting, say), *rest] or [say("twin.kept")],
    )


def _twin_word(judged: list[Judged], say: Texts) -> str:
    """Number of those in the table that passed; of one alone its verdict."""
    if len(judged) == 1:
        one, verdict = judged[0]
        words = say(f"verdict.{verdict.status}")
        return say("twin.only", title=say.given(one.title), verdict=words)
    passed = sum(v.status == "passed" for _, v in judged)
    return passed_words(passed, len(judged), say)


def _not_passed(counting: list[Judged], say: Texts) -> list[str]:
    """Sub-models that did not pass, as one sentence; none where all passed."""
    words = []
    for status in NOT_PASSED:
        titles = [say.given(one.title) for one, v in counting if v.status == status]
        if titles:
            verdict = say(f"verdict.{status}")
            words.append(say("twin.not_passed", count=len(titles), verdict=verdict,
                             titles=", ".join(titles)))  # fmt: skip
    said = "; ".join(words)
    return [f"{said[:1].upper()}{said[1:]}."] if words else []


def _twin_status(parts: list[PartVerdict], grave: list[str]) -> Status:
    found = {part.status for part in parts}
    if found == {"failed"}:
        return "failed"
    if found == {"unknown"} and not any(part.reserved for part in parts):
        return "unknown"
    return "passed" if found == {"passed"} and not grave else "attention"


def _leaks(facts: MachineFacts) -> dict[str, list[str]]:
    """Records to judge by that a model was also fitted on, by the title of the sub-model."""
    leaks = {one.title: one.leaked(facts.golden) for one in facts.models}
    return {title: files for title, files in leaks.items() if files}


def _grave(facts: MachineFacts, say: Texts) -> list[tuple[str, str]]:
    """Faults that make the verdict itself doubtful, or a whole file worthless, with the remedy."""
    said = [
        (say("grave.leak", title=say.given(title), files=say.some(files)), say("grave.leak_remedy"))
        for title, files in _leaks(facts).items()
    ]
    unreadable = facts.records.unreadable
    if unreadable:
        files = say("files.count", count=len(unreadable))
        said.append((say("grave.unreadable", files=files, names=say.some(unreadable)),
                     say("grave.unreadable_remedy", name=unreadable[0])))  # fmt: skip
    if facts.records.unbalanced:
        names = ", ".join(facts.records.unbalanced[:3])
        said.append((say("grave.unbalanced", names=names), say("grave.fault_remedy")))
    if facts.shelf.broken:
        names = "; ".join(f"{k} ({v})" for k, v in sorted(facts.shelf.broken.items())[:3])
        said.append((say("grave.broken", names=names), say("grave.fault_remedy")))
    if _rejected_much(facts):
        share = say.percent(facts.records.rejected, facts.records.records)
        reasons = facts.records.reasons
        words = say("grave.rejected", share=share)
        if reasons:
            words = say("grave.rejected_why", share=share, reason=reasons[0].reason)
        said.append((words, say("grave.rejected_remedy")))
    return said


def _rejected_much(facts: MachineFacts) -> bool:
    return facts.records.rejected > REJECTED_SHARE * max(1, facts.records.records)


def machine_notes(facts: MachineFacts, say: Texts = ENGLISH) -> list[str]:
    """Further observations, most important first; for the page of the records."""
    doubts = [words for page in facts.pages for words in page.doubts]
    said = [words for page in facts.pages for words in page.notes]
    said += _serving(facts, say)
    lost = [g for g in facts.records.losses if _in_working_time(g, facts.work.time_zone)]
    if lost:
        first, more = lost[0], len(lost) - 1
        said.append(say(
            "note.losses" if more else "note.loss", more if more else None,
            duration=say.duration(first.seconds), moment=say.moment(first.start), cause=first.cause,
        ))  # fmt: skip
    stopped = _stopped_days(facts)
    if stopped:
        share = f"{100 * STOPPED_SHARE:.0f}"
        said.append(say("note.stopped", share=share, days=say.day_list(stopped)))
    return [*doubts, *said]


def _serving(facts: MachineFacts, say: Texts) -> list[str]:
    """Version that serves by its history, and sub-models of it that failed or were not judged."""
    if facts.serving is None:
        return []
    said = []
    for last in served(facts.serving.history)[-1:]:
        key = "note.serves_anyway" if last.anyway else "note.serves"
        said.append(say(key, version=last.version, since=last.at[:10]))
    for status in ("failed", "not decided", "not judged"):
        names = [n for n, one in facts.serving.bundle.submodels.items() if one.status == status]
        if names:
            key = f"note.champion_{status.replace(' ', '_')}"
            said.append(say(key, count=len(names), titles=facts.titles(names, say.given)))
    return said


def _in_working_time(gap: Gap, zone: str) -> bool:
    """Whether a loss of the whole record is more than a night or a weekend switched off."""
    if gap.data_item != WHOLE or gap.seconds < LONG_LOSS_S:
        return False
    return day_of(gap.start, zone) == day_of(gap.end, zone) or gap.seconds < NIGHT_S


def _stopped_days(facts: MachineFacts) -> list[str]:
    return [
        day.day
        for day in facts.work.worked_days
        if (work := day.stopped + day.active) > WORKED_S and day.stopped > STOPPED_SHARE * work
    ]
