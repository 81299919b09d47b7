"""Parts from conf to the report: optimised, cut on the simulated shop floor, told."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from pipeline.machine.control.parameters import ControlParameters
from pipeline.parameters import structure
from pipeline.schema.model import Correlation
from pipeline.schema.store import write_json
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.job import write_parts
from pipeline.stages.__main__ import run
from pipeline.twin.control import ControlFitFacts, ControlModelFile
from tests.small_project import MACHINE, build, change, inside, new_project, params, store

pytestmark = pytest.mark.slow
PARTS, WORDS = f"data/parts/{MACHINE}", re.compile(rb"[FS][-+0-9.]+")
LIMIT = 420.0  # in N, another than what the shop floor would suggest


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mill with its part, and a control as conf/machine has it: nothing else was identified."""
    folder = new_project(tmp_path_factory.mktemp("parts") / "project")
    change(folder, "optimisation.search", population=12, generations=4, baseline=60)
    change(folder, "optimisation.certainty", draws=256)
    values = params(folder)
    control = structure(values, f"machine.{MACHINE}.control", ControlParameters)
    fit = ControlFitFacts(rmse_s=None, segments=1, condition=None, correlation=Correlation())
    stored = ControlModelFile(
        submodel="control", machine=MACHINE, origin="simulated", parameters={}, trained_on=(),
        control={"": control}, fit=fit, programs={},
    )  # fmt: skip
    write_json(stored, folder / "data/champion" / MACHINE / "control/model.json")
    shop = structure(values, f"machine.{MACHINE}.shop", ShopParameters)
    write_parts(folder / "data/raw" / MACHINE, shop)
    part = values["machine"][MACHINE]["parts"]["programs"][0]
    part["limits"]["load_N"], part["resolution_mm"] = LIMIT, 0.5
    change(folder, f"machine.{MACHINE}.parts", programs=[part], dynamics=None)
    build(folder, "optimise")
    return folder


def document(project: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(next((project / PARTS).glob("*.json")).read_text())
    return found


def test_programs_before_and_after_differ_in_f_and_s_alone(project: Path) -> None:
    before, after = (
        next((project / PARTS).glob(f"O*[0-9]{end}")).read_bytes() for end in (".before.nc", ".nc")
    )
    raw = next((project / "data/raw" / MACHINE / "parts").glob("*.nc")).read_bytes()
    assert before == raw != after

    def rest(text: bytes) -> list[bytes]:
        return [WORDS.sub(b"", line).replace(b" ", b"") for line in text.splitlines()]

    assert rest(before) == rest(after)


def test_the_document_keeps_its_limits_and_is_proved(project: Path) -> None:
    found = document(project)
    assert found["after"]["beyond"] == 0 and found["after"]["peak_load_N"] <= LIMIT
    assert found["certainty"]["exceedance"] <= 0.02  # asked for was 0.01, of 256 draws
    assert found["proof"]["same"] is True
    assert found["after"]["time_s"] < 0.9 * found["before"]["time_s"]
    assert found["methods"][0]["method"] == "as programmed"


def test_the_cut_as_written_is_that_before(project: Path) -> None:
    """It is stored beside the optimisation, as worn and with what the machine's limits say."""
    (path,) = (project / PARTS / "as_written").glob("*.json")
    written, found = json.loads(path.read_text()), document(project)
    before, cut = found["before"], written["cut"]
    assert written["time"]["sha256"] == found["proof"]["before_sha256"]
    assert written["time"]["file"] == f"parts/{path.stem}.nc"
    assert cut["summary"]["time_s"] == before["time_s"]
    assert cut["summary"]["peak_load_N"] == before["peak_load_N"]
    assert cut["summary"]["cost"]["sum"] == before["cost"]
    assert cut["limits"]["load_N"] == LIMIT and cut["forces"] and len(cut["blocks"]) > 1
    assert path.with_suffix(".parquet").exists()


def test_metrics_are_those_of_the_document(project: Path) -> None:
    metrics = json.loads((project / f"data/metrics/{MACHINE}_optimise.json").read_text())
    found, (label,) = document(project), {p.stem for p in (project / PARTS).glob("*.json")}
    assert metrics[f"{label}_after_time_s"] == pytest.approx(found["after"]["time_s"], rel=1e-3)
    assert metrics[f"{label}_same_geometry"] is True
    assert list(metrics) == sorted(metrics)


def test_the_shop_floor_cuts_both_and_the_page_lays_them_side_by_side(project: Path) -> None:
    change(project, f"machine.{MACHINE}.shop", trial_cuts=1)
    build(project, "trial")
    cut = json.loads((project / f"data/trials/{MACHINE}.json").read_text())
    (told,) = cut["parts"].values()
    found = document(project)
    assert cut["origin"] == "simulated" and told["seeds"] == 1
    assert told["limit_load_N"] == LIMIT == found["limits"]["load_N"]
    assert told["after"]["time_s"]["mean"] < told["before"]["time_s"]["mean"]
    places = ("signals", "clean", "models", "champion", "golden", "truth", "programs", "parts",
              "trials", "history", "ledger", "twin_state", "condition", "incidents")  # fmt: skip
    for place in places:
        (project / "data" / place).mkdir(exist_ok=True)
    with inside(project):
        run("report", *(f"data/{p}" for p in places), "data/settings/sections", "reports",
            "data/metrics/report.json")  # fmt: skip
    pages = (project / "reports").glob(f"{MACHINE}_program_*.html")
    path, written = sorted(pages, key=lambda one: len(one.name))
    page, programs = path.read_text(), (project / f"reports/{MACHINE}_programs.html").read_text()
    assert all(one.name in programs for one in (path, written))
    assert "cut on the simulated shop floor 1 times" in page
    assert f'href="{written.name}">As written<' in page
    assert "Load along the path" in written.read_text()


def test_a_part_that_the_shop_floor_does_not_make_is_refused(project: Path, tmp_path: Path) -> None:
    (tmp_path / "O9.json").write_text("{}")
    with (
        inside(project),
        pytest.raises(ValueError, match=r"O9 is no part of the shop floor, which makes O\d+: take"),
    ):
        run(f"trial@{MACHINE}", str(tmp_path), str(tmp_path / "out.json"))


def test_a_wrong_part_is_one_sentence_with_its_path(project: Path) -> None:
    values = params(project)
    part = values["machine"][MACHINE]["parts"]["programs"][0]
    values["machine"][MACHINE]["parts"]["programs"] = [part | {"limits": {"load_N": 0}}]
    broken = project.parent / "broken"
    broken.mkdir()
    store(broken, values)
    with inside(broken), pytest.raises(ValueError, match=r"load_N = 0.0 N must lie .*limits"):
        run(f"optimise@{MACHINE}", "raw", "models", "parts", "metrics.json")
