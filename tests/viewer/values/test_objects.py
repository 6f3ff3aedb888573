"""Objects of two sessions and their versions."""

from core.models.model import Model
from tests.conftest import open_models
from viewer.values.objects import EditableObject, ObjectLibrary


def test_versions_of_another_session_are_listed(model: Model) -> None:
    here = ObjectLibrary(open_models(model))
    here.add(EditableObject("chair", model[1], unedited=model[0]))
    here.add(EditableObject("chair (2)", model[0], version_of="chair"))
    there = (
        EditableObject("chair", model[0]),
        EditableObject("chair (2)", model[2], unedited=model[0], version_of="chair"),
        EditableObject("chair (3)", model[3], unedited=model[0], version_of="chair"),
    )
    names = here.match(there)
    assert names["chair"] == "chair"
    assert set(here.versions("chair")) == {added.name for added in here.added}
    assert here.own == ["chair"]
