import errno
import threading
from collections.abc import Generator, Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from PIL import Image

from core.edits.paint import PartPaint
from core.edits.stretch import Stretch
from core.export.films import TURN
from core.models.model import Instance
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import Clock
from viewer.editor import Editor
from viewer.services.messages import MessageKind
from viewer.session import Session
from viewer.values.share_settings import ShareSettings


def test_a_turntable_is_written_with_progress(session: Session, tmp_path: Path) -> None:
    progress: list[float] = []
    session.exporting.share(tmp_path / "turn.gif", ShareSettings("turntable", size=16))
    finish(session, lambda: bool(progress.append(session.exporting.progress)) or not session.exporting.running)
    assert max(progress) == 1.0
    with Image.open(tmp_path / "turn.gif") as video:
        assert (video.n_frames, video.size) == (TURN, (16, 16))
    assert session.messages.errors == []


def test_a_page_is_written_with_the_objects_name(session: Session, tmp_path: Path) -> None:
    session.exporting.share(tmp_path / "object.html", ShareSettings(kind="page"))
    finish(session, lambda: not session.exporting.running)
    assert session.messages.errors == []
    assert f"<title>{session.names.pair(session.editor.state.mix.a)}</title>" in (tmp_path / "object.html").read_text()
    assert session.exporting.saved == tmp_path / "object.html"


def test_the_time_left_does_not_count_preparation(session: Session, clock: Clock, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("viewer.activities.exporting.time", SimpleNamespace(monotonic=clock))
    exporting = session.exporting
    goes_on = threading.Event()

    def mesh(*_: object) -> Iterator[float]:
        yield 0.2
        goes_on.wait(60)
        yield 0.4
        while True:
            yield 0.4

    session.jobs.backend = replace(session.jobs.backend, mesh=mesh)
    exporting.share(Path("a.glb"), ShareSettings("mesh"))
    clock.now = 100.0
    deliver(session, lambda: exporting.progress == 0.2)
    assert exporting.remaining is None
    clock.now = 102.0
    goes_on.set()
    deliver(session, lambda: exporting.progress == 0.4)
    assert exporting.remaining == pytest.approx(6.0)
    exporting.cancel()


def test_an_export_goes_on_in_a_new_project(session: Session, tmp_path: Path) -> None:
    path = tmp_path / "turn.gif"
    session.exporting.share(path, ShareSettings("turntable", size=16))
    session.new()
    finish(session, lambda: not session.exporting.running)
    assert path.exists()
    assert session.messages.errors == []
    session.exporting.share(tmp_path / "next.png", ShareSettings("picture", size=16))
    finish(session, lambda: not session.exporting.running)
    assert (tmp_path / "next.png").exists()


_REFUSED = {
    "mesh": "a.stl a missing/a.glb mist.glb",  # the tiny model is a mist: it has no surface
    "turntable": "turn.avi turn missing/turn.mp4 missing/turn.gif",
    "picture": "a.xyz missing/a.png",
    "page": "a.htm missing/a.html",
}


@pytest.mark.parametrize(("kind", "names"), _REFUSED.items())
def test_an_unwritable_export_is_reported(session: Session, tmp_path: Path, kind: str, names: str) -> None:
    for name in names.split():
        session.messages.all.clear()
        session.exporting.share(tmp_path / name, ShareSettings(kind, cells=16, size=16))
        finish(session)
        assert len(session.messages.errors) == 1, name
        assert not session.exporting.running
    assert list(tmp_path.iterdir()) == []


def test_all_colours_of_one_shape_go_into_one_file(session: Session, editor: Editor, tmp_path: Path) -> None:
    written: list[dict[str, Instance]] = []

    def mesh(*arguments: Any) -> Generator[float, None, str]:
        written.append(arguments[-1])
        yield 1.0
        return "legs are thin"

    session.jobs.backend = replace(session.jobs.backend, mesh=mesh)
    plain = editor.scene.instance
    grey = 0.5, 0.5, 0.5
    red = plain.with_edits(PartPaint, PartPaint("", (0.8, 0.1, 0.1), grey))
    blue = plain.with_edits(PartPaint, PartPaint("", (0.1, 0.1, 0.8), grey))
    wide = blue.with_edits(Stretch, Stretch((1.2, 1.0, 1.0)))
    for name, instance in (("a.glb", red), ("b.glb", blue), ("c.3mf", blue), ("d.glb", wide)):
        editor.edit(instance)
        session.exporting.share(tmp_path / name, ShareSettings("mesh", mesh=name[1:], all_versions=True))
        finish(session, lambda: not session.exporting.running)
    assert [[*variants.values()] for variants in written] == [[red, plain], [blue, red, plain], [], [wide]]
    assert len(written[1]) == 3  # names differ
    assert "Saved c.3mf: legs are thin" in [message.text for message in session.messages.all]


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.webp"])
def test_a_picture_is_saved_on_white(session: Session, tmp_path: Path, name: str) -> None:
    session.exporting.share(tmp_path / name, ShareSettings("picture", size=48))
    finish(session)
    assert session.messages.errors == []
    with Image.open(tmp_path / name) as image:
        assert image.size == (48, 48)
        assert min(image.convert("RGB").getpixel((0, 0))) > 250  # type: ignore[arg-type, type-var]
    assert len(list(tmp_path.iterdir())) == 1


def test_a_cancelled_export_is_no_success(session: Session, tmp_path: Path) -> None:
    session.exporting.share(tmp_path / "a.png", ShareSettings("picture", size=16))
    session.exporting.cancel()
    assert session.messages.all[-1].kind is MessageKind.NOTE


def test_a_full_disk_is_reported(session: Session, editor: Editor, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full)
    scene = editor.scene
    session.exporting.share(tmp_path / "a.png", ShareSettings("picture", size=16))
    finish(session)
    assert session.messages.errors == ["Cannot export a.png: cannot write a.png: No space left on device"]
    assert list(tmp_path.iterdir()) == []
    assert editor.scene == scene
