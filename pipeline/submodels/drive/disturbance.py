"""Entry point of a recorded disturbance d in the loops of one axis, with factor, unit and delay.

Two equations hold in a recording, and each tells one half of the places.  The servo's own law

    A - A(r, x) = c (dA/dr) d  |  c [S_vp V_p d + S_vi V_i int(d)]  |  c d

has the disturbance where it enters at the reference position, at the speed command or at the
motor's command, and is met without it where a force pushes the axis; the mechanics

    K A - M a - F_f(v) - F_g = c d

have it only where it is such a force (or is added behind the place where the command is recorded,
which no record tells from a force).  The place whose equation gains most likelihood is taken.  In
a loop without integral and feed-forward the three places of the law are one equation: there the
factor decides, where only one of them has it in a unit in use, and the motion is the same anyway.

A feed-forward is made from backward differences of the reference, half a sample late, or from
central ones.  Without a disturbance the lag of the position loop mimics the one by the other; a
disturbance at the reference or the speed command tells them apart.  The likelier of both is taken;
where a recording does not tell them apart, what the factor differs by is added to its half width.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, floor, inf, isinf, log, log10

import numpy as np

from pipeline.machine.axis.drive_parameters import ServoParameters
from pipeline.schema.arrays import Floats
from pipeline.submodels.drive import servo_equation as law
from pipeline.submodels.drive.entry_fits import (
    APART,
    EARLIEST,
    LATEST,
    Entry,
    EntryFit,
    entry_fits,
    shifted,
)
from pipeline.submodels.drive.motion import motion
from pipeline.submodels.drive.records import Recording
from pipeline.submodels.statistics import Factor
from pipeline.twin.drive import IdentifiedDrive

PLACES: dict[Entry, str] = {
    "reference": "the reference position",
    "speed": "the speed command",
    "command": "the command of the motor",
    "force": "the axis, as a force",
    "none": "no place: it explains nothing",
    "open": "no place that these records determine",
}
ALIKE = 0.05
"""Relative difference from a unit's factor that gains and force constant may have [1]."""


@dataclass(frozen=True, kw_only=True)
class Disturbance:
    """Entry, factor and delay of a recorded disturbance."""

    entry: Entry
    """A key of ``PLACES``."""
    factor: Factor | None = None
    """SI quantity at the entry for one unit of the channel; of a force against positive motion.
    None where it is not determined: then the disturbance is left out."""
    unit: str = ""
    """Unit of the quantity at the entry."""
    delay: float = 0.0
    delay_half_width: float = inf
    """Delay of the entry behind the channel, with half of its 95 % interval [s]."""
    share: float = 0.0
    """Share of the squared error of its equation that it explains [1]."""
    words: str = ""
    """Remark, without a full stop; "" where the channel is what it was declared to be."""


def disturbance_of(recording: Recording, axis: str, drive: IdentifiedDrive) -> Disturbance | None:
    """Entry of the disturbance of ``axis`` in a recording; None where it has no such channel."""
    record = recording.axes[axis]
    if record.load is None:
        return None
    if np.ptp(record.load) == 0:
        return Disturbance(entry="none", words="the disturbance channel never changes in this "
                           "recording: it is left out")  # fmt: skip
    by_law = _by_law(recording, axis, drive)
    by_force = _by_force(recording, axis, drive)
    clear = {entry: one for entry, one in by_law.items() if one.clear}
    if (
        by_force is not None
        and by_force.clear
        and all(by_force.gain >= one.gain for one in clear.values())
    ):
        clear = {"force": by_force}
    if not clear:
        return _unexplained(by_law, by_force)
    units = {entry: _units(entry, record.command_unit, drive) for entry in clear}
    entry, alike = _entry(clear, units, record.load_unit)
    best = clear[entry]
    return Disturbance(
        entry=entry, factor=best.factor, unit=next(iter(units[entry])), delay=best.delay,
        delay_half_width=best.delay_half_width, share=best.share,
        words=_words(entry, best, units[entry], record.load_unit, alike),
    )  # fmt: skip


