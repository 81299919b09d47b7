"""Feed axes: servo loops, motor and inverter, drive train, friction of the guideway.

Two models.  The servo drive (``drive``, its parameters in ``drive_parameters``) is a P position and
a PI velocity loop around one mass on a screw with friction.  The three-loop drive (``three_loop``)
goes down to the currents: position, speed (PI or fuzzy PI) and current ``loops``, inverter and
synchronous ``motor``, two masses on a twisting shaft (``drive_train``).  Positions along the axis
at the carriage or the encoder; SI units.  Sources: Sim2023, Feed2025.
"""

__all__ = ["drive", "drive_parameters", "drive_train", "loops", "motor", "three_loop"]
