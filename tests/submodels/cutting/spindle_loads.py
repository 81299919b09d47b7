"""A spindle that shows its load: what a log would hold of it, written independently of the fit."""

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.submodels.cutting.spindle_load.levels import LoadLog, LoadScale

RATED_W = 15e3
BASE = 3000 / 60  # rev/s
NO_LOAD = (120.0, 4.0, 0.03)  # W, W s, W s^2: 1128 W at 8400 rpm
K_TC, K_TE = 800e6, 20e3
D, FLUTES = 12e-3, 3


DRIVE = SpindleDrive(
    rated_power_kW=RATED_W / 1e3, base_speed_rpm=BASE * 60, top_speed_rpm=12e3
)  # fmt: skip
SCALE = LoadScale(drive=DRIVE)


def free_power(n: np.ndarray) -> np.ndarray:
    return NO_LOAD[0] + NO_LOAD[1] * n + NO_LOAD[2] * n**2


def shown(power: np.ndarray, n: np.ndarray, step: float, noise: float, random) -> np.ndarray:
    """Percent of the power available, noisy over a second, in steps of the display."""
    full = RATED_W * np.minimum(1.0, n / BASE)
    wander = random.standard_normal(len(n) + 20)
    wander = np.convolve(wander, np.ones(5) / np.sqrt(5), mode="same")[10:-10]
    percent = 100 * power / np.maximum(full, 1.0) + noise * wander
    return np.round(percent / step) * step if step else percent


def no_load_log(random, speeds_rpm: list[float], *, step: float, noise: float) -> LoadLog:
    """Steps of speed, 15 s each, with ramps of 2 s between them that take power."""
    pieces, power = [], []
    last = 0.0
    for rpm in speeds_rpm:
        n = rpm / 60
        ramp = np.linspace(last, n, 20)
        pieces += [ramp, np.full(150, n)]
        power += [free_power(ramp) + 4e3, np.full(150, free_power(np.array(n)))]
        last = n
    n, P = np.concatenate(pieces), np.concatenate(power)
    return LoadLog(
        times=np.arange(len(n)) / 10, speed=n, load=shown(P, n, step, noise, random)
    )  # fmt: skip


def cut_log(
    random, cuts: list[tuple[float, float, float]], *, step: float, noise: float, spread: float
) -> LoadLog:
    """Slots of (rpm, feed for each tooth in mm, depth in mm), 6 s each, no two quite alike."""
    n = np.repeat([rpm / 60 for rpm, _, _ in cuts], 60)
    label = np.repeat(np.arange(len(cuts)), 60)
    f_z, a_p = (np.repeat([c[i] * 1e-3 for c in cuts], 60) for i in (1, 2))
    removal, edge = cut_rates(
        flutes=FLUTES, diameter=D, n=n, f_z=f_z, a_p=a_p, phi_st=0.0, phi_ex=np.pi
    )
    factor = np.exp(spread * random.standard_normal(len(cuts)))[label]
    P = free_power(n) + factor * (K_TC * removal + K_TE * edge)
    return LoadLog(
        times=np.arange(len(n)) / 10, speed=n, load=shown(P, n, step, noise, random),
        cut=label, removal=removal, edge=edge,
    )  # fmt: skip


def cut_rates(
    *, flutes: ArrayLike, diameter: ArrayLike, n: ArrayLike, f_z: ArrayLike, a_p: ArrayLike,
    phi_st: ArrayLike, phi_ex: ArrayLike,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Removal rate [m^3/s] and edge rate [m^2/s] of a cut with constant engagement; in SI."""
    teeth, D, speed = (np.asarray(v, dtype=np.float64) for v in (flutes, diameter, n))
    entry, leave = np.asarray(phi_st), np.asarray(phi_ex)
    removal = teeth * speed * np.asarray(f_z) * a_p * D / 2 * (np.cos(entry) - np.cos(leave))
    edge = teeth * speed * np.asarray(a_p) * D / 2 * (leave - entry)
    return removal, edge
