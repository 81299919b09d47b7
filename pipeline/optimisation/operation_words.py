"""Operations named in comments and tool names, in English, German, French, Italian and Spanish.

The operation that allows least counts: FINISH FACE MILL is finishing.  A name that directly follows
LEAVE, NEAR, BEFORE, AFTER or WITHOUT does not count, one that directly follows FOR, or the others
and a size, only where nothing else is named: ROUGH, LEAVE 0.25 FOR FINISH is roughing.  Farther
from them it counts: AFTER FLIP FINISH is finishing.  A TAP DRILL is a drill, and BORE and
COUNTERBORE are holes beside ROUGH, POCKET or CONTOUR.
"""

import re
import unicodedata
from functools import lru_cache

import numpy as np

from pipeline.cutting.catalogue import Operation
from pipeline.gcode.program import Program, TokenKind

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
