"""The mechanics of a feed drive as one mass on a screw (Sim2023).

M x'' = k A - F_f(x') - F_g - F_d: command A times the force constant k = 2 pi k_t / L, friction,
gravity less counterbalance, load.
"""

from dataclasses import dataclass
from math import isfinite, pi

from pipeline.machine.friction import FrictionParameters, speed_after


@dataclass(frozen=True, kw_only=True)
class FeedDriveParameters:
    """One axis from its command to the carriage.

    Parameters
    ----------
    mass : float
        All that moves, the screw's and motor's inertia as mass: M + J (2 pi / L)^2 [kg].
    force_constant : float
        Force on the carriage for one unit of the command [N/A] ([N/V] where the command is a
        voltage).  1 where nobody knows it: then forces are in the command's unit, and so is M.
    friction : FrictionParameters
        Both directions.
    offset : float
        Force against positive motion that is always there: gravity less counterbalance [N].
    backlash : float
        Between the screw and the carriage [m]; 0 for none.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    mass: float
    force_constant: float
    friction: FrictionParameters
    offset: float = 0.0
    backlash: float = 0.0

    def __post_init__(self) -> None:
        for name in ("mass", "force_constant"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0):
                raise ValueError(f"feed_drive.{name} = {value} must be finite and positive")
        if not isfinite(self.offset):
            raise ValueError(f"feed_drive.offset = {self.offset} N must be finite")
        if not (isfinite(self.backlash) and self.backlash >= 0):
            raise ValueError(f"feed_drive.backlash = {self.backlash} m must be finite, at least 0")


def force_constant(torque_constant: float, lead: float) -> float:
    """Return k = 2 pi k_t / L [N/A] of a motor of k_t [N m/A] on a screw of lead L [m/rev]."""
    return 2 * pi * torque_constant / lead


def screw_step(
    x: float, v: float, command: float, load: float, period: float, drive: FeedDriveParameters
) -> tuple[float, float, float]:
    """Position and speed one step on under a held command, and friction's mean over the step.

    Position by the trapezoid, so that the balance of energy closes in each step:
    M (v_next^2 - v^2) / 2 = (k A - F_g - F_d - F_f) (x_next - x).

    Parameters
    ----------
    x, v : float
        Before the step [m], [m/s].
    command : float
        A [A].
    load : float
        F_d, against positive motion [N].
    period : float
        Length of the step [s].
    drive : FeedDriveParameters
        The axis.

    Returns
    -------
    x, v, friction : float
        [m], [m/s], [N].
    """
    force = drive.force_constant * command - drive.offset - load
    v_next, friction = speed_after(v, force, drive.mass, period, drive.friction)
    return x + 0.5 * period * (v + v_next), v_next, friction


def carriage_position(carriage: float, x: float, backlash: float) -> float:
    """Where a carriage is that the screw at ``x`` takes along at either end of a gap [m].

    A play operator: the carriage stays where friction holds it until one end of the gap reaches
    it, and has then the screw's speed.  Its shocks and its free flight are not modelled.
    """
    return min(max(carriage, x - 0.5 * backlash), x + 0.5 * backlash)
