"""Signs of an operation: words of comments and tool names, and the cut itself.

Words are English, German, French, Italian and Spanish.  The operation that allows least counts:
FINISH FACE MILL is finishing.  A name that directly follows LEAVE, NEAR, BEFORE, AFTER or WITHOUT
does not count, one that directly follows FOR, or the others and a size, only where nothing else is
named: ROUGH, LEAVE 0.25 FOR FINISH is roughing.  Farther from them it counts: AFTER FLIP FINISH is
finishing.  A TAP DRILL is a drill, and BORE and COUNTERBORE are holes beside ROUGH, POCKET or
CONTOUR.

By the cut itself there are plunges, thin cuts, full width.  A cut reaches from where the tool
enters the material to where it leaves it, plunges or is lifted; its first and last rows may be
leads.
"""

import re
import unicodedata
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.cutting.catalogue import OPERATIONS, SLOTTING_IMMERSION, Operation
from pipeline.cutting.tool import Tool
from pipeline.gcode.moves import Kind, Moves
from pipeline.gcode.program import Program, TokenKind
from pipeline.schema.arrays import Bools, Floats, Rows
from pipeline.twin.cut.blocks import STEEP, CutBlocks
from pipeline.twin.cut.loads import Cut

READ_OTHERWISE: tuple[tuple[Operation | None, str], ...] = (
    (None, r"<(FINISH|SCHLICHT)[ -]?(ALLOWANCE|SIZE|STOCK|(AUF|UEBER)?MASS|ZUGABE)"
           r"|<(SLOT|POCKET|CONTOUR|PROFILE)[ -](WALL|FLOOR|SIDE|BOTTOM)"),
    ("drilling", r"<TAP(PING)?[ -]?(HOLE[ -]?)?DRILL|<PILOT|<CORE[ -]?(HOLE|DRILL)"
                 r"|(GEWINDE[ -]?)?KERN(LOCH|BOHR)"
                 r"|[#\d][\d.,/]* ?(MM )?DRILL \(?(M\d[\d.,X]*|[#\d][\d/]*-\d+)( UN[CF])? TAP>"),
    ("roughing", r"<SLOT[ -]?DRILL"),
    ("finishing", r"<SEMI([ -]?FINISH)?|VOR-?SCHLICHT"),
)  # fmt: skip
"""Words that together mean another operation than each alone, or none; < and > end a word."""
WORDS: tuple[tuple[Operation, str], ...] = (
    ("probing", r"PROB(E|ES|ING)>|MESSTAST|<TASTER|ANTAST|<MESS(EN|ZYK)|<EDGE[ -]?FIND|<PALPEUR"
                r"|<PALPAGE"),
    ("thread_milling", r"<THREAD[ -]?MILL|<THREAD(S|ING)?>|GEWINDEFR|<FILETAGE|<FILETTATURA"),
    ("tapping", r"<TAP(S|PING)?>|<THREAD[ -]?FORM|GEWINDE|<TARAUD|<MASCHI(O|ATURA)|<ROSCA|<MACHO"),
    ("reaming", r"<REAM(?!ED)|REIBAHL|<(AUS|AUF|VOR|NACH|FERTIG)?REIBEN|<ALES(AGE|OIR|ATORE|ATURA)"
                r"|<ESCARIA"),
    ("boring", r"<(BACK|FINE)?[ -]?BOR(E>|ING)|AUSDREH|(AUS|AUF|FEIN|FERTIG)BOHR|SPINDELN>"
               r"|BOHRSTANGE|BOHRKOPF|<MANDRINA|<BARENA"),
    ("engraving", r"<ENGRAV|GRAVIER|<GRAVUR|BESCHRIFT|<LETTERING|<TEXT>|<MARKING|<GRABA(R|DO)>"),
    ("chamfering", r"<CHAMFER(?!ED)|<CHAMF?>|<DEBURR|<BEVEL|<EDGE[ -]?BREAK|<CORNER[ -]?ROUND"
                   r"|<BREAK([ -](ALL|THE|SHARP|OUTER))*[ -](EDGE|CORNER)|<(AN)?FASEN?>|<FASENFR"
                   r"|FASFR|ENTGRAT|KANTEN?[ -]?(BRECH|BRUCH)|<CHANFREIN|<EBAVUR|<SMUSS"
                   r"|<SBAVA|<CHAFLAN"),
    ("countersinking", r"COUNTER[ -]?SINK|<C[ '/.-]?SINK|<CSN?K>|<(KEGEL|SPITZ|VER)?SENK(?!RECHT)"
                       r"|<FRAISUR|<SVASA|<AVELLAN"),
    ("counterboring", r"COUNTER[ -]?BOR(E|ING)|<C[ '/.-]?BOR(E|ING)|<SPOT[ -]?FAC"
                      r"|<BACK[ -]?(SPOT|FAC)|<(AN|FLACH|PLAN|ZAPFEN|STIRN|RUECK(WAERTS)?)[ -]?SENK"
                      r"|<LAMAGE"),
    ("centre_drilling", r"<SPOT|<(CENT(ER|RE)|CN?TR)[ .-]*DRILL|<CENT(ER|R)ING>|<[CS][/-]?DRILL"
                        r"|ZENTRIER|ANBOHR|<NC[ -]?BOHR|<POINTAGE|<CENTRAGE|<CENTRATURA|<CENTRINO"),
    ("deep_drilling", r"<DEEP[ -]?(HOLE|DRILL)|<GUN[ -]?DRILL|<PECK|TIEFBOHR|TIEFLOCH|EINLIPPEN"),
    ("finishing", r"<FINISH(?!ED)|<FIN>|<FINE>|<SPRING[ -]?(PASS|CUT)|<SMOOTH|<SKIM|<CLEAN[ -]?UP"
                  r"|<(FINAL|LAST)[ -](PASS|CUT)|SCHLICHT|<FERTIG(?!TEIL|MASS|KONTUR)|<FEIN"
                  r"|LEERSCHNITT|<FINITION|<FINITURA|<ACABAD"),
    ("drilling", r"DRILL(S|ING)?>|BOHR(?!UNG)|<PERCAGE|<PERCER|<FORET>|<FORATURA|<TALADR|<BROCA"),
    ("face_milling", r"<FACE[ -]?MILL|<FACING|PLANFR|<PLANEN>|MESSERKOPF|<SURFACAGE|<SPIANATURA"
                     r"|<PLANEADO"),
    ("roughing", r"<ROUGH|SCHRUPP|VORFR(AE)?S|<ADAPTIV|<TROCHO|<OPTI(LOAD|ROUGH)|WIRBELFR|<EBAUCH"
                 r"|<SGROSS|<DESBAST"),
    ("roughing", r"<SLOT(S|TING)?>|<KEYWAY|<POCKET|<CAVITY|<CONTOUR|<PROFILE?|<OUTSIDE|<SHOULDER"
                 r"|<HELI[CX]|<CIRCULAR|<FACE>|<MILLING|TASCHE|NUT(EN)?>|KONTUR|ABSATZ|FRAESEN>"
                 r"|<RAINURE|<POCHE|<TASCA|<RANURA|<CAJERA|<CONTORNO"),
)  # fmt: skip
"""Operations with the words that name them, those whose rule allows less first.

The last are sections of a program: what is roughed, slotted or finished there the cut itself says.
"""
ASIDE = (
    r"<(LEAV(E|ES|ING)|NEAR|BEFORE|AFTER|PRIOR TO|WITHOUT|UNTIL|VOR(?!-)|NACH|OHNE|NEBEN|AUFMASS"
    r"|AVANT|APRES|SANS|PRIMA|DOPO|SENZA|ANTES|DESPUES)>"
)
FOR = r"<(FOR|FUER|ZUM|ZUR|POUR|PER|PARA)>"
CLAUSE = r"[;:|]|,(?!\d)| - "
ARTICLE = r"THE|AN?|DE[MNRS]|DAS|DIE|L[EA]S?|IL|LO|EL|LOS"
SIZE = r"[#G+]?\.?\d[\d.,/]*( ?(MM|IN|INCH|\"))?|\d+H\d+|M(?!0|[12](?!\d))\d[\d.,X]*"
"""A number, a fit or a thread; M0, M1 and M2 are stops of the program."""

