"""What the report finds unusual in a machine's files, and what it leaves alone."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pyarrow as pa
import pytest
from page_reader import every_word, section, words
from report_folders import (
    FLEET,
    UTC_NS,
    empty_machine,
    live_table,
    machine,
    nanoseconds,
    parameter,
    reported,
    spindle_model,
    write_alarms,
    write_state,
    write_table,
)

from pipeline.charts.judged import scores_table
from pipeline.charts.sections import PartVerdict, SubModelPage
from pipeline.report.changes import MachineFigures, changes, key_figure
from pipeline.report.components import component_states, days_of_incident
from pipeline.report.facts import machine_facts
from pipeline.report.pages import write_report
from pipeline.report.records import FileRead, RecordsRead
from pipeline.report.scorecard import baseline_words, scorecard, worst_error
from pipeline.report.texts import ENGLISH
from pipeline.report.verdict import machine_actions
from pipeline.report.work import Day, Work
from pipeline.schema.incident import Event, Incident, Monitored, RuleState
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Figures, JudgedCase, Score, Verdict

BLANK = {
    "running": None, "position_control": None, "speed_known": None, "runs": [],
    "speed": np.zeros(288), "held": np.zeros(288),
}  # fmt: skip


def test_the_second_report_says_what_changed(tmp_path):
    folders = machine(tmp_path, "m", days=3)
    write_report([folders], FLEET, None, tmp_path / "one")
    machine(tmp_path, "m", days=4, passed=False)
    write_report([folders], FLEET, tmp_path / "one", tmp_path / "two")
    text = every_word(tmp_path / "two" / "m.html")
    assert "Days with records 3 4 +1" in text
    assert "Error over one hour (MAE) 0.800 K 2.70 K +1.90 K" in text
    assert "New raw files – agent/2024-03-07.txt" in text


def test_an_unchanged_report_is_the_same_bytes(tmp_path):
    folders = machine(tmp_path, "m", days=3)
    write_report([folders], FLEET, None, tmp_path / "out")
    machine(tmp_path, "m", days=4)
    written = []
    for _ in range(2):
        write_report([folders], FLEET, tmp_path / "out", tmp_path / "out")
        written.append({p.name: p.read_bytes() for p in (tmp_path / "out").iterdir()})
    assert "Days with records 3 4 +1" in every_word(tmp_path / "out" / "m.html")
    assert written[0] == written[1]


PROOF = pytest.mark.proof


@pytest.mark.parametrize(
    "content",
    [
        "no json",
        *(pytest.param(one, marks=PROOF) for one in ("[]", '{"format": 99}')),
        '{"format": 1}',
    ],
)
def test_an_earlier_report_that_cannot_be_read_is_said_not_raised(tmp_path, content):
    (tmp_path / "old.json").write_text(content)
    write_report([empty_machine(tmp_path, "m")], FLEET, tmp_path / "old.json", tmp_path / "out")
    assert "nothing is compared" in every_word(tmp_path / "out" / "m.html")


def test_a_model_that_learnt_from_the_golden_week_is_called_out(tmp_path):
    folders = machine(tmp_path, "m")
    leaked = spindle_model(folders, ["2024-03-04", "2024-03-05", "2024-03-06"])
    write_json(leaked, folders.models / "spindle" / "model.json")
    text = reported(tmp_path, folders)
    assert 'id="twin" class="is-attention"' in (tmp_path / "out" / "m.html").read_text()
    said = "the model of the spindle temperature was also fitted on agent/2024-03-06.txt"
    assert f"The judgement is worthless: {said}." in text
    assert "Take the golden records out of the training records" in text


def test_losses_without_a_reason_are_called_out(tmp_path):
    folders = machine(tmp_path, "m")
    path = folders.signals / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["files"]["agent/2024-03-04.txt"]["kept"] = 7
    path.write_text(json.dumps(manifest))
    text = reported(tmp_path, folders)
    assert "Records were lost without a reason in agent/2024-03-04.txt" in text


def test_a_day_without_record_is_a_surprise_only_on_a_weekday_that_works(tmp_path):
    folders = machine(tmp_path, "m", days=11)
    for lost in ("2024-03-09", "2024-03-10", "2024-03-13"):
        (folders.clean / "state" / f"{lost}.parquet").unlink()
    write_report([folders], FLEET, None, tmp_path / "out")
    assert "No record on Wed 13 Mar." in words(tmp_path / "out" / "m.html")


def test_records_of_two_years_are_two_periods_not_a_year_of_missing_days(tmp_path):
    folders = machine(tmp_path, "m", days=4)
    write_state(folders.clean / "state" / "2025-07-07.parquet", "2025-07-07", "O1", "READY", 0)
    text = reported(tmp_path, folders)
    assert "2 separate periods: Mon 4 Mar to Thu 7 Mar 2024; Mon 7 Jul to Mon 7 Jul 2025" in text
    assert "No record on" not in text
    assert "4 Mar 2024" in text.split("Figure")[0].split("no record")[-1]  # years in the figure


def test_a_night_switched_off_is_no_loss_but_an_hour_of_the_day_is(tmp_path):
    folders = machine(tmp_path, "m", days=4)
    start = nanoseconds("2024-03-04") + 19 * 3600 * 10**9
    hours = np.array([11, 1])
    write_table(folders.clean / "gaps.parquet", {
        "data_item": pa.array([None, None], pa.string()), "start": pa.array([start] * 2, UTC_NS),
        "end": pa.array(start + hours * 3600 * 10**9, UTC_NS), "cause": ["silence"] * 2,
    })  # fmt: skip
    text = reported(tmp_path, folders)
    assert "not heard for 1 h 00 min from Mon 4 Mar 2024, 19:00 UTC (silence)." in text


def test_a_sensor_that_often_reads_wrong_is_named(tmp_path):
    folders = machine(tmp_path, "m", days=4)
    write_table(folders.clean / "audit.parquet", {
        "data_item": ["S1temp"] * 400 + ["Xload"] * 9, "rule": ["zero"] * 400 + ["jump"] * 9,
        "time": pa.array(nanoseconds("2024-03-04") + 10**9 * np.arange(409), UTC_NS),
    })  # fmt: skip
    write_table(folders.signals / "data_items.parquet", {
        "data_item": ["S1temp"], "category": ["SAMPLE"], "component": ["Rotary"],
        "component_name": ["C"], "type": ["TEMPERATURE"],
    })  # fmt: skip
    text = reported(tmp_path, folders)
    assert (
        "Rotary C, temperature (S1temp) 400 values were removed (zeros between good values), 100 "
        "on a working day, the last on Mon 4 Mar 2024, 00:06 UTC." in text
    )
    assert "Xload 9 values were removed" not in text


def test_a_sensor_that_reads_right_since_weeks_is_in_doubt_no_more(tmp_path):
    folders = machine(tmp_path, "m", days=4)
    for age, doubted in ((5, 1), (20, 0)):
        last = nanoseconds("2024-03-07") - age * 86_400 * 10**9
        write_table(folders.clean / "audit.parquet", {
            "data_item": ["S1temp"] * 400, "rule": ["zero"] * 400,
            "time": pa.array([last] * 400, UTC_NS),
        })  # fmt: skip
        assert len(machine_facts(folders).doubtful_items) == doubted


def test_alarms_are_counted_by_kind_with_what_is_still_active_first(tmp_path):
    text, page = reported(tmp_path, machine(tmp_path, "m", days=4)), tmp_path / "out" / "m.html"
    assert "The control reported 1 fault and 3 warnings; the longest was 217" in every_word(
        tmp_path / "out" / "m_records.html")  # fmt: skip
    assert "At the end of the records 1 alarm was still active." in text
    rows = section(tmp_path / "out" / "m_records.html", "alarms").partition("<table")[2]
    assert rows.index("62 FOLLOWING ERROR") < rows.index("217 COOLANT LEVEL LOW")
    assert "O1001, line 120" in rows
    week = section(page, "alarms").partition("<table")[2]  # the open one lasts to the end
    assert week.index("62 FOLLOWING ERROR") < week.index("217 COOLANT LEVEL LOW")


def test_a_machine_without_conditions_has_no_section_of_alarms(tmp_path):
    folders = machine(tmp_path, "m", days=4)
    write_alarms(folders, np.zeros(0, dtype=np.int64))
    write_report([folders], FLEET, None, tmp_path / "out")
    assert section(tmp_path / "out" / "m.html", "alarms") == ""
    items = {name: ["servo_c"] for name in ("data_item", "component", "component_name")}
    write_table(folders.signals / "data_items.parquet", items | {
        "category": ["CONDITION"], "type": ["POSITION"]
    })  # fmt: skip
    said = "None of 1 condition was a warning or a fault."
    assert said in reported(tmp_path, folders)


def test_a_sunday_that_ran_for_minutes_once_makes_no_sunday_usual() -> None:
    """Four weeks of working days of 8 h, 0.4 h on the first Sunday, none on the others."""
    days = [
        Day(day=str(d), seconds={"ACTIVE": 8 * 3600.0}, **BLANK)
        for d in np.arange("2026-01-05", "2026-01-31", dtype="datetime64[D]")
        if d.astype(object).weekday() < 5 and str(d) != "2026-01-14"
    ]
    short = Day(day="2026-01-04", seconds={"ACTIVE": 0.4 * 3600}, **BLANK)
    found = Work(folders=None, shelf=None, days=[short, *days], cycles=None, state_files=[])
    assert "2026-01-11" in found.missing_days
    assert found.surprising_days == ["2026-01-14"]


def test_a_data_item_that_no_record_has_stands_first_with_the_names_like_it(tmp_path):
    folders = machine(tmp_path, "m", days=3)
    write_json({"absent": ["Ssped"], "near": {"Ssped": ["Sspeed"]}}, folders.clean / "summary.json")
    text = reported(tmp_path, folders)
    assert "does not exist in any record; called like it: Sspeed." in text


def test_what_is_missing_says_which_signals_are_logged(tmp_path):
    wanted = (("a model of the spindle", "speed, load and temperature of the spindle"),)
    folders = machine(tmp_path, "m", days=3, missing=wanted)
    assert "Logged already: spindle " in reported(tmp_path, folders)


def test_a_table_written_once_is_no_live_source():
    def of(last: str, kept: int) -> FileRead:
        return FileRead(format="csv", first="2024-03-01T00:00:00Z", last=last, kept=kept)

    files = {
        "agent/a.txt": of("2024-03-05T00:00:00Z", 90_000),
        "dynamometer/a.csv": FileRead(
            first="2024-03-20T00:00:00Z", last="2024-03-20T00:10:00Z", kept=99_000
        ),
        "wear/lives.csv": of("2024-03-22T00:00:00Z", 30),
    }
    read = RecordsRead(
        folders=None, shelf=None, files=files, reasons=None, changes=None, gap_causes=None,
        longest_gaps=[], losses=[],
    )  # fmt: skip
    assert read.last.day == 22
    assert read.last_live.day == 5
    assert read.newest == read.last_live < read.last


def test_a_figure_that_is_worse_on_other_records_stands_beside_the_one_that_decides(tmp_path):
    """The twin's free run has no limit and is 1.5 times as far off as its windows of an hour."""
    folders = machine(tmp_path, "m", days=4)
    write_report([folders], FLEET, None, tmp_path / "out")
    page = tmp_path / "out" / "m.html"
    said = "0.900 K of 2 K on Thu 7 Mar (elsewhere up "
    assert f"{said}to 1.20 K free run)" in words(page)


