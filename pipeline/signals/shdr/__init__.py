"""Logs of MTConnect agents and adapters (SHDR): ``time|item|value``, streamed in little memory.

Ordinary lines are read by a scanner in compiled code, all others one by one.  Source: MTConnect
agent, adapter protocol (README of mtconnect/cppagent, versions 1.x to 2.x).
"""

__all__ = ["log"]
