"""Documents of MTConnect agents: device models and observations, in XML and JSON.

Streams, Devices, Assets and Error documents of versions 1.0 to 2.7, one or many in a file.  Times
are nanoseconds since 1970 in UTC, values stand in the units of the document.
Source: ANSI/MTC1.4, MTConnect 2.x parts 2 and 3.
"""

__all__ = ["devices", "json_document", "xml_document", "xml_events"]
