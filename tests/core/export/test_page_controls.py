"""Buttons of a page in headless Chromium: views, swatches, dimensions, and the object in a room."""

import math
import re
from pathlib import Path

import numpy as np
import pytest

from core.editing.bounds import natural_bounds
from core.editing.size import shown_bounds
from core.edits.paint import PartPaint
from core.export.dimensions import dimension_lines
from core.export.page import MAX_BYTES, PageExtras, write_page
from core.geometry.camera import Camera
from core.gl.baking import bake
from core.metrics import psnr
from core.models.model import Instance, Model
from tests.conftest import offscreen, unchecked_shapes
from tests.core.detail.test_maps import striped
from tests.core.export.chromium import Chromium
from tests.core.export.conftest import SIZE
from tests.core.export.test_glb import gltf_of
from tests.core.export.test_page import on_white, press

ARROW = {"key": "ArrowRight", "code": "ArrowRight", "windowsVirtualKeyCode": 39}


@pytest.fixture(scope="module")
def swatches(tiny: Model, camera: Camera, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Instance]]:
    """A page of three variants with dimensions, and files for phones."""
    first = striped(tiny, camera.resized(192, 192))
    variants = {"as it was": first}
    for name, colour in (("red", (0.8, 0.1, 0.1)), ("blue", (0.1, 0.2, 0.8))):
        paint = PartPaint("", colour, (0.5, 0.5, 0.5))
        variants[name] = first.with_edits(PartPaint, paint)
    path = tmp_path_factory.mktemp("swatches") / "stool.html"
    with unchecked_shapes():
        list(write_page(first, camera, path, "Stool", PageExtras(variants, "cm", room=True)))
    return path, variants


def test_buttons_show_the_object_from_its_sides(chromium: Chromium, swatches: tuple[Path, dict[str, Instance]]) -> None:
    page = chromium
    page.open(swatches[0], 390, 844)
    angles = {"Front": math.pi / 2, "Side": 0.0, "Back": -math.pi / 2}
    for number, azimuth in enumerate(angles.values()):
        button = f"document.querySelectorAll('nav label')[{number}].getBoundingClientRect()"
        press(page, *page.evaluate(f"(({{ x, y, width }}) => [x + width / 2, y + 8])({button})"))
        assert page.evaluate("view.azimuth") == pytest.approx(azimuth)
    assert page.evaluate("document.querySelector('nav fieldset').innerText").split() == [*angles, "Photo"]
    page.send("Input.dispatchKeyEvent", type="keyDown", key="ArrowRight", code="ArrowRight", windowsVirtualKeyCode=39)
    assert page.evaluate(
        "JSON.stringify(view) === JSON.stringify({ ...home, ...view }) && view.azimuth === home.azimuth"
    )
    press(page, 195, 300, moved=20)
    assert page.evaluate("[...document.getElementsByName('View')].every((button) => !button.checked)")


def test_swatches_show_the_variants(
    camera: Camera, chromium: Chromium, swatches: tuple[Path, dict[str, Instance]]
) -> None:
    path, variants = swatches
    assert path.stat().st_size < MAX_BYTES
    chromium.events.clear()
    chromium.open(path, 390, 844)
    assert chromium.evaluate(
        "[...document.getElementsByName('Colour')].map((button) => button.parentNode.innerText)"
    ) == [*variants]
    chromium.evaluate(
        f"overlay.setAttribute('hidden', ''); stage.style.flex = 'none'; stage.style.height = '{SIZE}px'; 0"
    )
    chromium.evaluate(f"stage.style.width = '{SIZE}px'; document.getElementsByName('Colour')[0].focus()")
    with offscreen((SIZE, SIZE), background=None) as pictures:
        for number, variant in enumerate(variants.values()):
            if number:
                chromium.evaluate("window.seen = parts; 0")
                chromium.send("Input.dispatchKeyEvent", type="keyDown", **ARROW)
                chromium.wait("parts !== window.seen")
            *_, baked = filter(None, bake(variant))
            expected = on_white(pictures.draw(baked, camera))
            assert psnr(on_white(chromium.picture("draw(1)")), expected) >= 35
    assert chromium.complaints() == []


def test_dimensions_stand_beside_the_object_and_can_be_hidden(
    chromium: Chromium, swatches: tuple[Path, dict[str, Instance]]
) -> None:
    path, variants = swatches
    first = next(iter(variants.values()))
    chromium.open(path, 390, 844)
    box = shown_bounds(first, natural_bounds(first))
    size = chromium.evaluate("[stage.clientWidth, stage.clientHeight]")
    drawn_ends = chromium.evaluate("[...overlay.querySelectorAll('path')].map((path) => path.getAttribute('d'))")
    texts = chromium.evaluate("[...overlay.querySelectorAll('text')].map((text) => text.textContent)")
    home = chromium.evaluate("home")
    camera = Camera(home["azimuth"], home["elevation"], home["distance"], home["focal"] * min(size), *size)
    lines = dimension_lines(box, camera, "cm")
    assert texts == [line.label for line in lines]
    for line, path_text in zip(lines, drawn_ends, strict=True):
        numbers = [float(number) for number in re.findall(r"-?[0-9.]+(?:e-?[0-9]+)?", path_text)[:4]]
        written = np.array(numbers).reshape(2, 2) * min(size) / 100
        np.testing.assert_allclose(written, line.ends + 0.03 * min(size) * line.outward, atol=0.6)
    chromium.evaluate("document.getElementsByName('Size')[0].click()")
    assert chromium.evaluate("getComputedStyle(overlay).display") == "none"


ANDROID = "Object.defineProperty(navigator, 'userAgent', { get: () => 'Android' })"
IPHONE = "DOMTokenList.prototype.supports = (name) => name === 'ar'"


@pytest.mark.parametrize(
    ("device", "words"), [("", "on an iPhone"), (ANDROID, "stool.room.glb on a web server"), (IPHONE, None)]
)
def test_phones_place_the_object_in_a_room(
    chromium: Chromium, swatches: tuple[Path, dict[str, Instance]], device: str, words: str | None
) -> None:
    path, variants = swatches
    with chromium.before_pages(device):
        chromium.open(path, 390, 844)
    chromium.wait("document.querySelector('nav a')?.href")
    if words:
        chromium.evaluate("document.querySelector('nav a').click()")
        assert words in chromium.evaluate("document.getElementById('hint').innerText")
    else:
        link = "document.querySelector('nav a')"
        assert chromium.evaluate(f"[{link}.rel, {link}.childNodes.length, {link}.firstChild.tagName]") == [
            "ar",
            1,
            "IMG",
        ]
        content = "bytes(scene.room.usdz).then((file) => [...file.slice(0, 4)])"
        assert chromium.evaluate(content) == [*b"PK\x03\x04"]
        document = gltf_of(path.with_name(f"{path.stem}.room.glb").read_bytes())
        names = [entry["name"] for entry in document["extensions"]["KHR_materials_variants"]["variants"]]
        assert names == [*variants]
