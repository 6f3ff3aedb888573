import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from core.models.codes import Entry
from core.models.model import Model
from tests.viewer.driver import Drive, Driver
from tests.viewer.stand_ins import endless_fit
from viewer.services.backend import Backend
from viewer.values.share_settings import ShareSettings


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


def test_photos_that_wait_are_tiles_that_can_go_first_or_be_removed(
    drive: Drive, backend: Backend, photo: Path
) -> None:
    paths = [photo, photo.with_name("block two.png"), photo.with_name("block three.png")]
    for path in paths[1:]:
        path.write_bytes(photo.read_bytes())

    def act(window: Driver) -> None:
        fitting = window.workspace.fitting
        for path in paths:
            window.context.drop([str(path)])
        window.wait(
            lambda: bool(fitting.history.steps) and window.context.session.photo_thumbnails.get(path) is not None
        )
        window.click("Library/**/waits block three.png")
        window.click("**/###do it now")
        window.wait(lambda: fitting.history.name == "block three" and len(fitting.history.steps) > 3)
        assert not window.exists("Library/**/waits block three.png")
        window.click("Library/**/waits block.png", 1)  # it was under way
        window.click("**/###remove waiting")
        window.wait(lambda: len(fitting.queue) == 1)
        assert [request.history.name for request in fitting.queue] == ["block two"]
        shown = window.capture()
        tile = window.ctx.item_info("//Library/**/waits block two.png").rect_full
        photographed = shown[int(tile.min.y) : int(tile.max.y), int(tile.min.x) : int(tile.max.x)]
        assert (photographed[..., 0] > 2 * photographed[..., 1]).any()  # the red block

    drive(act, replace(backend, fit=endless_fit))


def test_a_photo_of_the_other_category_waits_as_a_tile_for_the_file_under_way(
    drive: Drive, backend: Backend, model: Model, photo: Path, tmp_path: Path
) -> None:
    def slow(*_: object) -> Iterator[int]:
        while True:
            time.sleep(0.01)
            yield 0

    other = replace(model, category="cars")
    quick = replace(
        backend,
        load_model=lambda name: other if name == "cars" else model,
        guess_category=lambda _: {"cars": 0.95, "chairs": 0.01},
        video=slow,
    )

    def act(window: Driver) -> None:
        exporting = window.workspace.exporting
        exporting.share(tmp_path / "turn.mp4", ShareSettings())
        window.context.drop([str(photo)])
        window.wait(lambda: bool(window.session.waiting))
        window.click("Library/**/waits block.png")
        assert exporting.running  # nothing is given up before a person says so
        window.click("**/###do it now")
        window.wait(lambda: window.session.model_name == "cars" and not window.session.fitting_runs)
        assert not exporting.running
        assert window.workspace.editor.objects.own == ["block"]

    drive(act, quick)
