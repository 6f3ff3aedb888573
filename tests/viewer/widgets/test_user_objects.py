from pathlib import Path

import numpy as np
from imgui_bundle import imgui

from tests.viewer.driver import Drive, Driver, in_window
from viewer.values.printable import as_label
from viewer.widgets import user_objects


def test_fitted_objects_are_renamed_removed_and_last(drive: Drive, photo: Path, tmp_path: Path) -> None:
    folder = tmp_path / "config"

    def first(window: Driver) -> None:
        editor = window.session.editor
        window.fit(photo)
        colour = user_objects.colour_of(editor.objects["block"])
        window.fit(photo)
        assert editor.objects.own[:2] == ["block (2)", "block"]
        window.ctx.mouse_move("//View/orbit")
        whole, box = window.capture(), window.ctx.item_info("//Library/**/show block").rect_full
        tile = whole[int(box.min.y) : int(box.max.y), int(box.min.x) : int(box.max.x)]
        assert (np.abs(tile / 255 - colour).max(-1) < 0.05).sum() > 10
        window.click("Library/**/show block", 1)
        window.ctx.item_click("//**/###rename object")
        window.ctx.item_click("//**/##new name")
        window.ctx.key_chars_replace_enter("Red chair")
        window.ctx.yield_(3)
        assert editor.objects.own[:2] == ["block (2)", "Red chair"]
        window.undo()
        assert editor.state.mix.a.shape == "Red chair"
        window.click("Library/**/show block (2)", 1)
        window.ctx.item_click("//**/###remove object")
        window.ctx.item_click("//**/###remove for good")
        window.ctx.yield_(3)
        assert editor.objects.own[0] == "Red chair"
        window.redo()  # undo comes back to what was removed
        assert editor.state.mix.a.shape == "block (2)"

    def second(window: Driver) -> None:
        window.menu("File/###new_project")
        editor = window.session.editor
        assert [one.name for one in editor.objects.added] == ["Red chair"]
        window.click("Library/**/show Red chair")
        assert editor.scene.codes == editor.objects["Red chair"].codes

    drive(first, folder=folder)
    drive(second, folder=folder)


@in_window()
def test_names_with_signs_of_imgui_are_shown_whole(window: Driver, photo: Path) -> None:
    """Their tiles are not one, though imgui forgets what precedes ###, and their menus hide nothing after ##."""
    editor = window.session.editor
    tiles = {}
    for name in ("left###chair", "right###chair"):
        window.fit(photo)
        window.session.rename(editor.state.mix.a.shape, name)
        window.ctx.yield_(3)
        tiles[name] = f"Library/**/{as_label(f'show {name}')}"
    for name in (*tiles, *reversed(tiles)):
        window.click(tiles[name])
        assert editor.state.mix.a.shape == name
    window.click(tiles["left###chair"], 1)
    window.ctx.item_click("//**/###remove object")
    label = window.ctx.item_info("//**/###remove for good").rect_full
    assert label.get_width() > imgui.calc_text_size(as_label("Remove left###chair")).x
    window.ctx.key_press(imgui.Key.escape)
