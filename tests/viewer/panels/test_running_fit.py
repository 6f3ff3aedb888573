from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from imgui_bundle import imgui

from core.fitting.fit import FitJob, FitStep
from core.models.model import Model
from tests.viewer.driver import Drive, Driver
from tests.viewer.stand_ins import CheckedFit, endless_fit
from viewer.services.backend import Backend


def test_the_view_is_turned_around_a_growing_fit_and_follow_returns(
    drive: Drive, backend: Backend, photo: Path
) -> None:
    def act(window: Driver) -> None:
        fitting, viewport, editor = window.session.fitting, window.session.viewport, window.session.editor
        window.context.drop([str(photo)])
        window.wait(lambda: viewport.source == "fit")
        window.drag("View/orbit", 120)
        assert viewport.following
        assert viewport.turned
        assert viewport.source == "fit"
        assert editor.scene.camera.azimuth != pytest.approx(1.0, abs=0.1)
        window.ctx.yield_(3)
        window.click("Library/**/waits block.png")
        assert not viewport.turned
        window.wait(lambda: viewport.full_frame[1].camera.azimuth == pytest.approx(1.0))
        window.press(imgui.Key.r)  # another shape and texture
        assert viewport.source == "scene"
        window.click("Library/**/waits block.png")
        window.wait(lambda: viewport.source == "fit")
        fitting.stop()
        window.wait()
        assert editor.state.mix.a.shape == "block"

    drive(act, replace(backend, fit=endless_fit))


@pytest.mark.usefixtures("lasting_messages")
def test_a_finished_fit_waits_to_be_shown_while_another_object_is_edited(
    drive: Drive, backend: Backend, photo: Path
) -> None:
    second = photo.with_name("block two.png")
    second.write_bytes(photo.read_bytes())
    ends = iter((4, 5))

    def fit(model: Model, job: FitJob) -> Iterator[FitStep]:
        """The same codes at every step, others for each photo: to show one result is not to show the other."""
        codes = model.codes[next(ends)]
        yield from (replace(step, codes=codes) for step in endless_fit(model, job))

    def act(window: Driver) -> None:
        fitting, editor = window.session.fitting, window.session.editor
        window.context.drop([str(photo)])
        window.context.drop([str(second)])
        window.wait(lambda: bool(fitting.history.steps))
        window.press(imgui.Key.r)  # another shape and texture
        before = editor.state
        fitting.stop()
        window.wait(lambda: fitting.history.name == "block two" and len(fitting.history.steps) > 3)
        fitting.stop()
        window.wait()
        assert editor.state is before
        assert {one.name for one in editor.objects.added} == {"block", "block two"}
        assert set(fitting.results.unseen) == {"block", "block two"}
        last = len(window.session.messages.shown) - 1
        window.click(f"Messages/###show {last}")
        assert editor.state.mix.a.shape == "block two"
        assert set(fitting.results.unseen) == {"block"}
        window.undo()
        assert editor.state == before

    drive(act, replace(backend, fit=fit))


def test_the_first_result_is_used_while_a_second_search_checks_it(
    drive: Drive, backend: Backend, model: Model, photo: Path
) -> None:
    def act(window: Driver) -> None:
        fitting, editor = window.session.fitting, window.session.editor
        window.context.drop([str(photo)])
        window.wait(lambda: fitting.results.checking is not None)
        assert editor.scene.codes == model.codes[3]
        window.ctx.yield_(3)
        window.drag("View/orbit", 60)  # it can be used
        turned = editor.scene.camera
        fit.may_end.set()
        window.wait(lambda: not fitting.running)
        assert editor.scene.codes == model.codes[4]
        assert editor.scene.camera == turned
        assert any("checked from other sides" in message.text for message in window.session.messages.all)

    fit = CheckedFit()
    drive(act, replace(backend, fit=fit))
