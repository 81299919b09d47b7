"""The command that makes a part program faster or cheaper."""

from collections.abc import Callable
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.kerf import app
from pipeline.cli.options import (
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
from pipeline.cli.progress import one_sentence, stages_bar
from pipeline.schema.limits import limit_options


def _limit(words: str) -> Any:
    return typer.Option(help=words, rich_help_panel="Limits")


def _with_limits(command: Callable[..., None]) -> Callable[..., None]:
    """The command with an option for each field of ``CutLimit`` in place of its ``limits``.

    The command gets a mapping of the fields' names to what was given, None where nothing was.
    """
    options, fields = [], {}
    for name, kind, words in limit_options():
        given = words.option.removeprefix("--").replace("-", "_")
        default = typer.Option(
            None, words.option, help=words.help, rich_help_panel="Limits",
            metavar=None if kind is float else "LOW HIGH",
        )  # fmt: skip
        fields[given] = name
        options.append(
            Parameter(given, Parameter.KEYWORD_ONLY, default=default, annotation=kind | None)
        )

    @wraps(command)
    def optimised(**given: Any) -> None:
        limits = {name: given.pop(option) for option, name in fields.items()}
        command(**given, limits=limits)

    own = [one.replace(kind=Parameter.KEYWORD_ONLY)
           for one in signature(command).parameters.values()]  # fmt: skip
    place = [one.name for one in own].index("limits")
    every = [*own[:place], *options, *own[place + 1 :]]
    optimised.__signature__ = Signature(every)  # type: ignore[attr-defined]
    optimised.__annotations__ = {one.name: one.annotation for one in every}
    del optimised.__wrapped__
    return optimised


@app.command()
@_with_limits
def optimise(
    *,
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
    model: Model = "champion",
    limits: dict[str, Any],
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
        PartRequest,
        SearchOptions,
        interruptible,
        limits_given,
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
                stock=stock, tool_table=tool_table, material=material, load=limits["load_N"],
                resolution=resolution, work_offset=work_offset, frf=frf,
            ),
            limits=limits_given(limits),
            model=model,
            search=SearchOptions(
                epsilon=epsilon, seed=seed, split=split, speeds=speeds,
                proof_comment=proof_comment,
            ),
        )  # fmt: skip
        check_outputs(program, out, json, page, inputs=request.cut.files)
        try:
            with interruptible(_ending) as ending, stages_bar() as shown:
                result, part = optimise_part(request, lambda w, s: (shown(w, s), ending())[1])
        except KeyboardInterrupt as error:
            typer.echo(
                "kerf: interrupted before anything kept the limits, nothing is written", err=True
            )
            raise typer.Exit(130) from error
        written = write_optimised(result, part, outputs)
    for line in optimise_lines(part):
        typer.echo(line)
    typer.echo(f"wrote {', '.join(str(path) for path in written)}")
    if part.interrupted:
        raise typer.Exit(130)


def _ending() -> None:
    typer.echo("kerf: ending with the best so far; Ctrl-C again to give up", err=True)
