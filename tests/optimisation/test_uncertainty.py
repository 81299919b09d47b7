"""Spreads of coefficients, runout, depth and model; verdicts and the figures that rest on them."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.app.optimise import optimise_lines
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.optimisation.job import machine_models
from pipeline.optimisation.reliability.part_loads import draws_of
from pipeline.optimisation.reliability.uncertainty import (
    FIGURES,
    NORMAL,
    judged_spread,
    uncertainty,
    used_models,
)
from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.report.optimised.page import optimised_page
from pipeline.schema.cutting import MAGNITUDE, OTHERS, CuttingModel, StoredCutModel, ToolGeometry
from pipeline.schema.drive import FOLLOWING
from pipeline.schema.model import Correlation, Parameter
from pipeline.schema.part import OptimisedPart, part_values
from pipeline.schema.store import StoreError, structured, write_json
from pipeline.schema.verdict import Score, Status, UsedModel, Verdict
from pipeline.twin.cut.coefficients import ToolCoefficients
from tests.optimisation.paper_part import CONTROL
from tests.report import optimise_documents
from tests.submodels.cutting import cutting_files

LAW = ForceLaw.linear(K_tc=700.0, K_rc=200.0, K_ac=100.0, K_te=30.0, K_re=20.0, K_ae=2.0)
MILL = Tool(kind="flat", diameter_mm=12.0, flutes=3)
MANY = 4096
HALF = {"K_tc": 60.0, "K_rc": 80.0, "K_ac": 30.0, "K_te": 6.0, "K_re": 5.0}
NAMES = [*HALF, "K_ae"]


def parameter(value, low, high) -> Parameter:
    known = value is not None
    return Parameter(
        value=value, unit="", interval_95=(low, high) if known else None, determined=known,
        method="",
    )  # fmt: skip


def model() -> CuttingModel:
    """A cut whose K_ae is not determined, and whose K_tc and K_te are known to be opposed."""
    values = dict(zip(NAMES, [700.0, 200.0, 100.0, 30.0, 20.0, None], strict=True))
    rows = {n: parameter(values[n], values[n] - half, values[n] + half) for n, half in HALF.items()}
    rows |= {"K_ae": parameter(None, 0.0, 0.0), "runout": parameter(8.0, 5.0, 12.0)}
    matrix = np.eye(7)
    matrix[1, 4] = matrix[4, 1] = -0.6
    prediction = StoredCutModel(
        tool={}, geometry=ToolGeometry(), values=(7e8, 2e8, 1e8, 3e4, 2e4, 5e3, 0.0, 0.0),
        natural_Hz=None, damping=None, left_out_N2=(),
    )  # fmt: skip
    correlation = Correlation(names=("along", *NAMES), values=tuple(map(tuple, matrix.tolist())))
    stored = cutting_files.model({"": rows})
    return replace(stored, correlation=correlation, prediction=prediction)


def identified(tool=MILL, certainty=None):
    law = ToolCoefficients(law=replace(LAW, K_ae=0.0), kind="identified", source="this machine")
    return uncertainty({1: law}, {1: tool}, model(), None, certainty or ReliabilitySettings())


def others(**kinds: str):
    """Two tools of sources that are named."""
    laws = {
        int(number[1:]): ToolCoefficients(law=LAW, kind="measured", source=source)
        for number, source in kinds.items()
    }
    return uncertainty(laws, dict.fromkeys(laws, MILL), None, None, ReliabilitySettings())


def alone(kind, found=None, judged=None, certainty=None):
    """One tool with a law of some kind."""
    law = ToolCoefficients(law=LAW, kind=kind, source="A")
    return uncertainty({1: law}, {1: MILL}, found, judged, certainty or ReliabilitySettings())


def coefficients(uncertain, number=1):
    return draws_of(uncertain, MANY, 0).tools[number].coefficients


def test_identified_coefficients_have_their_intervals_and_correlation():
    drawn = coefficients(identified())
    half = np.array(list(HALF.values())) * [1e6, 1e6, 1e6, 1e3, 1e3]
    assert drawn[:, :5].std(axis=0) == pytest.approx(half / NORMAL, rel=0.02)
    assert drawn[:, :5].mean(axis=0) == pytest.approx(
        [7e8, 2e8, 1e8, 3e4, 2e4], abs=0.01 * float(half.max()), rel=0.003
    )
    share = np.corrcoef(drawn[:, :5].T)
    expected = np.eye(5)
    expected[0, 3] = expected[3, 0] = -0.6
    assert share == pytest.approx(expected, abs=0.03)  # 1 / sqrt(4096) is 0.016


def test_what_was_not_determined_is_drawn_about_the_fits_value():
    """Nominal loads count K_ae as none; the fit took 5 N/mm and says little of it."""
    drawn = coefficients(identified())[:, 5]
    assert drawn.mean() == pytest.approx(5e3, rel=0.03)
    assert drawn.std() == pytest.approx(5e3, rel=0.03)
    said = next(one for one in identified().quantities if one.what.startswith("K_ae"))
    assert said.source == "not determined by the records"


def test_others_coefficients_err_together():
    drawn = coefficients(others(t1="A", t2="A")) / np.concatenate([LAW.cutting, LAW.edge])
    assert drawn.std(axis=0) == pytest.approx([0.1] * 6, rel=0.03)
    share = np.corrcoef(drawn.T)[np.triu_indices(6, 1)]
    assert share == pytest.approx(np.full(15, 0.8), abs=0.03)


@pytest.mark.parametrize(("source", "common"), [("A", 0.8), ("B", 0.0)])
def test_tools_of_one_source_err_together_and_of_two_do_not(source: str, common: float):
    draws = draws_of(others(t1="A", t2=source), MANY, 0)
    one, other = (draws.tools[number].coefficients[:, 0] for number in (1, 2))
    assert np.corrcoef(one, other)[0, 1] == pytest.approx(common, abs=0.04)


def test_a_cut_never_drives_its_tool():
    drawn = coefficients(alone("catalogue", certainty=ReliabilitySettings(catalogue=1.0)))
    assert drawn[:, [0, 3]].min() == 0.0 < drawn[:, 0].max()


class TestRunout:
    """Offsets of the tool's axis, as known of its mounting."""

    def sizes(self, uncertain):
        offsets = draws_of(uncertain, MANY, 0).tools[1].offsets
        angle = np.arctan2(offsets[:, 1], offsets[:, 0])
        # at any angle: means of cosines over 4096 draws are below 4 / sqrt(2 * 4096)
        for k in (1, 2, 3):
            assert abs(np.exp(1j * k * angle).mean()) < 0.05
        return np.hypot(*offsets.T) * 1e6

    def test_unknown_ones_are_rayleighs(self):
        size = self.sizes(others(t1="A"))
        for share in (0.1, 0.5, 0.9, 0.99):
            exact = 3.0 * np.sqrt(-2 * np.log(1 - share))
            assert np.quantile(size, share) == pytest.approx(exact, rel=0.03)

    def test_the_tables_stands(self):
        known = identified(replace(MILL, runout_um=6.0))
        assert self.sizes(known) == pytest.approx(np.full(MANY, 6.0))

    def test_another_mounting_adds_to_an_identified_one(self):
        spread = (12.0 - 8.0) / NORMAL  # the upper half of an interval that ends at 0
        exact = 8.0**2 + spread**2 + 2 * 3.0**2
        assert (self.sizes(identified()) ** 2).mean() == pytest.approx(exact, rel=0.03)

    def test_a_single_tooth_has_none(self):
        known = identified(replace(MILL, flutes=1))
        assert not draws_of(known, 64, 0).tools[1].offsets.any()


