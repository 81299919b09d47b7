"""Types of events whose values are names, whatever file they stand in.

Source: MTConnect 2.x part 2 (types of events whose value is an identifier or free text).
"""

WORDS = frozenset([
    "ACTIVE_PROGRAM", "ASSET_CHANGED", "ASSET_REMOVED", "BLOCK", "FIXTURE_ASSET_ID", "FIXTURE_ID",
    "HARDWARE", "LINE_LABEL", "OPERATOR_ID", "PALLET_ID", "PART_GROUP_ID", "PART_ID",
    "PART_KIND_ID", "PART_NUMBER", "PART_SERIAL_NUMBER", "PART_UNIQUE_ID", "PROCESS_AGGREGATE_ID",
    "PROCESS_OCCURRENCE_ID", "PROGRAM", "PROGRAM_COMMENT", "PROGRAM_HEADER", "PROGRAM_LOCATION",
    "SERIAL_NUMBER", "TOOL_ASSET_ID", "TOOL_GROUP", "TOOL_ID", "USER", "WORKHOLDING_ID",
])  # fmt: skip
"""Types of events that are names: ``0012`` is the program 0012, not the number 12."""


def element_name(kind: str) -> str:
    """Name of the element of a type: ``PATH_FEEDRATE`` becomes ``PathFeedrate``, ``x:FOO`` ``Foo``.

    Parameters
    ----------
    kind : str
        A type of a data item, with or without a vendor's prefix.
    """
    return "".join(word.capitalize() for word in kind.rpartition(":")[2].split("_"))


_ELEMENTS = frozenset(map(element_name, WORDS))


def is_name(kind: str | None) -> bool:
    """Whether the values of an event are names.

    Parameters
    ----------
    kind : str or None
        Its type (``TOOL_ID``) or its element (``ToolId``, ``ToolIdDiscrete``), with or without a
        vendor's prefix; None when it is not known.
    """
    if not kind:
        return False
    own = kind.rpartition(":")[2]
    return own in WORDS or own.removesuffix("Discrete") in _ELEMENTS
