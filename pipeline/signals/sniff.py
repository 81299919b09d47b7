"""Which reader a file wants, from its first bytes and, for text, its name."""

import gzip
from pathlib import Path

from pipeline.signals.records import Format, UnreadableFile

MAGIC: tuple[tuple[bytes, Format], ...] = (
    (b"PAR1", "parquet"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 5.0", "matlab"),
    (b"MATLAB 7.3", "matlab"),
    (b"TDSm", "tdms"),
)


def sniff(path: Path) -> Format:
    """The format of the file ``path``.

    Raises
    ------
    UnreadableFile
        When the file cannot be opened.
    """
    try:
        with path.open("rb") as file:
            head = file.read(4096)
        if head[:2] == b"\x1f\x8b":
            with gzip.open(path) as inside:
                head = inside.read(4096)
    except (OSError, EOFError) as error:
        raise UnreadableFile(f"cannot be opened: {error}") from error
    for magic, form in MAGIC:
        if head.startswith(magic):
            return form
    text = head.lstrip(b"\xef\xbb\xbf \t\r\n")
    if text[:1] == b"<" or text[:2] == b"--" and b"<" in text:
        return "mtconnect_xml"
    if text[:1] in (b"{", b"["):
        return "mtconnect_json"
    name = path.name.removesuffix(".gz").lower()
    return "csv" if name.endswith((".csv", ".tsv")) else "shdr"
