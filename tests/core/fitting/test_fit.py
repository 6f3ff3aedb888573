import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch

from core.fitting.fit import PRESETS, FitJob, FitSettings, FitStep, fit
from core.fitting.hypotheses import Hypothesis
from core.fitting.schedule import LOCAL_HYPOTHESES, build_schedule
from core.fitting.settings import ALL_COMPONENTS
from core.metrics import psnr, rotation_error
from core.models.model import Instance, Model
from core.photos.photo import Photo
from core.rendering.reference import render_exact
from tests.conftest import random_model
from tests.core.fitting.inputs import QUICK, SHORT, seeded
from tests.core.tiny import photo_of

IMPOSSIBLE = ({"hypotheses": 0}, {"steps": 0}, {"max_restarts": -1}, {"samples": 1}, {"code_prior": -1.0})
unchecked = pytest.mark.usefixtures("unchecked")
"""For tests that repeat calls which other tests of this file check."""


def fit_to_end(
    model: Model, *photos: Photo, settings: FitSettings = QUICK, resume_from: Hypothesis | None = None
) -> FitStep:
    *_, step = fit(model, FitJob(photos, settings, resume_from=resume_from))
    return step


def without_detail(step: FitStep) -> Instance:
    """The codes alone, without the photo's outline, which cuts off the haze of a tiny model."""
    return step.instance.with_detail(None)


@pytest.fixture(scope="module")
def complete_fit(tiny: Model) -> list[FitStep]:
    """The steps of a complete fit."""
    return list(fit(tiny, FitJob((photo_of(tiny[0], tiny.camera(1.2, 0.3)),), QUICK)))


# Results


@unchecked
@pytest.mark.parametrize("index, azimuth, elevation", [(1, 2.9, 0.6), (3, 6.0, 1.35)])
def test_an_unknown_camera_and_the_codes_are_recovered(tiny: Model, index: int, azimuth: float, elevation: float):
    truth = tiny.camera(azimuth, elevation)
    photo = photo_of(tiny[index], truth)
    result = fit_to_end(tiny, photo)
    assert rotation_error(result.cameras[0], truth) < 10
    assert abs(result.cameras[0].distance / truth.distance - 1) < 0.03
    assert psnr(render_exact(without_detail(result), result.cameras[0], 48).colour, photo.pixels) > 30


@unchecked
def test_a_searched_focal_length_is_recovered(tiny: Model):
    usual = tiny.camera(3.2, 0.4)
    truth = replace(usual, focal=0.7 * usual.focal, distance=0.7 * usual.distance)
    photo = photo_of(tiny[2], truth)
    settings = replace(QUICK, rays=256, free_steps=0)  # free biases explain part of what a wrong focal length cannot
    usual_focal = fit_to_end(tiny, photo, settings=settings)
    searched_focal = fit_to_end(tiny, photo, settings=replace(settings, estimate_focal=True))
    assert usual_focal.cameras[0].focal == usual.focal
    assert searched_focal.cameras[0].focal == pytest.approx(truth.focal, rel=0.15)
    assert abs(searched_focal.cameras[0].distance / truth.distance - 1) < 0.15
    assert searched_focal.psnr > usual_focal.psnr + 3
    again = fit_to_end(tiny, photo, settings=replace(QUICK, steps=4), resume_from=searched_focal.hypotheses[0])
    assert again.cameras[0].focal == pytest.approx(searched_focal.cameras[0].focal)  # kept, not searched for


def test_every_unknown_camera_has_a_focal_length_of_its_own(tiny: Model):
    cameras = [tiny.camera(1.2, 0.3), tiny.camera(2.6, 0.5), tiny.camera(4.0, 0.4)]
    first, *further = (photo_of(tiny[1], camera) for camera in cameras)
    photos = replace(first, camera=cameras[0]), *further
    result = fit_to_end(tiny, *photos, settings=replace(SHORT, estimate_focal=True))
    assert result.cameras[0].focal == cameras[0].focal
    assert result.cameras[1].focal != result.cameras[2].focal


def test_a_known_camera_leaves_the_codes_to_search_and_has_no_confidence(tiny: Model):
    truth = tiny.camera(0.9, 0.5)
    instance = tiny[2]
    result = fit_to_end(tiny, replace(photo_of(instance, truth), camera=truth))
    assert rotation_error(result.cameras[0], truth) < 1e-3
    novel_camera = tiny.camera(3.9, 0.6)
    expected = render_exact(instance, novel_camera, 48).colour
    assert psnr(render_exact(without_detail(result), novel_camera, 48).colour, expected) > 25
    assert result.runner_up is result.confidence is None


@unchecked
@pytest.mark.parametrize("first_is_known", [False, True])
def test_cameras_of_two_views_are_recovered_and_a_known_one_is_kept(tiny: Model, first_is_known: bool):
    truths = [tiny.camera(1.2, 0.3), tiny.camera(3.9, 0.5)]
    first, second = (photo_of(tiny[1], truth) for truth in truths)
    result = fit_to_end(tiny, replace(first, camera=truths[0]) if first_is_known else first, second)
    assert rotation_error(result.cameras[0], truths[0]) < (1e-3 if first_is_known else 5)
    assert rotation_error(result.cameras[1], truths[1]) < 5
    assert result.instance.codes.shape.shape == tiny.codes[1].shape.shape


