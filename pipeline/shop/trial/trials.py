"""Trial cuts: the shop's machine mills a part by any program, a dynamometer under it.

Edge forces are those of :mod:`pipeline.shop.cutting.force`.  Left out are the cut of the tool's end
where it goes down, bending of the tool, and the dynamics of tool and dynamometer: the load is the
resultant across the axis as it acts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from pipeline.parallel import mapped
from pipeline.shop.control.postprocessor import PartProgram
from pipeline.shop.parameters import ShopParameters
from pipeline.shop.trial.blank import Swept, swept
from pipeline.shop.trial.cutting import chance, check_cut, cut
from pipeline.shop.trial.job import TrialJob
from pipeline.shop.trial.motion import Track, control_of, program_steps, track


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
    spreads = {
        name: {key: round(float(getattr(values, key)()), digits) for key in ("mean", "min", "max")}
        for name, values, digits in (("time_s", time, 3), ("peak_load_N", peak, 2))
    }
    above = int((peak > worst.limit_load_N).sum())
    return {**spreads, "peak_line": worst.peak_line, "above": above}
