"""The command that makes a part program faster or cheaper."""

from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.kerf import app
from pipeline.cli.options import (
    Material,
    Pair,
    Program,
    Resolution,
    Responses,
    Stock,
    ToolTable,
    Unit,
    Whose,
    WorkOffset,
)
from pipeline.cli.progress import one_sentence, stages_bar


def _limit(words: str) -> Any:
    return typer.Option(help=words, rich_help_panel="Limits")


def _range(words: str) -> Any:
    return typer.Option(help=words, rich_help_panel="Limits", metavar="LOW HIGH")


@app.command()
def optimise(
    program: Program,
    machine: Whose,
    objective: Annotated[
        str, typer.Option(help="time, cost, energy, wear, or pareto: the knee of their front.")
    ] = "time",
    out: Annotated[Path | None, typer.Option(help="Program to write.")] = None,
    json: Annotated[Path | None, typer.Option(help="JSON of what was found.")] = None,
    page: Annotated[Path | None, typer.Option(help="HTML page of what was found.")] = None,
    unit: Unit = None,
    stock: Stock = None,
    tool_table: ToolTable = None,
    material: Material = None,
    resolution: Resolution = None,
    work_offset: WorkOffset = None,
    frf: Responses = None,
    limit_load: Annotated[float | None, _limit("Greatest load on a tool in the plane, N.")] = None,
    limit_deflection: Annotated[float | None, _limit("Of a tool's tip, um.")] = None,
    limit_roughness: Annotated[float | None, _limit("Height of the feed marks, um.")] = None,
    limit_torque: Annotated[float | None, _limit("Of the cut, N m.")] = None,
    power_share: Annotated[
        float | None, _limit("Of the drive's power that may be used, a share.")
    ] = None,
    chip: Annotated[Pair | None, _range("Thickest chip of a block, um.")] = None,
    feed: Annotated[Pair | None, _range("F, mm/min.")] = None,
    speed: Annotated[Pair | None, _range("S, rev/min.")] = None,
    cutting_speed: Annotated[Pair | None, _range("Cutting speed, m/min.")] = None,
    least_speed_change: Annotated[float | None, _limit("Between two S of a tool, rev/min.")] = None,
    stability_margin: Annotated[float | None, _limit("Kept free of the lobes, a share.")] = None,
    epsilon: Annotated[
        float | None, _limit("P(load > limit) at most; 0.01 by default, 0.5 takes nominal values.")
    ] = None,
    split: Annotated[
        bool, typer.Option("--split", help="Split long blocks where the cut changes.")
    ] = False,
    speeds: Annotated[
        str | None, typer.Option(help="blocks: S words at any block; own: only the program's.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Of all chance.")] = None,
    proof_comment: Annotated[
        bool,
        typer.Option("--proof-comment", help="The proof's hash in a comment at the program's end."),
    ] = False,
) -> None:
    """Make PROGRAM faster or cheaper inside its limits; only F and S words change.

    Ctrl-C ends the search and writes the best so far.
    """
    from pipeline.commands.optimise import (
        Outputs,
        PartLimits,
        PartRequest,
        SearchOptions,
        interruptible,
        objective_of,
        optimise_part,
        part_options,
        write_optimised,
    )
    from pipeline.commands.optimise_lines import optimise_lines
    from pipeline.commands.outputs import check_outputs

    with one_sentence():
        outputs = Outputs.of(out, json, page)
        request = PartRequest(
            program=program, machine=machine, unit=unit, objective=objective_of(objective),
            cut=part_options(
                stock=stock, tool_table=tool_table, material=material, load=limit_load,
                resolution=resolution, work_offset=work_offset, frf=frf,
            ),
            limits=PartLimits(
                load=limit_load, deflection=limit_deflection, roughness=limit_roughness,
                torque=limit_torque, power_share=power_share, chip=chip, feed=feed, speed=speed,
                cutting_speed=cutting_speed, least_speed_change=least_speed_change,
                stability_margin=stability_margin,
            ),
            search=SearchOptions(
                epsilon=epsilon, seed=seed, split=split, speeds=speeds,
                proof_comment=proof_comment,
            ),
        )  # fmt: skip
        check_outputs(program, out, json, page, inputs=request.cut.files)
        try:
            with interruptible(_ending) as asked, stages_bar() as told:
                result, document = optimise_part(request, lambda w, s: (told(w, s), asked())[1])
        except KeyboardInterrupt as error:
            typer.echo(
                "kerf: interrupted before anything kept the limits, nothing is written", err=True
            )
            raise typer.Exit(130) from error
        written = write_optimised(result, document, outputs)
    for line in optimise_lines(document):
        typer.echo(line)
    typer.echo(f"wrote {', '.join(str(path) for path in written)}")
    if document["interrupted"]:
        raise typer.Exit(130)


def _ending() -> None:
    typer.echo("kerf: ending with the best so far; Ctrl-C again to give up", err=True)
