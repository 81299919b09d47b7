"""The position loop around the speed loop: a gain on the position error, and feed-forward.

w_ref = (K_v (x_ref - x) + f_v x_ref') 2 pi / L
"""

from dataclasses import dataclass
from math import isfinite


@dataclass(frozen=True, kw_only=True)
class PositionLoopParameters:
    """One position loop.

    Parameters
    ----------
    gain : float
        K_v [1/s]; at a constant feed v without feed-forward the error is v / K_v.
    velocity_feedforward : float
        f_v, share of the reference's velocity that is fed forward; 0 for none, 1 for all.
    motor_encoder : bool
        Whether the position is the motor's, L / 2 pi times its angle, or a scale's at the carriage.
    every : int
        Periods of the current loop for one of the position loop.

    Raises
    ------
    ValueError
        When a value is out of its range.
    """

    gain: float
    velocity_feedforward: float = 0.0
    motor_encoder: bool = False
    every: int = 10

    def __post_init__(self) -> None:
        if not (isfinite(self.gain) and self.gain > 0):
            raise ValueError(f"position_loop.gain = {self.gain} 1/s must be finite and positive")
        if not (isfinite(self.velocity_feedforward) and self.velocity_feedforward >= 0):
            raise ValueError(
                f"position_loop.velocity_feedforward = {self.velocity_feedforward} must be finite, "
                "at least 0"
            )
        if not (isfinite(self.every) and self.every >= 1 and self.every % 1 == 0):
            raise ValueError(f"position_loop.every = {self.every} must be a whole number from 1")