@pytest.mark.parametrize("announced", [True, False])
def test_a_machine_whose_agent_said_unavailable_is_off_and_not_silent(tmp_path, announced):
    folders = machine(tmp_path, "m", days=4)
    live_table(folders, "2024-03-12T00:00:00Z")
    end = machine_facts(folders).work.last
    start = int((end if announced else end - 7200) * 10**9)
    write_table(folders.clean / "gaps.parquet", {
        "data_item": pa.array(["execution"], pa.string()), "start": pa.array([start], UTC_NS),
        "end": pa.array([None], UTC_NS), "cause": ["unavailable"],
    })  # fmt: skip
    facts = machine_facts(folders)
    assert facts.off is announced
    assert (facts.silence is None) is announced
    text = reported(tmp_path, folders)
    assert ("unavailable since then, as its agent said" in text) is announced
    assert ("is silent" in text) is not announced


def monitored(folders, *incidents):
    """The same machine with what monitoring found."""
    path = folders.clean.parent / "incidents.json"
    write_json(Monitored(
        machine=folders.name, origin=folders.origin, days=("2024-03-07",), known_good=(),
        worked_s=1.0, rules={"x_following_error": RuleState(
            limit=2.0, unit="1", assessed_s=60.0, events=0)}, incidents=incidents,
    ), path)  # fmt: skip
    return replace(folders, incidents=path)


