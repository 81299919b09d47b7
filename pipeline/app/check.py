"""Check of ``kerf check``: a program was changed in nothing but its F and S words."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pipeline.app.programs import machine_setup
from pipeline.optimisation.proof.prove import Proof, prove

ADDED = "-"


def check_programs(
    before: Path, after: Path, machine: str | None, dialect: str | None, *, splits: bool = False
) -> Proof:
    """Compare two programs with the set-up of ``machine``, read in ``dialect``.

    Subprograms of both are searched in the folder of ``before``.  With ``splits`` the second may
    have more points on the path of straight cuts.

    Raises
    ------
    ValueError
        When a file does not exist or cannot be followed, or there is no such machine or dialect.
    """
    setup = machine_setup(machine, dialect)
    texts = [_text(path) for path in (before, after)]
    setup = replace(setup, folders=(*setup.folders, before.resolve().parent))
    return prove(texts[0], texts[1], before.name, after.name, setup, splits=splits)


def _text(path: Path) -> bytes:
    if not path.is_file():
        state = "is no file" if path.exists() else "does not exist"
        raise ValueError(f"{path} {state}: name a part program")
    return path.read_bytes()


def check_lines(proof: Proof, before: Path, after: Path) -> Iterator[str]:
    """Lines that ``kerf check`` prints: words that differ, how many, and the proof's hash."""
    if proof.differences:
        yield f"{'line':>8}  {before.name} -> {after.name}"
    for change in proof.differences:
        yield f"{change.line:>8}  {change.before or ADDED:<12} -> {change.after}"
    counts = [
        f"{sum(c.letter == letter and (c.before is None) == added for c in proof.differences)} "
        f"{letter} {'added' if added else 'changed'}"
        for letter in "FS"
        for added in (False, True)
    ]
    if proof.points:
        counts.append(f"{proof.points} points put in")
    yield ", ".join(counts)
    if proof.first is not None:
        yield f"not the same, first in line {proof.first.line}: {proof.first.reason}"
        yield f"  {before.name}: {proof.first.before}"
        yield f"  {after.name}: {proof.first.after}"
        return
    but = ", but for feed and speed" if proof.differences else ""
    yield f"{proof.moves} moves are the same to the last bit{but}"
    yield f"proof sha256 {proof.sha256}"
