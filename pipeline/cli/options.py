"""Options that several commands have."""

from pathlib import Path
from typing import Annotated

import typer

Machine = Annotated[str, typer.Argument(help="As in conf/machine/.")]
Program = Annotated[Path, typer.Argument(help="A part program.")]
Pair = tuple[float, float]


Whose = Annotated[str, typer.Option(help="Whose control, as in conf/machine/.")]
Unit = Annotated[str | None, typer.Option(help="Which of several machines of a kind.")]
Stock = Annotated[
    str | None,
    typer.Option(
        help="Blank to cut, in work coordinates, mm: box:X0,X1,Y0,Y1,Z0,Z1, "
        "cylinder:X,Y,DIAMETER,Z0,Z1 or an .stl file."
    ),
]
ToolTable = Annotated[
    str | None, typer.Option(help="Tools by number: a table of conf/tool/, or a YAML file.")
]
Material = Annotated[str | None, typer.Option(help="Of the blank, as in conf/material/.")]
Load = Annotated[float | None, typer.Option(help="Greatest load on a tool in the plane, N.")]
Resolution = Annotated[float | None, typer.Option(help="Of the blank, mm; 0.2 by default.")]
WorkOffset = Annotated[
    str | None, typer.Option(help="That the blank is measured in; that of the first cut.")
]
Responses = Annotated[
    list[str] | None,
    typer.Option(help="Frequency response at the tools' tips: x=TIP.csv, y=TIP.csv or a UFF."),
]
Model = Annotated[
    str, typer.Option(help="Whose sub-models: champion, or latest, which is the exception.")
]