def _unexplained(by_law: dict[Entry, EntryFit], by_force: EntryFit | None) -> Disturbance:
    if not by_law and by_force is None:
        return Disturbance(
            entry="open", words="where the disturbance enters is not determined, it is left out: "
            "record commanded and measured position while it comes and goes on a moving axis",
        )  # fmt: skip
    share = max(one.share for one in [*by_law.values(), *([by_force] if by_force else [])])
    without = (
        ""
        if by_law and by_force
        else (
            " (tested as a force on the axis only)" if by_force else " (tested in the loops only)"
        )
    )
    return Disturbance(
        entry="none", share=share,
        words=f"the disturbance channel explains nothing of command or force{without}, and is "
        "left out",
    )  # fmt: skip


def _entry(
    clear: dict[Entry, EntryFit], units: dict[Entry, dict[str, float]], declared: str
) -> tuple[Entry, tuple[Entry, ...]]:
    """The most likely place, and the others that the record does not tell from it."""
    best = max(clear, key=lambda entry: clear[entry].gain)
    alike = tuple(e for e in clear if clear[best].gain - clear[e].gain < APART)
    if len(alike) == 1:
        return best, ()

    def mismatch(entry: Entry) -> float:
        found = abs(clear[entry].factor.value)
        known = units[entry]
        if declared and declared in known:
            known = {declared: known[declared]}
        return min(abs(log(found / one)) for one in known.values())

    fitting = [entry for entry in alike if mismatch(entry) < ALIKE]
    if not fitting:
        entry: Entry = "command" if "command" in alike else best
        return entry, tuple(e for e in alike if e != entry)
    return min(fitting, key=mismatch), ()


def _units(entry: Entry, command: str, drive: IdentifiedDrive) -> dict[str, float]:
    """Units in use at a place, with the factor that a channel in each has; SI first."""
    constant = drive.feed_drive.force_constant
    newton = drive.force_unit == "N"
    if entry == "reference":
        return {"m": 1.0, "mm": 1e-3, "um": 1e-6}
    if entry == "speed":
        return {"m/s": 1.0, "mm/s": 1e-3, "mm/min": 1e-3 / 60}
    if entry == "command":
        known = {command: 1.0}
        return known | ({"N": 1 / constant, "kN": 1e3 / constant} if newton else {})
    return {"N": 1.0, "kN": 1e3, command: constant} if newton else {command: 1.0}


def _words(
    entry: Entry, found: EntryFit, units: dict[str, float], declared: str, alike: Sequence[Entry]
) -> str:
    """The cause, where the channel is not the force in newton that a load is taken for."""
    value, half, si = found.factor.value, found.factor.half_width, next(iter(units))
    unit, ratio = min(
        ((name, abs(value) / one) for name, one in units.items()), key=lambda u: abs(log(u[1]))
    )
    known = abs(ratio - 1) <= ALIKE + half / abs(value)
    expected = declared or ("N" if entry == "force" else "")
    said = []
    if entry != "force":
        said.append(f"the disturbance enters at {PLACES[entry]}, not as a force on the axis")
    if value < 0:
        said.append("its sign is the opposite of that declared")
    if known and unit != expected:
        said.append(f"it acts as if in {unit}" + (f", not in {expected}" if expected else ""))
    if not known:
        known_to = round(value, -floor(log10(half))) if half > 0 else value
        said.append(f"its factor is {known_to:.4g} {si} for one unit of the channel")
    if abs(found.delay) > max(found.delay_half_width, 1e-3):
        said.append(f"it is {1e3 * found.delay:.3g} ms behind its channel")
    if alike:
        others = " and ".join(PLACES[one] for one in alike)
        said.append(f"these loops do not tell {PLACES[entry]} from {others}, which move alike")
    return ", ".join(said)


def law_fits(
    recording: Recording, axis: str, drive: IdentifiedDrive
) -> dict[law.Difference, dict[Entry, EntryFit]]:
    """Fits of each entry of the disturbance into the servo, by feed-forward difference.

    Central differences alone where nothing is fed forward; empty without servo, reference or
    position.
    """
    one, servo, h = recording.axes[axis], drive.servo, recording.period
    if servo is None or one.reference is None or one.position is None or one.load is None:
        return {}
    record = law.ServoRecord(
        reference=one.reference, position=one.position, command=one.command, period=h
    )
    nominal, values = _law(servo, sum(law.servo_periods(one.constants, h)) / 2)
    bandwidth = min(law.ABOVE * servo.loop_gain / (2 * np.pi), law.FASTEST / h)
    ahead = servo.velocity_feedforward > 0 or servo.acceleration_feedforward > 0
    differences: tuple[law.Difference, ...] = ("central", "backward") if ahead else ("central",)
    try:
        equations = {
            each: law.servo_equation([record], nominal, bandwidth, each) for each in differences
        }
    except ValueError:
        return {}
    return {
        each: _Law(record, one.load, servo, equation, bandwidth).about_its_gains(values)
        for each, equation in equations.items()
    }


