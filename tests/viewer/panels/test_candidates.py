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


def test_candidates_are_shown_and_one_is_preferred(drive: Drive, backend: Backend, photo: Path, tmp_path: Path) -> None:
    def act(window: Driver) -> None:
        workspace, editor = window.workspace, window.workspace.editor
        fitting = workspace.fitting
        window.context.drop([str(photo)])
        window.wait(lambda: sum(tile.frame is not None for tile in fitting.candidates.tiles) == 4)
        assert fitting.running
        third = fitting.candidates.tiles[2].hypothesis
        window.drag("Candidates/cameras", 40, 10)
        window.ctx.mouse_move("//Candidates/**/candidate 2")
        window.click("Candidates/**/candidate 3")
        window.wait(lambda: fitting.running and fitting.candidates.tiles[0].hypothesis.start == third.start)
        assert fitting.candidates.tiles[0].hypothesis.cameras[0].azimuth == third.cameras[0].azimuth
        window.show("Objects")
        window.click("Fit/###stop fit")
        assert editor.scene.camera.azimuth == third.cameras[0].azimuth
        window.wait()
        assert window.exists("Objects/**/show block")
        window.show("Candidates")
        assert window.exists("Candidates/cameras")

    def held(model: Model, job: FitJob) -> Iterator[FitStep]:
        while True:
            for step in islice(quick_fit(model, job), 5):
                time.sleep(0.01)
                yield step

    drive(act, replace(backend, fit=held))
