"""Part programs on the command line: interpretation, planning, prediction."""

import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from pipeline.app.fleet import DATA, machine_parameters, outside_fleet
from pipeline.app.output import LOG, check_outputs
from pipeline.app.tables import section
from pipeline.cutting.economics.spindle_power import SpindleDrive
from pipeline.gcode.errors import NO_BLOCK
from pipeline.gcode.interpret import interpret, interpret_in_parts
from pipeline.gcode.moves import Moves
from pipeline.gcode.program import Program, output_lines, read_program
from pipeline.gcode.setup import MachineLimits, Setup, setup_beside
from pipeline.machine.control.parameters import ControlParameters, of_dialect
from pipeline.parameters import RENAMED, structure
from pipeline.schema.files import replacing
from pipeline.schema.store import read_json
from pipeline.schema.verdict import UsedModel, Verdict
from pipeline.twin.preflight import Preflight, limits_of, preflight

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.optimisation.job import MachineModels
    from pipeline.optimisation.settings import OptimisationSettings
    from pipeline.submodels.contract import SubModel
    from pipeline.twin.program_axes import Residual


Share = Callable[[float], None]


CHAMPION, LATEST = "champion", "latest"
"""Sub-models that a command uses: the champion's, or the latest."""


PACKED: dict[str, Literal["gzip", "bz2", "xz", "zstd"]] = {
    ".gz": "gzip", ".bz2": "bz2", ".xz": "xz", ".zst": "zstd",
}  # fmt: skip
"""Compression of a table by the end of its file's name."""
UNITS_HEAD = 100_000
"""Bytes of a program in which its unit is looked for."""
VERDICT_WORDS = {
    "passed": "passed", "failed": "failed", "not decided": "was not decided",
    "not judged": "was not judged",
}  # fmt: skip
"""Words for a model's verdict in a sentence."""


@dataclass(frozen=True, kw_only=True)
class Controlled:
    """A machine with its control: identified, or as in conf/machine/."""

    machine: str
    """Name of the machine."""
    control: ControlParameters
    """Control of the unit."""
    identified: bool
    """Whether it was identified."""
    unit: str = ""
    """Unit among several machines of a kind; empty where there is one."""
    chosen: bool = False
    """Whether the user named it."""
    units: tuple[str, ...] = ()
    """All units of the machine."""
    origin: str
    """Origin of the machine's records."""
    setup: Setup
    """Setup of the machine."""
    parameters: dict[str, Any]
    """Composition of conf/ with this machine."""
    models: Path
    """Folder of the sub-models that are used: the champion's, or the latest ones."""

    @property
    def sections(self) -> dict[str, Any]:
        """Sections of the machine's file."""
        return self.parameters["machine"][self.machine]

    def preflight(self, moves: Moves) -> Preflight:
        """Moves held against the machine's travel, speeds, feeds and tool lengths."""
        return preflight(moves, self.setup, machine_limits(self.sections, self.setup))

    @property
    def source(self) -> str:
        """Origin of the control, for documents."""
        return "identified" if self.identified else "conf/machine"

    @property
    def optimisation(self) -> "OptimisationSettings":
        """Settings and uncertainty of the optimisation of programs."""
        from pipeline.optimisation.settings import OptimisationSettings

        return structure(self.parameters, "optimisation", OptimisationSettings)

    @cached_property
    def identified_models(self) -> "MachineModels":
        """Models that were identified of the machine, read once."""
        from pipeline.optimisation.job import machine_models
        from pipeline.submodels.wear.machine_wear import machine_wear

        return machine_models(self.models, self.control, machine_wear(self.models))

    @property
    def used(self) -> tuple[UsedModel, ...]:
        """Sub-models that figures rest on, with their verdicts, the gravest first."""
        from pipeline.optimisation.reliability.uncertainty import used_models

        return used_models(self.identified_models.verdicts, self.optimisation.certainty)


def machine_setup(machine: str | None, dialect: str | None) -> Setup:
    """The set-up of ``machine`` (a Fanuc without offsets when it has none), in ``dialect``."""
    sections = {} if machine is None else machine_parameters(machine)["machine"][machine]
    setup = section(sections, "setup", Setup) or Setup()
    return setup if dialect is None else replace(setup, dialect=dialect)  # type: ignore[arg-type]


def machine_limits(sections: Mapping[str, Any], setup: Setup) -> MachineLimits:
    """Limits of a machine's file: those of its set-up, else of spindle drive and control."""
    known = dict(sections)
    drive = section(known, "spindle_drive", SpindleDrive)
    control = section(known, "control", ControlParameters)
    return limits_of(setup, control, None if drive is None else drive.top_speed_rpm)


def moves_in_parts(path: Path, setup: Setup, share: Share, rows: int) -> Iterator[Moves]:
    """The moves of :func:`read_moves` in parts of at least ``rows``."""
    return interpret_in_parts(*_followed(path, setup, share), rows)


