"""Dialog programs that answer, fail or hang; each is a script in place of zenity."""

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from imgui_bundle import imgui

from tests.viewer.driver import Drive, Driver, in_window
from viewer.screen.dialog_programs import ProgramDialog, command, installed_program
from viewer.screen.file_dialog import FileDialog, FileRequest
from viewer.services.backend import Backend

Install = Callable[[str], Path]


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Makes a zenity of the lines of a script, the only dialog program."""

    def make(lines: str, name: str = "zenity") -> Path:
        program = tmp_path / name
        program.write_text(f"#!/bin/sh\n{lines}\n")
        program.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:/bin:/usr/bin")
        return program

    return make


def shown(window: Driver) -> FileDialog:
    files = FileDialog(native=True)
    window.context.files = files
    files.ask(FileRequest("Photo", print, (".png",)))
    return files


def has_ended(process: str) -> bool:
    status = Path(f"/proc/{process}/status")
    return not status.exists() or "State:\tZ" in status.read_text()


def wait_for_line(window: Driver) -> None:
    window.wait(lambda: window.exists("Choose a file###ask/##path"))


FAILURES = {
    "cancelled at once": "exit 1",
    "no display": "echo 'cannot open display: :7' >&2; exit 1",
    "nothing": "exit 0",
    "error": "exit 255",
    "unknown option": "echo usage; exit 2",
    "crash": "kill -SEGV $$",
    "endless answer": "sleep 1.5; yes /a/path.png",
    "endless error": "sleep 1.5; yes 'not so' >&2",
    "late error": "sleep 1.5; echo 'Failed to open display' >&2; exit 1",
}


@pytest.mark.parametrize("lines", FAILURES.values(), ids=FAILURES)
def test_a_failed_program_raises(lines: str, install: Install) -> None:
    dialog = ProgramDialog([str(install(lines))])
    assert dialog.ready(60_000)
    with pytest.raises(OSError, match="ended with status"):
        dialog.result()


def test_an_answer_is_read_in_spite_of_warnings_and_odd_names(install: Install) -> None:
    lines = "printf '/photos/ein st\\374hl \\n.png\\n'; echo '(zenity:7): Gtk-WARNING **: no theme' >&2"
    dialog = ProgramDialog([str(install(lines))])
    assert dialog.ready(60_000)
    assert os.fsencode(dialog.result()) == b"/photos/ein st\374hl \n.png"


def test_a_program_and_its_children_can_be_ended(install: Install, tmp_path: Path) -> None:
    dialog = ProgramDialog([str(install(f"sleep 1000 & echo $! > {tmp_path}/child; wait"))])
    child = tmp_path / "child"
    while not (child.exists() and child.read_text().strip()):
        assert not dialog.ready(10)
    dialog.kill()
    assert dialog.ready(60_000)
    dialog.kill()
    assert has_ended(child.read_text().strip())


def test_the_program_of_the_desktop_is_chosen(install: Install, monkeypatch: pytest.MonkeyPatch) -> None:
    zenity = install("exit 0")
    kdialog = install("exit 0", "kdialog")
    monkeypatch.setenv("XDG_CURRENT_DESKTOP", "ubuntu:GNOME")
    assert installed_program() == str(zenity)
    monkeypatch.setenv("XDG_CURRENT_DESKTOP", "KDE")
    assert installed_program() == str(kdialog)
    words = command(str(kdialog), "Photo", "/home/", (".png",), False)
    assert words[3:] == ["--getopenfilename", "/home/", "*.png *.PNG|Photo\n*|All files"]
    words = command(str(zenity), "Save", "/home/a.png", (".png",), True)
    assert words[1:4] == ["--file-selection", "--title=Save", "--filename=/home/a.png"] and "--save" in words


@pytest.mark.parametrize("content", [b"#!/bin/sh\nexit 1\n", b"\x7fELF"], ids=["fails", "cannot start"])
@in_window()
def test_the_path_is_typed_where_a_program_fails(window: Driver, install: Install, content: bytes) -> None:
    install("").write_bytes(content)
    shown(window)
    wait_for_line(window)
    window.click("Choose a file###ask/Cancel")


@in_window()
def test_a_second_press_ends_a_program_that_hangs(window: Driver, install: Install) -> None:
    install("exec sleep 1000")
    files = shown(window)
    window.ctx.yield_(3)
    assert files.asking and not window.exists("Choose a file###ask/##path")
    files.ask(FileRequest("Photo", print, (".png",)))
    wait_for_line(window)
    window.click("Choose a file###ask/Cancel")


@in_window()
def test_esc_ends_a_program_that_hangs(window: Driver, install: Install) -> None:
    install("exec sleep 1000")
    files = shown(window)
    window.ctx.yield_(3)
    window.press(imgui.Key.escape)
    assert not files.asking and not window.exists("Choose a file###ask/##path")


def test_the_end_of_the_window_ends_a_program_that_hangs(
    drive: Drive, backend: Backend, install: Install, tmp_path: Path
) -> None:
    install(f"echo $$ > {tmp_path}/child; exec sleep 1000")

    def act(window: Driver) -> None:
        shown(window)
        window.wait((tmp_path / "child").exists)

    drive(act, backend, (1280, 800), True)
    assert has_ended((tmp_path / "child").read_text().strip())
