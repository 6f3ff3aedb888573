from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui
from PIL import Image

from core.photos.photo import read_cut_out
from core.photos.saliency import predict_saliency
from tests.core.tiny import tiny_model
from tests.viewer.driver import Drive, Driver, in_window
from viewer.services.backend import Backend
from viewer.values.fit_history import PhotoSource

_SAMPLES = Path(__file__).parents[3] / "assets" / "samples"
_BOX = (0.15, 0.15), (0.4, 0.5), (0.7, 0.85)
"""around the blue block of ``busy``"""


@pytest.fixture
def busy(tmp_path: Path) -> Path:
    """A photo of a blue and a red block on noise."""
    noise = np.random.default_rng(0).integers(60, 200, (160, 240, 3)).astype(np.uint8)
    noise[40:120, 60:120] = (30, 40, 220)
    noise[50:70, 130:150] = (220, 30, 30)
    Image.fromarray(noise).save(tmp_path / "busy.png")
    return tmp_path / "busy.png"


class _Canvas:
    """The photo of the dialog, drawn on with the mouse; places are shares of its width and height."""

    def __init__(self, window: Driver) -> None:
        self.window = window
        self.box = window.ctx.item_info("//Cut out###segment/**/canvas").rect_full

    def place(self, x: float, y: float) -> imgui.ImVec2:
        """A place in pixels of the window."""
        low = self.box.min
        high = self.box.max
        return imgui.ImVec2(low.x + x * (high.x - low.x), low.y + y * (high.y - low.y))

    def draw(self, *fractions: tuple[float, float]) -> None:
        """A stroke through these places, or a box between the first and the last."""
        ctx = self.window.ctx
        first, *later = (self.place(*position) for position in fractions)
        ctx.mouse_move_to_pos(first)
        ctx.mouse_down()
        for position in later:
            ctx.mouse_move_to_pos(position)
            ctx.yield_()
        ctx.mouse_up()
        self.window.wait()

    def covered(self, x: float, y: float) -> bool:
        """Whether the object was found at this place."""
        result = self.window.session.segmenting.result
        mask = result.cut.mask
        return bool(mask[int(y * mask.shape[0]), int(x * mask.shape[1])])


def _drop(window: Driver, photo: Path) -> _Canvas:
    """Open the dialog with a photo."""
    window.session.segmenting.open((PhotoSource(photo),), 0)
    window.wait(lambda: window.session.segmenting.active and not window.session.jobs.busy())
    return _Canvas(window)


@in_window(load_model=lambda name: tiny_model())
def test_a_photo_on_busy_background_is_segmented_by_strokes(window: Driver, busy: Path) -> None:
    segmenting = window.session.segmenting
    history = window.editor.history
    canvas = _drop(window, busy)
    window.press(imgui.Key.f1)
    assert not window.context.help_open
    assert window.session.messages.errors == []
    assert window.editor.history is history
    canvas.draw(*_BOX)
    assert segmenting.hints.box == pytest.approx((0.15, 0.15, 0.7, 0.85), abs=0.01)
    assert canvas.covered(0.38, 0.5)
    window.click("Cut out###segment/**/Remove")
    canvas.draw((0.5, 0.37), (0.64, 0.37), (0.64, 0.4))
    assert not canvas.covered(0.58, 0.37)
    window.click("Cut out###segment/**/Add")
    canvas.draw((0.55, 0.7), (0.6, 0.7))
    assert canvas.covered(0.58, 0.7)
    window.undo()
    window.wait()
    assert not canvas.covered(0.58, 0.7)
    window.ctx.mouse_move_to_pos(canvas.place(0.5, 0.5))
    window.ctx.mouse_wheel_y(4.0)
    window.ctx.yield_(2)
    before_zoom = segmenting.hints
    canvas.draw((0.4, 0.4), (0.6, 0.6))  # nearer, so a stroke of half the length
    (near,) = segmenting.hints.strokes[len(before_zoom.strokes) :]
    assert 0.05 < near.points[-1][0] - near.points[0][0] < 0.15
    window.undo()
    window.wait()
    assert segmenting.settled
    assert segmenting.hints == before_zoom
    window.click("Cut out###segment/**/###cancel segmentation")


