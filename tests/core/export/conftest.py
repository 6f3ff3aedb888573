from collections.abc import Iterator

import pytest

from core.geometry.camera import Camera
from core.models.model import Model
from tests.core.export.chromium import Chromium

SIZE = 160  # px, of pages' pictures


@pytest.fixture(scope="package")
def chromium() -> Iterator[Chromium]:
    try:
        browser = Chromium()
    except FileNotFoundError as error:
        pytest.skip(str(error))
    with browser:
        yield browser


@pytest.fixture(scope="module")
def camera(tiny: Model) -> Camera:
    return tiny.camera(1.1, 0.3).resized(SIZE, SIZE)
