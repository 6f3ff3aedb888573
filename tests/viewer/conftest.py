"""Sessions and windows to test; a tiny model."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from imgui_bundle import imgui
from imgui_bundle.immapp import testing
from PIL import Image

from core.detail.progressive import render_progressively
from core.editing.bounds import Bounds
from core.models.model import Model
from core.photos.segmentation import CutOut
from tests.conftest import no_opengl, random_model, unchecked_shapes
from tests.viewer.driver import Drive, Driver, finish
from tests.viewer.stand_ins import (
    Clock,
    no_guess,
    quick_colour,
    quick_fit,
    quick_frames,
    quick_paint,
    quick_photo,
    quick_pictures,
    two_models,
    with_quick_bank,
)
from viewer.app import App
from viewer.editor import Editor
from viewer.screen import window
from viewer.services.backend import Backend
from viewer.services.single_instance import SingleInstance
from viewer.services.worker import Worker
from viewer.session import Session


@pytest.fixture(autouse=True)
def _no_saliency_network(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has tests of its own; here a person points at what stands before a cluttered background."""
    monkeypatch.setattr("core.photos.candidates.predict_saliency", lambda _: None)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture(scope="session")
def model() -> Model:
    """Made once; nothing here changes it."""
    return with_quick_bank(random_model())


@pytest.fixture
def backend(model: Model) -> Backend:
    """Stand-ins for all that takes time. Turntables are real."""
    return Backend(
        lambda name: model,
        frame_photo=quick_photo,
        frames=quick_frames,
        fit=quick_fit,
        pictures=quick_pictures,
        guess_category=no_guess,
        paint=quick_paint,
        paint_colour=quick_colour,
        distance=lambda instance, camera, fraction: camera.distance,
        bounds=lambda instance: Bounds((-0.2, -0.15, -0.3), (0.2, 0.15, 0.3), 150.0, -0.06),
        direction_words=lambda model: iter(({"shape": ("rounder", ""), "texture": ("redder",)},)),
    )


@pytest.fixture
def both(backend: Backend) -> Backend:
    """The same with two models: a blue block is a car, any other a chair."""

    def guess(cut: CutOut) -> dict[str, float]:
        is_blue = bool((cut.pixels[..., 2] > cut.pixels[..., 0]).any())
        return {"cars": 0.95, "chairs": 0.01} if is_blue else {"chairs": 0.95}

    return replace(backend, load_model=two_models().__getitem__, guess_category=guess)


@pytest.fixture
def real_backend(model: Model) -> Backend:
    """Nothing stands in but a tiny model, whose view bank is that of another: that of a mist takes a minute."""
    return Backend(
        load_model=lambda name: model,
        guess_category=no_guess,
        direction_words=lambda model: iter(({"shape": ("rounder", ""), "texture": ("redder",)},)),
    )


@pytest.fixture
def worker() -> Iterator[Worker]:
    worker = Worker()
    yield worker
    worker.close()


@pytest.fixture
def session(worker: Worker, backend: Backend) -> Session:
    """A session with its model open and everything rendered, without a window."""
    session = Session(worker, backend, seed=0)
    session.viewport.change(detail=32, samples=96)
    session.start()
    finish(session)
    return session


@pytest.fixture
def editor(session: Session) -> Editor:
    """Of the model that is open."""
    return session.editor


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """An image that can be fitted: a red block on white."""
    image = Image.new("RGB", (96, 96), "white")
    image.paste((200, 30, 30), (30, 20, 66, 80))
    image.save(tmp_path / "block.png")
    return tmp_path / "block.png"


@pytest.fixture
def bad_files(tmp_path: Path) -> dict[str, Path]:
    """What people drop by mistake, by what is wrong with it."""
    Image.new("RGB", (1, 1), "red").save(tmp_path / "dot.png")
    Image.new("RGB", (20_000, 1), "red").save(tmp_path / "line.png")
    (tmp_path / "text.png").write_text("this is text")
    (tmp_path / "empty.jpg").write_bytes(b"")
    Image.new("RGB", (64, 64), "red").save(tmp_path / "whole.png")
    (tmp_path / "broken.png").write_bytes((tmp_path / "whole.png").read_bytes()[:60])
    names = ("dot.png", "line.png", "text.png", "empty.jpg", "broken.png", "missing.png")
    return {name: tmp_path / name for name in names}


@pytest.fixture(scope="session")
def opengl() -> None:
    """Skips where no window can be drawn; fails there if CI says that one should be."""
    try:
        window.prepare(headless=True)
    except window.NoDisplayError as error:
        no_opengl(error)


@pytest.fixture
def drive(
    backend: Backend, opengl: None, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> Drive:
    """Opens the real window and hands a :class:`Driver` to a function.

    ``strict`` makes a mistake in the use of imgui fail the test; in the program it is logged.
    """
    ours = backend
    captures = tmp_path_factory.mktemp("captures")
    monkeypatch.setattr("viewer.app.is_fast", lambda gl: False)  # measured in half a second, and not alike everywhere

    def run(
        act: Callable[[Driver], None],
        backend: Backend = ours,
        size: tuple[int, int] = (1280, 800),
        strict: bool = True,
        folder: Path | None = None,
        instance: SingleInstance | None = None,
        image: Path | None = None,
    ) -> None:
        session = Session(Worker(), backend, 0, folder)
        session.viewport.change(detail=32, samples=96)
        app = App(session, size, folder, headless=True, native_dialogs=False, instance=instance)
        if image:
            app.context.fit(image)

        def test(ctx: imgui.test_engine.TestContext) -> None:
            imgui.get_io().config_error_recovery_enable_assert = strict
            driver = Driver(app, ctx, captures)
            driver.wait_for_view() if backend.frames is render_progressively else driver.wait()
            act(driver)

        try:
            with unchecked_shapes():
                testing.run(test_function=test, runner_params=app.params, add_ons_params=window.ADD_ONS)
        finally:
            session.jobs.worker.close()

    return run
