from pathlib import Path

import pytest
from imgui_bundle import imgui
from PIL import Image

from tests.viewer.driver import Driver, in_window
from tests.viewer.stand_ins import small_video


@in_window()
def test_keyframes_are_added_moved_shown_and_deleted(window: Driver) -> None:
    editor = window.session.editor
    made = window.session.player
    window.show("Timeline")
    buttons, line = (window.ctx.item_info(f"//Timeline/{name}").rect_full for name in ("###share video", "time"))
    assert line.min.y > buttons.max.y
    window.click("Timeline/###add_key")
    first = editor.scene
    made.seek(2.0)
    window.click("Library/**/show object 3")
    window.drag("View/orbit", 120, 30)
    window.press(imgui.Key.k)
    second = editor.scene
    assert [key.seconds for key in made.timeline.keys] == [0.0, 2.0]
    window.wait()  # for its thumbnails
    window.drag("Timeline/key 2", 60)
    moved = made.timeline.keys[1].seconds
    assert moved > 2.2
    assert editor.scene == second  # the dragged one is shown
    window.undo()
    assert made.timeline.keys[1].seconds == 2.0
    window.redo()
    window.click("Timeline/key 1")
    assert editor.scene == first
    window.click("Timeline/key 2")
    assert editor.scene == second
    window.click("Timeline/time")  # the middle
    assert made.seconds == pytest.approx(2.0, abs=0.1)
    assert editor.scene not in (first, second)
    window.drag("View/orbit", 50)
    window.click("Timeline/###add_key")
    assert len(made.timeline.keys) == 3
    window.press(imgui.Key.delete)
    assert len(made.timeline.keys) == 2
    window.click("Timeline/key 2")
    window.press(imgui.Key.delete)
    assert len(made.timeline.keys) == 1


@in_window(video=small_video)
def test_a_timeline_is_exported(window: Driver, tmp_path: Path) -> None:
    session = window.session
    made = window.session.player
    window.show("Timeline")
    made.add_key()
    made.seek(2.0)
    session.editor.show_object("object 3")
    made.add_key()
    window.click("Timeline/Loop")
    assert not made.timeline.loop
    window.set("Timeline/##length", 1.0)
    window.ctx.yield_(2)
    assert made.timeline.length == 1.0
    window.click("Timeline/###share video")
    window.click("Share/###more")
    for name, label in (("##video", "webp"), ("##background", "Transparent")):
        window.click(f"Share/{name}")
        window.click(f"**/{label}")
    window.click("Share/###save")
    window.type(str(tmp_path / "mine"))
    window.wait(lambda: not session.exporting.running)
    assert session.messages.errors == []
    with Image.open(tmp_path / "mine.webp") as video:
        assert (video.size, video.mode) == ((32, 32), "RGBA")
        assert 3 < video.n_frames <= 24  # equal images are one


@in_window()
def test_a_key_pressed_three_times_makes_three_keyframes_and_says_so(window: Driver) -> None:
    # The timeline is folded away.
    editor = window.session.editor
    player = window.session.player
    instances = []
    for name in ("object 2", "object 3", "object 4"):
        editor.show_object(name)
        window.press(imgui.Key.k)
        instances.append(editor.scene.instance)
    assert [key.view.instance for key in player.timeline.keys] == instances
    assert [key.seconds for key in player.timeline.keys] == [0.0, 1.0, 2.0]
    assert window.session.messages.shown[-1].text == "Keyframe 3 of 3, at 2.0 s"
    for key, stands in ((imgui.Key.comma, 1), (imgui.Key.comma, 0), (imgui.Key.comma, 0), (imgui.Key.period, 1)):
        window.press(key)  # steps through them
        assert (player.seconds, editor.scene.instance) == (float(stands), instances[stands])


@in_window()
def test_playing_is_one_step_of_undo_and_stops_at_a_touch(window: Driver) -> None:
    session = window.session
    editor = window.session.editor
    player = session.player
    window.show("Timeline")
    window.press(imgui.Key.k)
    player.seek(2.0)
    window.click("Library/**/show object 3")
    window.press(imgui.Key.k)
    before = editor.state
    past = len(editor.history.past)
    window.click("Timeline/###play")
    assert player.playing
    frames = set[int]()
    window.wait(lambda: bool(frames.add(id(session.viewport.frame))) or len(frames) > 6)
    window.ctx.mouse_move("//View/orbit")
    window.press(imgui.Key.space)
    assert not player.playing
    window.wait()
    assert session.viewport.frame.final
    assert len(editor.history.past) == past + 1
    window.undo()
    assert editor.state == before
    window.press(imgui.Key.space)
    assert player.playing
    window.drag("View/orbit", 60)
    assert not player.playing
    window.wait()
