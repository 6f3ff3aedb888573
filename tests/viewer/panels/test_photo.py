import math
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui

from core.edits.paint import PartPaint, Rgb
from core.fitting.fit import FitJob, FitStep
from core.models.model import Instance, Model
from core.models.photo_detail import Erasure
from core.photos.photo import Photo, read_cut_out
from core.photos.segmentation import CutOut, Hints
from tests.viewer.driver import Drive, Driver, in_window, opened
from tests.viewer.stand_ins import (
    block,
    crowded,
    detailed_fit,
    doubted,
    endless_fit,
    quick_colour,
    quick_fit,
    quick_paint,
    quick_photo,
)
from tests.viewer.test_editor import fitted
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.values import orbit
from viewer.values.fit_history import PhotoSource
from viewer.values.paints import paints_of, rgb
from viewer.widgets.user_objects import COLOURS


def newest_paint(editor: Editor) -> Rgb:
    return editor.scene.instance.codes.of_kind(PartPaint)[-1].colour


@in_window(fit=detailed_fit)
def test_photo_and_view_are_compared_from_the_photo_s_camera(window: Driver, photo: Path) -> None:
    context = window.context
    window.fit(photo)
    first, low, high = window.editor.scene.camera, *context.view
    middle = int((low.y + high.y) / 2), int((low.x + high.x) / 2)
    window.press(imgui.Key._4)
    window.wait()
    assert context.tool == "wipe"
    assert window.editor.scene.camera == window.session.photo_camera != first
    history = window.editor.history
    window.drag("View/orbit", -400)
    render = window.capture()
    window.drag("View/orbit", 400)
    np.testing.assert_allclose(window.capture()[middle], (200, 30, 30), atol=12)  # the red block
    assert abs(render[middle] - (200, 30, 30)).max() > 30
    assert window.editor.history is history
    window.press(imgui.Key._4)
    assert context.tool == "turn"
    np.testing.assert_allclose(window.capture()[middle], render[middle], atol=3)
    window.click("Photo/###wipe")
    assert context.tool == "wipe"
    window.click("Photo/###wipe")
    assert context.tool == "turn"
    window.drag("View/orbit", 100)
    assert window.editor.scene.camera != window.session.photo_camera


@in_window()
def test_detail_is_erased_on_the_object_with_a_brush_of_any_size(window: Driver, model: Model, tmp_path: Path) -> None:
    window.editor.add_and_show(fitted(model), window.editor.scene.camera)
    window.show("Photo")
    unerased = window.editor.state

    def erased() -> tuple[Erasure, ...]:
        detail = window.editor.scene.instance.detail
        return detail.views[0].erased

    window.click("Photo/###erase")
    window.wait()
    assert window.editor.scene.camera == window.session.photo_camera
    from_photo = window.editor.state
    window.drag("View/orbit", 40)
    (stroke,) = erased()
    xs = [x for x, _ in stroke.points]
    assert len(xs) > 1 and xs[-1] > xs[0]
    assert window.editor.history.past[-1] == from_photo, "a stroke is one step"
    window.ctx.mouse_wheel_y(4.0)
    window.ctx.yield_(2)
    window.drag("View/orbit", 40)
    assert erased()[1].radius > 1.5 * stroke.radius
    window.session.save_project(tmp_path / "a.codenerf")
    again = opened(tmp_path / "a.codenerf", window.session).history.now
    assert again.scene.instance.detail == window.editor.scene.instance.detail
    for _ in range(3):
        window.undo()
    assert erased() == ()
    assert window.editor.state == unerased


@in_window()
def test_a_fit_is_begun_again_in_several_ways(window: Driver, photo: Path) -> None:
    window.fit(photo)
    window.drag("View/orbit", 150)
    turned = window.editor.scene.camera
    window.click("Photo/###again")
    window.click("**/###resume from view")
    window.wait(lambda: not window.fitting.running)
    assert orbit.same_direction(window.fitting.view.camera, turned)
    assert window.editor.objects.own[:2] == ["block (2)", "block"]
    window.click("Photo/###again")
    window.click("**/###restart")
    window.wait(lambda: not window.fitting.running)
    assert len(window.fitting.history.steps) == 10
    assert not orbit.same_direction(window.fitting.view.camera, turned)


