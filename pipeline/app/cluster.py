"""Workers of a cluster, and the machines of a fleet identified at once (`kerf worker`, `identify`).

DVC stays the one driver: it says which identifications are out of date and takes each result as its
stage's own, so that the next ``dvc repro`` finds them up to date.  A worker writes nothing: it runs
a stage in a folder of its own and returns the files.
"""

import os
import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from pipeline.parallel import WORKER, mapped
from pipeline.schema.files import replacing
from pipeline.stages.__main__ import load_stage, run
from pipeline.submodels.contract import submodels

VERB = "identify_"
"""Beginning of the names of the stages that are run at once."""


@dataclass(frozen=True, kw_only=True)
class Identified:
    """Files of an identification by their path in its folder, or the sentence of its error."""

    stage: str
    files: dict[str, bytes]
    error: str = ""


def work_for(scheduler: str, workers: int) -> None:
    """Become ``workers`` processes of one thread each that work for the scheduler at an address."""
    import importlib.util

    if importlib.util.find_spec("distributed") is None:
        raise ValueError("a worker needs Dask: install kerf-twin[cluster]")
    words = [sys.executable, "-m", "distributed.cli.dask_worker", scheduler, "--nthreads", "1",
             "--nworkers", str(workers), "--no-dashboard"]  # fmt: skip
    for name in submodels():  # its first task need not wait seconds for them
        words += ["--preload", f"pipeline.submodels.{name}.submodel"]
    sys.stderr.flush()
    os.execve(sys.executable, words, os.environ | WORKER)


def identify_fleet(
    machines: Collection[str], submodels: Collection[str], say: Callable[[str], None]
) -> list[str]:
    """Identify what DVC calls out of date, all at once, and return the sentences of errors.

    ``machines``, ``submodels``: those that are identified, all where empty; ``say`` takes a line on
    each stage that is done.  A stage that reads the model of another one waits for it.  ValueError
    where an earlier stage is out of date, or DVC knows no such stage.
    """
    from dvc.exceptions import DvcException
    from dvc.repo import Repo

    errors: dict[str, str] = {}
    try:
        with Repo() as repo:
            names = [one.addressing for one in repo.index.stages
                     if _is_wanted(one.addressing, machines, submodels)]  # fmt: skip
            if not names:
                raise ValueError("dvc.yaml has no such identification: name others")
            while wave := _next_wave(stale := _stale(repo, names), names, errors):
                tasks = [(one.addressing, *one.cmd.split()[4:]) for one in wave]
                done = list(zip(wave, mapped(identified, tasks), strict=True))
                errors |= {found.stage: found.error for _, found in done if found.error}
                taken = [(stage, found) for stage, found in done if not found.error]
                for stage, found in taken:
                    _take(stage, found)
                _commit(repo, [stage for stage, _ in taken])
                for _, found in taken:
                    say(f"{found.stage}: {len(found.files)} files")
            for name in set(names) & set(stale) - set(errors):
                errors[name] = f"{name} reads a model that is out of date: identify that one first"
    except DvcException as error:
        raise ValueError(f"DVC: {error}") from error
    return sorted(errors.values())


def _is_wanted(stage: str, machines: Collection[str], submodels: Collection[str]) -> bool:
    name, _, machine = stage.partition("@")
    return (
        name.startswith(VERB)
        and (not machines or machine in machines)
        and (not submodels or name.removeprefix(VERB) in submodels)
    )


def _stale(repo: Any, names: Collection[str]) -> dict[str, Any]:
    """Stages out of date, of those named and all that they start from, in one pass over the graph.

    ``repo.status`` and ``repo.commit`` read dvc.yaml and dvc.lock anew for each stage.
    """
    from dvc.repo import lock_repo

    with lock_repo(repo):
        wanted = set[Any]()
        more = [one for one in repo.index.stages if one.addressing in names]
        while more:
            if (one := more.pop()) not in wanted:
                wanted.add(one)
                more.extend(repo.index.graph.successors(one))
        return {one.addressing: one for one in repo.index.stages
                if one in wanted and one.status(check_updates=True)}  # fmt: skip


def _commit(repo: Any, stages: list[Any]) -> None:
    """Make DVC take what lies where some stages write as theirs, all in one write of its lock."""
    from dvc.repo import lock_repo

    if not stages:
        return
    with lock_repo(repo):
        for one in stages:
            one.save()
            one.commit()
        stages[0].dvcfile.dump_stages(stages, update_pipeline=False)


def _next_wave(
    stale: Mapping[str, Any], names: Collection[str], failed: Collection[str]
) -> list[Any]:
    """Stages out of date that read nothing of another one that is."""
    # a judgement writes beside the model that another identification reads, and changes no model
    before = sorted(one for one in stale if not one.startswith((VERB, "judge_")))
    if before:
        raise ValueError(
            f"{before[0]} is out of date, which identification starts from: run `dvc repro clean "
            "index` first"
        )
    open_ones = [one for name, one in stale.items() if name.startswith(VERB)]
    return [one for one in open_ones
            if one.addressing in names and one.addressing not in failed
            and not any(_feeds(other, one) for other in open_ones)]  # fmt: skip


def _feeds(stage: Any, other: Any) -> bool:
    """Whether ``other`` reads something that ``stage`` writes."""
    read = [Path(dep.fs_path) for dep in other.deps]
    return any(Path(out.fs_path).is_relative_to(one) for out in stage.outs for one in read)


def identified(task: tuple[str, ...]) -> Identified:
    """Run an identification, its name and its paths, in a folder of its own."""
    stage, *paths = task
    at = load_stage(stage.partition("@")[0]).paths.index("folder")
    with TemporaryDirectory() as name:
        paths[at] = name
        try:
            run(stage, *paths, written=name)
        except (ValueError, OSError) as error:
            return Identified(stage=stage, files={}, error=f"{stage}: {error}")
        return Identified(stage=stage, files=dict(_files(Path(name))))


def _files(folder: Path) -> Iterator[tuple[str, bytes]]:
    for path in sorted(one for one in folder.rglob("*") if one.is_file()):
        yield path.relative_to(folder).as_posix(), path.read_bytes()


def _take(stage: Any, found: Identified) -> None:
    """Put the files of an identification where its stage writes them, in place of the old ones."""
    paths = load_stage(found.stage.partition("@")[0]).paths
    folder = Path(stage.cmd.split()[4:][paths.index("folder")])
    for out in stage.outs:
        out.remove(ignore_remove=True)
    for name, content in found.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        with replacing(folder / name) as path:
            path.write_bytes(content)
