"""A page in headless Chromium shows what this program draws, asks for nothing and turns by mouse and touch."""

import base64
import io
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from jaxtyping import Float, UInt8
from PIL import Image

from core.detail.lookup import DetailMaps
from core.edits.bend import Bend
from core.edits.edit import Edit
from core.edits.stretch import Stretch
from core.export.page import MAX_BYTES, Look, write_page
from core.export.page import page as page_text
from core.geometry.camera import Camera
from core.gl.baking import bake
from core.metrics import psnr
from core.models.model import Instance, Model
from core.models.photo_detail import OtherSide
from tests.conftest import offscreen, unchecked_shapes
from tests.core.detail.test_maps import lettered, striped
from tests.core.export.chromium import Chromium
from tests.core.export.conftest import SIZE

CAMERAS = [(1.1 + turn * math.pi / 5, 0.3 * (turn % 4) - 0.2) for turn in range(10)]


def on_white(image: UInt8[np.ndarray, "height width 4"]) -> Float[np.ndarray, "height width 3"]:
    colours = image[..., :3] / 255
    opacity = image[..., 3:] / 255
    return colours * opacity + 1 - opacity


def drawn(browser: Chromium, azimuth: float, elevation: float) -> Float[np.ndarray, "height width 3"]:
    return on_white(browser.picture(f"view.azimuth = {azimuth}; view.elevation = {elevation}; draw(1)"))


SIZE_EDITS = Bend(-0.35, -0.02, 0.1, 0.35), Stretch((1.0, 1.5, 0.7))


@pytest.mark.parametrize(
    "side, views, edits",
    [
        ("mirrored", CAMERAS, ()),
        (None, CAMERAS[:2], ()),
        ("mirrored", CAMERAS[:3], SIZE_EDITS),
    ],
)
def test_pages_show_the_programs_own_render(
    tiny: Model,
    camera: Camera,
    chromium: Chromium,
    tmp_path: Path,
    side: OtherSide | None,
    views: list[tuple[float, float]],
    edits: tuple[Edit, ...],
) -> None:
    instance = tiny[0] if side is None else striped(tiny, camera.resized(192, 192))
    instance = instance.changed(edits=edits)
    if instance.detail and side:
        instance = instance.with_detail(replace(instance.detail, other_side=side))
    path = tmp_path / "object.html"
    list(write_page(instance, camera, path, "Stool <1>"))
    assert path.stat().st_size < MAX_BYTES
    chromium.events.clear()
    chromium.open(path, SIZE, SIZE + 100)
    chromium.evaluate(f"stage.style.flex = 'none'; stage.style.height = '{SIZE}px'; 0")
    *_, baked = filter(None, bake(instance))
    with offscreen((SIZE, SIZE), background=None) as pictures:
        for azimuth, elevation in views:
            expected = on_white(pictures.draw(baked, replace(camera, azimuth=azimuth, elevation=elevation)))
            assert psnr(drawn(chromium, azimuth, elevation), expected) >= 35
    assert chromium.requests() == [path.as_uri()]
    assert chromium.complaints() == []
    assert chromium.evaluate("document.title") == "Stool <1>"


def borrowing(maps: DetailMaps) -> DetailMaps:
    """Return maps with others that count in the mirror only, as those borrowed from a training object."""
    photo = maps.photos[0]
    coloured = tuple(torch.cat((1 - level[:3], level[3:])) for level in photo.fine)
    twin = replace(photo, fine=tuple(map(torch.zeros_like, coloured)), mirrored=coloured)
    return replace(maps, photos=(photo, twin), borrowed=1)


@pytest.mark.parametrize("changed", [lettered, borrowing])
def test_pages_show_what_the_mirror_image_has_of_its_own(
    tiny: Model, camera: Camera, chromium: Chromium, tmp_path: Path, changed: Callable[[DetailMaps], DetailMaps]
) -> None:
    *_, baked = filter(None, bake(striped(tiny, camera.resized(192, 192))))
    baked = replace(baked, detail=changed(baked.detail))
    path = tmp_path / "object.html"
    path.write_text(page_text([Look("", baked, np.zeros((64, 64, 4), np.uint8))], camera, "Stool"))
    chromium.open(path, SIZE, SIZE + 100)
    chromium.evaluate(f"stage.style.flex = 'none'; stage.style.height = '{SIZE}px'; 0")
    with offscreen((SIZE, SIZE), background=None) as pictures:
        for azimuth in (1.1, math.pi - 1.1):
            expected = on_white(pictures.draw(baked, replace(camera, azimuth=azimuth)))
            assert psnr(drawn(chromium, azimuth, camera.elevation), expected) >= 35


