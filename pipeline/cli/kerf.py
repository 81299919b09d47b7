"""The command itself; its parts are the modules beside this one."""

import typer

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="The digital twin of a machine tool that rebuilds itself from the machine's own records.",
)
