from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from core.photos import candidates
from tests.core.tiny import tiny_model
from tests.viewer.driver import finish, fit
from tests.viewer.stand_ins import no_guess, quick_fit, quick_frames
from viewer.editor import Editor
from viewer.services.backend import Backend
from viewer.services.worker import Worker
from viewer.session import Session
from viewer.values.fit_history import PhotoSource


def test_a_damaged_image_is_reported_and_not_segmented(session: Session, editor: Editor, bad_files: dict[str, Path]):
    history = editor.history
    for path in bad_files.values():
        session.messages.all.clear()
        session.segmenting.open((PhotoSource(path),), 0)
        finish(session)
        assert editor.history is history
        assert session.messages.errors or session.segmenting.problem, path.name
        session.segmenting.close()


def test_a_photo_that_is_cut_out_is_fitted_at_once(worker: Worker, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    noise = np.random.default_rng(0).integers(60, 200, (160, 240, 3)).astype(np.uint8)
    noise[40:120, 60:120] = (30, 40, 220)
    Image.fromarray(noise).save(tmp_path / "street.png")
    mask = np.zeros((160, 240), np.float32)
    mask[40:120, 60:120] = 1.0
    candidate = candidates.Candidate("network", mask)
    monkeypatch.setattr(candidates, "network_candidate", lambda *_: candidate)
    tiny = tiny_model()
    backend = Backend(lambda name: tiny, frames=quick_frames, fit=quick_fit, guess_category=no_guess)
    session = Session(worker, backend, seed=0)
    fitting = session.fitting
    fit(session, tmp_path / "street.png")
    assert not session.segmenting.active
    assert session.editor.objects.own[0] == "street"
    assert fitting.history.photo.photo.cropped
