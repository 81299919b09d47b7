"""Stage: what the champion of a machine estimates over its production records."""

from pathlib import Path

from pipeline.cutting.tool import ToolTable
from pipeline.fleet import Fleet
from pipeline.monitoring.state import write_twin_state
from pipeline.parameters import read_params, structure
from pipeline.schema.bundle import read_champions
from pipeline.schema.golden import read_golden
from pipeline.signals.cleaning.settings import CleanMachine, CleanSettings
from pipeline.stages.optimise import named
from pipeline.submodels.cases import Records, Roles


def state(
    champion: Path,
    champions: Path,
    raw: Path,
    signals: Path,
    clean: Path,
    golden: Path,
    written: Path,
    *,
    fleet: Fleet,
    cleaning: CleanSettings,
    mapping: CleanMachine,
    tool: dict[str, ToolTable],
) -> None:
    """Write the state of all days and recordings, and the manifest that says what is not known."""
    name = champion.name
    under = fleet.drives_under.get(name)
    records = Records.of_machine(
        champion.parents[1], name, champion, None if under is None else Path(under)
    )
    values, path = read_params(), f"machine.{name}.roles"
    own = "roles" in values["machine"][name]  # a machine that nothing is fitted on has none
    tables = [named(tool, one, "tool").tools for one in mapping.tool_tables]
    write_twin_state(
        champion, records, written, roles=structure(values, path, Roles) if own else Roles(),
        cleaning=cleaning, sets=read_golden(golden / f"{name}.json"), values=values,
        tools={number: one.diameter for table in tables for number, one in table.items()},
        chosen=read_champions(champions).machines.get(name),
    )  # fmt: skip
