"""Parts of a machine: what a person may write, what becomes of it, what lies on disk after."""

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.app.tables import read_catalogue, read_material, read_tools
from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.gcode.setup import Setup
from pipeline.optimisation.document import part_metrics, write_program
from pipeline.optimisation.job import (
    MachineModels,
    Workshop,
    job_of,
    job_request,
    spindle_drive,
)
from pipeline.optimisation.settings import OptimisationSettings, Part, Parts
from pipeline.parameters import ParametersError, structure
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.limits import CutLimit
from pipeline.schema.model import Parameter
from pipeline.schema.part import OptimisedPart
from pipeline.schema.store import structured
from pipeline.stages.optimise import named
from tests.report import optimise_documents
from tests.submodels.cutting import cutting_files
from tests.twin.cut_parts import CONTROL

ROOT = Path(__file__).parents[2]
PART: dict[str, Any] = {
    "program": "parts/O1.nc", "stock": "box:0,60,0,40,-10,0", "tool_table": "mine",
    "material": "A6061",
}  # fmt: skip
DRIVE = SpindleDrive(
    rated_power_kW=12.0, base_speed_rpm=2500.0, top_speed_rpm=12000.0, no_load_W=(80.0, 2.4)
)


def workshop() -> Workshop:
    """Tools and a material of conf/, with prices and cutting data."""
    rates = yaml.safe_load((ROOT / "conf/cost/default.yaml").read_text())
    return Workshop(
        table=read_tools("mill01"), material=read_material("A6061"), catalogue=read_catalogue(),
        rates=structure({"a": rates}, "a", CostRates), drive=DRIVE, drive_source="", energy=None,
        dynamics=None,
    )  # fmt: skip


def cutting(material: str = "A6061") -> CuttingModel:
    """As identified with a tool of 12 mm and three teeth."""

    def known(**values: float) -> dict[str, Parameter]:
        return {
            name: Parameter(value=value, unit="", interval_95=None, determined=True, method="")
            for name, value in values.items()
        }

    tool = {"kind": "flat", "diameter_mm": 12.0, "flutes": 3}
    groups = {"": known(K_tc=700.0), "spindle": known(p0=55.0, p1=1.5, p2=0.02)}
    return cutting_files.model(groups, material=material, tool=tool)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"program": "/etc/passwd"}, "must be a file below the machine's raw records"),
        ({"program": "../mill02/O1.nc"}, "must be a file below the machine's raw records"),
        ({"program": ""}, "must be a file below the machine's raw records"),
        ({"program": "parts/O 1 (front).nc"}, r"'O 1 \(front\)' names files and a heading"),
        ({"name": "../O1"}, "names files and a heading"),
        ({"resolution_mm": 0}, "resolution_mm = 0.0 mm must lie from 0.001 to 100"),
        ({"objective": "money"}, "'money' is none of time, cost, energy, wear, pareto"),
        ({"limits": {"load_N": -1}}, "load_N = -1.0 N must lie above 0"),
        ({"limits": {"lod_N": 1}}, "lod_N"),
    ],
)
def test_a_part_that_is_none_is_refused(change: dict[str, Any], said: str) -> None:
    with pytest.raises(ParametersError, match=said):
        structure({"parts": {"programs": [PART | change]}}, "parts", Parts)


def test_files_are_called_after_the_program_or_as_they_are_told() -> None:
    assert Part(**PART).label == "O1"
    spaced = PART | {"program": "programs/REV-A OP2 (Front).NC", "name": "BOX-OP2"}
    assert Part(**spaced).label == "BOX-OP2"


def test_no_two_parts_write_the_same_file() -> None:
    with pytest.raises(ValueError, match="two programs called O1: rename one"):
        Parts(programs=(Part(**PART), Part(**PART | {"program": "other/O1.nc"})))
    with pytest.raises(ValueError, match=r"parts\.programs is empty"):
        Parts(programs=())