_ENTRIES = (*READ_OTHERWISE, *WORDS)
_ROUGH = len(_ENTRIES) - 2
"""Entry of the words that say roughing, and do not only name a section."""
_CARE = {name: place for place, (name, _) in reversed(list(enumerate(WORDS)))}


def _pattern() -> re.Pattern[str]:
    """One group for each entry and for what is said in passing."""
    groups = [(f"e{k}", words) for k, (_, words) in enumerate(_ENTRIES)]
    groups += [("aside", ASIDE), ("for", FOR), ("clause", CLAUSE)]
    ends = str.maketrans({"<": "(?<![A-Z])", ">": "(?![A-Z])"})
    return re.compile("|".join(f"(?P<{name}_>{words.translate(ends)})" for name, words in groups))


_PATTERN = _pattern()
_ARTICLES = re.compile(rf"[ -]*(({ARTICLE})[ -]+)*")
_SIZES = re.compile(rf"[ -]*(({ARTICLE}|{SIZE})[ -]+)*")
_NUMBER = re.compile(
    r"\b(?:T|TOOL|WKZ|WERKZEUG)\s*(?:NO\.?|NR\.?|[#=])?\s*0*(\d+)\b", re.IGNORECASE
)
_PLAIN = str.maketrans({"Ä": "AE", "Ö": "OE", "Ü": "UE", "_": " "})


