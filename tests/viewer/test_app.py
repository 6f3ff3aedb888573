import math
import os
import shutil
import sys
import textwrap
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest
from imgui_bundle import hello_imgui, imgui

from tests.viewer.driver import Drive, Driver, in_window, tooltip
from tests.viewer.stand_ins import endless_fit
from viewer import app
from viewer.panels import all_panels
from viewer.screen.file_dialog import FileRequest
from viewer.screen.window import resize
from viewer.services.backend import Backend
from viewer.services.messages import UNFORESEEN
from viewer.values import orbit
from viewer.values.history import History
from viewer.values.objects import EditableObject
from viewer.values.preferences import Preferences
from viewer.values.share_settings import KINDS


def test_preferences_and_layout_are_kept_between_launches(drive: Drive, tmp_path: Path) -> None:
    folder = tmp_path / "config"

    def first(window: Driver) -> None:
        assert replace(window.context.preferences, folder="") == Preferences()
        window.drag("View/orbit", 30)
        window.menu("View/###dark")
        window.menu("View/###larger_text")
        window.press(imgui.Key.mod_ctrl, imgui.Key.equal)
        large = hello_imgui.em_size()
        window.press(imgui.Key.mod_ctrl, imgui.Key.minus)
        assert hello_imgui.em_size() < large
        saved.append(window.context.preferences)
        window.ctx.yield_(2)
        assert Preferences.load(folder) == saved[0]
        window.menu("Panels/###reset_layout")
        window.ctx.yield_(5)
        window.drag("View/orbit", 30)
        window.show("Photo")

    def second(window: Driver) -> None:
        assert window.app._front_panel() == "Photo"
        assert window.context.preferences == replace(saved[0], front="Photo")
        assert not (saved[0].dark or saved[0].newcomer)

    saved: list[Preferences] = []
    drive(first, folder=folder)
    assert (folder / "window.ini").is_file()
    drive(second, folder=folder)

    def third(window: Driver) -> None:
        second(window)
        view, library = (window.ctx.window_info(f"//{name}").window for name in ("View", "Library"))
        assert library.pos.y > view.pos.y

    drive(third, folder=folder, size=(900, 600))


@pytest.mark.parametrize("end", ["killed", "quit"])
def test_a_session_goes_on_at_the_next_launch(drive: Drive, both: Backend, photo: Path, tmp_path: Path, end: str):
    folder = tmp_path / "config"
    killed = tmp_path / "killed"
    made = list[History]()

    def first(window: Driver) -> None:
        window.click("Library/**/show car 3")
        window.drag("View/orbit", 80)
        made.append(window.session.editor.history)
        window.context.drop([str(photo)])
        window.wait(lambda: len(window.session.fitting.history.steps) > 3)
        window.wait(lambda: window.session.recording.is_up_to_date)
        shutil.copytree(folder, killed)
        if end == "quit":
            window.press(imgui.Key.mod_ctrl, imgui.Key.q)

    def second(window: Driver) -> None:
        window.wait(lambda: not window.session.fitting.running)
        window.wait()
        editor = window.session.editor
        assert window.session.messages.errors == []
        assert editor.history == made[0]
        assert editor.objects.own[0] == "block"
        window.click("Library/**/show block")
        assert editor.state.mix.a.shape == "block"
        window.undo()
        assert editor.history.now == made[0].now
        window.undo()
        assert editor.state == made[0].past[-1]
        window.menu("File/###new_project")
        assert not window.session.editor.history.past
        assert window.session.editor.objects.own[0] == "block"
        window.menu("File/Recent/###earlier 1")
        assert window.session.editor.state == made[0].past[-1]

    says_quit = pytest.raises(RuntimeError, match="exited before")  # as the toolkit says where a test ends the program
    with says_quit if end == "quit" else nullcontext():
        drive(first, replace(both, fit=endless_fit), folder=folder)
    drive(second, both, folder=killed if end == "killed" else folder)


