"""A page in headless Chromium shows what this program draws, asks for nothing and turns by mouse and touch."""

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from jaxtyping import Float, UInt8

from core.detail.rendering import bake
from core.export.page import MAX_BYTES, write_page
from core.geometry.camera import Camera
from core.metrics import psnr
from core.models.codes import Codes
from core.models.model import Model
from core.models.photo_detail import OtherSide
from core.rendering.offscreen import OffscreenRenderer
from tests.conftest import no_opengl
from tests.core.detail.test_maps import striped
from tests.core.export.chromium import Chromium

SIZE = 160
CAMERAS = [(1.1 + turn * math.pi / 5, 0.3 * (turn % 4) - 0.2) for turn in range(10)]


@pytest.fixture(scope="module")
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


def on_white(image: UInt8[np.ndarray, "height width 4"]) -> Float[np.ndarray, "height width 3"]:
    colours, opacity = image[..., :3] / 255, image[..., 3:] / 255
    return colours * opacity + 1 - opacity


def drawn(browser: Chromium, azimuth: float, elevation: float) -> Float[np.ndarray, "height width 3"]:
    return on_white(browser.picture(f"view.azimuth = {azimuth}; view.elevation = {elevation}; draw(1)"))


@pytest.mark.parametrize("side, views", [("mirrored", CAMERAS), ("soft", CAMERAS[:2]), (None, CAMERAS[:2])])
def test_it_shows_the_programs_own_picture(
    tiny: Model,
    camera: Camera,
    chromium: Chromium,
    tmp_path: Path,
    side: OtherSide | None,
    views: list[tuple[float, float]],
) -> None:
    codes = tiny.codes[0] if side is None else striped(tiny, camera.resized(192, 192))
    if codes.detail and side:
        codes = replace(codes, detail=replace(codes.detail, other_side=side))
    path = tmp_path / "object.html"
    list(write_page(tiny, codes, camera, path, "Stool <1>"))
    assert path.stat().st_size < MAX_BYTES
    chromium.events.clear()
    chromium.open(path, SIZE, SIZE + 100)
    chromium.evaluate(f"stage.style.flex = 'none'; stage.style.height = '{SIZE}px'; 0")
    *_, baked = filter(None, bake(tiny, codes))
    try:
        pictures = OffscreenRenderer((SIZE, SIZE), background=None)
    except RuntimeError as error:
        no_opengl(error)
    with pictures:
        for azimuth, elevation in views:
            own = on_white(pictures.draw(baked, replace(camera, azimuth=azimuth, elevation=elevation)))
            assert psnr(drawn(chromium, azimuth, elevation), own) >= 35
    assert chromium.requests() == [path.as_uri()]
    assert chromium.complaints() == []
    assert chromium.evaluate("document.title") == "Stool <1>"


@pytest.mark.parametrize("width, height", [(1280, 800), (390, 844)])
def test_a_hand_turns_it(tiny: Model, camera: Camera, chromium: Chromium, tmp_path: Path, width: int, height: int):
    path = tmp_path / "object.html"
    list(write_page(tiny, tiny.codes[0], camera, path, "Stool"))
    chromium.open(path, width, height)
    x, y = width // 2, height // 2
    for kind, moved in (("mousePressed", 0), ("mouseMoved", 40), ("mouseReleased", 40)):
        chromium.send("Input.dispatchMouseEvent", type=kind, x=x + moved, y=y, button="left", buttons=1, clickCount=1)
    turned = chromium.evaluate("home.azimuth - view.azimuth")
    assert turned == pytest.approx(160 / chromium.evaluate("Math.min(stage.clientWidth, stage.clientHeight)"))
    for kind, reach in (("touchStart", 30), ("touchMove", 60), ("touchEnd", 0)):
        touches = [{"x": x + side * reach, "y": y, "id": side} for side in (0, 1)] if reach else []
        chromium.send("Input.dispatchTouchEvent", type=kind, touchPoints=touches)
    assert chromium.evaluate("view.distance / home.distance") == pytest.approx(0.5, abs=0.01)
    assert chromium.evaluate("document.documentElement.scrollWidth <= innerWidth && !canvas.hidden")
    assert chromium.complaints() == []


def test_only_a_page_is_written_and_large_photos_fit(tiny: Model, camera: Camera, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a page must end in \.html"):
        list(write_page(tiny, tiny.codes[0], camera, tmp_path / "object.png", "Stool"))
    job = write_page(tiny, tiny.codes[0], camera, tmp_path / "object.html", "Stool")
    next(job)
    job.close()
    assert list(tmp_path.iterdir()) == []
    photo = striped(tiny, camera.resized(192, 192)).detail
    codes: Codes = replace(tiny.codes[0], detail=replace(photo, views=photo.views * 4))
    path = tmp_path / "object.html"
    list(write_page(tiny, codes, camera, path, "Stool"))
    assert path.stat().st_size < MAX_BYTES
