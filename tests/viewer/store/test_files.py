"""Projects: complete, small, and of any origin."""

import io
import random
import sqlite3
import subprocess
import sys
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.models.missing import MissingInstance
from core.models.model import Model
from core.models.open_models import OpenModels
from core.models.photo_detail import compressed
from core.photos.photo import Photo
from core.photos.segmentation import Hints, Stroke
from tests.conftest import open_models, random_model
from tests.viewer.driver import finish, fit, opened
from viewer.session import Session
from viewer.store.files import read_project
from viewer.store.store import Store
from viewer.values.fit_history import FitHistory, FitRequest, FittedPhoto, PhotoSource
from viewer.values.project import Project


@pytest.fixture
def saved(session: Session, photo: Path, tmp_path: Path) -> Project:
    """A fitted object, a mix, an undone edit, a branch, and a fit that waits, in ``a.codenerf``."""
    editor = session.editor
    fit(session, photo)
    editor.set_b("object 4")
    editor.mix_both(0.0, 0.4)
    editor.undo()
    editor.mix_both(0.0, 0.7)
    editor.show_object("object 2")
    editor.undo()
    hints = Hints((0.1, 0.2, 0.8, 0.9), (Stroke(((0.5, 0.5), (0.6, 0.5)), 0.02, False),))
    pending = (FitRequest(FitHistory((PhotoSource(photo, hints),))),)
    project = replace(session.project(), pending=pending, path=tmp_path / "kept.codenerf")
    Store().save(project, tmp_path / "a.codenerf")
    return project


def change(path: Path, *statements: str) -> None:
    """Change rows of a project's file."""
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        for statement in statements:
            connection.execute(statement)


def test_a_saved_project_is_loaded_completely(saved: Project, session: Session, tmp_path: Path) -> None:
    loaded = opened(tmp_path / "a.codenerf", session)
    assert loaded.history == saved.history and len(loaded.history.branches()) == 1
    assert len(loaded.history.future) == 1 and all(map(session.editor.objects.can_show, loaded.history.states))
    assert [vars(item) for item in loaded.objects] == [vars(item) for item in saved.objects]
    assert loaded.pending[0].history.sources == saved.pending[0].history.sources
    ((key, fit),) = loaded.fits.items()
    expected = saved.fits[key]
    assert [step.psnr for step in fit.steps] == [step.psnr for step in expected.steps]
    last = fit.last
    assert (last.confidence, last.runner_up) == (expected.last.confidence, expected.last.runner_up)
    assert last.instance == expected.last.instance and len(last.hypotheses) == len(expected.last.hypotheses)
    assert all(step.instance == last.instance and not step.hypotheses for step in fit.steps[:-1])
    assert (last.hypotheses[0].crop_transform == expected.last.hypotheses[0].crop_transform).all()
    photo_pixels, loaded_pixels = (value.photos[0].preview.pixels.astype(float) for value in (expected, fit))
    assert np.abs(photo_pixels - loaded_pixels).mean() < 5
    assert loaded.path is None and loaded.lost == ()


def test_a_project_is_small_and_its_states_share_codes(saved: Project, session: Session, tmp_path: Path) -> None:
    history = saved.history
    for step in range(400):  # the camera moves, codes stay
        camera = replace(history.now.scene.camera, azimuth=0.01 * step)
        history = history.changed(replace(history.now, scene=replace(history.now.scene, camera=camera)))
    Store().save(replace(saved, history=history), tmp_path / "a.codenerf")
    assert (tmp_path / "a.codenerf").stat().st_size < 600_000
    loaded = opened(tmp_path / "a.codenerf", session)
    assert loaded.history == history
    first = loaded.history.past[-300].scene.instance.codes.shape
    assert first.data_ptr() == loaded.history.now.scene.instance.codes.shape.data_ptr()


def test_a_photo_keeps_the_fields_beside_its_pixels(model: Model, saved: Project, tmp_path: Path) -> None:
    mask = torch.zeros(8, 8, dtype=torch.bool)
    mask[2:5] = True
    photo = Photo(torch.rand(8, 8, 3), mask, model.camera(0.1, 0.2).resized(8, 8), True, ~mask)
    photo = replace(photo, scaled=True, opacity=0.9 * mask, edge_error=1.5, focal=50.0, blur=2.0, side="back")
    photo = replace(photo, fine=compressed(np.full((24, 24, 4), 255, np.uint8)))
    fitted = FittedPhoto(PhotoSource(tmp_path / "b.png"), photo)
    pending = (FitRequest(FitHistory((fitted.source,), (fitted,))),)
    Store().save(replace(saved, pending=pending), tmp_path / "a.codenerf")
    loaded = read_project(tmp_path / "a.codenerf").pending[0].history.photos[0].photo
    assert (loaded.camera, loaded.cropped, loaded.side, loaded.fine) == (photo.camera, True, "back", photo.fine)
    assert torch.equal(loaded.unseen, photo.unseen) and torch.equal(loaded.opacity, photo.opacity)
    assert (loaded.scaled, loaded.edge_error, loaded.focal, loaded.blur) == (True, 1.5, 50.0, 2.0)


