"""Records from outside: small logs and tables of kinds that were once stored wrongly or refused."""

from pathlib import Path

import nptdms
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from scipy.io import wavfile

from pipeline.app.fleet import use_fleet
from pipeline.app.machine import machine_text, propose
from pipeline.cutting.stability.tip_dynamics import read_frf
from pipeline.registry.store import client_of, experiment_of, versions
from pipeline.signals.formats import (
    Batch,
    ColumnSource,
    RecordSource,
    Rejection,
    TableLayout,
    Trace,
    UnreadableFile,
    format_of,
)
from pipeline.signals.mtconnect import xml_document
from pipeline.signals.shdr import log
from pipeline.signals.tables import cells, columnar, csv_table
from pipeline.submodels.control.runs import read_runs
from pipeline.submodels.deformation.features import input_maker
from pipeline.submodels.deformation.methods import growth_record
from pipeline.submodels.deformation.records import State
from tests.signals.shdr_log import line_by_line
from tests.submodels.deformation.growth_files import made

ITEM = '<DataItem id="{id}" name="{name}" category="{category}" type="{type}"/>'


def device(label: str, *items: tuple[str, str, str, str]) -> str:
    inside = "".join(ITEM.format(id=i, name=n, category=c, type=t) for i, n, c, t in items)
    return (
        f'<Device id="{label}_d" name="{label}" uuid="{label}_u"><DataItems>{inside}'
        "</DataItems></Device>"
    )


def position(label: str) -> str:
    return device(label, (f"{label}_x", "Xact", "SAMPLE", "POSITION"))


TWO_PATHS = device(
    "M1", ("p1_ex", "execution", "EVENT", "EXECUTION"), ("p2_ex", "execution", "EVENT", "EXECUTION")
)


def devices(folder: Path, *inside: str) -> Path:
    path = folder / "Devices.xml"
    path.write_text(f"<MTConnectDevices><Devices>{''.join(inside)}</Devices></MTConnectDevices>")
    return path


def logged(folder: Path, text: str, **options: str) -> tuple[dict[str, list[float]], list[str]]:
    """Numbers by item and reasons of rejection; both ways through a log agree."""
    path = folder / "log.txt"
    path.write_text(text)
    source = RecordSource(format="shdr", files="*.txt", devices="Devices.xml", **options)  # type: ignore[arg-type]
    ways = [said(list(way(path, source, folder))) for way in (line_by_line, log.read)]
    assert ways[0] == ways[1]
    return ways[0][0], [rejection.reason for rejection in ways[0][1]]


def said(batches: list[Batch]) -> tuple[dict[str, list[float]], list[Rejection]]:
    found: dict[str, list[float]] = {}
    for batch in batches:
        for row in batch.observations.to_pylist():
            found.setdefault(row["data_item"], []).append(row["number"] or row["text"])
    return found, [rejection for batch in batches for rejection in batch.rejected]


PREFIXED = """2026-06-11T00:00:00Z|M1:Xact|1
2026-06-11T00:00:01Z|M2:Xact|200
2026-06-11T00:00:02Z|M9:Xact|900
"""


def test_b01_a_prefix_names_the_device(tmp_path: Path) -> None:
    devices(tmp_path, position("M1"))
    values, reasons = logged(tmp_path, PREFIXED)
    assert values == {"Xact": [1.0]}
    assert [name in r for name, r in zip(("'M2'", "'M9'"), reasons, strict=True)] == [True, True]


def test_b01_each_device_of_the_document_keeps_its_own(tmp_path: Path) -> None:
    devices(tmp_path, position("M1"), position("M2"))
    values, reasons = logged(tmp_path, PREFIXED + "2026-06-11T00:00:03Z|M2_u:Xact|201\n")
    assert values == {"M1:Xact": [1.0], "M2:Xact": [200.0, 201.0]}
    assert ["'M9'" in r for r in reasons] == [True]
    chosen, reasons = logged(tmp_path, PREFIXED, device="M2")
    assert (chosen, len(reasons)) == ({"Xact": [200.0]}, 2)


