"""Numerical control of a machine tool: from the moves of a program to commanded axis positions.

A program under one control becomes a ``path`` with limits of speed, acceleration and jerk
(``parameters``, ``limits``); ``planner`` plans its rows with trapezoids or bounded jerk
(``look_ahead``) or with corners that the control blends (``blends``), adds the times of auxiliary
functions (``commands``), and ``interpolate`` gives positions before and after the filters, and
keeps a command that is not the control's own within speed and acceleration.  Positions in machine
coordinates of X Y Z A B C; metre, radian and second, feeds and spindle speeds in the program's
units.  Sources: Altintas, Manufacturing Automation, 2nd ed., 2012, chapter 5; parameters
as named by Fanuc.
"""

__all__ = ["commands", "interpolate", "parameters", "path", "planner"]