def test_a_project_brings_its_photos_and_names_no_folder(saved: Project, session: Session, photo: Path, tmp_path: Path):
    path = tmp_path / "elsewhere.codenerf"
    files = {**saved.model_files, "0" * 16: str(tmp_path / "of another project.safetensors")}
    Store().save(replace(saved, pending=(), model_files=files), path)
    assert str(tmp_path).encode() not in path.read_bytes()
    content = photo.read_bytes()
    photo.unlink()
    session.open_project(path)
    finish(session, lambda: not session.fitting.pending)
    (source,) = session.fitting.shown.sources
    assert source.name == photo.name and source.file.read_bytes() == content


def test_a_project_cannot_read_a_file_of_this_machine(saved: Project, session: Session, photo: Path, tmp_path: Path):
    secret = tmp_path / "secret.png"
    secret.write_bytes(b"private")
    path = tmp_path / "a.codenerf"
    named = f'"file_name": "{photo.name}"'
    secretly = f'"file_name": "", "copy": "{secret}"'  # the second of two equal names counts
    changed = f"replace(content, '{named}', '{secretly}')"
    where = f"typeof(content) = 'text' AND instr(content, '{named}')"
    with closing(sqlite3.connect(path)) as connection:
        assert connection.execute(f"SELECT count(*) FROM blobs WHERE {where}").fetchone()[0]
    change(path, f"UPDATE blobs SET content = {changed} WHERE {where}")
    session.open_project(path)
    finish(session, lambda: not session.fitting.pending)
    assert session.fitting.shown.sources
    assert all(source.copy is None for source in session.fitting.shown.sources)


def test_objects_of_a_missing_model_are_saved_unchanged(saved: Project, tmp_path: Path) -> None:
    files = dict.fromkeys(saved.model_files, "/gone/chairs.safetensors")
    Store().save(replace(saved, model_files=files), tmp_path / "a.codenerf")
    strangers = OpenModels(lambda name: random_model(seed=9))
    project = read_project(tmp_path / "a.codenerf").adopted(strangers)
    assert project.history == saved.history
    (fingerprint,) = saved.model_files
    assert project.objects[0].instance == MissingInstance(fingerprint, saved.objects[0].instance.codes)
    assert strangers.files[fingerprint] == "/gone/chairs.safetensors"
    Store().save(replace(project, model_files=strangers.files), tmp_path / "b.codenerf")
    assert read_project(tmp_path / "b.codenerf").history == saved.history
    extended = replace(random_model(seed=9), extends=(fingerprint,))
    project = read_project(tmp_path / "a.codenerf").adopted(open_models(extended))
    assert {state.scene.instance.fingerprint for state in project.history.states} == {extended.fingerprint}


def test_a_project_that_cannot_be_read_back_leaves_the_old_file(saved: Project, tmp_path: Path) -> None:
    path = tmp_path / "a.codenerf"
    content = path.read_bytes()
    ((key, fit),) = saved.fits.items()
    harmed = replace(fit, steps=(*fit.steps[:-1], replace(fit.last, loss=float("nan"))))
    with pytest.raises(ValueError, match="cannot be read back"):
        Store().save(replace(saved, fits={key: harmed}), path)
    with pytest.raises(ValueError, match="cannot write"):
        Store().save(saved, tmp_path / "no such folder" / "a.codenerf")
    assert path.read_bytes() == content and list(tmp_path.glob(".*")) == []


# Of any origin


def _content_of(query: str, content: str = "x'00'") -> str:
    return f"UPDATE blobs SET content = {content} WHERE id IN ({query})"


_STATES = "SELECT state FROM steps"
_LAST = "SELECT state FROM steps JOIN sessions ON number = current"
HARMS = {
    "state": (_content_of(_LAST),),
    "states": (_content_of(_STATES),),
    "camera": (f"UPDATE blobs SET content = replace(content, 'azimuth', 'nothing') WHERE id IN ({_LAST})",),
    "state and its row": ("DELETE FROM steps WHERE number = 1",),
    "tree": ("UPDATE sessions SET tip = 0",),
    "current": ("UPDATE sessions SET current = 'last'",),
    "object": ("UPDATE objects SET confidence = 7",),
    "version": ("UPDATE objects SET codes = 99999 WHERE version_of NOT NULL",),
    "fit": (_content_of("SELECT fit FROM objects"),),
    "request": (_content_of("SELECT pending FROM sessions", "'{}'"),),
    "requests": ("UPDATE sessions SET pending = 'many'",),
}
"""Changes of a project that leave the other parts of it."""


