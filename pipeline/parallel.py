"""Parallel execution in this process, in its threads, in processes beside it, or on a Dask cluster.

A task carries all that its result depends on, its random seed included, and linear algebra has one
thread wherever a task runs, so that the results are the same bits in every place.  Tasks for
processes go where the variable ``KERF_COMPUTE`` says: ``serial``, ``processes`` (as without it), or
the address of a Dask scheduler.  It is no setting of a model: no result depends on it.

A cluster holds each task with its arguments at the scheduler until its result is here, so that the
task of a worker that died runs again on another one.  Tasks within a task run one after the other.
"""

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")

Compute = Literal["serial", "threads", "processes", "dask"]
"""``threads`` only helps compiled kernels that let go of the interpreter; ``dask`` are
``processes`` that must run on a cluster."""
PLACE = "KERF_COMPUTE"
"""Variable with the place of tasks for processes."""
SAME_BITS = {
    "OMP_NUM_THREADS": "1",  # the same sums in the same order; narrow matrices gain three times
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_CORETYPE": "Haswell",
    "NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL AVX512_SPR",
    "ATEN_CPU_CAPABILITY": "avx2",
    "ONEDNN_MAX_CPU_ISA": "AVX2",
    "MKL_CBWR": "COMPATIBLE",
}
"""Variables that the libraries read when they are loaded; workers inherit them."""
WORKER = {**SAME_BITS, PLACE: "serial"}
"""Variables of a worker of a cluster: its tasks have the bits of a stage and its one core."""
LIBRARIES = ("numpy", "scipy", "pandas", "scikit-learn", "numba", "torch")
"""Libraries that must have the same version on a worker as here."""
WAIT_S = 60.0
"""Time that a cluster without a worker is waited for [s]."""


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
    this many at once, None for one a core; all workers of a cluster take part.  Raises the
    ValueError or OSError of the first task in their order; any other error as soon as a task raises
    it; OSError where a cluster cannot be reached or its workers run other code.

    >>> mapped(abs, [-2, 1], compute="serial")
    [2, 1]
    """
    todo = list(tasks)
    many = workers_for(len(todo), workers)
    place = _place(compute)
    if "://" in place and len(todo) > 1:
        return _results(_on_cluster(function, todo, place))
    if place == "processes" and many > 1:
        return _results(_processes(function, todo, many))
    return _here(function, todo, many if place == "threads" else 1)


def _place(compute: str) -> str:
    """``serial``, ``threads``, ``processes``, or the address of a scheduler."""
    if compute not in ("serial", "threads", "processes", "dask"):
        raise ValueError(f"compute = {compute!r}: give serial, threads, processes or dask")
    if compute in ("serial", "threads"):
        return compute
    place = os.environ.get(PLACE) or "processes"
    if place not in ("serial", "processes") and "://" not in place:
        raise ValueError(
            f"{PLACE} = {place!r}: give serial, processes or the address of a Dask scheduler, such "
            "as tcp://10.0.0.5:8786"
        )
    if compute == "dask" and place == "processes":
        raise ValueError(
            f"compute = 'dask' without a cluster: give the address of its scheduler in {PLACE}, "
            "such as tcp://10.0.0.5:8786"
        )
    return place


def _here(function: Callable[[Task], Result], tasks: Sequence[Task], threads: int) -> list[Result]:
    from threadpoolctl import threadpool_limits

    with threadpool_limits(1):
        if threads == 1:
            return [function(task) for task in tasks]
        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(function, tasks))


def _processes(
    function: Callable[[Task], Result], tasks: Sequence[Task], workers: int
) -> "list[_Done[Result]]":
    from joblib import Parallel, delayed, parallel_config

    with parallel_config(backend="loky", n_jobs=workers, inner_max_num_threads=1):
        found: list[_Done[Result]] = Parallel()(delayed(_attempted)(function, one) for one in tasks)
    return found


def _results(done: "Sequence[_Done[Result]]") -> list[Result]:
    """Results, or the first error in the order of the tasks."""
    for one in done:
        if one.error is not None:
            raise _rebuilt(*one.error)
    return [one.result for one in done]  # type: ignore[misc]  # no error: a result


def _on_cluster(
    function: Callable[[Task], Result], tasks: Sequence[Task], address: str
) -> "list[_Done[Result]]":
    """Outcomes of tasks on a cluster; arguments stay at the scheduler (joblib gives them to workers
    and loses those of workers that die).
    """
    client = _client(address)
    from distributed import KilledWorker

    work = partial(_on_worker, _code(), function)
    try:
        found: list[_Done[Result]] = client.gather(client.map(work, tasks, pure=False))
    except KilledWorker as error:
        raise OSError(
            f"a task ended {error.last_worker.address} and the workers that had it before: look "
            "into their logs, most of all for memory"
        ) from error
    return found


@cache
def _client(address: str) -> Any:
    """Connection to a scheduler that has a worker, one in the life of this process."""
    try:
        from distributed import Client
    except ModuleNotFoundError as error:
        raise ValueError(f"{PLACE} = {address!r} needs Dask: install kerf-twin[cluster]") from error
    try:
        client = Client(address, set_as_default=False)
    except (OSError, ValueError) as error:
        raise OSError(f"no Dask scheduler answers at {address}: {error}") from error
    try:
        client.wait_for_workers(1, timeout=WAIT_S)
    except TimeoutError as error:
        raise OSError(
            f"the scheduler at {address} has no worker: start one by `kerf worker {address}`"
        ) from error
    return client


def _on_worker(code: str, function: Callable[[Task], Result], task: Task) -> "_Done[Result]":
    """Outcome of a task where code, libraries and variables are those of who sent it."""
    from threadpoolctl import threadpool_limits

    unlike = sorted(name for name, value in WORKER.items() if os.environ.get(name) != value)
    if unlike:
        said = f"a worker runs without {unlike[0]}={WORKER[unlike[0]]}: start it by `kerf worker`"
        return _Done(error=(OSError, (said,), {}))
    if code != _code():
        said = f"the worker in {Path.cwd()} has other code or libraries: bring it to this state"
        return _Done(error=(OSError, (said,), {}))
    with threadpool_limits(1):
        return _attempted(function, task)


@cache
def _code() -> str:
    """Digest of the code that a task may run, and of the versions of its libraries."""
    from hashlib import sha256
    from importlib.metadata import version

    found = sha256(" ".join(map(version, LIBRARIES)).encode())
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        found.update(path.read_bytes())
    return found.hexdigest()


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
