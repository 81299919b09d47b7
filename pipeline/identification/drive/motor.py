"""Parameters of a synchronous motor and its shaft from recorded currents, voltages and speed.

u_d = R i_d + L_d di_d/dt - w_e L_q i_q, u_q = R i_q + L_q di_q/dt + w_e (L_d i_d + phi), and
T_e = J dw/dt + B w + T_c sign w + T_l (Feed2025), linear in what is sought once integrated over
windows.  What the record does not excite is not determined, and why is said.

Where the voltages are the ones commanded, the inverter takes its dead time from them: a voltage of
constant height along the current, u_0 i / |i|, which least squares without it takes for resistance
(Jeong and Park 1991).  It is sought too, and kept where the record shows it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.identification.drive.modulating import ModulatingSettings, Windows
from pipeline.identification.drive.split_sample import SplitFit, split_fit

Floats = NDArray[np.float64]
ELECTRICAL = {"resistance": "ohm", "inductance_d": "H", "inductance_q": "H", "flux": "Wb"}
DEAD_VOLTAGE = {"dead_voltage": "V"}
SHOWN = 2.0
"""Half widths of its interval that a dead voltage must come to: chance comes to it once in 10^4."""
MECHANICAL = {"inertia": "kg m^2", "damping": "N m s/rad", "coulomb": "N m", "load": "N m"}
SMALL_TORQUE = 0.05
"""Share of the record's torque within which a part of it may be wrong and still be known."""


@dataclass(frozen=True, kw_only=True)
class MotorFitSettings:
    """How a motor is identified.

    Parameters
    ----------
    modulating : ModulatingSettings
        Windows over which the equations are integrated.
    widest : float
        Half width of the 95 % interval beyond which a parameter is not determined, as a share of
        its value [1].

    Raises
    ------
    ValueError
        When a setting is out of its range.
    """

    modulating: ModulatingSettings = field(default_factory=ModulatingSettings)
    widest: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.widest <= 1:
            raise ValueError(f"motor_fit.widest = {self.widest} must lie above 0, at most 1")


