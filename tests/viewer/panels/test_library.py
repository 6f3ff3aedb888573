from dataclasses import replace
from pathlib import Path

import numpy as np
from imgui_bundle import imgui

from core.models.codes import Entry
from core.models.model import Model
from tests.viewer.driver import Drive, Driver, in_window
from tests.viewer.stand_ins import HeldFit, block, endless_fit
from viewer.services.backend import Backend


def test_one_of_each_form_is_listed_and_its_variants_fold_out(drive: Drive, backend: Backend, model: Model) -> None:
    names = ("kenney_chair", "kenney_chair-form1", "kenney_chair-look1", "object 3", "object 4", "object 5")
    book = replace(model.codes, objects=tuple(Entry(name, i, i) for i, name in enumerate(names)))
    varied = replace(model, codes=book)

    def act(window: Driver) -> None:
        mix = window.editor.state.mix
        assert mix.a.shape == "kenney_chair"
        assert mix.b.startswith("object")  # an unlike one, not a variant
        assert window.exists("Library/**/show object 5")
        assert not window.exists("Library/**/show kenney_chair-look1")
        window.click("Library/**/variants of kenney_chair")
        window.click("Library/**/show kenney_chair-look1")
        assert window.editor.state.mix.a.shape == "kenney_chair-look1"
        window.click("Library/**/variants of kenney_chair")
        assert not window.exists("Library/**/show kenney_chair-look1")

    drive(act, replace(backend, load_model=lambda name: varied))


def test_forty_photos_are_fitted_one_after_the_other(drive: Drive, backend: Backend, photo: Path) -> None:
    paths = [block(photo, f"{number:02d}") for number in range(40)]
    fit = HeldFit()

    def top(window: Driver, name: str) -> float:
        return window.ctx.item_info(f"//{name}").rect_full.min.y

    def act(window: Driver) -> None:
        window.context.drop([*map(str, paths)])
        window.wait(lambda: bool(window.fitting.history.steps) and window.fitting.history.photo is not None)
        assert len(window.fitting.waiting.requests) == 39
        rows = [top(window, f"Library/**/waits block {number:02d}.png") for number in range(16)]  # in sight
        assert rows == sorted(rows)
        assert len(set(rows)) == 8  # of two columns
        window.show("Photo")
        assert window.exists("Photo/**/waits block 07.png")
        assert not window.exists("Photo/**/waits block 20.png")
        window.wait(lambda: window.exists("Photo/**/###point at it"))
        assert top(window, "Photo/**/###point at it") < 800  # the photo is in sight
        fit.may_end.set()
        window.wait(lambda: not window.fitting.running and not window.fitting.waiting.requests)
        assert window.editor.objects.own == [path.stem for path in reversed(paths)]
        assert not window.fitting.pending
        assert not window.session.jobs.messages.errors

    drive(act, replace(backend, fit=fit))


@in_window()
def test_what_was_fitted_is_mine(window: Driver, photo: Path) -> None:
    window.click("View/**/###fit_image")
    window.type(str(photo))
    window.wait(lambda: not window.fitting.running)
    window.wait()
    assert window.editor.objects.own == ["block"]
    second = block(photo, "two")
    window.fit(second)
    assert window.fitting.history.photo.source.path == second
    window.click("Library/**/show block")  # the photo panel follows
    assert window.fitting.history.photo.source.path == photo
    window.click("Library/**/show block two")
    assert window.fitting.history.photo.source.path == second
    window.click("Library/**/show object 3")
    window.click("Library/**/show block")
    assert window.editor.state.mix.a == ("block", "block")


@in_window(fit=endless_fit)
def test_photos_under_way_are_tiles_that_can_be_stopped_or_removed(window: Driver, photo: Path) -> None:
    paths = [photo, block(photo, "two"), block(photo, "three")]
    fitting = window.fitting
    for path in paths:
        window.context.drop([str(path)])
    window.wait(lambda: bool(fitting.history.steps) and window.context.session.photo_thumbnails.get(path) is not None)
    window.click("Library/**/waits block two.png", 1)
    window.click("**/###remove waiting")
    assert [request.history.name for request in fitting.waiting.requests] == ["block three"]
    window.click("Library/**/waits block.png", 1)  # it is under way
    window.click("**/###stop fit")
    window.wait(lambda: fitting.history.name == "block three" and len(fitting.history.steps) > 3)
    assert not window.exists("Library/**/waits block.png")
    screen = window.capture()
    tile = window.ctx.item_info("//Library/**/waits block three.png").rect_full
    photographed = screen[int(tile.min.y) : int(tile.max.y), int(tile.min.x) : int(tile.max.x)]
    assert (photographed[..., 0] > 2 * photographed[..., 1]).any()  # the red block


@in_window(fixture="both")
def test_chairs_and_cars_are_one_library(window: Driver) -> None:
    cars, chairs = window.session.models
    window.click("Library/**/show car 2")
    assert window.editor.model is cars and window.editor.state.mix.b.startswith("car")
    window.click(f"Library/###{chairs.fingerprint}")
    assert not window.exists("Library/**/show car 2")
    window.drop("Library/**/show object 3", "Mix/slot B")
    assert window.editor.model is cars
    assert window.session.messages.newest.text == "A chair cannot be mixed with a car: show it to begin with it"
    window.click("##MainMenuBar/##MenuBar/###show")
    assert window.editor.model is chairs
    window.click("Library/**/show object 2", 1)
    window.click("**/Make it B")
    assert window.editor.state.mix.b == "object 2"
    window.click("Library/###mine")
    assert not window.exists("Library/**/show object 2")
    window.click("Library/###all")
    window.click("Library/**/show car 3", 1)
    window.ctx.item_click("**/Make it B")  # which is greyed
    window.press(imgui.Key.escape)
    assert window.editor.state.mix.b == "object 2"
    for _ in range(3):
        window.undo()
    assert window.editor.model is chairs and not window.editor.history.past


@in_window()
def test_arrow_keys_go_from_tile_to_tile_with_a_ring_and_enter_shows_one(window: Driver) -> None:
    key = imgui.Key
    window.click("Library/**/show object 2")
    window.press(key.down_arrow)
    window.press(key.right_arrow)
    focused = imgui.internal.get_focus_id()
    (name,) = (
        name
        for name in next(iter(window.editor.objects.families.values()))
        if window.ctx.item_info(f"//Library/**/show {name}").id_ == focused
    )
    box = window.ctx.item_info(f"//Library/**/show {name}").rect_full
    around = window.capture()[int(box.min.y) - 6 : int(box.max.y) + 6, int(box.min.x) - 6 : int(box.max.x) + 6]
    ring = np.abs(around / 255 - window.context.palette.accent).max(-1) < 0.02
    assert ring.sum() > box.max.x - box.min.x
    window.press(key.enter)
    assert name != "object 2" and window.editor.state.mix.a.shape == name


@in_window(fixture="both")
def test_a_category_lists_the_fitted_objects_of_it_first(window: Driver, photo: Path) -> None:
    window.fit(photo)
    filters = {model.category: model.fingerprint for model in window.session.models}
    for filter_id, is_listed in ((filters["cars"], False), (filters["chairs"], True), ("mine", True)):
        window.click(f"Library/**/###{filter_id}")
        window.ctx.yield_(2)
        assert window.exists("Library/**/show block") == is_listed
