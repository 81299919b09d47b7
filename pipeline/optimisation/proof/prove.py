"""Proof that a program was changed in nothing but its F and S words.

The texts are the same, byte for byte, but for numbers of F and S words and such words added at the
end of a line's words, only where F is a feed and S a speed.  Both programs, interpreted with the
same set-up, make the same moves to the last bit: positions, arcs, planes, feed modes, tools,
frames, spindle direction, M codes, dwells, path modes; by the same lines, with the switch for ``/``
either way.  A changed word in a line that is never executed is a difference.  The hash is one of
the equal content, so that either program alone gives it again.

Not proved: a program that reads the F or S in force may keep it in a variable that outlives the
run, or branch on it.
"""

import hashlib
import re
from dataclasses import dataclass, replace

import numpy as np

from pipeline.gcode.errors import GcodeError
from pipeline.gcode.interpret import Interpreter
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program
from pipeline.gcode.setup import Setup
from pipeline.optimisation.proof.moves import (
    Splits,
    merged,
    moves_difference,
    moves_digest,
    splits_of,
)
from pipeline.optimisation.proof.reasons import text_difference
from pipeline.optimisation.proof.text import (
    Difference,
    WordChange,
    proof_line,
    shown,
    text_digest,
    with_comment,
    without_comment,
)
from pipeline.schema.arrays import Bools

LEFT_OUT = "it is not executed, so that nothing proves what its F or S means"
OTHERWISE = "one program executes it and the other does not"
READ = "it reads the F or S in force, which differ"
_READS = re.compile(
    rb"(?i)#<\s*_(?:feed|rpm)\s*>|#\s*\[?\s*4\s*[0-4]\s*[01]\s*9(?![0-9])|\$P_[FS]\b|\$AC_"
)
"""The feed and speed in force: LinuxCNC's parameters, Fanuc's modal variables, Siemens' own."""
_SKIP = re.compile(rb"(?i)\s*(?:N\s*[0-9]+\s*)?/")
LEVELS = tuple(range(1, 10))
"""Levels of the block skip ``/``."""


@dataclass(frozen=True, kw_only=True)
class Proof:
    """Result of the comparison of two programs."""

    same: bool
    """Whether nothing but F and S words differs."""
    first: Difference | None
    """The first block that is not the same."""
    differences: tuple[WordChange, ...]
    """F and S words changed and added, in the order of the lines; up to ``first``."""
    moves: int
    """Rows that were compared; 0 where the texts already differ."""
    sha256: str
    """SHA-256 of the equal content; empty where the programs differ."""
    before_sha256: str
    after_sha256: str
    """SHA-256 of the second text."""
    dialect: str = "fanuc"
    """Dialect in which both programs were read."""
    points: int = 0
    """Lines that were put in on the path of straight cuts."""


def prove(
    before: bytes, after: bytes, name_before: str, name_after: str, setup: Setup, *,
    splits: bool = False,
) -> Proof:  # fmt: skip
    """The comparison of :func:`proved`."""
    return proved(before, after, name_before, name_after, setup, splits=splits)[0]


def proved(
    before: bytes, after: bytes, name_before: str, name_after: str, setup: Setup, *,
    splits: bool = False,
) -> tuple[Proof, tuple[Moves, Moves] | None]:  # fmt: skip
    """Proof of two texts and their moves, split lines merged where ``splits`` are allowed."""
    for data, name in ((before, name_before), (after, name_after)):
        if not data.strip():
            raise ValueError(f"{name} is empty: name a part program")
    lines, _, _ = without_comment(before.splitlines(keepends=True))
    others, written, place = without_comment(after.splitlines(keepends=True))
    splitting = splits_of(lines, others) if splits else None
    kept = others if splitting is None else splitting.kept
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
        points=0 if splitting is None else len(splitting.points),
    )
    if not proof.same:
        return proof, None
    texts = _Texts(lines, others, kept, changes, splitting, (name_before, name_after))
    first, one, whole, other = texts.compared(setup)
    if first is not None:
        return replace(proof, same=False, first=first, moves=len(one)), (one, other)
    sha256 = _sha256(lines, one)
    first = _wrong_hash(written, place, sha256, _sha256(kept, whole))
    agreed = "" if first is not None else sha256
    made = replace(proof, same=first is None, first=first, moves=len(one), sha256=agreed)
    return made, (one, other)


