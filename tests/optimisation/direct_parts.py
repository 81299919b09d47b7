"""Small parts whose best feeds and speeds are known, and the problems made of them."""

from dataclasses import replace

from pipeline.cutting.economics.cost import CostRates
from pipeline.cutting.economics.material import Material, Taylor
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.engagement.stock import Box
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import (
    AuxiliaryParameters,
    AxisParameters,
    ControlParameters,
)
from pipeline.optimisation.problem.feasible import problem_of
from pipeline.optimisation.problem.problem import Problem
from pipeline.optimisation.text.editable_blocks import editable_blocks
from pipeline.schema.limits import Margins
from pipeline.twin.control import planned_program
from pipeline.twin.cut.coefficients import ToolCoefficients
from pipeline.twin.cut.document import CutBasis
from pipeline.twin.cut.loads import CutJob, cut_program

K_T, K_E = 1.23e9, 0.5  # A6061 of Sim2023 [N/m^2], [1]
LAW = ForceLaw(K_tc=K_T, K_rc=K_E * K_T)
SIX = Tool(kind="flat", diameter_mm=6.0, flutes=2, stickout_mm=20.0, price=20.0)
TAYLOR = Taylor(n=0.3, C_m_min=600.0)
RATES = CostRates(currency="EUR", labour_per_h=60.0, tool_change_min=1.0)
FREE = Margins(
    load=0.0, power=0.0, torque=0.0, chip=0.0, deflection=0.0, stability=0.0, cutting_speed=0.0,
    roughness=0.0,
)  # fmt: skip
DEPTH = 2.0  # of cuts [mm]
BLANK = Box(x_mm=(0, 300), y_mm=(0, 60), z_mm=(-10, 0))


def material(taylor: Taylor = TAYLOR) -> Material:
    return Material(
        name="A6061", group=22, iso="N", k_c11=600.0, m_c=0.0, radial=0.5, source="Sim2023",
        ratio_source="Sim2023", taylor={"carbide": taylor},
    )  # fmt: skip


def control(acceleration=1e6, **auxiliary) -> ControlParameters:
    """Axes that reach their speed at once, so that blocks do not interact."""
    axis = AxisParameters(
        rapid_speed=30000, cutting_speed=20000, rapid_acceleration=acceleration,
        cutting_acceleration=acceleration, arc_acceleration=acceleration, corner_jump=1e6,
    )  # fmt: skip
    return ControlParameters(
        axes={"X": axis, "Y": axis, "Z": axis}, auxiliary=AuxiliaryParameters(**auxiliary)
    )


def problem(
    text, limits, *, tool=SIX, tools=None, taylor=TAYLOR, rates=RATES, drive=None, energy=None,
    machine=None, resolution=0.5, blank=BLANK, setup=None,
) -> Problem:  # fmt: skip
    """Of a program in text."""
    tools = {1: tool} if tools is None else tools
    program = parse_program(text.encode(), "part.nc")
    moves = interpret(program, Setup() if setup is None else setup)
    plan = planned_program(moves, control() if machine is None else machine)
    job = CutJob(
        stock=blank, tools=tools, force_laws=dict.fromkeys(tools, LAW), resolution=resolution * 1e-3
    )
    law = ToolCoefficients(law=LAW, kind="measured", source="Sim2023")
    basis = CutBasis(
        stock="box", table="one", material=material(taylor), coefficients=dict.fromkeys(tools, law),
        rates=rates, drive=drive, energy=energy,
    )  # fmt: skip
    limits = replace(limits, margins=FREE)
    return problem_of(cut_program(plan, job), basis, limits, editable_blocks(program, moves))


def slots(*depths, length=280.0, feed=200.0, speed=3000.0) -> str:
    """Slots side by side along X, each of its own depth [mm], entered from outside the blank."""
    lines = ["T1 M6", f"S{speed:g} M3", "G0 X-10 Y5 Z5"]
    for row, depth in enumerate(depths):
        lines += [
            f"G0 X-10 Y{5 + 8 * row:g}", f"G0 Z-{depth:g}",
            f"G1 X{length:g} F{feed:g}", "G0 Z5",
        ]  # fmt: skip
    return "\n".join([*lines, "M30", ""])


def side_cut(width, *, depth=DEPTH, length=290.0, feed=200.0, speed=3000.0, diameter=6.0) -> str:
    """One up-milled pass of a radial depth [mm] along the blank's edge at y = 0."""
    y = width - diameter / 2
    return "\n".join([
        "T1 M6", f"S{speed:g} M3", f"G0 X-10 Y{y:g} Z5", f"G0 Z-{depth:g}",
        f"G1 X{length:g} F{feed:g}", "G0 Z5", "M30", "",
    ])  # fmt: skip


def drive(power_kW=1.0, base=6000.0, top=20000.0, **choices) -> SpindleDrive:
    return SpindleDrive(rated_power_kW=power_kW, base_speed_rpm=base, top_speed_rpm=top, **choices)