def test_b01_a_name_that_several_items_share_is_refused(tmp_path: Path) -> None:
    devices(tmp_path, position("M1"), position("M2"))
    values, reasons = logged(tmp_path, "2026-06-11T00:00:00Z|Xact|1\n2026-06-11T00:00:00Z|M1_x|2\n")
    assert values == {"M1:Xact": [2.0]}
    assert "write the id (M1:M1_x, M2:M2_x)" in reasons[0]


STREAMS = """<MTConnectStreams><Header instanceId="1"/><Streams><DeviceStream name="M1" uuid="M1_u">
<ComponentStream component="Path" componentId="p"><Events>{}</Events></ComponentStream>
</DeviceStream></Streams></MTConnectStreams>"""
EXECUTION = (
    '<Execution dataItemId="{}" name="execution" sequence="{}" '
    'timestamp="2026-06-11T00:00:00Z">{}</Execution>'
)


@pytest.mark.parametrize("document", [None, "Devices.xml"])
def test_b01_two_paths_keep_their_execution_apart(tmp_path: Path, document: str | None) -> None:
    devices(tmp_path, TWO_PATHS)
    path = tmp_path / "streams.xml"
    events = EXECUTION.format("p1_ex", 1, "ACTIVE") + EXECUTION.format("p2_ex", 2, "READY")
    path.write_text(STREAMS.format(events))
    source = RecordSource(format="mtconnect_xml", files="*.xml", devices=document)
    values, rejected = said(list(xml_document.read(path, source, tmp_path)))
    first = "p1_ex" if document else "execution"
    assert (values, rejected) == ({first: ["ACTIVE"], "p2_ex": ["READY"]}, [])


START = np.datetime64("2026-01-05T10:00:00", "us")


def tdms(folder: Path, **channels: tuple[list[float], dict[str, object]]) -> Trace:
    with nptdms.TdmsWriter(folder / "x.tdms") as writer:
        writer.write_segment([
            nptdms.ChannelObject("G", name, np.array(values), properties=facts)
            for name, (values, facts) in channels.items()
        ])  # fmt: skip
    columns = {name.lower(): ColumnSource(column=name, unit="N") for name in channels}
    layout = TableLayout(columns=columns, group="G")
    source = RecordSource(format="tdms", files="*.tdms", table=layout)
    return columnar.read_tdms(folder / "x.tdms", source, folder)


def waveform(later_s: float = 0.0, **more: object) -> dict[str, object]:
    start = START + np.timedelta64(round(later_s * 1e6), "us")
    return {"wf_increment": 1.0, "wf_start_time": start, "wf_start_offset": 0.0} | more


@pytest.mark.parametrize("later", [waveform(3.0), waveform(2.75, wf_start_offset=0.25)])
def test_b03_channels_stand_at_their_own_start(tmp_path: Path, later: dict[str, object]) -> None:
    found = tdms(tmp_path, Fx=([0, 1, 2, 3, 4], waveform()), Fy=([10, 11, 12, 13, 14], later))
    frame = found.table.to_pandas()
    assert str(frame["time"][0]) == "2026-01-05 10:00:00+00:00"
    assert frame["fx"].tolist()[:5] == [0, 1, 2, 3, 4]
    assert frame["fy"].tolist()[3:] == [10, 11, 12, 13, 14]
    assert frame["fy"][:3].isna().all() and frame["fx"][5:].isna().all()


@pytest.mark.parametrize(
    ("facts", "reason"),
    [
        (waveform(60.0), "have no time in common"),
        ({"wf_increment": 1.0, "wf_start_offset": 1.0}, "have no time in common"),
        (waveform() | {"NI_Scale[0]_Scale_Type": "Reciprocal", "NI_Number_Of_Scales": 1},
         "'G/Fy' has the scale 'Reciprocal'"),
        (waveform(wf_xunit_string="Hz"), "a waveform over 'Hz', not over time"),
    ],
)  # fmt: skip
def test_b03_what_a_channel_says_of_itself_is_read_or_refused(
    tmp_path: Path, facts: dict[str, object], reason: str
) -> None:
    with pytest.raises(UnreadableFile, match=reason):
        tdms(tmp_path, Fx=([0, 1, 2], waveform()), Fy=([10, 11, 12], facts))