def test_depth_is_of_each_tool_and_the_model_of_the_part():
    draws = draws_of(others(t1="A", t2="A"), MANY, 0)
    depths = [draws.tools[number].depth for number in (1, 2)]
    assert [d.std() * 1e6 for d in depths] == pytest.approx([10.0, 10.0], rel=0.03)
    assert abs(np.corrcoef(*depths)[0, 1]) < 0.04
    assert draws.model.mean() == pytest.approx(1.0, abs=1e-3)
    assert draws.model.std() == pytest.approx(0.02, rel=0.03)


def test_the_models_spread_is_that_of_judged_recordings_where_it_is_greater():
    scores = tuple(
        replace(score("cutting", f"{role} {error}", error), role=role)
        for role, error in (("held_out", 3.0), ("golden", -5.0), ("training", 90.0))
    )
    # of all recordings together, and by a fit without it: neither is a recording of its own
    scores += (
        replace(scores[0], group="all", peak_percent=50.0),
        replace(scores[0], regime=OTHERS, peak_percent=60.0),
    )
    judged = replace(verdict("cutting", "passed"), scores=scores)
    for least, expected in ((0.02, np.sqrt((9 + 25) / 2) / 100), (0.1, 0.1)):
        known = alone("measured", judged=judged, certainty=ReliabilitySettings(model=least))
        assert known.model == pytest.approx(expected)


