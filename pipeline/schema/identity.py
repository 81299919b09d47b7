"""Identity of a machine: its name, its origin, whom to credit."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class MachineIdentity:
    """Identity of a machine."""

    name: str
    """Name, as in its file in ``conf/machine/``."""
    description: str = ""
    """Make and kind, for people."""
    type: str = ""
    """Type, such as the maker's model: machines of a fleet with the same one are siblings, whose
    parameters are pooled on their pages."""
    origin: str = "recorded"
    """``"simulated"`` or ``"recorded"``; shown wherever its results are."""
    credit: str = ""
    """Credit that is due wherever its results are shown."""
    recordings: str = ""
    """Folder under KERF_RECORDINGS that its files are collected from."""

    def __post_init__(self) -> None:
        if self.origin not in ("simulated", "recorded"):
            raise ValueError(f"identity.origin = {self.origin!r} must be 'simulated' or 'recorded'")
