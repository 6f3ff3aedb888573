import json
import math
import random
import zipfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from core.models.missing import MissingInstance
from core.models.model import Model
from core.models.open_models import OpenModels
from core.models.photo_detail import compressed
from core.photos.photo import Photo
from core.photos.segmentation import Hints, Stroke
from core.runtime import reading
from tests.conftest import random_model
from tests.viewer.driver import finish
from viewer.editor import Editor
from viewer.session import Session
from viewer.values.fit_history import FitHistory, FitRequest, FittedPhoto, PhotoSource
from viewer.values.project import Project

_MODELS = "8ae7cc4698822b70", "55f394133df24d74"  # that the files of former versions were made with, or extend


@pytest.fixture
def models(session: Session) -> OpenModels:
    return session.models


@pytest.fixture
def saved(session: Session, editor: Editor, photo: Path) -> Project:
    """A fitted object, a mix, an undone edit, and a fit that waits."""
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    editor.set_b("object 4")
    editor.mix_both(0.0, 0.4)
    editor.show_object("object 2")
    editor.show_object("object 3")
    editor.undo()
    project = session.project()
    hints = Hints((0.1, 0.2, 0.8, 0.9), (Stroke(((0.5, 0.5), (0.6, 0.5)), 0.02, False),))
    source = PhotoSource(photo, hints)
    return replace(project, pending=(FitRequest(FitHistory((source,))),))


def test_a_saved_project_is_loaded_completely(
    models: OpenModels, saved: Project, session: Session, tmp_path: Path
) -> None:
    saved.save(tmp_path / "a.codenerf", models)
    loaded = Project.load(tmp_path / "a.codenerf", models)
    assert loaded.history == saved.history
    assert len(loaded.history.past) > 3
    assert len(loaded.history.future) == 1
    before, mixed = saved.objects
    after, mixed_again = loaded.objects
    assert mixed_again.instance == mixed.instance and mixed.version_of == before.key
    assert (after.name, after.confidence) == ("block", before.confidence)
    assert after.instance == before.instance
    assert after.fitted
    assert loaded.pending[0].history.sources == saved.pending[0].history.sources
    last = loaded.fit.last
    expected = saved.fit.last
    assert [step.psnr for step in loaded.fit.steps] == [step.psnr for step in saved.fit.steps]
    assert last.confidence == expected.confidence
    assert last.runner_up == expected.runner_up
    assert last.instance == expected.instance
    assert len(last.hypotheses) == len(expected.hypotheses)
    assert [len(step.hypotheses) for step in loaded.fit.steps[:-1]] == [1] * 9
    assert (last.hypotheses[0].crop_transform == expected.hypotheses[0].crop_transform).all()
    assert loaded.fit.photos[0].pixels.shape == saved.fit.photos[0].pixels.shape
    before, after = (project.fit.photos[0].preview for project in (saved, loaded))
    assert before and after and np.abs(after.pixels.astype(float) - before.pixels).mean() < 5  # the whole photo
    assert all(map(session.editor.can_show, loaded.history.states))


def test_loaded_states_share_codes(models: OpenModels, saved: Project, model: Model, tmp_path: Path):
    history = saved.history
    for step in range(400):  # the camera moves, the codes stay
        camera = replace(history.now.scene.camera, azimuth=0.01 * step)
        history = history.changed(replace(history.now, scene=replace(history.now.scene, camera=camera)))
    replace(saved, history=history).save(tmp_path / "a.codenerf", models)
    assert (tmp_path / "a.codenerf").stat().st_size < 200_000
    loaded = Project.load(tmp_path / "a.codenerf", models)
    assert loaded.history == history
    first = loaded.history.past[-300]
    last = loaded.history.now
    assert first.scene.instance.codes.shape.data_ptr() == last.scene.instance.codes.shape.data_ptr()