def _room(names: tuple[str, ...], seed: int) -> tuple[Image.Image, list[np.ndarray]]:
    """Sample images before a wall, on a floor, both of grainy paint; and where each object is."""
    rng = np.random.default_rng(seed)
    size = (320, 60 + 200 * len(names))
    wall = rng.uniform(120, 200, 3)
    floor = rng.uniform(60, 130, 3)
    paint = np.where(np.arange(size[0])[:, None, None] < 200, wall, floor) + rng.normal(0, 8, (*size, 3))
    room = Image.fromarray(paint.clip(0, 255).astype(np.uint8))
    masks = []
    for number, name in enumerate(names):
        cut = read_cut_out(_SAMPLES / f"{name}.png")
        corner = (200 * number, 40 + 10 * number)
        values = np.dstack((cut.pixels, cut.opacity)) * 255
        image = Image.fromarray(values.astype(np.uint8)).resize((256, 256), Image.Resampling.BICUBIC)
        room.paste(image, corner, image)
        pasted_mask = Image.new("L", room.size)
        pasted_mask.paste(image.getchannel("A"), corner)
        masks.append(np.asarray(pasted_mask) > 127)
    return room, masks


def _inside(mask: np.ndarray) -> tuple[float, float]:
    """A place on the object, next to its middle, in shares of width and height."""
    rows, columns = np.nonzero(mask)
    nearest = np.hypot(rows - rows.mean(), columns - columns.mean()).argmin()
    return (columns[nearest] + 0.5) / mask.shape[1], (rows[nearest] + 0.5) / mask.shape[0]


@pytest.mark.slow  # the network beside a window that is drawn without end
def test_one_click_finds_each_of_several_objects(
    drive: Drive, backend: Backend, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # As in the program, the network looks around the point.
    monkeypatch.setattr("core.photos.candidates.predict_saliency", predict_saliency)
    pictures = (("chairs/purple", "chairs/cushion"), ("cars/estate", "chairs/children"), ("cars/sports", "cars/hybrid"))
    rooms = [_room(names, seed) for seed, names in enumerate(pictures)]

    def act(window: Driver) -> None:
        segmenting = window.session.segmenting
        for number, (room, masks) in enumerate(rooms):
            room.save(tmp_path / f"{number}.png")
            canvas = _drop(window, tmp_path / f"{number}.png")
            for expected_mask in masks:
                canvas.draw(_inside(expected_mask))
                assert len(segmenting.hints.points) == 1
                mask = segmenting.result.cut.mask
                assert (mask & expected_mask).sum() / (mask | expected_mask).sum() > 0.8
            window.click("Cut out###segment/**/###cancel segmentation")

    drive(act, replace(backend, load_model=lambda name: tiny_model()))


@in_window(load_model=lambda name: tiny_model())
def test_a_fitted_photo_is_segmented_again_with_its_hints(window: Driver, busy: Path) -> None:
    segmenting = window.session.segmenting
    _drop(window, busy).draw(*_BOX)
    hints = segmenting.hints
    window.click("Cut out###segment/**/###fit segmentation")
    assert not segmenting.active
    window.wait(lambda: not window.fitting.running)
    assert window.editor.objects.own[0] == "busy"
    fitted = window.fitting.history.photo
    assert fitted.source.hints == hints
    assert fitted.photo.cropped
    window.click("Photo/###point at it")
    window.wait(lambda: segmenting.result is not None)
    assert segmenting.hints == hints
    window.click("Cut out###segment/**/###cancel segmentation")
    window.wait()
    assert not segmenting.active


@in_window(load_model=lambda name: tiny_model())
def test_a_photo_dropped_on_the_dialog_waits_for_its_end(window: Driver, busy: Path) -> None:
    segmenting = window.session.segmenting
    _drop(window, busy).draw(*_BOX)
    hints = segmenting.hints
    window.context.drop([str(busy.with_name("missing.png"))])
    window.wait(lambda: bool(window.session.messages.errors))
    assert segmenting.active  # with its photo
    window.context.drop([str(busy)])
    window.wait()
    assert segmenting.hints == hints
    window.click("Cut out###segment/**/###cancel segmentation")
    window.wait(lambda: bool(window.editor.objects.own))  # the one that was dropped
    assert not segmenting.active
    assert window.editor.objects.own == ["busy"]