@dataclass(frozen=True, slots=True)
class _Texts:
    """Two programs whose texts are the same but for F and S words: what they make is compared."""

    lines: list[bytes]
    others: list[bytes]
    kept: list[bytes]
    changes: tuple[WordChange, ...]
    splits: Splits | None
    names: tuple[str, str]

    def compared(self, setup: Setup) -> tuple[Difference | None, Moves, Moves, Moves]:
        """First difference with the switch for ``/`` either way, and the moves as it is set."""
        run: Bools = np.zeros(len(self.lines) + 1, dtype=np.bool_)
        made: list[tuple[Moves, Moves, Moves]] = []
        first = None
        for one in switches(self.lines, setup):
            try:
                first, before, whole, after = self._made(one, run)
            except GcodeError:
                if one is setup:
                    raise
                continue  # it is no program with that switch
            made.append((before, whole, after))
            if first is not None:
                break
        if self.changes:
            first = first or left_out(self.changes, self.lines, self.kept, run)
            first = first or reads_in_force(self.lines, self.kept, run)
        return first, *made[0]

    def _made(self, setup: Setup, run: Bools) -> tuple[Difference | None, Moves, Moves, Moves]:
        """The first difference of what is made, and the moves; ``run`` gets executed lines."""
        lines, kept = self.lines, self.kept
        one, executed = executed_moves(Program(b"".join(lines), self.names[0]), setup)
        other, after = executed_moves(Program(b"".join(self.others), self.names[1]), setup)
        run |= executed
        whole = other if self.splits is None else merged(other, self.splits)
        if not isinstance(whole, Moves):
            texts = [shown(b"".join(text[whole[0] - 1 : whole[0]])) for text in (lines, kept)]
            return Difference(whole[0], texts[0], texts[1], whole[1]), one, other, other
        first = _in_lines(moves_difference(one, whole), one, lines, kept)
        if self.splits is not None:
            after = np.delete(after, sorted(self.splits.points))
        return first or executed_otherwise(lines, kept, executed, after), one, whole, other


def with_proof_comment(text: bytes, proof: Proof) -> bytes:
    """A program with the proof's hash in a comment at its end, before a closing ``%``."""
    if not proof.same:
        raise ValueError(f"there is no proof to write into the program: {proof.first}")
    lines = text.splitlines(keepends=True)
    return b"".join(with_comment(lines, proof_line(proof.sha256, proof.dialect)))


def _in_lines(
    difference: tuple[int, int, str] | None, moves: Moves, lines: list[bytes], others: list[bytes]
) -> Difference | None:
    if difference is None:
        return None
    row, _, what = difference
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


def _wrong_hash(written: str | None, place: int, sha256: str, other: str) -> Difference | None:
    """Whether a hash is not the one of both programs, that in the comment too."""
    if written is not None and written != sha256:
        reason = "its proof comment has another hash (of another set-up, or another program)"
        return Difference(place + 1, sha256, written, reason)
    if sha256 != other:
        return Difference(0, sha256, other, "the hashes of what is the same differ")
    return None


def executed_moves(program: Program, setup: Setup) -> tuple[Moves, Bools]:
    """Moves of a program, and which of its lines it executes (L + 1,), that of line n is n."""
    walk = Interpreter(program, setup)
    return walk.moves(), walk.executed


def switches(lines: list[bytes], setup: Setup) -> list[Setup]:
    """The set-up, and where lines begin with ``/`` also with all of them executed, and none."""
    if not any(_SKIP.match(line) for line in lines):
        return [setup]
    others = [skip for skip in ((), LEVELS) if skip != setup.block_skip]
    return [setup, *(replace(setup, block_skip=skip) for skip in others)]


def left_out(
    changes: tuple[WordChange, ...], lines: list[bytes], others: list[bytes], executed: Bools
) -> Difference | None:
    """First changed word in no executed line; ``executed`` (L + 1,), equally many lines."""
    for change in changes:
        if not executed[change.line]:
            return _difference(change.line, lines, others, LEFT_OUT)
    return None


def executed_otherwise(
    lines: list[bytes], others: list[bytes], executed: Bools, executed_after: Bools
) -> Difference | None:
    """The first line that one program executes and the other does not."""
    differs = np.flatnonzero(executed != executed_after)
    return _difference(int(differs[0]), lines, others, OTHERWISE) if len(differs) else None


def reads_in_force(lines: list[bytes], others: list[bytes], executed: Bools) -> Difference | None:
    """The first executed line that reads the F or S in force."""
    for number, text in enumerate(lines, 1):
        if executed[number] and _READS.search(text):
            return _difference(number, lines, others, READ)
    return None


def _difference(number: int, lines: list[bytes], others: list[bytes], reason: str) -> Difference:
    return Difference(number, shown(lines[number - 1]), shown(others[number - 1]), reason)
