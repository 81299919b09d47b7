"""Duties that were proposed are run on the simulated mill, and intervals narrow as promised."""

import json
import re
import sys
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
import yaml
from typer.testing import CliRunner

from pipeline.app.commands import app
from pipeline.parameters import structure
from pipeline.schema.golden import Days
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.si import DAY
from pipeline.schema.store import read_json
from pipeline.schema.verdict import Verdict
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.schedule import Shop, working_day
from pipeline.shop.sensors import air_of_day, ambient_temperature, new_machine, sensed_day
from pipeline.shop.spindle import available_power
from pipeline.shop.timeline import Timeline
from pipeline.stages.compose import composed
from pipeline.stages.identify import identify, judge
from pipeline.submodels.cases import Case, Cases, Roles
from pipeline.submodels.contract import Shown
from pipeline.submodels.spindle.calibration import ForestSettings
from pipeline.submodels.spindle.days import IntervalSettings, SpindleLimits
from pipeline.submodels.spindle.fit import (
    Given,
    Problem,
    SpindleFitSettings,
    solve,
    structure_of,
)
from pipeline.submodels.spindle.submodel import SUBMODEL, Fitting, Judging
from pipeline.thermal.network import SOURCES
from pipeline.twin.spindle import TARGET, SpindleRecords, spindle_stretches
from tests.small_project import ROOT
from tests.submodels.made_pages import made as page_made
from tests.submodels.made_pages import tables
from tests.submodels.spindle.test_submodel import records_of

MACHINE = "mill00"
EXTRA = 4
"""Day on which the recording is made."""
START, WARM_S, HOUR = 6 * 3600, 3600, 3600
RECORDS = SpindleRecords(position_control=True, ambient=True)


@cache
def sections():
    values = yaml.safe_load(composed(ROOT / "conf", ("fleet=demo",)))
    own = f"machine.{MACHINE}"
    about = {
        "identity": structure(values, f"{own}.identity", MachineIdentity), "roles": Roles(),
        "spindle": RECORDS,
    }  # fmt: skip
    fitting = Fitting(
        **about, spindle_interval=IntervalSettings(folds=2),
        spindle_fit=SpindleFitSettings(nodes=(1,), time_constants_s=(1500.0,), compute="serial"),
        residual_forest=ForestSettings(trees=2, depth=3, every_s=3600.0),
    )  # fmt: skip
    return (
        structure(values, f"{own}.shop", ShopParameters), fitting,
        Judging(**about, spindle_limits=SpindleLimits()),
    )  # fmt: skip


