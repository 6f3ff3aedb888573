from dataclasses import dataclass
from pathlib import Path

import pytest

from viewer.screen import file_dialog as files
from viewer.screen.file_dialog import Files, Wish


@dataclass
class Dialog:
    """The system's, answered already."""

    answer: str

    def ready(self, _timeout: int) -> bool:
        return True

    def result(self) -> str:
        return self.answer


def test_a_file_that_an_ending_leads_to_is_asked_about(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "film.mp4").touch()
    asked, answers, saved = list[str](), ["film", "film.mp4"], list[Path]()

    def opened(wish: Wish, folder: Path) -> Dialog:
        asked.append(wish.name)
        return Dialog(str(folder / answers[len(asked) - 1]))

    monkeypatch.setattr(files, "_open_native", opened)
    dialogs = Files(native=True)
    dialogs.folder = tmp_path
    dialogs.ask(Wish("Export", saved.append, (".mp4",), True, "turntable.mp4"))
    dialogs.draw()
    assert saved == []
    dialogs.draw()
    assert asked == ["turntable.mp4", "film.mp4"]
    assert saved == [tmp_path / "film.mp4"]
    assert not dialogs.asking


@pytest.mark.parametrize(("typed", "path"), [("a", "a.png"), ("a.webp", "a.webp"), (" a.png ", "a.png")])
def test_a_name_without_an_ending_gets_one(typed: str, path: str) -> None:
    assert Wish("Save", print, (".png",), True, "picture.png").path(typed) == Path(path)


def test_a_file_that_is_no_name_is_not_there() -> None:
    assert not files.is_there(Path("a\0b"))
