"""Feed axes: servo loops, motor and inverter, drive train, friction of the guideway.

Two models.  The servo drive is a P position and a PI velocity loop (``servo``) around one mass on a
screw (``feed_drive``, ``friction``); ``drive_step`` holds it compiled, for many parameter sets
one after another.  The three-loop drive (``three_loop``) goes down to the currents:
position, speed (PI or fuzzy PI) and current ``loops``, inverter and synchronous ``motor``, two
masses on a twisting shaft (``drive_train``); ``speed_trial`` compares its speed loops.  Positions
along the axis at the carriage or the encoder; SI units.  Sources: Sim2023, Feed2025.
"""

__all__ = [
    "drive_step",
    "drive_train",
    "feed_drive",
    "friction",
    "loops",
    "motor",
    "presliding",
    "servo",
    "speed_trial",
    "three_loop",
    "three_loop_axis",
]