def _by_law(recording: Recording, axis: str, drive: IdentifiedDrive) -> dict[Entry, EntryFit]:
    """Fits by the likelier differences; none without servo, reference or position.

    Where the recording does not tell them apart, what a factor differs by is a doubt of it.
    """
    found = list(law_fits(recording, axis, drive).values())
    if not found:
        return {}
    likelihood = [max(one.likelihood for one in fits.values()) for fits in found]
    best, highest = found[int(np.argmax(likelihood))], max(likelihood)
    open_ = [best]
    open_ += [fits for fits, one in zip(found, likelihood, strict=True) if highest - one < APART]
    return {
        entry: one.doubted(max(abs(one.factor.value - fits[entry].factor.value) for fits in open_))
        for entry, one in best.items()
    }


@dataclass(frozen=True, eq=False)
class _Law:
    """The servo's law on one recording, in which a disturbance may enter."""

    record: law.ServoRecord
    load: Floats
    servo: ServoParameters
    equation: law.ServoEquation
    bandwidth: float

    def about_its_gains(self, values: Floats) -> dict[Entry, EntryFit]:
        """Fits of each place about the gains that the recording shows, from ``values``.

        By these a factor scales.  Where nothing enters, they are those of ``values``.
        """
        found, values = self.fits(values, {})
        if not any(each.clear for each in found.values()):
            return found
        return self.fits(values, found)[0]

    def fits(
        self, values: Floats, before: dict[Entry, EntryFit]
    ) -> tuple[dict[Entry, EntryFit], Floats]:
        """Fits of each place about ``values`` of the law, and its values beside the likeliest.

        An error of a gain scales the disturbance of a fit ``before``, too.
        """
        own = -(self.equation.columns @ self.equation.factors(values))
        fitted = values > 0
        fitted[law.TS] = True  # a twin's lag is of first order, a recorded one is what it is
        nuisance = self.equation.jacobian(values, fitted)
        entering = self.entering(values)
        table = np.stack([factors for factors, _ in entering.values()], axis=1)

        def columns(samples: float) -> dict[Entry, Floats]:
            return dict(zip(entering, self.entered(samples, table).T, strict=True))

        period = self.record.period
        scaled = {
            entry: self.entered(
                round(one.delay / period), one.factor.value * entering[entry][1][:, fitted]
            )
            for entry, one in before.items()
        }
        found = entry_fits(
            own, nuisance, scaled, columns, period=period, step=0.25 / self.bandwidth,
            weight=0.25, stretch=self.equation.stretch,
        )  # fmt: skip
        entry = max(found, key=lambda each: found[each].gain)
        best = found[entry]
        left = own - best.factor.value * columns(best.delay / period)[entry]
        shown = values.copy()
        shown[fitted] += np.linalg.lstsq(nuisance, left, rcond=None)[0]
        low, high = self.equation.nominal.bounds(self.equation.longest)
        return found, np.clip(shown, low, high)

    def entering(self, values: Floats) -> dict[Entry, tuple[Floats, Floats]]:
        """Factors of the rows of the disturbance at each place, (M,), and their slopes, (M, D)."""
        gain, error, swept = self.equation.nominal.velocity_gain, 0, 2 * law.NODES
        reference, slopes = self.equation.factors(values), self.equation.slopes(values)
        speed, command = np.zeros_like(reference), np.zeros_like(reference)
        by_gain = np.zeros_like(slopes)
        reference[-1], command[-1] = 0.0, 1.0
        # without delay it enters as the error and its integral do; this is the identified one
        speed[error], by_gain[error, law.SVP] = gain * values[law.SVP], gain
        speed[swept] = self.servo.integral
        return {
            "reference": (reference, slopes), "speed": (speed, by_gain),
            "command": (command, np.zeros_like(slopes)),
        }  # fmt: skip

    def entered(self, samples: float, factors: Floats) -> Floats:
        """The disturbance, so many whole samples late, by factors (M, K) of its rows; (N, K)."""
        signals, held = self.pushed
        record, node, width = self.record, self.equation.node, self.bandwidth
        return np.concatenate([
            part
            for a, b in law.stretches(record, self.equation.nominal.current_limit, width)
            for part in law.without_drift(
                law.delayed(
                    signals, law.stretch_rows(b - a, record.period, node, width) + a + held
                    - round(samples), node / record.period,
                ) @ factors
            )
        ])  # fmt: skip

    @cached_property
    def pushed(self) -> tuple[Floats, int]:
        """Signals with the disturbance for the servo's; number of samples to hold at their ends."""
        record = self.record
        held = ceil(max(LATEST, -EARLIEST) / record.period) + 2
        push = np.pad(self.load, held, mode="edge")
        aside = replace(record, reference=push, position=np.zeros(len(push)), command=push)
        return law.servo_signals(aside, self.bandwidth, self.equation.difference), held