@pytest.mark.parametrize("harm", HARMS)
def test_an_unreadable_part_leaves_the_others(saved: Project, session: Session, tmp_path: Path, harm: str) -> None:
    path = tmp_path / "a.codenerf"
    change(path, "PRAGMA foreign_keys = OFF", *HARMS[harm])
    session.new()
    session.open_project(path)
    assert "Parts of it cannot be read" in session.messages.newest.text and session.messages.errors == []
    assert session.project_path is None  # so that the file is not written over
    project = opened(path, session) if harm != "states" else session.project()
    project.history.check()
    lost = {"state": 1, "camera": 1, "state and its row": 1}.get(harm, 0)
    count = 1 if harm == "states" else len(saved.history.steps) - lost
    assert len(project.history.steps) == count
    assert len(project.objects) == len(saved.objects) - {"object": 2, "version": 1}.get(harm, 0)
    assert bool(project.fits) == (harm not in ("fit", "object"))
    assert len(project.pending) == (not harm.startswith("request"))


def _png(side: int) -> bytes:
    file = io.BytesIO()
    Image.new("L", (side, side), 255).save(file, "PNG")
    return file.getvalue()


def _write(path: Path, query: str, content: bytes | str) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as connection:
        connection.execute(f"UPDATE blobs SET content = ? WHERE id IN ({query})", (content,))


_IMAGE = "SELECT id FROM blobs WHERE substr(content, 2, 3) = CAST('PNG' AS BLOB)"
_CYCLE = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i, 1, 2, '', '' FROM n"
BOMBS: dict[str, tuple[Callable[[Path], object], str]] = {
    "photo": (lambda path: _write(path, _IMAGE, _png(13_000)), "the image is too large"),
    "json": (lambda path: _write(path, _LAST, f'"{"a" * 17_000_000}"'), "JSON has at most 16 MB"),
    "nesting": (lambda path: _write(path, _LAST, "[" * 99_999 + "]" * 99_999), "nested too deeply"),
    "row": (lambda path: change(path, _content_of(_LAST, "zeroblob(90000000)")), "too big"),
    "view": (
        lambda path: change(
            path, "DROP TABLE sessions", f"CREATE VIEW sessions (id, current, tip, models, project) AS {_CYCLE}"
        ),
        "it has other tables than a project",
    ),
    "virtual": (
        lambda path: change(path, "DROP TABLE pictures", "CREATE VIRTUAL TABLE pictures USING fts4 (name)"),
        "it has other tables than a project",
    ),
    "generated": (
        lambda path: change(
            path,
            "DROP TABLE members",
            "CREATE TABLE members (session, object AS (length(hex(zeroblob(session * 30000000)))))",
            "INSERT INTO members VALUES (1)",
        ),
        "it has other tables than a project",
    ),
    "application": (lambda path: change(path, "PRAGMA application_id = 7"), "another program has written it"),
    "newer": (lambda path: change(path, "PRAGMA user_version = 99"), "another version of this program"),
    "empty": (lambda path: path.write_bytes(b""), "another program has written it"),
    "text": (lambda path: path.write_text("hello" * 1000), "not a database"),
    "no session": (lambda path: change(path, "DELETE FROM sessions"), "the project is empty"),
}
"""Changes of a project that take much memory or time, or that are none: how each is made, and what is said."""

_READ = """
import resource, sys, time
from pathlib import Path
from tests.conftest import open_models, random_model
from viewer.store.files import read_project
def megabytes():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // (1024 if sys.platform == "linux" else 1024**2)
assert not read_project(Path(sys.argv[1])).lost
before = megabytes()
for path in map(Path, sys.argv[2:]):
    try:
        print(f"{path.stem}: {read_project(path).lost}")
    except ValueError as error:
        print(f"{path.stem}: {error}")
print(megabytes() - before)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="nobody counts memory there")
def test_files_that_would_take_gigabytes_or_run_code_are_refused_in_one_line(saved: Project, tmp_path: Path) -> None:
    path = tmp_path / "a.codenerf"
    paths = [tmp_path / f"{name}.codenerf" for name in BOMBS]
    for (make, _), bomb in zip(BOMBS.values(), paths, strict=True):
        bomb.write_bytes(path.read_bytes())
        make(bomb)
    words = [sys.executable, "-c", _READ, path, *paths]
    done = subprocess.run(words, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=True)
    *lines, megabytes = done.stdout.splitlines()
    for (name, (_, said)), line in zip(BOMBS.items(), lines, strict=True):
        assert line.startswith(f"{name}: ") and said in line
    assert int(megabytes) < 500


def test_a_project_damaged_anywhere_is_read_in_part_or_refused(saved: Project, session: Session, tmp_path: Path):
    path = tmp_path / "a.codenerf"
    intact = path.read_bytes()
    generator = random.Random(0)
    opens = 0
    for _ in range(40):
        harmed = bytearray(intact)
        for _ in range(generator.randint(1, 20)):
            harmed[generator.randrange(len(harmed))] = generator.randrange(256)
        path.write_bytes(harmed[: generator.randint(len(harmed) // 2, 2 * len(harmed))])
        with suppress(ValueError):
            project = read_project(path, session.editor.state)
            project.history.check()
            opens += len(project.history.steps) > 1
    assert opens > 10
    with pytest.raises(ValueError, match="no such project"):
        read_project(tmp_path / "missing.codenerf")
