"""A view of a stool, with other objects."""

import pytest

from core.lab.benchmarks.held_out_views import HeldOutView
from core.models.model import Model
from tests.core.lab.evaluation.test_protocol import views_of


@pytest.fixture(scope="session")
def view(tiny: Model) -> HeldOutView:
    return HeldOutView(tiny, views_of(tiny, 0, 10), 0, views_of(tiny, 1, 10), views_of(tiny, 3, 10))
