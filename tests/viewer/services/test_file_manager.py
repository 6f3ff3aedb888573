from pathlib import Path

import pytest

from viewer.services.file_manager import folder_command, show_in_folder


@pytest.mark.parametrize(
    ("platform", "command"),
    [
        ("linux", ["xdg-open", "folder"]),
        ("darwin", ["open", "-R", "folder/chair.glb"]),
        ("win32", ["explorer", "/select,folder/chair.glb"]),
    ],
)
def test_every_system_has_its_command(platform: str, command: list[str]) -> None:
    assert folder_command(Path("folder/chair.glb"), platform) == command


def test_a_missing_file_manager_is_reported(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ValueError, match="no file manager"):
        show_in_folder(tmp_path / "chair.glb")
