"""Properties of few examples in every run, and of many under ``proof``."""

from collections.abc import Callable
from functools import wraps
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings

Test = Callable[..., None]


def few_and_many(check: Test, few: int, many: int, **strategies: Any) -> tuple[Test, Test]:
    """The property ``check`` as two tests; arguments without a strategy are fixtures."""

    def of(examples: int) -> Test:
        @wraps(check)
        def test(*given_ones: Any, **by_name: Any) -> None:
            check(*given_ones, **by_name)

        health = [HealthCheck.function_scoped_fixture]
        limits = settings(max_examples=examples, deadline=None, suppress_health_check=health)
        found: Test = limits(given(**strategies)(test))
        return found

    return of(few), pytest.mark.proof(of(many))
