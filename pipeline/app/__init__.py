"""The command kerf: records, state and champions of a fleet, part programs, cuts, optimisation.

``commands`` holds the options and is thin; the other modules do what stands behind them and say it
in lines.  Units are those of the shop floor: mm, mm/min, rev/min, N.
"""

__all__ = [
    "check", "compensation", "correction", "cut", "fleet", "main", "optimise", "programs",
    "synthesise", "wear",
]  # fmt: skip


def main() -> None:
    """Run ``kerf``."""
    from pipeline.app import commands, own_machine
    from pipeline.app.kerf import app
    from pipeline.schema.files import ended_by_signals

    del commands, own_machine  # imported so that its commands are there
    with ended_by_signals():
        app()