@unchecked
def test_the_optical_axis_of_a_moved_crop_is_recovered(tiny: Model):
    truth = tiny.camera(1.2, 0.4)
    photo = photo_of(tiny[0], truth)
    moved = Photo(photo.pixels.roll((2, -2), (0, 1)), photo.mask.roll((2, -2), (0, 1)), cropped=True)
    assert rotation_error(fit_to_end(tiny, moved).cameras[0], truth) < 5


# Search and resuming


def test_hypotheses_are_ranked_and_the_local_search_starts_around_the_leader(complete_fit: list[FitStep]):
    for step in complete_fit:
        losses = [hypothesis.loss for hypothesis in step.hypotheses]
        assert losses == sorted(losses)
        assert (step.hypotheses[0].origin, step.hypotheses[0].cameras) == (step.origin, step.cameras)
        assert torch.equal(step.hypotheses[0].instance.codes.shape, step.instance.codes.shape)
    assert len(complete_fit[0].hypotheses) == QUICK.hypotheses
    assert complete_fit[-1].runner_up is not None
    assert complete_fit[-1].hypotheses[1].cameras == complete_fit[-1].runner_up.cameras
    first = sum(stage.steps for stage in build_schedule(QUICK, ALL_COMPONENTS, unknown=True).coarse)
    before, after = complete_fit[first - 1 : first + 1]
    assert after.active == min(QUICK.hypotheses, LOCAL_HYPOTHESES) + 1
    origins, later_origins = ({hypothesis.origin for hypothesis in step.hypotheses} for step in (before, after))
    assert later_origins <= origins
    assert after.loss <= before.loss  # the winner of the coarse search waits until it is beaten
    assert before.hypotheses[0].cameras in [hypothesis.cameras for hypothesis in after.hypotheses]


@unchecked
def test_a_fit_resumes_from_a_hypothesis(tiny: Model):
    truth = tiny.camera(1.2, 0.3)
    photo = replace(photo_of(tiny[0], truth), cropped=True)
    early = next(fit(tiny, FitJob((photo,), QUICK)))
    begin = replace(early.hypotheses[0], origin=3)
    steps = list(fit(tiny, FitJob((photo,), replace(QUICK, steps=30), resume_from=begin)))
    assert {step.active for step in steps} == {1}
    assert rotation_error(steps[0].cameras[0], begin.cameras[0]) < 10
    assert steps[0].origin == begin.origin
    before, after = (
        psnr(render_exact(hypothesis.instance, hypothesis.cameras[0], 48).colour, photo.pixels)
        for hypothesis in (begin, steps[-1].hypotheses[0])
    )
    assert after > before + 3
    assert steps[-1].runner_up is not None
    assert steps[-1].confidence is None


@unchecked
def test_a_resumed_fit_keeps_its_viewpoint_even_if_the_opposite_is_better(tiny: Model):
    photo = photo_of(tiny[0], tiny.camera(1.2, 0.3))
    hypothesis = fit_to_end(tiny, photo, settings=SHORT).hypotheses[0]
    camera = hypothesis.cameras[0]
    wrong = replace(hypothesis, cameras=(replace(camera, azimuth=camera.azimuth + math.pi),))
    resumed = fit_to_end(tiny, photo, settings=replace(QUICK, steps=2), resume_from=wrong)
    assert rotation_error(resumed.cameras[0], wrong.cameras[0]) < 60


def test_a_resumed_fit_keeps_known_cameras_and_several_unknown_ones(tiny: Model):
    truths = [tiny.camera(1.2, 0.3), tiny.camera(3.9, 0.5), tiny.camera(2.4, 0.4)]
    photos = [photo_of(tiny[1], truth) for truth in truths]
    job = FitJob((replace(photos[0], camera=truths[0]), *photos[1:]), SHORT)
    *_, first = fit(tiny, job)
    *_, second = fit(tiny, replace(job, resume_from=first.hypotheses[0]))
    assert rotation_error(second.cameras[0], truths[0]) < 1e-3
    assert len(second.hypotheses[0].cameras) == 3
    with pytest.raises(ValueError, match="the photos that it had"):
        replace(job, photos=job.photos[:1], resume_from=first.hypotheses[0])
    *_, less = fit(tiny, replace(job, photos=job.photos[:2], resume_from=first.hypotheses[0].without([2])))
    assert len(less.cameras) == 2 and less.confidence is None


# Runner-up


