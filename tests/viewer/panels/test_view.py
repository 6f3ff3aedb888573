import time
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui

from core.detail.progressive import render_frame
from core.export.framing import filling_distance
from core.models.model import Model
from tests.core.tiny import tiny_model
from tests.viewer.driver import Driver, in_window
from tests.viewer.stand_ins import detailed_fit, endless_fit
from viewer.values import orbit
from viewer.values.objects import EditableObject
from viewer.values.view_modes import MODES


def stools(name: str) -> Model:
    """The model of stools that the drawn images are of."""
    return replace(tiny_model(), category="chairs")


@in_window()
def test_a_drag_turns_the_object_and_is_one_step_of_undo(window: Driver) -> None:
    first_scene = window.editor.scene
    assert window.context.preferences.newcomer
    window.drag("View/orbit", 150, 40)
    turned = window.editor.scene.camera
    assert turned.azimuth < first_scene.camera.azimuth
    assert turned.elevation > first_scene.camera.elevation
    assert turned.distance == first_scene.camera.distance
    assert not window.context.preferences.newcomer
    window.undo()
    assert window.editor.scene == first_scene
    assert not window.editor.history.past
    window.redo()
    assert window.editor.scene.camera == turned
    window.undo()
    window.press(imgui.Key.mod_ctrl, imgui.Key.mod_shift, imgui.Key.z)
    assert window.editor.scene.camera == turned
    window.click("View/###undo")
    assert window.editor.scene == first_scene
    window.click("View/###redo")
    assert window.editor.scene.camera == turned
    window.ctx.key_down(imgui.Key.mod_shift)  # finely
    window.drag("View/orbit", 150)
    window.ctx.key_up(imgui.Key.mod_shift)
    assert 0 < turned.azimuth - window.editor.scene.camera.azimuth < 0.3 * (first_scene.camera.azimuth - turned.azimuth)


@in_window(size=(900, 600))
def test_the_way_in_is_in_the_view_until_something_is_opened(window: Driver, monkeypatch: pytest.MonkeyPatch) -> None:
    started = list[Path]()
    monkeypatch.setattr(window.fitting, "start", started.append)
    window.click("View/**/sample cushion")
    assert [path.name for path in started] == ["cushion.png"]
    window.click("View/**/###fit_image")
    assert window.context.files.asking
    window.ctx.item_click("//Choose a file###ask/Cancel")
    window.drag("View/orbit", 40)
    window.ctx.yield_(2)
    assert window.exists("View/**/sample cushion")  # to turn the object makes nothing
    assert window.exists("View/**/###fit_image") and not window.exists("Library/###fit_image")
    window.show("Photo")
    assert window.exists("Photo/sample cushion")
    for _ in range(9):
        window.press(imgui.Key.r)
    window.ctx.yield_(2)
    card = window.ctx.item_info("//View/**/sample cushion").rect_full
    strip = window.ctx.window_info("//History").window
    assert strip.pos.x + strip.size.x < card.min.x  # an edit opens nothing, and hides no sample
    window.editor.add_and_show(EditableObject("opened", window.editor.scene.instance), window.session.viewport.camera)
    window.ctx.yield_(2)
    assert not window.exists("View/**/sample cushion")
    assert not window.exists("View/**/###fit_image") and window.exists("Library/**/###fit_image")


@in_window(size=(900, 600))
def test_the_card_of_a_low_window_leaves_room_for_the_object(window: Driver) -> None:
    low, high = window.context.view
    assert 0 < window.context.covered < 0.25 * (high.y - low.y)
    assert window.session.viewport.settings.covered == round(window.context.covered)


@in_window()
def test_the_first_hint_is_beside_the_buttons_and_covers_no_part(window: Driver) -> None:
    low, high = window.context.view
    images = []
    window.wait(lambda: window.session.viewport.sharp)
    for newcomer in (True, False):
        window.context.set_preference(newcomer=newcomer)
        images.append(window.capture_view())
    rows = np.flatnonzero(np.abs(images[0] - images[1]).max((1, 2)) > 20)
    assert rows.size and rows.max() < 40 < high.y - low.y  # px, where the buttons end


