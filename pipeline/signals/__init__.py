"""Signals: a machine's reports, from raw files to clean tables and to channels in SI.

Tables speak the names and units of MTConnect (ANSI/MTC1.4), times are nanoseconds since 1970 in
UTC; ``recordings`` hands channels to sub-models in SI.
"""

__all__ = [
    "cleaning",
    "columns",
    "conditions",
    "contracts",
    "formats",
    "ingest",
    "mtconnect",
    "recorder_faults",
    "recordings",
    "shdr",
    "store",
    "tables",
    "units",
    "wear_lives",
    "wear_windows",
    "windows",
]
