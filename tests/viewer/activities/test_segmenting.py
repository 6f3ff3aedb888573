import threading
from collections.abc import Iterator
from pathlib import Path

from core.models.model import Model
from core.photos.photo import Crop
from tests.core.tiny import tiny_model
from tests.viewer.driver import deliver, finish
from tests.viewer.stand_ins import quick_frames
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.values.fit_history import PhotoSource
from viewer.workspace import Workspace


def test_a_image_that_is_segmented_by_hand_must_be_one(
    session: Session, editor: Editor, workspace: Workspace, bad_files: dict[str, Path]
) -> None:
    before = editor.history
    for path in bad_files.values():
        session.messages.clear()
        workspace.segmenting.open((PhotoSource(path),), 0)
        workspace.segmenting.set_crop(Crop(0.8))
        finish(session)
        assert editor.history is before
        assert session.messages.errors or workspace.segmenting.problem, path.name
        workspace.segmenting.close()


def test_a_segmentation_is_shown_before_it_can_be_framed(worker: Worker, photo: Path) -> None:
    ready, tiny = threading.Event(), tiny_model()

    def view_bank(model: Model) -> Iterator[None]:
        while not ready.is_set():
            yield None

    session = Session(worker, Backend(lambda name: tiny, frames=quick_frames, view_bank=view_bank), seed=0)
    session.open_model("chairs")
    deliver(session, lambda: session.workspace is not None)
    assert session.workspace is not None
    segmenting = session.workspace.segmenting
    segmenting.open((PhotoSource(photo),), 0)
    deliver(session, lambda: segmenting.result is not None)
    assert segmenting.result is not None
    assert segmenting.result.cropped is None
    ready.set()
    finish(session)
    assert segmenting.result.cropped is not None
