"""What changes of a sub-model's parameters are compared by."""

from report_folders import parameter

from pipeline.report.changes import MachineFigures, changes, key_figure


def figures(value: float | None, **compared: float) -> MachineFigures:
    return MachineFigures(
        figures={name: key_figure(name, "s", v) for name, v in compared.items()},
        parameters={"wear": {"T1": {"rate": parameter(value, "mm/h")}}},
    )


def test_a_changed_parameter_stands_with_the_note_of_its_submodel():
    note = {"wear": lambda group, name, p, q: f"{group} {name} grew by {q.value / p.value:g}"}
    (change,) = changes(figures(0.2), figures(0.4), note)
    assert (change.what, change.before, change.now) == (
        "Parameter wear T1 rate", "0.200\u00a0mm/h", "0.400\u00a0mm/h"
    )  # fmt: skip
    assert (change.difference, change.note) == ("+0.200\u00a0mm/h", "T1 rate grew by 2")
    assert changes(figures(0.2), figures(0.2), note) == []
    assert changes(figures(0.2), figures(None), note)[0].now == "not known"


def test_counts_change_by_whole_numbers_and_what_was_not_there_was_not_known():
    before, now = figures(0.2, runs=3), figures(0.2, runs=5, new=1.5)
    found = {c.what: (c.before, c.now, c.difference) for c in changes(before, now, {})}
    assert found == {
        "runs": ("3\u00a0s", "5\u00a0s", "+2\u00a0s"),
        "new": ("not known", "1.50\u00a0s", ""),
    }
