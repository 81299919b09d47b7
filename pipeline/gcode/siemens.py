"""Lines of a Sinumerik 840D program to statements of ISO 6983.

What moves the machine is said in the words that the interpreter knows (SUPA as G53, CYCLE81 as G81,
TRANS as G52, ``D1`` as G43 with the tool's number); what does not move it stands in
:data:`~pipeline.gcode.siemens_words.WITHOUT_MOTION`; anything else is an error.  The dialect has no
jumps here, so that lines are read in the order in which they are carried out and a reader may
remember what it read: the tool, the modal call, the turned work plane.

Source: Sinumerik 840D sl, Programming Manual Fundamentals, Job Planning, Cycles.
"""

from collections.abc import Mapping

from pipeline.gcode.program import Line
from pipeline.gcode.siemens_frames import SQUARE, tilt
from pipeline.gcode.siemens_line import Memory, Reading, constant
from pipeline.gcode.siemens_scanner import Pieces, Token
from pipeline.gcode.siemens_words import AXES
from pipeline.gcode.statements import Binary, Number, Statement, WordItem


class SiemensReader:
    """Reads the lines of one program, in order.

    Parameters
    ----------
    file : str
        Name for errors.
    tools : mapping of str to int, optional
        Number in the tool table of a tool's name; names that are not in it get the next free
        numbers in the order in which they are called.
    """

    def __init__(self, file: str, tools: Mapping[str, int] | None = None) -> None:
        self.file = file
        self.memory = Memory(dict(tools or {}))

    def statement(self, line: Line) -> Statement:
        """What the next line asks for.

        Raises
        ------
        GcodeError
            A word that is not known, or that cannot be followed.
        """
        pieces = Pieces(line.text.decode("latin-1"), line.number, self.file, line.code_start)
        reading = Reading(self.memory, pieces)
        reading.read()
        if not reading.shifts:
            self._remember(reading)
            self._check(reading)
        return Statement(
            line.number,
            line.skip,
            reading.number,
            tuple(self._drilled(reading)),
            tuple(reading.assignments),
            None,
            tuple(pieces.comments),
        )

    def _remember(self, reading: Reading) -> None:
        memory = self.memory
        for word in reading.words:
            value = constant(word.value)
            if word.letter == "G" and value in (0.0, 1.0, 2.0, 3.0):
                memory.motion = value
            elif word.letter == "G" and value in (90.0, 91.0):
                memory.absolute = value == 90.0
            elif word.letter == "M" and value == 6:
                memory.tool = memory.selected
            elif word.letter in memory.at:
                unknown = not memory.absolute or (word.letter == "Z" and reading.machine)
                memory.at[word.letter] = None if unknown else value

    def _check(self, reading: Reading) -> None:
        """Whether motion can be followed with the table and the axes turned as they are."""
        memory = self.memory
        moved = next((word for word in reading.words if word.letter in AXES), None)
        if moved is None or reading.machine:
            return
        b, c = (memory.at["B"], memory.at["C"]) if memory.transformed else (0.0, 0.0)
        if b is None or c is None or tilt(memory.frame, b, c) > SQUARE:
            reason = (
                "the work plane that AROT makes is not square to the tool with the table at this B "
                "and C under TRAORI: correct the angles, or give B and C as numbers before"
            )
        elif memory.transformed and any(word.letter in "BC" for word in reading.words):
            reason = (
                "moving B or C under TRAORI needs the machine's dimensions, which are not known: "
                "post the program with 3+2 axes"
            )
        elif memory.transformed and memory.shifted:
            reason = "TRANS under TRAORI is not supported: shift the coordinates in the program"
        else:
            return
        raise reading.pieces.error(_token(moved), reason)

    def _drilled(self, reading: Reading) -> list[WordItem]:
        """The words; in a block that moves under MCALL with the hole."""
        drilling, words = self.memory.drilling, reading.words
        moved = next((word for word in words if word.letter in "XYZ"), None)
        if drilling is None or reading.calls or reading.shifts or moved is None:
            return words
        retract, reference, clearance, depth = drilling
        level = constant(retract)
        if self.memory.motion != 0 or level is None or self.memory.at["Z"] != level:
            raise reading.pieces.error(
                _token(moved),
                "holes are followed where G0 is in force and Z stands at CYCLE81's retraction "
                "plane: position there before MCALL, in numbers",
            )
        plane = Binary("+", reference, clearance)
        hole = (("G", Number(81.0)), ("Z", depth), ("R", plane))
        kept = [word for word in words if word.letter != "Z" and not _is_rapid(word)]
        return kept + [WordItem(name, value, moved.column, moved.text) for name, value in hole]


def _is_rapid(word: WordItem) -> bool:
    return word.letter == "G" and word.value == Number(0.0)


def _token(word: WordItem) -> Token:
    return Token("", word.text, word.column, "", 0.0)
