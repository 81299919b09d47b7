"""What can limit a row of a cut, by the names and in the order of every array of it."""

CONSTRAINTS = (
    "load limit", "deflection", "roughness", "greatest chip", "least chip", "spindle torque",
    "spindle power", "stability", "cutting speed", "spindle speed", "feed", "as programmed",
)  # fmt: skip
"""The last: chips of a plunge or a drill that nothing else bounds get no thicker than they were."""

(
    LOAD, DEFLECTION, ROUGHNESS, GREATEST_CHIP, LEAST_CHIP, TORQUE, POWER, STABILITY,
    CUTTING_SPEED, SPINDLE_SPEED, FEED, AS_PROGRAMMED,
) = range(len(CONSTRAINTS))  # fmt: skip