@in_window()
def test_wheel_and_keys_move_the_camera_and_a_double_click_brings_it_back(window: Driver) -> None:
    ctx = window.ctx
    home = window.editor.scene.camera
    ctx.mouse_move("//View/orbit")
    for _ in range(3):
        ctx.mouse_wheel_y(1.0)
    window.wait()
    assert window.editor.scene.camera.distance < home.distance
    assert max(map(abs, window.session.viewport.settings.pan)) < 0.1
    low, high = window.context.view
    ctx.mouse_move_to_pos(low + (high - low) * 0.75)
    ctx.mouse_wheel_y(1.0)
    assert max(window.session.viewport.settings.pan) < -0.01  # what is under the mouse stays there
    time.sleep(0.7)
    ctx.yield_(2)
    window.press(imgui.Key.right_arrow)
    assert window.editor.scene.camera.azimuth > home.azimuth
    assert len(window.editor.history.past) == 1  # moves of the camera are one step
    io = imgui.get_io()
    io.mouse_single_click_delay, io.mouse_double_click_time = 11.0, 10.0  # s: frames of a busy machine take long
    ctx.item_double_click("//View/orbit")
    ctx.yield_(2)
    assert (window.editor.scene.camera, window.session.viewport.settings.pan) == (home, (0.0, 0.0))
    window.drag("View/orbit", 60)
    window.click("View/###reset_view")
    assert window.editor.scene.camera == home


@in_window()
def test_the_image_on_screen_is_the_newest_frame_over_the_background(window: Driver, tmp_path: Path) -> None:
    window.drag("View/orbit", 60)
    window.wait(lambda: window.session.viewport.sharp)  # a finer frame comes once the hand has rested
    screen = window.capture_view()
    frame = window.session.viewport.frame
    rows = ((np.arange(screen.shape[0]) + 0.5) * frame.image.shape[0] / screen.shape[0]).astype(int)
    columns = ((np.arange(screen.shape[1]) + 0.5) * frame.image.shape[1] / screen.shape[1]).astype(int)
    expected = frame.image[rows][:, columns].astype(float)
    covered = frame.opacity[rows][:, columns] > 0.5
    covered[:80], covered[-210:] = False, False  # buttons, badge, and the card of the start
    assert covered.sum() > 1000
    alike = np.abs(screen - expected).max(-1) <= 2
    assert alike[covered].mean() > 0.98  # but for the mouse, and edges between pixels


@in_window()
def test_the_other_buttons_pan_the_object(window: Driver) -> None:
    first_scene = window.editor.scene

    def middle() -> float:
        frame = window.session.viewport.frame
        return frame.opacity.nonzero()[1].mean() / frame.resolution[0]

    for button in (1, 2):
        usual = middle()
        window.ctx.mouse_move("//View/orbit")
        window.ctx.mouse_down(button)
        pressed_at = imgui.get_mouse_pos()
        window.ctx.mouse_move_to_pos((pressed_at.x + 100, pressed_at.y))
        window.ctx.mouse_up(button)
        window.wait()
        assert window.editor.scene == first_scene
        assert window.session.viewport.settings.pan[0] > 0.1
        assert middle() > usual + 0.05
        window.press(imgui.Key._0)
        window.wait()
        assert window.session.viewport.settings.pan == (0.0, 0.0)


@in_window(fixture="real_backend")
def test_depth_normals_opacity_and_samples_are_shown(window: Driver, tmp_path: Path) -> None:
    images = []
    for mode in MODES:
        window.session.viewport.change(mode=mode)
        window.ctx.yield_(2)
        images.append(window.capture_view(border=60))
    assert all(np.abs(first - second).mean() > 1 for first, second in combinations(images, 2))
    assert window.session.messages.errors == []


