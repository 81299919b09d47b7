"""What comments and names of tools mean to a machinist, in English and German."""

import pytest

from pipeline.gcode.program import parse_program
from pipeline.optimisation.operation_signs import (
    READ_OTHERWISE,
    WORDS,
    comments_of,
    named_operation,
    says_roughing,
    tool_texts,
)
from pipeline.optimisation.operations import KEPT
from pipeline.optimisation.practice import RULES, Rule

MEANT = {
    "centre_drilling": (
        "10MM NC-ANBOHRER 90", "ANBOHREN D5", "SPOT", "SPOT DRILL 90DEG", "1/2 SPOTDRILL",
        "CENTER DRILL #3", "CENTRE-DRILL", "ZENTRIERBOHRER A2.5", "SPOT_DRILL_10", "C/DRILL",
        "SPOT FOR M8 TAP", "#3 CTR DRILL", "CNTR DRILL", "S/DRILL",
    ),
    "countersinking": (
        "16MM COUNTERSINK 90", "CSK 90", "KEGELSENKER 20MM", "SENKEN M8", "C'SINK", "VERSENKEN",
    ),
    "counterboring": (
        "COUNTERBORE 11", "C-BORE M6", "SPOTFACE D20", "20MM BACK SPOTFACER", "FLACHSENKER 15",
        "BACK FACE D20 AT THE BORES", "PLANSENKEN",
    ),
    "chamfering": (
        "8MM 90DEG FASENFRAESER", "FASENFR\xc4SER 45", "KANTEN BRECHEN 0.5", "EDGE BREAK 0.2",
        "BREAK EDGES", "BREAK ALL SHARP EDGES", "CHAMFER MILL", "DEBURR", "FASE 1X45", "ENTGRATEN",
        "FINISH CHAMFER", "CHANFREIN",
    ),
    "engraving": ("BESCHRIFTUNG", "LETTERING", "TEXT", "ENGRAVE S/N", "60DEG ENGRAVER"),
    "finishing": (
        "FINISH FACE MILL 1.0 DEEP", "FACING, FINISH", "FINISH WALL AFTER DRILLING", "SPRING PASS",
        "VORSCHLICHTEN", "SEMI-FINISH WALLS", "3D SEMI, LEAVES 0.1", "SCHLICHTEN KONTUR",
        "10MM SCHLICHTFRAESER 4Z", "ROUGH AND FINISH WALLS", "AFTER ROUGHING FINISH FLOOR",
        "NACH DEM BOHREN SCHLICHTEN", "SLOT FINISH", "ENDMILL FOR FINISHING", "FERTIGFRAESEN",
        "PROFILE OUTSIDE FINISH, ARC IN AND OUT", "FINISH_WALLS",
        "NACH UMSPANNEN SCHLICHTEN", "CLEAR NEAR CLAMP FINISH", "LEAVE 0.2 ON WALL FINISH FLOOR",
        "AFTER M01 FINISH POCKET", "ZUM SCHLUSS SCHLICHTEN TASCHE", "LEAVE 0.2 FINISH FLOOR",
        "LEAVE FINISH STOCK 0.2 FINISH WALL",
    ),
    "drilling": (
        "6.8 TAP DRILL", "6.8MM TAP DRILL CARBIDE", "DRILL FOR REAMER", "DRILL FOR M8 TAP",
        "KERNLOCH M8", "KERNLOCHBOHRER 6,8", "CORE HOLE G1/4", "PILOT HOLE", "BOHRER 8.5",
        "LETTER F DRILL .257", "BOHREN VOR DEM REIBEN", "F\xdcR REIBAHLE BOHREN",
        "DRILL 8.5 BEFORE TAPPING", "GEWINDEKERNLOCH BOHREN",
        "6.8 DRILL M8 TAP", "6.8MM DRILL M8X1.25 TAP", "#7 DRILL (1/4-20 TAP)",
        "DRILL BEFORE M8 TAP", "DRILL FOR A 1/4-20 TAP",
    ),
    "deep_drilling": ("DEEP HOLE DRILL", "TIEFLOCHBOHRER", "GUNDRILL", "PECK DRILL"),
    "tapping": (
        "M8 HSS-E TAP", "TAP M8", "M8 FORM TAP", "GEWINDEFORMER M6", "GEWINDEBOHRER M10",
        "DRILL AND TAP M6", "TAPPING AFTER DRILLING", "M8 TAP", "6.8 DRILL, M8 TAP",
    ),
    "thread_milling": ("THREAD MILL", "12MM THREAD-MILL", "GEWINDEFRAESER M20"),
    "reaming": ("10H7 REAMER", "REAM", "REIBAHLE 10H7", "REIBEN", "DRILL AND REAM",
                "NACH HAERTEN REIBEN", "OHNE KUEHLUNG REIBEN", "AFTER FLIP REAM 10H7",
                "AFTER FLIP FOR REAM"),
    "boring": ("ROUGH BORING", "40H7 FINE BORING HEAD", "AUSDREHEN", "AUSSPINDELN", "BORE 40H7",
               "FERTIGBOHREN 40H7"),
    "probing": ("PROBE G54", "MESSTASTER", "PROBING CYCLE", "ANTASTEN"),
    "face_milling": ("50MM FACE MILL R390", "FACING", "PLANFRAESEN", "MESSERKOPF 63"),
    "roughing": (
        "ROUGH, LEAVE 0.25 FOR FINISH", "ROUGH POCKET BORE 40", "CONTOUR NEAR PROBE",
        "HELICAL ROUGH OF THE BORES D38", "SCHRUPPEN NUT", "SLOT 12 WIDE", "SLOT DRILL 10",
        "SCHRUPPEN, SCHLICHTAUFMASS 0.3", "ADAPTIVE ROUGHING OPTILOAD .055", "TASCHE 20X30",
        "POCKET BEFORE REAMING", "SCHRUPPEN AUFMASS 0,3 SCHLICHTEN", "MILL POCKET COUNTERBORE",
        "ROUGH, LEAVE .010 STOCK FOR FINISH", "ROUGH AFTER THE 1. FINISH",
    ),
    None: (
        "16MM ENDMILL 4Z", "20MM SCHAFTFRAESER 4Z", "TOP OF THE FINISHED PART", "BOHRUNG 8",
        "HOUSING OP10 GJL-250 WITHOUT BORING", "LEAVE 0.25 FOR FINISH", "SENKRECHT", "TAPPED HOLES",
        "SLOT WALLS", "OVER THE CLAMP",
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("text", "operation"), [(text, name) for name, texts in MEANT.items() for text in texts]
)
def test_a_text_names_what_a_machinist_reads(text: str, operation: str | None) -> None:
    assert named_operation(text) == operation
    assert named_operation(text.lower()) == operation


def test_a_rule_of_dashes_is_read_at_once() -> None:
    """What lies between a word and an operation has one reading."""
    assert named_operation("AFTER " + "-" * 5000 + "1-2," * 5000 + " FINISH") == "finishing"


def test_words_that_allow_less_stand_first() -> None:
    """Rules by how much they leave free: kept, no more of both, no more of F, free."""

    def freedom(rule: Rule) -> tuple[bool, bool, bool]:
        return rule.feed != "keep", rule.speed == "free", rule.feed == "free"

    rules = [freedom(RULES.get(name, Rule())) for name, _ in WORDS]
    assert rules == sorted(rules)
    assert {name for name, rule in RULES.items() if rule.feed == "keep"} == set(KEPT)
    assert all(name is None or name in dict(WORDS) for name, _ in READ_OTHERWISE)


@pytest.mark.parametrize(("text", "rough"), [
    ("ROUGH SIDE MILL, LEAVE 0.25 FOR FINISH", True), ("SCHRUPPEN", True), ("TROCHOIDAL", True),
    ("POCKET", False), ("ROUGH AND FINISH", False), ("CONTOUR AFTER ROUGHING", False),
])  # fmt: skip
def test_a_text_says_roughing_or_only_names_a_section(text: str, rough: bool) -> None:
    assert says_roughing(text) is rough


@pytest.mark.parametrize(("text", "texts"), [
    ("T1|50MM FACE MILL|H1", {1: "T1|50MM FACE MILL|H1"}),
    ("T1 ROUGHING 16MM 4Z, T2 FINISHING 10MM 4Z", {1: "ROUGHING 16MM 4Z,", 2: "FINISHING 10MM 4Z"}),
    ("TOOLS: T01 DRILL 8, T02 TAP M10, T3 CSK", {1: "DRILL 8,", 2: "TAP M10,", 3: "CSK"}),
    ("WERKZEUG 4 REIBAHLE", {4: "WERKZEUG 4 REIBAHLE"}),
    ("PART 2", {}),
])  # fmt: skip
def test_each_number_of_a_tool_has_the_text_up_to_the_next(
    text: str, texts: dict[int, str]
) -> None:
    assert tool_texts(text) == texts


def test_tools_behind_their_words_are_at_least_what_they_are_called() -> None:
    found = tool_texts("ROUGHER IS T1, FINISHER IS T2")
    assert [named_operation(found[number]) for number in (1, 2)] == ["roughing", "finishing"]


@pytest.mark.parametrize("encoding", ["utf-8", "latin-1"])
def test_umlauts_are_read_however_they_are_written(encoding: str) -> None:
    program = parse_program(
        "(FASENFR\xc4SER)\nG1 X1 (T3 R\xdcCKW\xc4RTSSENKER)\n".encode(encoding), "P.nc"
    )
    lines, tools = comments_of(program)
    assert lines[1] == "FASENFR\xc4SER" and tools == {3: "T3 R\xdcCKW\xc4RTSSENKER"}
    assert named_operation(tools[3]) == "counterboring"
