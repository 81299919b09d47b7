"""Trials on the simulated mill: parts cut by two programs, axes driven by commands and corrections.

Trial cuts: the shop's machine mills a part by any program, a dynamometer under it.  Edge forces are
those of :mod:`pipeline.shop.cutting.force`.  Left out are the cut of the tool's end where it goes
down, bending of the tool, and the dynamics of tool and dynamometer: the load is the resultant
across the axis as it acts.

Corrected commands: the commanded positions and the same with a correction added are driven on the
same axes under the same noise; errors are those against the command, at the position loop's sensor
and at the carriage.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.parallel import mapped
from pipeline.schema.arrays import Bools, Floats
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.drives.axis import follow
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.cutting import chance, check_cut, cut
from pipeline.shop.trial.job import TrialJob
from pipeline.shop.trial.motion import Swept, Track, control_of, program_steps, swept, track


@dataclass(frozen=True, kw_only=True, eq=False)
class Prepared:
    """Common to every cut of a program: steps, motion and the swept part of the blank."""

    program: PartProgram
    track: Track
    swept: Swept


@dataclass(frozen=True, kw_only=True)
class Trial:
    """Result of one cut."""

    time_s: float
    """Time of the program by the shop's control [s]."""
    limit_load_N: float
    """Limit of the load [N]."""
    peaks_N: dict[int, float]
    """Peak load in each line of the program's text in which the tool moves [N]."""

    @property
    def peak_load_N(self) -> float:
        """Greatest load across the tool's axis [N]; 0 when nothing is cut."""
        return max(self.peaks_N.values(), default=0.0)

    @property
    def peak_line(self) -> int | None:
        """Line of that peak; None when nothing is cut."""
        return max(self.peaks_N, key=self.peaks_N.__getitem__) if self.peak_load_N > 0 else None


def prepare(text: bytes | str, name: str, job: TrialJob, parameters: ShopParameters) -> Prepared:
    """Read a program, let the shop's control run it once, and sweep the blank.

    ``name`` is the file's, for messages.  Raises GcodeError at the first word that cannot be
    followed; ValueError when the program does nothing, exceeds the mill, or cuts with an unknown
    tool or a standing spindle.
    """
    program = program_steps(text, name, job, parameters.control)
    control = control_of(program, job, parameters, parameters.generator("trial control"))
    plan = None if len(program.steps) == 1 else control.run(program)
    if plan is None or not plan.spans:
        raise ValueError(f"{name} does nothing: a trial cut needs a program that moves the tool")
    motion = track(plan, job, parameters.control)
    blank = swept(motion.tip, motion.tool, program.steps, job)
    check_cut(name, motion, blank, job)
    return Prepared(program=program, track=motion, swept=blank)


def trial(prepared: Prepared, job: TrialJob, parameters: ShopParameters, seed: int) -> Trial:
    """Cut one part of a program that :func:`prepare` has read; ``seed`` of its differences."""
    random = np.random.Generator(np.random.PCG64([parameters.seed, seed, *b"trial cut"]))
    part = chance(job, parameters, random)
    peaks = cut(prepared.track, prepared.swept, part, parameters, random)
    plan = control_of(prepared.program, job, parameters, random).run(prepared.program)
    tip, line = prepared.track.tip, prepared.track.line
    moving = np.any(np.diff(tip, axis=0, prepend=tip[:1]) != 0, axis=1)
    return Trial(
        time_s=plan.duration, limit_load_N=job.limit_load_N,
        peaks_N={n: peaks.get(n, 0.0) for n in np.unique(line[moving]).tolist()},
    )  # fmt: skip


def trials(
    before: bytes | str, after: bytes | str, job: TrialJob, parameters: ShopParameters,
    seeds: Sequence[int],
) -> dict[str, Any]:  # fmt: skip
    """Loads and times of a program before and after a change, over the same parts.

    Equal parts (batch, mounting, edge) are cut by both, one of each for each seed.  For JSON:
    number of seeds, the limit [N], and for both programs time of the runs [s], peak load over the
    runs [N], and in how many of them a peak was above the limit.  Raises GcodeError or ValueError
    when :func:`prepare` refuses a program, or without seeds.
    """
    if not len(seeds):
        raise ValueError("trials need one seed or more; got none")
    out: dict[str, Any] = {"seeds": len(seeds), "limit_load_N": job.limit_load_N}
    for name, text in (("before", before), ("after", after)):
        prepared = prepare(text, name, job, parameters)
        # the forces' kernel lets other threads run
        cuts = mapped(partial(trial, prepared, job, parameters), seeds, compute="threads")
        out[name] = _summary(cuts)
    return out


