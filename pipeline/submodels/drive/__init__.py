"""Feed drives: friction, moving mass and loops of each axis, identified from records of its servo.

An axis is one mass on a screw, M a + F_f(v) + F_g = k A, under a cascade of position and velocity
loop (Sim2023); positions in metres at the encoder, forces in newtons at the carriage, or in the
command's unit where the force constant is not listed.  ``feed_drive`` holds the mechanics by
regression on filtered motion and force (Gautier, Vandanjon and Presse 1994), ``servo_fit`` the
loops by their control law, ``motor`` resistance, inductances and flux of a synchronous motor.
"""

__all__ = ["feed_drive", "motor", "servo_fit", "submodel"]
