"""The golden week, frozen by hash: files that no model learns from and every model is judged on."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path

import cattrs


@dataclass(frozen=True, kw_only=True)
class FrozenFile:
    """A raw file as it was when the week was frozen: path under data/raw/<machine>, sha256."""

    file: str
    sha256: str


@dataclass(frozen=True, kw_only=True)
class Week:
    """First and last UTC day, ``YYYY-MM-DD``, both included."""

    first: str
    last: str

    def __post_init__(self) -> None:
        for name in ("first", "last"):
            day = getattr(self, name)
            try:
                proper = date.fromisoformat(day).isoformat() == day
            except ValueError:
                proper = False
            if not proper:
                raise ValueError(f"the week's {name} day {day!r} is no day YYYY-MM-DD")
        if self.last < self.first:
            raise ValueError(f"the week ends {self.last}, before it begins {self.first}")


@dataclass(frozen=True, kw_only=True)
class GoldenWeek:
    """A machine's golden week, as stored in ``data/golden/<machine>.json``."""

    machine: str
    week: Week
    files: tuple[FrozenFile, ...]

    @property
    def sha256(self) -> str:
        """One hash of the whole week: of its files' names and hashes."""
        lines = "".join(f"{f.sha256}  {f.file}\n" for f in self.files)
        return hashlib.sha256(lines.encode()).hexdigest()


def read_golden(path: Path) -> GoldenWeek:
    """The frozen week in ``path``.

    Raises
    ------
    ValueError
        When the file is missing or is not one; the message says how to freeze a week.
    """
    if not path.exists():
        raise ValueError(
            f"{path} does not exist: freeze a week that no model learns from with "
            f"`kerf golden {path.stem} --first YYYY-MM-DD --last YYYY-MM-DD`"
        )
    converter = cattrs.Converter(forbid_extra_keys=True)
    try:
        return converter.structure(json.loads(path.read_text()), GoldenWeek)
    except (ValueError, cattrs.BaseValidationError) as error:
        raise ValueError(
            f"{path} is no frozen week ({error}): freeze it again with `kerf golden`"
        ) from error


def freeze(machine: str, week: Week, manifest: dict[str, dict[str, object]]) -> GoldenWeek:
    """Freeze the raw files whose observations reach into ``week``.

    ``manifest`` is the ``files`` section of the machine's ingest manifest.

    Raises
    ------
    ValueError
        When no file reaches into the week.
    """
    files = [
        FrozenFile(file=name, sha256=str(entry["sha256"]))
        for name, entry in sorted(manifest.items())
        if entry.get("last") and _reaches(entry, week)
    ]
    if not files:
        raise ValueError(
            f"{machine} has no record from {week.first} to {week.last}: put its files into "
            f"data/raw/{machine} and run `dvc repro`, or name another week"
        )
    return GoldenWeek(machine=machine, week=week, files=tuple(files))


def _reaches(entry: dict[str, object], week: Week) -> bool:
    """Whether the last observation of a file lies in the week.

    A log restates at its start what was known before, so that its first time says little.
    """
    return week.first <= str(entry["last"])[:10] <= week.last


def write_golden(golden: GoldenWeek, path: Path) -> None:
    """Store a frozen week."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(golden), indent=2) + "\n")


def changes(golden: GoldenWeek, manifest: dict[str, dict[str, object]]) -> Sequence[str]:
    """One sentence for each file of the golden week that is no longer what was frozen.

    A file that reaches into the week and was not frozen changes the week as much as one that is
    not what it was.
    """
    found = []
    for frozen in golden.files:
        entry = manifest.get(frozen.file)
        if entry is None:
            found.append(f"{frozen.file} of the golden week is not among the records")
        elif entry["sha256"] != frozen.sha256:
            found.append(
                f"{frozen.file} of the golden week has sha256 {str(entry['sha256'])[:12]}, "
                f"frozen was {frozen.sha256[:12]}"
            )
    known = {frozen.file for frozen in golden.files}
    found += [
        f"{name} reaches into the golden week and was not frozen with it"
        for name, entry in sorted(manifest.items())
        if name not in known and entry.get("last") and _reaches(entry, golden.week)
    ]
    return found