@pytest.mark.parametrize("margin", [0.0, 9.0])
def test_a_doubtful_fit_alone_offers_its_other_viewpoint(drive: Drive, backend: Backend, photo: Path, margin: float):
    def rated(model: Model, job: FitJob) -> Iterator[FitStep]:
        return (replace(step, margin=margin, psnr=40.0) for step in quick_fit(model, job))

    def act(window: Driver) -> None:
        window.fit(photo)
        after_fit = window.editor.state
        assert window.exists("Photo/###viewpoint") == (margin == 0.0)
        if margin:
            return
        window.click("Photo/###viewpoint")
        assert window.editor.scene.camera.azimuth == pytest.approx(1.0 + math.pi)
        assert window.fitting.view.from_runner_up
        assert window.editor.scene.instance == after_fit.scene.instance
        window.click("Photo/###viewpoint")
        assert window.editor.scene.camera.azimuth == pytest.approx(1.0)
        assert not window.exists("Photo/###fit from here")
        window.undo()
        assert window.editor.scene.camera.azimuth == pytest.approx(1.0 + math.pi)
        window.click("Photo/###viewpoint")
        window.click("Photo/###fit from here")
        window.wait(lambda: not window.fitting.running)
        assert len(window.editor.objects.own) == 2

    drive(act, replace(backend, fit=rated))


def test_a_new_photo_is_not_shown_as_the_object_on_screen(
    drive: Drive, backend: Backend, model: Model, photo: Path
) -> None:
    goes_on = threading.Event()

    def slow(path: Path, hints: Hints | None) -> CutOut:
        goes_on.wait()
        return read_cut_out(path, hints)

    def act(window: Driver) -> None:
        window.editor.add_and_show(fitted(model), window.editor.scene.camera)
        window.show("Photo")
        assert window.exists("Photo/photo")
        try:
            window.context.drop([str(photo)])
            window.ctx.yield_(3)
            assert window.exists("Photo/###stop fit") and not window.exists("Photo/photo")
            window.click("Library/**/show object 5")
            assert window.exists("View/badge")  # it is still the object before
        finally:
            goes_on.set()
        window.wait(lambda: not window.fitting.running)

    drive(act, replace(backend, cut_out=slow))


@in_window(fit=endless_fit)
def test_the_panel_shows_the_fit_of_the_object_in_the_view(window: Driver, model: Model, photo: Path) -> None:
    editor = window.editor
    assert not window.exists("Photo/##photo detail")
    editor.add_and_show(fitted(model), editor.scene.camera)
    window.show("Photo")
    assert window.exists("Photo/##photo detail")
    window.context.drop([str(photo)])
    window.wait(lambda: len(window.session.fitting.history.steps) > 3)
    window.ctx.yield_(3)
    assert window.exists("Photo/###stop fit")
    assert not window.exists("Photo/##photo detail")  # that would be another object's
    window.click("Library/**/show fitted")
    assert window.exists("Photo/##photo detail")
    assert not window.exists("Photo/###stop fit")
    window.click("Library/**/show object 5")
    assert window.exists("Photo/sample cushion")
    assert window.exists("Photo/###original paint")
    window.session.fitting.stop()


@in_window(fixture="both", cut_out=doubted)
def test_a_doubtful_cut_out_is_answered_by_one_click(window: Driver, photo: Path) -> None:
    window.ask_about(photo)
    assert window.exists("Photo/photo")
    assert window.session.messages.newest is None
    window.click("Photo/###as chairs")
    window.wait(lambda: not window.fitting.running)
    assert window.editor.objects.own == ["block"]
    assert window.editor.model.category == "chairs"
    window.ask_about(photo)
    window.click("Photo/###this one")
    window.wait(lambda: not window.fitting.running)
    assert window.editor.model.category == "cars"
    window.ask_about(photo)
    window.click("Photo/###leave photo")
    assert not (window.fitting.questions or window.fitting.running)
    window.ask_about(photo)
    window.click("Photo/###point at it")
    assert window.session.segmenting.active
    window.session.segmenting.close()