def test_what_tools_share_is_said_once():
    said = others(t1="A", t2="A", t7="B").quantities
    assert [one.what for one in said if one.source == "A"] == ["coefficients (T1, T2)"]
    assert "runout (T1, T2, T7)" in [one.what for one in said]


def test_the_same_seed_is_the_same_bytes_and_the_first_are_the_first():
    known = identified()
    one, again, other = (draws_of(known, 256, seed) for seed in (5, 5, 6))
    for name in ("coefficients", "offsets", "depth"):
        here = getattr(one.tools[1], name)
        assert here.tobytes() == getattr(again.tools[1], name).tobytes()
        assert here.tobytes() != getattr(other.tools[1], name).tobytes()
        assert np.array_equal(getattr(one.first(10).tools[1], name), here[:10])
    assert len(one.first(10)) == 10


def test_a_law_without_its_tool_is_named():
    law = ToolCoefficients(law=LAW, kind="measured", source="A")
    with pytest.raises(ValueError, match="T4 has a force law and is no tool"):
        uncertainty({4: law}, {1: MILL}, None, None, ReliabilitySettings())


NUMBERS = st.none() | st.floats(
    allow_nan=False, allow_infinity=False, min_value=-1e9, max_value=1e9
)


@st.composite
def parameters(draw: st.DrawFn) -> Parameter:
    """A parameter that says little: without a value, without an interval, or not determined."""
    low, high = sorted(draw(st.tuples(*2 * (st.floats(-1e9, 1e9),))))
    return Parameter(
        value=draw(NUMBERS), unit="", interval_95=draw(st.sampled_from([None, (low, high)])),
        determined=draw(st.booleans()), method="",
    )  # fmt: skip


CORRELATIONS = st.just(Correlation()) | st.permutations(NAMES).flatmap(
    lambda names: st.lists(
        st.lists(st.none() | st.floats(-1, 1), min_size=6, max_size=6), min_size=6, max_size=6
    ).map(lambda rows: Correlation(names=tuple(names), values=tuple(map(tuple, rows))))
)
FITTED = st.none() | st.lists(st.floats(-1e9, 1e9), min_size=6, max_size=8).map(
    lambda values: replace(cutting_files.PLAIN_MODEL, values=tuple(values))
)
ROWS = st.dictionaries(st.sampled_from([*NAMES, "runout", "helix"]), parameters())


@given(rows=ROWS, correlation=CORRELATIONS, fitted=FITTED)
@settings(max_examples=25)
def test_a_model_that_says_little_is_drawn_from_all_the_same(rows, correlation, fitted):
    found = cutting_files.model({"": rows}, correlation=correlation, prediction=fitted)
    assert_finite(alone("identified", found, cutting_files.verdict()))


def assert_finite(known) -> None:
    drawn = draws_of(known, 16, 0).tools[1]
    assert np.isfinite(drawn.coefficients).all() and np.isfinite(drawn.offsets).all()


def test_a_cut_without_a_fit_is_not_known():
    for bare in (None, cutting_files.without_forces()):
        assert_finite(alone("identified", bare))


RELIABILITY = ReliabilitySettings()
STATUSES: tuple[Status | None, ...] = (*get_args(Status), None)
"""None: no verdict.json beside the model."""
QUANTITIES = {"control": "run time", "drive": f"{FOLLOWING} X", "cutting": MAGNITUDE}


