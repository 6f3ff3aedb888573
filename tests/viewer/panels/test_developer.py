import time
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice
from pathlib import Path

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from tests.viewer.driver import Drive, Driver, in_window
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
        window.fit(photo)
        window.context.drop([str(photo)])
        window.wait(lambda: window.fitting.running and bool(window.fitting.history.steps))
        third = window.fitting.history.last.hypotheses[2]
        window.show("Developer")
        window.click("Developer/**/candidate 3")
        window.wait(lambda: window.fitting.running and window.fitting.history.last.hypotheses[0].origin == third.origin)
        assert window.fitting.history.last.cameras[0].azimuth == third.cameras[0].azimuth
        window.show("Photo")
        window.click("Photo/###stop fit")
        assert window.editor.scene.camera.azimuth == third.cameras[0].azimuth
        window.wait()
        assert window.exists("Library/**/show block")
        window.show("Developer")
        assert window.exists("Developer/**/candidate 1")

    drive(act, replace(backend, fit=fit))


@in_window(fixture="real_backend")
def test_numbers_describe_the_frame_on_screen(window: Driver) -> None:
    window.show("Developer")
    window.click("Developer/##mode")
    window.click("**/Opacity")
    window.wait(lambda: window.session.viewport.frame.final and not window.session.jobs.busy("view"))
    assert window.session.messages.errors == []
