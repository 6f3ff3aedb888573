from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
from imgui_bundle import imgui

from core.models.model import Instance, Model
from tests.viewer.driver import Drive, Driver, in_window
from viewer.values.objects import EditableObject
from viewer.values.printable import as_label
from viewer.widgets import user_objects


def test_fitted_objects_are_renamed_removed_and_last(drive: Drive, photo: Path, tmp_path: Path) -> None:
    folder = tmp_path / "config"

    def first(window: Driver) -> None:
        window.fit(photo)
        colour = user_objects.colour_of(window.editor.objects["block"])
        window.fit(photo)
        assert window.editor.objects.own[:2] == ["block (2)", "block"]
        window.ctx.mouse_move("//View/orbit")
        screen = window.capture()
        box = window.ctx.item_info("//Library/**/show block").rect_full
        tile = screen[int(box.min.y) : int(box.max.y), int(box.min.x) : int(box.max.x)]
        assert (np.abs(tile / 255 - colour).max(-1) < 0.05).sum() > 10
        window.click("Library/**/show block", 1)
        window.ctx.item_click("//**/###rename object")
        window.ctx.item_click("//**/##new name")
        window.ctx.key_chars_replace_enter("Red chair")
        window.ctx.yield_(3)
        assert window.editor.objects.own[:2] == ["block (2)", "Red chair"]
        window.undo()
        assert window.editor.state.mix.a.shape == "Red chair"
        window.choose("block (2)", "###remove object")
        assert window.editor.objects.own[0] == "Red chair"
        window.redo()  # undo comes back to what was removed
        assert window.editor.state.mix.a.shape == "block (2)"

    def second(window: Driver) -> None:
        window.menu("File/###new_project")
        assert [added.name for added in window.editor.objects.added] == ["Red chair"]
        window.click("Library/**/show Red chair")
        assert window.editor.scene.instance == window.editor.objects["Red chair"].instance

    drive(first, folder=folder)
    drive(second, folder=folder)


def paint(window: Driver, colour: tuple[float, float, float]) -> Instance:
    """Paint the object on screen, and return its codes."""
    window.session.painting.paint(colour)
    window.session.painting.release()
    window.wait()
    return window.editor.scene.instance


@in_window()
def test_a_painted_object_is_painted_in_mine_after_a_click(window: Driver, photo: Path) -> None:
    window.fit(photo)
    fitted = window.editor.scene.instance
    white = tile(window)
    red = paint(window, (1.0, 0.0, 0.0))
    window.click("Library/**/show object 3")
    window.wait()
    assert np.abs(tile(window) - white).max() > 30
    window.click("Library/**/show block")
    assert window.editor.scene.instance == red
    window.choose("block", "###keep version")
    assert window.editor.objects.own == ["block"] and window.editor.scene.instance == red
    blue = paint(window, (0.0, 0.0, 1.0))
    window.click("Library/**/version 0 of block")
    assert window.editor.scene.instance == fitted and window.editor.objects["block"].instance == blue
    assert window.fitting.shown.sources  # it can be tried again
    window.undo()
    assert window.editor.scene.instance == window.editor.objects["block"].instance == blue
    assert window.editor.objects.states("block") == [fitted, blue, red]


def tile(window: Driver, name: str = "block") -> np.ndarray:
    """Pixels of an object's tile in Mine."""
    window.ctx.mouse_move("//View/orbit")
    box = window.ctx.item_info(f"//Library/**/show {name}").rect_full
    return window.capture()[int(box.min.y) : int(box.max.y), int(box.min.x) : int(box.max.x)]


@in_window()
def test_a_removed_object_comes_back_by_undo_and_by_its_message(window: Driver, photo: Path) -> None:
    window.fit(photo)
    window.menu("File/###new_project")
    objects = window.editor.objects  # the object is not in the new history
    window.choose("block", "###remove object")
    assert objects.own == [] and "Removed block" in window.session.messages.newest.text
    window.undo()
    assert objects.own == ["block"]
    window.redo()
    assert objects.own == []
    window.drag("View/orbit", 30)
    window.click("##MainMenuBar/##MenuBar/###undo")
    assert objects.own == ["block"]
    assert window.session.messages.newest is None


@in_window()
def test_random_codes_and_mixes_of_an_object_are_no_version_of_it(window: Driver, photo: Path) -> None:
    editor = window.editor
    window.fit(photo)
    fitted = editor.scene.instance
    edits = (
        lambda: editor.sample(),
        lambda: editor.edit(editor.scene.instance.changed(texture=editor.scene.instance.codes.texture + 0.1)),
        lambda: editor.mix_both(0.5, 0.5),
    )
    for edit in edits:
        edit()
        assert editor.objects["block"].instance == fitted
    window.click("Library/**/show block")
    assert editor.scene.instance == fitted