def score(name: str, group: str, error: float, limit: float = 10.0) -> Score:
    """A recording with an error [%] against its limit [%]."""
    figure = "peak_percent" if name == "cutting" else "relative_percent"
    failed = abs(error) > limit
    said = f"{group}: {QUANTITIES[name]}, an error {error:.4g} % is above {limit:g} %"
    return Score(
        quantity=QUANTITIES[name], unit="", group=group, regime="", role="golden", n=9,
        limits={figure: limit}, status="failed" if failed else "passed",
        reasons=(said,) * failed, **{figure: error},
    )  # fmt: skip


def verdict(name: str, status: Status, *errors: float, reasons: tuple[str, ...] = ()) -> Verdict:
    scores = tuple(score(name, f"r{k}.csv", error) for k, error in enumerate(errors))
    said = tuple(reason for one in scores for reason in one.reasons)
    return Verdict(
        submodel=name, machine="mill01", origin="simulated", status=status,
        reasons=reasons + said, judged_role="golden", golden=None, scores=scores,
    )  # fmt: skip


def used(**verdicts: Verdict | None) -> dict[str, UsedModel]:
    return {one.submodel: one for one in used_models(verdicts, RELIABILITY)}


@pytest.mark.parametrize("statuses", list(product(STATUSES, repeat=3)), ids=str)
def test_every_combination_of_verdicts_names_what_did_not_pass_first(
    statuses: tuple[Status | None, ...],
) -> None:
    errors = {
        "passed": (1.0, -2.0), "failed": (1.0, 14.0), "not decided": (1.0, -2.0), "not judged": (),
    }  # fmt: skip
    verdicts = {
        name: None if status is None else verdict(name, status, *errors[status])
        for name, status in zip(FIGURES, statuses, strict=True)
    }
    found = used_models(verdicts, RELIABILITY)
    assert {one.submodel: one.status for one in found} == {
        name: status or "not judged" for name, status in zip(FIGURES, statuses, strict=True)
    }
    doubtful = [one.doubtful for one in found]
    assert doubtful == sorted(doubtful, reverse=True)
    for one in found:
        passed = used(**{one.submodel: verdict(one.submodel, "passed", *errors["passed"])})
        least = passed[one.submodel].spread_percent
        assert least is not None and one.spread_percent is not None
        assert one.spread_percent > least if one.doubtful else one.spread_percent == least
        assert one.status in one.sentence and one.figures in one.sentence
        if one.status == "failed":
            assert "r1.csv" in one.sentence and "14 % is above 10 %" in one.sentence


@pytest.mark.parametrize("name", FIGURES)
def test_what_was_not_identified_says_what_stands_in_for_it(name: str) -> None:
    others = {other: verdict(other, "passed", 1.0) for other in FIGURES if other != name}
    found = used(**others)[name]
    assert found.status == "not identified" and found.reason
    assert found.spread_percent == (25.0 if name == "control" else None)


def test_spreads_are_those_of_the_errors_of_judged_recordings() -> None:
    passed = used(control=verdict("control", "passed", 3.0, -4.0))["control"]
    assert passed.spread_percent == pytest.approx(np.sqrt(12.5), abs=1e-3)
    assert (passed.recordings, passed.error_percent) == (2, passed.spread_percent)
    failed = used(control=verdict("control", "failed", 3.0, -14.0))["control"]
    assert failed.spread_percent == 14.0 and failed.error_percent < 14.0
    assert used(control=verdict("control", "failed", 3.0))["control"].spread_percent == 10.0
    assert used(cutting=verdict("cutting", "passed", 0.5))["cutting"].spread_percent == 2.0


def test_the_worst_limit_missed_is_named_and_faults_of_the_judgement_before_it() -> None:
    failed = verdict("drive", "failed", 11.0, 19.0, 12.0)
    found = used(drive=failed)["drive"]
    assert found.reason.startswith("r1.csv") and found.missed == 3
    assert "and 2 more" in found.sentence
    leak = "a.csv: b.csv has the same bytes as c.csv, which the model was fitted on"
    worthless = replace(failed, reasons=(*failed.reasons, leak))
    assert used(drive=worthless)["drive"].reason == leak


