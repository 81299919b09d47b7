"""The fleet that is built: which machines, and which of them record what."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Fleet:
    """A fleet, as in ``conf/fleet/``.

    Parameters
    ----------
    name : str
        Of the fleet.
    machines : tuple of str
        Every machine.
    simulated : tuple of str
        Those whose records the simulated shop floor writes.
    spindles : tuple of str
        Those that record speed, load and temperature of their spindle.
    controls : tuple of str
        Those that log the line of the program that they execute, with the programs.
    drives : tuple of str
        Those whose axes are recorded by the servo: position, speed or current, sample by sample.
    cuts : tuple of str
        Those whose cutting was recorded: forces by a dynamometer, or the load of the spindle.
    optimised : tuple of str
        Those with part programs that are made faster or cheaper inside their limits.
    trials : tuple of str
        Those of them where the simulated shop floor cuts these programs before and after.

    Raises
    ------
    ValueError
        When a list names a machine that the fleet does not have, or that another list lacks
        which it needs.
    """

    name: str
    machines: tuple[str, ...]
    simulated: tuple[str, ...] = ()
    spindles: tuple[str, ...] = ()
    controls: tuple[str, ...] = ()
    drives: tuple[str, ...] = ()
    cuts: tuple[str, ...] = ()
    optimised: tuple[str, ...] = ()
    trials: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for part in PARTS:
            strangers = set(getattr(self, part)) - set(self.machines)
            if strangers:
                raise ValueError(
                    f"fleet.{part} names {sorted(strangers)}, which fleet.machines does not: "
                    "add it there"
                )
        for part, needed in NEEDS:
            lacking = sorted(set(getattr(self, part)) - set(getattr(self, needed)))
            if lacking:
                raise ValueError(
                    f"fleet.{part} names {lacking}, which fleet.{needed} does not: add it there, "
                    "or leave it out"
                )


PARTS = ("simulated", "spindles", "controls", "drives", "cuts", "optimised", "trials")
"""Lists of a fleet."""
NEEDS = (("optimised", "controls"), ("trials", "optimised"), ("trials", "simulated"))
"""What a machine of one list has to be in too."""
MISSING = {
    "spindles": (
        "a thermal model of the spindle",
        "its speed, load and temperature over a working week",
    ),
    "controls": (
        "a model of the control",
        "the line of the program, feed, overrides and tool while programs run, and the programs",
    ),
    "drives": (
        "models of the feed drives",
        "commanded and actual position and the current of each axis at 1 kHz, back and forth at "
        "many speeds",
    ),
    "cuts": (
        "the forces of the cut",
        "forces on a dynamometer in slots of known depth at three feeds or more, at 10 kHz, with "
        "tool, material and spindle speed; or, when nothing better exists, the load of the spindle "
        "with the line of a program of known cuts",
    ),
    "optimised": (
        "part programs that are faster or cheaper inside their limits",
        "the part programs, with blank, tool table, material and limits of each in section parts "
        "of the machine’s file",
    ),
}


def missing(fleet: Fleet, machine: str) -> list[tuple[str, str]]:
    """What cannot be built for ``machine``, each with what to record for it."""
    return [MISSING[part] for part in MISSING if machine not in getattr(fleet, part)]
