"""The files that the program reads are in its package and in its bundle."""

import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

_ROOT = Path(__file__).resolve().parents[2]
_FOLDERS = "borrowed", "models", "networks", "samples"
_FILES = [
    file.relative_to(_ROOT)
    for folder in _FOLDERS
    for file in sorted((_ROOT / "assets" / folder).rglob("*"))
    if file.suffix in (".npy", ".onnx", ".png", ".safetensors", ".webp")
]
_FILES += [
    file.relative_to(_ROOT) for file in sorted((_ROOT / "core" / "export").glob("page*")) if file.suffix != ".py"
]


def test_every_asset_is_package_data() -> None:
    packages = tomllib.loads((_ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]
    included = packages["packages"]["find"]["include"]
    patterns = [
        f"{name.replace('.', '/')}/{pattern}"
        for name, listed in packages["package-data"].items()
        for pattern in listed
        if any(fnmatch(name, package) for package in included)
    ]
    assert {file.parts[1] for file in _FILES} == {*_FOLDERS, "export"}
    assert [file for file in _FILES if not any(fnmatch(file.as_posix(), pattern) for pattern in patterns)] == []


def test_every_asset_is_in_the_bundle(monkeypatch: pytest.MonkeyPatch) -> None:
    hooks: Any = ModuleType("PyInstaller.utils.hooks")
    hooks.collect_all = lambda name: ([], [], [])
    monkeypatch.setitem(sys.modules, "PyInstaller.utils.hooks", hooks)
    bundled = list[tuple[str, str]]()

    class Analysis:
        pure = scripts = binaries = ()

        def __init__(self, *args: object, datas: list[tuple[str, str]], **options: object) -> None:
            self.datas = datas
            bundled.extend(datas)

    def step(*args: object, **options: object) -> None: ...

    spec = _ROOT / "viewer" / "bundle.spec"
    steps = {"Analysis": Analysis, "PYZ": step, "EXE": step, "COLLECT": step}
    exec(compile(spec.read_text(), spec, "exec"), {"SPECPATH": str(spec.parent), **steps})
    bundled_files = {Path(folder) / Path(file).name for file, folder in bundled}
    assert [file for file in _FILES if file not in bundled_files] == []
