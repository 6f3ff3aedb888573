from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.progressive import Frame, RenderJob
from core.models.model import Instance
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import Bakery, quick_frames
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.values import orbit


@pytest.mark.parametrize(
    "error",
    [
        MemoryError(),
        torch.OutOfMemoryError("CUDA out of memory.\nTried to allocate 2 GiB"),
        RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory: you tried to allocate 9 bytes"),
    ],
)
def test_a_render_that_fails_is_reported(session: Session, editor: Editor, error: Exception) -> None:
    def broken(job: object):
        raise error
        yield

    session.jobs.backend = replace(session.jobs.backend, frames=broken)
    editor.sample()
    finish(session)
    assert session.messages.errors == ["Cannot render the object: not enough memory; try a smaller size"]


@pytest.fixture
def bakery(session: Session) -> Bakery:
    bake = Bakery()
    session.jobs.backend = replace(session.jobs.backend, bake=bake)
    return bake


def test_a_baked_object_is_turned_by_opengl_until_the_exact_picture_is_there(session: Session, bakery: Bakery) -> None:
    viewport = session.viewport
    editor = session.editor
    editor.set_camera(orbit.turned(editor.scene.camera, 0.2, 0.0))
    assert viewport.baked_frame is None
    viewport.change(opengl=True)
    finish(session, lambda: viewport.baked is not None and viewport.baked.cells == 128 and viewport.sharp)
    exact_frame = viewport.frame
    editor.set_camera(orbit.turned(editor.scene.camera, 0.2, 0.0))
    assert viewport.baked_frame.camera.azimuth == editor.scene.camera.azimuth
    assert (viewport.baked_frame.width, viewport.baked_frame.height) == viewport.settings.panel
    assert viewport.frame is exact_frame
    assert not viewport.sharp
    finish(session, lambda: viewport.baked_frame is None and viewport.sharp)
    assert viewport.frame.resolution == viewport.settings.panel  # none of fewer pixels came between
    viewport.pan_by(0.1, 0.0)
    assert viewport.baked_frame is not None
    viewport.change(opengl=False)
    assert viewport.baked_frame is None
    finish(session, lambda: viewport.sharp)
    assert bakery.baked == [editor.scene.instance]


def test_an_edit_of_the_object_is_rendered_and_bakes_it_again(session: Session, bakery: Bakery) -> None:
    viewport = session.viewport
    editor = session.editor
    viewport.change(opengl=True)
    finish(session, lambda: viewport.baked is not None)
    for _ in range(2):
        editor.sample()
        assert viewport.baked_frame is None
        assert viewport.baked is None
        finish(session, lambda: viewport.is_baked(editor.scene.instance))
        editor.set_camera(orbit.turned(editor.scene.camera, 0.2, 0.0))
        assert viewport.baked_frame is not None
    assert len(bakery.baked) == 3


def test_an_object_that_cannot_be_baked_is_reported_once(session: Session) -> None:
    def broken(instance: Instance) -> Iterator[None]:
        raise ValueError("no grid")
        yield

    session.jobs.backend = replace(session.jobs.backend, bake=broken)
    session.viewport.change(opengl=True)
    finish(session, lambda: bool(session.messages.errors))
    finish(session, lambda: session.viewport.sharp)
    session.editor.set_camera(orbit.turned(session.editor.scene.camera, 0.2, 0.0))
    finish(session, lambda: session.viewport.sharp)
    assert session.messages.errors == ["Cannot bake the object: no grid"]


def test_what_is_on_screen_is_not_sharp_once_the_scene_has_changed(session: Session, editor: Editor) -> None:
    finish(session, lambda: session.viewport.sharp)
    editor.sample()
    assert not session.viewport.sharp  # its render is still to come
    finish(session, lambda: session.viewport.sharp)


def test_an_unfinished_image_is_stored(worker: Worker, backend: Backend) -> None:
    def unfinished(job: RenderJob) -> Iterator[Frame | None]:
        yield replace(next(filter(None, quick_frames(job))), stage_count=2)
        while True:
            yield None

    session = Session(worker, replace(backend, frames=unfinished), 0)
    assert not session.viewport.picture()()
    session.start()
    deliver(session, lambda: session.viewport.frame is not None)
    (stored,) = session.viewport.picture()().values()
    np.testing.assert_array_equal(stored[..., :3], session.viewport.frame.image)
    session.close()
