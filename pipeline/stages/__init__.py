"""One function a DVC stage; its signature is its contract with dvc.yaml.

Positional parameters are paths in the order of the command, keyword-only ones sections of
params.yaml. ``python -m pipeline.stages NAME@MACHINE PATH...`` runs one.
"""

__all__ = ["compose", "correct_programs", "optimise", "report", "sections"]
