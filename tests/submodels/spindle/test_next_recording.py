"""Duties that were proposed are run on the simulated mill, and intervals narrow as promised."""

import re
import sys
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pandas as pd
import pytest
import yaml

from pipeline.parameters import structure
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.si import DAY
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.schedule import Shop, working_day
from pipeline.shop.sensors import air_of_day, ambient_temperature, new_machine, sensed_day
from pipeline.shop.spindle import available_power
from pipeline.shop.timeline import Timeline
from pipeline.stages.compose import composed
from pipeline.submodels.cases import Case, Cases, Roles
from pipeline.submodels.next_recording import by_design
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
