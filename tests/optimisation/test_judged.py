"""Verdicts of control, drives and cut: what each says of the figures that rest on it."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.app.optimise import optimise_lines
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.optimisation.job import machine_models
from pipeline.optimisation.reliability.judged import FIGURES, judged_spread, used_models
from pipeline.optimisation.reliability.uncertainty import uncertainty
from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.report.optimised.page import optimised_page
from pipeline.schema.cutting import MAGNITUDE
from pipeline.schema.drive import FOLLOWING
from pipeline.schema.part import OptimisedPart, part_values
from pipeline.schema.store import StoreError, write_json
from pipeline.schema.structure import structured
from pipeline.schema.verdict import Score, Status, UsedModel, Verdict
from pipeline.twin.cut.coefficients import ToolCoefficients
from tests.optimisation.paper_part import CONTROL
from tests.report import optimise_documents
from tests.submodels.cutting import cutting_files

SETTINGS = ReliabilitySettings()
STATUSES: tuple[Status | None, ...] = (*get_args(Status), None)
"""None: no verdict.json beside the model."""
QUANTITIES = {"control": "run time", "drive": f"{FOLLOWING} X", "cutting": MAGNITUDE}
LAW = ForceLaw.linear(K_tc=700.0, K_rc=200.0, K_ac=100.0, K_te=30.0, K_re=20.0, K_ae=2.0)
MILL = Tool(kind="flat", diameter_mm=12.0, flutes=3)


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
    return {one.submodel: one for one in used_models(verdicts, SETTINGS)}


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
    found = used_models(verdicts, SETTINGS)
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
    law = {1: ToolCoefficients(law=LAW, kind="identified", source="this machine")}
    known = uncertainty(law, {1: MILL}, cutting_files.model(), judged, SETTINGS)
    assert known.model == pytest.approx(spread) and source in known.quantities[-1].source
    book = {1: replace(law[1], kind="catalogue", source="a book")}  # has a spread of its own
    assert uncertainty(book, {1: MILL}, None, judged, SETTINGS).model <= 0.15


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
        verdicts=used_models(verdicts, SETTINGS), warnings=(),
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
    verdicts = used_models({one: verdict(one, "passed", 1.0) for one in FIGURES}, SETTINGS)
    page = optimised_page(replace(part, verdicts=verdicts), [])
    assert page.status == optimised_page(part, []).status == "passed"
    assert page.sentences == optimised_page(part, []).sentences
    lines = list(optimise_lines(replace(part, verdicts=verdicts)))
    assert not any("WARNING" in line for line in lines)
    assert sum("passed;" in line and line.endswith("%") for line in lines) == 3