@lru_cache(maxsize=4096)
def named_operation(text: str) -> Operation | None:
    """Operation that a comment or the name of a tool speaks of; roughing is any milling.

    >>> [named_operation(name) for name in ("10H7 REAMER", "8.5 DRILL", "16MM ENDMILL")]
    ['reaming', 'drilling', None]
    >>> named_operation("FINISH WALL AFTER DRILLING"), named_operation("6.8 TAP DRILL")
    ('finishing', 'drilling')
    """
    named = (_ENTRIES[entry][0] for entry in _named(text))
    return min((name for name in named if name is not None), key=_CARE.__getitem__, default=None)


def says_roughing(text: str) -> bool:
    """Whether a text says that a cut is a roughing one, and names nothing that allows less.

    >>> [says_roughing(text) for text in ("ADAPTIVE CLEARING", "POCKET", "ROUGH AND FINISH")]
    [True, False, False]
    """
    return named_operation(text) == "roughing" and _ROUGH in _named(text)


def _named(text: str) -> set[int]:
    plain = unicodedata.normalize("NFC", text).upper().translate(_PLAIN)
    plain = unicodedata.normalize("NFD", plain).encode("ascii", "ignore").decode()
    named: dict[str, set[int]] = {"": set(), "for": set(), "aside": set()}
    holes: set[int] = set()
    passing, behind = "", 0
    for found in _PATTERN.finditer(plain):
        kind = str(found.lastgroup).rstrip("_")
        if not _SIZES.fullmatch(plain, behind, found.start()):
            passing = ""
        if kind == "clause":
            passing = ""
        elif kind in ("aside", "for"):
            passing = "aside" if "aside" in (passing, kind) else "for"
            behind = found.end()
        else:
            entry = int(kind[1:])
            if passing == "aside" and not _ARTICLES.fullmatch(plain, behind, found.start()):
                passing = "for"
            if _ENTRIES[entry][0] is None:
                pass
            elif found[0].endswith("BORE") and not passing:
                holes.add(entry)
            else:
                named[passing].add(entry)
            passing = ""
    if any(_ENTRIES[entry][0] == "roughing" for entry in named[""]):
        holes = set()
    return (named[""] | holes) or named["for"]


