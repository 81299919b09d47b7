"""The newest 24 hours of continuous records: days that are neither learnt from nor frozen."""

from pipeline.schema.verdict import Role
from pipeline.submodels.cases import Case, Cases, newest_day, nights


def cases(**roles: Role) -> Cases:
    """A case a name; the underscores of a day are hyphens."""
    names = {name.strip("_").replace("_", "-"): role for name, role in roles.items()}
    return Cases(
        cases=tuple(
            Case(name=name, group=name, role=role, files=(), load=lambda: None)
            for name, role in names.items()
        )
    )


def test_the_newest_day_is_held_out_and_after_the_last_training_day() -> None:
    found = cases(
        _2026_01_03="held_out", _2026_01_05="training", _2026_01_08="held_out",
        _2026_01_07="held_out", _2026_01_09="golden", _2026_01_10="sealed",
    )  # fmt: skip
    assert list(nights(found)) == ["2026-01-07", "2026-01-08"]
    assert [one.name for one in newest_day(found)] == ["2026-01-08"]


def test_recordings_and_frozen_days_are_no_nights() -> None:
    assert newest_day(cases(circle="held_out", _2026_13_01="held_out")) == ()
    assert newest_day(cases(_2026_01_05="training", _2026_01_08="golden")) == ()
