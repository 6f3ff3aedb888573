import errno
import json
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from core.fitting.fit import FitJob, FitStep
from core.models.codes import CodeBook, Codes
from core.models.model import Model
from core.photos.photo import Framing
from tests.core.tiny import tiny_model
from tests.viewer.window_driver import broken_fit, deliver, endless_fit, finish, quick_frames
from viewer.activities.exporting import VideoChoice
from viewer.services.messages import Kind
from viewer.services.worker import Worker
from viewer.session import PARTS, Session, Streams
from viewer.values import orbit
from viewer.values.fit_history import Source


def test_a_model_opens_with_its_first_object_drawn(session: Session, model: Model) -> None:
    assert session.scene.codes == model.codes[0]
    assert session.scene.camera == orbit.home(model)
    assert session.viewport.frame is not None
    assert session.viewport.frame.final
    assert session.messages == []


def test_thumbnails_are_drawn_when_they_are_asked_for(session: Session, model: Model) -> None:
    names = session.gallery.names
    assert len(names) == len(model.codes)
    assert [session.gallery.picture(name) for name in names[:2]] == [None, None]
    finish(session)
    assert all(session.gallery.picture(name) for name in names[:2])
    assert session.gallery.picture(names[2]) is None
    finish(session)
    assert session.gallery.picture(names[2])


def test_no_edit_before_there_is_a_model_does_harm(worker: Worker, streams: Streams, tmp_path: Path) -> None:
    session = Session(worker, streams)
    session.undo()
    session.redo()
    session.settle()
    session.viewport.render()
    session.load_scene(tmp_path / "scene.json")
    session.exporting.turntable(tmp_path / "a.mp4")
    session.exporting.mesh(tmp_path / "a.glb")
    session.exporting.picture(tmp_path / "a.png")
    session.fitting.stop()
    assert not session.ready
    assert not session.worker.busy()


def test_a_model_that_cannot_be_opened_leaves_the_open_one(session: Session) -> None:
    def missing(name: str) -> Model:
        raise ValueError(f"no model called {name!r}")

    before = session.history
    session.streams = replace(session.streams, load_model=missing)
    session.open_model("tables")
    finish(session)
    assert session.history is before
    assert session.errors == ["Cannot open the model tables: no model called 'tables'"]


def test_every_edit_can_be_undone_and_redone(session: Session, tmp_path: Path, model: Model) -> None:
    session.save_scene(tmp_path / "saved.json")
    edits = (
        lambda: session.look(orbit.dragged(session.scene.camera, 0.2, 0.1)),
        lambda: session.show("object 2"),
        lambda: session.pick_b("object 4"),
        lambda: session.mix("shape", 0.5),
        lambda: session.mix("texture", 0.7),
        lambda: session.mix_both(0.2, 0.3),
        lambda: session.take("texture", "object 3"),
        lambda: session.swap(),
        lambda: session.move_along("shape", 1, 2.0),
        lambda: session.randomise("texture"),
        lambda: session.pull("shape", 0.5),
        lambda: session.to_mean("shape"),
        lambda: session.to_object("texture"),
        lambda: session.reset_view(),
        lambda: session.film.add_key(),
        lambda: session.film.set_turns(2),
        lambda: session.load_scene(tmp_path / "saved.json"),
    )
    states = [session.state]
    for edit in edits:
        edit()
        assert session.state != states[-1]
        states.append(session.state)
    for state in states[-2::-1]:
        session.undo()
        assert session.state == state
    for state in states[1:]:
        session.redo()
        assert session.state == state


def test_a_drag_is_one_step(session: Session) -> None:
    before = session.state
    for number in range(20):
        session.move_along("shape", 0, 0.1 * number + 0.05, gesture="shape 0")
    session.settle()
    session.undo()
    assert session.state == before