@given(
    errors=st.lists(st.floats(-0.5, 0.5), max_size=6), least=st.floats(0.0, 0.5),
    failed=st.floats(0.0, 1.0), not_judged=st.floats(0.0, 1.0),
)  # fmt: skip
def test_no_verdict_narrows(
    errors: list[float], least: float, failed: float, not_judged: float
) -> None:
    settings = ReliabilitySettings(failed=failed, not_judged=not_judged)
    spread = {
        status: judged_spread(status, errors, least, settings)[0] for status in get_args(Status)
    }
    assert spread["passed"] >= least
    assert spread["failed"] >= max(failed, spread["passed"] * (1 - 1e-12))
    assert spread["not judged"] >= max(not_judged, spread["passed"])


@pytest.mark.parametrize(
    ("judged", "spread", "source"),
    [
        (verdict("cutting", "passed", 1.0), 0.02, "certainty.model"),
        (verdict("cutting", "passed", 5.0), 0.05, "1 recordings"),
        (verdict("cutting", "failed", 5.0), 0.1, "certainty.failed"),
        (verdict("cutting", "failed", 5.0, -15.0), 0.15, "greatest error of 2 recordings"),
        (verdict("cutting", "not judged"), 0.25, "certainty.not_judged"),
        (None, 0.25, "certainty.not_judged"),
    ],
)
def test_loads_of_identified_coefficients_count_with_the_verdicts_spread(
    judged: Verdict | None, spread: float, source: str
) -> None:
    known = alone("identified", cutting_files.model(), judged)
    assert known.model == pytest.approx(spread) and source in known.quantities[-1].source
    assert alone("catalogue", judged=judged).model <= 0.15  # a book has a spread of its own


def test_verdicts_are_read_beside_the_models(tmp_path: Path) -> None:
    for name in ("drive", "cutting"):
        (tmp_path / name).mkdir()
    write_json(cutting_files.model(), tmp_path / "cutting/model.json")
    assert machine_models(tmp_path, CONTROL).verdicts == {"cutting": None}
    failed = verdict("cutting", "failed", 12.0)
    write_json(failed, tmp_path / "cutting/verdict.json")
    write_json(verdict("drive", "failed", 12.0), tmp_path / "drive/verdict.json")
    found = machine_models(tmp_path, CONTROL)
    assert found.verdicts == {"cutting": failed} and found.judged == failed  # no drive.json
    (tmp_path / "cutting/verdict.json").write_text("{")
    with pytest.raises(StoreError, match=r"verdict\.json"):
        machine_models(tmp_path, CONTROL)


@pytest.mark.parametrize("status", ["failed", "not judged"])
@pytest.mark.parametrize("name", FIGURES)
def test_what_did_not_pass_stands_at_the_top_of_page_json_and_lines(
    name: str, status: Status
) -> None:
    verdicts = {one: verdict(one, "passed", 1.0) for one in FIGURES}
    verdicts[name] = verdict(
        name, status, 13.0, reasons=("nothing held out",) * (status != "failed")
    )
    part = replace(
        optimise_documents.part(optimise_documents.optimised()),
        verdicts=used_models(verdicts, RELIABILITY), warnings=(),
    )  # fmt: skip
    values = json.loads(json.dumps(part_values(part)))
    assert list(values)[:2] == ["warnings", "verdicts"]
    assert values["verdicts"][0]["submodel"] == name
    assert structured(values, OptimisedPart, "$") == part
    lines = list(optimise_lines(part))
    assert lines[1].startswith(f"WARNING: {name} {status}: ")
    page = optimised_page(part, [])
    assert page.sentences[0].lower().startswith(f"{name} {status}") and page.status != "passed"
    assert page.sections[0].key == "verdicts"
    assert page.sections[0].pairs[0][0].lower() == name


def test_a_part_all_of_whose_models_passed_has_no_doubt() -> None:
    part = optimise_documents.part(optimise_documents.optimised())
    part = replace(part, warnings=(), setup=replace(part.setup, warnings=()))
    verdicts = used_models({one: verdict(one, "passed", 1.0) for one in FIGURES}, RELIABILITY)
    page = optimised_page(replace(part, verdicts=verdicts), [])
    assert page.status == optimised_page(part, []).status == "passed"
    assert page.sentences == optimised_page(part, []).sentences
    lines = list(optimise_lines(replace(part, verdicts=verdicts)))
    assert not any("WARNING" in line for line in lines)
    assert sum("passed;" in line and line.endswith("%") for line in lines) == 3
