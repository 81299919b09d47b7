"""Flank wear of the teeth of an end mill over its life, and forces of teeth that are worn apart.

dVB/dt of a tooth is (break_in / τ_b) exp(-t / τ_b) + r s (v / v_0) exp(C_2 / θ_0 (1 - θ_0 / θ))
with its share s of a turn in the material against that of a slot and the flank's temperature θ =
θ_0 (v / v_0)^p (f / f_0)^q (1 + β VB) (Usui et al. 1984; Cook 1973).  By its runout a tooth
carries more or less than its feed, and wears by the root of that.

The edge is that of :mod:`pipeline.shop.cutting.force`: size effect, ploughing that grows with the
chip, runout and tilt on true tooth paths.  Here each tooth has a land of its own, on which pressure
and friction act (Smithey, Kapoor, DeVor 2000), and the cutting force in the chip and the rubbing
one at edge and flank are kept apart, since both emit sound (Kannatey-Asibu, Dornfeld 1982).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import pi

import numpy as np

from pipeline.schema.arrays import Floats
from pipeline.shop.cutting.force import Motion, edges, pass_forces
from pipeline.shop.cutting.parameters import Conditions, EndMill, Workpiece, engaged
from pipeline.shop.parameters import Random
from pipeline.shop.wear.parameters import Cutter, PlannedCut, WearRate

STEP = 0.1
"""Step of the integration [min]."""
LOAD = (0.2, 2.5)
"""Least and greatest chip load of a tooth against the mean one [1]."""
SLICE = 0.5
"""Greatest height of a slice of the edges [mm]; its lag is below one degree."""


@dataclass(frozen=True, kw_only=True)
class WornTool:
    """One tool of its type: geometry with its own runout, and rates of its teeth against usual."""

    mill: EndMill
    teeth: Floats


def new_tool(cutter: Cutter, law: WearRate, random: Random) -> WornTool:
    """A tool as it comes out of its box into its holder, drawn."""
    runout, tilt = cutter.runout * random.rayleigh(0.8), cutter.tilt * random.rayleigh(0.8)
    angle, turned = random.uniform(-180, 180, 2)
    sharpness = np.exp(random.normal(0, cutter.edge_scatter, cutter.flutes))
    mill = EndMill(
        diameter=cutter.diameter, flutes=cutter.flutes, helix=cutter.helix,
        runout=min(float(runout), 200.0), runout_angle=float(angle),
        tilt=min(float(tilt), 20.0), tilt_angle=float(turned),
        sharpness=tuple((sharpness / sharpness.mean()).tolist()),
    )  # fmt: skip
    own = np.exp(random.normal(0, law.tooth_scatter, cutter.flutes))
    whole = np.exp(random.normal(0, law.tool_scatter))
    return WornTool(mill=mill, teeth=own * whole)


def conditions(cut: PlannedCut, cutter: Cutter, speed: float) -> Conditions:
    """Conditions of a cut as commanded, ``speed`` times as fast; speeds in steps of 10."""
    n = round(speed * cut.cutting_speed * 1e3 / (pi * cutter.diameter) / 10) * 10.0
    return Conditions(
        immersion=cut.immersion, depth=cut.depth, speed=n,
        width=cutter.diameter if cut.immersion == "slot" else min(cut.width, cutter.diameter),
        feed=round(cut.feed_per_tooth * cutter.flutes * n / 10) * 10.0,
    )  # fmt: skip


def chip_loads(mill: EndMill, conditions: Conditions) -> Floats:
    """Chip load of each tooth against the mean one at half of the depth, shape (F,) [1]."""
    radii = edges(mill, conditions.depth, conditions.depth / 3).radii[:, 1]
    # the tooth before it, in whose trace it cuts, has the number below: see `force.forces`
    more = (radii - np.roll(radii, 1)) * 1e3 / conditions.feed_per_tooth(mill.flutes)
    return np.clip(1 + more, *LOAD)


def wear_rate(
    law: WearRate, conditions: Conditions, diameter: float, load: Floats, land: Floats,
    hardness: float,
) -> Floats:  # fmt: skip
    """Rate of the flank wear of each tooth after its break-in, shape (F,) [um/min].

    ``diameter`` [mm]; ``load`` (F,) of :func:`chip_loads` [1]; ``land`` (F,) so far [um]; relative
    ``hardness`` [1].
    """
    begin, end = engaged(conditions, diameter)
    v = pi * diameter * conditions.speed * 1e-3 / law.cutting_speed
    f = conditions.feed_per_tooth(land.size) / law.feed_per_tooth
    hotter = v**law.speed_exponent * f**law.feed_exponent * (1 + law.land_heating * land * 1e-3)
    usui = np.exp(law.activation / law.temperature * (1 - 1 / hotter))
    harder = hardness**law.hardness_exponent
    share = (end - begin) / pi
    return law.rate * share * v * usui * harder * np.sqrt(load)


def flank_wear(
    law: WearRate, tool: WornTool, cuts: Sequence[Conditions], times: Floats, hardness: Floats
) -> Floats:
    """Flank wear (K, F) of each tooth of a tool at ``times`` (K,) in the cut [min] [um].

    The ``cuts`` are made by turns; ``hardness`` (K,): of the material up to each time [1].
    """
    land, now, found = np.zeros(tool.mill.flutes), 0.0, []
    loads = [chip_loads(tool.mill, one) for one in cuts]
    for until, hard in zip(times.tolist(), hardness.tolist(), strict=True):
        steps = max(int(np.ceil((until - now) / STEP)), 1)
        step = (until - now) / steps
        for _ in range(steps):
            fresh = law.break_in / law.break_in_time * np.exp(-(now + step / 2) / law.break_in_time)
            rates = [
                wear_rate(law, one, tool.mill.diameter, load, land, hard)
                for one, load in zip(cuts, loads, strict=True)
            ]
            land = land + step * (fresh + sum(rates) / len(rates)) * tool.teeth
            now += step
        found.append(land)
    return np.array(found)


def workpiece(steel: Workpiece, hardness: float) -> Workpiece:
    """A batch of the material, ``hardness`` [1] against its usual one; the force follows it."""
    names = ("tangential", "radial", "axial", "edge_tangential", "edge_radial", "flank_pressure")
    return replace(steel, **{name: getattr(steel, name) * hardness for name in names})


def cut_forces(
    conditions: Conditions, mill: EndMill, material: Workpiece, land: Floats, motion: Motion,
    length: float,
) -> Floats:  # fmt: skip
    """True forces on the tool at each step, (T, 6); ``land`` (F,) [um], block ``length`` [mm]."""
    per_radian = (motion.x[-1] - motion.x[0]) / (motion.angle[-1] - motion.angle[0])
    return pass_forces(
        conditions, mill, material, motion, flank=np.outer(land * 1e-6, material.flank(1.0)),
        length=length, slice_height=min(SLICE, conditions.depth / 4),
        feed=np.full(motion.x.size, per_radian),
    )  # fmt: skip
