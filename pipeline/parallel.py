"""Parallel execution in this process, in its threads, or in processes beside it.

A task carries all that its result depends on, its random seed included, and linear algebra has one
thread wherever a task runs, so that the results are the same bits in every place.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Generic, Literal, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

Compute = Literal["serial", "threads", "processes"]
"""``threads`` only helps compiled kernels that let go of the interpreter."""


@dataclass(frozen=True)
class _Done(Generic[Result]):
    """Result of a task, or the error that ended it in a form that travels between processes."""

    result: Result | None = None
    error: tuple[type[Exception], tuple[Any, ...], dict[str, Any]] | None = None


def workers_for(tasks: int, workers: int | None = None) -> int:
    """Number of workers for some tasks: ``workers``, or the cores that this process may use."""
    available = workers or len(os.sched_getaffinity(0))
    return max(1, min(available, tasks))


def mapped(
    function: Callable[[Task], Result],
    tasks: Iterable[Task],
    *,
    compute: Compute = "processes",
    workers: int | None = None,
) -> list[Result]:
    """``function`` of each task, in the order of the tasks.

    ``function``: for ``processes`` with a result that pickles; ``tasks``: its arguments, random
    seeds included; ``compute``: where the tasks run, a single one always here; ``workers``: at most
    this many at once, None for one a core.  Raises the ValueError or OSError of the first task in
    their order; any other error as soon as a task raises it.

    >>> mapped(abs, [-2, 1], compute="serial")
    [2, 1]
    """
    todo = list(tasks)
    many = workers_for(len(todo), workers)
    if compute not in ("serial", "threads", "processes"):
        raise ValueError(f"compute = {compute!r}: give serial, threads or processes")
    if compute == "processes" and many > 1:
        return _processes(function, todo, many)
    return _here(function, todo, many if compute == "threads" else 1)


def _here(function: Callable[[Task], Result], tasks: Sequence[Task], threads: int) -> list[Result]:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        if threads == 1:
            return [function(task) for task in tasks]
        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(function, tasks))


def _processes(
    function: Callable[[Task], Result], tasks: Sequence[Task], workers: int
) -> list[Result]:
    from joblib import Parallel, delayed, parallel_config

    with parallel_config(backend="loky", n_jobs=workers, inner_max_num_threads=1):
        done = Parallel()(delayed(_attempted)(function, task) for task in tasks)
    for one in done:
        if one.error is not None:
            raise _rebuilt(*one.error)
    return [one.result for one in done]


def _attempted(function: Callable[[Task], Result], task: Task) -> _Done[Result]:
    """Result of one task; bad input becomes a value, so that the first error is that of serial."""
    try:
        return _Done(result=function(task))
    except (ValueError, OSError) as error:
        args = error.args
        if isinstance(error, OSError) and error.errno is not None:  # args lacks the file's name
            args = (error.errno, error.strerror, error.filename)
        return _Done(error=(type(error), args, dict(error.__dict__)))


def _rebuilt(kind: type[Exception], args: tuple[Any, ...], state: dict[str, Any]) -> Exception:
    """Error with its type, sentence and fields, whatever its constructor needs."""
    error = kind.__new__(kind, *args)
    error.args = error.args or args
    error.__dict__.update(state)
    return error
