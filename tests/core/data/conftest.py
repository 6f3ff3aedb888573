"""Drawing needs OpenGL through EGL (Mesa's software one will do); without it these tests say so and step aside."""

from collections.abc import Iterator

import pytest

from core.data.rasterise import Rasteriser


@pytest.fixture(scope="module")
def rasteriser() -> Iterator[Rasteriser]:
    """A rasteriser for 64 px pictures."""
    try:
        made = Rasteriser(64)
    except RuntimeError as error:
        pytest.skip(str(error))
    with made:
        yield made
