"""Pooling with a golden machine: the prior where a record says little, else the record."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from pipeline.app.commands import app
from pipeline.schema.model import Correlation, Parameter
from pipeline.schema.store import read_json, write_json
from pipeline.submodels.spindle.fit import SpindleFitSettings
from pipeline.submodels.spindle.transfer import (
    Transfer,
    TransferPoint,
    TransferSettings,
    first_minutes,
    leader,
    pooled_network,
    transfer,
)
from pipeline.thermal.network import SpindleThermalParameters
from pipeline.twin.spindle import Forest, SpindleFitFacts, SpindleModelFile, SpindleRecords
from tests.small_project import inside, with_conf
from tests.submodels.spindle.spindle_days import ONE, RECORDS, days_of, state_table

SIBLING = SpindleThermalParameters(
    heating={"bearing_friction": 7.5e-7, "copper": 0.065}, cooling_rate=1 / 1100, ambient=25.0
)
"""Another machine of the type: 20 to 25 % and 1 K from :data:`ONE`."""
QUICK = SpindleFitSettings(step_s=60.0, time_constants_s=(1500.0,))
SETTINGS = TransferSettings(minutes=(15.0, 60.0, 1440.0))


def parameter(value: float, unit: str = "1/s") -> Parameter:
    ends = (0.95 * value, 1.05 * value)
    return Parameter(value=value, unit=unit, interval_95=ends, determined=True, method="")


GOLDEN = SpindleModelFile(
    submodel="spindle", machine="golden", origin="simulated",
    parameters={"": {
        "cooling_rate": parameter(ONE.cooling_rate), "ambient": parameter(ONE.ambient, "CELSIUS"),
        **{name: parameter(value) for name, value in ONE.heating.items()},
    }},
    trained_on=(), network=ONE, records=RECORDS, training_days=(),
    fit=SpindleFitFacts(
        step_s=60.0, nodes=1, rmse_K=0.3, rmse_days_left_out_K={}, condition=None,
        correlation=Correlation(), evaluations=1, seconds=0.0, bridged_s=0.0,
    ),
    forest=Forest(used=False, why="", sources=(), extra=(), days=(), examples=0,
                  rmse_days_left_out_K=None, rmse_without_K=None),
)  # fmt: skip


def distance(found: SpindleThermalParameters, truth: SpindleThermalParameters) -> float:
    """Mean absolute logarithm of the parameters' ratio."""
    ratios = [found.cooling_rate / truth.cooling_rate]
    ratios += [found.heating[name] / truth.heating[name] for name in truth.heating]
    return float(np.mean(np.abs(np.log(ratios))))


def pooled(pieces, **how: float) -> SpindleThermalParameters:
    return pooled_network(GOLDEN, pieces, replace(SETTINGS, **how), correlation_s=3600.0)


def test_a_long_record_gives_the_siblings_own_parameters():
    pieces = days_of(SIBLING, 4, 8)
    assert distance(pooled(pieces), SIBLING) < 0.02 < distance(ONE, SIBLING)


def test_a_record_that_shows_nothing_leaves_the_golden_parameters():
    resting = days_of(SIBLING, 4, 1, excited=())
    found = pooled(first_minutes_of_rest(resting))
    assert distance(found, ONE) < 0.01
    assert found.ambient == pytest.approx(SIBLING.ambient, abs=0.2)  # this a rest does show


def first_minutes_of_rest(pieces):
    """A record whose temperature moves to its surround, without any heat."""
    piece = pieces[0]
    frame = piece.frame.assign(spindle_temperature=SIBLING.ambient)
    return [replace(piece, frame=frame)]


def test_machines_that_are_said_to_be_alike_move_less():
    pieces = first_minutes(days_of(SIBLING, 4, 1), 60.0)
    near, far = (pooled(pieces, between_machines=s) for s in (0.01, 0.5))
    assert distance(near, ONE) < distance(far, ONE)


def test_the_first_minutes_begin_with_the_first_start_and_go_on_over_days():
    pieces = days_of(SIBLING, 5, 2, hours=2.0)
    turns = int(np.argmax((pieces[0].frame["bearing_friction"] > 0).to_numpy()))
    (short,) = first_minutes(pieces, 10.0)
    assert len(short.frame) == turns + 10
    both = first_minutes(pieces, 180.0)
    assert [piece.day for piece in both] == [piece.day for piece in pieces]
    assert sum(len(piece.frame) for piece in both) == turns + 180
    with pytest.raises(ValueError, match="never starts on the training days: record a warm-up"):
        first_minutes(days_of(SIBLING, 5, 1, excited=()), 10.0)


def test_the_curve_of_a_sibling_begins_at_the_golden_one_and_ends_below_it():
    days = days_of(SIBLING, 6, 5, noise_K=0.5, whole_degrees=True)
    held = SpindleRecords(position_control=True)
    found = transfer(
        GOLDEN, "sibling", "simulated", days[:3], days[3:], own=held, resolution_K=1.0,
        fitting=QUICK, settings=SETTINGS,
    )  # fmt: skip
    first, *_, last = found.points
    assert last.pooled < 0.3 * last.golden
    assert first.pooled < first.own  # a quarter of an hour alone says too little
    assert {one.golden for one in found.points} == {first.golden}
    assert found.not_transferred == ("position_hold",)
    assert found.days_judged == (days[3].day, days[4].day)
    with pytest.raises(ValueError, match="sibling has no day beside its training days"):
        transfer(
            GOLDEN, "sibling", "simulated", days, [], own=RECORDS, resolution_K=1.0,
            fitting=QUICK, settings=SETTINGS,
        )  # fmt: skip


