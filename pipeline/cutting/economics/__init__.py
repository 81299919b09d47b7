"""Economics of the cut: materials, tool life, power of the spindle drive, electricity, cost.

Formulas are in SI; parameters keep the units of tables (mm, m/min, kW, N/mm^2), which their names
say.  Tool life is Taylor's (1907), its optima Gilbert's (1950), the cost of a part that of Sim2023.
"""

__all__ = ["cost", "material", "spindle_power"]
