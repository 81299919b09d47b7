"""What stands behind the command ``kerf``: each a thing that a person asks for."""