@in_window(cut_out=crowded)
def test_a_click_on_a_numbered_box_fits_that_object(window: Driver, photo: Path) -> None:
    window.ask_about(photo)
    window.click("Photo/object 1")
    window.wait(lambda: not window.fitting.running)
    assert window.editor.objects.own == ["block"]
    window.click("Photo/object 2")  # the other one, later
    window.wait(lambda: not window.fitting.running)
    assert window.editor.objects.own == ["block (2)", "block"]
    assert window.fitting.shown.sources[0].hints.box == window.fitting.shown.photo.preview.boxes[1]


@in_window(paint=quick_paint, paint_colour=quick_colour)
def test_paint_is_picked_from_photo_and_view_and_taken_off(window: Driver, model: Model) -> None:
    window.editor.add_and_show(fitted(model), window.editor.scene.camera)
    window.show("Photo")
    window.wait()
    unpainted = window.editor.state
    past = len(window.editor.history.past)
    for red in (0.2, 0.5, 0.9):  # a drag over colours
        window.session.painting.paint((red, 0.0, 0.0))
    window.wait()
    assert newest_paint(window.editor)[0] == pytest.approx(0.9)
    assert len(window.editor.history.past) == past + 1
    window.click("Photo/###pick colour")
    window.click("Photo/photo")
    window.wait()
    assert newest_paint(window.editor) == pytest.approx([1.0, 0.0, 0.0], abs=0.05)  # the photo's red
    window.click("Photo/###pick colour")
    window.click("View/orbit")
    window.wait()
    assert window.context.tool == "turn"
    assert len(window.editor.history.past) == past + 3
    window.click("Photo/###original paint")
    assert window.editor.scene.instance == unpainted.scene.instance
    for _ in range(4):
        window.undo()
    assert window.editor.state == unpainted


@in_window(paint=quick_paint, paint_colour=quick_colour)
def test_esc_ends_a_drag_over_colours_without_a_paint(window: Driver) -> None:
    unpainted = window.editor.state
    window.show("Photo")
    window.wait()
    window.click("Photo/###paint")
    window.ctx.mouse_move("**/square")
    window.ctx.mouse_down(0)
    window.ctx.mouse_move_to_pos(imgui.get_mouse_pos() + imgui.ImVec2(20, 10))
    assert window.session.painting.dragged
    window.press(imgui.Key.escape)
    window.ctx.mouse_up(0)
    window.wait()
    assert window.editor.state == unpainted and not window.context.preferences.paints


@in_window(paint=quick_paint, paint_colour=quick_colour)
def test_one_click_on_a_swatch_paints_and_other_colours_are_remembered(window: Driver) -> None:
    past = len(window.editor.history.past)
    window.show("Photo")
    window.wait()
    name, paint = next(iter(paints_of(window.session.painting.part).items()))
    window.click("Photo/###swatch 1")
    window.wait()
    assert newest_paint(window.editor) == pytest.approx(rgb(paint)), name
    assert len(window.editor.history.past) == past + 1
    assert not window.context.preferences.paints
    window.click("Photo/###paint")
    window.drag("**/square", 30, -20)
    window.press(imgui.Key.escape)
    window.wait()
    assert len(window.editor.history.past) == past + 2
    (remembered,) = window.context.preferences.paints
    assert newest_paint(window.editor) == pytest.approx(rgb(remembered), abs=0.01)
    window.undo()
    window.click("Photo/###swatch 13")
    window.wait()
    assert newest_paint(window.editor) == pytest.approx(rgb(remembered), abs=0.01)
    window.undo()
    window.undo()
    assert len(window.editor.history.past) == past


@in_window()
def test_the_strength_of_the_photo_detail_is_a_slider(window: Driver, model: Model) -> None:
    window.editor.add_and_show(fitted(model), window.editor.scene.camera)
    window.show("Photo")
    full_strength = window.editor.state
    window.drag("Photo/##photo detail", -60)
    assert window.editor.scene.instance.detail.strength < 1
    window.undo()
    assert window.editor.state == full_strength