def test_the_panel_of_the_readme_works(drive: Drive, monkeypatch: pytest.MonkeyPatch) -> None:
    manual = (Path(app.__file__).parent / "README.md").read_text()
    code = textwrap.dedent(manual.split("```python\n")[1].split("```")[0])
    names: dict[str, type] = {}
    exec(code, names)
    panels = [*all_panels(), names["PlacePanel"]()]
    monkeypatch.setattr(app, "all_panels", lambda: panels)

    def act(window: Driver) -> None:
        editor = window.session.editor
        camera = editor.scene.camera
        window.show("Place")
        window.click("Place/###other side")
        assert editor.scene.camera == orbit.turned(camera, math.pi, 0.0)
        window.click("View/###undo")
        assert editor.scene.camera == camera

    drive(act)


@in_window(strict=False)
def test_a_panel_that_fails_does_not_take_the_window_with_it(window: Driver) -> None:
    session = window.session
    editor = window.session.editor

    def fail(context: object) -> None:
        imgui.begin_child("left open")
        imgui.push_id("left open too")
        raise KeyError("a mistake")

    library = next(panel for panel in window.app.panels if panel.title == "Library")
    drawn = library.draw
    library.draw = fail
    window.wait(lambda: bool(session.messages.errors))
    window.ctx.yield_(5)
    assert session.messages.errors == [f"The panel Library failed: {UNFORESEEN}"]
    assert session.messages.log[-1].detail == "KeyError: 'a mistake'"
    window.drag("View/orbit", 30)
    assert editor.history.past
    assert sum("failed" in message.text for message in session.messages.log) == 1  # in every frame, and said so once
    library.draw = drawn
    window.click("Library/**/show object 3")
    assert editor.state.mix.a.shape == "object 3"


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text elsewhere")
def test_a_photo_whose_name_is_no_text_is_fitted_shown_and_removed(drive: Drive, photo: Path) -> None:
    path = photo.rename(photo.with_name(os.fsdecode(b"block_\xff\xfe.png")))

    def act(window: Driver) -> None:
        objects = window.session.editor.objects
        window.context.drop([str(path)])
        window.wait(lambda: bool(objects.added) and not window.session.fitting.running)
        for panel in ("Library", "Photo", "Messages log"):
            if panel in window.context.panels:
                window.show(panel)
        window.context.load(path)  # is no scene, which a message says
        window.wait(lambda: bool(window.session.messages.errors))
        assert [added.name for added in objects.added] == ["block_??"]
        assert all("failed" not in error for error in window.session.messages.errors)
        window.session.remove("block_??")
        window.wait()
        assert not objects.added

    drive(act)


def test_the_layout_at_first_comes_back_by_a_reset(drive: Drive) -> None:
    def seen(window: Driver) -> set[str]:
        window.ctx.yield_(10)
        windows = {panel.title: imgui.internal.find_window_by_name(panel.title) for panel in window.app.panels}
        return {title for title, docked in windows.items() if docked is not None and docked.active}

    def act(window: Driver) -> None:
        def corner(panel: str) -> imgui.ImVec2:
            return window.ctx.window_info(f"//{panel}").window.pos

        first = {"Library", "View", "Mix", "Sliders", "Photo"}
        assert {*first} - {"Sliders", "Photo"} <= seen(window) <= first
        assert corner("Library").x < corner("View").x < corner("Mix").x
        hidden = {name for name in first if window.ctx.window_info(f"//{name}").window.dock_node.is_no_tab_bar()}
        assert hidden == {"View", "Library"}  # which say themselves what they are
        for is_shown in (True, False):
            window.menu("Panels/Developer")
            assert ("Developer" in seen(window)) == is_shown
        window.menu("Panels/###fold_panels")
        assert seen(window) == {"View"}
        window.menu("Panels/###fold_panels")
        assert {"Library", "Mix"} <= seen(window) <= first
        window.menu("Panels/###fold_panels")
        window.menu("Panels/###reset_layout")
        assert {"Library", "Mix"} <= seen(window) <= first

    drive(act)


