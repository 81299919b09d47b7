"""What every command does around its work: one sentence for bad input, a bar while it waits."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer


@contextmanager
def one_sentence() -> Iterator[None]:
    """Bad input ends in one sentence and exit status 2, not in a traceback."""
    try:
        yield
    except (ValueError, OSError) as error:
        typer.echo(f"kerf: {error}", err=True)
        raise typer.Exit(2) from error


@contextmanager
def steps_bar(what: str, total: int) -> Iterator[Callable[[str], None]]:
    """A bar on standard error when a person looks, nothing in a log."""
    if not sys.stderr.isatty():
        yield lambda name: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)

        def advance(name: str) -> None:
            bar.update(task, advance=1, description=f"{what} {name}")

        yield advance


@contextmanager
def share_bar(what: str) -> Iterator[Callable[[float], None]]:
    """A bar that is told which share is done, on standard error when a person looks."""
    if not sys.stderr.isatty():
        yield lambda done: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def stages_bar() -> Iterator[Callable[[str, float], None]]:
    """A bar that is told what is under way and which share is done, with the time that is left."""
    if not sys.stderr.isatty():
        yield lambda what, done: None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading", total=1.0)
        yield lambda what, done: bar.update(task, completed=done, description=what)
