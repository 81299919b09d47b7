"""Unpacking of gzip that keeps what stands before a cut or damage."""

import zlib
from collections.abc import Callable, Iterator

MAGIC = b"\x1f\x8b"
"""The first bytes of a gzip stream."""


def gunzip(raw: Iterator[bytes], chunk: int, damaged: Callable[[str], None]) -> Iterator[bytes]:
    """Unpack a gzip stream of any number of members.

    Parameters
    ----------
    raw : iterator of bytes
        The stream in pieces.
    chunk : int
        Bytes that a piece of the result has at most.
    damaged : callable
        Called with the reason when the stream ends early; what came before has been yielded.
    """
    unpack, inside = zlib.decompressobj(31), False
    for packed in raw:
        while packed := packed if inside else packed.lstrip(b"\0"):
            inside = True
            try:
                data = unpack.decompress(packed, chunk)
            except zlib.error as error:
                damaged(f"the gzip stream is damaged from here on ({error})")
                return
            if data:
                yield data
            packed = unpack.unconsumed_tail
            if unpack.eof:  # another member, or nothing, follows
                packed, inside = unpack.unused_data, False
                unpack = zlib.decompressobj(31)
    if inside:
        yield unpack.flush()
        if not unpack.eof:
            damaged("the gzip stream is cut off here")
