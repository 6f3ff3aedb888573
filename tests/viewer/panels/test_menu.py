from pathlib import Path

import pytest
from imgui_bundle import imgui

from tests.viewer.driver import Driver, in_window
from viewer.actions import ACTIONS
from viewer.panels.help import find
from viewer.panels.menu import MENUS


@in_window()
def test_files_opened_lately_are_in_the_menu(window: Driver, photo: Path, tmp_path: Path) -> None:
    window.drag("View/orbit", 80)
    scene = window.editor.scene
    window.editor.scene.save(tmp_path / "mine.json")
    window.context.drop([str(tmp_path / "mine.json")])
    window.context.drop([str(photo)])
    window.wait(lambda: not window.fitting.running)
    window.wait()
    assert [Path(name).name for name in window.context.preferences.recent] == ["block.png", "mine.json"]
    window.menu("File/Recent/###recent 2")
    assert window.editor.scene == scene


@in_window()
def test_menus_help_and_theme(window: Driver) -> None:
    ctx = window.ctx
    context = window.context
    window.press(imgui.Key.f1)
    window.ctx.yield_(2)
    window.press(imgui.Key.f1)
    assert not context.help_open
    window.menu("Help/###help")
    assert context.help_open
    window.menu("View/###dark")
    assert not context.preferences.dark
    assert imgui.get_style().window_border_size == 1.0  # floating windows have an edge on light colours
    window.drag("View/orbit", 30)
    window.menu("Edit/###undo")
    assert not window.editor.history.past
    window.menu("File/###open_scene")
    assert context.files.asking
    ctx.item_click("//Choose a file###ask/Cancel")


def test_every_action_without_a_key_is_in_a_menu() -> None:
    in_menus = {entry for entries in MENUS.values() for entry in entries if isinstance(entry, str)}
    assert {action.id for action in ACTIONS.values() if not action.keys} <= in_menus <= ACTIONS.keys()


@in_window(size=(900, 600))
def test_actions_objects_and_panels_are_found_by_typing(window: Driver) -> None:
    context = window.context
    key = imgui.Key
    for action in ACTIONS.values():
        if action.enabled(context):
            assert find(context, action.words)[0].words.lower() == action.words.lower()

    expected = {"eye": "eyedropper", "erase": "erase", "undo": "undo", "paint": "swatch", "export": "share…"}
    expected |= {"Make taller": "click a part", "photo open": "open photo…", "keyboard": "keys and search…"}
    for words, first in expected.items():
        assert find(context, words)[0].words.lower() == first
    assert "Click a part" in [entry.words for entry in find(context, "change its color")]
    assert not find(context, "no such word")

    def search(words: str) -> None:
        window.press(key.mod_ctrl, key.k)
        window.ctx.yield_(3)
        window.ctx.key_chars(words)
        window.ctx.yield_(2)

    search("dark")
    window.press(key.enter)
    assert not context.preferences.dark and not context.help_open
    search("object 4")
    window.press(key.enter)
    assert window.editor.state.mix.a.shape == "object 4"
    search("normals")
    window.press(key.enter)
    assert window.session.viewport.settings.mode == "normals"
    search("object")
    window.click("Help/**/###found 1")
    assert window.editor.state.mix.a.shape != "object 4" and not context.help_open
    search("developer")
    window.press(key.enter)
    window.ctx.yield_(3)
    assert window.exists("Developer/##mode")


@in_window()
def test_images_are_pasted(window: Driver, photo: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    held: list[object] = [None, OSError("wl-paste or xclip is required"), [str(photo)]]

    def grabbed() -> object:
        content = held.pop(0)
        if isinstance(content, OSError):
            raise content
        return content

    monkeypatch.setattr("viewer.services.clipboard.ImageGrab.grabclipboard", grabbed)
    imgui.set_clipboard_text("no file of this name")
    window.press(imgui.Key.mod_ctrl, imgui.Key.v)
    window.wait(lambda: len(window.session.messages.errors) == 1)
    assert "no image" in window.session.messages.errors[0]
    window.press(imgui.Key.mod_ctrl, imgui.Key.v)
    window.wait(lambda: len(window.session.messages.errors) == 2)
    assert "xclip" in window.session.messages.errors[1]
    window.menu("Edit/###paste")
    window.wait(lambda: bool(window.fitting.history.steps) and not window.fitting.running)
    assert window.editor.objects.own[0] == "block"
    imgui.set_clipboard_text(photo.as_uri())
    window.press(imgui.Key.mod_ctrl, imgui.Key.v)
    window.wait(lambda: window.editor.objects.own[0] == "block (2)")


@in_window()
def test_projects_are_saved_opened_dropped_and_recent(window: Driver, photo: Path, tmp_path: Path) -> None:
    window.fit(photo)
    window.drag("View/orbit", 60)
    made = window.editor.history
    ctrl = imgui.Key.mod_ctrl
    window.press(ctrl, imgui.Key.s)
    window.type(str(tmp_path / "chair"))
    assert (tmp_path / "chair.codenerf").is_file()
    window.press(imgui.Key._2)  # a step of its own, as another drag would not be
    again = window.editor.history
    window.press(ctrl, imgui.Key.s)  # where it was saved before
    assert not window.context.files.asking
    window.press(ctrl, imgui.Key.n)
    assert not window.editor.history.past
    assert window.session.project_path is None
    window.press(ctrl, imgui.Key.o)
    window.type(str(tmp_path / "chair.codenerf"))
    assert window.editor.history == again
    window.wait(lambda: window.fitting.history.photo is not None)
    window.menu("File/###new_project")
    window.context.drop([str(tmp_path / "chair.codenerf")])
    assert window.editor.history == again
    window.menu("File/###new_project")
    window.menu("File/Recent/###recent 1")
    assert window.editor.history == again
    window.undo()
    assert window.editor.state == made.now
    window.press(imgui.Key.mod_ctrl, imgui.Key.mod_shift, imgui.Key.s)
    window.type(str(tmp_path / "chair.codenerf"))  # it is there: that asks
    assert window.context.files.asking
    saved_bytes = (tmp_path / "chair.codenerf").read_bytes()
    window.ctx.item_click("//Choose a file###ask/Cancel")
    window.ctx.yield_(2)
    assert (tmp_path / "chair.codenerf").read_bytes() == saved_bytes
    window.press(imgui.Key.mod_ctrl, imgui.Key.mod_shift, imgui.Key.s)
    window.type(str(tmp_path / "chair.codenerf"))
    window.ctx.item_click("//Choose a file###ask/###choose")
    window.ctx.yield_(2)
    assert not window.context.files.asking
    assert (tmp_path / "chair.codenerf").read_bytes() != saved_bytes
