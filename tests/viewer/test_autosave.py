import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.viewer.driver import finish
from viewer.autosave import Autosave
from viewer.editor import Editor
from viewer.session import Session
from viewer.values.objects import EditableObject
from viewer.values.saved_session import SavedSession
from viewer.workspace import Workspace


class Clock:
    """Stands until it is moved."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def edit(session: Session, photo: Path) -> None:
    """A fitted object, a mix, a timeline."""
    workspace = session.workspace
    assert workspace is not None
    editor = workspace.editor
    workspace.fitting.start(photo)
    finish(session, lambda: not workspace.fitting.running)
    editor.set_b("object 4")
    editor.mix("texture", 0.4)
    workspace.player.add_key()
    workspace.player.seek(1.5)
    editor.show_object("object 2")
    workspace.player.add_key()
    workspace.player.set_turns(-2)


def test_a_session_comes_back_from_its_text(
    session: Session, editor: Editor, workspace: Workspace, photo: Path
) -> None:
    edit(session, photo)
    workspace.exporting.scene(photo.with_name("opened.json"))
    session.open_scene(photo.with_name("opened.json"))
    state, fitted = editor.state, editor.objects["block"]
    saved = SavedSession.read(SavedSession.of("chairs", state, editor.objects.added).text)
    found, objects = saved.restored(workspace.model)
    assert saved.model == "chairs"
    assert found == state
    assert [one.name for one in objects] == ["block", "opened"]
    assert objects[1].photo is None
    assert objects[0].codes == fitted.codes
    assert objects[0].photo.pixels == pytest.approx(fitted.photo.pixels, abs=0.003)
    assert (objects[0].photo.mask == fitted.photo.mask).all()


def test_it_is_written_between_drags_and_goes_with_a_good_end(
    session: Session, editor: Editor, tmp_path: Path, clock: Clock
) -> None:
    autosave = Autosave(session, tmp_path, clock)
    clock.now = 10.0
    autosave.tick()
    assert not list(tmp_path.iterdir())  # nofitted was made yet
    editor.set_coordinate("shape", 0, 1.0, gesture="shape 0")
    autosave.tick()
    assert not list(tmp_path.iterdir())
    editor.end_gesture()
    autosave.tick()
    (written,) = tmp_path.iterdir()
    before = written.read_text()
    editor.show_object("object 2")
    autosave.tick()
    assert written.read_text() == before  # too early
    clock.now = 20.0
    autosave.tick()
    assert written.read_text() != before
    autosave.close()
    assert not list(tmp_path.iterdir())


def test_what_an_older_version_wrote_is_read(session: Session, editor: Editor, photo: Path) -> None:
    edit(session, photo)
    about = json.loads(SavedSession.of("chairs", editor.state, editor.objects.added).text)
    older = {"opened": about.pop("model"), "things": about.pop("objects")} | about
    saved = SavedSession.read(json.dumps(older))
    assert saved.model == "chairs"
    state, objects = saved.restored(editor.model)
    assert state == editor.state
    assert [one.name for one in objects] == ["block"]


@pytest.mark.skipif(sys.platform == "win32", reason="not known on Windows")
def test_only_what_a_dead_run_left_is_offered(session: Session, tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", "pass"]) as ended:
        pass
    for number in (ended.pid, os.getppid()):
        (tmp_path / f"session-{number}.json").write_text("{}")
    autosave = Autosave(session, tmp_path)
    assert [path.name for path in autosave.left] == [f"session-{ended.pid}.json"]
    autosave.discard()
    assert [path.name for path in tmp_path.iterdir()] == [f"session-{os.getppid()}.json"]


def test_of_several_that_were_left_the_last_is_offered_first(session: Session, tmp_path: Path) -> None:
    for age, name in enumerate(("999999999-a", f"{os.getpid()}-b", "999999998")):  # the second's number is ours now
        (tmp_path / f"session-{name}.json").write_text("{}")
        os.utime(tmp_path / f"session-{name}.json", (age, age))
    autosave = Autosave(session, tmp_path)
    assert autosave.times == (0, 1, 2)
    autosave.discard()
    autosave.discard()
    assert [path.name for path in tmp_path.iterdir()] == ["session-999999999-a.json"]
    assert autosave.left


@pytest.mark.parametrize("harm", ["{", "[]", "model only", "no key", "another model", "bad timeline", "no such object"])
def test_what_cannot_be_read_is_reported_and_changes_nothing(
    session: Session, editor: Editor, tmp_path: Path, harm: str
) -> None:
    editor.show_object("object 3")
    about = json.loads(SavedSession.of("chairs", editor.state, ()).text)
    if harm == "model only":
        about = {"model": "chairs"}
    elif harm == "no key":
        del about["mix"]["a"]
    elif harm == "another model":
        about["scene"]["model"] = "another"
    elif harm == "bad timeline":
        about["timeline"]["length"] = -1.0
    elif harm == "no such object":
        about["mix"]["b"] = "gone"
    text = harm if harm in ("{", "[]") else json.dumps(about)
    (tmp_path / "session-999999999.json").write_text(text)
    before = editor.history
    autosave = Autosave(session, tmp_path)
    autosave.restore()
    finish(session)
    assert editor.history is before
    assert len(session.messages.errors) == 1
    assert len(list(tmp_path.iterdir())) == 1
    autosave.discard()
    assert not list(tmp_path.iterdir())


def test_a_session_of_another_model_opens_it_first(session: Session, editor: Editor, photo: Path) -> None:
    edit(session, photo)
    saved = SavedSession.of("other", editor.state, (editor.objects["block"],))
    session.restore(saved)
    finish(session)
    assert session.model_name == "other"
    assert session.workspace is not None
    editor = session.workspace.editor
    assert editor.objects.names[0] == "block"
    assert len(editor.state.timeline.keys) == 2


def test_a_restored_object_whose_name_is_taken_gets_another(session: Session, editor: Editor, photo: Path) -> None:
    edit(session, photo)
    editor.show_object("block")
    saved = SavedSession.of("other", editor.state, editor.objects.added)
    codes = editor.objects["block"].codes
    session.open_model("other")
    finish(session)
    assert session.workspace is not None
    editor = session.workspace.editor
    editor.objects.add(EditableObject("block", editor.objects["object 1"].codes))
    session.restore(saved)
    assert editor.state.mix.a == ("block (2)", "block (2)")
    assert editor.objects["block (2)"].codes == codes
