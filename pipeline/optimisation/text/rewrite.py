"""Program with other F and S words, every other byte kept, and the rows that match in both."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from pipeline.gcode.interpret import interpret
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program, number_text
from pipeline.gcode.setup import Setup
from pipeline.optimisation.problem.arrays import Editable
from pipeline.optimisation.proof.text import WordChange
from pipeline.optimisation.text.editable_blocks import (
    LineRuns,
    ModalWords,
    at_speed,
    places_of,
    reads_feed,
)
from pipeline.optimisation.text.words import (
    FeedText,
    ProgramWords,
    in_place_of,
    rounded_feeds,
    rounded_speeds,
)
from pipeline.schema.arrays import Bools, Floats, Rows


@dataclass(frozen=True, kw_only=True)
class Rewritten:
    """The new text of a program, and the words that differ."""

    text: bytes = field(repr=False)
    changes: tuple[WordChange, ...]


def rewrite(
    program: Program,
    moves: Moves,
    editable: Editable,
    feeds: ArrayLike,
    speeds: ArrayLike,
    setup: Setup,
) -> Rewritten:
    """Program that gives each row its F (M,), in the units of ``Moves``, and S (M,) [rev/min]."""
    wanted_f = _wanted_feeds(program, moves, editable, feeds)
    wanted_s = _wanted_speeds(moves, editable, speeds)
    places = places_of(program, moves)
    _refuse_several(places.line_runs, places.speed, wanted_s, moves)
    words, text = places.words, FeedText.of(places.words, moves)
    changed: dict[int, list[tuple[str, bytes]]] = {}
    for line, (row, value) in _values(places.feed, wanted_f, places.feed_may):
        changed.setdefault(line, []).append(("F", text.number(row, value)))
    for line, (_, value) in _values(places.speed, wanted_s, places.speed_may):
        changed.setdefault(line, []).append(("S", f"{value:.0f}".encode("ascii")))
    written, changes = _put(words, changed)
    _check(program, moves, written, wanted_f, wanted_s, setup)
    return Rewritten(text=written, changes=changes)


def _wanted_feeds(program: Program, moves: Moves, editable: Editable, feeds: ArrayLike) -> Floats:
    given = _of_rows("feeds", feeds, moves)
    changes = reads_feed(moves) & (given != moves.feed)
    _refuse(changes & (editable.block < 0), "F", moves, given, moves.feed)
    bad = changes & ~((given > 0) & np.isfinite(given))
    _refuse(bad, "F", moves, given, moves.feed)
    changed = np.where(changes, given, moves.feed)
    wanted = np.where(changes, rounded_feeds(program, moves, np.maximum(changed, 1e-9)), moves.feed)
    rows = np.flatnonzero(editable.block >= 0)
    block = editable.block[rows]
    one = np.full(len(editable.line), np.nan)
    one[block] = wanted[rows]
    differs = rows[wanted[rows] != one[block]]
    if len(differs):
        raise ValueError(
            f"{program.name}:{moves.line[differs[0]]} is to have several feeds: rows of one line "
            "share their F"
        )
    return wanted


def _wanted_speeds(moves: Moves, editable: Editable, speeds: ArrayLike) -> Floats:
    given = _of_rows("speeds", speeds, moves)
    changes = at_speed(moves) & (given != moves.speed)
    _refuse(changes & ~editable.speed, "S", moves, given, moves.speed)
    _refuse(changes & ~((given > 0) & np.isfinite(given)), "S", moves, given, moves.speed)
    return np.where(changes, rounded_speeds(np.where(changes, given, 1.0)), moves.speed)


def _of_rows(name: str, values: ArrayLike, moves: Moves) -> Floats:
    given = np.asarray(values, dtype=np.float64)
    if given.shape != (len(moves),):
        raise ValueError(f"{name} has the shape {given.shape}: give one value for each row")
    return given


def _refuse(rows: Bools, letter: str, moves: Moves, given: Floats, own: Floats) -> None:
    wrong = np.flatnonzero(rows)
    if len(wrong):
        row = wrong[0]
        raise ValueError(
            f"{moves.files[moves.file[row]]}:{moves.line[row]} is to have {letter}{given[row]:g} "
            f"in place of {letter}{own[row]:g}: change only what editable_blocks says may be "
            "changed, to positive numbers"
        )


def _refuse_several(line_runs: LineRuns, speed: ModalWords, wanted: Floats, moves: Moves) -> None:
    one = line_runs.one_value(wanted, at_speed(moves))[speed.run]
    several = np.flatnonzero(np.isnan(one))
    if len(several):
        raise ValueError(
            f"line {speed.line[several[0]]} is to have several speeds: rows of one pass share "
            "their S"
        )


def _values(
    modal: ModalWords, wanted: Floats, may: Bools
) -> Iterator[tuple[int, tuple[int, float]]]:
    row = dict(zip(modal.line.tolist(), modal.row.tolist(), strict=True))
    for line, value in modal.written(wanted[modal.row], may).items():
        yield line, (row[line], value)


def _put(
    words: ProgramWords, changed: Mapping[int, list[tuple[str, bytes]]]
) -> tuple[bytes, tuple[WordChange, ...]]:
    program, edits, changes = words.program, [], []
    tokens = {letter: words.token(letter) for letter in "FS"}
    start = program.tokens.start
    for line in sorted(changed):
        for letter, number in changed[line]:
            token = int(tokens[letter][line])
            if token < 0:
                at, lead, small = words.place(line)
                word = (letter.lower() if small else letter).encode("ascii") + number
                edits.append((at, at, lead + word))
                changes.append(WordChange(line, letter, None, _shown(word)))
                continue
            first, last = int(start[token]), int(start[token + 1])
            old = program.data[first:last]
            if float(number_text(old)) != float(number):
                new = in_place_of(old, number)
                edits.append((first, last, new))
                changes.append(WordChange(line, letter, _shown(old), _shown(new)))
    return _edited(program.data, edits), tuple(changes)


def _shown(word: bytes) -> str:
    return word.decode("latin-1")


def _edited(data: bytes, edits: list[tuple[int, int, bytes]]) -> bytes:
    """Bytes with others in the place of some; several at one place in their order."""
    pieces, at = [], 0
    for first, last, text in sorted(edits, key=lambda edit: edit[0]):
        pieces += [data[at:first], text]
        at = last
    return b"".join([*pieces, data[at:]])


def _check(
    program: Program, moves: Moves, text: bytes, feeds: Floats, speeds: Floats, setup: Setup
) -> None:
    after = interpret(Program(text, program.name), setup)
    rows = matching_rows(moves, after)
    wrong = (reads_feed(moves) & (after.feed[rows] != feeds)) | (
        at_speed(moves) & (after.speed[rows] != speeds)
    )
    bad = np.flatnonzero(wrong)
    if len(bad):
        row, other = bad[0], rows[bad[0]]
        raise ValueError(
            f"{moves.files[moves.file[row]]}:{moves.line[row]} has F{after.feed[other]:g} "
            f"S{after.speed[other]:g} in the new text and should have F{feeds[row]:g} "
            f"S{speeds[row]:g}: its F or S comes from where it cannot be followed, leave it as it "
            "is"
        )


def only_speed(moves: Moves) -> Bools:
    """Rows that are an S word of a turning spindle and nothing else (M,)."""
    turned = np.diff(moves.direction, prepend=np.int8(0)) != 0
    return (moves.kind == Kind.SPINDLE) & (moves.code == 0) & ~turned


def matching_rows(before: Moves, after: Moves) -> Rows:
    """Row of ``after`` for each row of ``before``; shape (M,), ascending."""
    spare_before, spare_after = only_speed(before), only_speed(after)
    rows, others = np.flatnonzero(~spare_before), np.flatnonzero(~spare_after)
    if len(rows) != len(others) or not _alike(before, after, rows, others):
        raise ValueError(
            f"{before.files[0]} has {len(rows)} moves and {after.files[0]} {len(others)} others: "
            "rows match only where nothing but F and S words differ"
        )
    matches = np.empty(len(before), dtype=np.intp)
    matches[rows] = others
    for row in np.flatnonzero(spare_before).tolist():
        # the S word of the same line: it stands right before what the line does
        start = matches[row - 1] + 1 if row else 0
        if not (
            start < len(after)
            and spare_after[start]
            and before.line[row] == after.line[start]
            and before.file[row] == after.file[start]
        ):
            raise ValueError(
                f"{before.files[before.file[row]]}:{before.line[row]} has an S word that "
                f"{after.files[0]} has not: rows match only where no S word was taken away"
            )
        matches[row] = start
    return matches


def _alike(before: Moves, after: Moves, rows: Rows, others: Rows) -> bool:
    names = ("kind", "line", "file", "end", "direction", "tool", "code", "value")
    return all(
        np.array_equal(getattr(before, name)[rows], getattr(after, name)[others]) for name in names
    )