def test_a_photo_keeps_the_fields_beside_its_pixels(
    models: OpenModels, model: Model, saved: Project, tmp_path: Path
) -> None:
    mask = torch.zeros(8, 8, dtype=torch.bool)
    mask[2:5] = True
    photo = Photo(torch.rand(8, 8, 3), mask, model.camera(0.1, 0.2).resized(8, 8), True, ~mask)
    photo = replace(photo, scaled=True, opacity=0.9 * mask, edge_error=1.5, focal=50.0, blur=2.0)
    photo = replace(photo, fine=compressed(np.full((24, 24, 4), 255, np.uint8)))
    fitted = FittedPhoto.of(PhotoSource(tmp_path / "b.png"), photo)
    pending = (FitRequest(FitHistory((fitted.source,), (fitted,))),)
    replace(saved, pending=pending).save(tmp_path / "a.codenerf", models)
    loaded = Project.load(tmp_path / "a.codenerf", models).pending[0].history.photos[0].photo
    assert (loaded.camera, loaded.cropped) == (photo.camera, True)
    assert (loaded.unseen == photo.unseen).all()
    assert torch.equal(loaded.opacity, photo.opacity)
    assert (loaded.scaled, loaded.edge_error, loaded.focal, loaded.blur) == (True, 1.5, 50.0, 2.0)
    assert loaded.fine == photo.fine


def rewrite(path: Path, change: Callable[[dict, dict[str, bytes]], None]) -> None:
    """Change the JSON and the members of a project's file."""
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    record = json.loads(members["project.json"])
    change(record, members)
    members["project.json"] = json.dumps(record).encode()
    with zipfile.ZipFile(path, "w") as file:
        for name, content in members.items():
            file.writestr(name, content)


@pytest.mark.parametrize("harm", ["empty", "text", "cut", "no tensors", "format"])
def test_a_broken_project_is_reported_in_one_line(models: OpenModels, saved: Project, tmp_path: Path, harm: str):
    path = tmp_path / "a.codenerf"
    saved.save(path, models)

    def change(record: dict, members: dict[str, bytes]) -> None:
        if harm == "no tensors":
            del members["tensors.safetensors"]
        elif harm == "format":
            record["format"] = "another"

    rewrite(path, change)
    if harm in ("empty", "text", "cut"):
        path.write_bytes({"empty": b"", "text": b"hello", "cut": path.read_bytes()[:900]}[harm])
    with pytest.raises(ValueError, match=r"a\.codenerf: ") as error:
        Project.load(path, models)
    assert "\n" not in str(error.value)


def test_files_name_objects_as_before_codes_with_the_fingerprint_of_their_model(
    models: OpenModels, saved: Project, tmp_path: Path
) -> None:
    saved.save(tmp_path / "a.codenerf", models)
    with zipfile.ZipFile(tmp_path / "a.codenerf") as file:
        project = json.loads(file.read("project.json"))["project"]
    (model,) = models
    names = ["shape", "texture", "shape_offsets", "texture_offsets", "detail", "model"]
    scene = project["history"]["steps"][0]["state"]["scene"]
    for holder in (scene, *project["objects"], *project["fit"]["steps"]):
        assert "instance" not in holder and list(holder["codes"]) == names
        assert holder["codes"]["model"] == model.fingerprint
    assert list(scene) == ["codes", "camera"]


def _last_state(record: dict, members: dict[str, bytes]) -> None:
    history = record["project"]["history"]
    del history["steps"][history["current"]]["state"]["mix"]["a"]


def _camera(record: dict, members: dict[str, bytes]) -> None:
    record["project"]["history"]["steps"][1]["state"]["scene"]["camera"]["distance"] = "far"


def _every_state(record: dict, members: dict[str, bytes]) -> None:
    for step in record["project"]["history"]["steps"]:
        step["state"]["scene"] = 0


def _object(record: dict, members: dict[str, bytes]) -> None:
    record["project"]["objects"][0]["confidence"] = 7


def _fit(record: dict, members: dict[str, bytes]) -> None:
    record["project"]["fit"]["steps"][0]["loss"] = "small"


def _photo(record: dict, members: dict[str, bytes]) -> None:
    members["photos/0.png"] = b"no image"


def _request(record: dict, members: dict[str, bytes]) -> None:
    record["project"]["pending"][0]["history"]["sources"][0]["path"] = 3


def _newer(record: dict, members: dict[str, bytes]) -> None:
    record["format"] = "codenerf-project-9"


_HARMS = _last_state, _camera, _every_state, _object, _fit, _photo, _request, _newer


