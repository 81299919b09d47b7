"""Errors of part programs, with the place and the remedy, and files that are no program of a mill.

A foreign file is recognised by its first bytes, a control by the head of its programs.  In a
lathe's program X is a diameter, F is mm/rev under G99, G50 S bounds the speed under G96, G70 to G76
turn: such signs are counted over its first lines.  Sources: Fanuc 0i-T operator's manual, G-code
system A; Okuma OSP, Philips/Maho 432, Fagor 8055 and Heidenhain programming manuals.
"""

import re
import unicodedata
from collections.abc import Callable

NO_BLOCK = "{} holds no block that the control carries out: name a part program"
"""Refusal of a program that moves nothing, by its name."""


class GcodeError(ValueError):
    """A word that cannot be interpreted: its place, the reason and the remedy.

    Line and column of the word count from 1; 0 where there is none.
    """

    def __init__(self, file: str, line: int, column: int, word: str, reason: str) -> None:
        self.file, self.line, self.column = file, line, column
        self.word, self.reason = word, reason
        super().__init__(f"{file}:{line}:{column}: {word}: {reason}")


ALIKE = dict(
    zip("АВЕКМНОРСТХУІЈЅΑΒΕΖΗΙΚΜΝΟΡΤΥΧаеосрхуіј",
        "ABEKMHOPCTXYIJSABEZHIKMNOPTYXaeocpxyij", strict=True)
)  # fmt: skip
"""Cyrillic and Greek letters -> the Latin letter that they look like."""


def strange_character(text: str, at: int) -> str:
    """Name of a character that is not ASCII at a place of a line; empty where it is ASCII."""
    raw = text[at : at + 4].encode("latin-1", "replace")
    if not raw or raw[0] < 0x80:
        return ""
    length = next((n for n in (2, 3, 4) if _decoded(raw[:n], "utf-8")), 0)
    sign = _decoded(raw[:length], "utf-8") if length else _decoded(raw[:1], "cp1252")
    if not sign:
        return f"byte 0x{raw[0]:02X} has no meaning in a program: retype what stands here"
    name = f"U+{ord(sign):04X} ({unicodedata.name(sign, 'no name')})"
    dash = unicodedata.category(sign) == "Pd" or sign == "\u2212"
    plain = "-" if dash else ALIKE.get(sign, unicodedata.normalize("NFKC", sign))
    if plain.isascii() and plain.strip():
        words = "the minus sign -" if dash else plain
        return f"{name} stands for {words}: type {plain} instead"
    return f"{name} has no meaning in a program: retype what stands here"


def _decoded(raw: bytes, encoding: str) -> str:
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        return ""
    return text if len(text) == 1 else ""


ErrorAt = Callable[[str], GcodeError]
"""Error about one place, from its reason."""