def _summary(cuts: Sequence[Trial]) -> dict[str, Any]:
    time = np.array([one.time_s for one in cuts])
    peak = np.array([one.peak_load_N for one in cuts])
    worst = cuts[int(np.argmax(peak))]
    return {
        "time_s": _spread(time, 3), "peak_load_N": _spread(peak, 2), "peak_line": worst.peak_line,
        "above": int((peak > worst.limit_load_N).sum()),
    }  # fmt: skip


def _spread(values: ArrayLike, digits: int) -> dict[str, float]:
    return {f: round(float(getattr(np, f)(values)), digits) for f in ("mean", "min", "max")}


UNEVEN = 0.01
"""Greatest deviation of a step of time from their median, as a share of it [1]."""
CUTTING = "cutting"
"""Column that is 1 where the program cuts; it may be absent."""
PLACES = ("measured", "carriage")
"""Positions that are compared: that of the position loop's sensor, and the true one."""


def corrected_trials(
    table: Path, parameters: ShopParameters, seeds: Sequence[int]
) -> dict[str, Any]:
    """Drive the commands of a table and the corrected ones from standstill, once for each seed.

    The table is CSV: ``t``, evenly spaced [s], commanded and corrected position ``X`` and
    ``X_corrected`` of each axis in the machine's frame [mm], and ``cutting``, 1 where the program
    cuts. Comment lines begin with ``#``.  The noise of a seed is the same before and after.

    The document has, by axis and place (``measured`` by the position loop's sensor, ``carriage``),
    ``rms_um`` and ``max_um`` of the error ``before`` and ``after``, and ``share_left`` of the RMS;
    the same under ``cutting`` and of the distance from the ``path``; each number with mean, least
    and greatest value over the seeds.  Raises ValueError without seeds, or for a table of another
    form.
    """
    if not len(seeds):
        raise ValueError("corrected trials need one seed or more; got none")
    commands = Commands.of(table, parameters)
    # the kernel of the axes lets other threads run
    found = mapped(partial(_driven, commands, parameters), seeds, compute="threads")
    return {"seeds": len(seeds)} | _spreads(found)


