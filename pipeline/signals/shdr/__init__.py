"""Logs of MTConnect agents and adapters (SHDR): ``time|item|value``, streamed in little memory.

Ordinary lines are read by a fast path in compiled code, all others by the reference path; both give
the same rows.  Source: MTConnect agent, adapter protocol (README of mtconnect/cppagent, versions
1.x to 2.x).
"""

__all__ = ["log"]
