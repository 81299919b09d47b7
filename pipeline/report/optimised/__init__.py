"""Page of an optimised part program, from its stored document and nothing else.

The command and the report write the same page.  Loads are in [N], feeds as the program writes them,
speeds in [rev/min], times in [s].
"""

__all__ = ["page"]