def an_incident(severity, component, day, title="Friction rises", rule="x"):
    event = Event(rule=rule, component=component, severity=severity, start=f"{day}T08:00Z",
                  end=f"{day}T08:10Z", value=3.0, limit=2.0, unit="1",
                  words={"alarm": "1281"})  # fmt: skip
    return Incident(
        id=title + day, machine="m", origin="simulated", component=component, title=title,
        severity=severity, check="Look at the guide.", who="maintenance", start=f"{day}T08:00Z",
        end=f"{day}T09:00Z", seconds=60.0, count=1, events=(event,),
    )  # fmt: skip


def test_incidents_of_the_week_are_actions_by_risk_and_states_of_their_component(tmp_path):
    found = monitored(
        machine(tmp_path, "m", days=5),
        an_incident("watch", "Path (motion_c)", "2024-03-05", "Alarm 1281 X AXIS MALF.", "alarm"),
        an_incident("act", "X axis", "2024-03-06"),
        an_incident("act", "spindle drive", "2024-02-20"),  # weeks ago
    )
    facts = machine_facts(found)
    rows = [row for row in machine_actions(facts, [], True, ENGLISH)
            if row.href.endswith("#incidents")]  # fmt: skip
    assert [(row.action.what, row.action.where, row.risk, row.since) for row in rows[:2]] == [
        ("Look at the guide", "X axis", 2, "2024-03-06"),
        ("Find out why 1281 recurs: look at the guide", "Path", 1, "2024-03-05"),
    ]
    assert rows[0].action.until == "now" and not rows[0].engineers
    states = {one.key: one for one in component_states(facts, ENGLISH)}
    assert (states["axes"].status, states["axes"].since) == ("failed", "Wed\xa06\xa0Mar")
    assert states["axes"].why == "Friction rises, and 1 more"
    assert states["spindle"].status != "failed"


