"""The real window, its widgets clicked and dragged by name."""

import math
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import combinations, islice
from pathlib import Path

import av
import numpy as np
import pytest
import torch
import trimesh
from imgui_bundle import hello_imgui, imgui
from imgui_bundle.immapp import testing
from PIL import Image

from core.export.keyframes import Shot
from core.files import whole_file
from core.fitting.fit import FitJob, FitStep
from core.models.codes import Codes
from core.models.field import Field
from core.models.model import Model
from core.models.pictures import save_picture
from core.models.scene import Scene
from core.photos.photo import Photo
from tests.core.tiny import tiny_model
from tests.viewer.window_driver import Driver, broken_fit, endless_fit, quick_fit, quick_frames, quick_photo
from viewer import app
from viewer.activities.exporting import VideoChoice, film
from viewer.panels import all_panels
from viewer.panels.fit import in_words
from viewer.screen.file_dialog import Wish
from viewer.session import PARTS, Streams
from viewer.values import orbit
from viewer.values.preferences import Preferences
from viewer.values.quality import QUALITIES
from viewer.values.view_modes import MODES

Drive = Callable[..., None]


def test_a_drag_turns_the_object_and_is_one_step_of_undo(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session, before = window.session, window.session.scene
        assert window.desk.likes.newcomer
        window.drag("View/orbit", 150, 40)
        turned = session.scene.camera
        assert turned.azimuth < before.camera.azimuth
        assert turned.elevation > before.camera.elevation
        assert turned.distance == before.camera.distance
        assert not window.desk.likes.newcomer
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.scene == before
        assert not session.history.past
        window.press(imgui.Key.mod_ctrl, imgui.Key.y)
        assert session.scene.camera == turned
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        window.press(imgui.Key.mod_ctrl, imgui.Key.mod_shift, imgui.Key.z)
        assert session.scene.camera == turned
        window.click("View/###undo")
        assert session.scene == before
        window.click("View/###redo")
        assert session.scene.camera == turned

    drive(act)


def test_wheel_and_keys_move_the_camera_and_a_double_click_brings_it_back(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session, ctx = window.session, window.ctx
        home = session.scene.camera
        ctx.mouse_move("//View/orbit")
        for _ in range(3):
            ctx.mouse_wheel_y(1.0)
        window.wait()
        assert session.scene.camera.distance < home.distance
        time.sleep(0.7)
        ctx.yield_(2)
        window.press(imgui.Key.right_arrow)
        assert session.scene.camera.azimuth > home.azimuth
        assert len(session.history.past) == 2
        ctx.item_double_click("//View/orbit")
        ctx.yield_(2)
        assert session.scene.camera == home
        window.drag("View/orbit", 60)
        window.click("View/###home")
        assert session.scene.camera == home

    drive(act)


def test_the_picture_on_screen_is_the_newest_frame_over_the_ground(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:

        window.desk.chose(smooth=False)
        window.drag("View/orbit", 60)
        window.wait()
        testing.capture(window.ctx, str(tmp_path / "window.png"))
        low, high = window.desk.view
        shown = np.asarray(Image.open(tmp_path / "window.png").convert("RGB"))
        shown = shown[int(low.y) : int(high.y), int(low.x) : int(high.x)].astype(float)
        frame = window.session.viewport.frame
        assert frame is not None
        rows = ((np.arange(shown.shape[0]) + 0.5) * frame.image.shape[0] / shown.shape[0]).astype(int)
        columns = ((np.arange(shown.shape[1]) + 0.5) * frame.image.shape[1] / shown.shape[1]).astype(int)
        expected = frame.image[rows][:, columns].astype(float)
        covered = frame.opacity[rows][:, columns] > 0.5
        covered[:80], covered[-80:] = False, False  # buttons and badge
        assert covered.sum() > 1000
        alike = np.abs(shown - expected).max(-1) <= 2
        assert alike[covered].mean() > 0.98  # but for the mouse, and edges between pixels

    drive(act)


def test_sliders_move_one_direction_and_can_be_reset(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Codes")
        before = session.state
        window.ctx.item_input_value("//Codes/**/##shape 2", 1.5)
        window.ctx.yield_(2)
        moved = session.space("shape").coordinates(session.code("shape"))
        assert moved[1] == pytest.approx(1.5, abs=1e-3)
        assert session.scene.codes.texture is before.scene.codes.texture
        window.drag("Codes/**/##texture 1", 40)
        assert session.state.scene.codes != before.scene.codes
        window.click("Codes/**/##texture 1", 1)
        assert session.space("texture").coordinates(session.code("texture"))[0] == pytest.approx(0, abs=1e-4)
        window.click("Codes/**/Mean##shape")
        np.testing.assert_allclose(session.code("shape"), session.space("shape").mean)
        window.click("Codes/**/Reset##shape")
        np.testing.assert_allclose(session.code("shape"), before.scene.codes.shape)
        window.click("Codes/**/###Random texture")
        while session.history.past:
            window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state == before

    drive(act)


def test_dragging_a_slider_is_one_step(drive: Drive) -> None:
    def act(window: Driver) -> None:
        before = window.session.state
        window.show("Codes")
        window.drag("Codes/**/##shape 1", 70)
        assert window.session.state != before
        assert window.session.history.past == (before,)

    drive(act)


def test_objects_are_picked_and_mixed(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.click("Objects/**/show object 2")
        window.choose("object 4", "Make it B")
        assert (session.state.mix.a, session.state.mix.b) == (("object 2", "object 2"), "object 4")
        assert session.scene.codes == model.codes[2]
        window.ctx.item_input_value("//Mix/##mix shape", 1.0)
        window.ctx.yield_(2)
        np.testing.assert_allclose(session.code("shape"), model.codes[4].shape)
        np.testing.assert_allclose(session.code("texture"), model.codes[2].texture)
        window.drag("Mix/##mix texture", 60)
        assert 0 < session.state.mix.texture <= 1
        assert session.state.mix.shape == 1.0
        past = len(session.history.past)
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state.mix.texture == 0
        assert len(session.history.past) == past - 1

    drive(act)


def test_the_pad_mixes_shape_across_and_texture_upwards(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.click("Objects/**/show object 2")
        window.choose("object 4", "Make it B")
        before = session.state
        window.click("Mix/mix pad")
        assert session.state.mix.shape == pytest.approx(0.5, abs=0.05)
        assert session.state.mix.texture == pytest.approx(0.5, abs=0.05)
        middle = session.state
        window.drag("Mix/mix pad", 300, 15)  # beyond its border
        mix = session.state.mix
        assert mix.shape == 1.0
        assert 0 < mix.texture < middle.mix.texture
        assert session.scene.codes == model.codes[2].mixed(model.codes[4], mix.shape, mix.texture)
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state == middle
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state == before

    drive(act)


def test_shape_and_texture_are_taken_from_different_thumbnails(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.drop("Objects/**/show object 3", "Mix/slot shape")
        window.choose("object 2", "Take only its texture")
        assert session.scene.codes == Codes(model.codes[3].shape, model.codes[2].texture)
        window.drop("Objects/**/show object 5", "Mix/slot B")
        assert (session.state.mix.a, session.state.mix.b) == (("object 3", "object 2"), "object 5")
        window.click("Mix/###swap")
        assert session.scene.codes == Codes(model.codes[2].shape, model.codes[3].texture)
        assert len(session.history.past) == 4

    drive(act)


def test_what_is_locked_is_left_alone(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.click("Mix/###lock shape")
        window.click("Objects/**/show object 2")
        window.drop("Objects/**/show object 3", "Mix/slot shape")
        window.click("Codes/**/###Random texture")
        assert torch.equal(session.code("shape"), model.codes[0].shape)
        assert len(session.history.past) == 2
        window.click("Mix/###lock shape")
        window.drop("Objects/**/show object 3", "Mix/slot shape")
        assert torch.equal(session.code("shape"), model.codes[3].shape)

    drive(act)


def test_a_sheet_is_filled_clicked_and_exported(drive: Drive, model: Model, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Sheet")
        window.click("Sheet/###add")
        window.choose("object 3", "Add to the sheet")
        window.drop("Objects/**/show object 5", "Sheet/###add")
        assert session.sheet.names == ("object 0", "object 1", "object 3", "object 5")
        window.wait()
        window.click("Sheet/pair 3 2")
        assert session.scene.codes == Codes(model.codes[3].shape, model.codes[1].texture)
        assert len(session.history.past) == 1
        window.click("Sheet/texture of object 1")
        assert session.sheet.names == ("object 0", "object 3", "object 5")
        window.click("Sheet/###export sheet")
        window.type(str(tmp_path / "mine"))
        window.wait()
        with Image.open(tmp_path / "mine.png") as image:
            assert image.size == (768, 768)
        window.click("Sheet/###clear sheet")
        assert session.sheet.names == ()
        assert session.errors == []

    drive(act)


def test_a_code_is_measured_and_pulled_back(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Plausible")
        window.click("Objects/**/show object 3")
        assert [session.nearest(part)[0] for part in ("shape", "texture")] == ["object 3", "object 3"]
        before, far = session.state, session.distance("shape")
        window.drag("Plausible/**/##pull shape", -60)
        assert 0 < session.distance("shape") < far
        assert session.scene.codes.texture is before.scene.codes.texture
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state == before

    drive(act)


def test_a_dropped_image_is_fitted(drive: Drive, model: Model, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:

        before = window.session.state
        window.desk.drop([str(photo)])
        window.wait(lambda: not window.session.fitting.running)
        window.wait()
        assert window.session.scene.codes == model.codes[3]
        assert window.session.gallery.names[0] == "block"
        assert window.ctx.item_exists("//Objects/**/show block")
        testing.capture(window.ctx, str(tmp_path / "fit.png"))
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert window.session.state == before

    drive(act)


def test_photo_and_render_are_compared_at_the_fitted_pose(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def shown(window: Driver, mode: str = "wipe") -> np.ndarray:
        window.ctx.mouse_move("//View/orbit")
        window.ctx.yield_(2)
        box = window.ctx.item_info(f"//Fit/{mode}").rect_clipped
        testing.capture(window.ctx, str(tmp_path / "wipe.png"))
        whole = np.asarray(Image.open(tmp_path / "wipe.png").convert("RGB")).astype(float)
        # Without captions and borders.
        return whole[int(box.min.y) + 40 : int(box.max.y) - 5, int(box.min.x) + 5 : int(box.max.x) - 5]

    def act(window: Driver) -> None:
        session = window.session
        window.desk.drop([str(photo)])
        window.wait(lambda: session.fitting.course.difference is not None and not session.fitting.running)
        window.wait()
        found = session.scene.camera
        window.click("View/###home")
        window.click("Fit/###photo camera")
        assert session.scene.camera == found
        window.click("Fit/Wipe")
        before = session.history
        window.drag("Fit/wipe", 400)
        whole_photo = shown(window)
        window.drag("Fit/wipe", -400)
        whole_render = shown(window)
        assert np.abs(whole_photo - whole_render).mean() > 5
        window.click("Fit/Onion skin")
        window.drag("Fit/onion skin", -400)
        np.testing.assert_allclose(shown(window, "onion skin"), whole_render, atol=3)
        window.drag("Fit/onion skin", 400)
        np.testing.assert_allclose(shown(window, "onion skin"), whole_photo, atol=3)
        window.click("Fit/Difference")
        assert window.ctx.item_exists("//Fit/difference")
        unlike = shown(window, "difference")
        window.ctx.key_down(imgui.Key.f)
        np.testing.assert_allclose(shown(window, "difference"), whole_photo, atol=3)
        window.ctx.key_up(imgui.Key.f)
        np.testing.assert_array_equal(shown(window, "difference"), unlike)
        window.click("Fit/Side by side")
        assert session.history is before

    drive(act)


def test_a_fit_is_scrubbed_and_a_step_restored(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session, fitting = window.session, window.session.fitting
        window.desk.drop([str(photo)])
        window.wait(lambda: not fitting.running)
        window.wait()
        found, past = session.state, len(session.history.past)
        window.drag("Fit/scrub", -60)
        course = fitting.course
        assert course.at is not None
        assert 0 < course.at < 5
        assert session.scene.codes == course.steps[course.at].codes
        assert session.scene.camera.elevation == course.steps[course.at].cameras[0].elevation
        assert len(session.history.past) == past + 1
        window.wait()
        testing.capture(window.ctx, str(tmp_path / "scrub.png"))
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state == found
        window.click("Fit/###keep step")
        name = f"block at {course.steps[course.at].seconds:.1f} s"
        assert session.gallery.names[0] == name
        assert session.state.mix.a == (name, name)
        assert session.scene.codes == course.steps[course.at].codes
        window.click("Fit/###newest")
        assert session.scene.codes == found.scene.codes
        assert fitting.course.at is None

    drive(act)


def test_a_fit_goes_on_from_a_step_and_from_the_view(drive: Drive, photo: Path) -> None:
    def act(window: Driver) -> None:
        session, fitting = window.session, window.session.fitting
        window.desk.drop([str(photo)])
        window.wait(lambda: not fitting.running)
        window.click("Fit/scrub")
        kept = fitting.course.steps[: (fitting.course.at or 0) + 1]
        window.click("Fit/###fit again")
        window.click("**/###go on")
        window.wait(lambda: not fitting.running)
        assert fitting.course.steps[: len(kept)] == kept
        assert len(fitting.course.steps) == len(kept) + 10
        seconds = [step.seconds for step in fitting.course.steps]
        assert seconds == sorted(seconds)
        assert fitting.course.last.cameras == kept[-1].cameras
        assert session.gallery.names[:2] == ["block (2)", "block"]
        window.drag("View/orbit", 150)
        turned = session.scene.camera
        window.click("Fit/###fit again")
        window.click("**/###from view")
        window.wait(lambda: not fitting.running)
        assert fitting.camera == turned
        window.click("Fit/##effort")
        window.click("**/any lens")
        assert fitting.lens
        window.click("**/any lens")
        window.click("**/draft")
        window.click("Fit/###fit again")
        window.click("**/###again")
        window.wait(lambda: not fitting.running)
        assert fitting.effort == "draft"
        assert len(fitting.course.steps) == 10
        assert fitting.camera != turned

    drive(act)


def test_the_race_is_seen_and_a_hypothesis_preferred(
    drive: Drive, streams: Streams, photo: Path, tmp_path: Path
) -> None:
    def act(window: Driver) -> None:
        session, fitting = window.session, window.session.fitting
        window.desk.drop([str(photo)])
        window.wait(lambda: sum(tile.picture is not None for tile in fitting.race.tiles) == 4)
        assert fitting.running
        testing.capture(window.ctx, str(tmp_path / "race.png"))
        third = fitting.race.tiles[2].hypothesis
        window.drag("Race/cameras", 40, 10)
        window.ctx.mouse_move("//Race/**/hypothesis 2")
        window.click("Race/**/hypothesis 3")
        window.wait(lambda: fitting.running and fitting.race.tiles[0].hypothesis.start == third.start)
        assert fitting.race.tiles[0].hypothesis.cameras[0].azimuth == third.cameras[0].azimuth
        window.show("Objects")
        window.click("Fit/###stop fit")
        assert session.scene.camera.azimuth == third.cameras[0].azimuth
        window.wait()
        assert window.ctx.item_exists("//Objects/**/show block")
        window.show("Race")
        assert window.ctx.item_exists("//Race/cameras")

    def held(model: Model, job: FitJob) -> Iterator[FitStep]:
        while True:
            for step in islice(quick_fit(model, job), 5):
                time.sleep(0.01)
                yield step

    drive(act, replace(streams, fit=held))


def test_a_doubtful_fit_is_seen_from_its_other_camera(drive: Drive, photo: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.desk.drop([str(photo)])
        window.wait(lambda: not session.fitting.running)
        window.wait()
        found, past = session.state, len(session.history.past)
        window.click("Fit/###other camera")
        assert session.scene.camera.azimuth == pytest.approx(1.0 + math.pi)
        assert session.scene.camera.width == found.scene.camera.width
        assert session.scene.codes == found.scene.codes
        assert len(session.history.past) == past + 1
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state == found

    drive(act)


def test_a_fit_that_knows_of_no_other_camera_offers_none(drive: Drive, streams: Streams, photo: Path) -> None:
    def act(window: Driver) -> None:
        window.desk.drop([str(photo)])
        window.wait(lambda: not window.session.fitting.running)
        window.wait()
        assert window.ctx.item_exists("//Fit/###photo camera")
        assert not window.ctx.item_exists("//Fit/###other camera")

    def lone_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        return (replace(step, alternative=None, margin=None) for step in quick_fit(model, job))

    drive(act, replace(streams, fit=lone_fit))


@pytest.mark.parametrize(("confidence", "told"), [(0.95, "sure"), (0.9, "likely"), (0.5, "likely"), (0.2, "doubtful")])
def test_confidence_is_told_in_words(confidence: float, told: str) -> None:
    assert in_words(confidence).split(",")[0] == told


def test_a_fit_chosen_by_name_can_be_stopped(drive: Drive, streams: Streams, photo: Path) -> None:
    def act(window: Driver) -> None:
        fitting = window.session.fitting
        window.show("Fit")
        window.click("Fit/###fit image")
        window.type(str(photo))
        window.wait(lambda: len(fitting.course.steps) > 3)
        assert fitting.running
        window.drag("View/orbit", 50)  # the window lives meanwhile
        window.click("Fit/###stop fit")
        assert not fitting.running
        window.wait()
        assert window.session.gallery.names[0] == "block"

    drive(act, replace(streams, fit=endless_fit))


def test_a_photo_on_busy_ground_is_cut_out_by_hand(drive: Drive, streams: Streams, tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(60, 200, (160, 240, 3)).astype(np.uint8)
    noise[40:120, 60:120], noise[50:70, 130:150] = (30, 40, 220), (220, 30, 30)
    Image.fromarray(noise).save(tmp_path / "busy.png")

    def act(window: Driver) -> None:
        session, cutting, ctx = window.session, window.session.cutting, window.ctx
        before = session.history
        window.desk.drop([str(tmp_path / "busy.png")])
        window.wait(lambda: cutting.active and not session.worker.busy())
        assert "no plain ground" in cutting.problem
        window.press(imgui.Key.f1)
        assert not window.desk.help_open
        assert session.errors == []
        assert session.history is before
        canvas = "//Cut out###cutout/**/canvas"
        box = ctx.item_info(canvas).rect_full
        width, height = box.max.x - box.min.x, box.max.y - box.min.y

        def drawn(*shares: tuple[float, float]) -> None:
            places = [imgui.ImVec2(box.min.x + x * width, box.min.y + y * height) for x, y in shares]
            ctx.mouse_move_to_pos(places[0])
            ctx.mouse_down()
            for place in places[1:]:
                ctx.mouse_move_to_pos(place)
                ctx.yield_()
            ctx.mouse_up()
            window.wait()

        def covered(x: float, y: float) -> bool:
            assert cutting.cut is not None
            mask = cutting.cut.cut.mask
            return bool(mask[int(y * mask.shape[0]), int(x * mask.shape[1])])

        drawn((0.15, 0.15), (0.4, 0.5), (0.7, 0.85))
        assert cutting.hints.box == pytest.approx((0.15, 0.15, 0.7, 0.85), abs=0.01)
        assert covered(0.38, 0.5)
        window.click("Cut out###cutout/**/Remove")
        drawn((0.5, 0.37), (0.64, 0.37), (0.64, 0.4))
        assert not covered(0.58, 0.37)
        window.click("Cut out###cutout/**/Add")
        drawn((0.55, 0.7), (0.6, 0.7))
        assert covered(0.58, 0.7)
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        window.wait()
        assert not covered(0.58, 0.7)
        ctx.item_input_value("//Cut out###cutout/**/##scale", 0.8)
        window.wait()
        assert cutting.framing.scale == pytest.approx(0.8)
        testing.capture(ctx, str(tmp_path / "cut.png"))
        hints = cutting.hints
        window.click("Cut out###cutout/**/###fit cut")
        assert not cutting.active
        window.wait(lambda: not session.fitting.running)
        assert session.gallery.names[0] == "busy"
        shot = session.fitting.course.shot
        assert shot is not None
        assert shot.source.hints == hints
        assert shot.photo.framed
        window.click("Fit/###cut out")
        window.wait(lambda: cutting.cut is not None)
        assert cutting.hints == hints
        window.click("Cut out###cutout/**/###clear cut")
        window.wait()
        assert cutting.cut is None
        window.click("Cut out###cutout/**/###undo cut")
        window.wait()
        assert cutting.hints == hints
        window.click("Cut out###cutout/**/###cancel cut")
        window.wait()
        assert not cutting.active
        window.click("Fit/###cut out")
        window.wait(lambda: cutting.cut is not None)
        window.desk.drop([str(tmp_path / "missing.png")])
        window.wait(lambda: bool(session.errors))
        past = len(session.history.past)
        window.drag("View/orbit", 50)  # the dialog is gone
        assert len(session.history.past) == past + 1

    tiny = tiny_model()
    drive(act, replace(streams, load_model=lambda name: tiny))


def test_images_are_pasted(drive: Drive, photo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def act(window: Driver) -> None:
        session = window.session
        held: list[object] = [None, OSError("wl-paste or xclip is required"), [str(photo)]]

        def grabbed() -> object:
            found = held.pop(0)
            if isinstance(found, OSError):
                raise found
            return found

        monkeypatch.setattr("viewer.services.clipboard.ImageGrab.grabclipboard", grabbed)
        imgui.set_clipboard_text("no file of this name")
        window.press(imgui.Key.mod_ctrl, imgui.Key.v)
        window.wait(lambda: len(session.errors) == 1)
        assert "no image" in session.errors[0]
        window.press(imgui.Key.mod_ctrl, imgui.Key.v)
        window.wait(lambda: len(session.errors) == 2)
        assert "xclip" in session.errors[1]
        window.ctx.set_ref("##MainMenuBar")
        window.ctx.menu_click("File/###paste")
        window.wait(lambda: bool(session.fitting.course.steps) and not session.fitting.running)
        assert session.gallery.names[0] == "block"
        imgui.set_clipboard_text(photo.as_uri())
        window.press(imgui.Key.mod_ctrl, imgui.Key.v)
        window.wait(lambda: session.gallery.names[0] == "block (2)")

    drive(act)


def test_several_photos_are_fitted_together_with_known_poses(
    drive: Drive, photo: Path, model: Model, tmp_path: Path
) -> None:
    camera = model.camera(2.0, 0.5)
    for name in ("block b.txt", "other.txt"):
        (tmp_path / name).write_text(" ".join(str(float(number)) for number in camera.pose().flatten()))
    for name in ("block b.png", "block c.png"):
        (tmp_path / name).write_bytes(photo.read_bytes())

    def act(window: Driver) -> None:
        session, fitting = window.session, window.session.fitting
        window.desk.drop([str(photo), str(tmp_path / "block b.png"), str(tmp_path / "block b.txt")])
        window.wait(lambda: bool(fitting.course.steps) and not fitting.running)
        assert [source.pose is not None for source in fitting.course.sources] == [False, True]
        window.click("Fit/###photo 2")
        window.wait()
        assert fitting.camera.azimuth == pytest.approx(2.0)
        window.click("Fit/###add photo")
        window.type(str(tmp_path / "block c.png"))
        window.wait(lambda: len(fitting.course.shots) == 3 and not fitting.running)
        window.click("Fit/###photo 3")
        window.click("Fit/###pose")
        window.type(str(tmp_path / "other.txt"))
        window.wait(lambda: not fitting.running)
        assert fitting.course.view == 2
        assert fitting.course.sources[2].pose == tmp_path / "other.txt"
        window.wait()
        testing.capture(window.ctx, str(tmp_path / "several.png"))
        window.desk.drop([str(photo), str(tmp_path / "other.txt")])
        assert "other.txt" in session.errors[0]
        session.messages.clear()
        window.desk.drop([str(tmp_path / "other.txt")])
        assert len(session.errors) == 1
        assert not fitting.running

    def posed(path: Path, model: Model, pose: Path | None = None, *told: object) -> Photo:
        found = quick_photo(path, model)
        return replace(found, camera=camera.resized(32, 32)) if pose else found

    drive(act, Streams(lambda name: model, posed, quick_frames, quick_fit))


def test_a_fit_stopped_before_its_first_step_can_be_begun_again(drive: Drive, streams: Streams, photo: Path) -> None:
    begin = threading.Event()

    def late_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        begin.wait(30)
        yield from quick_fit(model, job)

    def act(window: Driver) -> None:
        session, fitting = window.session, window.session.fitting
        window.desk.drop([str(photo)])
        window.wait(lambda: fitting.course.shot is not None)
        window.click("Fit/###stop fit")
        window.click("Fit/###photo camera")
        begin.set()
        window.click("Fit/###fit again")
        window.click("**/###again")
        window.wait(lambda: not fitting.running)
        assert session.gallery.names[0] == "block"
        assert session.errors == []

    drive(act, replace(streams, fit=late_fit))


def test_a_fit_that_fails_is_told_and_put_away(drive: Drive, streams: Streams, photo: Path) -> None:
    def act(window: Driver) -> None:
        before = window.session.history
        window.desk.drop([str(photo)])
        window.wait(lambda: bool(window.session.errors))
        assert window.session.history is before
        window.click("Messages/###dismiss 0")
        assert window.session.errors == []

    drive(act, replace(streams, fit=broken_fit))


def test_bad_files_are_told_and_change_nothing(
    drive: Drive, bad_files: dict[str, Path], tmp_path: Path, model: Model
) -> None:
    Scene("another", model.codes[0], model.camera(0, 0)).save(tmp_path / "other.json")
    (tmp_path / "torn.json").write_text('{"model": ')

    def act(window: Driver) -> None:
        session, before = window.session, window.session.history
        for path in (*bad_files.values(), tmp_path / "other.json", tmp_path / "torn.json"):
            session.messages.clear()
            window.desk.drop([str(path)])
            window.wait(lambda: bool(session.errors))
            window.wait()
            assert session.history is before, path.name
            assert not session.fitting.running
        window.desk.drop([])

    drive(act)


def filled(model: Model, bias: float) -> Model:
    """Clear air, or a solid block: both are drawn quickly."""
    field = Field(model.field.config)
    torch.nn.init.constant_(field.density_layer.bias, bias)
    return replace(model, field=field)


def test_a_turntable_is_exported(drive: Drive, tmp_path: Path, real_streams: Streams, model: Model) -> None:
    def act(window: Driver) -> None:
        window.show("Export")
        window.click("Export/##video size")
        window.click("**/128 px")
        window.click("Export/##frames")
        window.click("**/36 frames")
        window.click("Export/###export turntable")
        window.type(str(tmp_path / "turn.mp4"))
        window.wait(lambda: window.session.exporting.progress > 0, 60)
        window.wait(lambda: not window.session.exporting.running, 60)
        assert window.session.errors == []
        with av.open(str(tmp_path / "turn.mp4")) as video:
            assert (video.streams.video[0].frames, video.streams.video[0].width) == (36, 128)

    air = filled(model, -100.0)
    drive(act, replace(real_streams, load_model=lambda name: air))


def test_a_mesh_is_exported(drive: Drive, tmp_path: Path, streams: Streams, model: Model) -> None:
    def act(window: Driver) -> None:
        window.show("Export")
        window.click("Export/##mesh format")
        window.click("**/.ply")
        window.click("Export/##cells")
        window.click("**/96 cells")
        window.click("Export/###export mesh")
        window.type(str(tmp_path / "block"))
        window.wait(lambda: window.session.exporting.progress > 0)
        window.wait(lambda: not window.session.exporting.running)
        assert window.session.errors == []
        found = trimesh.load_mesh(tmp_path / "block.ply")
        assert found.is_watertight
        np.testing.assert_allclose(found.extents, 2 * np.array(model.extent), rtol=0.05)
        assert found.visual.kind == "vertex"
        assert [path.name for path in tmp_path.iterdir()] == ["block.ply"]

    block = filled(model, 100.0)
    drive(act, replace(streams, load_model=lambda name: block))


def test_a_name_without_an_ending_gets_the_proposed_one() -> None:
    wish = Wish("Save", lambda _: None, (".glb", ".ply"), True, "mesh.ply")
    assert wish.path(" /a/b ") == Path("/a/b.ply")
    assert wish.path("/a/b.glb") == Path("/a/b.glb")
    assert replace(wish, save=False).path("/a/b") == Path("/a/b")


def test_a_webp_turntable_under_way_is_no_sheet(drive: Drive, tmp_path: Path, streams: Streams) -> None:
    def endless(*_: object) -> Iterator[int]:
        while True:
            time.sleep(0.01)
            yield 1

    def act(window: Driver) -> None:
        session, ctx = window.session, window.ctx
        session.sheet.add("object 1")
        session.exporting.turntable(tmp_path / "turn.webp")
        window.wait(lambda: session.exporting.progress > 0)
        window.show("Sheet")
        assert ctx.item_exists("//Sheet/###export sheet")
        assert not ctx.item_exists("//Sheet/###cancel export")
        window.click("Sheet/###export sheet")  # waits for the turntable
        assert not window.desk.files.asking
        window.show("Export")
        window.click("Export/###cancel export")
        assert not session.exporting.running

    drive(act, replace(streams, film=endless))


@pytest.mark.parametrize(("kind", "name"), [("turntable", "turn.mp4"), ("mesh", "chair.glb")])
def test_an_export_is_cancelled_and_leaves_nothing(
    drive: Drive, tmp_path: Path, streams: Streams, kind: str, name: str
) -> None:
    def slow(*_: object) -> Iterator[float]:
        with whole_file(tmp_path / name):
            for number in range(1000):
                time.sleep(0.01)
                yield number / 1000

    def act(window: Driver) -> None:
        window.show("Export")
        window.click(f"Export/###export {kind}")
        window.type(str(tmp_path / name))
        window.wait(lambda: window.session.exporting.progress > 0)
        assert len(list(tmp_path.iterdir())) == 1
        window.click("Export/###cancel export")
        window.wait(lambda: not list(tmp_path.iterdir()))
        assert not window.session.exporting.running
        assert window.session.errors == []

    drive(act, replace(streams, film=slow, mesh=slow))


def test_scenes_and_pictures_are_saved_and_opened(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.drag("View/orbit", 90, -20)
        scene = session.scene
        window.show("Export")
        window.click("Export/###save scene")
        window.type(str(tmp_path / "mine"))
        assert (tmp_path / "mine.json").is_file()
        window.click("Export/###save picture")
        export = next(panel for panel in window.app.panels if panel.title == "Export")
        export._picture = 128  # too late: what stood there at the click counts
        window.type(str(tmp_path / "mine"))
        window.wait()
        assert Image.open(tmp_path / "mine.png").size == (512, 512)
        window.click("View/###home")
        assert session.scene != scene
        window.press(imgui.Key.mod_ctrl, imgui.Key.o)
        window.type(str(tmp_path / "mine.json"))
        assert session.scene == scene
        window.click("View/###home")
        window.desk.drop([str(tmp_path / "mine.json")])
        assert session.scene == scene
        window.press(imgui.Key.mod_ctrl, imgui.Key.s)
        window.ctx.item_click("//Choose a file###ask/Cancel")
        window.ctx.yield_(2)
        assert not window.desk.files.asking

    drive(act)


def test_a_dropped_picture_of_this_program_restores_its_scene(
    drive: Drive, tmp_path: Path, model: Model, photo: Path
) -> None:
    other = Scene("another model", model.codes[0], model.camera(0, 0))
    save_picture(np.zeros((32, 32, 3), np.uint8), tmp_path / "other.png", other)

    def act(window: Driver) -> None:
        session = window.session
        window.drag("View/orbit", 90, -20)
        window.click("Codes/**/###Random shape")
        scene = session.scene
        window.show("Export")
        window.click("Export/###save picture")
        window.type(str(tmp_path / "mine.png"))
        window.wait()
        window.click("View/###home")
        window.click("Objects/**/show object 4")
        window.desk.drop([str(tmp_path / "mine.png")])
        assert session.scene == scene
        before = session.history
        window.desk.drop([str(tmp_path / "other.png")])
        window.wait(lambda: bool(session.errors))
        assert "another model" in session.errors[0]
        assert session.history is before
        assert not session.fitting.running
        assert session.gallery.names == ["mine", *(f"object {number}" for number in range(6))]
        testing.capture(window.ctx, str(tmp_path / "told.png"))
        session.show("object 4")
        window.desk.drop([str(tmp_path / "mine.png"), str(photo)])  # both are taken
        assert session.scene == scene
        window.wait(lambda: "block" in session.gallery.names)

    drive(act)


def test_a_film_is_made_and_exported(drive: Drive, streams: Streams, tmp_path: Path) -> None:
    def small(model: Model, shots: list[Shot], path: Path, choice: VideoChoice) -> Iterator[int]:
        return film(model, shots, path, replace(choice, size=choice.size // 16))

    def act(window: Driver) -> None:
        session, made = window.session, window.session.film
        window.show("Timeline")
        buttons, line = (window.ctx.item_info(f"//Timeline/{name}").rect_full for name in ("###film form", "time"))
        assert line.min.y > buttons.max.y
        window.click("Timeline/###add key")
        first = session.scene
        made.seek(2.0)
        window.click("Objects/**/show object 3")
        window.drag("View/orbit", 120, 30)
        window.press(imgui.Key.k)
        second = session.scene
        assert [key.seconds for key in made.timeline.keys] == [0.0, 2.0]
        window.wait()  # for its small pictures
        window.drag("Timeline/key 2", 60)
        moved = made.timeline.keys[1].seconds
        assert moved > 2.2
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert made.timeline.keys[1].seconds == 2.0
        window.press(imgui.Key.mod_ctrl, imgui.Key.y)
        window.click("Timeline/key 1")
        assert session.scene == first
        window.click("Timeline/key 2")
        assert session.scene == second
        window.click("Timeline/time")  # the middle
        assert made.seconds == pytest.approx(2.0, abs=0.1)
        assert session.scene not in (first, second)
        window.drag("View/orbit", 50)
        window.click("Timeline/###add key")
        assert len(made.timeline.keys) == 3
        window.click("Timeline/###add key")  # in its own place
        window.click("Timeline/###remove key")
        assert len(made.timeline.keys) == 2
        window.click("Timeline/key 2", 1)
        window.click("**/Remove")
        assert len(made.timeline.keys) == 1
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        window.click("Timeline/Loop")
        window.click("Timeline/Smooth")
        assert not (made.timeline.loop or made.timeline.smooth)
        window.ctx.item_input_value("//Timeline/##turns", 1)
        window.ctx.item_input_value("//Timeline/##length", 1.0)
        window.ctx.yield_(2)
        assert (made.timeline.turns, made.timeline.length) == (1, 1.0)
        testing.capture(window.ctx, str(tmp_path / "timeline.png"))
        window.click("Timeline/###film form")
        window.click("$FOCUSED/##format")
        window.click("**/webp")
        window.click("$FOCUSED/##rate")
        window.click("**/12 fps")
        window.click("$FOCUSED/###transparent")
        window.click("$FOCUSED/###export film")
        window.type(str(tmp_path / "mine"))
        window.wait(lambda: not session.exporting.running)
        assert session.errors == []
        with Image.open(tmp_path / "mine.webp") as video:
            assert (video.size, video.mode) == ((16, 16), "RGBA")
            assert 3 < video.n_frames <= 12  # pictures that are alike are one

    drive(act, replace(streams, film=small))


def test_playing_is_one_step_of_undo_and_stops_at_a_touch(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session, film = window.session, window.session.film
        window.show("Timeline")
        window.press(imgui.Key.k)
        film.seek(2.0)
        window.click("Objects/**/show object 3")
        window.press(imgui.Key.k)
        before, past = session.state, len(session.history.past)
        window.click("Timeline/###play")
        assert film.playing
        seen = set[int]()
        window.wait(lambda: bool(seen.add(id(session.viewport.frame))) or len(seen) > 6)
        window.ctx.mouse_move("//View/orbit")
        window.press(imgui.Key.space)
        assert not film.playing
        window.wait()
        assert session.viewport.frame.final
        assert len(session.history.past) == past + 1
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert session.state == before
        window.press(imgui.Key.space)
        assert film.playing
        window.drag("View/orbit", 60)
        assert not film.playing
        window.wait()

    drive(act)


def test_strips_show_where_sliders_lead(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Codes")
        window.wait(lambda: session.stills.drawn >= 6 and not session.worker.busy())
        testing.capture(window.ctx, str(tmp_path / "codes.png"))
        before = session.scene.codes
        window.click("Codes/**/shape 1 at 2")
        assert session.space("shape").coordinates(session.code("shape"))[0] == pytest.approx(2.0, abs=1e-3)
        assert session.scene.codes.texture is before.texture
        window.click("Codes/**/shape 1 at 0")
        assert session.space("shape").coordinates(session.code("shape"))[0] == pytest.approx(0.0, abs=1e-3)
        window.click("Codes/###strips")
        window.ctx.yield_(2)
        assert not window.ctx.item_exists("//Codes/**/shape 1 at 2")

    drive(act)


def test_a_random_object_keeps_what_is_locked(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session = window.session
        before = session.scene.codes
        window.click("Mix/###lock texture")
        window.click("Codes/###random all")
        assert not torch.equal(session.code("shape"), before.shape)
        assert torch.equal(session.code("texture"), before.texture)
        window.click("Mix/###lock texture")
        window.ctx.mouse_move("//View/orbit")
        window.press(imgui.Key.r)
        assert not torch.equal(session.code("texture"), before.texture)
        assert len(session.history.past) == 2

    drive(act)


def test_a_click_in_the_filmstrip_restores_a_state(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Visited")
        first = session.state
        window.drag("View/orbit", 60)
        second = session.state
        window.click("Objects/**/show object 3")
        third = session.state
        window.wait()
        window.click("Visited/**/state 1")
        assert session.state == first
        assert len(session.history.future) == 2
        testing.capture(window.ctx, str(tmp_path / "visited.png"))
        window.click("Visited/**/state 3")
        assert session.state == third
        window.click("Visited/**/state 2")
        assert session.state == second
        window.press(imgui.Key.mod_ctrl, imgui.Key.y)
        assert session.state == third

    drive(act)


def test_usual_views_have_keys_and_the_camera_has_numbers(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Camera")
        window.ctx.mouse_move("//View/orbit")
        for key, view in ((imgui.Key._1, "front"), (imgui.Key._2, "side"), (imgui.Key.keypad3, "top")):
            window.press(key)
            assert (session.scene.camera.azimuth, session.scene.camera.elevation) == orbit.VIEWS[view]
        window.click("Camera/###see front")
        past = len(session.history.past)
        window.ctx.item_input_value("//Camera/##azimuth", 30.0)
        window.ctx.item_input_value("//Camera/##elevation", -12.5)
        window.ctx.item_input_value("//Camera/##distance", 2.5)
        window.ctx.yield_(2)
        camera = session.scene.camera
        assert (math.degrees(camera.azimuth), math.degrees(camera.elevation)) == pytest.approx((30.0, -12.5))
        assert camera.distance == pytest.approx(2.5)
        assert len(session.history.past) == past + 3
        window.press(imgui.Key._4)  # no photo yet
        assert session.scene.camera == camera
        window.desk.drop([str(photo)])
        window.wait(lambda: not session.fitting.running)
        window.wait()
        found = session.scene.camera
        window.click("Camera/###see side")
        window.press(imgui.Key._4)
        assert session.scene.camera == found
        testing.capture(window.ctx, str(tmp_path / "camera.png"))

    drive(act)


@pytest.mark.parametrize("button", [1, 2])
def test_the_other_buttons_push_the_object_aside(drive: Drive, button: int) -> None:
    def act(window: Driver) -> None:
        session, ctx, before = window.session, window.ctx, window.session.scene
        middle = session.viewport.frame.opacity.nonzero()[1].mean() / session.viewport.frame.resolution[0]
        ctx.mouse_move("//View/orbit")
        ctx.mouse_down(button)
        place = imgui.get_mouse_pos()
        ctx.mouse_move_to_pos((place.x + 100, place.y))
        ctx.mouse_up(button)
        window.wait()
        assert session.scene == before
        assert session.viewport.pan[0] > 0.1
        assert session.viewport.frame.opacity.nonzero()[1].mean() / session.viewport.frame.resolution[0] > middle + 0.05
        window.press(imgui.Key.home)
        window.wait()
        assert session.viewport.pan == (0.0, 0.0)

    drive(act)


def test_shift_turns_finely(drive: Drive) -> None:
    def act(window: Driver) -> None:
        session, before = window.session, window.session.scene.camera
        window.drag("View/orbit", 100)
        coarse = before.azimuth - session.scene.camera.azimuth
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        window.ctx.key_down(imgui.Key.mod_shift)
        window.drag("View/orbit", 100)
        window.ctx.key_up(imgui.Key.mod_shift)
        assert 0 < before.azimuth - session.scene.camera.azimuth < 0.3 * coarse

    drive(act)


def test_preferences_and_layout_are_kept_between_launches(drive: Drive, tmp_path: Path) -> None:
    folder = tmp_path / "config"

    def first(window: Driver) -> None:
        assert window.desk.likes == Preferences()
        window.drag("View/orbit", 30)
        window.ctx.set_ref("##MainMenuBar")
        window.ctx.menu_click("Look/Dark")
        window.ctx.menu_click("Look/Larger text")
        window.ctx.yield_(2)
        window.press(imgui.Key.mod_ctrl, imgui.Key.equal)
        before = hello_imgui.em_size()
        window.press(imgui.Key.mod_ctrl, imgui.Key.minus)
        assert hello_imgui.em_size() < before
        window.ctx.item_input_value("//View/##quality", 2)
        kept.append(window.desk.likes)
        window.ctx.yield_(2)
        assert Preferences.load(folder) == kept[0]
        testing.capture(window.ctx, str(tmp_path / "light.png"))
        window.ctx.set_ref("##MainMenuBar")
        window.ctx.menu_click("Look/Reset layout")
        window.ctx.yield_(5)
        window.drag("View/orbit", 30)

    def second(window: Driver) -> None:
        assert window.desk.likes == kept[0]
        assert (window.desk.likes.dark, window.desk.likes.newcomer, window.session.viewport.quality) == (
            False,
            False,
            QUALITIES[2],
        )

    kept: list[Preferences] = []
    drive(first, folder=folder)
    assert (folder / "window.ini").is_file()
    drive(second, folder=folder)


def test_a_session_that_ended_badly_is_offered_back(drive: Drive, photo: Path, tmp_path: Path) -> None:
    folder = tmp_path / "config"

    def first(window: Driver) -> None:
        assert not window.ctx.window_info("//###Recovery").window
        window.desk.drop([str(photo)])
        window.wait(lambda: not window.session.fitting.running)
        window.wait()
        window.press(imgui.Key.k)
        window.drag("View/orbit", 80)
        window.desk.autosave._when = 0.0
        window.wait(lambda: any(folder.glob("session-*.json")))
        (written,) = folder.glob("session-*.json")
        (folder / "session-999999999.json").write_text(written.read_text())  # of a run that is no more
        made.append(window.session.state)

    def second(window: Driver) -> None:
        session = window.session
        testing.capture(window.ctx, str(tmp_path / "offer.png"))
        window.click("###Recovery/###restore")
        window.wait()
        assert session.errors == []
        assert session.state == made[0]
        assert session.gallery.names[0] == "block"
        assert session.gallery["block"].photo is not None
        assert not window.desk.autosave.left
        window.press(imgui.Key.mod_ctrl, imgui.Key.z)
        assert not session.history.past

    made: list[object] = []
    drive(first, folder=folder)
    assert [path.name for path in folder.glob("session-*.json")] == ["session-999999999.json"]
    drive(second, folder=folder)
    assert not list(folder.glob("session-*.json"))


def test_files_opened_lately_are_in_the_menu(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.drag("View/orbit", 80)
        scene = session.scene
        session.save_scene(tmp_path / "mine.json")
        window.desk.drop([str(tmp_path / "mine.json")])
        window.desk.drop([str(photo)])
        window.wait(lambda: not session.fitting.running)
        window.wait()
        assert [Path(name).name for name in window.desk.likes.recent] == ["block.png", "mine.json"]
        window.ctx.set_ref("##MainMenuBar")
        window.ctx.menu_click("File/Open recent/###recent 2")
        window.ctx.yield_(2)
        assert session.scene == scene

    drive(act)


def test_depth_normals_opacity_and_samples_are_shown(drive: Drive, real_streams: Streams, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        seen = []
        for number in range(len(MODES)):
            testing.capture(window.ctx, str(tmp_path / f"{number}.png"))
            low, high = window.desk.view
            whole = np.asarray(Image.open(tmp_path / f"{number}.png").convert("RGB")).astype(int)
            seen.append(whole[int(low.y) + 60 : int(high.y) - 60, int(low.x) : int(high.x)])
            window.ctx.mouse_move("//View/orbit")
            window.press(imgui.Key.v)
        assert all(np.abs(one - other).mean() > 1 for one, other in combinations(seen, 2))
        window.click("View/##mode")
        window.click("**/Normals")
        window.click("View/##mode")
        window.click("**/Colour")
        assert window.session.errors == []

    drive(act, real_streams)


def test_the_speed_panel_tells_of_the_picture_on_screen(drive: Drive, real_streams: Streams, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Speed")
        window.drag("View/orbit", 40)
        window.wait(lambda: session.viewport.frame.final and not session.worker.busy("view"))
        sizes, seconds = zip(*session.viewport.times, strict=True)
        assert sizes[-1] == session.viewport.frame.resolution
        assert list(seconds) == sorted(seconds)
        testing.capture(window.ctx, str(tmp_path / "speed.png"))
        assert session.errors == []

    drive(act, real_streams)


def test_the_slider_under_the_mouse_tells_what_it_changes(drive: Drive, real_streams: Streams, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        panel = next(panel for panel in window.app.panels if panel.title == "Codes")
        window.click("Codes/###strips")
        found = {}
        for part in PARTS:
            window.ctx.mouse_move(f"//Codes/**/##{part} 1")
            window.ctx.yield_(2)
            panel._influence = None
            window.wait(lambda: panel._influence is not None)
            testing.capture(window.ctx, str(tmp_path / f"{part}.png"))
            found[part] = panel._influence[2]
        assert found["texture"].leak == 0.0
        assert found["texture"].picture.std() > 0
        assert found["shape"].leak > 0
        assert not window.session.history.past

    drive(act, real_streams)


def test_menus_help_and_theme(drive: Drive) -> None:
    def act(window: Driver) -> None:
        ctx, desk = window.ctx, window.desk
        window.press(imgui.Key.f1)
        assert desk.help_open
        assert ctx.window_info("//Help").window is not None
        window.press(imgui.Key.mod_shift, imgui.Key.slash)
        assert not desk.help_open
        ctx.set_ref("##MainMenuBar")
        ctx.menu_click("Help/Keys and mouse")
        ctx.yield_(2)
        assert desk.help_open
        ctx.menu_click("Look/Dark")
        ctx.menu_click("Look/###smooth")
        ctx.yield_(2)
        assert not desk.likes.dark
        assert not desk.likes.smooth
        window.drag("View/orbit", 30)
        ctx.menu_click("Edit/Undo")
        ctx.yield_(2)
        assert not window.session.history.past
        ctx.menu_click("File/###fit image")
        ctx.yield_(2)
        assert desk.files.asking
        ctx.item_click("//Choose a file###ask/Cancel")

    drive(act)


def test_models_and_samples_are_in_the_menus(drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    def act(window: Driver) -> None:
        ctx, session = window.ctx, window.session
        assert session.opened == "chairs"
        window.drag("View/orbit", 30)
        ctx.set_ref("##MainMenuBar")
        ctx.menu_click("Model/chairs")  # which is there already
        ctx.yield_(2)
        assert not session.loading
        assert session.history.past
        ctx.menu_click("Model/cars")
        ctx.yield_(2)
        window.wait()
        assert session.opened == "cars"
        assert not session.history.past
        ctx.menu_click("Model/chairs")
        ctx.yield_(2)
        window.wait()
        assert session.history.past
        started = list[Path]()
        monkeypatch.setattr(session.fitting, "start", started.append)
        ctx.menu_click("File/Fit a sample/cushion")
        ctx.yield_(2)
        assert [path.name for path in started] == ["cushion.png"]
        assert started[0].is_file()

    drive(act)


def test_the_size_of_the_finished_picture_can_be_chosen(drive: Drive) -> None:
    def act(window: Driver) -> None:
        window.ctx.item_input_value("//View/##quality", 2)
        window.wait(lambda: window.session.viewport.frame.final and window.session.viewport.frame.samples == 128)
        frame = window.session.viewport.frame
        assert frame is not None
        assert min(frame.resolution) == 192
        assert window.session.scene.camera == orbit.home(window.session.model)

    drive(act)


def test_the_panel_of_the_manual_works(drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    manual = (Path(app.__file__).parent / "README.md").read_text()
    code = textwrap.dedent(manual.split("```python\n")[1].split("```")[0])
    names: dict[str, type] = {}
    exec(code, names)
    panels = [*all_panels(), names["Place"]()]
    monkeypatch.setattr(app, "all_panels", lambda: panels)

    def act(window: Driver) -> None:
        before = window.session.scene.camera
        window.show("Place")
        window.click("Place/###other side")
        assert window.session.scene.camera == orbit.turned(before, math.pi, 0.0)
        window.click("View/###undo")
        assert window.session.scene.camera == before

    drive(act)


def test_a_panel_that_fails_does_not_take_the_window_with_it(drive: Drive) -> None:
    def act(window: Driver) -> None:
        def fail(desk: object) -> None:
            imgui.begin_child("left open")
            imgui.push_id("left open too")
            raise KeyError("a mistake")

        drawn = window.app.panels[2].draw
        window.app.panels[2].draw = fail
        window.wait(lambda: bool(window.session.errors))
        window.ctx.yield_(5)
        assert window.session.errors == ["The panel Objects failed: KeyError: 'a mistake'"]
        window.drag("View/orbit", 30)
        assert window.session.history.past
        window.app.panels[2].draw = drawn
        window.click("Objects/Try again")
        window.click("Objects/**/show object 3")
        assert window.session.state.mix.a.shape == "object 3"

    drive(act, strict=False)


def test_closing_while_a_fit_runs_ends_within_a_second(drive: Drive, streams: Streams, photo: Path) -> None:
    def act(window: Driver) -> None:
        window.desk.drop([str(photo)])
        window.wait(lambda: len(window.session.fitting.course.steps) > 3)
        ended.append(time.monotonic())

    ended: list[float] = []
    drive(act, replace(streams, fit=endless_fit))
    assert time.monotonic() - ended[0] < 1.0
    assert not any(thread.name == "worker" for thread in threading.enumerate())


@pytest.mark.parametrize("size", [(640, 400), (1280, 800), (2560, 1600)])
def test_windows_of_any_size_can_be_worked_in(drive: Drive, size: tuple[int, int]) -> None:
    def act(window: Driver) -> None:
        viewport = imgui.get_main_viewport().size
        assert (viewport.x, viewport.y) == size
        window.drag("View/orbit", 30)
        window.show("Codes")
        window.click("Codes/**/Mean##shape")
        assert len(window.session.history.past) == 2

    drive(act, size=size)


def test_a_real_scene_is_drawn_and_the_frame_rate_is_the_windows(drive: Drive, real_streams: Streams) -> None:
    def act(window: Driver) -> None:
        assert window.session.viewport.frame is not None
        assert window.session.viewport.frame.final
        window.drag("View/orbit", 30)
        window.wait()
        assert window.session.errors == []
        assert hello_imgui.frame_rate() > 0

    drive(act, real_streams)
