"""Whether the sampled loop of an axis is stable: its linear part, in slip and within the limit.

From one of the servo's samples to the next the deviation s = (x, v, J, v_seen, v_ref), J the
integral's share of the command as an acceleration, goes over into G s.  The loop is stable while
all eigenvalues of G lie inside the unit circle.
"""

import numpy as np
import numpy.typing as npt

from pipeline.machine.axis.feed_drive import DriveColumn, FeedDriveParameters, drive_row
from pipeline.machine.axis.servo import ServoParameters

Floats = npt.NDArray[np.float64]


def loop_matrix(rows: Floats, period: float, substeps: int = 1) -> Floats:
    """G of axes, of their less viscous direction.

    Parameters
    ----------
    rows : (..., 21) array
        Of :func:`pipeline.machine.axis.feed_drive.drive_row`.
    period : float
        Of the servo [s].
    substeps : int
        Steps of the mechanics in it.

    Returns
    -------
    (..., 5, 5) array
    """
    K, V, R, M, k, T_v, T_x = (
        rows[..., column]
        for column in (
            DriveColumn.LOOP_GAIN, DriveColumn.PROPORTIONAL, DriveColumn.INTEGRAL,
            DriveColumn.MASS, DriveColumn.FORCE_CONSTANT, DriveColumn.VELOCITY_LAG,
            DriveColumn.POSITION_LAG,
        )
    )  # fmt: skip
    seen, reached = _approach(T_v, period), _approach(T_x, period)
    zero, one = np.zeros_like(K), np.ones_like(K)
    v_seen = _row(zero, seen, zero, 1 - seen, zero)
    v_ref = _row(-reached * K, zero, zero, zero, 1 - reached)
    error = v_ref - v_seen
    J = _row(zero, zero, np.where(R > 0, one, zero), zero, zero)
    acceleration = (k * V / M)[..., np.newaxis] * error + _row(zero, zero, one, zero, zero)
    x, v = _row(one, zero, zero, zero, zero), _row(zero, one, zero, zero, zero)
    step = period / substeps
    half = 0.5 * step * np.minimum(*_viscous(rows))[..., np.newaxis] / M[..., np.newaxis]
    for _ in range(substeps):
        v_next = ((1 - half) * v + step * acceleration) / (1 + half)
        x, v = x + 0.5 * step * (v + v_next), v_next
    J_next = J + (period * k * R / M)[..., np.newaxis] * error
    return np.stack((x, v, J_next, v_seen, v_ref), axis=-2)


def stable(rows: Floats, period: float, substeps: int = 1) -> npt.NDArray[np.bool_]:
    """Whether axes are stable; parameters as of :func:`loop_matrix`, shape (...)."""
    step = period / substeps
    # beyond this the step of viscous friction turns the speed round
    viscous = np.maximum(*_viscous(rows)) * step < 2 * rows[..., DriveColumn.MASS]
    radius = np.abs(np.linalg.eigvals(loop_matrix(rows, period, substeps))).max(axis=-1)
    found: npt.NDArray[np.bool_] = viscous & (radius < 1)
    return found


def check_stability(
    servo: ServoParameters, feed_drive: FeedDriveParameters, period: float, substeps: int = 1
) -> None:
    """Refuse a servo whose loop is unstable when it samples with ``period`` [s].

    Raises
    ------
    ValueError
        With the longest period at which it is stable, or with that there is none.
    """
    row = drive_row(servo, feed_drive)
    if stable(row, period, substeps):
        return
    bandwidth = feed_drive.force_constant * servo.proportional / feed_drive.mass
    loop = f"S_pp P_p = {servo.loop_gain:.4g} 1/s, k S_vp V_p / M = {bandwidth:.4g} 1/s"
    shorter = period * np.geomspace(0.99, 1e-6, 1000)
    good = next((T for T in shorter if stable(row, T, substeps)), None)
    if good is None:
        raise ValueError(
            f"the loop ({loop}) is unstable at any period from {shorter[-1]:.2g} to {period:.4g} s:"
            " lower the position gain, the integral gain or the lags"
        )
    raise ValueError(
        f"period = {period:.4g} s is too long for the loop ({loop}), which is stable up to "
        f"{good:.3g} s: lower the gains, or let the servo run in substeps"
    )


def _approach(lag: Floats, period: float) -> Floats:
    with np.errstate(divide="ignore", over="ignore"):
        return -np.expm1(-period / lag)


def _viscous(rows: Floats) -> tuple[Floats, Floats]:
    return rows[..., DriveColumn.VISCOUS_POSITIVE], rows[..., DriveColumn.VISCOUS_NEGATIVE]


def _row(*entries: Floats) -> Floats:
    return np.stack(entries, axis=-1)
