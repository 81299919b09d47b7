"""Columns of a cut's rows and of a spindle's drive as the compiled evaluation takes them.

Way [m] and teeth / 60; scale and exponent of the load table; wear a second of motion, at which
speed [rev/min] and feed for each tooth [m], and the exponents of both; price of a life; share of
the row in the material; power that is always on, and that of the drives while axes move [W]; least
and greatest feed for each tooth [m], F [mm/min], S [rev/min]; [mm/min] in one unit of F, 0 where F
is not judged; 1 where the row cuts.

A drive: rated power that may be taken, below and above the base speed [W]; base and top speed
[1/s]; efficiency, and that with the motor's; coefficients of the no-load power [W, W s, ...].
"""

COLUMNS = 21
(
    LENGTH, TEETH, SCALE, EXPONENT, WEAR, SPEED, FEED, SPEED_POWER, FEED_POWER, LIFE, INSIDE,
    STEADY, MOVING, LOW, HIGH, FEED_LOW, FEED_HIGH, SPEED_LOW, SPEED_HIGH, FEED_UNIT, CUTS,
) = range(COLUMNS)  # fmt: skip
POWER_BELOW, POWER_ABOVE, BASE, TOP, EFFICIENCY, SUPPLY, IDLE = range(7)
