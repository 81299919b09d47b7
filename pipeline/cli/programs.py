"""Commands for part programs: what they say, how long they take, whether two are the same."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.kerf import app
from pipeline.cli.options import (
    Load,
    Material,
    Model,
    Program,
    Resolution,
    Responses,
    Stock,
    ToolTable,
    Unit,
    Whose,
    WorkOffset,
)
from pipeline.cli.progress import one_sentence, share_bar


@app.command()
def interpret(
    program: Program,
    out: Annotated[Path, typer.Option(help="CSV to write, a row a move.")],
    machine: Annotated[
        str | None, typer.Option(help="Whose offsets and tools hold, as in conf/machine/.")
    ] = None,
    dialect: Annotated[
        str | None, typer.Option(help="fanuc, linuxcnc or siemens; the machine's by default.")
    ] = None,
) -> None:
    """Follow PROGRAM block by block and write its moves."""
    from pipeline.commands.outputs import check_outputs
    from pipeline.commands.programs import machine_setup, moves_table, read_moves

    with one_sentence(), share_bar("interpreting") as share:
        check_outputs(program, out)
        moves = read_moves(program, machine_setup(machine, dialect), share)
        moves_table(moves).to_csv(out, index=False)
    typer.echo(f"{len(moves)} moves, {moves.length.sum():.3f} mm, wrote {out}")


@app.command()
def simulate(
    program: Program,
    machine: Whose,
    unit: Unit = None,
    out: Annotated[
        Path | None, typer.Option(help="Parquet of positions at the interpolation period.")
    ] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of the times, block by block.")] = None,
    stock: Stock = None,
    tool_table: ToolTable = None,
    material: Material = None,
    limit_load: Load = None,
    resolution: Resolution = None,
    work_offset: WorkOffset = None,
    frf: Responses = None,
    page: Annotated[Path | None, typer.Option(help="HTML page of the cut.")] = None,
    model: Model = "champion",
) -> None:
    """Plan PROGRAM as MACHINE's control does: how long each block takes, and why.

    With a blank, tools and its material also what the cut takes: load, power, stability, cost.
    """
    from pipeline.commands.cutting import cut_document, cut_options, write_page
    from pipeline.commands.cutting_lines import cut_lines
    from pipeline.commands.outputs import check_outputs
    from pipeline.commands.programs import (
        simulate_program,
        simulated_document,
        simulated_lines,
        write_document,
        write_trace,
    )

    with one_sentence():
        options = cut_options(
            stock=stock, tool_table=tool_table, material=material, limit_load=limit_load,
            resolution=resolution, work_offset=work_offset, frf=frf or (), page=page,
        )  # fmt: skip
        check_outputs(program, json, out, page, inputs=options.files if options else ())
        with share_bar("planning") as share:
            simulated = simulate_program(program, machine, unit, share, model)
        document = simulated_document(simulated, program.stem, machine)
        if options is not None:
            document["cut"] = cut_document(simulated, machine, options)
        if json is not None:
            write_document(document, json)
        if out is not None:
            with share_bar("writing positions") as share:
                write_trace(simulated.plan, out, share)
        if page is not None:
            write_page(document, page, json)
    for line in simulated_lines(document, program):
        typer.echo(line)
    if options is not None:
        for line in cut_lines(document["cut"]):
            typer.echo(line)


@app.command()
def check(
    before: Annotated[Path, typer.Argument(help="A part program.")],
    after: Annotated[Path, typer.Argument(help="The same with other feeds and speeds.")],
    machine: Annotated[
        str | None, typer.Option(help="Whose offsets and tools hold, as in conf/machine/.")
    ] = None,
    dialect: Annotated[
        str | None, typer.Option(help="fanuc, linuxcnc or siemens; the machine's by default.")
    ] = None,
    splits: Annotated[
        bool, typer.Option(help="Let AFTER have more points on the way of straight cuts.")
    ] = False,
) -> None:
    """Prove that AFTER differs from BEFORE in F and S words only, and in no move; else exit 1."""
    from pipeline.commands.check import check_lines, check_programs

    with one_sentence():
        proof = check_programs(before, after, machine, dialect, splits=splits)
    for line in check_lines(proof, before, after):
        typer.echo(line)
    if not proof.same:
        raise typer.Exit(1)
