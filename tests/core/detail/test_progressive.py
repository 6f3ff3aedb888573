import pytest
from torch import Tensor

from core.detail.progressive import RenderJob, RenderSettings, render_progressively
from core.models.model import Model
from core.rendering.fast import clear_cache
from core.rendering.folded_field import FoldedField
from core.rendering.images import is_cached
from core.rendering.occupancy import shape_occupancy
from tests.conftest import random_model


def test_frames_come_coarse_to_fine(model: Model):
    job = RenderJob(model[0], model.camera(0.3, 0.2))
    frames = [frame for frame in render_progressively(job) if frame]
    assert [frame.resolution for frame in frames] == [(4, 4), (8, 8), (16, 16), (32, 32)]
    assert [frame.final for frame in frames] == [False, False, False, True]
    assert [frame.samples for frame in frames] == [64, 64, 64, 192]
    times = [frame.seconds for frame in frames]
    assert times == sorted(times)


def test_new_textures_are_rendered_at_full_size_and_last_stages_with_all_samples():
    model = random_model()
    camera = model.camera(0.3, 0.2)
    assert [frame.stage for frame in render_progressively(RenderJob(model[0], camera)) if frame] == [0, 1, 2, 3]
    textured = model[0].with_texture(model[1])
    (frame,) = [frame for frame in render_progressively(RenderJob(textured, camera)) if frame]
    assert frame.final
    assert frame.resolution == (32, 32)
    assert [frame.stage for frame in render_progressively(RenderJob(model[1], camera)) if frame] == [0, 1, 2, 3]
    model = random_model()
    job = RenderJob(model[0], model.camera(0.3, 0.2), RenderSettings(divisors=(2, 1, 1)))
    stages = [(frame.resolution, frame.samples) for frame in render_progressively(job) if frame]
    assert stages == [((16, 16), 64), ((32, 32), 64), ((32, 32), 192)]


def test_only_the_last_stage_computes_the_complete_occupancy_of_a_new_shape():
    clear_cache()
    model = random_model()
    for instance in (model[0], model[0].mixed(model[1], 0.02, 0)):
        stream = render_progressively(RenderJob(instance, model.camera(0.3, 0.2), RenderSettings(divisors=(1, 1))))
        frames = [next(frame for frame in stream if frame)]
        preview = shape_occupancy(instance, complete=False)
        frames += [frame for frame in stream if frame]
        finished = shape_occupancy(instance, complete=False)
        assert [frame.resolution for frame in frames] == [(32, 32), (32, 32)]
        assert (preview.complete, finished.complete) == (instance == model[0], True)


def test_an_abandoned_stream_does_no_more_work(monkeypatch: pytest.MonkeyPatch):
    evaluate = FoldedField.density
    calls = list[int]()

    def counted(folded: FoldedField, activations: Tensor) -> tuple[Tensor, Tensor]:
        calls.append(len(activations))
        return evaluate(folded, activations)

    monkeypatch.setattr(FoldedField, "density", counted)
    model = random_model()
    job = RenderJob(model[0], model.camera(0.3, 0.2))
    stream = render_progressively(job)
    while next(stream) is None:
        pass
    begun = len(calls)
    stream.close()
    assert len(calls) == begun
    assert next(stream, "over") == "over"
    assert not is_cached(job.instance, job.camera, job.settings.samples)
    list(render_progressively(job))
    assert len(calls) > begun


@pytest.mark.parametrize("settings", [{"samples": 1}, {"divisors": ()}, {"divisors": (0,)}, {"preview_samples": 1}])
def test_settings_that_render_nothing_are_refused(settings: dict):
    with pytest.raises(ValueError, match="at least 2 samples"):
        RenderSettings(**settings)
