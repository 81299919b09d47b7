"""The control as a sub-model: what is stored of it, runs and their errors, what is not judged."""

import json
from dataclasses import replace
from hashlib import sha256

import numpy as np
import pandas as pd
import pytest

from pipeline.gcode.moves import Kind
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.model import Band, Condition
from pipeline.schema.store import StoreError, parsed, write_json
from pipeline.signals.cleaning.settings import CleanMachine
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.control.fit import ControlFitSettings, identify_control
from pipeline.submodels.control.submodel import (
    FITTED,
    FROM_SPEEDS,
    NAIVE,
    NOT_DETERMINED,
    OVERRIDE_ONLY,
    SUBMODEL,
    TIME,
    WAIT,
    ControlLimits,
    Fitting,
    Judging,
    naive_times,
    time_bands,
)
from pipeline.submodels.judge import judge, metrics
from pipeline.twin.control import (
    WHOLE,
    ControlModelFile,
    ControlRecords,
    planned_program,
    read_controls,
    time_interval,
)
from tests.submodels.control.part_programs import SETUP, exciting, moves_of, start, truth
from tests.submodels.control.polled_logs import ALONE, ITEMS, Operated, polled_log, write_log

RECORDS = ControlRecords(logs="*.txt", programs="*.nc")
IDENTITY = MachineIdentity(name="mill", origin="simulated")
ROLES = Roles(training=("train*",))
POLLS = 0.3
"""Both ends of a run are seen up to a poll late [s]."""
SHARED = {
    "identity": IDENTITY, "roles": ROLES, "mapping": CleanMachine(signals=ITEMS), "setup": SETUP,
    "control_records": RECORDS, "control_fit": ControlFitSettings(),
}  # fmt: skip


@pytest.fixture(scope="module")
def moves(tmp_path_factory):
    return moves_of(exciting(), tmp_path_factory.mktemp("programs"), "part")


def machine(folder, moves, runs, ran=None):
    """Folders of a machine that ran the program ``part`` as ``runs`` say, by name of the log."""
    raw, signals = folder / "raw", folder / "signals"
    raw.mkdir(parents=True)
    (signals / "observations").mkdir(parents=True)
    (raw / "part.nc").write_text("\n".join(exciting()) + "\n")
    files = {}
    for seed, (name, operated) in enumerate(runs.items()):
        log = polled_log(moves, ran or truth(), np.random.default_rng(seed), operated, begin=1.0)
        output = f"observations/{name}.parquet"
        write_log(log, signals / output)
        digest = sha256(name.encode()).hexdigest()
        files[f"{name}.txt"] = {"output": output, "sha256": digest, "last": None}
    (signals / "manifest.json").write_text(json.dumps({"files": files}))
    return Records(raw=raw, signals=signals)


def model_of(control):
    """A stored model whose control is known."""
    from pipeline.schema.model import Correlation
    from pipeline.twin.control import ControlFitFacts

    fit = ControlFitFacts(rmse_s=0.0, segments=1, condition=1.0, correlation=Correlation())
    return ControlModelFile(
        submodel="control", machine="mill", origin="simulated", parameters={}, trained_on=(),
        control={"": control}, fit=fit, programs={},
    )  # fmt: skip


@pytest.fixture
def judged(moves, tmp_path):
    """The verdict on runs of the program ``part``, by name, under ``control``."""

    def verdict(runs, control=None, ran=None, percent=9.0):
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        records = machine(folder, moves, runs, ran)
        settings = Judging(**SHARED, control_limits=ControlLimits(total_percent=percent))
        model = model_of(control or truth())
        write_json(model, folder / "model.json")
        return judge(
            model, SUBMODEL.load(folder, settings), SUBMODEL.cases(records, settings),
            SUBMODEL.targets(settings, model), sets=None, files=records.files,
        ).verdict  # fmt: skip

    return verdict


def fact(verdict, run, name):
    return next(c for c in verdict.cases if c.case == f"{run}.txt").facts[name].value


def score(verdict, run):
    return next(s for s in verdict.of(TIME, group=f"{run}.txt") if s.regime == WHOLE)


def total(moves, operated=ALONE):
    return planned_program(moves, truth(), operated.overrides(moves)).total


def test_the_true_control_is_right_but_for_polling(judged, moves):
    slower = Operated(feed={0: 60.0})
    found = judged({"train": ALONE, "new": slower})
    for run, operated in (("train", ALONE), ("new", slower)):
        measured = fact(found, run, "measured")
        assert measured == pytest.approx(total(moves, operated), abs=POLLS)
        assert fact(found, run, "predicted") == pytest.approx(total(moves, operated), rel=0.001)
        assert abs(fact(found, run, "error")) < 100 * POLLS / measured + 0.1
    assert (score(found, "train").role, score(found, "new").role) == ("training", "held_out")
    assert found.status == "passed"


