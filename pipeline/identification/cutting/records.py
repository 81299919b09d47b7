"""Recordings of a dynamometer: which ones, their channels, and what stands in them."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

from pipeline.identification.cutting.conditions import Conditions, Said
from pipeline.identification.cutting.known import CuttingKnown, named_channels
from pipeline.identification.cutting.revolution import Revolution
from pipeline.identification.cutting.settings import CuttingFitSettings
from pipeline.identification.cutting.spindle_load_records import SpindleLoadRecords

__all__ = [
    "CuttingFitSettings", "CuttingKnown", "CuttingRecording", "CuttingRecords", "read_recordings",
]  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class CuttingRecords:
    """Recordings of a machine's cutting forces, and what they serve for.

    Parameters
    ----------
    recordings : str
        Pattern of their names below the machine's folder; "" where there is no dynamometer.
    training : tuple of str
        Patterns of those that coefficients are identified from; they are judged on the others.
    channels : mapping of str to str
        x, y and z of the dynamometer by their names in the recordings.
    name : str, optional
        Regular expression that finds conditions in a recording's name, by named groups.
    conditions : Said
        The same for all recordings.
    by_pattern : mapping of str to Said
        Of the recordings whose names fit a pattern.
    left_out : mapping of str to str
        Patterns of recordings that are not used, with the reason.
    spindle : SpindleLoadRecords, optional
        Logs of the spindle's load.

    Raises
    ------
    ValueError
        When it names no recording at all, or not the channels x, y and z.
    """

    recordings: str = ""
    training: tuple[str, ...] = ()
    channels: Mapping[str, str] = field(
        default_factory=lambda: {"x": "force_x", "y": "force_y", "z": "force_z"}
    )
    name: str | None = None
    conditions: Said = field(default_factory=Said)
    by_pattern: Mapping[str, Said] = field(default_factory=dict)
    left_out: Mapping[str, str] = field(default_factory=dict)
    spindle: SpindleLoadRecords | None = None

    def __post_init__(self) -> None:
        named_channels(self.channels)
        if not self.recordings and self.spindle is None:
            raise ValueError(
                "cutting_records names neither recordings of a dynamometer nor logs of the "
                "spindle's load: write recordings or spindle"
            )

    def is_training(self, recording: str) -> bool:
        """Whether coefficients may be learnt from ``recording``."""
        return any(fnmatchcase(recording, pattern) for pattern in self.training)


@dataclass(frozen=True, kw_only=True, eq=False)
class CuttingRecording:
    """One recording of a cut.

    Parameters
    ----------
    name : str
        Of the raw file.
    sha256 : str
        Of the raw file.
    trained : bool
        Whether coefficients may be learnt from it.
    conditions : Conditions, optional
        What is known of the cut; its speed is the one that was set.
    revolution : Revolution, optional
        Its mean revolution, forces on the tool along feed, normal, axis; None when it is left out.
    zero_known : bool
        Whether the zero of its channels was seen in air.
    reason : str
        Why it is left out.
    notes : tuple of str
        What was done to its rows.
    """

    name: str
    sha256: str
    trained: bool
    conditions: Conditions | None = None
    revolution: Revolution | None = None
    zero_known: bool = False
    reason: str = ""
    notes: tuple[str, ...] = ()

    @property
    def role(self) -> str:
        """As the documents say it: training, judged or left out."""
        if self.revolution is None:
            return "left out"
        return "training" if self.trained else "judged"

    @property
    def cut(self) -> tuple[Conditions, Revolution]:
        """Its conditions and its mean revolution.

        Raises
        ------
        ValueError
            When it is left out.
        """
        if self.conditions is None or self.revolution is None:
            raise ValueError(f"{self.name} is left out: {self.reason}")
        return self.conditions, self.revolution


def read_recordings(
    signals: Path, records: CuttingRecords, known: CuttingKnown, settings: CuttingFitSettings
) -> list[CuttingRecording]:
    """Every recording that ``records`` names, in the order of their names.

    Parameters
    ----------
    signals : Path
        As ``ingest`` wrote it.
    records : CuttingRecords
        Which recordings, their channels and conditions.
    known : CuttingKnown
        The tool, and how the dynamometer stands.
    settings : CuttingFitSettings
        How many harmonics are used.

    Returns
    -------
    list of CuttingRecording
        One that cannot be used is there with the reason; empty without a dynamometer.

    Raises
    ------
    ValueError
        When ``signals`` has no manifest, or none of its files fits ``records.recordings``.
    """
    from pipeline.identification.cutting.reading import read_file

    if not records.recordings:
        return []
    try:
        files = json.loads((signals / "manifest.json").read_text())["files"]
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"{signals}/manifest.json cannot be read: run `dvc repro`") from error
    named = {
        name: entry for name, entry in sorted(files.items())
        if fnmatchcase(name, records.recordings)
    }  # fmt: skip
    if not named:
        raise ValueError(
            f"no recording in {signals} fits cutting_records.recordings = {records.recordings!r}: "
            "put recordings of the dynamometer there or correct the pattern"
        )
    kept: dict[str, str] = {}
    for name in sorted(named, key=lambda one: (not records.is_training(one), one)):
        kept.setdefault(str(named[name].get("sha256") or name), name)
    found = []
    for name, entry in named.items():
        sha256 = str(entry.get("sha256") or "")
        first = kept[sha256 or name]
        if name == first:
            found.append(read_file(signals, name, entry, records, known, settings))
            continue
        copied = f"it is a copy of {first}: record another"
        trained = records.is_training(name)
        found.append(CuttingRecording(name=name, sha256=sha256, trained=trained, reason=copied))
    return found
