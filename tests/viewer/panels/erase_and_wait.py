"""A window in which a stroke is erased from a photo, which then runs on: to be killed. The argument is its folder."""

import sys
from pathlib import Path

from imgui_bundle import imgui
from imgui_bundle.immapp import testing

from core.models.model import Model
from tests.conftest import random_model
from tests.viewer.driver import Driver
from tests.viewer.stand_ins import no_guess, quick_bank, quick_fit, quick_frames, quick_photo
from tests.viewer.test_editor import fitted
from viewer.app import App
from viewer.screen import window
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session


def run(folder: Path) -> None:
    """Never returns by itself."""
    model: Model = random_model()
    backend = Backend(
        lambda name: model,
        frame_photo=quick_photo,
        frames=quick_frames,
        fit=quick_fit,
        view_bank=quick_bank,
        guess_category=no_guess,
    )
    window.prepare(headless=True)
    app = App(Session(Worker(), backend, seed=0), (1280, 800), folder, headless=True, native_dialogs=False)

    def act(ctx: imgui.test_engine.TestContext) -> None:
        driver = Driver(app, ctx, folder)
        driver.wait()
        editor = driver.session.editor
        editor.add_and_show(fitted(model), editor.scene.camera)
        driver.show("Photo")
        driver.click("Photo/###erase")
        driver.drag("View/orbit", 40)
        driver.wait(lambda: False, longest=600)

    testing.run(test_function=act, runner_params=app.params, add_ons_params=window.add_ons())


if __name__ == "__main__":
    run(Path(sys.argv[1]))
