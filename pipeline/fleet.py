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
    """

    name: str
    machines: tuple[str, ...]
    simulated: tuple[str, ...] = ()
    spindles: tuple[str, ...] = ()
    controls: tuple[str, ...] = ()
    drives: tuple[str, ...] = ()
    cuts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for part in ("simulated", "spindles", "controls", "drives", "cuts"):
            strangers = set(getattr(self, part)) - set(self.machines)
            if strangers:
                raise ValueError(
                    f"fleet.{part} names {sorted(strangers)}, which fleet.machines does not: "
                    "add it there"
                )


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
}


def missing(fleet: Fleet, machine: str) -> list[tuple[str, str]]:
    """What cannot be built for ``machine``, each with what to record for it."""
    return [MISSING[part] for part in MISSING if machine not in getattr(fleet, part)]
