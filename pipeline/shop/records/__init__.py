"""Records of the simulated machine's working days: MTConnect log, device model, thermocouples.

Numbers are in the units of MTConnect 2.0 (native units where an adapter writes), temperatures in
degC, times in UTC with seconds counted from the first midnight.
"""

__all__: list[str] = []
