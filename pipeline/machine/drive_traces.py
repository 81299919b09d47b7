"""One axis after the other under its servo, everything that it did kept, compiled."""

from pipeline.kernels import compiled
from pipeline.machine.drive_arithmetic import (
    ASKED,
    COMMAND,
    FORWARD,
    UNIT,
    V,
    X,
    make_ready,
    mechanics_step,
    servo_sample,
)


@compiled
def drive_traces(  # type: ignore[no-untyped-def]
    reference, load, table, start, period, inner, held, room, position, velocity, command
):
    """Fill position, velocity and command, shape (P, T), at the samples of the reference.

    ``reference`` has shape (T,), ``load`` (1 or T,), ``table`` (P, columns) and ``start`` (P, 4);
    ``room`` to work in is ROWS * LANES long.
    """
    each = period / inner
    loaded = 1 if load.shape[0] > 1 else 0
    for p in range(table.shape[0]):
        make_ready(table[p], start[p], reference[0], each, held, room, 0)
        for k in range(reference.shape[0]):
            here, after = reference[k], reference[min(k + 1, reference.shape[0] - 1)]
            position[p, k], velocity[p, k] = room[X], room[V]
            for j in range(inner):
                r = here + (after - here) * (j / inner)
                forward = (r - room[ASKED]) / each
                ahead = (forward - room[FORWARD]) / each
                room[ASKED], room[FORWARD] = r, forward
                servo_sample(room, 0, r, forward, ahead)
                if j == 0:
                    command[p, k] = room[COMMAND] / room[UNIT]
                for _ in range(held):
                    mechanics_step(room, 0, load[loaded * k], 0.5 * each / held)
