"""Stage: clean a machine's records, only the days that changed."""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pipeline.signals.cleaning.clean import clean as clean_records
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings
from pipeline.signals.contracts import check_files

TABLES = {"state": "state/*.parquet"} | {
    name: f"{name}.parquet" for name in ("cycles", "segments", "audit", "gaps", "alarms")
}


def clean(signals: Path, clean: Path, *, mapping: CleanMachine, cleaning: CleanSettings) -> None:
    """Read ``signals``, write ``clean``."""
    summary = clean_records(signals, clean, machine=mapping, settings=cleaning)
    for line in absent_lines(signals.name, summary, mapping):
        sys.stderr.write(f"{line}\n")
    check_files(clean, TABLES)


def absent_lines(machine: str, summary: Mapping[str, Any], mapping: CleanMachine) -> Iterator[str]:
    """A sentence for each data item that the machine's file names and no record has."""
    for item in summary["absent"]:
        like = summary["near"].get(item, [])
        hint = f"did you mean {' or '.join(like)}?" if like else "nothing there is called like it;"
        yield (
            f"clean@{machine}: no record has the data item {item!r}, named as "
            f"{mapping.signal_of[item]} in conf/machine/{machine}.yaml: {hint} "
            f"`kerf records --machine {machine}` lists what there is"
        )