def test_a_fault_that_came_once_is_to_be_watched_on_its_component(tmp_path):
    folders = monitored(machine(tmp_path, "m", days=5))
    write_alarms(folders, np.array([nanoseconds("2024-03-05") + 9 * 3600 * 10**9]))
    facts = machine_facts(folders)
    once = replace(facts.alarms.alarms[0], level="fault", item="spindle_c", where="Rotary C",
                   code="53", message="OVERLOAD", ended="normal", end=None)  # fmt: skip
    facts = replace(facts, alarms=replace(facts.alarms, alarms=[once]))
    states = {one.key: one for one in component_states(facts, ENGLISH)}
    assert states["spindle"].status == "attention"
    assert states["spindle"].why.replace("\xa0", " ") == "Fault 53 OVERLOAD: once, Tue 5 Mar"


def test_an_incident_of_alarms_has_the_days_of_its_alarms_and_no_others(tmp_path):
    """It lasts from Monday to Friday, and the alarm came on four of the days."""
    one = an_incident("watch", "coolant_c", "2024-03-04", "Alarm 217 COOLANT LEVEL LOW", "alarm")
    event = replace(one.events[0], words={"alarm": "217 COOLANT LEVEL LOW"})
    one = replace(one, events=(event,))
    folders = machine(tmp_path, "m", days=5)
    facts = machine_facts(monitored(folders, replace(one, end="2024-03-08T09:00Z")))
    seen = [alarm for alarm in facts.alarms.alarms if alarm.code == "217"]
    found = days_of_incident(facts, replace(one, component=seen[0].by))
    assert sum(found.values()) == len(found) == len(seen) == 4
    longer = replace(event, words={"alarm": "1217 COOLANT LEVEL LOW"})  # another code
    assert not days_of_incident(facts, replace(one, component=seen[0].by, events=(longer,)))


