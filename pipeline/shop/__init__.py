"""A simulated shop floor that writes what real machines write, with their dirt.

Another machine than the twin: of ours, nothing but the reader of part programs is imported here.
Everything shown from it is to be labelled "simulated".
"""

from pipeline.shop.parameters import ShopParameters
from pipeline.shop.simulate import simulate

__all__ = ["ShopParameters", "simulate"]