@in_window()
def test_seven_images_of_turn_side_undo_undo_redo_redo(window: Driver) -> None:
    def turn(window: Driver) -> None:
        window.drag("View/orbit", 150)

    def see_the_side(window: Driver) -> None:
        window.press(imgui.Key._2)

    def image() -> np.ndarray:
        window.ctx.mouse_move("//Mix/slot B")  # the tooltip is not in the view
        window.wait()
        window.wait(lambda: window.session.viewport.sharp)  # every pixel comes once the hand rests
        return window.capture_view(border=80)

    window.context.set_preference(newcomer=False)
    images = [image()]
    for step in (turn, see_the_side, Driver.undo, Driver.undo, Driver.redo, Driver.redo):
        step(window)
        images.append(image())
    assert min(np.abs(a - b).mean() for a, b in combinations(images[:3], 2)) > 0.5
    first, second, third, *later = images
    for image_later, expected in zip(later, (second, first, second, third), strict=True):
        np.testing.assert_allclose(image_later, expected, atol=1)


@in_window("real_backend", (900, 600), load_model=stools)
def test_opengl_turns_the_object_where_it_is_fast_and_the_exact_picture_follows(window: Driver) -> None:
    context = window.context
    viewport = window.session.viewport
    viewport.change(detail=32, samples=32)  # it is sharpened to every pixel
    window.drag("View/orbit", 30)
    context.fast_opengl = True
    window.ctx.mouse_move("//Mix/slot B")  # the tooltip is not in the view
    window.wait(lambda: viewport.baked is not None and viewport.baked.cells == 128 and viewport.sharp)
    exact = window.capture_view(border=80)
    window.app.each_frame = viewport.render  # as a hand that never rests
    window.wait(lambda: viewport.baked_frame is not None)
    turned = window.capture_view(border=80)
    assert viewport.baked_frame is not None
    assert 0 < np.sqrt(np.square(turned - exact).mean()) < 6
    assert np.abs(exact - exact[0, 0]).max() > 50
    window.app.each_frame = lambda: None
    window.wait(lambda: viewport.baked_frame is None and viewport.sharp)
    window.ctx.mouse_move("//View/orbit")
    viewport.change(mode="depth")  # nothing is baked of that
    window.drag("View/orbit", 30)
    assert viewport.baked_frame is None
    assert window.session.messages.errors == []


@in_window("real_backend", (900, 600), load_model=stools)
def test_the_shadow_stays_while_the_object_turns(window: Driver) -> None:
    context = window.context
    viewport = window.session.viewport

    def seen() -> np.ndarray:
        low, high = context.view
        window.ctx.mouse_move_to_pos(((low.x + high.x) / 2, low.y + 20))  # in the border, where nothing has a tooltip
        return window.capture_view(border=100)

    viewport.change(detail=32, samples=32)  # it is sharpened to every pixel
    window.drag("View/orbit", 30)
    context.fast_opengl = True
    window.wait(lambda: viewport.baked is not None and viewport.baked.cells == 128 and viewport.sharp)
    with_shadow = seen()
    frame, crop = viewport.full_frame
    viewport.full_frame = replace(frame, shadow=None), crop
    viewport.frame = viewport.full_frame[0]
    plain = seen()
    ground = (plain - with_shadow).mean(-1) > 3
    assert 200 < ground.sum() < 0.3 * ground.size
    assert (with_shadow <= plain + 1).all()
    window.app.each_frame = viewport.render  # as a hand that never rests
    window.wait(lambda: viewport.baked_frame is not None)
    assert np.median(np.abs(seen() - with_shadow)[ground]) < 2  # it does not jump
    assert window.session.messages.errors == []