def read_moves(path: Path, setup: Setup, share: Share) -> Moves:
    """Moves of the program at ``path``; ``share`` is called with the share done."""
    moves = interpret(*_followed(path, setup, share))
    if len(moves) == 0:
        raise ValueError(NO_BLOCK.format(path.name))
    return moves


def _followed(
    path: Path, setup: Setup, share: Share
) -> tuple[Program, Setup, Callable[[int], None]]:
    program = program_at(path)
    lines = max(len(program), 1)
    return program, setup_beside(setup, path), lambda done: share(min(done / lines, 1.0))


def passed_over(path: Path, setup: Setup) -> Iterator[str]:
    """Words of a program that move nothing and are not followed, a line of text each."""
    program = program_at(path)
    said = units_assumed(program, setup)
    if said:
        yield f"{path.name}: {said}"
    if setup.dialect != "fanuc":
        return
    blocks = [] if program.ends_blocks else program.remarked_blocks()
    if blocks:
        yield (
            f"{path.name}: what stands behind ; is a comment here and was left out "
            f"({_first_lines(blocks)}): end each line of code with ; where it ends blocks"
        )
    for word, places in output_lines(program.data).items():
        yield (
            f"{path.name}: {word} is passed over ({_first_lines(places)}): it writes to a device "
            "or names variables, and moves nothing"
        )


def _first_lines(lines: Sequence[int]) -> str:
    return f"line {', '.join(map(str, lines[:5]))}{' …' * (len(lines) > 5)}"


_UNITS = re.compile(rb"(?i)G0*(?:2[01]|7[01]0?)(?![.\d])|[XYZ]\s*=?[-+.\d#\[]")


def units_assumed(program: Program, setup: Setup) -> str:
    """Assumed unit of a program that moves before it states one; empty where it does."""
    first = _UNITS.search(re.sub(rb"\([^)\n]*\)|;[^\n]*", b"", program.data[:UNITS_HEAD]))
    if first is None or first[0][:1] in b"Gg":
        return ""
    codes = "G70 nor G71" if setup.dialect == "siemens" else "G20 nor G21"
    unit, other = ("inches", "false") if setup.inch else ("millimetres", "true")
    return (
        f"neither {codes} comes before the first move: {unit} are assumed; set setup.inch: {other} "
        "in the machine's file where the control starts in the other unit"
    )


def program_at(path: Path) -> Program:
    """Program in a file."""
    check_program(path)
    return read_program(path)


def check_program(path: Path) -> None:
    """Refuse a path that is no file."""
    if not path.is_file():
        state = "is no file" if path.exists() else "does not exist"
        raise ValueError(f"{path} {state}: name a part program")


def write_csv(table: "pd.DataFrame", out: Path) -> None:
    """Write a table as CSV, packed where the end of the file's name says so (``.gz``)."""
    with replacing(out) as part:
        table.to_csv(part, index=False, compression=PACKED.get(out.suffix))


def model_folder(machine: str, model: str = CHAMPION) -> Path:
    """Folder of the sub-models of a machine that a command uses."""
    if model == CHAMPION:
        return DATA / "champion" / machine
    if model != LATEST:
        raise ValueError(f"--model {model} is neither champion nor latest: name one of them")
    if not (DATA / "models" / machine).is_dir():
        why = outside_fleet(machine) or "run `dvc repro` to identify it"
        raise ValueError(f"data/models/{machine} does not exist: {why}")
    return DATA / "models" / machine


def stored_model(machine: str, model: str, one: "SubModel[Any, Any, Any]") -> Path:
    """Folder of one sub-model's model."""
    folder = model_folder(machine, model) / one.name
    if not (folder / "model.json").exists():
        why = outside_fleet(machine) or f"{machine} needs {one.needs}"
        raise ValueError(f"{folder} holds no model: {why}")
    return folder


def model_lines(head: str, models: Path, status: str, name: str) -> Iterator[str]:
    """Head of a report on one model's answer, with what is to be known of the model."""
    yield head
    if "champion" not in models.parts:
        yield f"with {models.as_posix()}, not with the champion"
    if status != "passed":
        yield f"WARNING: the {name} {VERDICT_WORDS[status]}"


def passed_status(folder: Path, name: str, use: str = "use it", *, anyway: bool) -> str:
    """Status of the verdict beside a model; what serves or is used without a pass is warned of.

    Refused where it neither passed nor serves, unless ``anyway``.
    """
    path = folder / "verdict.json"
    verdict = read_json(path, Verdict) if path.exists() else None
    status = "not judged" if verdict is None else verdict.status
    if status == "passed":
        return status
    serves = _serving_words(folder)
    if not (anyway or serves):
        why = f" ({verdict.reasons[0]})" if verdict is not None and verdict.reasons else ""
        raise ValueError(
            f"the {name} in {folder} {VERDICT_WORDS[status]}{why}: mend that first, or {use} with "
            "--anyway"
        )
    LOG.warning("the %s %s%s", name, VERDICT_WORDS[status],
                serves or ": use this for trials alone")  # fmt: skip
    return status


