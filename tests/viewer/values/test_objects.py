"""Objects of two sessions and their versions."""

import pytest

from core.models.model import Model
from tests.conftest import open_models
from viewer.values.objects import EditableObject, ObjectLibrary


def test_versions_of_another_session_are_listed(model: Model) -> None:
    here = ObjectLibrary(open_models(model))
    here.add(EditableObject("chair", model[1], unedited=model[0], key="7"))
    here.add(EditableObject("chair (2)", model[0], version_of=here["chair"].key))
    incoming = (
        EditableObject("chair", model[0], key="7"),
        EditableObject("chair (2)", model[2], unedited=model[0], version_of="7", key="8"),
        EditableObject("chair (3)", model[3], unedited=model[0], version_of="7", key="9"),
    )
    names = here.match(incoming)
    assert names["chair"] == "chair"
    assert set(here.versions("chair")) == {added.name for added in here.added}
    assert here.own == ["chair"]


def test_a_new_object_with_a_former_ones_name_gets_none_of_its_versions(model: Model) -> None:
    library = ObjectLibrary(open_models(model))
    library.add(EditableObject("chair", model[0]))
    version = library.version("chair", model[1])
    left = (library[version], EditableObject("chair", model[2]))  # of another session, from which the root was removed
    library = ObjectLibrary(open_models(model))
    library.match(left)
    assert library.versions("chair") == ["chair"]
    assert len(library.own) == 2


def test_a_renamed_object_keeps_its_versions_when_another_takes_its_name(model: Model) -> None:
    library = ObjectLibrary(open_models(model))
    library.add(EditableObject("chair", model[0]))
    version = library.version("chair", model[1])
    library.rename("chair", "armchair")
    library.add(EditableObject("chair", model[2]))
    assert library.versions("armchair") == ["armchair", version]
    assert library.versions("chair") == ["chair"]


def test_versions_of_another_home_stay_with_their_object(model: Model) -> None:
    homes = [ObjectLibrary(open_models(model)) for _ in range(2)]
    for number, home in enumerate(homes):
        home.add(EditableObject("chair", model[2 * number], key="7"))
        home.version("chair", model[2 * number + 1])
    here, stranger = homes
    names = here.match(stranger.ever_added)
    assert here.versions("chair") == ["chair", "chair (2)"]
    assert here.versions(names["chair"]) == [names["chair"], names["chair (2)"]]
    assert here.own == [names["chair"], "chair"]


@pytest.mark.parametrize("key", ["-1", "1.5", "police", "9" * 5000])
def test_a_key_that_is_no_time_is_refused(model: Model, key: str) -> None:
    with pytest.raises(ValueError, match="an object's key is a number of ns"):
        EditableObject("chair", model[0], key=key)
