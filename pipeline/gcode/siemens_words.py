"""Words of the Sinumerik 840D: what they are in ISO 6983, or that they move nothing.

Source: Sinumerik 840D sl, Programming Manual Fundamentals and Job Planning.
"""

G_CODES = frozenset(
    (0, 1, 2, 3, 4, 9, 17, 18, 19, 40, 41, 42, 53, 54, 55, 56, 57, 64, 70, 71, 90, 91, 93, 94, 95,
     96, 97, 500)
)  # fmt: skip
"""Those that mean here what they mean to the interpreter."""
FOREIGN_M = frozenset((98, 99, 198))
"""Subprograms of other controls."""
SAME_AS: dict[float, int] = {
    60: 61,  # exact stop, modal
    641: 64,
    642: 64,
    643: 64,
    644: 64,
    645: 64,
    700: 70,
    710: 71,
}
"""G code -> the one that does the same to the path here: 641 to 645 round corners in other ways."""

WITHOUT_MOTION: dict[str, str] = {
    "BRISK": "acceleration in steps",
    "COMPCAD": "compressor on",
    "COMPCURV": "compressor on",
    "COMPOF": "compressor off",
    "COMPON": "compressor on",
    "DRIVE": "acceleration that falls with speed",
    "DYNFINISH": "dynamics for finishing",
    "DYNNORM": "normal dynamics",
    "DYNPOS": "dynamics for positioning",
    "DYNROUGH": "dynamics for roughing",
    "DYNSEMIFIN": "dynamics for semi-finishing",
    "FFWOF": "feed-forward control off",
    "FFWON": "feed-forward control on",
    "FNORM": "feed as F says, constant in a block",
    "G601": "exact stop fine",
    "G602": "exact stop coarse",
    "G603": "exact stop at the end of interpolation",
    "SOFT": "acceleration with limited jerk",
}
"""Word -> what it sets; where the path goes does not depend on it."""

AXES = frozenset("XYZABC")
LETTERS = frozenset("ABCFIJKMSXYZ")
"""Addresses whose value is passed on as it stands; H would be a function of the machine builder."""
TYPES = frozenset({"REAL", "INT", "BOOL"})
CALLS: dict[str, str] = {
    "CYCLE800": "swivelling by CYCLE800 needs the machine's dimensions: post the turned plane with "
    "TRAORI and AROT",
    "": "this cycle or function is not known in the dialect siemens: post it as single moves",
}
"""Why a call is refused."""
