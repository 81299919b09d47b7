"""Modal groups: which G and M codes shut each other out, and when a block carries them out.

G codes are kept ten times their number (G54.1 is 541).  Sources: ISO 6983-1; Fanuc 0i-F operator's
manual B-64694EN (group numbers of machining centres); LinuxCNC 2.9 "G-code overview", tables of
modal groups and "order of execution".
"""

from dataclasses import dataclass

BOTH = frozenset({"fanuc", "linuxcnc", "siemens"})
FANUC_ONLY = frozenset({"fanuc"})
LINUXCNC_ONLY = frozenset({"linuxcnc"})
SIEMENS_ONLY = frozenset({"siemens"})


@dataclass(frozen=True, kw_only=True)
class Group:
    """Codes of which one is in force.

    Parameters
    ----------
    codes : tuple of int
        Ten times the G code.
    step : int
        When a block carries them out, small first: LinuxCNC's order, which is Fanuc's too where the
        order matters.
    default : int
        In force when the control is switched on; 0 in groups without one is G0.
    dialects : frozenset of str
        That have the group.
    """

    codes: tuple[int, ...]
    step: int
    default: int | None = None
    dialects: frozenset[str] = BOTH


GROUPS: dict[str, Group] = {
    "units": Group(codes=(200, 210), step=5, default=210),
    "units of Siemens": Group(codes=(700, 710), step=5, default=710, dialects=SIEMENS_ONLY),
    "feed_mode": Group(codes=(930, 940, 950), step=10, default=940),
    "spindle_mode": Group(codes=(960, 970), step=25, default=970),
    "plane": Group(codes=(170, 180, 190), step=130, default=170),
    "diameter": Group(codes=(70, 80), step=140, default=80, dialects=LINUXCNC_ONLY),
    "compensation": Group(codes=(400, 410, 411, 420, 421), step=150, default=400),
    "length": Group(codes=(430, 431, 432, 440, 490), step=160, default=490),
    "wcs": Group(
        codes=(540, 541, 550, 560, 570, 580, 590, 591, 592, 593, 5000), step=170, default=540
    ),
    "path": Group(codes=(610, 611, 620, 630, 640), step=180, default=640),
    "distance": Group(codes=(900, 910), step=120, default=900),
    "arc_distance": Group(codes=(901, 911), step=120, default=911),
    "retract": Group(codes=(980, 990), step=200, default=980),
    "polar": Group(codes=(150, 160), step=202, default=150, dialects=FANUC_ONLY),
    "scaling": Group(codes=(500, 510), step=204, default=500, dialects=FANUC_ONLY),
    "mirror": Group(codes=(501, 511), step=204, default=501, dialects=FANUC_ONLY),
    "rotation": Group(codes=(680, 690), step=206, default=690, dialects=FANUC_ONLY),
    "modal_macro": Group(codes=(660, 661, 670), step=300, default=670, dialects=FANUC_ONLY),
    "cycle": Group(
        codes=(730, 740, 760, 800, 810, 820, 830, 840, 850, 860, 870, 880, 890),
        step=220,
        default=800,
    ),
    "motion": Group(
        codes=(0, 10, 20, 30, 330, 331, 382, 383, 384, 385), step=220, default=0
    ),
}  # fmt: skip
"""Name -> group.  ``cycle`` and ``motion`` are one group in LinuxCNC, groups 9 and 1 in Fanuc."""

ONE_SHOT: dict[int, tuple[int, frozenset[str]]] = {
    40: (110, BOTH),
    80: (195, FANUC_ONLY),
    51: (195, FANUC_ONLY),
    50: (195, FANUC_ONLY),
    90: (185, BOTH),
    100: (210, BOTH),
    110: (210, FANUC_ONLY),
    270: (210, FANUC_ONLY),
    280: (210, BOTH),
    281: (210, LINUXCNC_ONLY),
    300: (210, BOTH),
    301: (210, LINUXCNC_ONLY),
    310: (220, FANUC_ONLY),
    520: (210, BOTH),
    530: (215, BOTH),
    600: (185, FANUC_ONLY),
    650: (300, FANUC_ONLY),
    920: (210, BOTH),
    921: (210, BOTH),
    922: (210, LINUXCNC_ONLY),
    923: (210, LINUXCNC_ONLY),
}
"""G code of one block only (group 0) -> when it is carried out, who has it."""

WORD_STEPS = {"F": 20, "S": 30, "T": 40, "D": 149, "H": 159}
"""Words with a meaning of their own -> when they are carried out."""

M_STEPS: dict[str, dict[int, int]] = {
    "linuxcnc": {
        6: 50, 61: 50, 3: 70, 4: 70, 5: 70, 19: 70, 70: 75, 71: 75, 72: 75, 73: 75, 7: 80, 8: 80,
        9: 80, 0: 400, 1: 400, 2: 400, 30: 400, 60: 400, 99: 400,
    },
    "fanuc": {
        3: 70, 4: 70, 13: 70, 14: 70, 7: 80, 8: 80, 29: 80, 19: 310, 5: 320, 9: 330, 6: 340,
        0: 400, 1: 400, 2: 410, 30: 410, 98: 420, 198: 420, 99: 430,
    },
    "siemens": {
        6: 50, 3: 70, 4: 70, 7: 80, 8: 80, 5: 320, 9: 330, 0: 400, 1: 400, 2: 410, 30: 410, 17: 410,
    },
}  # fmt: skip
"""M code -> when it is carried out: on a Fanuc what starts comes before the motion, what ends after
(M6 too, as posts write ``G91 G28 Z0 M6``)."""
OTHER_M_STEP = {"linuxcnc": 90, "fanuc": 350, "siemens": 350}

M_GROUPS: dict[int, str] = {
    **dict.fromkeys((0, 1, 2, 30, 60), "stop"),
    **dict.fromkeys((6, 61), "tool change"),
    **dict.fromkeys((3, 4, 5, 19), "spindle"),
    **dict.fromkeys((7, 8, 9), "coolant"),
    **dict.fromkeys((48, 49), "overrides"),
}
"""M code -> group of which LinuxCNC takes one a block."""

GROUP_OF: dict[int, str] = {code: name for name, group in GROUPS.items() for code in group.codes}


def g_code(code: int) -> str:
    """``G54.1`` for 541."""
    return f"G{code // 10}" if code % 10 == 0 else f"G{code // 10}.{code % 10}"


def step_of(code: int, dialect: str) -> int | None:
    """When ``dialect`` carries out a G code; None where it does not know the code."""
    if code in ONE_SHOT:
        step, dialects = ONE_SHOT[code]
        if dialect in dialects:
            return step
    if code == CANCEL:
        return GROUPS["cycle"].step - 1
    group = GROUPS.get(GROUP_OF.get(code, ""))
    if group is None or dialect not in group.dialects:
        return None
    return group.step


def excludes(first: int, second: int) -> bool:
    """Whether LinuxCNC refuses both in a block: of one group, or both want axis words."""
    names = {GROUP_OF.get(first), GROUP_OF.get(second)}
    if CANCEL in (first, second) and first != second:
        return False  # G80 G0 is no conflict: the motion is what stays in force
    if len(names) == 1 and names != {None}:
        return True
    moves = names & {"cycle", "motion"}
    if len(moves) == 2:
        return True
    return bool({first, second} & AXIS_TAKERS) and (bool(moves) or {first, second} <= AXIS_TAKERS)


CANCEL = 800
AXIS_TAKERS = frozenset({100, 280, 300, 520, 920})
"""Codes of one block that take the axis words for themselves."""