@pytest.mark.parametrize(("size", "fraction"), [((900, 600), 0.5), ((1280, 800), 0.62), ((1920, 1080), 0.7)])
def test_the_view_is_most_of_a_window_of_any_size(drive: Drive, size: tuple[int, int], fraction: float) -> None:
    def act(window: Driver) -> None:
        editor = window.session.editor
        low, high = window.context.view
        viewport = imgui.get_main_viewport().size
        assert (viewport.x, viewport.y) == size
        assert (high.x - low.x) * (high.y - low.y) > fraction * size[0] * size[1]
        window.drag("View/orbit", 30)
        window.show("Sliders")
        window.click("Sliders/###sample")
        assert len(editor.history.past) == 2
        resize(1280, 800)
        window.ctx.yield_(5)
        low, high = window.context.view
        assert (high.x - low.x) * (high.y - low.y) > 0.62 * 1280 * 800

    drive(act, size=size)


def too_wide() -> dict[str, float]:
    """px by which what is in a window of the toolkit's, child windows too, or that window itself, is cut off."""
    screen = imgui.get_main_viewport()
    excess = dict[str, float]()
    for window in imgui.get_current_context().windows:
        if window.active and not window.hidden and not window.flags & imgui.WindowFlags_.horizontal_scrollbar:
            left = screen.pos.x - window.pos.x
            right = window.pos.x + window.size.x - screen.pos.x - screen.size.x
            excess[window.name] = max(0.0, window.scroll_max.x - window.window_padding.x, left, right)
    return {name: px for name, px in excess.items() if px}


def look(window: Driver) -> None:
    """Fail if anything is cut off."""
    window.ctx.yield_(5)  # a window that fits itself to its content takes a few frames
    assert not too_wide()


@in_window(size=(900, 600))
def test_the_wheel_scrolls_the_strip_and_tab_leaves_the_view(window: Driver, tmp_path: Path) -> None:
    editor = window.session.editor
    for number in range(12):
        editor.objects.add(EditableObject(f"made {number}", editor.scene.instance))
    window.ctx.yield_(3)
    tile = "//Library/**/show made 9"
    left = window.ctx.item_info(tile).rect_full.min.x
    window.ctx.mouse_move(tile)
    window.ctx.mouse_wheel_y(-1.0)
    window.ctx.yield_(3)
    assert window.ctx.item_info(tile).rect_full.min.x < left
    window.show("Mix")
    window.ctx.mouse_move("//View/orbit")
    window.press(imgui.Key.tab)
    assert imgui.get_current_context().nav_window.root_window.name == "Mix"  # the mouse only rests on the view
    window.ctx.window_focus("//View")
    window.press(imgui.Key.tab)
    assert imgui.get_current_context().nav_window.root_window.name == "Library"
    (tmp_path / "empty").mkdir()
    window.context.drop([str(tmp_path / "empty")])
    assert window.session.messages.errors == ["There is no photo in empty"]


@in_window(size=(900, 600), fit=endless_fit)
def test_no_panel_is_cut_off_where_the_window_is_small_and_texts_are_large(window: Driver, photo: Path) -> None:
    session = window.session
    window.context.set_preference(text=2.0)
    window.wait()
    for panel in window.app.panels:
        window.show(panel.title)
        look(window)
    window.context.drop([str(photo)])
    window.wait(lambda: session.viewport.source == "fit")
    window.press(imgui.Key.r)  # another object: the fit is not followed any more
    look(window)
    assert window.exists("Library/**/waits block.png")
    session.fitting.stop()
    window.wait()
    look(window)
    window.show("Developer")
    look(window)
    session.messages.report("Cannot open this", ValueError("a reason of many words, " * 6))
    look(window)
    session.segmenting.open(session.fitting.history.sources, 0)
    window.wait(lambda: session.segmenting.plain is not None)
    look(window)


