from dataclasses import replace
from pathlib import Path

from core.models.codes import Entry
from core.models.model import Model
from tests.viewer.driver import Drive, Driver
from viewer.services.backend import Backend


def test_one_of_each_form_is_listed_and_its_variants_fold_out(drive: Drive, backend: Backend, model: Model) -> None:
    names = ("kenney_chair", "kenney_chair-form1", "kenney_chair-look1", "object 3", "object 4", "object 5")
    book = replace(model.codes, objects=tuple(Entry(name, i, i) for i, name in enumerate(names)))
    varied = replace(model, codes=book)

    def act(window: Driver) -> None:
        mix = window.workspace.editor.state.mix
        assert mix.a.shape == "kenney_chair"
        assert mix.b.startswith("object")  # an unlike one, not a variant
        assert window.exists("Library/**/show object 5")
        assert not window.exists("Library/**/show kenney_chair-look1")
        window.click("Library/**/variants of kenney_chair")
        window.click("Library/**/show kenney_chair-look1")
        assert window.workspace.editor.state.mix.a.shape == "kenney_chair-look1"
        window.click("Library/**/variants of kenney_chair")
        assert not window.exists("Library/**/show kenney_chair-look1")

    drive(act, replace(backend, load_model=lambda name: varied))


def test_what_was_rebuilt_is_mine(drive: Drive, photo: Path) -> None:
    def act(window: Driver) -> None:
        window.click("Library/###fit_image")
        window.type(str(photo))
        window.wait(lambda: not window.workspace.fitting.running)
        window.wait()
        assert window.workspace.editor.objects.own == ["block"]
        other = photo.with_name("block two.png")
        other.write_bytes(photo.read_bytes())
        window.fit(other)
        fitting = window.workspace.fitting
        assert fitting.history.photo.source.path == other
        window.click("Library/**/show block")  # the photo panel follows
        assert fitting.history.photo.source.path == photo
        window.click("Library/**/show block two")
        assert fitting.history.photo.source.path == other
        window.click("Library/**/show object 3")
        window.click("Library/**/show block")
        assert window.workspace.editor.state.mix.a == ("block", "block")

    drive(act)
