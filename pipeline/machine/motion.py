"""The words of a plan: how a row moves, what bounds it, what halts it."""

from enum import IntEnum


class Motion(IntEnum):
    """How a row moves."""

    STILL = 0
    RAPID = 1
    CUTTING = 2
    PER_TURN = 3  # cutting, its feed bound to the spindle
    INDEPENDENT = 4  # a rapid whose axes each go as fast as they can


class Binding(IntEnum):
    """What keeps a row from being faster."""

    NOTHING = 0  # it does not move
    FEED = 1
    RAPID = 2  # the speed of rapids, by the override
    AXIS_SPEED = 3
    ARC = 4  # centripetal acceleration
    CURVE = 5  # the corners of a curve made of chords
    TOLERANCE = 6
    CORNER = 7  # the jump of speed at one of its ends
    EXACT_STOP = 8  # a standstill at one of its ends
    ACCELERATION = 9  # too short to reach its speed from that of its neighbours


class Halt(IntEnum):
    """What a row asks of the motion before it."""

    NONE = 0
    STOPS = 1  # a standstill
