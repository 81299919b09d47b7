"""Sub-models of a machine: each identified from records, judged, registered and shown alike.

``contract`` says what a sub-model is, ``cases`` what records are to it, ``judge`` how its
predictions are held against what was measured, ``next_recording`` what would help most.  A folder
a sub-model: its identification, its predictor, its own figures.  The physics that it identifies
lies below, in rooms of its own.
``deformation`` also writes its model as a correction for a control; ``following_residual`` gives
the twin its prediction of what the drives leave over; ``wear`` tells the wear of a recording and
``synthesis`` makes signals at a given one.
"""

__all__ = [
    "cases",
    "conformal",
    "contract",
    "cutting",
    "deformation",
    "following_residual",
    "judge",
    "next_recording",
    "promotion",
    "scoring",
    "siblings",
    "spindle",
    "synthesis",
    "wear",
]
