import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from tests.viewer.driver import Drive, Driver
from tests.viewer.stand_ins import quick_fit
from viewer.services.backend import Backend


def test_candidates_are_shown_and_one_is_preferred(drive: Drive, backend: Backend, photo: Path) -> None:
    fits = [quick_fit]

    def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        """The first one ends; the later ones stay where four hypotheses are active."""
        if fits:
            yield from fits.pop()(model, job)
            return
        while True:
            for step in islice(quick_fit(model, job), 5):
                time.sleep(0.01)
                yield step

    def act(window: Driver) -> None:
        editor, fitting = window.session.editor, window.session.fitting
        window.fit(photo)
        assert [tile.frame is not None for tile in fitting.candidates.tiles] == [True] * 4
        window.context.drop([str(photo)])
        window.wait(lambda: len(fitting.candidates.tiles) == 4 and fitting.running)
        third = fitting.candidates.tiles[2].hypothesis
        window.show("Candidates")
        window.drag("Candidates/cameras", 40, 10)
        window.ctx.mouse_move("//Candidates/**/candidate 2")
        window.click("Candidates/**/candidate 3")
        window.wait(lambda: fitting.running and fitting.candidates.tiles[0].hypothesis.origin == third.origin)
        assert fitting.candidates.tiles[0].hypothesis.cameras[0].azimuth == third.cameras[0].azimuth
        window.show("Photo")
        window.click("Photo/###stop fit")
        assert editor.scene.camera.azimuth == third.cameras[0].azimuth
        window.wait()
        assert window.exists("Library/**/show block")
        window.show("Candidates")
        assert window.exists("Candidates/cameras")

    drive(act, replace(backend, fit=fit))
