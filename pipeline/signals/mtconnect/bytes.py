"""Compiled looks at bytes: comparing, searching, the ends of names and values.

These functions allocate nothing, as :func:`pipeline.kernels.compiled` asks.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from pipeline.kernels import compiled

_DEVICE = np.frombuffer(b"DeviceStream ", np.uint8).copy()
# How far the search may go on when this byte stands where the last of `_DEVICE` would.
_SKIP = np.full(256, _DEVICE.size, np.int64)
_SKIP[_DEVICE] = _DEVICE.size - 1 - np.arange(_DEVICE.size)


@intrinsic
def load8(typing_context: Any, buf: Any, at: Any) -> Any:
    """Eight bytes of ``buf`` from ``at`` on as one number; they must lie within it."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        array = context.make_array(signature.args[0])(context, builder, args[0])
        pointer = builder.gep(array.data, [args[1]])
        wide = builder.bitcast(pointer, ir.IntType(64).as_pointer())
        word = builder.load(wide)
        word.align = 1
        return word

    return types.uint64(buf, types.int64), generate


@compiled
def is_at(buf: Any, at: Any, end: Any, word: Any) -> Any:
    """Whether ``word`` stands at ``at``, before ``end``."""
    n = word.size
    i = 0
    while i < n and at + i < end and buf[at + i] == word[i]:
        i += 1
    return i == n


@compiled
def same(buf: Any, a: Any, b: Any, n: Any) -> Any:
    """Whether the ``n`` bytes from ``a`` and from ``b`` on are the same."""
    i = 0
    while i + 8 <= n:
        if load8(buf, a + i) != load8(buf, b + i):
            return False
        i += 8
    while i < n:
        if buf[a + i] != buf[b + i]:
            return False
        i += 1
    return True


@compiled
def is_space(c: Any) -> Any:
    """Whether a byte is white space of XML."""
    return c == 32 or c == 10 or c == 13 or c == 9


@compiled
def name_char(c: Any) -> Any:
    """Whether a byte may stand in a name, as far as ASCII goes."""
    return (
        97 <= c <= 122 or 65 <= c <= 90 or 48 <= c <= 57 or c == 95 or c == 58 or c == 45 or c == 46
    )


@compiled
def value_end(buf: Any, at: Any, end: Any) -> Any:
    """The quote that ends an attribute's value, -1 if something odd comes before."""
    while at < end:
        c = buf[at]
        if c == 34:
            return at
        if c < 32 or c == 60:
            return -1
        at += 1
    return -1


@compiled
def element_end(buf: Any, at: Any, end: Any, name: Any, length: Any) -> Any:
    """The place after ``</name>``; -1 where there is none or a comment, CDATA, ... before it."""
    while at + length + 3 <= end:
        if buf[at] == 60:
            c = buf[at + 1]
            if c == 33 or c == 63:
                return -1
            if c == 47 and same(buf, at + 2, name, length):
                after = buf[at + 2 + length]
                if after == 62:
                    return at + length + 3
                if not name_char(after):
                    return -1
        at += 1
    return -1


@compiled
def device_tag(buf: Any, at: Any, end: Any) -> Any:
    """The next place of ``DeviceStream `` from ``at`` on, -1 when there is none."""
    n = _DEVICE.size
    i = at + n - 1
    while i < end:
        c = buf[i]
        skip = _SKIP[c]
        if skip == 0:
            if is_at(buf, i - n + 1, end, _DEVICE):
                return i - n + 1
            skip = 1
        i += skip
    return -1
