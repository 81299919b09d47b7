"""Small optimisation problems: the parts of the cut's tests, what judges and what limits them."""

from dataclasses import replace

import numpy as np

from pipeline.cutting.economics.cost import CostRates, EnergyParameters
from pipeline.cutting.economics.material import Material, Taylor
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.stability.tip_dynamics import Mode, TipDynamics
from pipeline.gcode.moves import Kind, Moves
from pipeline.machine.control.parameters import AuxiliaryParameters
from pipeline.optimisation.problem.arrays import Editable
from pipeline.optimisation.problem.feasible import problem_of
from pipeline.optimisation.problem.problem import Problem
from pipeline.schema.limits import CutLimit, Margins
from pipeline.twin.control import planned_program
from pipeline.twin.cut.coefficients import ToolCoefficients
from pipeline.twin.cut.document import CutBasis
from pipeline.twin.cut.loads import Cut, CutJob, cut_program
from tests.gcode.following import follow
from tests.twin.cut_parts import BLOCK, CONTROL, LAW, SIX, TEN

DRIVE = SpindleDrive(
    rated_power_kW=5.0, base_speed_rpm=3000, top_speed_rpm=10000, efficiency=0.8,
    motor_efficiency=0.7, no_load_W=(20.0, 0.5, 0.001),
)  # fmt: skip
RATES = CostRates(
    currency="EUR", labour_per_h=36.0, machine_per_h=20.0, energy_per_kWh=0.5, tool_change_min=2.0
)
ENERGY = EnergyParameters(base_load_kW=1.5, drives_kW=0.4, coolant_kW=0.8)
MATERIAL = Material(
    name="A6061", group=22, iso="N", k_c11=800, m_c=0.25, radial=0.5, source="made up",
    ratio_source="made up",
    taylor={"carbide": Taylor(
        n=0.25, C_m_min=500.0, f_z_exponent=0.2, f_z_ref_mm=0.05, a_p_exponent=0.1, a_p_ref_mm=2.0,
        a_e_exponent=0.1, a_e_ref_mm=5.0,
    )},
)  # fmt: skip
MODES = (
    Mode(direction="x", natural_frequency_Hz=900, damping=0.03, stiffness_N_m=8e6),
    Mode(direction="y", natural_frequency_Hz=1000, damping=0.03, stiffness_N_m=6e6),
)
DYNAMICS = TipDynamics(source="made up", every=MODES)
DRILL = replace(TEN, kind="drill", stickout_mm=40.0)
TOOLS = {1: TEN, 2: SIX, 3: DRILL}
NO_MARGINS = Margins(
    load=0, power=0, torque=0, chip=0, deflection=0, stability=0, cutting_speed=0, roughness=0
)
ROOMY = CutLimit(load_N=1e4, chip_um=(0.0, 1e4), power_share=2.0, margins=NO_MARGINS)
"""Limits that nothing here comes near."""

TWO_TOOLS = """T1 M6
G0 X-10 Y20 S6000 M3
M8
Z5
G1 Z-2 F300
X30 F600
S5000
X70 F700
G0 Z5
T2 M6
G0 X-10 Y36 S8000 M3
G1 Z-1 F300
X35
G4 P1500
S9000 X70
G0 Z5
T3 M6
G0 X30 Y8 S1500 M3
G99 G81 X30 Y8 Z-6 R2 F150
G80 M9
G0 Z5
M30
"""
"""Two end mills and a drill, changes of S between blocks and in one, a dwell, coolant, a cycle."""


def cut_on(text: str, *, control=CONTROL, tools=None, laws=None, resolution=0.5, **setup) -> Cut:
    """The cut of a program in text on a control."""
    tools = TOOLS if tools is None else tools
    laws = dict.fromkeys(tools, LAW) if laws is None else laws
    plan = planned_program(follow(text, **setup), control)
    job = CutJob(
        stock=BLOCK, tools=tools, force_laws=laws, resolution=resolution * 1e-3,
        offsets=setup.get("work_offsets", {}),
    )  # fmt: skip
    return cut_program(plan, job)


def basis_of(cut: Cut, **changes) -> CutBasis:
    """Everything known, with ``changes``."""
    laws = {
        number: ToolCoefficients(law=law, kind="catalogue", source="made up")
        for number, law in zip(cut.numbers, cut.force_laws, strict=True)
    }
    values = {
        "stock": "box", "table": "made up", "material": MATERIAL, "coefficients": laws,
        "rates": RATES, "energy": ENERGY, "drive": DRIVE,
    }  # fmt: skip
    return CutBasis(**(values | changes))


def all_editable(moves: Moves) -> Editable:
    """Every line at feed is a block; every S of a turning spindle may change, at any row."""
    fed = np.isin(moves.kind, (Kind.FEED, Kind.ARC))
    line, block = np.unique(moves.line[fed], return_inverse=True)
    of_row = np.full(len(moves), -1, dtype=np.intp)
    of_row[fed] = block
    turning = moves.direction != 0
    return Editable(
        block=of_row, line=line.astype(np.intp), speed=turning, may_start=turning,
        own_start=moves.kind == Kind.SPINDLE, held=(),
    )  # fmt: skip


def problem_on(cut: Cut, limits: CutLimit = ROOMY, *, editable=None, f_z_load=None, **basis):
    """The problem of a cut in which all may be changed, unless ``editable`` says otherwise."""
    editable = all_editable(cut.plan.path.moves) if editable is None else editable
    return problem_of(cut, basis_of(cut, **basis), limits, editable, f_z_load=f_z_load)


def own(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """F and S as programmed, shape (M,) each."""
    moves = problem.cut.plan.path.moves
    return moves.feed, moves.speed


def waiting_control(**auxiliary):
    """The control of the parts with a spindle that takes time."""
    times = {
        "spindle_acceleration": 3000.0, "spindle_base_speed": 4000.0,
        "spindle_deceleration": 2500.0, "spindle_delay": 0.1, "tool_change": 3.0, "m_code": 0.2,
    }  # fmt: skip
    return replace(CONTROL, auxiliary=AuxiliaryParameters(**(times | auxiliary)))