@pytest.mark.parametrize("harm", _HARMS, ids=lambda harm: harm.__name__)
def test_a_part_that_cannot_be_read_leaves_the_others_and_its_file_is_kept(
    models: OpenModels, saved: Project, tmp_path: Path, harm: Callable[[dict, dict[str, bytes]], None]
) -> None:
    path = tmp_path / "a.codenerf"
    saved.save(path, models)
    rewrite(path, harm)
    project = Project.load(path, models)
    lost = {_last_state: 1, _camera: 1, _every_state: len(saved.history.states) - 1}.get(harm, 0)
    assert len(project.history.states) == len(saved.history.states) - lost
    assert len(project.objects) == len(saved.objects) - (harm is _object)
    assert bool(project.fit.steps) == (harm not in (_fit, _photo))
    assert len(project.pending) == len(saved.pending) - (harm is _request)
    (original,) = project.originals
    assert original.name == "a.codenerf" and original.content == path.read_bytes() and all(original.reasons)
    project.save(tmp_path / "b.codenerf", models)
    again = Project.load(tmp_path / "b.codenerf", models)
    assert again.originals == project.originals
    assert again.history == project.history


@pytest.fixture
def branched(saved: Project) -> Project:
    """The same at a branch from the second state; the later ones are another branch."""
    history = saved.history.at(1)
    camera = history.now.scene.camera
    instance = history.past[0].scene.instance
    edited = replace(
        history.now, scene=replace(history.now.scene, instance=instance.changed(texture=instance.codes.texture + 0.1))
    )
    turned = replace(edited, scene=replace(edited.scene, camera=replace(camera, azimuth=0.5)))
    return replace(saved, history=history.changed(edited).changed(turned))


@pytest.mark.parametrize("lost", ["first", "fork", "now", "end of the other", "step", "all but the other"])
def test_branches_stay_where_a_state_between_cannot_be_read(
    models: OpenModels, branched: Project, tmp_path: Path, lost: str
) -> None:
    history = branched.history
    path = tmp_path / "a.codenerf"
    (branch,) = history.branches()
    own = [history.steps.index(step) for step in history.steps if step.state in history.states]
    numbers = {"first": [0], "fork": [1], "now": [history.current], "end of the other": [branch.last], "step": [1]}
    dropped = numbers.get(lost, own)
    branched.save(path, models)

    def harm(record: dict, members: dict[str, bytes]) -> None:
        for number in dropped:
            if lost == "step":
                record["project"]["history"]["steps"][number] = "lost"
            else:
                record["project"]["history"]["steps"][number]["state"]["mix"] = None

    rewrite(path, harm)
    project = Project.load(path, models)
    project.history.check()
    assert len(project.originals) == 1
    left = [step.state for number, step in enumerate(history.steps) if number not in dropped]
    assert [step.state for step in project.history.steps] == left
    assert len(project.history.branches()) == (lost != "all but the other")
    if history.current not in dropped:
        assert project.history.now == history.now


@pytest.mark.parametrize(
    "harm", [{"current": 99}, {"tip": 0}, {"tip": "last"}, {"current": None}, {"steps": 3}], ids=str
)
def test_states_that_are_no_tree_are_consecutive(
    models: OpenModels, branched: Project, tmp_path: Path, harm: dict
) -> None:
    path = tmp_path / "a.codenerf"
    branched.save(path, models)
    rewrite(path, lambda record, members: record["project"]["history"].update(harm))
    project = Project.load(path, models)
    assert project.originals[0].content == path.read_bytes()
    scenes = [step.state.scene for step in branched.history.steps]
    assert [state.scene for state in project.history.states] == (scenes[:1] if "steps" in harm else scenes)


def test_objects_of_a_missing_model_are_saved_unchanged(models: OpenModels, saved: Project, tmp_path: Path) -> None:
    def foreign(record: dict, members: dict[str, bytes]) -> None:
        record["project"]["objects"][0]["codes"]["model"] = "0" * 16
        record["project"]["history"]["steps"][1]["state"]["scene"]["codes"]["model"] = "0" * 16
        record["project"]["models"] = ["chairs", "/gone/stools.safetensors"]
        record["project"]["model_files"] = {}

    saved.save(tmp_path / "a.codenerf", models)
    rewrite(tmp_path / "a.codenerf", foreign)
    (model,) = models

    def load(name: str) -> Model:
        raise ValueError(f"no such model: {name}")

    here = OpenModels(load)
    here.add("chairs", model)
    project = Project.load(tmp_path / "a.codenerf", here)
    assert here.files["0" * 16] == "/gone/stools.safetensors"
    assert not project.originals
    replace(project, model_files=here.files).save(tmp_path / "b.codenerf", here)
    again = Project.load(tmp_path / "b.codenerf", here)
    assert again.objects[0].instance == MissingInstance("0" * 16, saved.objects[0].instance.codes)
    assert again.history == project.history
    assert again.model_files["0" * 16] == "/gone/stools.safetensors"