def asked_for(sentence, shop):
    """Timeline of a day on which the spindle does what a sentence asks for, from 7:00 on."""
    day = Timeline(day=EXTRA)
    day.on, day.off = START, START + WARM_S + HOUR
    day.power[day.on : day.off] = True
    duty = slice(START + WARM_S, START + WARM_S + 1200)
    speeds = [float(one) for one in re.findall(r"(\d+) rev/min", sentence)]
    load = re.match(r"cut at (\d+) % load", sentence)
    motor = shop.spindle.motor
    if speeds:
        day.speed_command[duty] = np.repeat(speeds, 1200 // len(speeds))
    if load:
        most = float(available_power(np.array(speeds), motor)[0])
        day.cut_power[duty] = float(load[1]) / 100 * most
    if sentence.startswith("hold"):
        day.hold[duty] = True
    if sentence.startswith("stop"):  # warm from work before
        before = slice(START, START + WARM_S)
        day.speed_command[before], day.cut_power[before] = 6000.0, 0.5 * motor.rated_power
    return day


def table_of(day, first, last):
    """State table of seconds of a sensed day, as cleaning leaves it."""
    midnight = pd.Timestamp("2026-01-05", tz="UTC") + pd.Timedelta(days=day.timeline.day)
    rows = slice(first, last)
    frame = pd.DataFrame({
        "spindle_speed": day.numbers["S1n"], "spindle_load": day.numbers["S1load"],
        TARGET: day.numbers["S1temp"], "ambient_temperature": np.round(day.ambient, 1),
        "spindle_position_control": day.timeline.hold.astype(float),
    })  # fmt: skip
    frame.index = midnight + pd.to_timedelta(np.arange(DAY), unit="s")
    return frame.iloc[rows]


def recorded(shop, days, *, most_s=DAY):
    """State tables of the days of a mill, each from its start on."""
    ambient = ambient_temperature(shop)
    machine = new_machine(shop, float(ambient[0]))
    found = []
    for day in days:
        sensed = sensed_day(machine, day, air_of_day(ambient, day.day))
        extra = day.day == EXTRA
        first, length = (START + WARM_S, HOUR) if extra else (day.on, most_s)
        found.append(table_of(sensed, first, min(first + length + 60, day.off + 60)))
    return found


def case_of(table, role):
    name = str(table.index[0].date())
    return Case(name=name, group=name, role=role, files=(), load=lambda: table)


def stretches_of(model, table):
    """Stretches of a state table, as the identification takes them."""
    return list(spindle_stretches(
        table, str(table.index[0].date()), model.records, step=model.fit.step_s, bridge_s=600.0,
        shortest_s=3600.0,
    ))  # fmt: skip


def again(design, model, pieces):
    """The design with the intervals of the same network fitted to ``pieces``."""
    sources = [name for name in design.names if name in SOURCES]
    settings = SpindleFitSettings(step_s=model.fit.step_s)
    problem = Problem(Given(pieces, model.records, settings), sources, structure_of(model.network))
    half = solve(problem, [problem.position(model.network)]).uncertainty.half_width
    scale = np.array([problem.scale.get(name, 1.0) for name in design.names])
    return replace(design, half_widths=half / scale)


def promised_and_reached(folder, seed):
    """Half width now, promised and reached [K] for each candidate of a mill of another seed."""
    shop, fitting, judging = sections()
    shop = replace(shop, seed=seed)
    floor = Shop(parameters=shop, random=shop.generator("schedule"))
    days = [working_day(floor, number) for number in range(3)]
    one, two, judged = recorded(shop, days)
    cases = Cases(cases=tuple(map(case_of, (one, two, judged),
                                  ("training", "training", "held_out"))))  # fmt: skip
    model = SUBMODEL.fit(cases, fitting, folder)
    (design,) = SUBMODEL.designs(model, cases, judging)
    pieces = [piece for table in (one, two) for piece in stretches_of(model, table)]
    known = design.determined
    # the same interval by the same fit, with and without
    base = again(design, model, pieces)
    rows = []
    for candidate in design.candidates:
        duty = asked_for(candidate.record, shop)
        *_, more = recorded(shop, [*days, duty])
        extra = stretches_of(model, more)
        assert len(extra) == 1
        anew = again(design, model, [*pieces, *extra])
        total = np.vstack([design.rows, candidate.rows])
        rows.append((
            candidate.record, base.half_width(known), base.half_width(known, candidate.rows),
            replace(anew, rows=total).half_width(known),
        ))  # fmt: skip
    return rows


SEEDS = range(1, 7)


@pytest.mark.proof
def test_intervals_narrow_on_the_simulated_mill_as_promised(tmp_path):
    """Of six mills: promised and reached half width [K] of each duty, by the same fit."""
    rows = [(seed, *row) for seed in SEEDS for row in promised_and_reached(tmp_path, seed)]
    for seed, words, now, promised, reached in rows:
        said = f"{seed} {words[:44]:44} {now:.3f} {promised:.3f} {reached:.3f} K\n"
        sys.stdout.write(said)
    ratio = np.array([reached / promised for *_, promised, reached in rows])
    assert np.mean((ratio > 1 / 1.5) & (ratio < 1.5)) >= 0.9
    assert 0.9 < np.median(ratio) < 1.2


IDENTITY = MachineIdentity(name="mill", description="a mill", origin="simulated")


def test_page_and_command_say_what_to_record_next(tmp_path, monkeypatch):
    records = records_of(tmp_path / "clean")
    folder = tmp_path / "data/models/mill/spindle"
    roles = Roles(training_days=Days(first="2026-01-05", last="2026-01-07"))
    about = {"identity": IDENTITY, "roles": roles, "spindle": SpindleRecords()}
    fitting = Fitting(
        **about, spindle_interval=IntervalSettings(folds=2),
        spindle_fit=SpindleFitSettings(
            nodes=(1,), time_constants_s=(1500.0,), step_s=60.0, compute="serial"
        ),
        residual_forest=ForestSettings(trees=2, depth=3, every_s=3600.0),
    )  # fmt: skip
    reads = {"manifest": records.manifest, "clean": records.clean}
    identify(SUBMODEL, reads, folder, settings=fitting)
    judging = Judging(**about, spindle_limits=SpindleLimits())
    judge(SUBMODEL, reads, folder, tmp_path, tmp_path / "m.json", tmp_path / "plots",
          settings=judging)  # fmt: skip
    verdict = read_json(folder / "verdict.json", Verdict)
    first = verdict.next_recordings[0]
    assert first.unit == "K"
    assert 0 < first.expected < first.now
    assert first.gain_percent == pytest.approx(100 * (1 - first.expected / first.now), abs=0.5)

    shown = Shown(
        machine="mill", origin="simulated", model=read_json(folder / "model.json", SUBMODEL.model),
        verdict=verdict, predictions=None, folder=folder,
    )  # fmt: skip
    rows = tables(page_made(SUBMODEL, shown))["What to record next"]
    assert [row[0] for row in rows] == [one.record for one in verdict.next_recordings]
    assert f"({first.gain_percent:g} % narrower)" in rows[0][2]

    monkeypatch.chdir(tmp_path)
    (tmp_path / "conf/machine").mkdir(parents=True)
    (tmp_path / "conf/machine/mill.yaml").write_text("")
    done = CliRunner().invoke(app, ["records", "-m", "mill", "--next", "--json", "next.json"])
    assert done.exit_code == 0, done.output
    assert f"spindle: {first.record}" in done.output
    stored = json.loads((tmp_path / "next.json").read_text())
    assert stored["spindle"][0]["gain_percent"] == first.gain_percent
    (folder / "verdict.json").unlink()
    failed = CliRunner().invoke(app, ["records", "-m", "mill", "--next"])
    assert failed.exit_code == 2
    assert "holds no verdict to go by" in failed.output