def _law(servo: ServoParameters, period: float) -> tuple[law.Nominal, Floats]:
    """The servo's gains, and its factors of them in the order of ``TERMS``.

    Those of the equation, which integrates where the servo, of ``period`` [s], sums up: what of the
    proportional gain stands for the difference is taken off again.
    """
    nominal = law.Nominal(
        position_gain=servo.position_gain, velocity_gain=servo.velocity_gain,
        integral_gain=servo.integral_gain, velocity_feedforward=0.0, acceleration_feedforward=0.0,
        current_limit=None if isinf(servo.current_limit) else servo.current_limit,
        unnamed=frozenset(),
    )  # fmt: skip
    values = np.zeros(len(law.TERMS))
    values[[law.SPP, law.SVP]] = (
        servo.position_scale,
        servo.velocity_scale - 0.5 * period * servo.integral / servo.velocity_gain,
    )
    values[law.SVI] = servo.integral_scale if servo.integral_gain > 0 else 0.0
    values[[law.FV, law.FA]] = servo.velocity_feedforward, servo.acceleration_feedforward
    values[[law.TX, law.TV, law.TS]] = servo.position_lag, servo.velocity_lag, 1.0
    return nominal, values


def _by_force(recording: Recording, axis: str, drive: IdentifiedDrive) -> EntryFit | None:
    """Fit of the mechanics; None where the axis hardly moves under the disturbance."""
    from pipeline.submodels.drive.identifiability import drive_force, held_out_load_factor
    from pipeline.submodels.drive.inverse_dynamics import regressors

    one = recording.axes[axis]

    def late(samples: float) -> Recording:
        load = None if one.load is None else shifted(one.load, samples)
        return replace(recording, axes={**recording.axes, axis: replace(one, load=load)})

    try:
        rows = regressors([motion(recording, axis, drive.bandwidth_Hz, drive.delay)])
    except ValueError:
        return None
    at = rows.names.index("load")
    if len(rows.force) < 30 or np.ptp(rows.linear[:, at]) == 0:
        return None
    own = rows.force - drive_force(rows, drive.feed_drive)

    def columns(samples: float) -> dict[Entry, Floats]:
        again = regressors([motion(late(samples), axis, drive.bandwidth_Hz, drive.delay)])
        return {"force": again.linear[:, at]}

    width = drive.bandwidth_Hz or 0.25 / recording.period
    share = min(width * 2 * _row_period(recording, width), 1.0)
    found = entry_fits(
        own, np.ones((len(own), 1)), {}, columns, period=recording.period, step=0.25 / width,
        weight=0.5 * share, stretch=rows.stretch,
    )["force"]  # fmt: skip
    if abs(found.delay) <= found.delay_half_width + recording.period:
        found = replace(found, delay=0.0)
    factor = held_out_load_factor(
        late(found.delay / recording.period), axis, drive.feed_drive, drive.bandwidth_Hz,
        drive.delay,
    )  # fmt: skip
    return None if factor is None else replace(found, factor=factor)


def _row_period(recording: Recording, bandwidth: float) -> float:
    """Distance of the rows of the mechanics [s]."""
    return max(recording.period, 1 / (12 * bandwidth))
