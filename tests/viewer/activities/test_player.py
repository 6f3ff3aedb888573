from pathlib import Path

import pytest

from tests.viewer.driver import finish
from tests.viewer.stand_ins import Clock
from viewer.activities.player import Player
from viewer.editor import Editor
from viewer.session import Session
from viewer.values import orbit
from viewer.values.share_settings import ShareSettings


@pytest.fixture
def player(session: Session, editor: Editor, clock: Clock) -> Player:
    """Two keyframes in four seconds."""
    session.player = Player(session.jobs, editor, clock)
    session.player.add_key()
    session.player.seek(2.0)
    editor.show_object("object 3")
    editor.set_camera(orbit.turned(editor.scene.camera, 1.0, 0.0))
    session.player.add_key()
    editor.end_gesture()
    return session.player


def test_the_player_stops_where_undo_takes_its_keys(session: Session, editor: Editor, clock: Clock) -> None:
    player = session.player = Player(session.jobs, editor, clock)
    player.add_key()
    player.play()
    editor.undo()
    player.tick()
    assert not player.playing
    assert not player.timeline.keys


def test_playing_goes_with_the_clock_and_round(editor: Editor, player: Player, clock: Clock) -> None:
    player.seek(0.0)
    editor.end_gesture()
    player.play()
    for passed, stands in ((1.0, 1.0), (3.5, 3.5), (5.0, 1.0)):
        clock.now = passed
        player.tick()
        assert player.seconds == pytest.approx(stands)
        assert editor.scene.instance == player.timeline.at(stands).instance
    assert player.playing


def test_a_key_at_the_end_of_a_loop_is_the_one_it_stands_on(player: Player) -> None:
    player.seek(player.timeline.length)
    player.add_key()
    assert player.key == 2


def test_no_key_takes_the_place_of_another(editor: Editor, player: Player) -> None:
    first = player.timeline.keys
    length = player.timeline.length
    player.seek(length)
    for count in range(3, 8):
        editor.sample()
        player.add_key()
        assert len(player.timeline.keys) == count
        assert player.timeline.keys[-1].view.instance == editor.scene.instance
    assert player.timeline.keys[:2] == first
    assert player.seconds == player.timeline.keys[-1].seconds < player.timeline.length


def test_a_timeline_without_loop_ends_and_restarts(player: Player, clock: Clock) -> None:
    player.loop(False)
    player.play()
    clock.now += 9.0
    player.tick()
    assert not player.playing
    assert player.seconds == player.timeline.length
    player.play()
    assert player.seconds == 0.0


def test_the_view_shows_the_scene_at_the_playhead(session: Session, player: Player, clock: Clock) -> None:
    player.play()
    clock.now += 1.0
    player.tick()
    player.pause()
    finish(session)
    assert session.viewport.request.instance == player.timeline.at(1.0).instance
    assert session.viewport.frame is not None and session.viewport.frame.final


def test_any_edit_stops_the_player(editor: Editor, player: Player, clock: Clock) -> None:
    player.play()
    editor.show_object("object 1")
    edited = editor.scene
    clock.now += 0.5
    player.tick()
    assert not player.playing
    assert editor.scene == edited


def test_a_project_begun_meanwhile_has_an_empty_timeline(session: Session, player: Player) -> None:
    player.play()
    session.new()
    finish(session)
    assert not player.playing
    assert session.player.timeline.keys == ()
    assert session.messages.errors == []


def test_a_timeline_without_keys_does_nothing(session: Session, tmp_path: Path) -> None:
    session.player.play()
    session.player.seek(1.0)
    session.exporting.share(tmp_path / "a.gif", ShareSettings("video"))
    assert not session.player.playing
    assert not session.exporting.running


def test_an_unwritable_export_is_reported(session: Session, player: Player, tmp_path: Path) -> None:
    webp = ShareSettings("video", video=".webp", background="transparent")
    session.exporting.share(tmp_path / "a.mp4", webp)
    finish(session)
    assert "transparent" in session.messages.errors[0]
    assert not list(tmp_path.iterdir())
