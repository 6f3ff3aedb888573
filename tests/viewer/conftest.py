"""Sessions and windows to test; a tiny model."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
from imgui_bundle import imgui
from imgui_bundle.immapp import testing
from PIL import Image

from core.models.model import Model
from tests.conftest import no_opengl, random_model
from tests.viewer.window_driver import Driver, finish, quick_fit, quick_frames, quick_photo
from viewer.app import App
from viewer.screen import window
from viewer.services.worker import Worker
from viewer.session import Session, Streams
from viewer.values.quality import Quality


@pytest.fixture(scope="session", autouse=True)
def _one_thread() -> None:
    """Threads of a tiny network wait for each other, for ages where other tests run beside."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def model() -> Model:
    """Made once; nothing here changes it."""
    return random_model()


@pytest.fixture
def streams(model: Model) -> Streams:
    """Stand-ins for all that takes time. Turntables are real."""
    return Streams(lambda name: model, quick_photo, quick_frames, quick_fit, lambda model: iter(()))


@pytest.fixture
def real_streams(model: Model) -> Streams:
    """Nothing stands in but a tiny model. Its bank of views is left out: that of a mist takes a minute."""
    return Streams(load_model=lambda name: model, preparing=lambda _: iter(()))


@pytest.fixture
def worker() -> Iterator[Worker]:
    worker = Worker()
    yield worker
    worker.close()


@pytest.fixture
def session(worker: Worker, streams: Streams) -> Session:
    """A session with its model open and everything drawn, without a window."""
    session = Session(worker, streams, seed=0)
    session.viewport.quality = Quality(32, 96)
    session.open_model("chairs")
    finish(session)
    return session


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    """A picture that can be fitted: a red block on white."""
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
def drive(streams: Streams, opengl: None) -> Callable[..., None]:
    """Opens the real window and hands a :class:`Driver` to a function.

    ``strict`` makes a mistake in the use of imgui fail the test; in the program it is logged.
    """
    ours = streams

    def run(
        act: Callable[[Driver], None],
        streams: Streams = ours,
        size: tuple[int, int] = (1280, 800),
        strict: bool = True,
        folder: Path | None = None,
    ) -> None:
        session = Session(Worker(), streams, seed=0)
        session.viewport.quality = Quality(32, 96)
        app = App(session, size, folder, headless=True, native_dialogs=False)

        def test(ctx: imgui.test_engine.TestContext) -> None:
            imgui.get_io().config_error_recovery_enable_assert = strict
            driver = Driver(app, ctx)
            session.open_model("chairs")
            driver.wait(lambda: session.viewport.frame is not None and not session.worker.busy())
            act(driver)

        try:
            testing.run(test_function=test, runner_params=app.params, add_ons_params=window.add_ons())
        finally:
            session.worker.close()

    return run
