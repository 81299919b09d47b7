"""Command line of Kerf: records, state and champions of a fleet, part programs, cuts."""

__all__ = ["main"]


def main() -> None:
    """Run ``kerf``."""
    import gc

    gc.set_threshold(50_000)  # imports make many objects and no garbage: 5 to 8 % of a warm command
    from pipeline.app import (  # isort: skip
        commands, incident_commands, life_commands, program_commands,
    )  # fmt: skip
    from pipeline.app.kerf import app
    from pipeline.schema.files import ended_by_signals

    # imported so that their commands are there
    del commands, incident_commands, life_commands, program_commands
    with ended_by_signals():
        app()