def test_a_project_that_is_missing_or_of_no_open_model(models: OpenModels, tmp_path: Path, saved: Project) -> None:
    with pytest.raises(ValueError, match=r"no such project: .*a\.codenerf"):
        Project.load(tmp_path / "a.codenerf", models)
    saved.save(tmp_path / "a.codenerf", models)
    (model,) = models
    strangers = OpenModels(lambda name: random_model(seed=9))
    loaded = Project.load(tmp_path / "a.codenerf", strangers)
    assert loaded.history == saved.history and all(state.scene.instance.is_missing for state in loaded.history.states)
    extended = replace(random_model(seed=9), extends=(model.fingerprint,))
    loaded = Project.load(tmp_path / "a.codenerf", OpenModels(lambda name: extended))
    assert {state.scene.instance.fingerprint for state in loaded.history.states} == {extended.fingerprint}


def test_states_that_mix_objects_that_nobody_has_are_not_shown(session: Session, saved: Project) -> None:
    editor = Editor(session.models, session.editor.model, torch.Generator())
    editor.restore(replace(saved, objects=()))
    assert [editor.can_show(state) for state in editor.history.states] == [
        "block" not in state.mix.names for state in saved.history.states
    ]
    assert editor.can_show(editor.state)


def test_a_project_that_is_too_large_is_not_saved(session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(reading, "MAX_TEXT", 10)
    assert not session.save_project(tmp_path / "a.codenerf")
    assert len(session.messages.errors) == 1 and not list(tmp_path.iterdir())


@pytest.mark.parametrize("kind", [zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_project_damaged_anywhere_is_reported_in_one_line(
    models: OpenModels, saved: Project, tmp_path: Path, kind: int
):
    path = tmp_path / "a.codenerf"
    saved.save(path, models)
    with zipfile.ZipFile(path) as file:
        members = {name: file.read(name) for name in file.namelist()}
    with zipfile.ZipFile(path, "w", kind) as file:
        for name, content in members.items():
            file.writestr(name, content)
    intact = path.read_bytes()
    generator = random.Random(0)
    assert Project.load(path, models).objects
    for _ in range(40):
        harmed = bytearray(intact)
        for _ in range(generator.randint(1, 20)):
            harmed[generator.randrange(len(harmed))] = generator.randrange(256)
        path.write_bytes(harmed[: generator.randint(1, 2 * len(harmed))])
        with suppress(ValueError):
            Project.load(path, models)


def test_a_project_that_cannot_be_read_back_leaves_the_old_file(
    models: OpenModels, saved: Project, tmp_path: Path
) -> None:
    path = tmp_path / "a.codenerf"
    saved.save(path, models)
    before = path.read_bytes()
    step = replace(saved.fit.steps[-1], loss=math.nan)
    harmed = replace(saved, fit=replace(saved.fit, steps=(*saved.fit.steps[:-1], step)))
    with pytest.raises(ValueError, match="cannot be read back"):
        harmed.save(path, models)
    assert path.read_bytes() == before
    assert list(tmp_path.glob(".*")) == []


def test_a_project_that_is_handed_on_names_no_folder_and_finds_photos_beside_it(
    models: OpenModels, saved: Project, photo: Path, tmp_path: Path
) -> None:
    path = tmp_path / "elsewhere" / "a.codenerf"
    path.parent.mkdir()
    replace(saved, pending=(), path=tmp_path / "kept.codenerf").shared().save(path, models)
    with zipfile.ZipFile(path) as file:
        assert str(tmp_path).encode() not in b"".join(map(file.read, file.namelist()))
    project = Project.load(path, models)
    assert project.path is None
    moved = project.beside(path.parent)
    assert moved.fit.sources[0].path == moved.fit.photos[0].source.path == Path(photo.name)
    (path.parent / photo.name).write_bytes(photo.read_bytes())
    moved = project.beside(path.parent)
    assert moved.fit.sources[0].path == path.parent / photo.name
