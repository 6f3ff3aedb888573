"""A tiny model to fit and render; rendering datasets needs OpenGL through EGL (Mesa's software one will do)."""

from collections.abc import Iterator
from contextlib import nullcontext

import pytest

from core.lab.datasets.rasteriser import Rasteriser
from core.models.model import Model
from tests.conftest import no_opengl, unchecked_shapes
from tests.core.tiny import tiny_model

UNCHECKED = {"benchmarks", "cli", "evaluation"}
"""Packages whose tests run what those of other packages have checked."""


@pytest.fixture(scope="module", autouse=True)
def _shape_checks(request: pytest.FixtureRequest) -> Iterator[None]:
    with unchecked_shapes() if request.path.parent.name in UNCHECKED else nullcontext():
        yield


@pytest.fixture
def unchecked() -> Iterator[None]:
    """Switch shape checks off, for calls that another test makes with checks."""
    with unchecked_shapes():
        yield


@pytest.fixture(scope="module")
def rasteriser() -> Iterator[Rasteriser]:
    """A rasteriser for 64 px images."""
    try:
        made = Rasteriser(64)
    except RuntimeError as error:
        no_opengl(error)
    with made:
        yield made


@pytest.fixture(scope="session")
def tiny() -> Model:
    """The one of :mod:`tests.core.tiny`, made once."""
    return tiny_model()
