"""Page of a simulated part program: its path, its feed over time, and its time by cause.

Moves are those of the table that ``simulate_programs`` writes, positions in the machine's frame
[mm], feeds in [mm/min], times in [s].
"""

__all__ = ["moves", "simulated"]
