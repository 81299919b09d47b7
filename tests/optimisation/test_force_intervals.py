"""Forces of each tool with their intervals: of draws that have one runout, whatever the slope."""

from dataclasses import replace
from itertools import product

import pytest

from pipeline.cutting.tool import Tool
from pipeline.optimisation.reliability.part_loads import cut_ranges, force_intervals
from pipeline.optimisation.reliability.uncertainty import uncertainty
from pipeline.optimisation.settings import ReliabilitySettings
from pipeline.schema.program_cut import ForceInterval
from pipeline.twin.cut.coefficients import ToolCoefficients
from pipeline.twin.cut.loads import Cut
from tests.optimisation.test_reliability import EDGES, SURE
from tests.twin.cut_parts import cut_of

BEGIN = "T1 M6\nG0 X15 Y25 S6000 M3\nZ1\n"
PROGRAMS = {
    "slot": BEGIN + "G1 Z-2 F200\nX45 F600\nG0 Z5\nM30\n",
    "ramp": BEGIN + "G1 Z0 F200\nX45 Z-2 F600\nX15 Z-4\nG0 Z5\nM30\n",
    "steep ramp": BEGIN + "G1 Z0 F200\nX20 Z-6 F300\nG0 Z5\nM30\n",
    "upwards": BEGIN + "G1 Z-4 F200\nX45 Z-1 F600\nG0 Z5\nM30\n",
    "helix": BEGIN + "G1 Z0 F200\n" + "".join(
        f"G3 X15 Y25 I5 J0 Z-{z} F600\n" for z in (1, 2, 3)) + "G0 Z5\nM30\n",
    "plunge": BEGIN + "G1 Z-6 F200\nG0 Z5\nM30\n",
}  # fmt: skip
MILL = Tool(kind="flat", diameter_mm=10.0, flutes=3, helix_deg=30.0)
TOOLS = {
    "flat": MILL,
    "flat, 6 flutes, known runout": replace(MILL, flutes=6, runout_um=8.0),
    "flat, 1 flute": replace(MILL, flutes=1),
    "bull nose": replace(MILL, kind="bull_nose", corner_radius_mm=2.0, flutes=2),
    "ball": replace(MILL, kind="ball", flutes=4),
    "drill": Tool(kind="drill", diameter_mm=8.0, flutes=2, point_angle_deg=118.0),
    "drill, known runout": Tool(kind="drill", diameter_mm=8.0, flutes=2, runout_um=10.0),
    "chamfer mill": Tool(kind="drill", role="chamfer_mill", diameter_mm=10.0, flutes=4,
                         point_angle_deg=90.0),
}  # fmt: skip


def interval(cut: Cut, certainty: ReliabilitySettings) -> ForceInterval:
    laws = {1: ToolCoefficients(law=EDGES, kind="measured", source="one")}
    uncertain = uncertainty(laws, {1: cut.tools[0]}, None, None, certainty, ranges=cut_ranges(cut))
    (found,) = force_intervals(cut, uncertain, laws, None, seed=0)
    return found


@pytest.mark.parametrize(
    ("name", "program"),
    [
        ("flat", "helix"), ("flat", "plunge"), ("flat, 6 flutes, known runout", "ramp"),
        ("flat, 1 flute", "plunge"), ("bull nose", "steep ramp"), ("ball", "upwards"),
        ("drill", "plunge"), ("drill, known runout", "plunge"), ("chamfer mill", "slot"),
    ],
)  # fmt: skip
def test_no_load_is_outside_of_its_interval(name: str, program: str) -> None:
    _check(name, program)


@pytest.mark.proof
@pytest.mark.parametrize(("name", "program"), list(product(TOOLS, PROGRAMS)))
def test_no_load_of_any_tool_on_any_slope_is_outside_of_its_interval(
    name: str, program: str
) -> None:
    _check(name, program)


def _check(name: str, program: str) -> None:
    """In order, and where runout alone is uncertain between the loads without it and with much."""
    cut, far = (
        cut_of(PROGRAMS[program], tools={1: one}, laws={1: EDGES}, resolution=1.0)
        for one in (TOOLS[name], replace(TOOLS[name], runout_um=12.0))
    )
    for certainty in (ReliabilitySettings(), replace(SURE, runout_um=3.0)):
        found = interval(cut, certainty)
        low, peak, high = found.peak_load_low_N, found.peak_load_N, found.peak_load_high_N
        means = found.mean_load_low_N, found.mean_load_N, found.mean_load_high_N
        assert 0.0 <= low <= peak <= high
        assert 0.0 <= means[0] <= means[1] <= means[2]
        assert means[1] <= peak
    assert high <= 1.02 * far.station_loads.peak.max()  # Rayleigh's of 3 um is seldom above 7
    if not TOOLS[name].runout:
        assert low >= 0.98 * cut.station_loads.peak.max()


def test_a_drill_has_the_runout_of_its_draws() -> None:
    """Lips that balance have no load but for runout, which is in the load and in its interval."""
    cut = cut_of(PROGRAMS["plunge"], tools={1: TOOLS["drill"]}, laws={1: EDGES}, resolution=1.0)
    assert cut.station_loads.peak.max() == 0.0
    found = interval(cut, ReliabilitySettings())
    assert found.peak_load_low_N < found.peak_load_N < found.peak_load_high_N
    assert found.runout == "not known, Rayleigh's scale 3 um"
    still = interval(cut, ReliabilitySettings(runout_um=0.0))
    assert (still.peak_load_low_N, still.peak_load_N, still.mean_load_high_N) == (0.0, 0.0, 0.0)
