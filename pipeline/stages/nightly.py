"""Stage: score the champion of a machine on the nights that it has not seen."""

from pathlib import Path

from pipeline.fleet import Fleet
from pipeline.monitoring.budget import MonitoringSettings
from pipeline.monitoring.nightly import score_nights
from pipeline.parameters import read_params
from pipeline.schema.golden import read_golden
from pipeline.schema.ledger import read_ledger, write_ledger
from pipeline.submodels.cases import Records


def nightly(
    champion: Path,
    raw: Path,
    signals: Path,
    clean: Path,
    golden: Path,
    ledger: Path,
    *,
    fleet: Fleet,
    monitoring: MonitoringSettings,
) -> None:
    """Append to the ledger the nights that it does not hold yet; a night is scored once."""
    under = fleet.drives_under.get(champion.name)
    records = Records.of_machine(
        champion.parents[1], champion.name, champion, None if under is None else Path(under)
    )
    known = read_ledger(ledger)
    new = score_nights(
        champion, records, known, sets=read_golden(golden / f"{champion.name}.json"),
        values=read_params(), settings=monitoring,
    )  # fmt: skip
    write_ledger((*known, *new), ledger)