SIZES = [(390, 844), (150, 150), (1280, 800)]


@pytest.fixture(scope="module")
def stool(tiny: Model, camera: Camera, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with photo detail."""
    path = tmp_path_factory.mktemp("page") / "stool.html"
    with unchecked_shapes():
        list(write_page(striped(tiny, camera.resized(192, 192)), camera, path, "Stool"))
    return path


@pytest.fixture
def page(chromium: Chromium, stool: Path) -> Iterator[Chromium]:
    """The page on a phone, with nothing left of earlier tests."""
    chromium.events.clear()
    chromium.open(stool, 390, 844)
    yield chromium


def press(browser: Chromium, x: float, y: float, moved: float = 0, seconds: float = 0.0) -> None:
    """Press the mouse, move it, and let go; ``seconds``: the time of the events, 0 for now."""
    for kind, shift in (("mousePressed", 0), ("mouseMoved", moved), ("mouseReleased", moved)):
        mouse = {"type": kind, "x": x + shift, "y": y, "button": "left", "buttons": 1, "clickCount": 1}
        browser.send("Input.dispatchMouseEvent", **mouse, **({"timestamp": seconds} if seconds else {}))


def pinch(browser: Chromium, x: float, y: float) -> None:
    """Two fingers that move apart to twice their distance."""
    for kind, reach in (("touchStart", 30), ("touchMove", 60), ("touchEnd", 0)):
        touches = [{"x": x + side * reach, "y": y, "id": side} for side in (0, 1)] if reach else []
        browser.send("Input.dispatchTouchEvent", type=kind, touchPoints=touches)


def shows_something(image: UInt8[np.ndarray, "height width 4"]) -> bool:
    return image[..., :3].min(-1).mean() < 250 and image[..., :3].min() < 150


def words(browser: Chromium) -> str:
    return browser.evaluate("document.body.innerText + document.querySelector('main').ariaLabel")


@pytest.mark.parametrize("width, height", SIZES)
def test_pages_of_any_size_show_the_programs_own_render(
    tiny: Model, camera: Camera, chromium: Chromium, stool: Path, width: int, height: int
) -> None:
    chromium.open(stool, width, height)
    size = chromium.evaluate("[stage.clientWidth, stage.clientHeight]")
    assert size[0] == width and size[1] > 0.85 * height
    *_, baked = filter(None, bake(striped(tiny, camera.resized(192, 192))))
    with offscreen(tuple(size), background=None) as pictures:
        focal = camera.focal / camera.height * min(size)
        expected = pictures.draw(baked, replace(camera, focal=focal, width=size[0], height=size[1]))
    assert psnr(on_white(chromium.picture("draw(1)")), on_white(expected)) >= 35


@pytest.mark.parametrize("width, height", SIZES)
def test_dragging_turns_the_object(chromium: Chromium, stool: Path, width: int, height: int):
    chromium.events.clear()
    chromium.open(stool, width, height)
    press(chromium, width // 2, height // 2, moved=40)
    turned = chromium.evaluate("home.azimuth - view.azimuth")
    assert turned == pytest.approx(160 / chromium.evaluate("Math.min(stage.clientWidth, stage.clientHeight)"))
    pinch(chromium, width // 2, height // 2)
    assert chromium.evaluate("view.distance / home.distance") == pytest.approx(0.5, abs=0.01)
    assert chromium.evaluate("document.documentElement.scrollWidth <= innerWidth")
    assert chromium.complaints() == []


def test_fingers_on_the_caption_zoom_the_object_and_not_the_page(page: Chromium) -> None:
    point = page.evaluate("(({ x, y }) => [x + 5, y + 5])(document.querySelector('footer b').getBoundingClientRect())")
    pinch(page, *point)
    assert page.evaluate("view.distance / home.distance") == pytest.approx(0.5, abs=0.01)
    assert page.evaluate("visualViewport.scale") == 1
    for deltas in ({"modifiers": 2}, {}):  # a trackpad's pinch is a wheel with Ctrl
        page.send("Input.dispatchMouseEvent", type="mouseWheel", x=point[0], y=point[1], deltaX=0, deltaY=100, **deltas)
    assert page.evaluate("view.distance / home.distance") == pytest.approx(0.5 * math.exp(0.2), abs=0.01)
    assert page.evaluate("visualViewport.scale") == 1


def test_keys_turn_and_zoom_and_a_double_tap_resets_the_view(page: Chromium) -> None:
    for key in ("ArrowLeft", "ArrowUp", "+"):
        page.send("Input.dispatchKeyEvent", type="keyDown", key=key)
    assert page.evaluate(
        "[view.azimuth - home.azimuth, view.elevation - home.elevation, view.distance / home.distance]"
    ) == [pytest.approx(value) for value in (0.1, -0.1, 0.9)]
    began = page.evaluate("Date.now() / 1000")
    for seconds in (0.0, 1.0, 1.1):
        assert page.evaluate("view.azimuth !== home.azimuth")
        press(page, 200, 300, seconds=began + seconds)
    assert page.evaluate("JSON.stringify(view) === JSON.stringify(home)")
    page.send("Input.dispatchKeyEvent", type="keyDown", key="+")
    page.send("Input.dispatchKeyEvent", type="keyDown", key="Home")
    assert page.evaluate("JSON.stringify(view) === JSON.stringify(home)")


def test_the_canvas_follows_the_density_of_the_screen(page: Chromium) -> None:
    width = page.evaluate("draw(1); canvas.width")  # a slow machine draws fewer pixels while it turns
    page.send("Emulation.setDeviceMetricsOverride", width=390, height=844, deviceScaleFactor=2, mobile=False)
    page.wait(f"canvas.width > {1.5 * width}")


def test_page_heads_have_an_image_for_previews_of_links(page: Chromium) -> None:
    address = page.evaluate("document.querySelector('meta[property=\"og:image\"]').content")
    assert address.startswith("data:image/jpeg;base64,")
    with Image.open(io.BytesIO(base64.b64decode(address.partition(",")[2]))) as picture:
        assert picture.size == (512, 512)
        assert shows_something(np.array(picture.convert("RGBA")))
    assert page.evaluate("document.querySelector('meta[property=\"og:title\"]').content") == "Stool"


def test_colours_are_never_read_back_from_a_canvas(chromium: Chromium, stool: Path) -> None:
    broken = "throw new Error('read back')"
    names = "CanvasRenderingContext2D", "OffscreenCanvasRenderingContext2D", "WebGL2RenderingContext"
    script = ";".join(
        f"{name}.prototype.{read} = () => {{ {broken} }}"
        for name in names
        for read in ("getImageData", "readPixels", "getBufferSubData")
    )
    with chromium.before_pages(script):
        chromium.open(stool, 390, 844)
    assert chromium.evaluate("document.body.dataset.state") == "turns"


def test_a_lost_context_shows_the_poster_until_it_is_restored(page: Chromium) -> None:
    page.evaluate("view.azimuth = 2; draw(1); window.loss = gl.getExtension('WEBGL_lose_context'); loss.loseContext()")
    page.wait("document.body.dataset.state === 'paused'")
    assert shows_something(page.screenshot())
    assert "paused the drawing" in words(page) and "drag" not in words(page)
    page.evaluate("loss.restoreContext()")
    page.wait("document.body.dataset.state === 'turns'")
    assert page.evaluate("view.azimuth") == 2
    again = on_white(page.picture("draw(1)"))
    page.evaluate("begin()")
    page.wait("document.body.dataset.state === 'turns'")
    assert psnr(again, on_white(page.picture("draw(1)"))) > 45
    assert again.min() < 0.6
    assert page.complaints() == []


@pytest.mark.parametrize("wake", ["tap", "key", "show"])
def test_a_context_that_is_never_restored_is_replaced(page: Chromium, wake: str) -> None:
    for _ in range(2):
        page.evaluate("gl.getExtension('WEBGL_lose_context').loseContext()")
        page.wait("document.body.dataset.state === 'paused'")
        if wake == "tap":
            press(page, 195, 400, moved=20)
        elif wake == "key":
            page.send("Input.dispatchKeyEvent", type="keyDown", key="ArrowLeft")
        else:
            page.evaluate("document.dispatchEvent(new Event('visibilitychange'))")
        page.wait("document.body.dataset.state === 'turns'")
        assert page.evaluate("document.querySelectorAll('canvas').length") == 1
        assert page.picture("draw(1)")[..., 3].max() == 255
    assert (page.evaluate("view.azimuth - home.azimuth") != 0) == (wake != "show")


_GL, _NO = "WebGL2RenderingContext.prototype", "() => false"
FAILURES = {
    "has no WebGL 2": "HTMLCanvasElement.prototype.getContext = () => null",
    "has no DecompressionStream": "delete window.DecompressionStream",
    "has no ResizeObserver": "delete window.ResizeObserver",
    "has no PointerEvent": "delete window.PointerEvent",
    "driver refuses the drawing program (no)": f"{_GL}.getShaderParameter = {_NO}; {_GL}.getShaderInfoLog = () => 'no'",
    "driver refuses the drawing program (link)": (
        f"{_GL}.getProgramParameter = {_NO}; {_GL}.getProgramInfoLog = () => 'link'"
    ),
    "graphics card fails (error 1285)": f"{_GL}.getError = () => 1285",
    "cannot decode": "Image.prototype.decode = () => Promise.reject(new Error('cannot decode'))",
    "is not a function": f"{_GL}.texImage3D = undefined",
    "cannot run the page": "Object.defineProperty(window, 'JSON', { value: null })",
}


@pytest.mark.parametrize("why", FAILURES)
def test_a_failed_drawing_leaves_the_poster_and_names_the_reason(chromium: Chromium, stool: Path, why: str) -> None:
    with chromium.before_pages(FAILURES[why]):
        chromium.open(stool, 390, 844)
    assert shows_something(chromium.screenshot())
    assert "still picture" in words(chromium) and why in words(chromium)
    assert "drag" not in words(chromium)


def test_a_browser_that_cannot_read_the_script_shows_the_poster(
    chromium: Chromium, stool: Path, tmp_path: Path
) -> None:
    old = tmp_path / "old.html"
    old.write_text(stool.read_text().replace('"use strict";', '"use strict"; ]'))
    chromium.open(old, 390, 844)
    assert "cannot run the page" in words(chromium) and "drag" not in words(chromium)
    assert shows_something(chromium.screenshot())


def test_an_error_while_turning_shows_the_poster(page: Chromium) -> None:
    page.evaluate("gl.drawArrays = undefined; setTimeout(() => draw(1)); 0")
    page.wait("document.body.dataset.state === 'still'")
    assert shows_something(page.screenshot())
    assert "is not a function" in words(page) and "drag" not in words(page)


def test_pages_without_javascript_show_a_still_image(chromium: Chromium, stool: Path) -> None:
    chromium.send("Emulation.setScriptExecutionDisabled", value=True)
    try:
        chromium.events.clear()
        chromium.send("Page.navigate", url=stool.as_uri())
        chromium.expect("Page.loadEventFired")
        assert shows_something(chromium.screenshot())
        assert "JavaScript is off" in chromium.evaluate("document.body.innerText")
    finally:
        chromium.send("Emulation.setScriptExecutionDisabled", value=False)


def test_twenty_frames_of_one_document_show_the_object(chromium: Chromium, stool: Path, tmp_path: Path) -> None:
    """More than the contexts that a browser keeps: the oldest become posters, and turn once they are tapped."""
    frame, side = '<iframe src="{}" width="148" height="148" style="border:0"></iframe>', 160
    (tmp_path / "album.html").write_text(
        f"<style>body {{ margin: 0; display: grid; grid-template-columns: repeat(5, {side}px); }}</style>"
        + frame.format(stool.as_uri()) * 20
    )
    chromium.events.clear()
    chromium.send("Emulation.setDeviceMetricsOverride", width=800, height=600, deviceScaleFactor=1, mobile=False)
    chromium.send("Page.navigate", url=(tmp_path / "album.html").as_uri())
    chromium.expect("Page.loadEventFired")
    frames = chromium.frames()
    assert len(frames) == 20
    state = "document.body.dataset.state"
    for context in frames:
        chromium.wait(f"['turns', 'paused'].includes({state})", context)
    picture = chromium.screenshot()
    rows = [picture[top : top + 148] for top in range(0, 4 * 150, 150)]
    for row in rows:
        for left in range(0, 5 * side, side):
            assert shows_something(row[:, left : left + 148])
    states = [chromium.evaluate(state, context) for context in frames]
    assert 10 <= states.count("turns") < 20
    asleep = states.index("paused")
    press(chromium, side * (asleep % 5) + 70, 150 * (asleep // 5) + 70, moved=20)
    chromium.wait(f"{state} === 'turns'", frames[asleep])
    assert chromium.evaluate("view.azimuth !== home.azimuth", frames[asleep])


def test_only_a_page_is_written_and_large_photos_fit(tiny: Model, camera: Camera, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a page must end in \.html"):
        list(write_page(tiny[0], camera, tmp_path / "object.png", "Stool"))
    job = write_page(tiny[0], camera, tmp_path / "object.html", "Stool")
    next(job)
    job.close()
    assert list(tmp_path.iterdir()) == []
    photo = striped(tiny, camera.resized(192, 192)).detail
    instance: Instance = tiny[0].with_detail(replace(photo, views=photo.views * 4))
    path = tmp_path / "object.html"
    list(write_page(instance, camera, path, "Stool"))
    assert path.stat().st_size < MAX_BYTES
