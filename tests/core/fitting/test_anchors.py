"""Several photos with unknown cameras."""

from dataclasses import replace

import pytest
import torch

from core.classifiers.viewpoint import SIDES, Side
from core.fitting.anchors import Assignment, best_assignments
from core.fitting.fit import FitJob, FitStep, fit
from core.fitting.hypotheses import HypothesisBatch
from core.fitting.initial import initial_hypotheses
from core.fitting.problem import MOST_PHOTOS
from core.geometry.camera import Camera
from core.metrics import rotation_error
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.fitting.inputs import QUICK, SHORT, problem_of, seeded, standing
from tests.core.tiny import photo_of

pytestmark = pytest.mark.usefixtures("unchecked")  # test_fit fits several photos with checks
ANGLES = (1.2, 0.3), (3.9, 0.5), (5.4, 0.2)


def photos_of(model: Model, *numbers: int) -> tuple[list[Photo], list[Camera]]:
    """A photo of each of some objects, from different sides."""
    cameras = [model.camera(*angles) for angles in ANGLES[: len(numbers)]]
    return [photo_of(model[number], camera) for number, camera in zip(numbers, cameras, strict=True)], cameras


def last_step(model: Model, photos: list[Photo]) -> FitStep:
    *_, step = fit(model, FitJob(tuple(photos), QUICK))
    return step


def test_three_photos_find_each_other_and_each_has_a_confidence(tiny: Model):
    photos, cameras = photos_of(tiny, 1, 1, 1)
    step = last_step(tiny, photos)
    assert max(map(rotation_error, step.cameras, cameras)) < 5
    assert step.left_out == () and len(step.confidences) == 3
    assert step.instance.detail is not None and len(step.instance.detail.views) == 3
    assert all(confidence is not None and 0 <= confidence <= 1 for confidence in step.confidences)


def test_a_photo_of_another_object_is_left_out(tiny: Model):
    photos, cameras = photos_of(tiny, 1, 1, 2)
    step = last_step(tiny, photos)
    assert step.left_out == (2,) and step.confidences[2] is None
    assert max(map(rotation_error, step.cameras[:2], cameras)) < 10
    assert step.instance.detail is not None and len(step.instance.detail.views) == 2


def test_of_two_different_objects_the_first_is_fitted(tiny: Model):
    photos, cameras = photos_of(tiny, 1, 2)
    step = last_step(tiny, photos)
    assert step.left_out == (1,)
    assert rotation_error(step.cameras[0], cameras[0]) < 10


def test_a_photo_joins_an_object_without_a_search(tiny: Model):
    photos, cameras = photos_of(tiny, 1, 1, 1)
    posed = [replace(photo, camera=camera) for photo, camera in zip(photos[:2], cameras, strict=False)]
    first = last_step(tiny, posed)
    steps = list(fit(tiny, FitJob(tuple(photos), replace(QUICK, free_steps=0), resume_from=first.hypotheses[0])))
    assert max(map(rotation_error, steps[-1].cameras, cameras)) < 5
    assert steps[-1].left_out == () and steps[-1].confidences[2] is not None
    assert steps[0].cameras[:2] == first.cameras
    assert len(steps) == steps[0].steps


def test_a_known_camera_joins_an_object(tiny: Model):
    photos, cameras = photos_of(tiny, 1, 1)
    posed = [replace(photo, camera=camera) for photo, camera in zip(photos, cameras, strict=True)]
    first = last_step(tiny, posed[:1])
    *_, step = fit(tiny, FitJob((photos[0], posed[1]), SHORT, resume_from=first.hypotheses[0]))
    assert rotation_error(step.cameras[1], cameras[1]) < 1e-3 and rotation_error(step.cameras[0], cameras[0]) < 5


def test_the_best_different_assignments_count_photos_that_are_not_left_out(tiny: Model):
    photos, _ = photos_of(tiny, 1, 1)
    problem = problem_of(tiny, *photos)

    def assignment(anchor: int, azimuth: float, *losses: float) -> Assignment:
        parameters = standing(0.0, views=2)
        parameters = parameters._replace(angles=torch.tensor([azimuth, 0.5]).repeat(1, 2, 1))
        return Assignment(anchor, HypothesisBatch.of(parameters), torch.tensor(losses))

    assignments = [assignment(0, 0.0, 2.0, 2.0), assignment(1, 0.1, 1.0, 1.0), assignment(1, 2.0, 0.5, 9.0)]
    assert best_assignments(problem, assignments, 4).origin.tolist() == [1, 2]
    assert best_assignments(problem, assignments, 1).loss.tolist() == [2.0]
    assert best_assignments(problem.without(0), assignments, 4).loss.tolist() == [1.0, 9.0]


def test_a_photo_without_weight_changes_no_loss_and_its_camera_stays(tiny: Model):
    photos, _ = photos_of(tiny, 1, 1)
    problem = problem_of(tiny, *photos).without(1)
    assert problem.unknown.tolist() == [True, False] and problem.has_one_unknown
    assert not bool(problem.scoring.certainty[1].any()) and not bool(problem.scoring.weights[1].any())


@pytest.mark.parametrize("side", ["front", "left", "back", "right"])
def test_a_named_side_comes_first_among_the_starts(tiny: Model, side: Side):
    photo = replace(photo_of(tiny[1], tiny.camera(SIDES[side], 0.3)), side=side)
    batch = initial_hypotheses(problem_of(tiny, photo), 8, seeded())
    turn = batch.parameters.angles[0, 0, 0] - SIDES[side]
    assert float(turn.cos()) > 0.8


def test_more_than_a_dozen_photos_are_refused(tiny: Model):
    photo = photo_of(tiny[1], tiny.camera(1.0, 0.3))
    with pytest.raises(ValueError, match="at most 12 photos"):
        FitJob((photo,) * (MOST_PHOTOS + 1), SHORT)
