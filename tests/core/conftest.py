"""Drawing needs OpenGL through EGL (Mesa's software one will do)."""

from collections.abc import Iterator

import pytest

from core.data.rasterise import Rasteriser
from tests.conftest import no_opengl


@pytest.fixture(scope="module")
def rasteriser() -> Iterator[Rasteriser]:
    """A rasteriser for 64 px pictures."""
    try:
        made = Rasteriser(64)
    except RuntimeError as error:
        no_opengl(error)
    with made:
        yield made
