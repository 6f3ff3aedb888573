import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.viewer.window_driver import finish
from viewer.autosave import Autosave
from viewer.session import Session
from viewer.values.objects import Thing
from viewer.values.saved_session import Saved


class Clock:
    """Stands until it is moved."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


def busy(session: Session, photo: Path) -> None:
    """A fitted object, a mix, a film."""
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    session.pick_b("object 4")
    session.mix("texture", 0.4)
    session.film.add_key()
    session.film.seek(1.5)
    session.show("object 2")
    session.film.add_key()
    session.film.set_turns(-2)


def test_a_session_comes_back_from_its_text(session: Session, photo: Path) -> None:
    busy(session, photo)
    session.save_scene(photo.with_name("opened.json"))
    session.load_scene(photo.with_name("opened.json"))
    state, thing = session.state, session.gallery["block"]
    saved = Saved.read(Saved.of("chairs", state, session.gallery.added).text)
    found, things = saved.restored(session.model)
    assert saved.model == "chairs"
    assert found == state
    assert [thing.name for thing in things] == ["block", "opened"]
    assert things[1].photo is None
    assert things[0].codes == thing.codes
    assert things[0].photo.pixels == pytest.approx(thing.photo.pixels, abs=0.003)
    assert (things[0].photo.mask == thing.photo.mask).all()


def test_it_is_written_when_the_hand_rests_and_goes_with_a_good_end(
    session: Session, tmp_path: Path, clock: Clock
) -> None:
    autosave = Autosave(session, tmp_path, clock)
    clock.now = 10.0
    autosave.tick()
    assert not list(tmp_path.iterdir())  # nothing was made yet
    session.move_along("shape", 0, 1.0, gesture="shape 0")
    autosave.tick()
    assert not list(tmp_path.iterdir())
    session.settle()
    autosave.tick()
    (written,) = tmp_path.iterdir()
    before = written.read_text()
    session.show("object 2")
    autosave.tick()
    assert written.read_text() == before  # too early
    clock.now = 20.0
    autosave.tick()
    assert written.read_text() != before
    autosave.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="Windows cannot be asked")
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


@pytest.mark.parametrize("harm", ["{", "[]", "opened only", "no key", "another model", "bad film", "no such object"])
def test_what_cannot_be_read_is_told_and_changes_nothing(session: Session, tmp_path: Path, harm: str) -> None:
    session.show("object 3")
    about = json.loads(Saved.of("chairs", session.state, ()).text)
    if harm == "opened only":
        about = {"opened": "chairs"}
    elif harm == "no key":
        del about["mix"]["a"]
    elif harm == "another model":
        about["scene"]["model"] = "another"
    elif harm == "bad film":
        about["timeline"]["length"] = -1.0
    elif harm == "no such object":
        about["mix"]["b"] = "gone"
    text = harm if harm in ("{", "[]") else json.dumps(about)
    (tmp_path / "session-999999999.json").write_text(text)
    before = session.history
    autosave = Autosave(session, tmp_path)
    autosave.restore()
    finish(session)
    assert session.history is before
    assert len(session.errors) == 1
    assert len(list(tmp_path.iterdir())) == 1
    autosave.discard()
    assert not list(tmp_path.iterdir())


def test_a_session_of_another_model_opens_it_first(session: Session, photo: Path) -> None:
    busy(session, photo)
    saved = Saved.of("other", session.state, (session.gallery["block"],))
    session.restore(saved)
    finish(session)
    assert session.opened == "other"
    assert session.gallery.names[0] == "block"
    assert len(session.state.timeline.keys) == 2


def test_a_restored_object_whose_name_is_taken_gets_another(session: Session, photo: Path) -> None:
    busy(session, photo)
    session.show("block")
    saved = Saved.of("other", session.state, session.gallery.added)
    codes = session.gallery["block"].codes
    session.open_model("other")
    finish(session)
    session.gallery.add(Thing("block", session.gallery["object 1"].codes))
    session.restore(saved)
    assert session.state.mix.a == ("block (2)", "block (2)")
    assert session.gallery["block (2)"].codes == codes
