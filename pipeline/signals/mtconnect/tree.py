"""Walking MTConnect JSON in its three forms, which nest the same things differently.

======================= ========================================================================
cppagent, jsonVersion 1 lists of ``{"Element": {...}}``
cppagent, jsonVersion 2 ``{"Element": [{...}, ...]}``, grouped by the element's name
MTConnect.NET           lists of plain objects, names in camel case, the element's name as ``type``
======================= ========================================================================
"""

from collections.abc import Iterator
from typing import Any

Node = dict[str, Any]


def part(node: Any, *names: str) -> Any:
    """The member of ``node`` by the first name that it has, whatever the case of letters."""
    if isinstance(node, dict):
        for name in names:
            if name in node:
                return node[name]
        lowered = {key.lower(): key for key in node}
        for name in names:
            if name.lower() in lowered:
                return node[lowered[name.lower()]]
    return None


def named(node: Any) -> Iterator[tuple[str, Any]]:
    """Element name and body of each member in any form; the name is ``""`` where none stands.

    A member that is no object is handed over as it is, for the caller to reject.
    """
    if node == {}:
        return
    for group in node if isinstance(node, list) else [node]:
        if isinstance(group, dict) and _is_wrapped(group):
            for name, inside in group.items():
                for body in inside if isinstance(inside, list) else [inside]:
                    yield name, body
        elif group is not None:
            yield "", group


def _is_wrapped(group: Node) -> bool:
    """Whether an object only holds named elements; a plain element has at least one plain value."""
    return bool(group) and all(
        isinstance(v, dict) or (isinstance(v, list) and all(isinstance(x, dict) for x in v))
        for v in group.values()
    )


def bodies(node: Any, *names: str) -> Iterator[Node]:
    """The objects among the members of ``node`` that are elements called so, in any form."""
    for group in node if isinstance(node, list) else [node]:
        inside = [part(group, name) for name in names]
        found = [body for body in inside if body is not None] or [group]
        for body in found:
            members = body if isinstance(body, list) else [body]
            yield from (member for member in members if isinstance(member, dict))


def plain(node: Node) -> dict[str, str]:
    """The plain values of an object as an element's attributes would hold them."""
    return {k: word(v) for k, v in node.items() if isinstance(v, (str, int, float))}


def word(value: Any) -> str:
    """A plain value as XML would write it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return value if isinstance(value, str) else "" if value is None else repr(value)
