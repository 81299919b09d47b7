"""Both ends of a drive, filtered alike: twist, the shaft's force, the flank in contact.

The twist of a shaft is predicted from the motor alone: its force by current and motion, over K.

Columns are those of the equation in :mod:`pipeline.submodels.drive.shaft`.  Waves over the motor's
turn stand for what repeats in each turn: the eccentricity of an encoder and the screw's pitch once,
the motor's cogging, a force that the current does not show, at orders that Fisher's test finds in
what the fit leaves over (R. A. Fisher, Tests of significance in harmonic analysis, 1929).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.ndimage import gaussian_filter1d, minimum_filter1d
from scipy.special import ndtri

from pipeline.schema.arrays import Bools, Floats
from pipeline.schema.drive import RIGID, TWIST, DriveModel
from pipeline.submodels.drive.records import Recording
from pipeline.twin.drive import IdentifiedDrive

WIDTH = 1.5
"""Standard deviation of the filter [samples]."""
REACH = 8.0
"""End of the filter [standard deviations]. Cut at 4, as is usual, its second derivative has a sum,
which makes of a position of 30 mm at 1 kHz an acceleration of 4 m/s^2."""
SLOW = 0.01
"""Share of the highest speed below which an axis may stand [1]."""
FLAT = 0.15
"""Share of the shaft's force, as root mean square, near which the flank may change [1]."""
ORDERS = np.arange(2, 201)
"""Waves a turn that are looked for [1]: cogging has as many as the least common multiple of a
motor's slots and poles."""
BINS = 4096
"""Parts of a turn in which what is left over is added up [1]."""
CHANCE = 0.01
"""Chance that noise alone makes a wave [1]."""
MOST_WAVES = 12
"""Most orders that are taken [1]."""
C, MASS, VISCOUS, COULOMB, DAMPING, LAG, PLAY = range(7)
"""Columns of the fit that recordings share."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Signals:
    """Filtered signals of one recording, T samples."""

    twist: Floats
    """Motor's position less the carriage's [m]; shape (T,)."""
    columns: Floats
    """Columns of the fit, in SI; that of the flank is empty; shape (T, 7)."""
    nuisance: Floats
    """Columns of what encoders and screw err by; shape (T, N)."""
    speed: Floats
    """Speed of the motor [m/s]; shape (T,)."""
    good: Bools
    """Recorded samples, away from the ends; shape (T,)."""
    period: float
    """Period of the samples [s]."""
    turn: Floats | None = None
    """Angle of the motor [rad]; None without the lead; shape (T,)."""


def _filtered(values: Floats, order: int = 0) -> Floats:
    return gaussian_filter1d(values, WIDTH, order=order, mode="nearest", truncate=REACH)


def signals_of(one: Recording, axis: str, force_constant: float, lead: float | None) -> Signals:
    """Filtered signals of both ends of ``axis``; force constant k [N/A], screw ``lead`` [m]."""
    raw, period = one.shafts[axis], one.period

    def filtered(values: Floats, order: int = 0) -> Floats:
        return _filtered(values, order) / period**order

    place = raw["motor"] - raw["motor"].mean()
    twist = raw["motor"] - raw["load"]
    force = force_constant * raw["command"]
    speed = filtered(place, 1)
    x, time = filtered(place), np.linspace(-1, 1, place.size)
    columns = np.zeros((place.size, 7))
    columns[:, C], columns[:, MASS] = filtered(force), -filtered(place, 2)
    columns[:, VISCOUS], columns[:, COULOMB] = -speed, -np.sign(speed)
    columns[:, DAMPING], columns[:, LAG] = -filtered(twist, 1), -filtered(force, 1)
    turn = None if lead is None else 2 * np.pi * raw["motor"] / lead
    waves = [] if turn is None else [_filtered(f(turn)) for f in (np.sin, np.cos)]
    good = one.air & (np.abs(speed) > SLOW * np.abs(speed).max())
    edge = int(np.ceil(REACH * WIDTH))
    good[:edge] = good[-edge:] = False
    return Signals(
        twist=filtered(twist - twist.mean()), columns=columns,
        nuisance=np.stack([np.ones(x.size), x, time, *waves], axis=1), speed=speed, good=good,
        turn=turn, period=period,
    )  # fmt: skip


def shaft_force(one: Signals, shared: Floats) -> Floats:
    """Force of the shaft [N] by the motor's equation, shape (T,), for a C above 0."""
    inside = [C, MASS, VISCOUS, COULOMB]
    return np.asarray(one.columns[:, inside] @ shared[inside] / shared[C])


def _unfiltered(values: Floats) -> Floats:
    """Values before the filter, to the second order of its width.

    At the resonance of a shaft the filter takes a third of the force's swing: a force that seems to
    stay on one flank has left it.
    """
    return np.asarray(values - 0.5 * WIDTH**2 * np.gradient(np.gradient(values)))


def flanks(one: Signals, shared: Floats) -> tuple[Floats, Bools]:
    """Flank in contact, -1 or 1, and where it is sure; both of shape (T,)."""
    if shared[C] <= 0:  # no twist that tells it: nothing hangs on the flank
        return np.sign(one.columns[:, C]), one.good
    force = shaft_force(one, shared)
    level = float(np.sqrt(np.mean(force[one.good] ** 2))) if one.good.any() else 0.0
    side, size = np.sign(force), 2 * int(np.ceil(4 * WIDTH)) + 1
    swing = _unfiltered(force)
    clear = np.sign(swing) * np.maximum(np.abs(swing) - FLAT * level, 0)
    # what the filter mixes must hang on one flank
    pulled, pushed = minimum_filter1d(clear, size), minimum_filter1d(-clear, size)
    return side, one.good & ((pulled > 0) | (pushed > 0))


