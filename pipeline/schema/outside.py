"""Conditions outside of the training data, and the factor by which they widen intervals."""

from collections.abc import Mapping

from pipeline.schema.model import Condition
from pipeline.schema.verdict import Fact, OutsideConditions

ONE = 0.1
"""Width of a learnt range, over its greater end, below which it counts as one value [1]."""


def outside_conditions(
    conditions: Mapping[str, Fact], learnt: Mapping[str, Condition], case: str = ""
) -> list[OutsideConditions]:
    """Conditions of ``case`` that the training cases did not cover."""
    found = []
    for name, fact in conditions.items():
        known = learnt.get(name)
        if known is None or fact.value is None:
            continue
        if isinstance(fact.value, str):
            inside, words = fact.value in known.words, ", ".join(known.words)
        else:
            low, high = known.low, known.high
            if low is None or high is None:
                continue
            slack = 1e-9 * max(abs(low), abs(high))
            inside = low - slack <= fact.value <= high + slack
            words = f"{low:g} to {high:g}" if high > low else f"{low:g}"
        if not inside:
            found.append(
                OutsideConditions(
                    case=case, condition=name, value=fact.value, unit=fact.unit, learnt=words
                )
            )
    return found


def widening(one: OutsideConditions) -> float:
    """Factor on an interval: one more for each width of the learnt range beyond its end.

    The width of one value is that value: speeds of 4000 and 4002 rev/min are one.
    """
    low, _, high = one.learnt.partition(" to ")
    try:
        ends = float(low), float(high or low)
    except ValueError:  # words have no distance
        return 2.0
    beyond = max(ends[0] - float(one.value), float(one.value) - ends[1])
    size = max(map(abs, ends))
    width = size if ends[1] - ends[0] < ONE * size else ends[1] - ends[0]
    if not width:  # learnt at 0 alone, as an entry angle: nothing to measure a distance by
        return 2.0
    return 1.0 + max(beyond, 0.0) / width


def widest(conditions: Mapping[str, Fact], learnt: Mapping[str, Condition]) -> float:
    """Factor on the intervals of a prediction under some conditions [1]; 1 inside of the learnt.

    >>> feed = {"highest feed": Condition(unit="mm/min", low=600.0, high=1200.0)}
    >>> widest({"highest feed": Fact(value=1500.0)}, feed)
    1.5
    """
    return max((widening(one) for one in outside_conditions(conditions, learnt)), default=1.0)
