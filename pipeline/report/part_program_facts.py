"""Facts about optimised part programs, and what the simulated shop floor made of them."""

from dataclasses import dataclass, field
from math import comb
from pathlib import Path
from typing import Any

from pipeline.charts.numbers import real
from pipeline.charts.sources import Shelf, dig, objects_of
from pipeline.report.folders import MachineFolders
from pipeline.report.optimise_verdict import AIMS

MODELS = "the program, its part in conf/machine and the machine’s models"
SURPRISE = 0.025  # chance below which trial cuts above the limit are no accident
CUT = "the programs before and after, cut on the simulated shop floor"


@dataclass(frozen=True, kw_only=True)
class PartProgram:
    """One part program, before and after.

    Parameters
    ----------
    label : str
        Of its files.
    document : dict
        As ``kerf optimise`` writes it.
    path : Path
        Of that document; the optimised program lies beside it.
    cut : dict or None
        What the simulated shop floor made of both; None where nothing was cut.
    """

    label: str
    document: dict[str, Any]
    path: Path
    cut: dict[str, Any] | None = None

    @property
    def program(self) -> Path:
        """The optimised program."""
        return self.path.with_suffix(".nc")

    @property
    def proved(self) -> bool:
        """Whether the geometry is proved to be the same."""
        return dig(self.document, "proof", "same") is True

    @property
    def inside(self) -> bool:
        """Whether no block is known to pass a limit."""
        return not real(dig(self.document, "after", "beyond"))

    @property
    def gain(self) -> float | None:
        """By how much what was aimed at is less [%]; negative where it is more."""
        _, key, _ = AIMS.get(str(self.document.get("objective")), AIMS["time"])
        change = real(dig(self.document, "gain", key))
        return None if change is None else -change

    @property
    def limit(self) -> float | None:
        """Of the load [N]."""
        return real(dig(self.document, "limits", "load_N"))

    @property
    def epsilon(self) -> float | None:
        """Chance that was allowed for a load above its limit [1]."""
        return real(dig(self.document, "certainty", "epsilon"))

    def cuts(self, which: str = "after") -> tuple[int, int] | None:
        """Trial cuts with a load above the limit, and how many there were."""
        above, seeds = real(dig(self.cut, which, "above")), real(dig(self.cut, "seeds"))
        return None if above is None or not seeds else (int(above), int(seeds))

    @property
    def overloaded(self) -> bool:
        """Whether more trial cuts passed the limit than chance explains at what is allowed."""
        cuts = self.cuts()
        return cuts is not None and at_least(*cuts, self.epsilon or 0.0) < SURPRISE


def at_least(many: int, of: int, chance: float) -> float:
    """Probability that ``many`` or more ``of`` independent cuts pass, each with ``chance``.

    >>> [round(at_least(k, 20, 0.01), 4) for k in (0, 1, 2)]
    [1.0, 0.1821, 0.0169]
    """
    return 1.0 - sum(comb(of, k) * chance**k * (1 - chance) ** (of - k) for k in range(many))


@dataclass(frozen=True, kw_only=True)
class PartPrograms:
    """The optimised programs of a machine, in the order of their labels."""

    programs: list[PartProgram] = field(default_factory=list)
    trial: Path | None = None

    @property
    def seconds(self) -> tuple[float, float] | None:
        """Of all programs together, before and after [s]; None where one is not known."""
        pairs = [
            [real(dig(one.document, which, "time_s")) for which in ("before", "after")]
            for one in self.programs
        ]
        known = [(a, b) for a, b in pairs if a is not None and b is not None]
        if not known or len(known) < len(pairs):
            return None
        return sum(a for a, _ in known), sum(b for _, b in known)


def part_programs(folders: MachineFolders, shelf: Shelf) -> PartPrograms:
    """What the documents of optimised programs and of their trial cuts say."""
    if folders.parts is None:
        return PartPrograms()
    trial = None if folders.trial is None else shelf.document(folders.trial, CUT)
    cuts = objects_of(trial, "parts")
    found = [
        PartProgram(label=path.stem, document=document, path=path, cut=cuts.get(path.stem))
        for path in sorted(folders.parts.glob("*.json"))
        if (document := shelf.document(path, MODELS)) is not None
    ]
    return PartPrograms(programs=found, trial=folders.trial if trial is not None else None)
