import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from PIL import Image

from core.models.model import Model
from tests.viewer.driver import Drive, Driver
from viewer.services.backend import Backend
from viewer.values.share_settings import ShareSettings


def test_a_grid_is_filled_clicked_and_exported(drive: Drive, model: Model, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        session, editor = window.session, window.session.editor
        window.show("Grid")
        window.click("Grid/###fill")
        assert session.grid.names == tuple(editor.objects.families[editor.model.fingerprint])[:3]
        window.click("Grid/###clear grid")
        window.click("Grid/###add")
        window.choose("object 3", "Add to the grid")
        window.drop("Library/**/show object 5", "Grid/###add")
        assert session.grid.names == ("object 0", "object 2", "object 3", "object 5")
        window.wait()
        window.click("Grid/pair 3 2")
        assert editor.scene.codes == model.codes[3].taking("texture", model.codes[2])
        assert len(editor.history.past) == 1
        window.click("Grid/texture of object 2")
        assert session.grid.names == ("object 0", "object 3", "object 5")
        window.click("Grid/###export grid")
        window.type(str(tmp_path / "mine"))
        window.wait()
        with Image.open(tmp_path / "mine.png") as image:
            assert image.size == (768, 768)
        window.click("Grid/###clear grid")
        assert session.grid.names == ()
        assert session.messages.errors == []

    drive(act)


def test_a_webp_turntable_under_way_is_no_grid(drive: Drive, tmp_path: Path, backend: Backend) -> None:
    def endless(*_: object) -> Iterator[int]:
        while True:
            time.sleep(0.01)
            yield 1

    def act(window: Driver) -> None:
        session = window.session
        session.grid.add("object 1")
        session.exporting.share(tmp_path / "turn.webp", ShareSettings())
        window.wait(lambda: session.exporting.progress > 0)
        window.show("Grid")
        assert window.exists("Grid/###export grid")
        assert not window.exists("Grid/###cancel export")
        window.click("Grid/###export grid")  # waits for the turntable
        assert not window.context.files.asking
        window.context.share()
        window.click("Share/###cancel export")
        assert not session.exporting.running

    drive(act, replace(backend, video=endless))