def test_types_add_up_to_the_run_and_errors_are_those_of_the_times(judged):
    found = judged({"new": Operated(feed={0: 80.0})})
    measured, predicted = fact(found, "new", "measured"), fact(found, "new", "predicted")
    rounding = 100 * 0.01 / measured + 0.005  # times are rounded to 0.01 s
    error = 100 * (predicted / measured - 1)
    assert fact(found, "new", "error") == pytest.approx(error, abs=rounding)
    assert score(found, "new").mean_percent == pytest.approx(error, abs=rounding)
    types = [s for s in found.of(TIME, group="new.txt") if s.regime != WHOLE]
    # segments begin at the first line that a poll saw
    assert sum(s.bias for s in types) == pytest.approx(predicted - measured, abs=POLLS)


def test_holds_of_the_operator_are_stops_and_no_error(judged, moves):
    found = judged({"new": Operated(holds=((40.0, 12.0), (90.0, 30.0)))})
    assert fact(found, "new", "stops") == pytest.approx(42.0, abs=2 * POLLS)
    assert fact(found, "new", "measured") == pytest.approx(total(moves), abs=3 * POLLS)


def test_waiting_at_m1_beyond_a_moment_is_the_operators(judged, moves):
    """The machine stands 20 s at each M1 where 0.6 s is planned, and the log calls it active."""
    waited = replace(truth(), auxiliary=replace(truth().auxiliary, stop=20.0))
    found = judged({"new": ALONE}, ran=waited)
    many = int((moves.kind == Kind.STOP).sum())
    beyond = 20.0 - truth().auxiliary.stop - WAIT
    assert fact(found, "new", "stops") == pytest.approx(many * beyond, abs=many * 0.1)


def test_a_feed_that_only_the_speeds_tell_is_an_error_without_them(judged):
    found = judged({"new": Operated(feed={0: 50.0})})
    assert fact(found, "new", "feed read from speeds") > 0.5
    assert abs(fact(found, "new", "error")) < 0.3
    assert fact(found, "new", f"error of {OVERRIDE_ONLY}") < -10


def test_simple_estimates_are_far_off(judged):
    found = judged({"new": ALONE})
    assert fact(found, "new", f"error of {NAIVE}") < -40
    assert abs(fact(found, "new", "error")) < 0.5
    assert metrics(found)[f"{TIME}, {WHOLE}"]["skill_mae"][NAIVE] > 0.95


def test_a_naive_time_is_the_path_over_the_feed(moves):
    naive = naive_times(moves, np.full(len(moves), 0.5), 12000.0)
    cut, rapid = moves.kind == Kind.FEED, moves.kind == Kind.RAPID
    np.testing.assert_allclose(naive[cut], moves.length[cut] / (moves.feed[cut] / 120), rtol=1e-12)
    np.testing.assert_allclose(naive[rapid], moves.length[rapid] / 200, rtol=1e-12)
    assert (naive[~cut & ~rapid & (moves.kind != Kind.ARC)] == 0).all()


def test_a_slow_control_fails_and_the_worst_run_decides(judged, moves):
    slow = replace(truth(), auxiliary=replace(truth().auxiliary, tool_change=8.0))
    found = judged({"train": ALONE, "a": ALONE, "b": Operated(feed={0: 40.0})}, control=slow)
    late = 6 * (8.0 - truth().auxiliary.tool_change)
    assert fact(found, "a", "error") == pytest.approx(100 * late / total(moves), abs=0.3)
    assert fact(found, "a", "error") > 9.0 > fact(found, "b", "error") > 0
    assert found.status == "failed"
    assert (score(found, "a").status, score(found, "b").status) == ("failed", "passed")


@pytest.fixture(scope="module")
def fitted(moves, tmp_path_factory):
    """The model of two training runs."""
    folder = tmp_path_factory.mktemp("fitted")
    records = machine(folder, moves, {"train1": ALONE, "train2": ALONE, "new": ALONE})
    settings = Fitting(**SHARED, control=start())
    return SUBMODEL.fit(SUBMODEL.cases(records, settings), settings, folder)


def test_the_model_says_what_it_was_fitted_on_and_by_what_method(fitted):
    assert [case.case for case in fitted.trained_on] == ["train1.txt", "train2.txt"]
    assert fitted.trained_on[0].files[0].sha256 == sha256(b"train1").hexdigest()
    assert set(fitted.programs.values()) == {"part.nc"}
    parameters = fitted.parameters[""]
    for one in parameters.values():
        if one.determined:
            low, high = one.interval_95
            assert low <= one.value <= high
            assert one.method in (FITTED, FROM_SPEEDS)
            assert one.remedy == ""
        else:
            assert (one.value, one.interval_95, one.method) == (None, None, NOT_DETERMINED)
            assert one.remedy.startswith("log ")
    names = [n for n, p in parameters.items() if p.method == FITTED]
    assert list(fitted.fit.correlation.names) == names
    np.testing.assert_array_equal(np.diag(fitted.fit.correlation.values), 1.0)