def test_a_direction_moves_alone(session: Session) -> None:
    before = session.space("shape").coordinates(session.code("shape"))
    session.move_along("shape", 2, -1.5)
    after = session.space("shape").coordinates(session.code("shape"))
    expected = before.clone()
    expected[2] = -1.5
    torch.testing.assert_close(after, expected, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(session.code("texture"), session.gallery["object 0"].codes.texture)


def test_shape_and_texture_slide_from_a_to_b_independently(session: Session) -> None:
    session.show("object 1")
    session.pick_b("object 2")
    a, b = session.gallery["object 1"].codes, session.gallery["object 2"].codes
    assert session.scene.codes == a
    session.mix("shape", 1.0)
    torch.testing.assert_close(session.code("shape"), b.shape)
    assert torch.equal(session.code("texture"), a.texture)
    session.mix("texture", 0.5)
    torch.testing.assert_close(session.code("texture"), (a.texture + b.texture) / 2)
    torch.testing.assert_close(session.code("shape"), b.shape)


def test_shape_and_texture_are_taken_from_different_objects(session: Session) -> None:
    one, two = session.gallery["object 1"].codes, session.gallery["object 2"].codes
    session.show("object 3")
    session.mix_both(0.5, 0.5)
    session.take("shape", "object 1")
    assert torch.equal(session.code("shape"), one.shape)
    assert (session.state.mix.a, session.state.mix.shape) == (("object 1", "object 3"), 0.0)
    assert session.state.mix.texture == 0.5
    session.take("texture", "object 2")
    assert torch.equal(session.code("texture"), two.texture)
    session.swap()
    assert session.state.mix.a == ("object 2", "object 1")
    torch.testing.assert_close(session.code("shape"), two.shape)
    torch.testing.assert_close(session.code("texture"), one.texture)
    session.move_along("shape", 0, 1.0)
    session.to_object("shape")
    assert torch.equal(session.code("shape"), two.shape)


def test_what_is_locked_stays_whatever_is_picked(session: Session) -> None:
    session.show("object 1")
    session.mix_both(0.5, 0.5)
    session.lock("shape", True)
    shape, mix = session.code("shape"), session.state.mix
    edits = (
        lambda: session.show("object 2"),
        lambda: session.randomise("shape"),
        lambda: session.take("shape", "object 3"),
        lambda: session.take("texture", "object 3"),
        lambda: session.mix_both(0.9, 0.9),
        lambda: session.swap(),
        lambda: session.to_mean("shape"),
    )
    for edit in edits:
        edit()
        assert torch.equal(session.code("shape"), shape)
        assert (session.state.mix.a.shape, session.state.mix.shape) == (mix.a.shape, mix.shape)
    assert session.state.mix.texture == 0.9
    session.lock("shape", False)
    session.show("object 2")
    assert session.scene.codes == session.gallery["object 2"].codes


def test_the_sheet_crosses_shapes_with_textures(session: Session, tmp_path: Path) -> None:
    session.sheet.add("object 1", "object 2")
    session.sheet.add("object 2", "object 4")
    assert session.sheet.names == ("object 1", "object 2", "object 4")
    finish(session)
    assert all(session.sheet.picture(pair) for row in session.sheet.rows for pair in row)
    session.show_pair(session.sheet.rows[0][2])
    assert torch.equal(session.code("shape"), session.gallery["object 1"].codes.shape)
    assert torch.equal(session.code("texture"), session.gallery["object 4"].codes.texture)
    session.sheet.remove("object 2")
    assert [pair.texture for pair in session.sheet.rows[1]] == ["object 1", "object 4"]
    session.exporting.sheet(tmp_path / "sheet.png", size=16)
    finish(session)
    with Image.open(tmp_path / "sheet.png") as image:
        assert image.size == (32, 32)
    session.sheet.clear()
    session.exporting.sheet(tmp_path / "empty.png")
    assert not session.exporting.running
    session.sheet.add(*session.gallery.names, *(f"object {n}" for n in range(6)))
    assert len(session.sheet.names) == 6


def test_pairs_taken_off_the_sheet_are_drawn_no_more(session: Session) -> None:
    session.sheet.add("object 1", "object 2", "object 3")
    session.sheet.remove("object 2")
    drawn, frames = list[Codes](), session.streams.frames
    session.streams = replace(session.streams, frames=lambda model, job: drawn.append(job.codes) or frames(model, job))
    finish(session)
    assert all(session.sheet.picture(pair) for row in session.sheet.rows for pair in row)
    assert not any(torch.equal(codes.shape, session.gallery["object 2"].codes.shape) for codes in drawn[1:])


def test_objects_that_the_sheet_has_no_room_for_are_told(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("viewer.activities.grid.MOST", 2)
    session.sheet.add("object 1", "object 2")
    assert session.messages == []
    session.sheet.add("object 2", "object 3")
    assert session.sheet.names == ("object 1", "object 2")
    assert session.messages[-1].text == "A sheet holds 2 objects; there is no room for object 3"


def test_a_sheet_that_cannot_be_written_is_told(session: Session, tmp_path: Path) -> None:
    session.sheet.add("object 1")
    for name in ("sheet.xyz", "missing/sheet.png"):
        session.messages.clear()
        session.exporting.sheet(tmp_path / name, size=16)
        finish(session)
        assert len(session.errors) == 1, name
    assert list(tmp_path.iterdir()) == []


def test_a_code_is_pulled_back_straight_towards_the_mean(session: Session) -> None:
    session.show("object 2")
    name, away = session.nearest("shape") or ("", 1.0)
    assert (name, away) == ("object 2", pytest.approx(0, abs=1e-5))
    space, before, history = session.space("shape"), session.code("shape"), session.history
    for to in (0.9, 0.01, 0.5):
        session.pull("shape", to, gesture="pull shape")
        assert session.distance("shape") == pytest.approx(to, rel=1e-3)
    direction = torch.nn.functional.cosine_similarity(session.code("shape") - space.mean, before - space.mean, dim=0)
    assert float(direction) == pytest.approx(1, abs=1e-3)
    assert session.nearest("texture") == ("object 2", pytest.approx(0, abs=1e-5))
    session.undo()
    assert session.state == history.now
    session.to_mean("shape")
    session.pull("shape", 1.0)  # the mean has no direction
    assert session.distance("shape") == pytest.approx(0, abs=1e-5)


def test_the_nearest_objects_are_searched_for_once_per_code(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = list[str]()
    for part in PARTS:
        search = getattr(CodeBook, f"nearest_{part}")
        counted = lambda book, code, part=part, search=search: asked.append(part) or search(book, code)  # noqa: E731
        monkeypatch.setattr(CodeBook, f"nearest_{part}", counted)
    for _ in range(3):
        assert [session.nearest(part) for part in PARTS] == [("object 0", 0.0)] * 2
    assert asked == ["shape", "texture"]
    session.take("texture", "object 3")
    session.look(orbit.dragged(session.scene.camera, 0.2, 0.1))
    assert [session.nearest(part) for part in PARTS] == [("object 0", 0.0), ("object 3", 0.0)]
    assert asked == ["shape", "texture", "texture"]


def test_another_b_takes_over_what_is_mixed_in(session: Session) -> None:
    session.show("object 1")
    session.mix("texture", 1.0)
    session.pick_b("object 3")
    torch.testing.assert_close(session.code("texture"), session.gallery["object 3"].codes.texture)
    assert torch.equal(session.code("shape"), session.gallery["object 1"].codes.shape)


def test_a_fit_joins_the_objects_and_becomes_current(session: Session, model: Model, photo: Path) -> None:
    before = session.state
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    assert session.scene.codes == model.codes[3]
    assert session.scene.camera.azimuth == pytest.approx(1.0)
    assert session.scene.camera.width == model.image_size
    assert session.gallery.names[0] == "block"
    assert session.state.mix.a == ("block", "block")
    session.gallery.picture("block")
    finish(session)
    assert session.gallery.picture("block")
    assert session.fitting.course.picture is not None
    assert len(session.fitting.course.steps) == 10
    assert session.fitting.course.shot is not None
    assert session.fitting.course.difference is not None
    wrong = np.abs(session.fitting.course.shot.pixels.astype(int) - session.fitting.course.picture.image)
    np.testing.assert_array_equal(session.fitting.course.difference, (2 * wrong).clip(0, 255))
    assert session.fitting.camera == session.scene.camera
    assert session.fitting.course.progress == 1.0
    session.undo()
    assert session.state == before
    assert "block" in session.gallery.names


def test_a_second_fit_of_the_same_file_has_a_name_of_its_own(session: Session, photo: Path) -> None:
    for _ in range(2):
        session.fitting.start(photo)
        finish(session, lambda: not session.fitting.running)
    assert session.gallery.names[:2] == ["block (2)", "block"]


def test_a_fit_that_is_stopped_keeps_what_it_found(session: Session, photo: Path) -> None:
    session.streams = replace(session.streams, fit=endless_fit)
    session.fitting.start(photo)
    finish_when = lambda: len(session.fitting.course.steps) > 4  # noqa: E731
    while not finish_when():
        session.worker.deliver()
    session.fitting.start(photo)  # refused: one at a time
    assert session.fitting.running
    session.fitting.stop()
    finish(session)
    assert not session.fitting.running
    assert session.scene.codes == session.fitting.course.steps[-1].codes
    assert session.gallery.names[0] == "block"


def test_the_view_follows_a_fit_until_a_hand_changes_the_scene(session: Session, photo: Path) -> None:
    session.streams = replace(session.streams, fit=endless_fit)
    before = session.viewport.frame
    session.viewport.resize(300, 200)
    session.fitting.start(photo)
    deliver(session, lambda: session.fitting.course.picture is not None)
    assert session.fitting.followed
    assert session.viewport.frame is session.fitting.live
    assert session.viewport.frame is not before
    assert session.viewport.frame.resolution[0] > session.viewport.frame.resolution[1]
    assert session.fitting.course.picture.resolution == (session.viewport.frame.resolution[1],) * 2
    session.film.add_key()
    session.viewport.push(0.1, 0.0)
    assert session.fitting.followed
    assert not session.worker.busy("view")
    session.move_along("shape", 0, 1.0)
    assert not session.fitting.followed
    session.undo()
    assert session.fitting.followed
    session.fitting.stop()
    finish(session)
    assert not session.fitting.followed


def test_a_fit_that_fails_changes_nothing(session: Session, photo: Path) -> None:
    session.streams = replace(session.streams, fit=broken_fit)
    before, names = session.history, session.gallery.names
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    assert session.history is before
    assert session.gallery.names == names
    assert session.errors == ["Cannot fit this image: the loss is not finite"]


def test_any_step_is_looked_at_and_a_new_fit_forgets_it(session: Session, photo: Path) -> None:
    session.fitting.scrub(3)
    session.fitting.keep()
    session.fitting.go_on()
    session.fitting.turn_to(1)
    assert not session.fitting.running
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    past, fitting = len(session.history.past), session.fitting
    for index in (8, 3, -5, 99):
        fitting.scrub(index, gesture="scrub")
    session.settle()
    assert fitting.course.at == 9
    fitting.scrub(4)
    assert session.scene.codes == fitting.course.steps[4].codes
    assert fitting.camera.elevation == session.scene.camera.elevation == fitting.course.steps[4].cameras[0].elevation
    assert len(session.history.past) == past + 2
    finish(session)
    fitting.again()
    finish(session, lambda: not fitting.running)
    assert fitting.course.at is None
    assert len(fitting.race.tiles) == 4
    assert [tile.lost is None for tile in fitting.race.tiles] == [True, True, False, False]
    finish(session)
    assert all(tile.picture for tile in fitting.race.tiles)


def test_a_fit_that_fails_to_go_on_keeps_what_there_was(session: Session, photo: Path) -> None:
    session.fitting.start(photo)
    finish(session)
    course, tiles = session.fitting.course, session.fitting.race.tiles

    def failing(model: Model, job: FitJob) -> Iterator[FitStep]:
        raise ValueError("the fit diverged from every start")
        yield

    session.streams = replace(session.streams, fit=failing)
    session.fitting.go_on()
    finish(session, lambda: not session.fitting.running)
    assert session.fitting.course is course
    assert session.fitting.race.tiles is tiles
    assert session.errors == ["Cannot fit this image: the fit diverged from every start"]


def test_a_picture_that_is_cut_out_by_hand_must_be_one(session: Session, bad_files: dict[str, Path]) -> None:
    before = session.history
    for path in bad_files.values():
        session.messages.clear()
        session.cutting.open((Source(path),), 0)
        session.cutting.frame(Framing(0.8))
        finish(session)
        assert session.history is before
        assert session.errors or session.cutting.problem, path.name
        session.cutting.close()


def test_a_cut_out_is_shown_before_it_can_be_framed(worker: Worker, photo: Path) -> None:
    ready, tiny = threading.Event(), tiny_model()

    def preparing(model: Model) -> Iterator[None]:
        while not ready.is_set():
            yield None

    session = Session(worker, Streams(lambda name: tiny, frames=quick_frames, preparing=preparing), seed=0)
    session.open_model("chairs")
    deliver(session, lambda: session.ready)
    session.cutting.open((Source(photo),), 0)
    deliver(session, lambda: session.cutting.cut is not None)
    assert session.cutting.cut.framed is None
    ready.set()
    finish(session)
    assert session.cutting.cut.framed is not None


def test_files_that_are_no_pictures_are_told_and_change_nothing(
    session: Session, photo: Path, bad_files: dict[str, Path]
) -> None:
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    before, course = session.history, session.fitting.course
    for path in bad_files.values():
        session.messages.clear()
        session.fitting.start(path)
        finish(session, lambda: not session.fitting.running)
        assert session.history is before
        assert session.fitting.course is course
        assert [message.kind for message in session.messages] == [Kind.ERROR], path.name
        assert "Traceback" not in session.errors[0]


def test_what_was_made_stays_with_its_model(session: Session, photo: Path) -> None:
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    session.film.add_key()
    before = session.state
    session.open_model("other")
    finish(session)
    assert "block" not in session.gallery.names
    session.open_model("chairs")
    finish(session)
    assert session.gallery.names[0] == "block"
    assert session.state == before


def test_all_that_is_asked_for_while_another_model_loads_is_for_that(session: Session, photo: Path) -> None:
    session.open_model("other")
    scene = photo.with_name("a.json")
    session.scene.save(scene)
    session.load_scene(scene)
    session.fitting.start(photo)
    assert not session.fitting.running
    finish(session, lambda: session.opened == "other" and not session.fitting.running)
    finish(session)
    assert {"a", "block"} <= {*session.gallery.names}


def test_a_photo_chosen_for_a_fit_is_not_added_to_another(session: Session, photo: Path) -> None:
    session.fitting.start(photo)
    finish(session, lambda: not session.fitting.running)
    first = session.fitting.course
    session.fitting.start(photo)
    session.fitting.add(first, photo)
    assert "stop it first" in session.messages[-1].text
    finish(session, lambda: not session.fitting.running)
    assert len(session.fitting.course.sources) == 1
    session.fitting.add(first, photo)
    finish(session, lambda: not session.fitting.running)
    assert len(session.fitting.course.sources) == 2


def test_errors_stay_and_are_told_once(session: Session) -> None:
    for number in (1, 2, 2, 3, 4, 5, 6):
        session.say(f"wrong {number}", Kind.ERROR)
        session.say(f"news {number}")
    assert session.errors == [f"wrong {number}" for number in range(1, 7)]
    assert [one.text for one in session.messages if one.kind is Kind.INFO] == [f"news {n}" for n in (3, 4, 5, 6)]


def test_an_image_dropped_while_the_model_loads_is_fitted_then(worker: Worker, streams: Streams, photo: Path) -> None:
    session = Session(worker, streams)
    session.fitting.start(photo)
    session.open_model("chairs")
    finish(session, lambda: session.ready and not session.fitting.running)
    assert session.gallery.names[0] == "block"


def test_scenes_come_back_exactly(session: Session, tmp_path: Path) -> None:
    session.randomise("shape")
    session.look(orbit.dragged(session.scene.camera, 0.123, 0.05))
    scene = session.scene
    session.save_scene(tmp_path / "mine.json")
    session.show("object 5")
    session.load_scene(tmp_path / "mine.json")
    assert session.scene == scene
    assert session.gallery.names[0] == session.state.mix.a.shape == session.state.mix.a.texture == "mine"
    assert session.gallery.added[0].codes == scene.codes


def test_a_saved_picture_brings_its_scene_back_exactly(session: Session, tmp_path: Path) -> None:
    session.randomise("texture")
    session.look(orbit.dragged(session.scene.camera, 0.123, 0.05))
    scene = session.scene
    session.exporting.picture(tmp_path / "mine.png", size=24)
    session.show("object 5")
    finish(session)
    session.load_scene(tmp_path / "mine.png")
    assert session.scene == scene
    session.undo()
    assert session.scene.codes == session.gallery["object 5"].codes


def test_a_scene_dropped_while_the_model_loads_is_opened_then(session: Session, tmp_path: Path) -> None:
    session.randomise("shape")
    session.save_scene(tmp_path / "mine.json")
    other = Session(session.worker, session.streams)
    other.load_scene(tmp_path / "mine.json")
    other.open_model("chairs")
    finish(other)
    assert other.scene == session.scene


def test_scenes_that_cannot_be_opened_change_nothing(session: Session, tmp_path: Path) -> None:
    session.save_scene(tmp_path / "scene.json")
    about = json.loads((tmp_path / "scene.json").read_text())
    (tmp_path / "other.json").write_text(json.dumps(about | {"model": "0" * 16}))
    (tmp_path / "short.json").write_text(json.dumps(about | {"shape": [1.0]}))
    (tmp_path / "nan.json").write_text(json.dumps(about | {"shape": [float("nan")] * 8}))
    (tmp_path / "camera.json").write_text(json.dumps(about | {"camera": about["camera"] | {"distance": -1}}))
    (tmp_path / "list.json").write_text("[1, 2]")
    (tmp_path / "binary.json").write_bytes(bytes(range(256)))
    before = session.history
    for name in ("other", "short", "nan", "camera", "list", "binary", "missing"):
        session.messages.clear()
        session.load_scene(tmp_path / f"{name}.json")
        assert session.history is before, name
        assert len(session.errors) == 1, name
    session.save_scene(tmp_path / "no such folder" / "scene.json")
    assert session.errors[-1].startswith("Cannot save the scene")


def test_a_turntable_is_written_with_progress(session: Session, tmp_path: Path) -> None:
    seen: list[float] = []
    session.exporting.turntable(tmp_path / "turn.gif", 4, VideoChoice(size=16))
    finish(session, lambda: bool(seen.append(session.exporting.progress)) or not session.exporting.running)
    assert max(seen) == 1.0
    with Image.open(tmp_path / "turn.gif") as video:
        assert (video.n_frames, video.size) == (4, (16, 16))
    assert session.errors == []


def test_a_cancelled_turntable_leaves_no_file(session: Session, tmp_path: Path) -> None:
    session.exporting.turntable(tmp_path / "turn.mp4", 5000, VideoChoice(size=16))
    while session.exporting.progress == 0:
        session.worker.deliver()
    assert session.exporting.remaining > 0
    session.exporting.cancel()
    finish(session, lambda: not list(tmp_path.iterdir()))
    assert not session.exporting.running


@pytest.mark.parametrize("name", ["turn.avi", "turn", "missing/turn.mp4", "missing/turn.gif"])
def test_a_turntable_that_cannot_be_written_is_told(session: Session, tmp_path: Path, name: str) -> None:
    session.exporting.turntable(tmp_path / name, 2, VideoChoice(size=16))
    finish(session)
    assert len(session.errors) == 1
    assert not session.exporting.running


def test_a_mesh_that_cannot_be_made_is_told_and_leaves_nothing(session: Session, tmp_path: Path) -> None:
    for name in ("a.stl", "a", "missing/a.glb", "mist.glb"):  # the tiny model is a mist: it has no surface
        session.messages.clear()
        session.exporting.mesh(tmp_path / name, resolution=16)
        finish(session)
        assert len(session.errors) == 1, name
        assert not session.exporting.running
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["a.png", "a.jpg", "a.webp"])
def test_a_picture_is_saved_on_white(session: Session, tmp_path: Path, name: str) -> None:
    session.exporting.picture(tmp_path / name, size=48)
    finish(session)
    assert session.errors == []
    with Image.open(tmp_path / name) as image:
        assert image.size == (48, 48)
        assert min(image.convert("RGB").getpixel((0, 0))) > 250  # type: ignore[arg-type, type-var]
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("name", ["a.xyz", "missing/a.png"])
def test_a_picture_that_cannot_be_saved_is_told(session: Session, tmp_path: Path, name: str) -> None:
    session.exporting.picture(tmp_path / name, size=16)
    finish(session)
    assert len(session.errors) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told_and_leaves_nothing(
    session: Session, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", full)
    scene = session.scene
    session.exporting.picture(tmp_path / "a.png", size=16)
    finish(session)
    assert session.errors == [f"Cannot save the picture: cannot write {tmp_path / 'a.png'}: No space left on device"]
    assert list(tmp_path.iterdir()) == []
    assert session.scene == scene


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        torch.OutOfMemoryError("CUDA out of memory.\nTried to allocate 2 GiB"),
        RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes"),
    ],
)
def test_a_render_that_fails_is_told(session: Session, error: Exception) -> None:
    def broken(model: Model, job: object):
        raise error
        yield

    session.streams = replace(session.streams, frames=broken)
    session.randomise("shape")
    finish(session)
    assert session.errors == ["Cannot draw the object: not enough memory; try a smaller size"]


def test_the_same_seed_draws_the_same(worker: Worker, streams: Streams) -> None:
    drawn = []
    for _ in range(2):
        session = Session(worker, streams, seed=7)
        session.open_model("chairs")
        finish(session)
        for part in PARTS:
            session.randomise(part)
        drawn.append(session.scene.codes)
    assert drawn[0] == drawn[1]


def test_a_model_of_no_objects_still_opens(worker: Worker, streams: Streams, model: Model) -> None:
    empty = replace(model, codes=CodeBook(model.codes.shapes, model.codes.textures, ()))
    session = Session(worker, replace(streams, load_model=lambda name: empty))
    session.open_model("chairs")
    finish(session)
    assert session.gallery.names == ["mean"]
    assert session.scene.codes == empty.codes.mean
    assert session.nearest("shape") is None