@in_window()
def test_names_with_signs_of_imgui_are_shown_whole(window: Driver, photo: Path) -> None:
    """Their tiles are not one, though imgui forgets what precedes ###, and their menus hide nothing after ##."""
    tiles = {}
    for name in ("left###chair", "right###chair"):
        window.fit(photo)
        window.session.rename(window.editor.state.mix.a.shape, name)
        window.ctx.yield_(3)
        tiles[name] = f"Library/**/{as_label(f'show {name}')}"
    for name in (*tiles, *reversed(tiles)):
        window.click(tiles[name])
        assert window.editor.state.mix.a.shape == name


def fit_and_paint(window: Driver, photo: Path) -> list[Instance]:
    """Fit a photo, paint the object red, and blue after undo; return the versions as fitted, blue and red."""
    window.fit(photo)
    fitted = window.editor.scene.instance
    red = paint(window, (1.0, 0.0, 0.0))
    window.undo()
    versions = [fitted, paint(window, (0.0, 0.0, 1.0)), red]  # what undo left behind is a version
    assert window.editor.objects.own == ["block"] and window.editor.objects.states("block") == versions
    return versions


@in_window()
def test_versions_are_tiles_under_their_object(window: Driver, photo: Path) -> None:
    versions = fit_and_paint(window, photo)
    window.click("Library/**/version 2 of block")
    assert window.editor.scene.instance == versions[2]
    window.undo()
    assert window.editor.scene.instance == versions[1]
    added = window.editor.objects.ever_added
    window.click("Library/**/version 0 of block", 1)
    window.press(imgui.Key.escape)
    assert window.editor.objects.ever_added == added  # a menu adds nothing
    window.click("Library/**/version 2 of block", 1)
    window.click("**/Make it B")
    window.ctx.yield_(3)
    assert window.exists("Mix/mix pad") and window.editor.objects[window.editor.state.mix.b].instance == versions[2]
    window.drag("Mix/mix pad", 100)
    mixed = window.editor.scene.instance
    assert window.editor.objects.states("block") == versions
    window.click("Library/**/version 1 of block")
    assert window.editor.objects.states("block") == [*versions, mixed]
    window.click("Library/**/version 2 of block", 1)
    window.click("**/###remove object")
    assert window.editor.objects.states("block") == [*versions[:2], mixed]
    window.undo()
    assert window.editor.objects.states("block") == [*versions, mixed]


def test_versions_and_their_names_last(drive: Drive, photo: Path, tmp_path: Path) -> None:
    def first(window: Driver) -> None:
        made.extend(fit_and_paint(window, photo))
        window.click("Library/**/version 2 of block", 1)
        window.ctx.item_click("//**/###rename object")
        window.ctx.item_click("//**/##new name")
        window.ctx.key_chars_replace_enter("Fire")
        window.ctx.yield_(3)
        assert window.session.names.version("block", made[2]) == "Fire"

    def second(window: Driver) -> None:
        editor = window.editor
        assert editor.objects.own == ["block"] and editor.objects.states("block") == made
        window.menu("File/###new_project")
        editor = window.editor
        assert editor.objects.own == ["block"] and editor.objects.states("block") == made
        assert window.session.names.label("Fire") == "Fire"
        window.session.rename("block", "Sofa")
        assert editor.objects.own == ["Sofa"] and editor.objects.states("Sofa") == made
        window.choose("Sofa", "###remove object")
        assert editor.objects.own == []

    made = list[Instance]()
    drive(first, folder=tmp_path / "config")
    drive(second, folder=tmp_path / "config")


@in_window()
def test_reset_and_another_branch_leave_the_edits_of_before_as_versions(window: Driver, photo: Path) -> None:
    window.fit(photo)
    fitted = window.editor.scene.instance
    red = paint(window, (1.0, 0.0, 0.0))
    window.editor.reset()
    assert window.editor.scene.instance == fitted and window.editor.objects.states("block") == [fitted, red]
    blue = paint(window, (0.0, 0.0, 1.0))
    window.undo()
    window.undo()
    assert window.editor.scene.instance == red
    green = paint(window, (0.0, 1.0, 0.0))
    assert window.editor.objects.states("block") == [fitted, green, red, blue]
    window.click("History/branch 1")
    assert set(window.editor.objects.states("block")) == {fitted, green, red, blue}


def test_a_tooltip_tells_two_fits_of_a_photo_apart(model: Model) -> None:
    noon = int(datetime(2026, 3, 1, 12, 5).timestamp() * 1e9)
    first = EditableObject("block", model[0], fitted=True, confidence=0.7, key=str(noon))
    later = replace(first, key=str(noon + 60 * 10**9))
    assert (
        user_objects.about(first)
        == "\nFitted to a photo on 01 March at 12:05, the camera right with a probability of 70%"
    )
    assert "12:06" in user_objects.about(later)
    assert user_objects.about(replace(first, fitted=False)) == ""