@pytest.mark.parametrize(
    ("stamp", "expected"),
    [
        ("1758033785.250", "2025-09-16T14:43:05.250"),
        ("1758033785", "2025-09-16T14:43:05"),
        ("1758033785250", "2025-09-16T14:43:05.250"),
        ("1758033785250000", "2025-09-16T14:43:05.250"),
        ("1758033785250000123", "2025-09-16T14:43:05.250000123"),
        ("17580337852500000", None),
    ],
)
def test_b05_the_unit_of_a_time_is_checked(
    tmp_path: Path, stamp: str, expected: str | None
) -> None:
    path = tmp_path / "log.txt"
    path.write_text(f"2025-09-16T14:43:05Z|Xact|0\n{stamp}|Xact|1\n")
    source = RecordSource(format="shdr", files="*.txt")
    batches = list(log.read(path, source, tmp_path))
    times = [str(t) for b in batches for t in b.observations["time"].to_numpy()[1:]]
    rejected = [r.reason for b in batches for r in b.rejected]
    assert times == ([str(np.datetime64(expected, "ns"))] if expected else [])
    assert [stamp in r for r in rejected] == ([] if expected else [True])


def table(folder: Path, text: str, **options: object) -> Trace:
    """Trace of ``t``, ``Fx`` and whatever follows in a text table."""
    (folder / "x.csv").write_text(text)
    layout = {"columns": {"fx": ColumnSource(column="Fx", unit="N")}, "time": "t"} | options
    source = RecordSource(format="csv", files="*.csv", table=TableLayout(**layout))  # type: ignore[arg-type]
    return csv_table.read(folder / "x.csv", source, folder)


def fixed(first: int, last: int) -> str:
    return "".join(f"{k / 10:.3f},{k * 1.5:.3f}\n" for k in range(first, last))


@pytest.mark.parametrize("ragged", ["reject", "fill"])
@pytest.mark.parametrize(
    ("broken", "lines"),
    [("6.000,9", [62]), ("6.000,90.", [62]), ("6.000,90.0", [62]), ("6.0\n00,90.000", [62, 63]),
     ("6.000,90.0006.100,91.500", [62]), ("6.000,90.000", [])],
)  # fmt: skip
def test_numbers_of_broken_lines_are_not_kept(
    tmp_path: Path, broken: str, lines: list[int], ragged: str
) -> None:
    text = f"t,Fx\n{fixed(0, 60)}{broken}\n{fixed(70, 90)}"
    found = table(tmp_path, text, ragged=ragged)
    assert [r.line for r in found.rejected] == lines
    assert found.table["t"].to_pylist()[60] == (7.0 if lines else 6.0)


def test_a_writer_that_leaves_zeros_away_breaks_no_line(tmp_path: Path) -> None:
    rows = "".join(f"{k / 1000:g},{k * 1.37:.6g}\n" for k in range(500))
    assert not table(tmp_path, "t,Fx\n" + rows).rejected


@pytest.mark.parametrize("cut", ["M1:Xact|12.", "M1:Xa"])
def test_a_line_of_a_log_that_lost_its_end_keeps_nothing(tmp_path: Path, cut: str) -> None:
    devices(tmp_path, position("M1"))
    text = f"2026-06-11T00:00:00Z|M1:Xact|1\n2026-06-11T00:00:01Z|{cut}"
    values, reasons = logged(tmp_path, text + "2026-06-11T00:00:02Z|Yact|3\n")
    assert values == {"Xact": [1.0]}
    assert reasons == ["the line breaks off, and the next one follows without a break"]


