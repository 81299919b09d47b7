"""Feed drives of the simulated mill: cascade, screw with two masses, LuGre friction, motor.

Positions are those of the carriage in the machine's frame; SI inside, mm, A and N in the traces
that a servo tuning tool writes.  Sources: Altintas et al., CIRP Annals 60 (2011), and those in
:mod:`pipeline.shop.drives.parameters`.
"""

__all__ = ["records"]
