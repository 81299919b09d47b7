"""The proof that a program was changed in nothing but its F and S words.

Two questions, answered without the code that writes words.  Are the texts the same, byte for byte,
but for numbers of F and S words and such words added at the end of a line's words, and only where
F is a feed and S a speed?  And do both programs, interpreted with the same set-up, make the same
moves to the last bit: positions, arcs, planes, feed modes, tools, frames, spindle direction, M
codes, dwells, path modes; by the same lines, and with the switch for ``/`` either way?  A word in
a line that is never executed is a difference, since nothing tells what it means.  The proof's hash
is one of what is the same, so that either program alone gives it again.
"""

import hashlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof.comment import proof_line, with_comment, without_comment
from pipeline.optimisation.proof.executed import (
    followed,
    left_out,
    of_kept,
    other_way,
    read,
    switches,
)
from pipeline.optimisation.proof.moves import moves_difference, moves_digest
from pipeline.optimisation.proof.splits import Splits, merged, splits_of
from pipeline.optimisation.proof.text import Difference, shown, text_difference, text_digest
from pipeline.optimisation.text.word_changes import WordChange

Flags = NDArray[np.bool_]

__all__ = ["Difference", "Proof", "prove", "with_proof_comment"]


@dataclass(frozen=True, kw_only=True)
class Proof:
    """What two programs have in common.

    Parameters
    ----------
    same : bool
        Whether nothing but F and S words differs.
    first : Difference or None
        The first block that is not the same.
    differences : tuple of WordChange
        F and S words changed and added, in the order of the lines; up to ``first``.
    moves : int
        Rows that were compared; 0 where the texts already differ.
    sha256 : str
        Of what is the same; empty where the programs are not.
    before_sha256, after_sha256 : str
        Of the two texts.
    dialect : str
        That both were read in.
    points : int
        Lines that were put in on the way of straight cuts.
    """

    same: bool
    first: Difference | None
    differences: tuple[WordChange, ...]
    moves: int
    sha256: str
    before_sha256: str
    after_sha256: str
    dialect: str = "fanuc"
    points: int = 0


def prove(
    before: bytes,
    after: bytes,
    name_before: str,
    name_after: str,
    setup: Setup,
    *,
    splits: bool = False,
) -> Proof:
    """Compare two texts, then what they make a machine do.

    Parameters
    ----------
    before, after : bytes
        Programs.
    name_before, name_after : str
        For errors.
    setup : Setup
        That both are interpreted with.
    splits : bool
        Whether lines may have been put in whose points lie on straight cuts; what is merged again
        must be the same.

    Raises
    ------
    ValueError
        When a program is empty or cannot be followed.
    """
    for data, name in ((before, name_before), (after, name_after)):
        if not data.strip():
            raise ValueError(f"{name} is empty: name a part program")
    lines, _, _ = without_comment(before.splitlines(keepends=True))
    others, told, place = without_comment(after.splitlines(keepends=True))
    found = splits_of(lines, others) if splits else None
    kept = others if found is None else found.kept
    first, changes = text_difference(lines, kept)
    proof = Proof(
        same=first is None,
        first=first,
        differences=changes,
        moves=0,
        sha256="",
        before_sha256=hashlib.sha256(before).hexdigest(),
        after_sha256=hashlib.sha256(after).hexdigest(),
        dialect=setup.dialect,
        points=0 if found is None else len(found.points),
    )
    if not proof.same:
        return proof
    texts = _Texts(lines, others, kept, changes, found, (name_before, name_after))
    first, one, whole = texts.compared(setup)
    if first is not None:
        return replace(proof, same=False, first=first, moves=len(one))
    sha256 = _sha256(lines, one)
    first = _wrong_hash(told, place, sha256, _sha256(kept, whole))
    agreed = "" if first is not None else sha256
    return replace(proof, same=first is None, first=first, moves=len(one), sha256=agreed)


@dataclass(frozen=True, slots=True)
class _Texts:
    """Two programs whose texts are the same but for F and S words: what they make is compared."""

    lines: list[bytes]
    others: list[bytes]
    kept: list[bytes]
    changes: tuple[WordChange, ...]
    splits: Splits | None
    names: tuple[str, str]

    def compared(self, setup: Setup) -> tuple[Difference | None, Moves, Moves]:
        """The first difference with the switch for ``/`` either way; the moves as it is set."""
        run: Flags = np.zeros(len(self.lines) + 1, dtype=np.bool_)
        found, first = [], None
        for one in switches(self.lines, setup):
            try:
                first, *moves = self._made(one, run)
            except GcodeError:
                if one is setup:
                    raise
                continue  # it is no program that way
            found.append(moves)
            if first is not None:
                break
        if self.changes:
            first = first or left_out(self.changes, self.lines, self.kept, run)
            first = first or read(self.lines, self.kept, run)
        return first, found[0][0], found[0][1]

    def _made(self, setup: Setup, run: Flags) -> tuple[Difference | None, Moves, Moves]:
        """The first difference of what is made, and the moves; ``run`` gets executed lines."""
        lines, kept = self.lines, self.kept
        one, executed = followed(Program(b"".join(lines), self.names[0]), setup)
        other, after = followed(Program(b"".join(self.others), self.names[1]), setup)
        run |= executed
        whole = other if self.splits is None else merged(other, self.splits)
        if not isinstance(whole, Moves):
            texts = [shown(b"".join(text[whole[0] - 1 : whole[0]])) for text in (lines, kept)]
            return Difference(whole[0], texts[0], texts[1], whole[1]), one, other
        first = _in_lines(moves_difference(one, whole), one, lines, kept)
        return first or other_way(lines, kept, executed, of_kept(after, self.splits)), one, whole


def with_proof_comment(text: bytes, proof: Proof) -> bytes:
    """A program with the proof's hash in a comment at its end, before a closing ``%``.

    Raises
    ------
    ValueError
        When there is no proof.
    """
    if not proof.same:
        raise ValueError(f"there is no proof to write into the program: {proof.first}")
    lines = text.splitlines(keepends=True)
    return b"".join(with_comment(lines, proof_line(proof.sha256, proof.dialect)))


def _in_lines(
    found: tuple[int, int, str] | None, moves: Moves, lines: list[bytes], others: list[bytes]
) -> Difference | None:
    """A difference of moves, told by the line that makes them."""
    if found is None:
        return None
    row, _, what = found
    inside = row >= 0 and moves.file[row] == 0
    at = int(moves.line[row]) if inside else 0
    texts = [shown(text[at - 1]) if at else "" for text in (lines, others)]
    where = "" if inside or row < 0 else f" in {moves.files[moves.file[row]]}:{moves.line[row]}"
    return Difference(at, texts[0], texts[1], f"the moves differ{where}: {what}")


def _sha256(lines: list[bytes], moves: Moves) -> str:
    digest = hashlib.sha256(b"kerf proof 1\n")
    digest.update(text_digest(lines))
    digest.update(moves_digest(moves))
    return digest.hexdigest()


def _wrong_hash(told: str | None, place: int, sha256: str, other: str) -> Difference | None:
    """Whether a hash is not the one of both programs, that in the comment too."""
    if told is not None and told != sha256:
        reason = "its proof comment has another hash (of another set-up, or another program)"
        return Difference(place + 1, sha256, told, reason)
    if sha256 != other:
        return Difference(0, sha256, other, "the hashes of what is the same differ")
    return None
