import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from core.models.model import Instance, Model
from core.models.scene import open_scene
from tests.conftest import open_models, random_model
from viewer.services.user_objects import UserObjects
from viewer.values.objects import EditableObject, ObjectLibrary


@pytest.fixture
def fitted(model: Model) -> EditableObject:
    return EditableObject("Red chair (2)", model[1], True, 0.83, key="1")


def test_objects_last_from_launch_to_launch(tmp_path: Path, model: Model, fitted: EditableObject) -> None:
    user_objects = UserObjects(tmp_path / "mine")
    assert user_objects.open(open_models(model)) == ()
    user_objects.sync(open_models(model), [fitted])
    (stored,) = UserObjects(tmp_path / "mine").open(open_models(model))
    assert (stored.name, stored.confidence) == ("Red chair (2)", 0.83)
    assert stored.instance == fitted.instance
    assert stored.fitted
    (path,) = (tmp_path / "mine").iterdir()
    assert open_scene(path, model).instance == fitted.instance  # it opens as any scene
    (waiting,) = UserObjects(tmp_path / "mine").open(open_models(random_model(seed=7)))
    assert (waiting.name, waiting.instance.is_missing) == (fitted.name, True)


def test_objects_last_when_their_model_is_extended(tmp_path: Path, model: Model, fitted: EditableObject) -> None:
    UserObjects(tmp_path).sync(open_models(model), [fitted])
    extended = replace(random_model(seed=7), extends=(model.fingerprint,))
    user_objects = UserObjects(tmp_path)
    (stored,) = user_objects.open(open_models(extended))
    instance = Instance(extended, fitted.instance.codes)
    assert (stored.name, stored.instance) == (fitted.name, instance)
    user_objects.sync(open_models(extended), [replace(stored, name="green")])
    (again,) = UserObjects(tmp_path).open(open_models(extended))
    assert (again.name, again.instance) == ("green", instance)


def test_an_edited_object_lasts_with_its_edits_in_its_place(tmp_path: Path, model: Model, fitted: EditableObject):
    user_objects = UserObjects(tmp_path)
    second = replace(fitted, name="green", key="2")
    user_objects.sync(open_models(model), [fitted])
    user_objects.sync(open_models(model), [fitted, second])
    edited = fitted.left_as(model[2])
    user_objects.sync(open_models(model), [edited, second])
    stored, _ = UserObjects(tmp_path).open(open_models(model))
    assert (stored.instance, stored.original, stored.unedited) == (edited.instance, fitted.instance, fitted.instance)
    user_objects.sync(open_models(model), [edited.left_as(fitted.instance), second])
    stored, _ = UserObjects(tmp_path).open(open_models(model))
    assert (stored.instance, stored.unedited) == (fitted.instance, None)


def test_an_update_stores_edits_of_kept_objects_alone(tmp_path: Path, model: Model, fitted: EditableObject) -> None:
    user_objects = UserObjects(tmp_path)
    unstored = EditableObject("green", model[3], True, key="2")
    user_objects.sync(open_models(model), [fitted])
    edited = fitted.left_as(model[2])
    user_objects.update(open_models(model), [edited, unstored])
    renamed = replace(unstored, name=fitted.name)  # the name is another object's by now
    user_objects.update(open_models(model), [renamed])
    (stored,) = UserObjects(tmp_path).open(open_models(model))
    assert (stored.instance, stored.original) == (edited.instance, fitted.instance)


def test_renamed_and_removed_objects_stay_so(tmp_path: Path, model: Model, fitted: EditableObject) -> None:
    user_objects = UserObjects(tmp_path)
    second = replace(fitted, name="../../blue", key="2")
    user_objects.sync(open_models(model), [fitted, second])
    user_objects.sync(open_models(model), [fitted, replace(second, name="green")])
    assert {stored.name for stored in UserObjects(tmp_path).open(open_models(model))} == {"Red chair (2)", "green"}
    user_objects.sync(open_models(model), [fitted])
    assert len(list(tmp_path.iterdir())) == 1
    written = next(tmp_path.iterdir()).stat().st_mtime_ns
    user_objects.sync(open_models(model), [fitted])
    assert next(tmp_path.iterdir()).stat().st_mtime_ns == written


def test_files_that_were_not_read_stay_unchanged(tmp_path: Path, model: Model, fitted: EditableObject) -> None:
    (tmp_path / "torn.json").write_text('{"model": ')
    user_objects = UserObjects(tmp_path)
    user_objects.open(open_models(model))
    UserObjects(tmp_path).sync(open_models(model), [fitted])  # of another window
    user_objects.sync(open_models(model), [])
    assert len(list(tmp_path.iterdir())) == 2
    user_objects = UserObjects()
    user_objects.sync(open_models(model), [fitted])
    assert user_objects.open(open_models(model)) == ()


def test_equal_names_of_two_windows_are_told_apart(tmp_path: Path, model: Model, fitted: EditableObject) -> None:
    windows = [UserObjects(tmp_path), UserObjects(tmp_path)]
    second = replace(fitted, instance=model[2], key="2")
    for user_objects, added in zip(windows, (fitted, second), strict=True):
        user_objects.sync(open_models(model), [added])
    again = UserObjects(tmp_path)
    stored = again.open(open_models(model))
    assert {item.name for item in stored} == {"Red chair (2)", "Red chair (2) (2)"}
    assert {item.instance for item in stored} == {fitted.instance, second.instance}
    again.sync(open_models(model), [item for item in stored if item.instance == second.instance])
    (left,) = UserObjects(tmp_path).open(open_models(model))
    assert left.instance == second.instance


def test_versions_of_two_windows_stay_with_their_own_objects(tmp_path: Path, model: Model, fitted: EditableObject):
    """All of one window's files are newer than the other's first one, and the names are the same."""
    second = replace(fitted, instance=model[2], key="2")
    versions = [
        replace(root.left_as(model[number]), name="version", version_of=root.key, key=str(number))
        for number, root in ((3, fitted), (4, second))
    ]
    for added in zip((fitted, second), versions, strict=True):
        UserObjects(tmp_path).sync(open_models(model), added)
    library = ObjectLibrary(open_models(model))
    library.match(UserObjects(tmp_path).open(open_models(model)))
    for root, version in zip((fitted, second), versions, strict=True):
        (name,) = (added.name for added in library.added if added.instance == root.instance)
        assert [library[item].instance for item in library.versions(name)] == [root.instance, version.instance]


def test_a_copied_file_is_another_object_once(tmp_path: Path, model: Model, fitted: EditableObject) -> None:
    UserObjects(tmp_path).sync(open_models(model), [fitted])
    (path,) = tmp_path.iterdir()
    shutil.copy(path, tmp_path / "copy.json")
    for _ in range(2):
        user_objects = UserObjects(tmp_path)
        user_objects.sync(open_models(model), user_objects.open(open_models(model)))
    assert len(list(tmp_path.iterdir())) == 2
