"""The proof's hash in a comment at a program's end."""

import re

_COMMENT = re.compile(
    rb"(?:\(KERF PROOF SHA256 ([0-9A-F]{64})\)|; KERF PROOF SHA256 ([0-9A-F]{64}))"
)


def proof_line(sha256: str, dialect: str) -> bytes:
    """The comment, without a line end."""
    said = f"KERF PROOF SHA256 {sha256.upper()}"
    return (f"; {said}" if dialect == "siemens" else f"({said})").encode("ascii")


def without_comment(lines: list[bytes]) -> tuple[list[bytes], str | None, int]:
    """Lines without the comment, the hash that it holds, and its place among them.

    Only blank lines and a closing ``%`` may follow it; what looks like it elsewhere is a line as
    any other.
    """
    for at in range(len(lines) - 1, -1, -1):
        found = _COMMENT.fullmatch(lines[at].rstrip(b"\r\n"))
        if found is not None:
            rest = lines[:at] + lines[at + 1 :]
            if lines[at] == found[0] and at:  # the text had no line end before
                rest[-1] = rest[-1].rstrip(b"\r\n")
            return rest, (found[1] or found[2]).decode("ascii").lower(), at
        if lines[at].strip() and not lines[at].lstrip().startswith(b"%"):
            break
    return lines, None, len(lines)


def with_comment(lines: list[bytes], comment: bytes) -> list[bytes]:
    """Lines with the comment at the end, before a closing ``%``, in place of an older one."""
    lines, _, _ = without_comment(lines)
    end = next((line[len(line.rstrip(b"\r\n")) :] for line in lines if line[-1:] in b"\r\n"), b"\n")
    last = len(lines)
    while last and not lines[last - 1].strip():
        last -= 1
    if last > 1 and lines[last - 1].lstrip().startswith(b"%"):
        return [*lines[: last - 1], comment + end, *lines[last - 1 :]]
    if lines and lines[-1][-1:] not in b"\r\n":
        return [*lines[:-1], lines[-1] + end, comment]
    return [*lines, comment + end]
