"""Strokes of an axis that would tell more of its friction and mass, and what they excite.

What a fit leaves over of a stroke (cogging, ripple of the screw, uneven guideways) hangs together
over the stroke: a stroke counts once, however long it is, by the mean over its rows.  Repeated
strokes begin at other places, so that they do not meet the same disturbance.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from pipeline.schema.arrays import Floats, Ints
from pipeline.schema.drive import FORCE, DirectionFriction, DriveAxis, DriveModel
from pipeline.schema.model import Parameter
from pipeline.submodels.drive.estimates import SENSOR
from pipeline.submodels.drive.inverse_dynamics import DIRECTIONS, LINEAR, Regressors, regressors
from pipeline.submodels.drive.motion import motion
from pipeline.submodels.drive.records import Recording, of_axis
from pipeline.submodels.next_recording import Candidate, Design

RECORDED_S = 240.0
"""Length of a recording, in files that a servo's recorder holds [s]; the rest of the twenty minutes
is set-up."""
AMPLITUDE = 0.25
"""Static friction beyond Coulomb's, over Coulomb friction, where nothing determines it [1]."""
CREEP = (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)
"""Slow speeds over Stribeck's velocity [1]."""
PLATEAU_S, PAUSE_S = 2.0, 0.12
"""Time at constant speed of a stroke, at most a third of the axis' range long, and between [s]."""
SHORT_M = 0.02
"""Length of a quick stroke [m]."""
LEAST_RATE = 0.01
"""Least acceleration of a stroke [m/s^2]."""
WORDS = ("Coulomb friction", "static friction beyond Coulomb's",
         "logarithm of Stribeck's velocity", "viscous friction")  # fmt: skip
LOGGED = (
    "from a place a third of a screw's lead further at each repetition; record commanded position, "
    "measured position and current at 1 kHz in files of a minute"
)


def axis_designs(
    model: DriveModel, training: Sequence[Recording], judged: Sequence[Recording]
) -> Iterator[Design]:
    """A design for each axis with records of its motion among both."""
    for letter, axis in model.axes.items():
        some, others = (_table(records, letter, axis) for records in (training, judged))
        if some is not None and others is not None:
            yield _design(letter, model, some, others)


def _table(recordings: Sequence[Recording], letter: str, axis: DriveAxis) -> Regressors | None:
    fit = axis.fit
    motions = [
        motion(one, letter, fit.bandwidth_Hz, fit.delay_s or 0.0)
        for one in of_axis(recordings, letter)
    ]
    if sum(int((one.known & one.moving).sum()) for one in motions) < 10 * len(LINEAR):
        return None
    try:
        found = regressors(motions)
    except ValueError:  # too few rows are left
        return None
    return found if len(found.force) else None


def _design(letter: str, model: DriveModel, some: Regressors, others: Regressors) -> Design:
    axis, stated = model.axes[letter], model.parameters[letter]
    half, floors, sizes = [_half(stated["mass"])], [SENSOR], [axis.feed_drive.mass]
    names, units = [f"{letter} mass"], [stated["mass"].unit]
    for direction, friction in zip(DIRECTIONS, _directions(axis), strict=True):
        own = {name: stated[f"{name}_{direction}"] for name in
               ("coulomb", "static", "viscous", "stribeck_velocity")}  # fmt: skip
        ends = own["stribeck_velocity"].interval_95
        half += [
            _half(own["coulomb"]), float(np.hypot(_half(own["static"]), _half(own["coulomb"]))),
            np.log(ends[1] / max(ends[0], 1e-9)) / 2 if ends else np.nan, _half(own["viscous"]),
        ]  # fmt: skip
        floors += [SENSOR, SENSOR, 0.0, SENSOR]
        sizes += [friction.coulomb, _amplitude(friction), 1.0, friction.viscous]
        names += [f"{letter} {words}, {direction}" for words in WORDS]
        units += [own["coulomb"].unit, own["coulomb"].unit, "1", own["viscous"].unit]
    sizes_ = np.maximum(np.array(sizes), 1e-12)
    rows = _once(_of_table(some, axis), some.stroke)
    return Design(
        names=tuple(names), units=tuple(units), half_widths=np.array(half), sizes=sizes_,
        floors=np.array(floors) * sizes_, information=rows.T @ rows,
        independent=len(np.unique(some.stroke)),
        noise=None if np.isfinite(half).all() else _noise(some, rows),
        judged=_of_table(others, axis), unit=axis.force_unit,
        interval=f"{FORCE} {letter} of the judged recordings, by mass and friction",
        limit=max(axis.constant_level, 1e-12), candidates=[
            Candidate(record=words, information=rows.T @ rows + more.T @ more)
            for words, more in _recordings(letter, axis, some)
        ],
    )  # fmt: skip


def _noise(table: Regressors, rows: Floats) -> float:
    """Standard deviation of a stroke's mean force with all nine parameters fitted [N]."""
    strokes = len(np.unique(table.stroke))
    force = _once(table.force[:, None], table.stroke)[:, 0]
    scale = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
    left = force - rows @ (np.linalg.lstsq(rows / scale, force)[0] / scale)
    return float(np.sqrt(left @ left / max(strokes - rows.shape[1], 1)))


