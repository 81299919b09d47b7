"""Small parts that tests cut: a slot, a pocket, and what they are cut with."""

from pipeline.cutting.engagement.stock import Box
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.tool import Tool
from pipeline.machine.control.parameters import AxisParameters, ControlParameters
from pipeline.twin.control import planned_program
from pipeline.twin.cut.loads import Cut, CutJob, cut_program
from tests.gcode.following import follow

K_T, K_E = 1.23e9, 0.5  # A6061 of Sim2023 [N/m^2], [1]
LAW = ForceLaw(K_tc=K_T, K_rc=K_E * K_T)
TEN = Tool(kind="flat", diameter_mm=10.0, flutes=2, stickout_mm=30.0, price=30.0, edges=3)
SIX = Tool(kind="flat", diameter_mm=6.0, flutes=2, stickout_mm=20.0, price=20.0)
BLOCK = Box(x_mm=(0, 60), y_mm=(0, 50), z_mm=(-10, 0))
AXIS = AxisParameters(
    rapid_speed=20000, cutting_speed=10000, rapid_acceleration=5000, cutting_acceleration=5000,
    arc_acceleration=5000, corner_jump=5000,
)  # fmt: skip
CONTROL = ControlParameters(axes={"X": AXIS, "Y": AXIS, "Z": AXIS})
DEPTH = 2.0

SLOT = f"""T1 M6
G0 X-10 Y25 S6000 M3
Z5
G1 Z-{DEPTH} F300
X70 F600
G0 Z5
M30
"""


def pocket() -> str:
    """A pocket of 40 x 30 mm with the tool of 10 mm, its corners as round as the tool."""
    lines = ["T1 M6", "G0 X15 Y15 S6000 M3", "Z2", f"G1 Z-{DEPTH} F200", "F600"]
    for inset in (0.0, 4.0, 8.0):
        low, right, high = 15 + inset, 45 - inset, 35 - inset
        lines += [f"X{low} Y{low}", f"X{right}", f"Y{high}", f"X{low}", f"Y{low}"]
    return "\n".join([*lines, "X25 Y25", "X35", "G0 Z5", "M30", ""])


def cut_of(text: str, *, resolution=0.5, tools=None, laws=None, stock=BLOCK, **setup) -> Cut:
    """The cut of a program in text."""
    tools = {1: TEN, 2: SIX} if tools is None else tools
    laws = dict.fromkeys(tools, LAW) if laws is None else laws
    plan = planned_program(follow(text, **setup), CONTROL)
    job = CutJob(stock=stock, tools=tools, force_laws=laws, resolution=resolution * 1e-3,
                 offsets=setup.get("work_offsets", {}))  # fmt: skip
    return cut_program(plan, job)
