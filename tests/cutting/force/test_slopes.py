"""Forces on ramps, helices and plunges against discs of the edge, whose chips ask no kernel."""

from itertools import product

import numpy as np
import pytest

from pipeline.cutting.force.drawn_loads import drawn_loads, edge_turn
from pipeline.cutting.force.force_law import ForceLaw
from pipeline.cutting.force.load_table import load_table
from pipeline.cutting.tool import Kind, Tool
from tests.cutting.plain_forces import plain_forces
from tests.cutting.tool_paths import BINS, arc, stations

F_Z = 5e-5
BARS = [0.02, 0.03, 0.02, 0.02]
"""Of :func:`errors` [1]; draws have teeth 7.5 degrees apart."""
UPWARDS = [0.05, 0.06, 0.04, 0.04]
"""A corner cuts with little of its length there, and with runout chips end within its pieces."""
LINEAR = ForceLaw.linear(K_tc=800.0, K_rc=300.0, K_ac=120.0, K_te=20.0, K_re=15.0, K_ae=3.0)
BENT = ForceLaw.kienzle(k_c11=1500.0, m_c=0.25, radial=0.4, axial=0.1)
ANGLES = 144
"""Of a turn, every 2.5 degrees: a peak of the load between them is 0.1 % higher."""


def tool(kind: Kind, flutes: int, runout: float) -> Tool:
    return Tool(
        kind=kind, diameter_mm=10.0, flutes=flutes, helix_deg=30.0, point_angle_deg=118.0,
        runout_um=runout, runout_deg=25.0, corner_radius_mm=2.0 if kind == "bull_nose" else 0.0,
    )  # fmt: skip


def profile(down: float) -> tuple[np.ndarray, np.ndarray]:
    """In front of a tool 4 mm deep; on its way down its end lies on half of what is behind, too."""
    if down == 90.0:
        return arc(0, 7, 4e-3)
    lower, upper = arc(0, np.pi, 4e-3)
    return lower, np.maximum(upper, arc(np.pi, 1.5 * np.pi, 3e-4 if down > 0 else 0.0)[1])


def discs(law: ForceLaw, one: Tool, down: float, many: int = 300) -> np.ndarray:
    lower, upper = profile(down)

    def inside(phi: np.ndarray, z: np.ndarray) -> np.ndarray:
        k = (phi * BINS / (2 * np.pi)).astype(int) % BINS
        return np.asarray((z >= lower[k]) & (z < upper[k]))

    angles = (np.arange(ANGLES) + 0.5) * (2 * np.pi / ANGLES)
    slope = -float(np.sin(np.radians(down)))
    return plain_forces(law, one, F_Z, 0.0, upper.max(), inside, angles, many, slope=slope)


def errors(law: ForceLaw, kind: Kind, flutes: int, runout: float, down: float) -> np.ndarray:
    """Of the peak, of a draw's, of mean load and torque, over the greatest force there is.

    A draw's is as :mod:`pipeline.optimisation.reliability.part_loads` takes it: what runout adds.
    """
    one, plain = tool(kind, flutes, runout), tool(kind, flutes, 0.0)
    true = discs(law, one, down)
    load, force = np.hypot(true[:, 0], true[:, 1]), np.linalg.norm(true[:, :3], axis=1).max()
    slope, heights = -float(np.sin(np.radians(down))), profile(down)
    cut = stations([heights], [0], 1, slope=slope)
    tables = [load_table(cut, [of], [law], F_Z).loads([F_Z]) for of in (one, plain)]
    angle = np.array([np.cos(one.runout_angle), np.sin(one.runout_angle)])
    with_runout, without = drawn_loads(
        edge_turn(one, *heights, slope=slope), [law.constants] * 2,
        [one.runout * angle, 0 * angle], [F_Z], m_c=law.m_c,
    )[0]  # fmt: skip
    found = np.array([
        tables[0].peak[0], tables[1].peak[0] + with_runout - without, tables[0].mean[0],
        tables[0].torque[0] / one.radius,
    ])  # fmt: skip
    torque = true[:, 3].mean() / one.radius
    return np.abs(found - [load.max(), load.max(), load.mean(), torque]) / force


@pytest.mark.parametrize(
    ("law", "kind", "flutes", "runout", "down"),
    [
        (LINEAR, "flat", 3, 10.0, 3.0),
        (LINEAR, "flat", 6, 0.0, 30.0),
        (BENT, "flat", 4, 5.0, 60.0),
        (LINEAR, "flat", 2, 10.0, 90.0),
        (LINEAR, "bull_nose", 4, 10.0, 10.0),
        (BENT, "bull_nose", 2, 0.0, -20.0),
        (LINEAR, "ball", 3, 0.0, -30.0),
        (LINEAR, "ball", 2, 10.0, 20.0),
        (LINEAR, "ball", 3, 10.0, 90.0),
        (BENT, "drill", 2, 10.0, 90.0),
        (LINEAR, "drill", 3, 10.0, 45.0),
    ],
)
def test_a_slope_has_the_forces_of_its_discs(law, kind, flutes, runout, down) -> None:
    assert (errors(law, kind, flutes, runout, down) < BARS).all()


@pytest.mark.proof
@pytest.mark.parametrize("kind", ["flat", "bull_nose", "ball", "drill"])
@pytest.mark.parametrize("law", [LINEAR, BENT], ids=["linear", "bent"])
def test_all_slopes_have_the_forces_of_their_discs(kind: Kind, law: ForceLaw) -> None:
    """0 to 90 degrees down and, but for drills, up; 2 to 6 flutes; runout 0 to 10 um."""
    downs = [*range(0, 91, 10), 3, *([] if kind == "drill" else (-5, -30, -60))]
    for flutes, runout, down in product(range(2, 7), (0.0, 3.0, 10.0), downs):
        found = errors(law, kind, flutes, runout, float(down))
        assert (found < (BARS if down >= 0 else UPWARDS)).all(), (flutes, runout, down, found)