HEAD = 100_000
"""Bytes of a program in which signs are looked for."""
POST = "post it for a Fanuc, LinuxCNC or Siemens mill"
FOREIGN: dict[str, tuple[re.Pattern[bytes], str]] = {
    name: (re.compile(rb"\A(?:%b)" % head if remedy else head, re.I | re.M), remedy)
    for name, head, remedy in (
        ("text in UTF-32", rb"\xff\xfe\x00\x00|\x00\x00\xfe\xff", "save it as UTF-8 or ASCII"),
        ("text in UTF-16", rb"\xff\xfe|\xfe\xff", "save it as UTF-8 or ASCII"),
        ("packed by gzip", rb"\x1f\x8b", "unpack it"),
        ("a ZIP archive", rb"PK\x03\x04|PK\x05\x06", "unpack it"),
        ("packed", rb"BZh\d1AY|\xfd7zXZ|7z\xbc\xaf|Rar!\x1a|\x28\xb5\x2f\xfd", "unpack it"),
        ("a PDF", rb"%PDF-", "name a part program"),
        ("an Office document", rb"\xd0\xcf\x11\xe0|\{\\rtf", "save it as plain text"),
        ("a picture", rb"\x89PNG|\xff\xd8\xff|GIF8|BM[\x00-\xff]{4}\x00{4}", "name a part program"),
        ("a DXF drawing", rb"\s*(?:999\s*\n[^\n]*\n\s*)*0\s*\r?\nSECTION|AutoCAD Binary DXF",
         "make a part program of it in a CAM system"),
        ("a DWG drawing", rb"AC10\d\d\x00", "make a part program of it in a CAM system"),
        ("a STEP file", rb"\s*ISO-10303-21", "make a part program of it in a CAM system"),
        ("an STL file", rb"solid\s[^\n]*\n\s*facet", "make a part program of it in a CAM system"),
        ("XML or HTML", rb"(?:\xef\xbb\xbf)?\s*<(?:\?xml|!DOC|html|svg)", "name a part program"),
        ("JSON", rb"\s*\{\s*\"", "name a part program"),
        ("plotter code (HPGL)", rb"\s*(?:\x1b[^\n]{0,9})?IN\s*;", "name a part program"),
        ("a Heidenhain conversational", rb"\A\s*(?:\d+\s+)?BEGIN\s+PGM\b", ""),
        ("a Heidenhain ISO", rb"\A\s*%\w+\s+G7[01]\s*\*", ""),
        ("an Okuma OSP",
         rb"\A\s*\$[\w.-]+%|^\s*(?:N\w+\s+)?(?:NOEX\b|CALL\s+O\w+|V[CZ]\w*\s*(?:\[\w+\]\s*)?=(?!=)"
         rb"|MODIN\b|MODOUT\b|DEF\s+WORK\b)|^(?![^\n]*G4[34])[^(\n]*\bG15\s*H\d", ""),
        ("a Mazatrol",
         rb"\A[^(\n]{0,300}\bMAZATROL\b|^\s*UNo\.?\s+(?:UNIT|MAT)\b|^\s*UNIT\s+UNO\b", ""),
        ("a Philips or Maho", rb"\A\s*%?PM\s*(?:\r?\n|\*)?\s*N9\d{3}|\A\s*%PM\b", ""),
        ("a Fagor", rb"\A\s*%[\w .-]{1,24},\s*[MX]{1,2}-?\s*,", ""),
    )
}  # fmt: skip
"""Kind of file -> its head, and the remedy; control -> lines of its programs, and no remedy."""
TEXT = re.compile(rb"[^\x00\t\n\v\f\r\x11-\x14\x1a\x1b -~\x7f-\xff]|[\x80-\x9f\xa0-\xff]")
"""Bytes that text of a program seldom holds."""
BINARY_SHARE, SAMPLE = 0.3, 4000


def refuse_foreign(data: bytes, file: str, dialect: str) -> None:
    """Refuse files that are no program of a mill with a GcodeError that names them."""
    head = data[:HEAD]
    for name, (pattern, remedy) in FOREIGN.items():
        found = pattern.search(head)
        if found is None or (dialect == "siemens" and name == "an Okuma OSP"):
            continue
        if remedy:
            reason = f"this is {name}, no part program: {remedy}"
            raise GcodeError(file, 1, 1, "file", reason)
        where = _place(head, found.end() - len(found[0].lstrip()))
        reason = f"this is {name} program, which is not followed: {POST}"
        raise GcodeError(file, *where, "program", reason)
    sample = head[:SAMPLE]
    if len(TEXT.findall(sample)) > BINARY_SHARE * max(len(sample), 1):
        reason = "this holds binary data (packed, encrypted, or of another system): name its text"
        raise GcodeError(file, 1, 1, "file", reason)
    _refuse_lathe(file, head, dialect)


def _place(head: bytes, at: int) -> tuple[int, int]:
    """Line and column of a byte, counting from 1."""
    return head.count(b"\n", 0, at) + 1, at - head.rfind(b"\n", 0, at)


_REMARKS = re.compile(rb";[^\n]*|\bG0*4(?!\d)[^\n]*")
_IGNORED = re.compile(
    rb"\([^)\n]*\)|;[^\n]*|^[^\n]*\bG0*6[56](?!\d)[^\n]*|\bG0*4(?!\d)[^\n]*", re.M
)
"""Comments, arguments of macros and dwells, whose letters mean other things."""


