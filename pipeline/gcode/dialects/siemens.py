"""Programs of the Sinumerik 840D, line by line to statements of ISO 6983.

Words that move the machine become those of ISO 6983 (SUPA as G53, CYCLE81 as G0 and G1, TRANS as
G52, ``D1`` as G43 with the tool's number); words without motion are in
:data:`~pipeline.gcode.dialects.siemens_words.WITHOUT_MOTION`; anything else is an error.  Lines are
read in the order of execution, since a reader remembers the tool, the modal call, the work plane.

Source: Sinumerik 840D sl, Programming Manual Fundamentals, Job Planning, Cycles.
"""

from collections.abc import Callable

from pipeline.gcode.dialects.siemens_line import LineReader
from pipeline.gcode.dialects.siemens_tokens import TokenStream
from pipeline.gcode.dialects.siemens_words import AXES, SQUARE, ModalMemory, tilt, token_of
from pipeline.gcode.moves import INCH
from pipeline.gcode.program import Line
from pipeline.gcode.setup import Setup
from pipeline.gcode.statements import ParameterStore, Statement, constant

UNITS = {70.0: INCH, 700.0: INCH, 71.0: 1.0, 710.0: 1.0}
"""G code -> millimetres in its unit of length."""
SYSTEMS = (53.0, 54.0, 55.0, 56.0, 57.0, 500.0)
"""G codes after which a coordinate means another place."""


class SiemensReader:
    """Reader of a program's lines in the order of execution, with its memory of modal data.

    Tool names get the numbers of ``setup``, others the next free ones; lines of a ``/`` level that
    is switched on are not read.  ``note`` takes a line and a remark on it.
    """

    def __init__(
        self, file: str, setup: Setup, store: ParameterStore | None = None,
        note: Callable[[int, str], None] = lambda line, what: None,
    ) -> None:  # fmt: skip
        self.file, self.skipped = file, setup.block_skip
        defined = {str(name).lower(): "REAL" for name in setup.parameters}
        unit = INCH if setup.inch else 1.0
        self.memory = ModalMemory(
            dict(setup.tool_names), defined=defined, common=frozenset(defined), unit=unit,
            store=store, note=note,
            radii={number: tool.diameter / 2 for number, tool in setup.tools.items()},
        )  # fmt: skip

    def statement(self, line: Line, file: str = "") -> Statement:
        """Statement of the next line, of another ``file`` in a subprogram; may raise GcodeError."""
        if line.skip is not None and line.skip in self.skipped:
            return Statement(line.number, line.skip, None, (), (), None, ())
        stream = TokenStream(
            line.text.decode("latin-1"), line.number, file or self.file, line.code_start
        )
        reader = LineReader(self.memory, stream)
        reader.read()
        if not reader.shifts:
            self._remember(reader)
            self._check(reader)
            moved = any(word.letter in AXES for word in reader.words)
            if moved and not (reader.calls or reader.rest):
                reader.drilled()
        return Statement(
            line.number,
            line.skip,
            reader.number,
            tuple(reader.words),
            tuple(reader.assignments),
            reader.control,
            tuple(stream.comments),
            tuple(
                Statement(line.number, line.skip, None, words, (), None, ())
                for words in reader.rest
            ),
        )

    def _remember(self, reader: LineReader) -> None:
        memory = self.memory
        for word in reader.words:
            value = constant(word.value)
            if word.letter == "G" and value in (0.0, 1.0, 2.0, 3.0):
                memory.motion = value
            elif word.letter == "G" and value in (17.0, 18.0, 19.0):
                memory.plane = value
            elif word.letter == "G" and value in (40.0, 41.0, 42.0):
                memory.compensated = value != 40.0
            elif word.letter == "G" and value in (90.0, 91.0):
                memory.absolute = value == 90.0
            elif word.letter == "G" and value in (*UNITS, *SYSTEMS):
                memory.unit = UNITS.get(value, memory.unit)
                memory.at["X"] = memory.at["Y"] = None
            elif word.letter == "F":
                memory.feed = memory.value(word.value)
            elif word.letter == "S":
                memory.speed = memory.value(word.value)
        self._remember_places(reader)

    def _remember_places(self, reader: LineReader) -> None:
        """Remember the positions of the axes, as far as they are numbers."""
        at = self.memory.at
        for word in reader.words:
            if word.letter not in at:
                continue
            absolute = self.memory.absolute if word.absolute is None else word.absolute
            linear, value = word.letter in "XY", self.memory.value(word.value)
            before = 0.0 if absolute else at[word.letter] if linear else None
            if before is None or value is None or (linear and reader.machine):
                at[word.letter] = None
            else:
                at[word.letter] = before + value

    def _check(self, reader: LineReader) -> None:
        """Refuse motion that the turned work plane or table does not allow."""
        memory = self.memory
        moved = next((word for word in reader.words if word.letter in AXES), None)
        if moved is None or reader.machine:
            return
        b, c = (memory.at["B"], memory.at["C"]) if memory.transformed else (0.0, 0.0)
        if b is None or c is None:
            reason = (
                "where the table stands under TRAORI is not known: give B and C as numbers, under "
                "G90, before the first move"
            )
        elif tilt(memory.frame, b, c) > SQUARE:
            reason = (
                "the work plane that AROT makes is not square to the tool with the table at this B "
                "and C under TRAORI: correct the angles, or give B and C as numbers before"
            )
        elif memory.transformed and any(word.letter in "BC" for word in reader.words):
            reason = (
                "moving B or C under TRAORI needs the machine's dimensions, which are not known: "
                "post the program with 3+2 axes"
            )
        elif memory.transformed and any(memory.shift.values()):
            reason = "TRANS under TRAORI is not supported: shift the coordinates in the program"
        else:
            return
        raise reader.stream.error(token_of(moved), reason)
