"""A simulated shop floor that writes what real machines write, with their dirt.

Another machine than the twin: nothing of ours is imported here.  Everything shown from it is to be
labelled "simulated".
"""

from pipeline.shop.parameters import ShopParameters
from pipeline.shop.simulate import simulate

__all__ = ["ShopParameters", "simulate"]
