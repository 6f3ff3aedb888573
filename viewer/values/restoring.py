"""States of other sessions among the objects and the models of this one."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain

from core.models.model import Model
from core.models.open_models import OpenModels
from viewer.values.history import History
from viewer.values.objects import ObjectLibrary
from viewer.values.project import Project
from viewer.values.state import Mix, Pair, State


def first_mix(objects: ObjectLibrary, model: Model) -> Mix:
    """Return the mix of a model's first two objects, without any of the second."""
    forms = objects.families[model.fingerprint]
    first, second = ([*forms, *chain(*forms.values())] * 2)[:2]
    return Mix(Pair(first, first), second)


def restored(
    project: Project, current_state: State, objects: ObjectLibrary, models: OpenModels
) -> tuple[History, dict[str, str]]:
    """Add a project's objects to ``objects`` and return its history, at the nearest state that can be shown.

    Its edits of an object replace those made here, which become a version. If no state can be shown,
    ``current_state`` follows all others. Also returns the keys of the objects here by their keys in the project.
    """
    names = objects.match(project.objects)

    def with_names_here(state: State) -> State:
        removed = frozenset(names[name] for name in state.removed & names.keys())
        return replace(_with_names_here(state, names, objects, models), removed=removed)

    history = project.history.everywhere(with_names_here)
    for saved in project.objects:
        here = objects[names[saved.name]]
        if here.instance != saved.instance:
            objects.keep(here.name, here.instance)
        if saved.unedited:
            objects.leave(here.name, saved.instance)
    keys = {item.key: objects[names[item.name]].key for item in project.objects}
    nearest = next((number for number in history.nearest if objects.can_show(history.steps[number].state)), None)
    if nearest is None:
        return History.of(replace(current_state, removed=history.now.removed)).after(history), keys
    return history.at(nearest), keys


def reopened(history: History, model: Model, objects: ObjectLibrary, models: OpenModels) -> History:
    """Return a history whose states that waited for a newly opened model can be shown."""

    def with_names_here(state: State) -> State:
        waited = model.shares_codes_with(state.scene.instance.fingerprint)
        return _with_names_here(state, {}, objects, models) if waited else state

    return history.everywhere(with_names_here)


def _with_names_here(state: State, names: Mapping[str, str], objects: ObjectLibrary, models: OpenModels) -> State:
    """Return a state with the names of its objects here: by ``names``, or those of its model's objects."""
    instance = models.adopt(state.scene.instance)
    names_here = {name: objects.name_here(name, instance.fingerprint) or name for name in state.mix.names}
    mix = state.mix.renamed({**names_here, **names})
    return replace(state, scene=replace(state.scene, instance=instance), mix=mix)