def _serving_words(folder: Path) -> str:
    """By whom a champion's sub-model was put into service; empty where it does not serve."""
    from pipeline.champions.serving import history_of
    from pipeline.schema.history import served

    if folder.parent.parent != DATA / CHAMPION:
        return ""
    for last in served(history_of(folder.parent.name))[-1:]:
        if folder.name in last.serving:
            how = "against the rules, by --anyway" if last.anyway else "by the rules"
            return (
                f"; it serves {how}, as {last.by} {last.event} version {last.version} on "
                f"{last.at}: {last.why}"
            )
    return ""


def machine_control(machine: str, unit: str | None, model: str = CHAMPION) -> Controlled:
    """The machine with its control: the one of ``model``, else that of its file."""
    from pipeline.twin.control import control_of_unit, read_controls

    parameters = machine_parameters(machine)
    sections, models = parameters["machine"][machine], model_folder(machine, model)
    records = sections.get("control_records", {})
    setup = section(sections, "setup", Setup) or Setup()
    units, default = tuple(records.get("units", ())), str(records.get("default_unit", ""))
    if unit is not None and unit not in units:
        if not units:
            raise ValueError(f"{machine} has no units: leave --unit out")
        raise ValueError(f"{machine} has no unit {unit!r}: name one of {', '.join(units)}")
    found = models / "control/model.json"
    if found.exists():
        control = control_of_unit(read_controls(found), unit or default)
    elif "control" in sections:
        known = of_dialect(sections["control"], setup.dialect)
        control = structure({"control": known}, "control", ControlParameters)
    else:
        raise ValueError(
            f"conf/machine/{machine}.yaml has no section control and none was identified: "
            "write its axes there, or log runs of programs and run `dvc repro`"
        )
    return Controlled(
        machine=machine, unit=unit or default, chosen=unit is not None, units=units,
        control=control, identified=found.exists(), setup=setup, parameters=parameters,
        origin=str(sections["identity"].get("origin", "recorded")), models=models,
    )  # fmt: skip


def machine_residual(on: Controlled) -> "tuple[Residual, str]":
    """The residual network of a machine with its name."""
    from pipeline.submodels.following_residual.model import residual_of

    needed_drives(on, "--residual")
    residual, name = residual_of(on.models)
    if residual is None:
        raise ValueError(
            f"{on.models / 'following_residual'} holds no residual model that passed: leave "
            f"--residual out, or record the axes of {on.machine} and run `dvc repro`"
        )
    return residual, name


def needed_drives(on: Controlled, option: str) -> Path:
    """File of the machine's identified drives, which an option needs."""
    found = on.models / "drive/model.json"
    if not found.exists():
        raise ValueError(
            f"{found} does not exist: {option} needs the feed drives of {on.machine}, record their "
            "servos and run `dvc repro`"
        )
    return found


def verdict_lines(models: Iterable[UsedModel]) -> Iterator[str]:
    """One line a sub-model that figures rest on; what failed or was not judged is marked."""
    for one in models:
        yield f"{'WARNING: ' if one.doubtful else '  '}{one.sentence}"


def predict_table(
    machine: str, name: str, table: Path, out: Path, model: str, *, anyway: bool
) -> tuple[int, tuple[str, ...]]:
    """Predict a table of a sub-model's inputs with a machine's champion.

    Refused where it did not pass, unless ``anyway``.  The number of rows, and a sentence on each
    interval that is not known, whose columns are empty.
    """
    import pandas as pd

    from pipeline.submodels.contract import submodel

    machine_parameters(machine)  # refuses one that is not known
    if now := RENAMED.get(name):
        raise ValueError(f"the sub-model {name} is called {now} now: give that name")
    one = submodel(name)
    folder = stored_model(machine, model, one)
    passed_status(folder, f"model of {name}", anyway=anyway)
    check_outputs(table, out)
    try:
        read = pd.read_parquet if table.suffix == ".parquet" else pd.read_csv
        given = read(table)
    except (OSError, ValueError, EOFError, zlib.error) as error:
        if not table.is_file():
            raise ValueError(f"{table} is no file: name a table of inputs") from error
        kind = "Parquet" if table.suffix == ".parquet" else "CSV"
        state = f"is no table of {kind}, or is cut off" if table.stat().st_size else "is empty"
        raise ValueError(f"{table} {state}: give a table of inputs") from error
    try:
        found = one.answer(folder)(given)
    except KeyError as error:
        raise ValueError(f"{table} has no column {error}: give the inputs of {name}") from error
    if set(found.columns) <= set(given.columns):
        wanted = ", ".join(map(str, one.example(folder).columns))
        raise ValueError(f"{table} has the inputs of no axis: give the columns {wanted}")
    if out.suffix == ".parquet":
        with replacing(out) as part:
            found.to_parquet(part, compression="zstd")
    else:
        write_csv(found, out)
    unknown: dict[str, list[str]] = {}
    for column, why in one.unknown_columns(folder).items():
        if column in found:
            unknown.setdefault(why, []).append(column)
    notes = [f"{', '.join(names)}: {why}" for why, names in unknown.items()]
    return len(found), tuple(notes)
