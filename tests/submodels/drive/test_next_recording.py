"""Strokes that were proposed are made on the simulated mill, and intervals narrow as promised."""

import re
import sys
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import yaml

from pipeline.parameters import structure
from pipeline.schema.drive import DriveAxis, DriveModel, FitFacts
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Correlation, Parameter
from pipeline.shop.drives.parameters import RATE
from pipeline.shop.drives.records import (
    Move,
    axis_columns,
    circles,
    reciprocation,
    travel,
)
from pipeline.shop.parameters import ShopParameters
from pipeline.stages.compose import composed
from pipeline.submodels.cases import Cases, Roles
from pipeline.submodels.drive.experiments import axis_designs
from pipeline.submodels.drive.feed_drive import identify_feed_drive
from pipeline.submodels.drive.records import (
    AxisRecord,
    DriveFitSettings,
    DrivePrior,
    DriveRecords,
    Recording,
)
from pipeline.submodels.drive.submodel import Fitting, drive_case
from pipeline.submodels.next_recording import DETERMINES, by_design
from tests.small_project import ROOT

MACHINE, AXIS = "mill00", "Y"


@cache
def sections():
    values = yaml.safe_load(composed(ROOT / "conf", ("fleet=demo",)))
    section = partial(structure, values)
    own = f"machine.{MACHINE}"
    about = {
        "identity": section(f"{own}.identity", MachineIdentity), "roles": Roles(),
        "drive": section(f"{own}.drive", DrivePrior),
        "drive_records": section(f"{own}.drive_records", DriveRecords),
    }  # fmt: skip
    fitting = Fitting(**about, drive_fit=DriveFitSettings(compare=False))
    return section(f"{own}.shop", ShopParameters), fitting


def recorded(shop, command, name, *, trained):
    """A recording of the axis along a command [mm], as the servo's tool gives it."""
    _, fitting = sections()
    drives, random = shop.drives, shop.generator(name)
    shown = [c.values for c in axis_columns(AXIS, drives.axes[AXIS], command, drives.tool, random)]
    reference, position, current = shown
    axis = AxisRecord(
        command=current, position=1e-3 * position, reference=1e-3 * reference,
        constants=fitting.drive.axis(AXIS).resolved({}),
    )  # fmt: skip
    found = Recording(
        name=f"servo/{name}.csv", trained=trained, period=1 / RATE, sha256=name,
        air=np.ones(len(current), bool), axes={AXIS: axis},
    )  # fmt: skip
    return drive_case(found, "training" if trained else "held_out")


def followed(shop, sentence):
    """Commands [mm] of the recordings that a sentence asks for, one a minute."""
    letter, _, speeds, longest, plateau, minutes = re.match(
        r"move (\w) in air (.+?), at ([\d., e+-]+) mm/s, over (\d+) mm or (\d+) s at most, for "
        r"(\d+) minutes", sentence
    ).groups()  # fmt: skip
    assert letter == AXIS
    bounds = getattr(shop.control, AXIS.lower()).bounds
    moves, commands = [], []
    frequency = shop.drives.axes[AXIS].cascade.position_frequency
    strokes = [
        (v, min(float(longest), v * float(plateau) + v**2 / bounds[0]))
        for v in map(float, speeds.split(","))
    ]
    further = shop.drives.axes[AXIS].lead / 3
    while len(commands) < int(minutes):
        moves += [Move(length=s * length, speed=v) for v, length in strokes for s in (1, -1)]
        moves.append(Move(length=further, speed=15.0))
        command = travel(moves, bounds, frequency)
        if command.size > 60 * frequency:
            commands.append(command)
            moves = []
    return commands


def designed(shop, more=()):
    """Design of a mill that made few strokes and some ``more`` recordings."""
    _, fitting = sections()
    limits = getattr(shop.control, AXIS.lower())
    frequency = shop.drives.axes[AXIS].cascade.position_frequency
    own = reciprocation(shop.drives.tool.speeds, limits.rapid / 60, limits.bounds,
                        shop.drives.axes[AXIS].lead)  # fmt: skip
    round_ = circles(80.0, (50.0, 150.0), 1.25, shop.control.path_bounds, frequency)[1]
    cases = Cases(cases=(
        recorded(shop, travel(own, limits.bounds, frequency), "strokes", trained=True),
        *(recorded(shop, one, f"more-{k}", trained=True) for k, one in enumerate(more)),
        recorded(shop, round_ - round_[0], "circle", trained=False),
    ))  # fmt: skip
    trained, judged = ([one.load() for one in cases.of(role)] for role in ("training", "held_out"))
    fit = identify_feed_drive(trained, AXIS, fitting.drive, fitting.drive_fit)
    parameters = {
        name: Parameter.estimated(*three, unit, method="", remedy="", determined=bool(known))
        for name, *three, unit, known in zip(
            fit.names, fit.values, fit.low, fit.high, fit.units, fit.determined, strict=True
        )
    }  # fmt: skip
    axis = DriveAxis(
        command_unit=fit.command_unit, force_unit=fit.force_unit, feed_drive=fit.feed_drive,
        servo=None, constant_level=500.0,
        fit=FitFacts(
            samples=fit.samples, relative_error_percent=None, bandwidth_Hz=fit.bandwidth_Hz,
            delay_s=fit.delay, condition=None, rank=fit.rank, correlation=Correlation(),
        ),
    )  # fmt: skip
    model = DriveModel(
        submodel="drive", machine=MACHINE, origin="simulated", trained_on=(),
        parameters={AXIS: parameters}, axes={AXIS: axis},
    )  # fmt: skip
    (design,) = axis_designs(model, trained, judged)
    return design


SEEDS = range(2)


@pytest.mark.proof
def test_strokes_that_are_proposed_determine_what_others_leave_open():
    """What nothing determined: promised and reached half widths of static friction's part [N]."""
    for seed in SEEDS:
        shop = replace(sections()[0], seed=seed)
        design = designed(shop)
        best = by_design(design)[0]
        assert (best.now, best.method) == (None, DETERMINES)
        assert best.interval.startswith("Y static friction")
        anew = designed(shop, followed(shop, best.record))
        assert anew.determined.all()
        place = design.names.index(best.interval)
        reached = anew.half_widths[place]
        sys.stdout.write(f"{seed} {best.interval}: {best.expected:.2f} {reached:.2f} N\n")
        assert 1 / 1.5 < reached / best.expected < 1.5
        fast = next(one for one in design.candidates if "fast to and fro" in one.record)
        other = designed(shop, followed(shop, fast.record))
        assert not other.determined[place]


@pytest.mark.proof
def test_forces_narrow_as_promised():
    """Where strokes of a minute determine all nine: promised and reached force [N] by strokes."""
    for seed in SEEDS:
        shop = replace(sections()[0], seed=seed)
        slow = followed(shop, by_design(designed(shop))[0].record)[:1]
        design = designed(shop, slow)
        assert design.determined.all()
        now = design.half_width()
        for one in design.candidates:
            promised = design.half_width(one.information)
            anew = designed(shop, [*slow, *followed(shop, one.record)])
            reached = replace(anew, judged=design.judged).half_width()
            sys.stdout.write(
                f"{seed} {one.record[:44]:44} {now:.2f} {promised:.2f} {reached:.2f} N\n"
            )
            assert 1 / 1.2 < reached / promised < 1.2
            assert reached < now