def test_no_dialog_is_cut_off_where_the_window_is_small_and_texts_are_large(drive: Drive, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        context = window.context
        context.set_preference(text=2.0)
        context.session.messages.report("Cannot open this", ValueError("a reason of many words"))
        look(window)
        for kind in KINDS:
            context.share(kind)
            look(window)
        context.session.exporting.saved = tmp_path / "a folder of a long name" / "a turntable of a long name.mp4"
        look(window)
        window.click("Share/###save")
        look(window)
        window.ctx.item_click("//Choose a file###ask/Cancel")
        window.press(imgui.Key.escape)
        window.press(imgui.Key.f1)
        look(window)
        window.press(imgui.Key.escape)
        for menu in ("File", "Edit", "View", "Panels", "Help"):
            window.click(f"##MainMenuBar/##MenuBar/{menu}")
            look(window)
            window.press(imgui.Key.escape)

    drive(act, size=(900, 600), folder=tmp_path / "config")


@in_window()
def test_a_chord_that_is_let_go_within_a_slow_frame_is_no_letter(window: Driver) -> None:
    key = imgui.Key
    io = imgui.get_io()
    editor = window.session.editor
    window.ctx.run_flags |= imgui.test_engine.TestRunFlags_.enable_raw_inputs.value
    for letter in (key.e, key.r):
        for frame in (((key.mod_ctrl, True),), ((letter, True), (key.mod_ctrl, False)), ((letter, False),)):
            for event in frame:
                io.add_key_event(*event)
            window.ctx.yield_()
    assert window.context.share_open
    assert not editor.history.past  # R alone is another object


@in_window()
def test_letters_typed_while_a_dialog_is_open_change_no_object(window: Driver) -> None:
    editor = window.session.editor
    key = imgui.Key
    history = editor.history
    window.press(key.mod_ctrl, key.e)
    window.press(key.r)
    assert editor.history is history
    window.show("Photo")  # as a dropped photo does
    window.press(key.f1)
    assert window.context.help_open
    window.press(key.escape)
    assert window.context.share_open and not window.context.help_open
    window.press(key.escape)
    assert not window.context.share_open
    window.press(key.r)
    assert editor.history is not history


def test_a_photo_of_the_command_line_brings_its_panel_to_the_front(drive: Drive, photo: Path) -> None:
    def act(window: Driver) -> None:
        window.ctx.yield_(5)
        assert window.app._front_panel() == "Photo"

    drive(act, image=photo)


@pytest.mark.parametrize("panel", ["Photo", "Developer"])
def test_the_front_panel_is_the_same_after_the_program_was_killed(drive: Drive, tmp_path: Path, panel: str) -> None:
    def first(window: Driver) -> None:
        window.show("Sliders")

    def second(window: Driver) -> None:
        assert window.app._front_panel() == "Sliders"
        window.show(panel)
        shutil.copytree(tmp_path / "config", tmp_path / "killed", ignore=shutil.ignore_patterns(".*"))

    def third(window: Driver) -> None:
        assert window.app._front_panel() == panel

    for folder, act in {"config": first, "killed": third}.items():
        drive(act, folder=tmp_path / folder)
        if act is first:
            drive(second, folder=tmp_path / folder)


@in_window()
def test_no_tooltip_opens_where_the_focus_returns_after_typing(window: Driver, tmp_path: Path) -> None:
    (tmp_path / "a.txt").touch()
    window.context.share("page")
    window.ctx.yield_(5)
    chosen = list[Path]()
    window.context.files.ask(FileRequest("Words", chosen.append, (".txt",)))
    window.ctx.yield_(5)
    window.ctx.key_chars_replace_enter(str(tmp_path / "a.txt"))
    window.wait(lambda: bool(chosen))
    answered = time.monotonic()
    window.wait(lambda: time.monotonic() > answered + 1.5)
    assert tooltip(window) is None
    window.press(imgui.Key.tab)
    window.wait(lambda: tooltip(window) is not None)


@in_window()
def test_the_library_has_a_tab_only_beside_another_panel(window: Driver) -> None:
    def node() -> imgui.internal.DockNode:
        return imgui.internal.find_window_by_name("Library").dock_node

    window.ctx.yield_(3)
    assert node().is_no_tab_bar()
    imgui.internal.dock_builder_dock_window("Sliders", node().id_)
    window.ctx.yield_(5)
    assert not node().is_no_tab_bar() and not node().is_hidden_tab_bar()
    window.app._reset_layout()
    window.wait(lambda: node().is_no_tab_bar())


@in_window()
def test_panels_are_wider_for_larger_text(window: Driver) -> None:
    def width(title: str) -> float:
        return imgui.internal.find_window_by_name(title).size.x

    before = {title: width(title) for title in ("Library", "Mix")}
    for text in (1.1, 1.21, 1.0):
        window.context.set_preference(text=text)
        for title, natural in before.items():
            window.wait(lambda title=title, natural=natural, text=text: abs(width(title) / natural - text) < 0.03)