def test_a_word_does_not_take_in_the_next_line_whose_time_has_whole_seconds(tmp_path: Path) -> None:
    devices(tmp_path, position("M1"))
    lost = "2026-06-11T00:00:01Z|note|STOPPED2026-06-11T00:00:02Z|Yact|3\n"
    values, reasons = logged(tmp_path, f"2026-06-11T00:00:00Z|M1:Xact|1\n{lost}")
    assert values == {"Xact": [1.0]}
    assert reasons == ["the line breaks off, and the next one follows without a break"]


AGENT = """<Agent id="a" name="Agent" uuid="ua"><DataItems>
<DataItem id="a_av" name="agent_avail" category="EVENT" type="AVAILABILITY"/></DataItems></Agent>"""


@pytest.mark.parametrize("with_log", [True, False])
def test_c01_an_agents_own_device_is_no_machine(tmp_path: Path, with_log: bool) -> None:
    document = devices(tmp_path, AGENT, position("M1"))
    streams = tmp_path / "s.xml"
    sample = (
        '<Position dataItemId="M1_x" name="Xact" sequence="1" timestamp="2026-06-11T00:00:00Z">1'
        "</Position>"
    )
    streams.write_text(
        STREAMS.format("").replace("<Events>", f"<Samples>{sample}</Samples><Events>")
    )
    found = propose("z", document, [streams] if with_log else [], None, tmp_path / "raw")
    assert found.device == "M1"
    assert list(found.series) == (["Xact"] if with_log else [])


@pytest.mark.parametrize("folder", ["logs [2026]", "100 % ?", "a*b"])
def test_c02_names_of_folders_are_no_patterns(tmp_path: Path, folder: str) -> None:
    raw = tmp_path / "raw"
    (raw / folder).mkdir(parents=True)
    (raw / folder / "day.txt").write_text("2026-06-11T00:00:00Z|Xact|1\n")
    document = devices(tmp_path, position("M1"))
    found = propose("z", document, [raw / folder / "day.txt"], None, raw)
    pattern = yaml.safe_load(machine_text(found))["records"][0]["files"]
    assert [p.name for p in raw.glob(pattern)] == ["day.txt"]
    assert list(found.series) == ["Xact"]


@pytest.mark.parametrize(
    ("name", "text", "form"),
    [
        ("a.txt", "[capture started]\n2026-06-11T00:00:00Z|Xact|1\n", "shdr"),
        ("a.txt", '{"capture": 1}\n1758033785.250|Xact|1\n', "shdr"),
        ("a.txt", "2026-06-11T00:00:00Z|@ASSET@|1|T|<MTConnectAssets/>\n", "shdr"),
        ("a.csv", "[s];[N]\n0;1\n", "csv"),
        ("a.txt", '[\n {"MTConnectStreams": {}}]', "mtconnect_json"),
        ("a.txt", "--mark\nContent-type: text/xml\n\n<MTConnectStreams/>", "mtconnect_xml"),
    ],
)
def test_c03_a_form_is_not_told_from_one_character(
    tmp_path: Path, name: str, text: str, form: str
) -> None:
    (tmp_path / name).write_text(text)
    assert format_of(tmp_path / name) == form