def table(one: Signals, side: Floats) -> Floats:
    """Columns of the fit with the play on a flank, then those of its own errors; (T, 7 + N)."""
    columns = one.columns.copy()
    columns[:, PLAY] = side / 2
    return np.concatenate([columns, one.nuisance], axis=1)


def left_over(one: Signals, side: Floats, ok: Bools) -> Floats:
    """Twist [m] that a recording's own fit leaves over, shape of ``ok`` set."""
    columns = table(one, side)[ok]
    if not len(columns):
        return np.zeros(0)
    found = np.linalg.lstsq(columns, one.twist[ok], rcond=None)[0]
    return np.asarray(one.twist[ok] - columns @ found)


def lasting(shown: Sequence[Signals], left: Sequence[Floats], sure: Sequence[Bools]) -> float:
    """Share of what is left over that outlasts the filter [1]; 0 where chance makes as much.

    All of it where the record is so short that chance could make that.

    The filter gives white noise the autocorrelation exp(-n^2 / (4 s^2)) over n samples, which ends;
    an error of the equation goes on.  It is the greatest autocorrelation between one and three
    times that length.  Of noise it has the variance sqrt(2 pi) s / N (Bartlett 1946).
    """
    end = int(np.ceil(4 * np.sqrt(2) * WIDTH))
    lags = np.arange(end, 3 * end + 1)
    products, pairs = np.zeros(len(lags)), np.zeros(len(lags))
    for one, part, ok in zip(shown, left, sure, strict=True):
        whole = np.zeros(len(one.twist))
        whole[ok] = part
        products += [whole[n:] @ whole[:-n] for n in lags]
        pairs += [np.count_nonzero(ok[n:] & ok[:-n]) for n in lags]
    count = sum(part.size for part in left)
    power = sum(float(part @ part) for part in left) / max(count, 1)
    if power == 0:
        return 0.0
    if pairs.min() == 0:
        return 1.0
    greatest = float(np.abs(products / pairs).max() / power)
    chance = -ndtri(0.5 * CHANCE / len(lags)) * np.sqrt(np.sqrt(2 * np.pi) * WIDTH / pairs.min())
    if chance >= 1:
        return 1.0
    return min(greatest, 1.0) if greatest > chance else 0.0


def with_waves(
    shown: Sequence[Signals], sides: Sequence[Floats], sure: Sequence[Bools]
) -> list[Signals]:
    """Recordings with significant waves over the turn, strongest first, by Fisher's test."""
    found: list[Signals] = list(shown)
    if any(one.turn is None for one in shown):
        return found
    for _ in range(MOST_WAVES):
        power = np.zeros(len(ORDERS))
        for one, side, ok in zip(found, sides, sure, strict=True):
            power += _power(one, left_over(one, side, ok), ok)
        # Fisher's level for noise that has the median's power (exponentially distributed)
        level = np.median(power) / np.log(2) * -np.log1p(-((1 - CHANCE) ** (1 / len(ORDERS))))
        if not power.max() > level:
            break
        found = [_with_wave(one, int(ORDERS[int(power.argmax())])) for one in found]
    return found


def _power(one: Signals, left: Floats, ok: Bools) -> Floats:
    """Power of what is left over at each of the orders [m^2]; shape (N,)."""
    if one.turn is None or not len(left):
        return np.zeros(len(ORDERS))
    # one turn in bins, whose transform has the orders
    place = (one.turn[ok] / (2 * np.pi) * BINS).astype(np.int64) % BINS
    turn = np.bincount(place, weights=left, minlength=BINS)
    return np.asarray(np.abs(np.fft.rfft(turn)[ORDERS]) ** 2 / len(left))


def _with_wave(one: Signals, order: int) -> Signals:
    if one.turn is None:
        return one
    waves = np.stack([_filtered(f(order * one.turn)) for f in (np.sin, np.cos)], axis=1)
    return replace(one, nuisance=np.concatenate([one.nuisance, waves], axis=1))


def is_known(model: DriveModel, letter: str) -> bool:
    """Whether the stiffness of the shaft of an axis is determined."""
    found = model.parameters.get(letter, {}).get("shaft_stiffness")
    return found is not None and found.determined


def twist_frames(
    recording: Recording, model: DriveModel, drives: Mapping[str, IdentifiedDrive]
) -> Iterator[pd.DataFrame]:
    """Twist of each axis whose both ends a recording shows [um], measured and predicted.

    Both encoders have their own zero, screw and scale their errors: a constant and a straight line
    over position are taken out of the measured twist as of the predicted.
    """
    for letter, raw in recording.shafts.items():
        if letter not in drives or letter not in model.shafts or not is_known(model, letter):
            continue
        shaft = model.shafts[letter]
        one = signals_of(recording, letter, drives[letter].feed_drive.force_constant, shaft.lead)
        factors = np.array(shaft.factors)
        side, sure = flanks(one, factors)
        table = one.columns.copy()
        # the predicted twist knows nothing of the carriage's scale
        table[:, DAMPING], table[:, PLAY] = 0.0, side / 2
        own, _ = np.linalg.qr(one.nuisance[sure][:, :2])
        measured, predicted = (
            values[sure] - own @ (own.T @ values[sure]) for values in (one.twist, table @ factors)
        )
        yield pd.DataFrame({
            "quantity": f"{TWIST} {letter}", "unit": "um",
            "t": np.arange(len(raw["motor"]))[sure] * recording.period,
            "measured": 1e6 * measured, "predicted": 1e6 * predicted, "scored": True,
            f"baseline_{RIGID}": 0.0,
        })  # fmt: skip
