"""From what a machine said to what is known of it: gaps, glitches, states on a grid, cycles."""

from pipeline.signals.cleaning.clean import clean
from pipeline.signals.cleaning.settings import (
    CleanMachine,
    CleanSettings,
    PositionControl,
    SignalMap,
)

__all__ = ["CleanMachine", "CleanSettings", "PositionControl", "SignalMap", "clean"]
