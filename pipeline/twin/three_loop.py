"""A feed axis down to its currents: three loops, modulation, motor, one or two masses, friction.

Position P with feed-forward, speed PI or fuzzy PI, currents PI, space-vector modulation (mean or
switched), synchronous motor, shaft that twists, guideway with Stribeck friction (Feed2025).  What
happens within a step is in :mod:`pipeline.machine.drive_train`, the loops in
:mod:`pipeline.machine.cascade`; here their parameters come together.
"""

from dataclasses import dataclass
from math import isinf

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from pipeline.machine.motor import magnetic_energy
from pipeline.twin.three_loop_parameters import ThreeLoopParameters, check_steps

Floats = npt.NDArray[np.float64]
_LONGEST = 1e9
"""Periods of the current loops between two samples."""


@dataclass(frozen=True, kw_only=True)
class ThreeLoopTrace:
    """An axis at T samples; every array has shape (T,).  Simulated.

    Parameters
    ----------
    time : ndarray
        [s].
    reference : ndarray
        Position [m] or speed [rad/s], whichever was followed.
    position, motor_position : ndarray
        Carriage, and motor's angle times L / 2 pi [m].
    speed, load_speed : ndarray
        Of the motor, and of the load about its shaft [rad/s].
    i_d, i_q : ndarray
        [A].
    u_d, u_q : ndarray
        Mean over the period of the current loops that ends there [V].
    torque : ndarray
        T_e [N m].
    friction : ndarray
        Of the guideway, against positive motion [N]; for rigid shafts that stand, with the motor's.
    proportional, integral : ndarray
        K_p [N m s/rad] and K_i [N m/rad] of the speed loop in the period that ends there.
    electrical_work, copper_loss, shaft_work, mechanical_loss, load_work : ndarray
        Since the start [J]: into the motor, lost in its windings, of T_e, lost to friction and
        damping, done on the load.
    magnetic, kinetic, elastic : ndarray
        Energy that is stored [J].
    """

    time: Floats
    reference: Floats
    position: Floats
    motor_position: Floats
    speed: Floats
    load_speed: Floats
    i_d: Floats
    i_q: Floats
    u_d: Floats
    u_q: Floats
    torque: Floats
    friction: Floats
    proportional: Floats
    integral: Floats
    electrical_work: Floats
    copper_loss: Floats
    shaft_work: Floats
    mechanical_loss: Floats
    load_work: Floats
    magnetic: Floats
    kinetic: Floats
    elastic: Floats


def follow_position(
    reference: ArrayLike,
    period: float,
    drive: ThreeLoopParameters,
    *,
    load: ArrayLike = 0.0,
    steps: int = 5,
) -> ThreeLoopTrace:
    """Let the axis follow positions, from rest at the first of them.

    Parameters
    ----------
    reference : array_like, shape (T,)
        Positions [m], straight between samples.
    period : float
        Time between samples [s], a whole multiple of the current loops' period.
    drive : ThreeLoopParameters
        The axis.
    load : array_like, shape (T,) or ()
        Force on the carriage against positive motion [N], held from sample to sample.
    steps : int
        Steps of the integrator in one period of the current loops.

    Raises
    ------
    ValueError
        When an input does not fit, or the drive runs away.
    """
    if drive.position_loop is None:
        raise ValueError("drive.position_loop is missing: give one, or follow speeds")
    return _follow(reference, period, drive, load, steps, position=True)


def follow_speed(
    reference: ArrayLike,
    period: float,
    drive: ThreeLoopParameters,
    *,
    load: ArrayLike = 0.0,
    steps: int = 5,
) -> ThreeLoopTrace:
    """Let the motor follow speeds, from rest; the position loop is left open.

    Parameters
    ----------
    reference : array_like, shape (T,)
        Speeds of the motor [rad/s], held from sample to sample.
    period, drive, load, steps
        As in :func:`follow_position`.

    Raises
    ------
    ValueError
        When an input does not fit, or the drive runs away.
    """
    return _follow(reference, period, drive, load, steps, position=False)