@dataclass(frozen=True, kw_only=True)
class MotorFit:
    """What a record tells of a motor, in the order of ``names``.

    Parameters
    ----------
    names, units : tuple of str, length D
        The parameters.
    values : ndarray, shape (D,)
        nan where the record does not determine them.
    low, high : ndarray, shape (D,)
        95 % interval; infinite where nothing bounds it.
    determined : ndarray of bool, shape (D,)
        Whether the record determines them.
    reasons : dict of str to str
        Why the others are not determined.
    condition : float
        Condition number of the regressors that are excited, each scaled to length one [1].
    correlation : ndarray, shape (D, D)
        Of the parameters.
    windows, left_out : int
        Windows fitted, and left out because a sample in them is no number.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: Floats
    low: Floats
    high: Floats
    determined: NDArray[np.bool_]
    reasons: dict[str, str]
    condition: float
    correlation: Floats
    windows: int
    left_out: int


def identify_motor(
    u_d: ArrayLike,
    u_q: ArrayLike,
    i_d: ArrayLike,
    i_q: ArrayLike,
    w_e: ArrayLike,
    period: float,
    settings: MotorFitSettings,
) -> MotorFit:
    """Resistance, both inductances, the magnets' flux linkage, and the inverter's dead voltage.

    The last is left out where the record does not clearly show it: measured voltages have none.

    Parameters
    ----------
    u_d, u_q : array_like, shape (T,)
        Voltages [V], amplitude-invariant; ``settings.modulating.held`` says whether they are held.
    i_d, i_q : array_like, shape (T,)
        Currents [A].
    w_e : array_like, shape (T,)
        Electrical speed [rad/s], pole pairs times the shaft's.
    period : float
        Between samples [s].
    settings : MotorFitSettings
        How they are found.

    Raises
    ------
    ValueError
        When the series are no record or too short for a window.
    """
    cut = Windows(
        {"u_d": u_d, "u_q": u_q, "i_d": i_d, "i_q": i_q, "w_e": w_e}, period, settings.modulating
    )
    d, q, w = (cut.signals[name] for name in ("i_d", "i_q", "w_e"))
    none = np.zeros((2, len(cut), settings.modulating.orders))
    along_d = [cut.halves(d), cut.rates(d), -cut.halves(w * q), none]
    along_q = [cut.halves(q), cut.halves(w * d), cut.rates(q), cut.halves(w)]
    driven = [cut.driven("u_d"), cut.driven("u_q")]
    size = np.maximum(np.hypot(d, q), np.finfo(float).tiny)
    fit = _fit([[*along_d, cut.halves(d / size)], [*along_q, cut.halves(q / size)]], driven)
    units = ELECTRICAL | DEAD_VOLTAGE
    if not fit.values[-1] > SHOWN * fit.half_width[-1]:
        fit, units = _fit([along_d, along_q], driven), ELECTRICAL
    return _judged(units, fit, cut, settings.widest * np.abs(fit.values), positive=4)


def identify_shaft(
    torque: ArrayLike, speed: ArrayLike, period: float, settings: MotorFitSettings
) -> MotorFit:
    """Inertia, damping, Coulomb friction and a constant load.

    Damping, friction and load may be zero: they are determined too when they are known within
    :data:`SMALL_TORQUE` of the record's torque (root mean square).

    Parameters
    ----------
    torque : array_like, shape (T,)
        T_e [N m]; ``settings.modulating.held`` says whether it is held.
    speed : array_like, shape (T,)
        w of the shaft [rad/s].
    period : float
        Between samples [s].
    settings : MotorFitSettings
        How they are found.

    Raises
    ------
    ValueError
        When the series are no record or too short for a window.
    """
    cut = Windows({"torque": torque, "speed": speed}, period, settings.modulating)
    w = cut.signals["speed"]
    turns = [cut.rates(w), cut.halves(w), cut.halves(np.sign(w)), cut.halves(np.ones_like(w))]
    fit = _fit([turns], [cut.driven("torque")])
    greatest = SMALL_TORQUE * float(np.sqrt(np.mean(cut.signals["torque"] ** 2)))
    fast = float(np.sqrt(np.mean(w**2)))
    small = np.array([0.0, greatest / fast if fast > 0 else 0.0, greatest, greatest])
    widest = np.maximum(settings.widest * np.abs(fit.values), small)
    return _judged(MECHANICAL, fit, cut, widest, positive=1)


def _fit(equations: Sequence[Sequence[Floats]], driven: Sequence[Floats]) -> SplitFit:
    """Fit equations, each of D regressors of shape (2, B, orders), to what drives them."""
    regressors = np.concatenate(
        [np.stack(one, axis=-1).reshape(2, -1, len(one)) for one in equations], axis=1
    )
    blocks = np.concatenate([np.repeat(np.arange(len(y)), y.shape[1]) for y in driven])
    return split_fit(regressors, np.concatenate([y.ravel() for y in driven]), blocks)


def _judged(
    units: dict[str, str], fit: SplitFit, cut: Windows, widest: Floats, *, positive: int
) -> MotorFit:
    """What is known, the first ``positive`` parameters of which must be above 0."""
    reasons = {}
    for k, (name, unit) in enumerate(units.items()):
        value, half = float(fit.values[k]), float(fit.half_width[k])
        told = f"its 95 % interval {value:.3g} ± {half:.2g} {unit}"
        if not fit.excited[k]:
            reasons[name] = "the record does not excite it beyond its noise"
        elif fit.interchangeable[k]:
            reasons[name] = "others can take its place: the record does not tell them apart"
        elif not np.isfinite(half):
            reasons[name] = f"{len(cut)} windows are too few for an interval"
        elif half > widest[k]:
            reasons[name] = f"{told} is wider than {widest[k]:.2g} {unit} either way"
        elif k < positive and value <= 0:
            reasons[name] = f"{told} is not above 0: check the signs of the recorded axes"
    determined = np.array([name not in reasons for name in units])
    return MotorFit(
        names=tuple(units),
        units=tuple(units.values()),
        values=np.where(determined, fit.values, np.nan),
        low=fit.values - fit.half_width,
        high=fit.values + fit.half_width,
        determined=determined,
        reasons=reasons,
        condition=fit.condition,
        correlation=fit.correlation,
        windows=len(cut),
        left_out=cut.left_out,
    )