def comments_of(program: Program) -> tuple[tuple[str, ...], dict[int, str]]:
    """Comments of each line (L + 1, line 0 unused), and those of tools by their number."""
    tokens, lines = program.tokens, [""] * (len(program) + 1)
    by_tool: dict[int, str] = {}
    line_of = np.repeat(np.arange(1, len(program) + 1), np.diff(tokens.first))
    there = np.flatnonzero(np.isin(tokens.kind, (TokenKind.COMMENT, TokenKind.REMARK)))
    for at, line in zip(there.tolist(), line_of[there].tolist(), strict=True):
        text = _decoded(program.data[tokens.start[at] : tokens.start[at + 1]]).strip("(); \r\n")
        of_tools = tool_texts(text)
        for number, own in of_tools.items():
            by_tool[number] = f"{by_tool.get(number, '')}; {own}".strip("; ")
        if not of_tools:
            lines[line] = f"{lines[line]} {text}".strip()
    return tuple(lines), by_tool


def tool_texts(text: str) -> dict[int, str]:
    """Comment on each tool, by its number: up to the next number, or all text before it.

    >>> tool_texts("T1 ROUGHING 16, T2 FINISHING 10")
    {1: 'ROUGHING 16,', 2: 'FINISHING 10'}
    """
    numbers = list(_NUMBER.finditer(text))
    if len(numbers) < 2:
        return {int(found[1]): text for found in numbers}
    ends = [found.start() for found in numbers[1:]] + [len(text)]
    if named_operation(text[: numbers[0].start()]) is None:
        spans = [(found.end(), end) for found, end in zip(numbers, ends, strict=True)]
    else:
        spans = [(0, found.start()) for found in numbers[:-1]] + [(0, len(text))]
    texts: dict[int, str] = {}
    for found, (start, end) in zip(numbers, spans, strict=True):
        number = int(found[1])
        texts[number] = f"{texts.get(number, '')} {text[start:end].strip()}".strip()
    return texts


def _decoded(data: bytes) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return data.decode("latin-1")


CODE = {name: code for code, name in enumerate(OPERATIONS)}
"""Operation -> its number in arrays of rows; -1 is none."""
DESCENDS = float(np.sin(np.radians(0.25)))
"""|dz / ds| from which one that goes down is a ramp."""
THIN, THIN_SHARE = 0.5e-3, 0.1
"""Depth of cut up to which a cut is a finishing one: [m], and as a share of the diameter."""
LEAD = 2.0
"""Length over the diameter up to which a row that is partly in air leads in or out [1]."""
SPOTTING_POINT = 100.0
"""Greatest point angle of spot drills and countersinks that no twist drill has [deg]."""
WHOLE_CONE = 0.98
"""Depth over the height of a drill's cone from which on its full diameter cuts [1]."""
DEEP_HOLE = 3.0
"""Depth of a hole over its diameter from which tables of drills reduce speed and feed [1]
(catalogue source ``deep_holes``)."""
SAME_HOLE = 2e-5
"""Distance up to which drills go down the same hole [m]: rounding of coordinates."""
UNEVEN, UNEVEN_SHARE = 1.5, 0.1
"""Difference of the engaged radius of a drill around its axis from which on it cuts on one side:
cells of the blank [1], and share of its radius [1]; less is not resolved."""
SECTORS = 6
"""A sixth of a turn: the part of it over which that radius is averaged."""


def spots_only(tool: Tool) -> bool:
    """Whether a tool of kind drill has the point of a spot drill or a countersink."""
    return tool.kind == "drill" and tool.point_angle_deg <= SPOTTING_POINT


