"""The package's forms keep at least 13 digits at the cases where the plain formulas lose half of theirs."""

import pytest

from tests.benchmarks.conditioning import FORMS


@pytest.mark.parametrize("make", FORMS, ids=lambda make: make.__name__)
def test_digits(make):
    form = make()
    assert form.digits(form.ours) >= 13
    assert form.digits(form.plain) <= 12