@in_window()
def test_several_photos_are_fitted_together(window: Driver, photo: Path, tmp_path: Path) -> None:
    (tmp_path / "other.txt").write_text("words")
    window.context.drop([str(photo), str(block(photo, "b"))])
    window.wait(lambda: bool(window.fitting.history.steps) and not window.fitting.running)
    window.click("Photo/photo 2")
    window.wait()
    assert window.fitting.history.photo_index == 1
    window.click("Photo/###add photo")
    window.type(str(block(photo, "c")))
    window.wait(lambda: len(window.fitting.history.photos) == 3 and not window.fitting.running)
    window.click("Photo/photo 3")
    assert window.fitting.history.photo_index == 2
    window.click("Photo/photo 3", 1)
    window.click("**/###side back")
    window.wait(lambda: window.fitting.history.sources[2].side == "back" and not window.fitting.running)
    assert [fitted.photo.side for fitted in window.fitting.history.photos] == [None, None, "back"]
    window.click("Photo/photo 1", 1)
    window.click("**/###remove photo")
    window.wait(lambda: len(window.fitting.history.photos) == 2 and not window.fitting.running)
    assert [source.side for source in window.fitting.history.sources] == [None, "back"]
    window.context.drop([str(photo), str(tmp_path / "other.txt")])
    assert "1 of 2 are no photos: other.txt" in window.session.messages.newest.text


@pytest.mark.parametrize(
    ("margin", "psnr", "second", "left_out", "words"),
    [
        (9, 30, "cars", (), "sure"),
        (0, 30, "cars", (), "doubtful"),  # as the dot of its tile
        (9, 12, "cars", (), "doubtful"),
        (9, 30, "chairs", (), "doubtful"),
        (9, 30, "cars", (1,), "doubtful"),
    ],
)
def test_several_photos_agree_or_not_by_a_dot(
    drive: Drive,
    backend: Backend,
    photo: Path,
    margin: float,
    psnr: float,
    second: str,
    left_out: tuple[int, ...],
    words: str,
) -> None:
    second_photo = block(photo, "two")

    def rated(model: Model, job: FitJob) -> Iterator[FitStep]:
        return (replace(step, margin=margin, psnr=psnr, left_out=left_out) for step in quick_fit(model, job))

    def told(cut: CutOut, model: Model, source: PhotoSource) -> Photo:
        category = second if source.path == second_photo else "cars"
        return replace(quick_photo(cut, model, source), categories={category: 0.9})

    def act(window: Driver) -> None:
        window.fit(photo, second_photo)
        window.show("Photo")
        again = window.ctx.item_info("//Photo/###again").rect_full
        line = window.capture()[int(again.max.y) : int(again.max.y) + 30, int(again.min.x) - 120 :]
        dots = [name for name, colour in COLOURS.items() if (abs(line - 255 * np.array(colour)).max(-1) < 2).sum() > 20]
        assert dots == [words]

    drive(act, replace(backend, fit=rated, frame_photo=told))


def test_a_swatch_never_shows_the_colour_of_another_object(drive: Drive, backend: Backend) -> None:
    may_measure = threading.Event()
    may_measure.set()

    def slow_colour(instance: Instance, part_name: str) -> Iterator[None]:
        while not may_measure.is_set():
            time.sleep(0.01)
            yield None
        return (yield from quick_colour(instance, part_name))

    def swatch(window: Driver) -> np.ndarray:
        centre = window.ctx.item_info("//Photo/###paint").rect_full.get_center()
        return window.capture()[int(centre.y), int(centre.x)]

    def act(window: Driver) -> None:
        window.show("Photo")
        window.wait()
        first_colour = swatch(window)
        may_measure.clear()
        window.click("Library/**/show object 3")
        window.wait_for_view()
        window.ctx.yield_(3)
        assert window.session.painting.colour is None
        assert np.abs(swatch(window) - 128).max() < 3 < np.abs(first_colour - 128).max()  # grey
        may_measure.set()
        window.wait(lambda: window.session.painting.colour is not None)
        window.ctx.yield_(2)
        colour = 255 * window.editor.scene.instance.codes.texture[:3].clamp(0, 1).numpy()
        assert np.abs(swatch(window) - colour).max() < 3

    drive(act, replace(backend, paint_colour=slow_colour))