def test_the_runner_up_is_a_distant_camera_of_higher_loss(tiny: Model, complete_fit: list[FitStep]):
    result = complete_fit[-1]
    assert rotation_error(result.cameras[0], tiny.camera(1.2, 0.3)) < 10
    assert result.margin is not None
    assert result.confidence is not None
    assert rotation_error(result.runner_up.cameras[0], result.cameras[0]) > 20
    assert 0 <= result.margin <= math.log(result.runner_up.loss / result.loss) + 1e-4
    assert result.margin > 0
    assert result.uncertainty is not None
    assert 0 < result.uncertainty < 30
    assert 0 <= result.confidence <= 1
    assert complete_fit[0].runner_up is complete_fit[0].confidence is complete_fit[0].uncertainty is None


# The stream


def test_steps_are_numbered_timed_finite_and_at_the_size_of_the_photo(tiny: Model):
    photo = photo_of(tiny[0], tiny.camera(0.4, 0.2).resized(24, 24))
    steps = list(fit(tiny, FitJob((photo,), SHORT)))
    assert [step.step for step in steps] == list(range(1, len(steps) + 1))
    assert {step.steps for step in steps} == {len(steps)}
    assert [step.seconds for step in steps] == sorted(step.seconds for step in steps)
    assert all(math.isfinite(step.loss) and math.isfinite(step.psnr) for step in steps)
    assert all((step.cameras[0].width, step.cameras[0].height) == (24, 24) for step in steps)
    assert not any(step.instance.codes.shape.requires_grad for step in steps)


@unchecked
def test_a_seed_determines_the_stream_and_the_model_is_unchanged(tiny: Model):
    photo = photo_of(tiny[1], tiny.camera(2.0, 0.6))

    def stream(seed: int) -> list[tuple]:
        steps = fit(tiny, FitJob((photo,), SHORT, seed))
        return [(step.loss, step.cameras, *step.instance.codes.shape.tolist()) for step in steps]

    def weights() -> bytes:
        tensors = [*tiny.field.state_dict().values(), tiny.codes.shapes, tiny.codes.textures]
        return b"".join(tensor.numpy().tobytes() for tensor in tensors)

    before = weights()
    assert stream(3) == stream(3) != stream(4)
    assert weights() == before
    assert not any(parameter.requires_grad for parameter in tiny.field.parameters())


@unchecked
@pytest.mark.parametrize("hypotheses, steps", [(1, 1), (1, 7), (2, 3), (3, 9), (40, 10)])
def test_any_number_of_hypotheses_and_steps_gives_a_runner_up(tiny: Model, hypotheses: int, steps: int):
    photo = photo_of(tiny[1], tiny.camera(2.0, 0.6))
    steps_of_fit = list(fit(tiny, FitJob((photo,), FitSettings(hypotheses, steps, rays=8, samples=4))))
    assert steps_of_fit[-1].step == steps_of_fit[-1].steps == len(steps_of_fit)
    assert steps_of_fit[-1].runner_up is not None


def test_a_model_that_paints_the_background_is_fitted():
    model = random_model(1, white_from_network=True)
    mask = torch.zeros(32, 32, dtype=torch.bool)
    mask[10:22, 8:20] = True
    pixels = torch.where(mask[..., None], torch.rand(32, 32, 3, generator=seeded()), torch.ones(3))
    result = fit_to_end(model, Photo(pixels, mask, model.camera(0.4, 0.3)), settings=SHORT)
    assert math.isfinite(result.psnr)


# Extreme input


@unchecked
def test_extreme_photos_have_finite_results(tiny: Model):
    everything = torch.ones(40, 40, dtype=torch.bool)
    dot = torch.zeros(40, 40, dtype=torch.bool)
    dot[0, 39] = True
    odd = [
        Photo(torch.zeros(40, 40, 3), everything),
        Photo(torch.ones(40, 40, 3), dot),
        Photo(torch.rand(9, 31, 3, generator=seeded()), torch.ones(9, 31, dtype=torch.bool)),
    ]
    for photo in odd:
        result = fit_to_end(tiny, photo, settings=SHORT)
        assert math.isfinite(result.loss)
        assert math.isfinite(result.cameras[0].distance)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: FitJob(()), "no photo"),
        *((lambda field=field: FitSettings(**field), "settings") for field in IMPOSSIBLE),
        (lambda: replace(PRESETS["paper"], hypotheses=2), "one hypothesis"),
        (lambda: replace(PRESETS["paper"], estimate_focal=True), "focal length"),
    ],
)
def test_impossible_jobs_are_refused(wrong: Callable[[], object], message: str):
    with pytest.raises(ValueError, match=message):
        wrong()


def test_a_photo_without_an_object_is_refused(tiny: Model):
    with pytest.raises(ValueError, match="shows no object"):
        fit_to_end(tiny, Photo(torch.ones(40, 40, 3), torch.zeros(40, 40, dtype=torch.bool)))


def test_a_model_of_nan_raises_one_clear_error():
    model = random_model()
    photo = photo_of(model[0], model.camera(0.3, 0.3))
    posed = replace(photo, mask=torch.ones_like(photo.mask), camera=model.camera(0.3, 0.3))
    model.field.density_layer.bias.fill_(math.nan)
    with pytest.raises(ValueError, match="diverged from every start"):
        fit_to_end(model, posed, settings=replace(SHORT, hypotheses=1))