def test_the_registry_serves_times_by_block(fitted, tmp_path):
    write_json(fitted, tmp_path / "model.json")
    served = SUBMODEL.serve(tmp_path)(SUBMODEL.example(tmp_path))
    assert (served["program"] == 0).all()
    assert served["time"].sum() > 12.0  # 120 mm at 600 mm/min, and corners
    total = served["time"].sum()
    assert served["program_time"].unique() == pytest.approx([total])
    bands = {"whole run": Band(lower=0.02, upper=0.03, n=4, groups=4)}
    feed = {"highest feed": Condition(unit="mm/min", low=300.0, high=500.0)}  # it goes at 600
    for learnt, factor in (({}, 1.0), (feed, 1.5)):
        model = replace(fitted, intervals=bands, conditions=learnt)
        write_json(model, tmp_path / "model.json")
        served = SUBMODEL.serve(tmp_path)(SUBMODEL.example(tmp_path))
        ends = served[["program_time_low", "program_time_high"]].iloc[0].tolist()
        assert ends == pytest.approx(
            [(1 - 0.02 * factor) * total, (1 + 0.03 * factor) * total], abs=2e-3
        )
    lacking = pd.concat([SUBMODEL.example(tmp_path), pd.DataFrame({"program": [None]})])
    with pytest.raises(ValueError, match="program is None in row 2, which is no text"):
        SUBMODEL.answer(tmp_path)(lacking)


@pytest.mark.parametrize("text", [b"", b"[]", b"{}", b"\xff", b'{"control": {}}', b"null"])
def test_another_file_is_no_identified_control(text):
    with pytest.raises(StoreError, match=r"model\.json is (no JSON|not what this version stores)"):
        parsed(text, ControlModelFile, "model.json")


def test_a_file_that_is_not_there_says_what_makes_it(tmp_path):
    with pytest.raises(StoreError, match=r"model\.json does not exist: run `dvc repro`"):
        read_controls(tmp_path / "model.json")


def test_a_time_has_an_interval_by_runs_left_out(fitted, moves):
    """Two runs of one program: each is predicted by a control of the other."""
    whole = fitted.intervals[WHOLE]
    assert (whole.groups, whole.n) == (2, 2)
    assert 0 < whole.upper < 0.02
    plan = planned_program(moves, fitted.control[min(fitted.control)])
    low, high = time_interval(plan, fitted.intervals, fitted.conditions)
    assert low < plan.total < high
    assert low == round(plan.total * (1 - whole.lower), 3)
    slow = {"highest feed": Condition(unit="mm/min", low=0.0, high=float(moves.feed.max()) / 2)}
    low, high = time_interval(plan, fitted.intervals, slow)  # one width of the range beyond it
    assert low == round(plan.total * (1 - 2 * whole.lower), 3)
    assert high == round(plan.total * (1 + 2 * whole.upper), 3)


def test_a_run_that_no_other_can_predict_gives_no_interval(moves, tmp_path):
    records = machine(tmp_path, moves, {"train": ALONE, "train2": Operated(abort=9.0)})
    settings = Fitting(**SHARED, control=start())
    model = SUBMODEL.fit(SUBMODEL.cases(records, settings), settings, tmp_path)
    assert model.intervals == {}
    plan = planned_program(moves, model.control[min(model.control)])
    assert time_interval(plan, model.intervals, model.conditions) is None


def test_programs_are_left_out_whole(moves, tmp_path):
    """Of one whose moves the other has not, the time is as wrong as it then is."""
    records = machine(tmp_path, moves, {"train1": ALONE, "train2": ALONE})
    line = ["G21 G90 G94", "G0 X0 Y0 Z0", *(f"G1 X{9 * (k % 2)} F6000" for k in range(80)), "M30"]
    path = records.raw / "plain.nc"
    path.write_text("\n".join(line) + "\n")
    plain = moves_of(line, tmp_path, "plain")
    log = polled_log(plain, truth(), np.random.default_rng(7), ALONE, begin=1.0)
    write_log(log, records.signals / "observations/train3.parquet")
    manifest = json.loads((records.signals / "manifest.json").read_text())
    manifest["files"]["train3.txt"] = {
        "output": "observations/train3.parquet", "sha256": "ab" * 32, "last": None,
    }  # fmt: skip
    (records.signals / "manifest.json").write_text(json.dumps(manifest))
    settings = Fitting(**SHARED, control=start())
    cases = SUBMODEL.cases(records, settings).of("training")
    runs = {case.name: case.load() for case in cases}
    assert {run.match.program for run in runs.values()} == {"part.nc", "plain.nc"}

    def bands(*names):
        some, settings = [runs[name] for name in names], ControlFitSettings()
        observed = [part for run in some for part in run.observed]
        fit = identify_control(observed, start(), settings)
        return time_bands(some, start(), settings, fit)

    alone, both = bands("train1.txt", "train2.txt"), bands(*runs)
    assert (both[WHOLE].groups, both[WHOLE].n) == (2, 3)
    assert both["rapid"].upper > 3 * alone["rapid"].upper