def fill_from_cut(code: NDArray[np.int8], moves: Moves, cut: Cut, blocks: CutBlocks) -> Bools:
    """Fill in the operations of rows in the material; rows that are thin across alone.

    ``code`` (M,) is filled in; returned are the rows (M,) that count as finishing by their radial
    depth, with a greater axial one.
    """
    row = blocks.row
    slender = np.zeros(len(code), dtype=np.bool_)
    if not len(row):
        return slender
    diameter = np.array([tool.diameter for tool in cut.tools])[blocks.tool]
    kind = np.array([tool.kind for tool in cut.tools])[blocks.tool]
    thin = np.minimum(THIN, THIN_SHARE * diameter)
    fine = np.minimum(blocks.axial_depth, blocks.radial_depth) <= thin
    finishing = np.where(kind == "ball", CODE["ball_finishing"], CODE["finishing"])
    fall = _fall(moves)[row]
    found = np.full(len(row), CODE["roughing"], dtype=np.int8)
    found[blocks.radial_depth >= SLOTTING_IMMERSION * diameter] = CODE["slotting"]
    begins = _begins(moves, cut)
    passes = np.cumsum(begins | (np.diff(moves.feed, prepend=-1.0) != 0)).astype(np.intp)[row]
    mostly = fine | _mostly(fine, passes, moves.length[row])
    found[mostly] = finishing[mostly]
    lead = _leads(moves, cut, blocks, np.cumsum(begins).astype(np.intp)[row])
    found[lead & (found != CODE["ball_finishing"])] = CODE["lead"]
    found[(fall > DESCENDS) & (found != CODE["ball_finishing"])] = CODE["ramping"]
    found[fall >= STEEP] = CODE["plunging"]
    drill, sideways = kind == "drill", np.abs(fall) < STEEP
    found[drill] = np.where(sideways[drill], CODE["chamfering"], CODE["drilling"])
    shallow, deep = (rows[row] & ~sideways for rows in _holes(cut))
    found[deep] = CODE["deep_drilling"]
    found[shallow] = CODE["centre_drilling"]
    code[row] = found
    slender[row] = (found == CODE["finishing"]) & (blocks.axial_depth > thin)
    return slender


def _fall(moves: Moves) -> Floats:
    """Height lost over the length of each row [1]; shape (M,)."""
    return (moves.start[:, 2] - moves.end[:, 2]) / np.maximum(moves.length, 1e-9)


def _moving(moves: Moves) -> Rows:
    return np.flatnonzero((moves.length > 0) | (moves.kind == Kind.RAPID))


def _begins(moves: Moves, cut: Cut) -> Bools:
    """Rows with which another cut begins, or a move that is none; shape (M,)."""
    moving = _moving(moves)
    inside = (cut.tool[moving] >= 0) & (np.abs(_fall(moves)[moving]) < STEEP)
    begins = np.zeros(len(moves), dtype=np.bool_)
    begins[moving] = ~inside | (np.diff(moves.tool[moving], prepend=-2) != 0)
    begins[moving[1:]] |= ~inside[:-1]
    return begins


def _mostly(rows: Bools, passes: Rows, length: Floats) -> Bools:
    """Blocks of a pass of which ``rows`` are at least half, by length."""
    share = np.bincount(passes, rows * length) / np.maximum(np.bincount(passes, length), 1e-12)
    return share[passes] >= 0.5


def _leads(moves: Moves, cut: Cut, blocks: CutBlocks, cuts: Rows) -> Bools:
    """Blocks that lead in or out: the short ends of a cut, partly in air.

    An end is short up to :data:`LEAD` diameters and half of its cut.  A cut that is no longer than
    that altogether is a loop or a pass of its own between two moves in air; beside a rapid or a
    plunge it is a lead too.
    """
    row, length = blocks.row, moves.length[blocks.row] * 1e-3
    longest = LEAD * np.array([tool.diameter for tool in cut.tools])[blocks.tool]
    in_air = length_in_air(cut, blocks)[row] > cut.engagement.resolution
    moving = _moving(moves)
    abrupt = (moves.kind == Kind.RAPID) | (np.abs(_fall(moves)) >= STEEP)
    place = np.searchsorted(moving, row)
    before = np.where(place > 0, abrupt[moving[place - 1]], True)
    after = moving[np.minimum(place + 1, len(moving) - 1)]
    behind = np.where(place + 1 < len(moving), abrupt[after], True)
    first = np.diff(cuts, prepend=-1) != 0
    last = np.diff(cuts, append=-1) != 0
    whole = np.bincount(cuts, length)[cuts]
    end = (first | last) & (length <= whole / 2)
    alone = (first & before) | (last & behind)
    return in_air & (length <= longest) & np.where(whole > longest, end, alone)


