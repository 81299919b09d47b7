"""Application of the command kerf: common options, error sentences, progress bar."""

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial
from itertools import takewhile
from logging import ERROR
from pathlib import Path
from threading import Timer
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from pipeline.app.output import LOG, log_to_standard_error
from pipeline.schema.limits import limit_words

_UsageError: Any = typer.BadParameter.__base__
RENAMED = {
    "compensation": "thermal-growth", "--compensate": "--corrected", "--compensated": "--residual",
}  # fmt: skip
"""Commands and options by the names that they had."""
NUMBERS = {"int_parsing": "whole number", "float_parsing": "number"}
"""Names of the numbers that an option takes, by the error of one that is none."""


class OneSentence(TyperGroup):
    """Commands whose wrong options end in one sentence, as all bad input does."""

    def main(self, *args: Any, standalone_mode: bool = True, **more: Any) -> Any:
        """Run a command; its exit status is that of the process."""
        more["standalone_mode"] = False
        if not standalone_mode:
            return super().main(*args, **more)
        try:
            code = super().main(*args, **more)
        except _UsageError as error:
            if type(error).__name__ == "NoArgsIsHelpError":
                error.show()
            else:
                where = f"; see `{error.ctx.command_path} --help`" if error.ctx else ""
                typer.echo(f"kerf: {_usage_sentence(error)}{where}", err=True)
            sys.exit(error.exit_code)
        sys.exit(code if isinstance(code, int) else 0)

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[Any, Any, list[str]]:
        """Refuse an option in the place of a value, and one of a single value that comes twice.

        The parser would take the option for the value, and the last of the values in silence.
        """
        if args and (now := RENAMED.get(args[0])):
            raise _UsageError(f"`kerf {args[0]}` is called `kerf {now}` now", ctx)
        name, command, words = super().resolve_command(ctx, args)
        if ctx.parent is None:
            CALLED.set(tuple(args))
        params: list[Any] = [] if command is None or ctx.resilient_parsing else [*command.params]
        options = {word: one for one in params for word in one.opts if word.startswith("-")}
        given: set[str] = set()
        k = 0
        while k < len(words) and words[k] != "--":
            word, is_joined, _ = words[k].partition("=")
            if word not in options and not word.startswith("--"):
                word, is_joined = words[k][:2], words[k][2:]  # -mNAME
            option: Any = options.get(word)
            many = 0 if option is None or option.is_flag or option.count else option.nargs
            if many and not option.multiple and option.name in given:
                raise _UsageError(f"{word} is given twice and holds one value: give it once")
            given |= {option.name} if many else set()
            many = 0 if is_joined else many
            values = words[k + 1 : k + 1 + many]
            if option and (len(values) < many or any(one in options for one in values)):
                needs = f"{many} values" if many > 1 else "a value"
                alone = " ".join(takewhile(lambda word: word not in options, values))
                lack = f", {alone} alone is given" if alone else ""
                helped = f"{option.help.rstrip('.')}; see `{ctx.command_path} {name} --help`"
                raise _UsageError(f"{words[k]} needs {needs}{lack}: {helped}")
            k += 1 + many
        return name, command, words


def _usage_sentence(error: Any) -> str:
    """What is wrong with an option or argument, and what to give."""
    option = getattr(error, "param", None)
    causes: list[Any] = getattr(error.__cause__, "errors", list)()
    kind = NUMBERS.get(causes[0]["type"]) if causes else None
    if option is not None and kind:
        return f"{option.opts[0]} {causes[0]['input']} is no {kind}: give one"
    if now := RENAMED.get(getattr(error, "option_name", "")):
        return f"{error.option_name} is called {now} now"
    said = str(error.format_message()).replace("Value error, ", "").rstrip(".")
    if said.startswith("Missing option '--machine'"):
        said += f": name the machine as in `{error.ctx.command_path} --machine mill00`"
    return said


CALLED: ContextVar[tuple[str, ...]] = ContextVar("CALLED", default=())
"""Words of the command that runs, from its name on."""
PROJECT = "Project and fleet, as in: kerf fleet demo"
RECORDS = "Records, as in: kerf ingest log.txt --machine mill00 --out read"
MODELS = "Models, as in: kerf promote --machine mill00 --why 'new probe'"
PROGRAMS = "Part programs, as in: kerf simulate part.nc --machine mill00"
"""Groups of commands in the help."""

app = typer.Typer(
    cls=OneSentence,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="The digital twin of a machine tool that rebuilds itself from the machine's own records.",
)


def _version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        typer.echo(f"kerf {version('kerf-twin')}")
        raise typer.Exit


def _work_in(project: Path | None) -> None:
    if project is not None:
        with one_sentence():
            if not project.is_dir():
                raise ValueError(f"{project} is no folder: `kerf init {project}` makes a project")
            os.chdir(project)