def test_a_dead_sensor_is_the_sensors_and_not_the_spindle_that_it_measures(tmp_path):
    title, where = "Temperature sensor of the spindle reports nothing", "spindle temperature"
    found = monitored(machine(tmp_path, "m", days=5),
                      an_incident("act", where, "2024-03-06", title, "sensor_silent"))  # fmt: skip
    states = {one.key: one for one in component_states(machine_facts(found), ENGLISH)}
    assert (states["sensors"].status, states["spindle"].status) == ("failed", "unknown")


def test_sensors_of_a_machine_without_a_log_are_not_fine(tmp_path):
    folders = machine(tmp_path, "m", days=1)
    for path in (folders.clean / "state").iterdir():
        path.unlink()
    states = {one.key: one for one in component_states(machine_facts(folders), ENGLISH)}
    assert states["sensors"].status == "unknown"


def test_an_alarm_that_stands_since_weeks_is_not_worse_than_the_week_before(tmp_path):
    folders = machine(tmp_path, "m", days=10)  # two weeks
    write_alarms(folders, np.array([nanoseconds("2024-03-05")]))
    states = {one.key: one for one in component_states(machine_facts(folders), ENGLISH)}
    where = next(one for one in states.values() if one.status == "failed")
    assert (where.since, where.trend) == ("Tue\xa05\xa0Mar", "same")


@pytest.mark.parametrize(
    ("until", "silent"), [("2024-03-10T06:00:00Z", False), ("2024-03-12T06:00:00Z", True)]
)
def test_a_log_that_ends_on_friday_is_silent_from_the_day_after_monday_on(tmp_path, until, silent):
    folders = machine(tmp_path, "m", days=5)  # Monday to Friday
    live_table(folders, until)
    assert (machine_facts(folders).silence is not None) is silent


def a_score(**parts):
    given = {"mae": 4.0, "rmse": 5.0, "max": 9.0, "bias": 0.1, "limits": {"mae": 8.0}, "unit": "um"}
    return Score(quantity="growth", group="a", regime="", role="held_out", n=9, **given | parts)


def verdict_with(score):
    return Verdict(
        submodel="deformation", machine="m", origin="recorded", status="passed",
        judged_role="held_out", scores=(score,), reasons=(), golden=None,
    )  # fmt: skip


def test_the_best_of_the_baselines_that_are_not_the_model_itself_is_shown():
    same = Figures(mae=4.0, rmse=5.0, max=9.0, bias=0.1)
    others = {"guess": same, "mean": Figures(mae=5.43), "persistence": Figures(mae=4.31)}
    worst = worst_error(verdict_with(a_score(baselines=others)))
    assert worst.baseline == (baseline_words("persistence"), "4.31\xa0µm")
    assert worst_error(verdict_with(a_score(baselines={"guess": same}))).baseline is None
    table = scores_table("scores", [a_score(baselines=others)], [])
    assert "guess" not in {head.group for head in table.heads}


