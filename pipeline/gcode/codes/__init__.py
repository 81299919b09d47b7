"""G and M codes: one function for each code, which takes its words from a block and acts on a run.

G codes are kept ten times their number.  Positions are in the machine's frame [mm, deg]. Sources:
Fanuc 0i-F operator's manual B-64694EN; LinuxCNC 2.9 "G-codes" and "M-codes".
"""

__all__ = ["cycles", "execution", "motion", "tools", "work_offsets"]
