"""Small programs optimised with the catalogue and without files, of one tool and of several."""

from typing import Any

from pipeline.app.tables import read_catalogue, read_material
from pipeline.cutting.economics.material import Material
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.cutting.tool import Tool, ToolTable
from pipeline.gcode.interpret import interpret
from pipeline.gcode.program import parse_program
from pipeline.gcode.setup import Setup
from pipeline.machine.control.parameters import ControlParameters
from pipeline.optimisation.document import optimised_part
from pipeline.optimisation.full_twin import Result
from pipeline.optimisation.job import JobRequest, MachineModels, Workshop
from pipeline.optimisation.optimise import optimise_worn
from pipeline.optimisation.settings import (
    OptimisationSettings,
    Part,
    ReliabilitySettings,
    SearchSettings,
)
from pipeline.schema.limits import CutLimit
from pipeline.schema.part import OptimisedPart
from tests.twin.cut_parts import CONTROL

QUICK = OptimisationSettings(
    certainty=ReliabilitySettings(draws=64),
    search=SearchSettings(population=8, generations=2, baseline=20, paper_generations=2, front=8),
)
SIXTEEN = Tool(kind="flat", diameter_mm=16.0, flutes=4, helix_deg=40.0, stickout_mm=50.0)
TEN = Tool(kind="flat", diameter_mm=10.0, flutes=4, helix_deg=40.0, stickout_mm=30.0)
EIGHT = Tool(kind="drill", diameter_mm=8.0, flutes=2, point_angle_deg=140.0)
THREADS = Tool(
    kind="flat", role="thread_mill", diameter_mm=9.0, flutes=4, stickout_mm=40.0, name="M12"
)
TOOLS = {1: SIXTEEN, 2: TEN, 3: EIGHT, 7: THREADS}
SLOTTED = "T1 M6\nG0 X-15 Y20 S1600 M3\nZ-4\nG1 X75 F300\nG0 Z20\n"
SHOULDER = "T2 M6\nG0 X-15 Y49 S2600 M3\nZ-3\nG1 X75 F400\nG0 Z20\n"
HOLE = "T3 M6\nG0 X50 Y44 S1600 M3\nZ2\nG1 Z-16 F160\nG0 Z20\n"
THREAD = (
    "T7 M6\nG0 X50 Y44 S2000 M3\nZ-10\nG91 G1 X1.5 F100\nG3 I-1.5 J0 Z1.75\nG1 X-1.5\nG90 G0 Z20\n"
)
STOCK = "box:0,60,0,50,-40,0"


def request_of(
    text: str, tools: dict[int, Tool], *, stock: str = STOCK, material: str = "steel_medium_carbon",
    settings: OptimisationSettings = QUICK, control: ControlParameters = CONTROL,
    limits: CutLimit | None = None, resolution: float = 1.0, law: Material | None = None,
    **known: Any,
) -> JobRequest:  # fmt: skip
    """A program on a bare control, in a workshop without prices but for what is ``known``."""
    part = Part(program="P.nc", stock=stock, tool_table="mine", material=material,
                limits=limits or CutLimit(), resolution_mm=resolution)  # fmt: skip
    workshop = Workshop(
        table=ToolTable(tools=tools), material=law or read_material(material), drive_source="",
        catalogue=read_catalogue(),
        **({"rates": None, "drive": None, "energy": None, "dynamics": None} | known),
    )  # fmt: skip
    program = parse_program(text.encode(), "P.nc")
    return JobRequest(
        program=program, part=part, setup=Setup(), models=MachineModels(control=control),
        workshop=workshop, settings=settings, moves=interpret(program, Setup()),
    )  # fmt: skip


def optimised(
    text: str, tools: dict[int, Tool] | None = None, *, stock: str = STOCK,
    drive: SpindleDrive | None = None, **limits: Any,
) -> Result:  # fmt: skip
    """The program of ``text`` (without M30) with limits by the names of their fields."""
    given = TOOLS if tools is None else tools
    limit = CutLimit(**limits)
    return optimise_worn(request_of(f"{text}M30\n", given, stock=stock, limits=limit, drive=drive))


def document(result: Result) -> OptimisedPart:
    """As it is stored and printed."""
    return optimised_part(result, machine="mill", origin="simulated", control="identified")


def written(result: Result, letter: str = "F") -> dict[int, float]:
    """Words of the program after, by line."""
    found = {}
    for number, line in enumerate(result.answer.text.decode().splitlines(), 1):
        for word in line.split():
            if word.startswith(letter):
                found[number] = float(word[1:])
    return found