def _drilling_stations(cut: Cut) -> Rows:
    engagement = cut.engagement
    drills = np.array([tool.kind == "drill" for tool in cut.tools])[engagement.tool]
    return np.flatnonzero(drills & engagement.feed & (engagement.slope <= -STEEP))


def _holes(cut: Cut) -> tuple[Bools, Bools]:
    """Rows of drills in holes that their full diameter does not reach, and in deep ones; (M,) each.

    A hole is all that drills cut at one place in the plane, with whatever codes and however often:
    it is as deep as from where the first of them met the material down to where the drill's full
    diameter ends at its lowest.
    """
    shallow, deep = np.zeros((2, cut.engagement.blocks), dtype=np.bool_)
    stations = _drilling_stations(cut)
    if not len(stations):
        return shallow, deep
    engagement, pieces, tools = cut.engagement, cut.path.pieces, cut.tools
    piece, tool = engagement.piece[stations], engagement.tool[stations].astype(np.intp)
    places = np.rint(pieces.end[piece, :2] / SAME_HOLE)
    hole = np.unique(places, axis=0, return_inverse=True)[1].ravel()
    begin = pieces.start[piece, 2] + engagement.slope[stations] * engagement.along[stations]
    end = begin + engagement.slope[stations] * engagement.length[stations]
    top, bottom = np.full(hole.max() + 1, -np.inf), np.full((hole.max() + 1, len(tools)), np.inf)
    reach = np.zeros(bottom.shape)
    np.maximum.at(top, hole, begin)
    np.minimum.at(bottom, (hole, tool), end)
    np.maximum.at(reach, (hole, tool), engagement.axial_depth[stations])
    cone = np.array([one.radius / np.tan(one.point_angle / 2) for one in tools])[tool]
    diameter = np.array([one.diameter for one in tools])[tool]
    spots = np.array([spots_only(one) for one in tools])[tool]
    row, depth = engagement.block[stations], top[hole] - bottom[hole, tool] - cone
    shallow[row[spots | (reach[hole, tool] < WHOLE_CONE * cone)]] = True
    deep[row[depth >= DEEP_HOLE * diameter - SAME_HOLE]] = True
    return shallow, deep


def drills_on_one_side(cut: Cut) -> Bools:
    """Rows (M,) in which a drill cuts more on one side: over a slot, on a slope, at an edge."""
    uneven = np.zeros(cut.engagement.blocks, dtype=np.bool_)
    stations = _drilling_stations(cut)
    engagement = cut.engagement
    height = np.maximum(engagement.upper[stations] - engagement.lower[stations], 0.0)
    if not len(stations):
        return uneven
    resolved = np.array([
        max(UNEVEN * engagement.resolution, UNEVEN_SHARE * tool.radius)
        / np.tan(tool.point_angle / 2)
        for tool in cut.tools
    ])[engagement.tool[stations]]  # fmt: skip
    width = height.shape[1] // SECTORS
    sums = np.cumsum(np.pad(height, ((0, 0), (1, width)), mode="wrap")[:, 1:], axis=1)
    sector = (sums[:, width:] - sums[:, :-width]) / width
    least = np.maximum(resolved, UNEVEN_SHARE * height.max(axis=1))  # a flat end has no cone
    uneven[engagement.block[stations[np.ptp(sector, axis=1) > least]]] = True
    return uneven


def length_in_air(cut: Cut, blocks: CutBlocks) -> Floats:
    """Length of each row that cuts nothing at feed [m]; shape (M,)."""
    length = cut.plan.path.moves.length * 1e-3
    inside = np.zeros(len(length))
    time = blocks.air + blocks.seconds
    inside[blocks.row] = np.divide(blocks.seconds, time, out=np.zeros(len(time)), where=time > 0)
    return length * (1 - inside)


def long_in_air(cut: Cut, blocks: CutBlocks) -> Bools:
    """Rows that leave the cut for more than a lead-out; shape (M,)."""
    diameter = np.array([tool.diameter for tool in cut.tools] or [0.0])
    return length_in_air(cut, blocks) > LEAD * diameter[cut.tool]
