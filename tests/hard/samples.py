"""Which of many cases are tried every time."""

import pytest


def sampled(cases):
    """Every third always, the others in campaigns: cases of one kind stand together, so that each kind is tried."""
    return [case if n % 3 == 0 else pytest.param(case, marks=pytest.mark.campaign) for n, case in enumerate(cases)]