def _spreads(found: Sequence[Any]) -> Any:
    """Documents of the same form as one, with mean, min and max for each number."""
    if isinstance(found[0], dict):
        return {key: _spreads([one[key] for one in found]) for key in found[0]}
    if any(one is None for one in found):
        return None
    return _spread(found, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Commands:
    """Commands of a table at the ticks of the position loop."""

    commanded: Mapping[str, Floats]
    corrected: Mapping[str, Floats]
    """Commanded and corrected position of each axis [mm]; shape (T,)."""
    cut: Bools
    """Whether the program cuts; shape (T,)."""

    @classmethod
    def of(cls, table: Path, parameters: ShopParameters) -> "Commands":
        """Commands in a table."""
        axes, frequency = parameters.drives.axes, parameters.drives.x.cascade.position_frequency
        period, columns = _read(table, axes)
        letters = [letter for letter in axes if letter in columns]
        commanded, corrected = (
            {a: _at_loop(columns[f"{a}{end}"], period, frequency) for a in letters}
            for end in ("", "_corrected")
        )
        cut = np.zeros(len(commanded[letters[0]]), bool)
        if CUTTING in columns:
            near = np.rint(np.arange(len(cut)) / (frequency * period)).astype(int)
            cut = columns[CUTTING][np.minimum(near, len(columns[CUTTING]) - 1)] > 0
        return cls(commanded=commanded, corrected=corrected, cut=cut)

    @cached_property
    def path(self) -> "CommandedPath":
        """The commanded path of all axes together."""
        return CommandedPath(np.stack(list(self.commanded.values()), axis=1))


def _driven(commands: Commands, parameters: ShopParameters, seed: int) -> dict[str, Any]:
    commanded, letters = commands.commanded, list(commands.commanded)
    reached: dict[tuple[str, str, bool], Floats] = {}
    for letter in letters:
        for corrected in (False, True):
            command = (commands.corrected if corrected else commanded)[letter]
            words = [parameters.seed, seed, *f"corrected {letter}".encode()]
            random = np.random.Generator(np.random.PCG64(words))
            out = follow(parameters.drives.axes[letter], command * 1e-3, random)
            for place in PLACES:
                reached[letter, place, corrected] = getattr(out, place) * 1e3
    found: dict[str, Any] = {"axes": {letter: {} for letter in letters}}
    for place in PLACES:
        for letter in letters:
            errors = (commanded[letter] - reached[letter, place, c] for c in (False, True))
            found["axes"][letter][place] = _compared(commands.cut, *errors)
        if len(letters) > 1:
            errors = (
                commands.path.distance(np.stack([reached[a, place, c] for a in letters], axis=1))
                for c in (False, True)
            )
            found.setdefault("path", {})[place] = _compared(commands.cut, *errors)
    return found


def _read(table: Path, known: Iterable[str]) -> tuple[float, Mapping[str, Floats]]:
    """Period [s] and columns by name, each of shape (N,)."""
    text = table.read_text(encoding="utf-8", errors="replace")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    names = [name.strip() for name in lines[0].split(",")] if lines else []
    moving = [a for a in known if {a, f"{a}_corrected"} & set(names)]
    wanted = ["t", *(name for a in moving for name in (a, f"{a}_corrected"))]
    if (
        not moving
        or sorted(set(names) - {CUTTING}) != sorted(wanted)
        or len(set(names)) < len(names)
    ):
        raise ValueError(
            f"{table} has the columns {', '.join(names) or 'none'}: give t [s] and, for each of "
            f"the axes {', '.join(known)} that moves, its commanded and its corrected position "
            "[mm], such as X and X_corrected"
        )
    if len(lines) < 3:
        raise ValueError(f"{table} has {len(lines) - 1} rows: two or more make a motion")
    try:
        values = np.loadtxt(lines[1:], delimiter=",", ndmin=2)
    except ValueError as error:
        raise ValueError(f"{table} is no table of numbers: {error}") from None
    if values.shape[1] != len(names):
        raise ValueError(f"{table} has {len(names)} names and {values.shape[1]} columns of numbers")
    if not np.isfinite(values).all():
        row, column = np.argwhere(~np.isfinite(values))[0].tolist()
        raise ValueError(
            f"{table}, row {row + 1}: {names[column]} = {values[row, column]} must be finite"
        )
    columns = dict(zip(names, values.T, strict=True))
    steps = np.diff(columns["t"])
    period = float(np.median(steps))
    uneven = np.abs(steps - period) > UNEVEN * period
    if period <= 0 or uneven.any():
        row = int(np.argmax(uneven)) + 1
        raise ValueError(
            f"{table}, row {row + 1}: t goes from {columns['t'][row - 1]:g} to "
            f"{columns['t'][row]:g} s, mostly {period:g} s a row: give even times that rise"
        )
    return float(steps.mean()), columns


def _at_loop(values: Floats, period: float, frequency: int) -> Floats:
    """Samples (N,), ``period`` apart [s], at the ticks of the position loop, by a cubic spline."""
    from scipy.interpolate import CubicSpline

    last = (len(values) - 1) * period
    ticks = np.arange(int(last * frequency * (1 + 1e-9)) + 1) / frequency
    curve = CubicSpline(np.linspace(0.0, last, len(values)), values)
    return curve(np.minimum(ticks, last))


class CommandedPath:
    """A path through close points (P, A)."""

    def __init__(self, points: Floats) -> None:
        from scipy.spatial import cKDTree

        moves = np.any(np.diff(points, axis=0) != 0, axis=1)
        self.points = points[np.concatenate([[True], moves])]
        self._tree = cKDTree(self.points)

    def distance(self, place: Floats) -> Floats:
        """Distances of places (T, A) from the path, shape (T,), by its nearest point."""
        path = self.points
        distance, near = self._tree.query(place)
        for other in (np.maximum(near - 1, 0), np.minimum(near + 1, len(path) - 1)):
            piece, away = path[other] - path[near], place - path[near]
            square = np.sum(piece**2, axis=1)
            along = np.sum(away * piece, axis=1) / np.where(square > 0, square, 1.0)
            left = away - np.clip(along, 0, 1)[:, None] * piece
            distance = np.minimum(distance, np.linalg.norm(left, axis=1))
        return np.asarray(distance, dtype=np.float64)


def _compared(cut: Bools, before: Floats, after: Floats) -> dict[str, Any]:
    """Both errors [mm] and the share of the RMS that is left, whole and in cuts."""
    whole = _both(before, after)
    return whole | ({CUTTING: _both(before[cut], after[cut])} if cut.any() else {})


def _both(before: Floats, after: Floats) -> dict[str, Any]:
    rms = [float(np.sqrt(np.mean(error**2))) for error in (before, after)]
    return {
        "before": {"rms_um": rms[0] * 1e3, "max_um": float(np.abs(before).max()) * 1e3},
        "after": {"rms_um": rms[1] * 1e3, "max_um": float(np.abs(after).max()) * 1e3},
        "share_left": rms[1] / rms[0] if rms[0] > 0 else None,
    }