def _half(one: Parameter) -> float:
    return np.nan if one.interval_95 is None else (one.interval_95[1] - one.interval_95[0]) / 2


def _directions(axis: DriveAxis) -> tuple[DirectionFriction, DirectionFriction]:
    friction = axis.feed_drive.friction
    return friction.positive, friction.negative


def _amplitude(friction: DirectionFriction) -> float:
    return friction.static - friction.coulomb or AMPLITUDE * friction.coulomb


def _of_table(table: Regressors, axis: DriveAxis) -> Floats:
    """Derivatives of the force by the nine parameters, filtered as the rows of a table are."""
    linear = {name: table.linear[:, k] for k, name in enumerate(table.names)}
    log = np.log([one.stribeck_velocity for one in _directions(axis)])
    static, slope = table.stribeck_columns(log), table.stribeck_slopes(log)
    columns = [linear["mass"]]
    for k, (direction, friction) in enumerate(zip(DIRECTIONS, _directions(axis), strict=True)):
        columns += [linear[f"coulomb_level_{direction}"], static[:, k],
                    _amplitude(friction) * slope[:, k], linear[f"viscous_{direction}"]]  # fmt: skip
    return np.column_stack(columns)


def _derivatives(velocity: Floats, acceleration: Floats, axis: DriveAxis) -> Floats:
    """The same at each row of a motion that was not recorded; shape (N, 9)."""
    columns = [acceleration]
    for sign, friction in zip((1.0, -1.0), _directions(axis), strict=True):
        speed = np.maximum(sign * velocity, 0.0)
        moves, share = sign * (speed > 0), (speed / friction.stribeck_velocity) ** 2
        static = np.exp(-share)
        columns += [
            moves * each for each in
            (np.ones(len(speed)), static, 2 * _amplitude(friction) * share * static, speed)
        ]  # fmt: skip
    return np.column_stack(columns)


def _once(rows: Floats, stroke: Ints) -> Floats:
    """Rows with the weight of one row a stroke."""
    _, member, count = np.unique(stroke, return_inverse=True, return_counts=True)
    return np.asarray(rows / np.sqrt(count[member])[:, None])


def _recordings(letter: str, axis: DriveAxis, table: Regressors) -> Iterator[tuple[str, Floats]]:
    """Recordings of strokes in words, with the rows that they would add."""
    fastest = float(np.abs(table.velocity).max())
    reach = max(float(np.ptp(table.position)) / 3, SHORT_M)
    rates = np.abs(table.linear[:, table.names.index("mass")])
    rate = max(float(np.percentile(rates, 99.9)), LEAST_RATE)
    stribeck = float(np.mean([one.stribeck_velocity for one in _directions(axis)]))
    slow = [share * stribeck for share in CREEP]
    every = np.geomspace(slow[0], fastest, 10).tolist()
    kinds: list[tuple[str, list[float], float]] = [
        ("slowly to and fro", slow, reach), ("to and fro at all speeds", every, reach),
        ("fast to and fro", [0.3 * fastest, 0.6 * fastest, fastest], reach),
        (f"{1e3 * SHORT_M:.0f} mm to and fro without a pause", [fastest], SHORT_M),
    ]  # fmt: skip
    for words, speeds, longest in kinds:
        said = ", ".join(f"{1e3 * speed:.3g}" for speed in speeds)
        velocity, acceleration, stroke = _strokes(speeds, rate, longest, table.period)
        yield (
            f"move {letter} in air {words}, at {said} mm/s, over {1e3 * longest:.0f} mm or "
            f"{PLATEAU_S:g} s at most, for {RECORDED_S / 60:g} minutes in all, {LOGGED}",
            _once(_derivatives(velocity, acceleration, axis), stroke),
        )


def _strokes(
    speeds: Sequence[float], rate: float, longest: float, period: float
) -> tuple[Floats, Floats, Ints]:
    """Velocity, acceleration and number of the stroke, in rows of ``period`` [s]."""
    velocities, accelerations, left = [], [], RECORDED_S
    while left > 0:
        for speed in speeds:
            peak = min(speed, float(np.sqrt(rate * longest)))
            ramp, plateau = peak / rate, min(PLATEAU_S, max(longest / peak - peak / rate, 0.0))
            end = 2 * ramp + plateau
            t = np.arange(0.5 * period, max(end, period), period)
            velocity = peak * np.clip(np.minimum(t, end - t) / ramp, 0.0, 1.0)
            acceleration = rate * ((t < ramp).astype(float) - (t > ramp + plateau))
            velocities += [velocity, -velocity]
            accelerations += [acceleration, -acceleration]
            left -= 2 * (end + PAUSE_S)
    stroke = np.repeat(np.arange(len(velocities)), [len(one) for one in velocities])
    return np.concatenate(velocities), np.concatenate(accelerations), stroke
