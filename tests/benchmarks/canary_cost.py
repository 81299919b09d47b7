"""Share of the canaries in the processor time of each judgement of a project that is built.

``python tests/benchmarks/canary_cost.py`` in the project; what is judged is written elsewhere.
"""

import sys
from pathlib import Path
from shutil import copytree
from tempfile import TemporaryDirectory
from time import process_time

import pipeline.submodels.judge as judging
from pipeline.fleet import Fleet
from pipeline.parameters import read_params, section_path, structure
from pipeline.stages.identify import judge
from pipeline.submodels.contract import sections, submodel


def costs(machine: str, name: str) -> tuple[float, float]:
    """Time of the canaries and of the whole judgement of a sub-model [s]."""
    one, values, spent = submodel(name), read_params(), []
    settings = one.judging(**{
        section: structure(values, section_path(values, section, machine), wanted)
        for section, wanted in sections(one.judging).items()
    })  # fmt: skip
    probe = judging.canaries

    def timed(*words):
        began = process_time()
        found = probe(*words)
        spent.append(process_time() - began)
        return found

    judging.canaries = timed
    try:
        with TemporaryDirectory() as place:
            folder = Path(place) / name
            copytree(f"data/models/{machine}/{name}", folder)
            reads = {read: Path("data") / read / machine for read in one.reads}
            reads |= {"manifest": Path("data/signals") / machine / "manifest.json"}
            reads = {read: path for read, path in reads.items() if read in one.reads}
            began = process_time()
            judge(one, reads, folder, Path("data/golden"), Path(place) / "m.json",
                  Path(place) / "plots", settings=settings)  # fmt: skip
            return sum(spent), process_time() - began
    finally:
        judging.canaries = probe


if __name__ == "__main__":
    fleet = structure(read_params(), "fleet", Fleet)
    for machine in fleet.machines:
        for name in fleet.submodels_of(machine):
            own, whole = costs(machine, name)
            sys.stdout.write(
                f"{machine} {name:20} {own:6.2f} of {whole:6.2f} s {100 * own / whole:5.1f} %\n"
            )
            sys.stdout.flush()