def _words(pattern: bytes) -> re.Pattern[bytes]:
    return re.compile(pattern, re.I | re.M)


TURNING = {
    "fanuc": _words(
        # contours by P and Q, their first blocks, threads, whose letters no mill's cycle has
        rb"\bG7[0-3](?=[^\n]*P\d+)(?=[^\n]*Q\d+)(?![^\n]*[RIL][-.\d])[^\n]*"
        rb"|\bG7[1-4](?=[^\n]*[UW][-+.\d])[^\n]*|\bG76(?=\s*P\d{5,6}\b)[^\n]*"
        rb"|\bG7[68](?=[^\n]*X)(?=[^\n]*P\d{3})(?=[^\n]*Q\d)(?![^\n]*R[-.\d])[^\n]*"
        rb"|\bG32(?=[^\n]*[XZUW])(?=[^\n]*F)[^\n]*"
    ),
    "siemens": _words(
        rb"\b(?:DIAMON|DIAM90|DIAMCYCOF)\b|\bCYCLE9(?:[3-9]|30|40|5[012])\s*\(|\bG33(?!\d)(?=[^\n]*[XZ])"
    ),
    "linuxcnc": _words(rb"(?!)"),
}
"""Signs of a lathe's program alone, by dialect."""
SIGNS = {
    "a limit of speed (G50 S or G92 S)": _words(
        rb"\bG(?:50|92)(?![.\d])(?![^\n]*[XYZ][-.\d])(?=[^\n]*S\d)|\bLIMS\s*="
    ),
    "constant surface speed (G96)": _words(rb"G96(?![.\d])"),
    "a turret's tool (T0101)": _words(rb"\bT\d{1,2}\d\d(?![.\d])"),
    "increments by U and W": _words(rb"(?:\b|(?<=[\d.]))[UW]\s*[-+]?[.\d]"),
    "feed per revolution (G99 without a cycle)": _words(rb"G99(?![.\d])"),
    "a feed below 1 a minute": _words(rb"F0?\.\d"),
}
"""Signs that a mill's program may have too, one of them."""
_CYCLE = _words(rb"G(?:7[346]|8[1-9])(?![.\d])")
_CHANGE = _words(rb"M0*6(?!\d)")
_PER_REVOLUTION = _words(rb"G9[35](?![.\d])")
_ACROSS = _words(rb"(?:\b|(?<=[\d.]))Y\s*=?[-+.\d#\[]")


def _signs(code: bytes) -> dict[str, re.Match[bytes]]:
    found = {name: match for name, one in SIGNS.items() if (match := one.search(code))}
    if _CYCLE.search(code):
        found.pop("feed per revolution (G99 without a cycle)", None)
    if _CHANGE.search(code):
        found.pop("a turret's tool (T0101)", None)
    if _PER_REVOLUTION.search(code):
        found.pop("a feed below 1 a minute", None)
    return found


def _refuse_lathe(name: str, head: bytes, dialect: str) -> None:
    """Refuse a lathe's program: two signs where nothing moves in Y, three where something does."""
    ignored = _REMARKS if dialect == "siemens" else _IGNORED
    code = ignored.sub(lambda found: b" " * len(found[0]), head)
    certain = TURNING[dialect].search(code)
    signs = {} if dialect == "linuxcnc" else _signs(code)
    few = len(signs) < (3 if _ACROSS.search(code) else 2)
    if certain is None and few:
        return
    first = certain or min(signs.values(), key=lambda found: found.start())
    line, column = _place(head, first.start())
    told = "" if few else f" ({', '.join(signs)})"
    raise GcodeError(
        name, line, column, first[0].decode("latin-1").strip()[:40] or "block",
        f"this is a lathe's program{told}, which is not followed: X would be taken for a radius "
        "and F for feed per minute; name a mill's program",
    )  # fmt: skip