@in_window(size=(900, 600), load_model=stools, distance=filling_distance, fit=detailed_fit)
def test_a_chosen_object_and_a_result_fill_three_quarters_of_the_view(window: Driver, photo: Path) -> None:
    viewport = window.session.viewport

    def filled() -> float:
        window.wait(lambda: not window.session.jobs.busy("framing"))
        crop = orbit.fit_to_panel(window.editor.scene.camera, *viewport.settings.panel, 192)
        opaque = render_frame(window.editor.scene.instance, crop.camera).opacity > 0.2
        ends = (np.flatnonzero(opaque.any(axis))[[0, -1]] / opaque.shape[1 - axis] for axis in (0, 1))
        return max(np.abs(2 * both - 1).max() for both in ends)

    assert filled() == pytest.approx(0.75, abs=0.06)
    crop = viewport.request.crop(64)
    _, height = viewport.settings.panel
    opaque = crop.cropped(render_frame(window.editor.scene.instance, crop.camera)).opacity > 0.2
    assert viewport.settings.covered > 50  # by the card with the samples
    assert not opaque[round(len(opaque) * (1 - viewport.settings.covered / height)) :].any()
    window.click(f"Library/**/show {[*next(iter(window.editor.objects.families.values()))][2]}")
    assert filled() == pytest.approx(0.75, abs=0.06)
    assert len(window.editor.history.past) == 1
    assert viewport.settings.covered > 50  # the samples stay
    window.fit(photo)
    assert filled() == pytest.approx(0.75, abs=0.06)
    assert orbit.same_direction(window.editor.scene.camera, window.fitting.view.camera)
    window.press(imgui.Key._4)
    assert window.editor.scene.camera == window.session.photo_camera
    assert window.session.messages.errors == []


@in_window(fit=endless_fit, distance=lambda *_: 1.1)
def test_the_object_stands_still_under_a_hand_and_a_first_fit_has_its_own_camera(window: Driver, photo: Path) -> None:
    viewport = window.session.viewport
    covered = viewport.settings.covered
    assert covered > 50
    window.drag("View/orbit", 60)  # the card is small now
    assert viewport.settings.covered == covered
    window.context.drop([str(photo)])
    window.wait(lambda: viewport.source == "fit")
    window.ctx.yield_(3)
    assert viewport.settings.covered == 0
    assert not viewport.turned
    window.fitting.stop()
    window.wait()
    assert orbit.same_direction(window.editor.scene.camera, window.fitting.view.camera)


@in_window(fit=endless_fit)
def test_the_view_is_turned_around_a_growing_fit_and_follow_returns(window: Driver, photo: Path) -> None:
    viewport = window.session.viewport
    window.context.drop([str(photo)])
    window.wait(lambda: viewport.source == "fit")
    window.drag("View/orbit", 120)
    assert viewport.following
    assert viewport.turned
    assert viewport.source == "fit"
    assert window.editor.scene.camera.azimuth != pytest.approx(1.0, abs=0.1)
    window.ctx.yield_(3)
    window.click("Library/**/waits block.png")
    assert not viewport.turned
    window.wait(lambda: viewport.full_frame[1].camera.azimuth == pytest.approx(1.0))
    window.press(imgui.Key.r)  # another shape and texture
    assert viewport.source == "scene"
    window.click("Library/**/waits block.png")
    window.wait(lambda: viewport.source == "fit")
    window.fitting.stop()
    window.wait()
    assert window.editor.state.mix.a.shape == "block"


@in_window()
def test_a_tool_ends_when_another_object_is_shown(window: Driver) -> None:
    window.context.tool = "erase"
    window.click("Library/**/show object 3")
    window.ctx.yield_(2)
    assert window.context.tool == "turn"


@in_window()
def test_the_history_is_out_of_the_way_of_share(window: Driver) -> None:
    window.press(imgui.Key.r)
    window.press(imgui.Key.r)
    assert window.exists("History/state 1")
    window.press(imgui.Key.mod_ctrl, imgui.Key.e)
    assert not imgui.internal.find_window_by_name("History").active