def points(*rows: tuple[float, float, float]) -> list[TransferPoint]:
    return [
        TransferPoint(minutes=15.0 * (i + 1), pooled=p, own=o, golden=g)
        for i, (p, o, g) in enumerate(rows)
    ]


def test_who_leads_does_so_beyond_the_sensor_and_at_all_longer_records():
    leads = points((2.0, 3.0, 2.5), (1.0, 3.0, 2.5), (1.0, 2.2, 2.5))
    assert leader(leads, 1.0).startswith("From 30 minutes of warm-up on, parameters pooled")
    none = "None of the three leads by more than the sensor's step of 1 K"
    assert leader(points((1.0, 3.0, 2.5), (1.0, 3.0, 1.5), (1.0, 3.0, 2.5)), 1.0).startswith(none)
    # the longest record alone confirms nothing
    assert leader(points((2.0, 2.0, 2.0), (0.1, 3.0, 3.0)), 1.0).startswith(none)


def test_models_of_the_golden_machines_siblings_narrow_and_move_the_prior():
    def sibling(shift: float) -> SpindleModelFile:
        known = GOLDEN.parameters[""]
        rates = {name: parameter(p.value * np.exp(shift)) for name, p in known.items()
                 if name != "ambient" and p.value}  # fmt: skip
        return replace(GOLDEN, machine=f"{shift}", parameters={"": {**known, **rates}})

    few = first_minutes(days_of(SIBLING, 1, 8), 15.0)
    rest = first_minutes_of_rest(days_of(SIBLING, 4, 1, excited=()))
    shifted = [sibling(shift) for shift in (0.19, 0.2, 0.21, 0.2)]

    def found(pieces, siblings) -> SpindleThermalParameters:
        return pooled_network(GOLDEN, pieces, SETTINGS, correlation_s=3600.0, siblings=siblings)

    moved = found(rest, shifted).heating["copper"] / ONE.heating["copper"]
    assert np.log(moved) == pytest.approx(4 / 5 * 0.2, abs=0.04)  # the mean of all five
    same = [sibling(shift) for shift in (0.0, 0.01, -0.01, 0.0)]
    assert distance(found(few, same), ONE) < distance(found(few, ()), ONE)
    result = transfer(
        GOLDEN, "sibling", "simulated", days_of(SIBLING, 1, 8), days_of(SIBLING, 1, 2),
        own=RECORDS, resolution_K=1.0, fitting=QUICK, settings=replace(SETTINGS, minutes=(15.0,)),
        siblings=same[:1],
    )  # fmt: skip
    assert result.siblings == ("0.0",)


def small_transfer(project: Path) -> Path:
    """A project in which ``kerf transfer`` has all that it reads."""
    with_conf(project)
    write_json(GOLDEN, project / "data/models/mill01/spindle/model.json")
    state = project / "data/clean/mill02/state"
    state.mkdir(parents=True)
    files = {}
    for number, day in enumerate(["2026-01-05", "2026-01-06", "2026-01-26"]):
        table = state_table(SIBLING, number, day, 2.0).assign(ambient_temperature=20.0)
        table.reset_index().to_parquet(state / f"{day}.parquet")
        files[f"{day}.txt"] = {"sha256": "0" * 64, "last": f"{day}T16:00:00Z"}
    write_json({"files": files}, project / "data/signals/mill02/manifest.json")
    return project


def test_the_command_writes_the_curve_and_prints_it(tmp_path):
    project = small_transfer(tmp_path / "project")
    words = ["transfer", "-m", "mill02", "--golden", "mill01", "--out"]
    with inside(project):
        done = CliRunner().invoke(app, [*words, "curve.json"])
        same = CliRunner().invoke(
            app, ["transfer", "-m", "mill01", "--golden", "mill01", "--out", "x"]
        )
        none = CliRunner().invoke(
            app, ["transfer", "-m", "mill01", "--golden", "mill02", "--out", "x"]
        )
    assert done.exit_code == 0, done.output
    found = read_json(project / "curve.json", Transfer)
    assert (found.origin, found.days_judged) == ("simulated", ("2026-01-26",))
    assert found.resolution_K == 1.0
    lines = done.stdout.splitlines()
    assert lines[0].startswith("mill02 (simulated) from golden: RMSE over free runs of 1 day not")
    assert f"{found.points[0].pooled:.2f}" in lines[2] and found.sentence in lines
    # a further machine of the golden one's type, of which a model is stored
    write_json(replace(GOLDEN, machine="mill00"), project / "data/models/mill00/spindle/model.json")
    with inside(project):
        done = CliRunner().invoke(app, [*words, "pooled.json"])
    assert "mill02 (simulated) from golden, pooled with mill00:" in done.stdout
    assert read_json(project / "pooled.json", Transfer).points != found.points
    assert same.exit_code == 2 and "name another one" in same.stderr
    assert none.exit_code == 2 and "dvc repro identify_spindle@mill02" in none.stderr