@pytest.mark.slow  # MLflow makes a database
@pytest.mark.parametrize(
    "folder",
    [
        "my%20project a b?c#",
        *(pytest.param(one, marks=pytest.mark.proof) for one in ("my%20project", "a b?c#", "a b")),
    ],
)
def test_c04a_a_project_may_stand_in_any_folder(
    tmp_path: Path, folder: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("MLFLOW_TRACKING_URI", raising=False)
    root = tmp_path / folder
    root.mkdir()
    client = client_of(root)
    place = client.get_experiment_by_name(experiment_of(client, root)).artifact_location
    assert [path.name for path in tmp_path.iterdir()] == [folder]
    assert place == (root / "mlartifacts").as_uri()
    assert versions("mill01", root) == []


@pytest.mark.parametrize("more", ["", "submodels: {spindle: [y]}\n"])
def test_a_short_fleet_is_whole_for_dvc(
    tmp_path: Path, more: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # its dvc.lock
    monkeypatch.setattr("pipeline.app.fleet.CONF", tmp_path)
    monkeypatch.setattr("pipeline.app.fleet.DATA", tmp_path / "data")
    monkeypatch.setattr("pipeline.app.fleet._composed", lambda override: {})
    (tmp_path / "fleet").mkdir()
    (tmp_path / "fleet/short.yaml").write_text(f"name: short\nmachines: [y]\n{more}")
    use_fleet("short")
    whole = yaml.safe_load((tmp_path / "fleet/active.yaml").read_text())
    full = yaml.safe_load((Path(__file__).parents[2] / "conf/fleet/simulated.yaml").read_text())
    assert set(full) <= set(whole) and set(full["submodels"]) == set(whole["submodels"])
    assert whole["submodels"]["spindle"] == (["y"] if more else [])


BERLIN = {"time_unit": "iso", "time_zone": "Europe/Berlin"}


def times(found: Trace) -> list[str]:
    return [str(at)[:16] for at in found.table["time"].to_numpy()]


def test_d11_the_setting_that_reads_a_time_is_named(tmp_path: Path) -> None:
    text = "t,Fx\n27.03.2025 14:55:00,1\n28.03.2025 14:55:00,2\n"
    with pytest.raises(UnreadableFile, match=r"give the layout's time_format, for example '%d"):
        table(tmp_path, text, **BERLIN)
    found = table(tmp_path, text, **BERLIN, time_format="%d.%m.%Y %H:%M:%S")
    assert times(found) == ["2025-03-27T13:55", "2025-03-28T13:55"]


def night(*clock: str) -> str:
    return "t,Fx\n" + "".join(f"2025-10-26 {at},{n}\n" for n, at in enumerate(clock))


@pytest.mark.parametrize(
    ("clock", "utc"),
    [
        (("01:30:00", "02:30:00", "02:30:00", "03:30:00"), ["23:30", "00:30", "01:30", "02:30"]),
        (("02:20:00", "02:40:00", "02:00:00", "02:20:00"), ["00:20", "00:40", "01:00", "01:20"]),
        (("01:30:00", "02:30:00", "03:30:00"), ["23:30", "02:30"]),
        (("02:30:00", "02:30:00", "02:30:01", "03:30:00"), ["02:30"]),
    ],
)
def test_d12_the_order_tells_the_repeated_hour(
    tmp_path: Path, clock: tuple[str, ...], utc: list[str]
) -> None:
    found = table(tmp_path, night(*clock), **BERLIN)
    assert [at[11:] for at in times(found)] == utc
    assert all("is two instants of Europe/Berlin" in r.reason for r in found.rejected)


def test_d12_in_a_column_of_timestamps_too() -> None:
    wall = pa.array(np.array(["2025-10-26T02:30", "2025-10-26T02:00"], "M8[ns]"))
    time, bad = cells.instants(wall, TableLayout(time_zone="Europe/Berlin"))
    assert np.diff(time).tolist() == [1800 * 10**9] and not bad.any()


LABVIEW = """LabVIEW Measurement\t
Separator\tTab
***End_of_Header***\t
\t
Channels\t1\t\t
***End_of_Header***\t\t
X_Value\tFx\tComment
0.0\t1.5
0.1\t2.5
"""


def test_d14_short_rows_name_their_setting(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFile, match="set ragged: fill in the layout"):
        table(tmp_path, LABVIEW, time="X_Value")
    assert table(tmp_path, LABVIEW, time="X_Value", ragged="fill").kept == 2


@pytest.mark.parametrize("delimiter", ["auto", " "])
@pytest.mark.parametrize(
    "text",
    [
        "   t           Fx\n   0.000     1.500\n   0.100    11.600\n",
        "made by DAQ 7\n\nt  Fx  wall temp\n0.000  1.500  20\n0.100  11.600  21\n",
        "t Fx\n0.000 1.500\n0.100\t11.600\n",
    ],
)
def test_e09_columns_may_stand_in_blanks(tmp_path: Path, text: str, delimiter: str) -> None:
    found = table(tmp_path, text, delimiter=delimiter)
    assert found.table["t"].to_pylist() == [0.0, 0.1]
    assert found.table["fx"].to_pylist() == [1.5, 11.6]


def test_american_times_are_read(tmp_path: Path) -> None:
    text = "t;Fx\n12/2/2009 2:42:25 PM;1\n12/13/2009 12:00:01.5 AM;2\n"
    found = table(tmp_path, text, time_unit="iso")
    assert [str(at)[:21] for at in found.table["time"].to_numpy()] == [
        "2009-12-02T14:42:25.0", "2009-12-13T00:00:01.5",
    ]  # fmt: skip
    with pytest.raises(UnreadableFile, match="time_format"):  # days stand first
        table(tmp_path, "t;Fx\n13/2/2009 2:42:25 PM;1\n", time_unit="iso")


@pytest.mark.parametrize(
    ("cell", "decimal", "value"),
    [
        ("1,234.5", ".", 1234.5), ("1,234,567", ".", 1234567.0), ("-12'345.5", ".", -12345.5),
        ("1.234,5", ",", 1234.5), ("1 234,5", ",", 1234.5), ("1,234", ".", None),
        ("1.234", ",", None), ("12,34.5", ".", None),
    ],
)  # fmt: skip
def test_marks_of_thousands(tmp_path: Path, cell: str, decimal: str, value: float | None) -> None:
    found = table(tmp_path, f"t;Fx\n0;1\n1;{cell}\n", decimal=decimal, delimiter=";")
    assert found.table["fx"].to_pylist() == ([1.0] if value is None else [1.0, value])


def test_a_wav_recording_is_named_with_its_remedy(tmp_path: Path) -> None:
    (tmp_path / "x.csv").write_bytes(b"RIFF\x24\0\0\0WAVEfmt ")
    source = RecordSource(format="csv", files="*", table=TableLayout(rest=True, rate=1e4))
    with pytest.raises(UnreadableFile, match=r"a WAV recording.*format wav.*full_scale"):
        csv_table.read(tmp_path / "x.csv", source, tmp_path)
    with pytest.raises(UnreadableFile, match=r"a WAV recording.*format wav.*full_scale"):
        list(log.read(tmp_path / "x.csv", RecordSource(format="shdr", files="*"), tmp_path))


TABLE = "DAQ;;\n\nTime;X_ActPos;X cmd [mm];T front;Fx;probe;state\ns;mm;;degC;N;um;\n" + "".join(
    f"{k / 1000:.4f};{k * 0.1:.3f};{k * 0.1:.3f};{20 + k / 100:.2f};{k % 7 - 3:.1f};{k};ok\n"
    for k in range(50)
).replace(".", ",")


def test_a_machine_is_proposed_from_tables(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(TABLE)
    found = propose("z", None, [tmp_path / "a.csv"], None, tmp_path / "raw")
    text = machine_text(found)
    records = yaml.safe_load(text)["records"][0]
    assert records["table"] == {
        "units_row": True, "decimal": ",", "time": "Time", "time_unit": "s", "rest": True,
        "columns": {},
    }  # fmt: skip
    choices = yaml.safe_load("".join(
        f"{line.lstrip(' #')}\n" for line in text.splitlines() if line.startswith("      #   ")
    ))  # fmt: skip
    assert {n: one.get("unit") for n, one in choices.items()} == {
        "x_actpos": None, "x_cmd": "mm", "t_front": None, "fx": None, "probe": None, "state": "",
    }  # fmt: skip
    for name, kind in (("X_ActPos", "position"), ("X cmd", "command"), ("T front", "temperature"),
                       ("Fx", "force"), ("probe", "displacement")):  # fmt: skip
        line = next(one for one in text.splitlines() if f'"{name}' in one and "#   " in one)
        assert f"could be a {kind}" in line
    columns = {n: ColumnSource(**one) for n, one in choices.items()}
    layout = TableLayout(**records["table"] | {"columns": columns, "text": ("state",)})
    source = RecordSource(format="csv", files="*", table=layout)
    assert csv_table.read(tmp_path / "a.csv", source, tmp_path).kept == 50


def test_a_machine_is_proposed_from_a_wav_recording(tmp_path: Path) -> None:
    wavfile.write(tmp_path / "a.wav", 8000, np.array([[1, -2], [3, 4]] * 20, np.int16))
    text = machine_text(propose("z", None, [tmp_path / "a.wav"], None, tmp_path / "raw"))
    records = yaml.safe_load(text)["records"][0]
    assert records == {"format": "wav", "files": "*.wav", "table": {"rest": True, "columns": {}}}
    assert '#   channel_2: {"column": "#2", "unit": "", "full_scale": 1.0}' in text


def test_d15_zeros_that_fill_the_last_line_are_no_frequencies(tmp_path: Path) -> None:
    path = tmp_path / "x.uff"
    path.write_text(UNEVEN)
    found = read_frf(path, direction="x")
    assert found.frequency_Hz.tolist() == [5.0, 10.0, 20.0]
    accelerance = found.receptance[:, 0, 0] * (2j * np.pi * found.frequency_Hz) ** 2
    assert accelerance.real == pytest.approx([1.0, 2.0, 3.0])
    path.write_text(UNEVEN.replace("         5         3", "         5         5"))
    with pytest.raises(ValueError, match="announces 5 values and has 4: it is cut"):
        read_frf(path, direction="x")


UNEVEN = """    -1
    58
n
n
01-Jan-2026 00:00:00
NONE
NONE
    4         0    0         0 p1              1   1 NONE               1   1
         5         3         0  0.00000e+00  0.00000e+00  0.00000e+00
        18    0    0    0                      Hz
        12    0    0    0                      m/s^2
        13    0    0    0                      N
         0    0    0    0 NONE                 NONE
  5.00000e+00  1.00000e+00  0.00000e+00  1.00000e+01  2.00000e+00  0.00000e+00
  2.00000e+01  3.00000e+00  0.00000e+00  0.00000e+00  0.00000e+00  0.00000e+00
    -1
"""


def test_growth_is_modelled_without_the_ambient_temperature() -> None:
    """The expansion of the groups needs no air; the two nodes, which do, are left out."""
    one = made(1)
    state = State(period=60.0, temperatures=one.temperatures, speed=one.speed,
                  ambient=np.full(len(one.speed), np.nan))  # fmt: skip
    record = growth_record(input_maker([state], (600.0,)).of(state), one.growth)
    assert record.ambient_C[0] == pytest.approx(one.temperatures[0].min(), abs=0.5)


def test_a_controls_log_may_be_a_table(tmp_path: Path) -> None:
    text = "t,Exec,Line,Fx\n" + "".join(
        f"2026-06-11 00:00:{k:02d},{'ACTIVE' if 5 <= k < 50 else 'READY'},{k // 5},1\n"
        for k in range(60)
    )
    columns = {"execution": ColumnSource(column="Exec"), "line": ColumnSource(column="Line")}
    trace = table(tmp_path, text, columns=columns, time_unit="iso")
    pq.write_table(trace.table, tmp_path / "log.parquet")
    items = {"execution": "execution", "line": "line"}
    (run,) = read_runs(tmp_path / "log.parquet", items, "log")
    assert (run.start, run.end) == (5.0, 50.0)
    pq.write_table(trace.table.rename_columns(["t", "execution", "line"]), tmp_path / "x.parquet")
    with pytest.raises(ValueError, match="times count from its start: give its layout a start"):
        read_runs(tmp_path / "x.parquet", items, "log")