@app.callback()
def _options(
    project: Annotated[
        Path | None,
        typer.Option("-C", metavar="PROJECT", callback=_work_in, help="Work in this folder."),
    ] = None,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Say it and end.")
    ] = False,
    verbose: Annotated[
        int,
        typer.Option(
            "--verbose", "-v", count=True,
            help="Say on standard error what each step read, found and took; -vv says more.",
        ),
    ] = 0,
    quiet: Annotated[
        bool, typer.Option("--quiet", "-q", help="Say only results and errors.")
    ] = False,
) -> None:  # fmt: skip
    """Options before the command's name."""
    log_to_standard_error(verbose, quiet)


def _machines(incomplete: str) -> list[str]:
    return sorted(path.stem for path in Path("conf/machine").glob(f"{incomplete}*.yaml"))


Machine = Annotated[
    str,
    typer.Option("--machine", "-m", help="Machine, as in conf/machine/.", autocompletion=_machines),
]
Program = Annotated[Path, typer.Argument(help="A part program.")]
Setup = Annotated[
    str | None,
    typer.Option(
        "--machine", "-m", help="Machine whose offsets and tools hold.", autocompletion=_machines
    ),
]
DialectName = Literal["fanuc", "linuxcnc", "siemens"]
Dialect = Annotated[
    DialectName | None,
    typer.Option(help="Dialect of the program; the machine's by default."),
]
Unit = Annotated[str | None, typer.Option(help="Unit, of several machines of a kind.")]
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
Material = Annotated[str | None, typer.Option(help="Material, as in conf/material/.")]
Load = Annotated[
    list[str] | None, typer.Option(help=limit_words("load_N")[0].help, metavar="N|T5=N")
]
Resolution = Annotated[float | None, typer.Option(help="Resolution of the blank, mm; 0.2.")]
WorkOffset = Annotated[
    str | None, typer.Option(help="Work offset of the blank; that of the first cut by default.")
]
Responses = Annotated[
    list[str] | None,
    typer.Option(help="Frequency response at the tools' tips: x=TIP.csv, y=TIP.csv or a UFF."),
]
Wear = Annotated[
    list[str] | None,
    typer.Option(
        help="Flank wear of a tool, T26=120 in um, again for more; or for all tools sharp, "
        "criterion (worn so far that it is changed) or known (as measured)."
    ),
]
WithResidual = Annotated[
    bool,
    typer.Option("--residual", help="Following errors with what the network adds to them."),
]
ModelName = Literal["champion", "latest"]
Model = Annotated[ModelName, typer.Option(help="Sub-models that serve, or the latest.")]
FormatName = Literal["csv", "fanuc", "siemens"]
Format = Annotated[FormatName, typer.Option(help="Format of the file.")]
ObjectiveName = Literal["time", "cost", "energy", "wear", "pareto"]
Objective = Annotated[
    ObjectiveName, typer.Option(help="What is made least; pareto takes the knee of their front.")
]
SpeedsName = Literal["blocks", "own"]
Speeds = Annotated[
    SpeedsName | None,
    typer.Option(help="S words at any block, or only the program's own.", rich_help_panel="Limits"),
]
Anyway = Annotated[
    bool, typer.Option("--anyway", help="Even when the model failed or was not judged.")
]
Conditions = Annotated[
    list[str] | None, typer.Option("--set", help="A condition, name=value; again for more.")
]
Json = Annotated[Path | None, typer.Option("--json", help="JSON to write, - for standard output.")]


@contextmanager
def one_sentence() -> Iterator[None]:
    """Bad input ends in one sentence and exit status 2, not in a traceback."""
    try:
        yield
    except BrokenPipeError:  # who reads standard output has seen enough
        raise
    except (ValueError, OSError) as error:
        typer.echo(f"kerf: {error}", err=True)
        raise typer.Exit(2) from error


@contextmanager
def _bar(what: str, total: float = 1.0) -> Iterator[Callable[..., None]]:
    """``update`` of a bar on standard error when a person looks; in a log it does nothing."""
    if not sys.stderr.isatty():
        yield lambda **changes: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        yield partial(bar.update, bar.add_task(what, total=total))


@contextmanager
def steps_bar(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A bar that goes one step ahead with each name."""
    with _bar(what, total) as update:
        yield lambda name: update(advance=1, description=f"{what} {name}")


@contextmanager
def share_bar(what: str) -> Iterator[Callable[[float], None]]:
    """A bar that shows which share is done."""
    with _bar(what) as update:
        yield lambda done: update(completed=done)


@contextmanager
def stages_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar that shows what is under way, which share is done, and the time that is left."""
    with _bar("reading") as update:
        yield lambda what, done: update(completed=done, description=what)


PATIENCE_S = 2.0
"""Time after which a command says what it is about [s]."""


@contextmanager
def progress_line(what: str) -> Iterator[None]:
    """A line once something takes longer than ``PATIENCE_S``; none if quiet, or nobody looks on."""
    timer = Timer(PATIENCE_S, partial(typer.echo, f"{what} …", err=True))
    timer.daemon = True
    if LOG.level < ERROR and sys.stderr.isatty():
        timer.start()
    try:
        yield
    finally:
        timer.cancel()