def test_a_share_of_next_to_nothing_is_not_shown():
    def shown(percent):
        one = a_score(relative_percent=percent, limits={"relative_percent": 15.0})
        table = scores_table("scores", [one], [])
        column = [head.name for head in table.heads].index("relative RMSE")
        return str(table.rows[0][column].text)

    assert shown(6.69e8) == "— (of nearly 0)" and shown(45.0) == "45.0"
    limits = {"relative_percent": 15.0}
    lead = worst_error(verdict_with(a_score(relative_percent=6.69e8, limits=limits)))
    assert lead.shown == "more than 1000\xa0% of nearly 0"
    unitless = replace(a_score(), unit="1")
    assert worst_error(verdict_with(unitless)).shown == "4.00"


def test_a_bias_that_is_most_of_the_error_and_a_small_number_of_records_are_said():
    case = JudgedCase(case="a", group="a", role="held_out")

    def line(**parts):
        judged = replace(
            verdict_with(a_score(**parts)), cases=(case, replace(case, case="b", group="b"))
        )
        page = SubModelPage(verdict=PartVerdict(status="passed", sentence="", todo=""))
        one = SimpleNamespace(name="deformation", title="growth", judged=judged, page=page)
        facts = SimpleNamespace(models=[one], serving=None, folders=SimpleNamespace(name="m"))
        return scorecard(facts, ENGLISH)[0]

    assert line(bias=-3.7).figure.worse == "bias −3.70\xa0µm"
    assert line(bias=0.3).figure.worse == ""
    share = {"unit": "1", "mean_percent": 37.0, "limits": {"mean_percent": 20.0}}
    assert line(bias=3.7, **share).figure.worse == "bias +37.0\xa0%"
    assert line().judged_on == "held out, 1"


def test_a_machine_without_a_sub_model_is_asked_for_what_is_logged_already(tmp_path):
    """In a fleet with others: not for the first model by the alphabet, and nothing of a verdict."""
    wanted = (("a model of the drives", "record currents at 1 kHz"),
              ("a model of the spindle", "record spindle speed and load"))  # fmt: skip
    bare = machine(tmp_path, "bare", "recorded", days=4, missing=wanted)
    bare = replace(bare, submodels=(), models=tmp_path / "none", champion=tmp_path / "none")
    write_report([machine(tmp_path, "m", days=4), bare], FLEET, None, tmp_path / "out")
    text = every_word(tmp_path / "out" / "bare.html")
    assert "The fleet names no sub-model of this machine" in text and "verdict.json" not in text
    assert "Record what is not logged yet of record spindle speed and load" in text


def figures(value: float | None, **compared: float) -> MachineFigures:
    return MachineFigures(
        figures={name: key_figure(name, "s", v) for name, v in compared.items()},
        parameters={"wear": {"T1": {"rate": parameter(value, "mm/h")}}},
    )


def test_a_changed_parameter_stands_with_the_note_of_its_submodel():
    note = {"wear": lambda group, name, p, q: f"{group} {name} grew by {q.value / p.value:g}"}
    (change,) = changes(figures(0.2), figures(0.4), note)
    assert (change.what, change.before, change.now) == (
        "Parameter wear T1 rate", "0.200\u00a0mm/h", "0.400\u00a0mm/h"
    )  # fmt: skip
    assert (change.difference, change.note) == ("+0.200\u00a0mm/h", "T1 rate grew by 2")
    assert changes(figures(0.2), figures(0.2), note) == []
    assert changes(figures(0.2), figures(None), note)[0].now == "not known"


def test_counts_change_by_whole_numbers_and_what_was_not_there_was_not_known():
    before, now = figures(0.2, runs=3), figures(0.2, runs=5, new=1.5)
    found = {c.what: (c.before, c.now, c.difference) for c in changes(before, now, {})}
    assert found == {
        "runs": ("3\u00a0s", "5\u00a0s", "+2\u00a0s"),
        "new": ("not known", "1.50\u00a0s", ""),
    }
