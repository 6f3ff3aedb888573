import math
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from imgui_bundle import imgui

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from core.photos.photo import Photo
from core.photos.segmentation import CutOut
from core.photos.view_bank import ViewBank
from tests.conftest import open_models, random_model
from tests.viewer.driver import Drive, Driver
from tests.viewer.stand_ins import broken_fit, endless_fit, quick_fit, quick_photo
from tests.viewer.test_editor import fitted
from viewer.services.backend import Backend
from viewer.values.fit_history import PhotoSource
from viewer.values.project import Project
from viewer.widgets.user_objects import COLOURS


def test_a_dropped_image_is_fitted(drive: Drive, model: Model, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        before = editor.state
        window.context.drop([str(photo)])
        window.wait(lambda: not session.fitting.running)
        window.wait()
        assert editor.scene.codes == model.codes[3]
        window.click("Photo/###share")  # what one does next is there
        window.press(imgui.Key.escape)
        window.click("Photo/###mix with")
        assert window.exists("Mix/mix pad")
        assert editor.objects.names[0] == "block"
        assert window.exists("Library/**/show block")
        window.undo()
        assert editor.state == before

    drive(act)


def test_photo_and_render_are_compared_at_the_fitted_pose(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def shown(window: Driver, mode: str = "wipe") -> np.ndarray:
        window.ctx.mouse_move("//View/orbit")
        window.ctx.yield_(2)
        box = window.ctx.item_info(f"//Photo/{mode}").rect_clipped
        whole = window.capture()
        # Without captions and borders.
        return whole[int(box.min.y) + 40 : int(box.max.y) - 5, int(box.min.x) + 5 : int(box.max.x) - 5]

    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        window.context.drop([str(photo)])
        window.wait(lambda: session.fitting.history.difference is not None and not session.fitting.running)
        window.wait()
        found = editor.scene.camera
        window.click("View/###reset_view")
        window.click("Photo/###viewpoint 1")
        assert editor.scene.camera == found
        window.click("Photo/Wipe")
        before = editor.history
        window.drag("Photo/wipe", 400)
        whole_photo = shown(window)
        window.drag("Photo/wipe", -400)
        whole_render = shown(window)
        assert np.abs(whole_photo - whole_render).mean() > 5
        window.click("Photo/Onion skin")
        window.drag("Photo/onion skin", -400)
        np.testing.assert_allclose(shown(window, "onion skin"), whole_render, atol=3)
        window.drag("Photo/onion skin", 400)
        np.testing.assert_allclose(shown(window, "onion skin"), whole_photo, atol=3)
        window.click("Photo/Difference")
        assert window.exists("Photo/difference")
        unlike = shown(window, "difference")
        window.ctx.key_down(imgui.Key.f)
        np.testing.assert_allclose(shown(window, "difference"), whole_photo, atol=3)
        window.ctx.key_up(imgui.Key.f)
        np.testing.assert_array_equal(shown(window, "difference"), unlike)
        window.click("Photo/Both")
        pair = window.ctx.item_info("//Photo/both").rect_full
        assert pair.max.x - pair.min.x > 0.9 * window.ctx.window_info("//Photo").window.size.x  # as wide as the panel
        assert editor.history is before

    drive(act)


def test_a_fit_is_scrubbed_and_a_step_restored(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        fitting = session.fitting
        window.context.drop([str(photo)])
        window.wait(lambda: not fitting.running)
        window.wait()
        found, past = editor.state, len(editor.history.past)
        window.click("Photo/Details")
        place = window.ctx.item_info("//Photo/###newest").rect_full.min.y
        window.drag("Photo/scrub", -60)
        assert window.ctx.item_info("//Photo/###newest").rect_full.min.y == place  # no row comes or goes
        history = fitting.history
        assert history.selected is not None
        assert 0 < history.selected < 5
        assert editor.scene.codes == history.steps[history.selected].codes
        assert editor.scene.camera.elevation == history.steps[history.selected].cameras[0].elevation
        assert len(editor.history.past) == past + 1
        window.wait()
        window.undo()
        assert editor.state == found
        window.click("Photo/###keep step")
        name = f"block at {history.steps[history.selected].seconds:.1f} s"
        assert editor.objects.names[0] == name
        assert editor.state.mix.a == (name, name)
        kept = editor.scene.codes
        assert kept.detail is not None
        assert replace(kept, detail=None) == history.steps[history.selected].codes
        window.click("Photo/###newest")
        assert editor.scene.codes == found.scene.codes
        assert fitting.history.selected is None

    drive(act)


def test_a_fit_is_resumed_from_a_step_and_from_the_view(drive: Drive, photo: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        fitting = session.fitting
        window.context.drop([str(photo)])
        window.wait(lambda: not fitting.running)
        window.click("Photo/Details")
        window.click("Photo/scrub")
        kept = fitting.history.steps[: (fitting.history.selected or 0) + 1]
        window.click("Photo/###refit")
        window.click("**/###resume")
        window.wait(lambda: not fitting.running)
        assert fitting.history.steps[: len(kept)] == kept
        assert len(fitting.history.steps) == len(kept) + 10
        seconds = [step.seconds for step in fitting.history.steps]
        assert seconds == sorted(seconds)
        assert fitting.history.last.cameras == kept[-1].cameras
        assert editor.objects.names[:2] == ["block (2)", "block"]
        window.drag("View/orbit", 150)
        turned = editor.scene.camera
        window.click("Photo/###refit")
        window.click("**/###resume from view")
        window.wait(lambda: not fitting.running)
        assert fitting.view.camera == turned
        window.click("Photo/##preset")
        window.click("**/draft")
        window.click("Photo/Estimate focal length")
        assert fitting.options.estimate_focal
        window.click("Photo/Estimate focal length")
        window.click("Photo/###refit")
        window.click("**/###restart")
        window.wait(lambda: not fitting.running)
        assert fitting.options.preset == "draft"
        assert len(fitting.history.steps) == 10
        assert fitting.view.camera != turned

    drive(act)


def test_a_doubtful_fit_is_seen_from_its_other_viewpoint(drive: Drive, photo: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        window.context.drop([str(photo)])
        window.wait(lambda: not session.fitting.running)
        window.wait()
        found, past = editor.state, len(editor.history.past)
        window.click("Photo/###viewpoint 2")
        assert editor.scene.camera.azimuth == pytest.approx(1.0 + math.pi)
        assert session.fitting.view.from_runner_up
        assert editor.scene.camera.width == found.scene.camera.width
        assert editor.scene.codes == found.scene.codes
        assert len(editor.history.past) == past + 1
        window.undo()
        assert editor.state == found

    drive(act)


def test_photo_and_viewpoint_are_those_of_the_chosen_object(drive: Drive, photo: Path) -> None:
    other = photo.with_name("block two.png")
    other.write_bytes(photo.read_bytes())

    def act(window: Driver) -> None:
        fitting, editor = window.session.fitting, window.session.editor
        window.fit(photo)
        window.fit(other)
        window.click("Photo/###viewpoint 2")
        window.wait()
        behind, shown = editor.scene.camera, fitting.history.image
        window.click("Library/**/show block")
        window.wait()
        assert fitting.history.photo.source.path == photo
        assert not fitting.view.from_runner_up
        assert not np.array_equal(fitting.history.image, shown)  # rendered from its own camera
        assert editor.scene.camera == behind  # the view is not turned by a choice
        window.click("Photo/###viewpoint 2")
        assert fitting.view.from_runner_up
        window.click("Library/**/show block two")
        assert fitting.history.photo.source.path == other
        assert not fitting.view.from_runner_up
        window.click("Photo/###viewpoint 1")
        assert editor.scene.camera.azimuth == pytest.approx(1.0)

    drive(act)


def test_a_fit_without_a_runner_up_offers_no_other_viewpoint(drive: Drive, backend: Backend, photo: Path) -> None:
    def act(window: Driver) -> None:
        window.context.drop([str(photo)])
        window.wait(lambda: not window.session.fitting.running)
        window.wait()
        camera = window.session.editor.scene.camera
        window.click("Photo/###viewpoint 2")  # it keeps its place, disabled
        assert window.session.editor.scene.camera == camera

    def lone_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        return (replace(step, runner_up=None, margin=None) for step in quick_fit(model, job))

    drive(act, replace(backend, fit=lone_fit))


def test_a_fit_chosen_by_name_can_be_stopped(drive: Drive, backend: Backend, photo: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        fitting = session.fitting
        window.show("Photo")
        window.click("Photo/###fit_image")
        window.type(str(photo))
        window.wait(lambda: len(fitting.history.steps) > 3)
        assert fitting.running
        window.drag("View/orbit", 50)  # the window lives meanwhile
        window.click("Photo/###stop fit")
        assert not fitting.running
        window.wait()
        assert editor.objects.names[0] == "block"

    drive(act, replace(backend, fit=endless_fit))


def test_several_photos_are_fitted_together_with_known_poses(
    drive: Drive, backend: Backend, photo: Path, model: Model, tmp_path: Path
) -> None:
    camera = model.camera(2.0, 0.5)
    for name in ("block b.txt", "other.txt"):
        (tmp_path / name).write_text(" ".join(str(float(number)) for number in camera.pose().flatten()))
    for name in ("block b.png", "block c.png"):
        (tmp_path / name).write_bytes(photo.read_bytes())

    def act(window: Driver) -> None:
        session = window.session
        fitting = session.fitting
        window.context.drop([str(photo), str(tmp_path / "block b.png"), str(tmp_path / "block b.txt")])
        window.wait(lambda: bool(fitting.history.steps) and not fitting.running)
        assert [source.pose is not None for source in fitting.history.sources] == [False, True]
        window.click("Photo/###photo 2")
        window.wait()
        assert fitting.view.camera.azimuth == pytest.approx(2.0)
        window.click("Photo/###refit")
        window.click("**/###add photo")
        window.type(str(tmp_path / "block c.png"))
        window.wait(lambda: len(fitting.history.photos) == 3 and not fitting.running)
        window.click("Photo/###photo 3")
        window.click("Photo/###refit")
        window.click("**/###pose")
        window.type(str(tmp_path / "other.txt"))
        window.wait(lambda: not fitting.running)
        assert fitting.history.photo_index == 2
        assert fitting.history.sources[2].pose == tmp_path / "other.txt"
        window.wait()
        window.context.drop([str(photo), str(tmp_path / "other.txt")])
        assert session.messages.shown[-1].text == "Left out other.txt: neither image nor pose"
        window.wait(lambda: not fitting.running)
        session.messages.clear()
        window.context.drop([str(tmp_path / "other.txt")])
        assert len(session.messages.errors) == 1
        assert not fitting.running

    def posed(cut: CutOut, model: Model, bank: ViewBank, source: PhotoSource) -> Photo:
        found = quick_photo(cut, model, bank, source)
        return replace(found, camera=camera.resized(32, 32)) if source.pose else found

    drive(act, replace(backend, frame_photo=posed))


@pytest.mark.parametrize(("psnr", "words"), [(30.0, "sure"), (12.0, "doubtful")])
def test_several_photos_agree_or_not_by_a_dot(
    drive: Drive, backend: Backend, photo: Path, psnr: float, words: str
) -> None:
    other = photo.with_name("block two.png")
    other.write_bytes(photo.read_bytes())

    def rated(model: Model, job: FitJob) -> Iterator[FitStep]:
        return (replace(step, psnr=psnr) for step in quick_fit(model, job))

    def act(window: Driver) -> None:
        window.fit(photo, other)
        window.show("Photo")
        viewpoint = window.ctx.item_info("//Photo/###viewpoint 1").rect_full
        line = window.capture()[int(viewpoint.min.y) : int(viewpoint.max.y), int(viewpoint.min.x) - 250 :]
        dots = [name for name, colour in COLOURS.items() if (abs(line - 255 * np.array(colour)).max(-1) < 2).sum() > 20]
        assert dots == [words]

    drive(act, replace(backend, fit=rated))


def test_a_fit_stopped_before_its_first_step_can_be_begun_again(drive: Drive, backend: Backend, photo: Path) -> None:
    begin = threading.Event()

    def late_fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        begin.wait(30)
        yield from quick_fit(model, job)

    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        fitting = session.fitting
        window.context.drop([str(photo)])
        window.wait(lambda: fitting.history.photo is not None)
        window.click("Photo/###stop fit")
        window.click("Photo/###viewpoint 1")
        begin.set()
        window.click("Photo/###refit")
        window.click("**/###restart")
        window.wait(lambda: not fitting.running)
        assert editor.objects.names[0] == "block"
        assert session.messages.errors == []

    drive(act, replace(backend, fit=late_fit))


@pytest.mark.usefixtures("lasting_messages")
def test_a_fit_that_fails_is_reported_and_dismissed(drive: Drive, backend: Backend, photo: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        before = editor.history
        window.context.drop([str(photo)])
        window.wait(lambda: bool(session.messages.errors))
        assert editor.history is before
        window.click("Messages/###dismiss 0")
        assert session.messages.errors == []

    drive(act, replace(backend, fit=broken_fit))


def test_the_photo_s_detail_has_a_slider_that_is_one_step_of_undo(drive: Drive, model: Model) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        assert not window.exists("Photo/##photo detail")
        editor.add_and_show(fitted(model), editor.scene.camera)
        window.show("Photo")
        before = editor.state
        assert window.exists("Photo/##photo detail")
        window.drag("Photo/##photo detail", -60)
        detail = editor.scene.codes.detail
        assert detail is not None and detail.strength < 1
        window.undo()
        assert editor.state == before

    drive(act)


def test_the_photo_s_detail_is_copied_to_the_other_side_and_erased(drive: Drive, model: Model, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        editor.add_and_show(fitted(model), editor.scene.camera)
        window.show("Photo")
        before = editor.state
        window.click("Photo/###both sides")
        copied = editor.scene.codes.detail
        assert copied is not None and copied.other_side == "soft"
        window.click("Photo/###erase detail")
        window.drag("Photo/erase from photo", 40)
        erased = editor.scene.codes.detail
        assert erased is not None and len(erased.views[0].erased) == 1
        xs = [x for x, _ in erased.views[0].erased[0].points]
        assert len(xs) > 1 and xs[-1] > xs[0]
        assert editor.history.past[-1].scene.codes.detail == copied, "a stroke is one step"
        window.session.project().save(tmp_path / "a.codenerf", window.session.models)
        again = Project.load(tmp_path / "a.codenerf", window.session.models).history.now
        assert again.scene.codes.detail == erased
        window.click("Photo/###restore detail")
        assert editor.scene.codes.detail == copied
        for _ in range(3):
            window.undo()
        assert editor.state == before

    drive(act)


def test_a_window_killed_after_an_erasure_has_it_again(tmp_path: Path, opengl: None) -> None:
    """A process of its own with the real window; it is killed as soon as the stroke has been written."""
    program = [sys.executable, "-m", "tests.viewer.panels.erase_and_wait", tmp_path]
    root = Path(__file__).parents[3]
    with subprocess.Popen(program, stdout=subprocess.DEVNULL, cwd=root) as run:
        try:
            _wait_for(lambda: any(_erased(path) for path in tmp_path.glob("session-*.codenerf")))
        finally:
            run.kill()
    (left,) = tmp_path.glob("session-*.codenerf")
    assert _erased(left)


def _erased(path: Path) -> bool:
    detail = Project.load(path, open_models(random_model())).history.now.scene.codes.detail
    return detail is not None and detail.other_side == "soft" and len(detail.views[0].erased) == 1


def _wait_for(what: Callable[[], bool], longest: float = 240.0) -> None:
    end = time.monotonic() + longest
    while not what():
        assert time.monotonic() < end
        time.sleep(0.1)
