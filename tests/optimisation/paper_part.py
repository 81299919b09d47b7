"""A part of the kind that Sim2023 optimises, its machine as the twin knows it, and the machine.

A6061, an end mill of 6 mm with two flutes, slots and corners, 60 N, F 100 to 500, S 1000 to 8000.
The paper's program, its prices and its machine are lost: blank, path and costs are ours.  The
machine is one of the shop floor, which knows more of cutting than the twin (size effect, ploughing,
wear, runout, sharpness, axes that lag); what the twin knows of it comes from its dynamometer alone.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from threadpoolctl import threadpool_limits

from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material
from pipeline.cutting.tool import ToolTable
from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.gcode.setup import Tool as Register
from pipeline.machine.control.parameters import (
    AuxiliaryParameters,
    AxisParameters,
    ControlParameters,
)
from pipeline.optimisation.job import Job, JobRequest, MachineModels, Workshop, job_of
from pipeline.optimisation.settings import OptimisationSettings, Part
from pipeline.parameters import structure
from pipeline.schema.cutting import CuttingModel
from pipeline.schema.identity import MachineIdentity
from pipeline.schema.limits import CutLimit
from pipeline.schema.part import Objective
from pipeline.schema.store import write_json
from pipeline.schema.verdict import Verdict
from pipeline.shop.cutting.dynamometer import write_dynamometer
from pipeline.shop.cutting.parameters import (
    ChannelMode,
    Conditions,
    Cutting,
    Dynamometer,
    EndMill,
    Series,
    SpindleTests,
    Workpiece,
)
from pipeline.shop.parameters import ControlParameters as ShopControl
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.job import TrialJob
from pipeline.signals.formats import RecordSource
from pipeline.signals.ingest import ingest
from pipeline.submodels.cases import Records, Roles
from pipeline.submodels.cutting.settings import (
    CuttingFitSettings,
    CuttingLimits,
    CuttingRecords,
    CuttingSetup,
)
from pipeline.submodels.cutting.submodel import SUBMODEL, Judging
from pipeline.submodels.judge import judge
from tests.small_project import ROOT

NAME = "O2023"
PROGRAM = """%
O2023(SLOTS AND CORNERS)
(BLANK BOX X0. X31. Y0. Y24. Z-10. Z0.)
(T1|6MM ENDMILL|H1|L100.000)
G21
G0 G17 G40 G49 G80 G90
T1 M6
G0 G90 G54 X-4. Y4. S5000 M3
G43 Z2. H1
M8
G1 Z-1. F400.
X6. F300.
X12.
G3 X14. Y6. I0. J2.
G1 Y8.5
G2 X16. Y10.5 I2. J0.
G1 X20.
G2 X22. Y8.5 I0. J-2.
G1 Y4.
X25.
Y11.5
X35.
G0 Z2.
Y24.
G1 Z-1.2 F400.
X28. F300.
X24.
Y18.5
X17.
Y17.
X11.
Y21.
G3 X8. Y24. I-3. J0.
G1 X2.
X-4.
G0 Z2.
M9
G91 G28 Z0.
M5
G90
M30
%
"""
STOCK = "box:0,31,0,24,-10,0"
LIMITS = CutLimit(load_N=60.0, feed_mm_min=(100.0, 500.0), speed_rpm=(1000.0, 8000.0))
TABLE, MATERIAL = "sim2023", "A6061"

OFFSET, LENGTH = (-410.0, -235.0, -470.0), 100.0
_AXIS = AxisParameters(
    rapid_speed=30000, cutting_speed=15000, rapid_acceleration=2500, cutting_acceleration=815,
    arc_acceleration=1000, corner_jump=600,
)  # fmt: skip
CONTROL = ControlParameters(
    axes={"X": _AXIS, "Y": _AXIS, "Z": _AXIS}, rapid_mode="independent", settle_time=0.17,
    auxiliary=AuxiliaryParameters(
        tool_change=1.3, m_code=0.34, stop=0.14, spindle_acceleration=19000,
        spindle_base_speed=3000, spindle_deceleration=13400, speed_change_waits=True,
    ),
)  # fmt: skip
"""As mill01's control was identified, with a faster changer."""
SETUP = Setup(
    work_offsets={"G54": (*OFFSET, 0.0, 0.0, 0.0)}, tools={1: Register(length=LENGTH)},
    initial_position=(-400.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)  # fmt: skip

END_MILL = EndMill(
    number=1, diameter=6.0, flutes=2, helix=0.0, runout=3.0, runout_angle=35.0, tilt=0.1,
    tilt_angle=120.0, sharpness=(1.04, 0.96), break_in=5.0, wear_rate=0.01,
)  # fmt: skip
"""In a collet of class 1 (ISO 15488: 10 um of indicated runout at most), 6 um usual.  Wrought
aluminium hardly wears carbide: some 10 um of land in the first hundred metres."""
ALUMINIUM = Workpiece(
    name="EN AW-6061 T6", tangential=695.0, radial=281.0, axial=0.0, exponent=0.08,
    edge_tangential=13.0, edge_radial=10.0, edge_axial=0.0, ploughing=2.0,
)  # fmt: skip
"""K_s = 750 N/mm2 at 68 deg for 6061-T6: Schmitz, Smith, *Machining Dynamics* (2009).  Edge forces
of 6082-T6: Liu et al. 2021, doi 10.1186/s10033-021-00536-9, table 5, their reference 189."""
PASS = Conditions(immersion="slot", depth=1.0, width=6.0, speed=5000.0, feed=300.0)
MACHINE = ShopParameters(
    machine="mill23", seed=2023, control=ShopControl(tool_change=1.3),
    cutting=Cutting(
        workpiece=ALUMINIUM, tool=END_MILL, spindle=SpindleTests(passes=(PASS,)),
        dynamometer=Dynamometer(
            series=Series(speeds=(5000.0, 7000.0), depths=(1.0, 1.2),
                          feeds=(0.015, 0.025, 0.04, 0.06), block=60.0, passes_between=0.0),
            x=ChannelMode(frequency=4400.0, damping=0.02),
            y=ChannelMode(frequency=4700.0, damping=0.02),
            z=ChannelMode(frequency=4600.0, damping=0.02),
            range=250.0, low_range=60.0, noise=0.1, hum=0.1, offset=0.5, drift=0.1,
        ),
    ),
)  # fmt: skip
"""The machine itself.  Its dynamometer is one for small forces: Kistler's data sheet of the 9256C
says 250 N, natural frequencies of 5.1 to 5.6 kHz without a workpiece."""
TRIAL = TrialJob(
    blank=(0.0, 31.0, 0.0, 24.0, -10.0, 0.0), limit_load_N=60.0, tools={1: END_MILL},
    workpiece=ALUMINIUM, lengths={1: LENGTH},
)  # fmt: skip


@dataclass(frozen=True)
class Knowledge:
    """What the twin knows of the machine's cut, and the verdict on it."""

    model: CuttingModel
    verdict: Verdict


def paper_knowledge(folder: Path) -> Knowledge:
    """The machine's cut, from its dynamometer's recordings written to ``folder``.

    It is judged on those that its fit did not see: another depth, another speed.  Runout belongs to
    a mounting and wear to an edge: those of the recordings are not those of the parts to come.
    """
    raw, signals = folder / "raw", folder / "signals"
    write_dynamometer(raw, MACHINE)
    conf = yaml.safe_load((ROOT / "conf/machine/mill01.yaml").read_text())
    sources = [one for one in conf["records"] if one["files"] == "dynamometer/*.csv"]
    identity = structure(
        {"machine": {"name": "mill23", "description": "of the shop floor", "origin": "simulated"}},
        "machine", MachineIdentity,
    )  # fmt: skip
    ingest(raw, signals, list(structure({"s": sources}, "s", tuple[RecordSource, ...])), identity)
    known = CuttingSetup(tool=_table().tools[1], material=MATERIAL)
    records = CuttingRecords(recordings="dynamometer/*.csv", name=conf["cutting_records"]["name"])
    roles = Roles(
        training=("dynamometer/slot-n5000f150ap1.csv", "dynamometer/slot-n5000f400ap1.csv",
                  "dynamometer/slot-n5000f600ap1.csv", "dynamometer/down-n5000*"),
    )  # fmt: skip
    settings = CuttingFitSettings(compare=False)
    judging = Judging(
        identity=identity, roles=roles, cutting=known, cutting_records=records,
        cutting_fit=settings, cutting_limits=CuttingLimits(),
    )  # fmt: skip
    read = Records(raw=raw, signals=signals)
    cases = SUBMODEL.cases(read, judging)
    with threadpool_limits(1):  # small matrices: threads cost more than they save
        model = SUBMODEL.fit(cases, judging, folder)
        write_json(model, folder / "model.json")
        found = judge(
            model, SUBMODEL.load(folder, judging), cases, SUBMODEL.targets(judging, model),
            sets=None, files=read.files,
        )  # fmt: skip
    return Knowledge(model, found.verdict)


def paper_job(
    objective: Objective, knowledge: Knowledge | None = None,
    settings: OptimisationSettings | None = None,
) -> Job:  # fmt: skip
    """The part with the paper's coefficients (conf/material/A6061), or what was identified."""
    program = parse_program(PROGRAM.encode(), f"{NAME}.nc")
    request = JobRequest(
        program=program, setup=SETUP, moves=interpret(program, SETUP), workshop=_workshop(),
        models=MachineModels(
            control=CONTROL, cutting=None if knowledge is None else knowledge.model,
            verdicts={} if knowledge is None else {"cutting": knowledge.verdict},
        ),
        part=Part(
            program=f"{NAME}.nc", stock=STOCK, tool_table=TABLE, material=MATERIAL, limits=LIMITS,
            objective=objective, resolution_mm=0.1,
        ),
        settings=settings or OptimisationSettings(),
    )  # fmt: skip
    return job_of(request)


def _workshop() -> Workshop:
    return Workshop(
        table=_table(), material=_conf("material/A6061.yaml", Material), drive=None,
        rates=_conf("cost/default.yaml", CostRates), drive_source="", energy=None, dynamics=None,
        catalogue=None,  # type: ignore[arg-type]  # limits of the part alone
    )  # fmt: skip


def _table() -> ToolTable:
    return _conf(f"tool/{TABLE}.yaml", ToolTable)


def _conf(name: str, kind: type) -> Any:
    return structure({"it": yaml.safe_load((ROOT / "conf" / name).read_text())}, "it", kind)
