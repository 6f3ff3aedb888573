import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import pytest
from imgui_bundle import imgui

from tests.viewer.driver import Driver, in_window
from viewer.screen.file_dialog import FileDialog, FileRequest, is_there, listed


@dataclass
class Dialog:
    """The system's, answered already."""

    answer: str

    def ready(self, timeout: int = 0) -> bool:
        return True

    def result(self) -> str:
        return self.answer

    def kill(self) -> None:
        """Nothing is open."""


def test_a_file_that_an_ending_leads_to_is_confirmed(tmp_path: Path) -> None:
    (tmp_path / "video.mp4").touch()
    proposed = list[str]()
    answers = ["video", "video.mp4"]
    saved = list[Path]()

    def opened(request: FileRequest, folder: Path) -> Dialog:
        proposed.append(request.name)
        return Dialog(str(folder / answers[len(proposed) - 1]))

    dialogs = FileDialog(native=True, open_native=opened)
    dialogs.saves = tmp_path
    dialogs.ask(FileRequest("Export", saved.append, (".mp4",), True, "turntable.mp4"))
    dialogs.draw()
    assert saved == []
    dialogs.draw()
    assert proposed == ["turntable.mp4", "video.mp4"]
    assert saved == [tmp_path / "video.mp4"]
    assert not dialogs.asking


@pytest.mark.parametrize(
    ("typed", "path"), [("a", "a.png"), ("a.webp", "a.webp"), (" a.png ", "a.png"), (" /a/b ", "/a/b.png")]
)
def test_a_name_without_an_ending_gets_the_proposed_one(typed: str, path: str) -> None:
    request = FileRequest("Save", print, (".webp", ".png"), True, "image.png")
    assert request.path(typed) == Path(path)
    assert replace(request, save=False).path("/a/b") == Path("/a/b")


def test_the_last_folder_is_taken_up_if_it_is_still_there(tmp_path: Path) -> None:
    files = FileDialog(native=False)
    start = files.saves
    for gone in ("", str(tmp_path / "gone"), "a\0b"):
        files.save_in(gone)
        assert files.saves == start
    files.save_in(str(tmp_path))
    assert files.unused("car.mp4") == tmp_path / "car.mp4"
    (tmp_path / "car.mp4").touch()
    (tmp_path / "car-2.mp4").mkdir()
    assert files.unused("car.mp4") == tmp_path / "car-3.mp4"


@in_window()
def test_enter_opens_a_folder_and_typing_goes_on(window: Driver, tmp_path: Path) -> None:
    opened = list[Path]()
    files = window.context.files
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "chair.png").touch()
    files.ask(FileRequest("Photo", opened.append, (".png",)))
    window.ctx.yield_(3)
    window.ctx.item_click("//Choose a file###ask/##path")
    window.ctx.key_chars_replace_enter(str(tmp_path / "photos"))
    window.ctx.yield_(3)
    window.ctx.key_chars_append_enter("chair")  # is not there, and Enter keeps it
    window.ctx.yield_(3)
    assert files.asking and opened == []
    window.ctx.key_chars_append_enter(".png")
    window.ctx.yield_(3)
    assert opened == [tmp_path / "photos" / "chair.png"]


@in_window()
def test_a_file_is_saved_in_a_typed_folder(window: Driver, tmp_path: Path) -> None:
    saved = list[Path]()
    files = window.context.files
    files.ask(FileRequest("Save", saved.append, (".png",), True, "chair.png"))
    window.ctx.yield_(3)
    window.ctx.item_click("//Choose a file###ask/##path")
    window.ctx.key_chars_replace_enter(str(tmp_path))
    window.ctx.yield_(3)
    assert saved == []
    window.ctx.item_click("//Choose a file###ask/###choose")
    window.ctx.yield_(3)
    assert saved == [tmp_path / "chair.png"]


@in_window()
def test_several_files_are_chosen_with_ctrl_or_as_a_folder(window: Driver, tmp_path: Path) -> None:
    opened = list[tuple[Path, ...]]()
    files = window.context.files
    names = ("a.png", "b.png", "c.png")
    for age, name in enumerate(names):
        (tmp_path / name).touch()
        os.utime(tmp_path / name, (1e9 - age, 1e9 - age))
    request = FileRequest("Photos", lambda *paths: opened.append(paths), (".png",), several=True)
    files.folder = tmp_path
    files.ask(request)
    window.ctx.yield_(3)
    window.ctx.item_click("//Choose a file###ask/###choose")
    window.ctx.yield_(3)
    files.ask(request)
    window.ctx.yield_(3)
    window.ctx.item_click("//Choose a file###ask/**/###file 1")
    window.ctx.key_down(imgui.Key.mod_ctrl)
    for number in (2, 3, 1):  # the second click on the first file takes it out again
        window.ctx.item_click(f"//Choose a file###ask/**/###file {number}")
    window.ctx.key_up(imgui.Key.mod_ctrl)
    window.ctx.item_click("//Choose a file###ask/###choose")
    window.ctx.yield_(3)
    assert [[path.name for path in paths] for paths in opened] == [["a.png", "b.png", "c.png"], ["b.png", "c.png"]]


@in_window()
def test_a_double_click_opens_folders_and_files_the_newest_first(window: Driver, tmp_path: Path) -> None:
    opened = list[Path]()
    files = window.context.files
    photos = tmp_path / "photos"
    photos.mkdir()
    for age, name in enumerate(("new.png", "old.jpg", "words.txt")):
        (photos / name).touch()
        os.utime(photos / name, (1e9 - age, 1e9 - age))
    if sys.platform == "linux":  # names of files are text elsewhere
        (photos / os.fsdecode(b"\xff.png")).touch()
    assert [path.name for path in listed(photos, (".png", ".jpg"))] == ["new.png", "old.jpg"]
    assert listed(tmp_path / "gone", (".png",)) == []
    files.folder = tmp_path
    imgui.get_io().mouse_double_click_time = 30.0  # of a slow machine
    imgui.get_io().mouse_single_click_delay = 31.0
    files.ask(FileRequest("Photo", opened.append, (".png", ".jpg")))
    window.ctx.yield_(9)  # a window that fits itself to its content takes a few frames
    corner = window.ctx.window_info("//Choose a file###ask").window.pos
    for number, expected in ((1, []), (2, [photos / "old.jpg"])):
        window.ctx.item_double_click(f"//Choose a file###ask/**/###file {number}")
        window.ctx.yield_(3)
        assert opened == expected
        if files.asking:
            assert window.ctx.window_info("//Choose a file###ask").window.pos == corner
    files.ask(FileRequest("Photo", opened.append, (".png", ".jpg")))
    window.ctx.yield_(3)
    window.ctx.item_click("//Choose a file###ask/**/###file 1")  # in the last folder
    window.ctx.yield_(2)
    assert files.asking
    window.ctx.item_click("//Choose a file###ask/###choose")
    assert opened[1:] == [photos / "new.png"]


def test_a_path_with_invalid_characters_does_not_exist() -> None:
    assert not is_there(Path("a\0b"))