def _follow(
    reference: ArrayLike,
    period: float,
    drive: ThreeLoopParameters,
    load: ArrayLike,
    steps: int,
    *,
    position: bool,
) -> ThreeLoopTrace:
    from pipeline.machine.cascade import COLUMNS, MEMORY, follow
    from pipeline.machine.drive_train import ROOM, STATES, TH_L, TH_M
    from pipeline.twin.three_loop_kernel import loops, shafts, winding

    asked = _samples("reference", reference)
    force = _samples("load", load, asked.size)
    clock = drive.current_loop.period
    check_steps(drive, steps)
    ratio = drive.transmission.ratio
    y = np.zeros(STATES)
    if position:
        y[TH_M] = y[TH_L] = asked[0] / ratio
    out = np.empty((asked.size, COLUMNS))
    reached = follow(
        asked, force * ratio, _periods(period, clock), winding(drive.motor), shafts(drive),
        loops(drive, steps, position), y, np.zeros(MEMORY), np.zeros((ROOM, STATES)), out,
    )  # fmt: skip
    if reached < asked.size or not np.isfinite(out).all():
        raise ValueError(
            f"the drive runs away at {reached * period:.4g} s: lower the gains of the position or "
            "speed loop, or the load"
        )
    return _trace(asked, period, drive, out)


def _samples(name: str, values: ArrayLike, many: int | None = None) -> Floats:
    found = np.array(values, dtype=np.float64)
    if many is not None and found.ndim == 0:
        found = np.full(many, found)
    if found.ndim != 1 or (many is None and found.size == 0):
        raise ValueError(f"{name} has shape {found.shape}, but must be one row of samples")
    if many is not None and found.size != many:
        raise ValueError(f"{name} has {found.size} samples, but the reference has {many}")
    wrong = np.flatnonzero(~np.isfinite(found))
    if wrong.size:
        raise ValueError(f"{name}[{wrong[0]}] = {found[wrong[0]]} must be finite")
    return found


def _periods(period: float, clock: float) -> int:
    many = round(period / clock) if 0 < period < _LONGEST * clock else 0
    if many < 1 or abs(many * clock - period) > 1e-9 * period:
        raise ValueError(
            f"period = {period} s must be a whole multiple of current_loop.period = {clock} s, "
            f"less than {_LONGEST:g} of it"
        )
    return many


def _trace(
    reference: Floats, period: float, drive: ThreeLoopParameters, out: Floats
) -> ThreeLoopTrace:
    from pipeline.machine import cascade as c
    from pipeline.machine import drive_train as d

    motor, transmission = drive.motor, drive.transmission
    i_d, i_q, w_m, w_l = out[:, d.I_D], out[:, d.I_Q], out[:, d.W_M], out[:, d.W_L]
    kinetic = (motor.inertia * w_m**2 + transmission.load_inertia * w_l**2) / 2
    twist = out[:, d.TH_M] - out[:, d.TH_L]
    rigid = isinf(transmission.stiffness)
    return ThreeLoopTrace(
        time=period * np.arange(reference.size, dtype=np.float64),
        reference=reference,
        position=transmission.ratio * out[:, d.TH_L],
        motor_position=transmission.ratio * out[:, d.TH_M],
        speed=w_m,
        load_speed=w_l,
        i_d=i_d,
        i_q=i_q,
        u_d=out[:, c.U_D],
        u_q=out[:, c.U_Q],
        torque=out[:, c.TORQUE],
        friction=out[:, c.FRICTION] / transmission.ratio,
        proportional=out[:, c.GAIN_P],
        integral=out[:, c.GAIN_I],
        electrical_work=out[:, d.INPUT],
        copper_loss=out[:, d.COPPER],
        shaft_work=out[:, d.SHAFT],
        mechanical_loss=out[:, d.LOST],
        load_work=out[:, d.LOAD],
        magnetic=magnetic_energy(i_d, i_q, motor),
        kinetic=kinetic,
        elastic=np.zeros_like(twist) if rigid else transmission.stiffness * twist**2 / 2,
    )
