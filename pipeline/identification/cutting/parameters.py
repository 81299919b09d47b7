"""What a fit says of each parameter: value, 95 % interval, and whether it is determined."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.force.force_law import N_MM, N_MM2
from pipeline.cutting.force.mean_force import COEFFICIENTS
from pipeline.cutting.tool import DEGREE, UM
from pipeline.identification.cutting.certainty import Certain
from pipeline.identification.cutting.fit import Fit

Floats = NDArray[np.float64]

UNITS = ("N/mm^2", "N/mm^2", "N/mm^2", "N/mm", "N/mm", "N/mm")
SCALES = (N_MM2, N_MM2, N_MM2, N_MM, N_MM, N_MM)
BESIDE = 0.1
"""A small coefficient is determined by a share of this share of the tangential one."""
ANGLE_DEG = 45.0
"""Half an interval of the runout's angle, at most."""
HELIX_DEG = 10.0
"""Half an interval of the helix angle, at most."""
RUNOUT = 0.1
"""Of the feed for each tooth: a runout is determined by a share of this much."""
NORMAL = 1.96
"""Standard deviations of half a 95 % interval."""
WAVEFORM = "weighted least squares on the harmonics of the revolution"


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One parameter; value and interval are told where it is determined.

    Parameters
    ----------
    name, unit, how : str
        Its name, its unit, where it is from.
    value, half_width : float
        In the unit; half of the 95 % interval.
    lowest : float
        Below which its interval does not go.
    determined : bool
        Whether the records determine it.
    reason : str
        Why not, and what to record; or what it means.
    """

    name: str
    unit: str
    value: float
    half_width: float
    determined: bool
    how: str
    reason: str = ""
    lowest: float = -np.inf


def parameters(
    fit: Fit, sure: Certain, widest: float, means: Sequence[Parameter]
) -> list[Parameter]:
    """Coefficients, runout and helix of a fit.

    The mean forces of the same records should say the same of a coefficient as their waveform.
    What lies between both is a sample of the difference of two errors of the model: their standard
    deviation is that over the root of two, and widens the interval of the waveform's.  A
    coefficient that only the mean forces determine is theirs.
    """
    half = np.array([sure.half_width(_unit(sure, name)) for name in COEFFICIENTS])
    apart = np.abs(np.array([one.value for one in means]) * SCALES - fit.values[:6])
    unexplained = NORMAL * np.where(np.isfinite(apart), apart, 0.0) / np.sqrt(2.0)
    found = coefficients(
        fit.values[:6], np.hypot(half, unexplained),
        float(np.mean([cut.conditions.f_z for cut in fit.problem.cuts])), widest, WAVEFORM,
    )  # fmt: skip
    better = [
        mean if mean.determined and not one.determined else one
        for one, mean in zip(found, means, strict=True)
    ]
    return [*better, *_runout(fit, sure, widest), _helix(fit, sure)]


def coefficients(
    values: Floats, half: Floats, f_z: float, widest: float, how: str
) -> list[Parameter]:
    """The six coefficients of the linear-edge law.

    Parameters
    ----------
    values, half : ndarray, shape (6,)
        And halves of their 95 % intervals [N/m^2], [N/m].
    f_z : float
        Mean feed for each tooth [m].
    widest : float
        Half an interval that is wider, as a share, is no determination [1].
    how : str
        Where they are from.
    """
    edge = max(abs(values[3]), abs(values[0]) * f_z)
    beside = BESIDE * np.array([abs(values[0])] * 3 + [edge] * 3)
    found = []
    for k, name in enumerate(COEFFICIENTS):
        told = bool(half[k] <= widest * max(abs(values[k]), beside[k]))
        reason = "" if told else (
            f"its 95 % interval is {half[k] / SCALES[k]:.3g} {UNITS[k]} to both sides: record cuts "
            "of the same tool at three feeds or more"
        )  # fmt: skip
        one = Parameter(
            name=name, unit=UNITS[k], value=values[k] / SCALES[k], determined=told,
            half_width=half[k] / SCALES[k], how=how, reason=reason,
        )  # fmt: skip
        found.append(one)
    return found


def _unit(sure: Certain, name: str, size: float = 1.0) -> Floats:
    slope = np.zeros(len(sure.names))
    if name in sure.names:
        slope[sure.names.index(name)] = size
    return slope


def _runout(fit: Fit, sure: Certain, widest: float) -> list[Parameter]:
    """Runout, and its angle from the tooth that stands out most."""
    flutes = fit.problem.tool.flutes
    here = fit.problem.geometry(fit.x)
    offset = complex(here.along, here.across)
    size, angle = abs(offset), float(np.angle(offset))
    outward = offset / size if size > 0 else 1.0
    radial = _unit(sure, "along", outward.real) + _unit(sure, "across", outward.imag)
    half = sure.half_width(radial)
    f_z = float(np.mean([cut.conditions.f_z for cut in fit.problem.cuts]))
    told = flutes > 1 and half <= widest * max(size, RUNOUT * f_z)
    wide = (
        f"its 95 % interval is {half / UM:.2g} um to both sides, in slots edges of different teeth "
        "look the same: record partial immersions, or several feeds"
    )
    if flutes == 1:
        reason = "a single tooth has no other beside which it could stand out"
    elif flutes == 2 and told:
        reason = "of two teeth: half the difference of their radii, the part along them"
    else:
        reason = "" if told else wide
    found = Parameter(
        name="runout", unit="um", value=size / UM, half_width=half / UM, determined=told,
        how=WAVEFORM, reason=reason, lowest=0.0,
    )  # fmt: skip
    across = _unit(sure, "along", -outward.imag) + _unit(sure, "across", outward.real)
    turn = sure.half_width(across) / max(size, 1e-12)
    pitch = 2 * np.pi / flutes
    sharp = flutes > 2 and turn <= ANGLE_DEG * DEGREE
    why = "two teeth do not tell it" if flutes == 2 else "the runout is too small to have one"
    return [
        found,
        Parameter(
            name="runout_angle", unit="deg", determined=sharp,
            value=(angle - pitch * round(angle / pitch)) / DEGREE, half_width=turn / DEGREE,
            how=WAVEFORM,
            reason="from the tooth that stands out most, within half a pitch" if sharp else why,
        ),
    ]  # fmt: skip


def _helix(fit: Fit, sure: Certain) -> Parameter:
    helix = fit.problem.geometry(fit.x).helix
    if not fit.problem.terms.helix:
        reason = f"{helix / DEGREE:g} deg was taken: the records do not tell another"
        return Parameter(
            name="helix", unit="deg", value=helix / DEGREE, half_width=0.0, determined=False,
            how="given", reason=reason,
        )  # fmt: skip
    half = sure.half_width(_unit(sure, "tan_helix")) * np.cos(helix) ** 2 / DEGREE
    told = bool(half <= HELIX_DEG)
    return Parameter(
        name="helix", unit="deg", value=helix / DEGREE, half_width=half, determined=told,
        how=WAVEFORM, reason="" if told else "record a deeper cut, in which the edge lags further",
    )  # fmt: skip


def modes(fit: Fit, sure: Certain, widest: float) -> dict[int, list[Parameter]]:
    """Natural frequency and damping of the channels that show feed (0), normal (1), axis (2)."""
    told = fit.problem.modes(fit.x)
    if told is None:
        return {}
    highest = max(cut.conditions.speed * cut.harmonics for cut in fit.problem.cuts)
    found = {}
    for k in range(3):
        rows = []
        for what, values, unit in (("natural", told[0], "Hz"), ("damping", told[1], "1")):
            half = sure.half_width(_unit(sure, f"log_{what}{k}"))
            seen = told[0][k] <= highest
            name = "natural_frequency_Hz" if what == "natural" else "damping"
            rows.append(
                Parameter(
                    name=name, unit=unit, value=float(values[k]), lowest=0.0,
                    half_width=half * float(values[k]), determined=bool(half <= widest and seen),
                    how=WAVEFORM,
                    reason="" if half <= widest and seen else
                    f"the channel shows no mode of its own below {highest:.0f} Hz",
                )
            )  # fmt: skip
        found[k] = rows
    return found