def job_in(tmp_path: Path, models: MachineModels, **change: Any) -> Any:
    program = tmp_path / "parts/O1.nc"
    program.parent.mkdir(exist_ok=True)
    program.write_text("%\nO1\nG0 X0\nM30\n%\n")
    part = Part(**(PART | {"limits": CutLimit(load_N=60.0)} | change))
    return job_of(job_request(
        tmp_path / part.program, part, workshop(), models, setup=Setup(),
        settings=OptimisationSettings(),
    ))  # fmt: skip


def test_a_job_holds_what_the_part_and_the_models_say(tmp_path: Path) -> None:
    bare = job_in(tmp_path, MachineModels(control=CONTROL))
    assert bare.basis.limit_load == bare.limits.load_N == 60.0
    assert bare.cut.resolution == pytest.approx(2e-4)
    assert bare.basis.coefficients[4].kind == "measured"  # by Sim2023
    assert bare.basis.drive == DRIVE and bare.basis.dynamics is None
    assert bare.setup.folders == (tmp_path / "parts",)  # where subprograms lie
    known = job_in(tmp_path, MachineModels(control=CONTROL, cutting=cutting()))
    assert known.basis.coefficients[4].kind == "identified"
    assert known.basis.drive.no_load_W == (55.0, 1.5, 0.02)
    assert "no-load power identified" in known.basis.drive_source
    other = job_in(tmp_path, MachineModels(control=CONTROL, cutting=cutting("C45")))
    assert other.basis.coefficients[4].kind == "measured"


def test_without_a_drive_nothing_is_made_of_its_no_load_power() -> None:
    assert spindle_drive(None, "a file", cutting()) == (None, "a file")
    assert spindle_drive(DRIVE, "a file", None) == (DRIVE, "a file")


def test_what_a_part_names_must_be_there(tmp_path: Path) -> None:
    bare = MachineModels(control=CONTROL)
    with pytest.raises(
        ValueError, match="conf/tool/ does not have 'hers', which is named: it has mine"
    ):
        named({"mine": 1}, "hers", "tool")
    for change, said in (
        ({"program": "parts/O2.nc"}, "O2.nc is no file: name a part program"),
        ({"stock": "sphere:1"}, "sphere"),
    ):
        with pytest.raises(ValueError, match=said):
            job_in(tmp_path, bare, **change)


def stored(**change: Any) -> OptimisedPart:
    """A part with few figures."""
    few = {"limits": {}, "currency": "KRW", "notes": ["Größe"], "certainty": None, "before": {},
           "after": {}}  # fmt: skip
    return optimise_documents.part(optimise_documents.optimised() | few | change)


def test_programs_are_written_byte_by_byte_and_figures_are_flat(tmp_path: Path) -> None:
    before, after = b"%\r\nO1 (\xe9)\r\nG1X1.F100.\r\n", b"%\r\nO1 (\xe9)\r\nG1X1.F200.\r\n"
    risk = {"epsilon": 0.01, "exceedance": 0.00712345, "interval_95": [0.0, 0.02], "draws": 64,
            "peaks": [], "nominal": None, "price": None, "uncertain": []}  # fmt: skip
    part = stored(
        certainty=risk, before={"time_s": 29.4812, "cost": None, "peak_load_N": 71.234},
        after={"time_s": 24.51, "cost": 76.4, "peak_load_N": None},
    )  # fmt: skip
    write_program("O1", before, after, part, tmp_path / "new")
    assert (tmp_path / "new/O1.before.nc").read_bytes() == before
    assert (tmp_path / "new/O1.nc").read_bytes() == after
    text = (tmp_path / "new/O1.json").read_text(encoding="utf-8")
    assert structured(json.loads(text), OptimisedPart, "$") == part and "Größe" in text
    assert json.loads(text)["limits"].keys() == {
        "power_share", "least_speed_change_rpm", "margins", "practice",
    }  # fmt: skip
    other = stored(proof={**vars(part.proof), "same": False})
    assert part_metrics({"O1": part, "O2": other}) == {
        "O1_before_time_s": 29.48, "O1_before_peak_load_N": 71.23, "O1_after_time_s": 24.51,
        "O1_after_cost_KRW": 76.4, "O1_exceedance": 0.007123, "O1_same_geometry": True,
        "O2_same_geometry": False,
    }  # fmt: skip
