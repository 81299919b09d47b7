"""Days of a plant (ISO dates), from midnight to midnight of its time zone; times are UTC."""

from datetime import date, timedelta
from difflib import get_close_matches
from pathlib import Path
from zoneinfo import available_timezones

import numpy as np

from pipeline.schema.arrays import Ints

UTC = "UTC"
QUARTER = 15 * 60 * 10**9
"""Midnight of every clock of today lies at a whole quarter of an hour in UTC [ns]."""


def is_day(text: str) -> bool:
    """Whether a text is a day, ``YYYY-MM-DD``."""
    try:
        return date.fromisoformat(text).isoformat() == text
    except ValueError:
        return False


def check_zone(name: str) -> None:
    """Raise ValueError for a time zone that is not in the IANA database."""
    known = available_timezones()
    if name not in known:
        like = get_close_matches(name, sorted(known), n=2, cutoff=0.5)
        hint = f"did you mean {' or '.join(like)}?" if like else "name one as America/New_York"
        raise ValueError(f"time_zone = {name!r} is not a time zone of the IANA database: {hint}")


def zone_of(clean: Path) -> str:
    """Time zone of the plant's days, as the state tables in ``clean`` have it; UTC without any."""
    import pyarrow.parquet as pq

    for path in sorted((clean / "state").glob("*.parquet"))[:1]:
        return str(pq.read_schema(path).field("time").type.tz)
    return UTC


def day_of(time: int, zone: str = UTC) -> str:
    """The plant's day of a time [ns]."""
    import pandas as pd

    return str(pd.Timestamp(time, tz=UTC).tz_convert(zone).date())


def day_of_text(time: str, zone: str = UTC) -> str:
    """The plant's day of a time of a manifest (ISO 8601, UTC)."""
    import pandas as pd

    return day_of(pd.Timestamp(time).tz_convert(UTC).as_unit("ns").value, zone)


def days_of(times: Ints, zone: str = UTC) -> list[str]:
    """The plant's days with one of some times [ns], sorted."""
    quarters = np.unique(times // QUARTER) * QUARTER
    return np.unique(clock(quarters, zone).astype("M8[ns]").astype("M8[D]")).astype(str).tolist()


def day_start(day: str, zone: str = UTC) -> int:
    """The first moment [ns] of a day."""
    return instant(day, 0.0, zone)


def instant(day: str, seconds: float, zone: str = UTC) -> int:
    """When [ns] the plant's clock shows so many seconds after midnight, first if it does twice."""
    import pandas as pd

    shown = pd.Timestamp(day) + pd.Timedelta(seconds=seconds)
    there = shown.tz_localize(zone, ambiguous=True, nonexistent="shift_forward")
    return int(there.as_unit("ns").value)


def day_end(day: str, zone: str = UTC) -> int:
    """The first moment [ns] of the next day."""
    return day_start(str(date.fromisoformat(day) + timedelta(days=1)), zone)


def clock(times: Ints, zone: str = UTC) -> Ints:
    """Time of the plant's clock at some times [ns], as times of UTC [ns]."""
    import pandas as pd

    shown = pd.DatetimeIndex(times, tz=UTC).tz_convert(zone).tz_localize(None)
    return np.asarray(shown.as_unit("ns").asi8, dtype=np.int64)
