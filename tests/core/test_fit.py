import hashlib
import math
from dataclasses import replace
from statistics import median

import pytest
import torch

from core import fit as fitting
from core import plan
from core.camera import Camera
from core.codes import Codes
from core.fit import PRESETS, FitJob, FitSettings, FitStep, _Race, fit
from core.hypotheses import Numbers, Objective, Pool, joined, judged, rival_of
from core.metrics import distance_error, psnr, rotation_error
from core.model import Model
from core.photos import Photo
from core.rays import cast
from core.render import render_exact, render_rays
from core.targets import Target, draw
from tests.conftest import random_model
from tests.core.tiny import tiny_model

QUICK = FitSettings(starts=8, steps=60, rays=128, samples=24)
SHORT = FitSettings(starts=4, steps=8, rays=48, samples=12)


@pytest.fixture(scope="module")
def tiny() -> Model:
    return tiny_model()


def photo_of(model: Model, codes: Codes, camera: Camera) -> Photo:
    seen = render_exact(model, codes, camera, 64)
    return Photo(seen.colour.clamp(0, 1), seen.opacity > 0.5)


def last(model: Model, *photos: Photo, settings: FitSettings = QUICK, seed: int = 0) -> FitStep:
    return last_of(model, FitJob(photos, settings, seed))


def last_of(model: Model, job: FitJob) -> FitStep:
    *_, step = fit(model, job)
    return step


# What is found


@pytest.mark.parametrize(("pays", "sparing", "directions"), [(0.002, True, 2), (2.0, True, 1), (2.0, False, 2)])
def test_code_directions_are_opened_while_they_pay(
    tiny: Model, monkeypatch: pytest.MonkeyPatch, pays: float, sparing: bool, directions: int
):
    monkeypatch.setattr(plan, "_RANKS", (1, 2, 2, 2, 2, 2))
    monkeypatch.setattr(fitting, "_LEADING", 1)
    monkeypatch.setattr(fitting, "_PAYS", pays)
    photo = replace(photo_of(tiny, tiny.codes[2], tiny.camera(0.9, 0.5)), camera=tiny.camera(0.9, 0.5))
    found = last(tiny, photo, settings=replace(QUICK, sparing=sparing))
    assert found.directions == (directions, directions)


def test_directions_opened_for_single_pictures_are_told_of_all(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(plan, "_RANKS", (1, 2, 2, 1, 1, 1))
    photos = [photo_of(tiny, tiny.codes[2], tiny.camera(azimuth, 0.5)) for azimuth in (0.9, 2.5)]
    steps = list(fit(tiny, FitJob(tuple(photos), SHORT)))
    first = [stage.anew for stage in plan.plan(SHORT, blind=True)].index(True)  # where each stage is one step
    together = [step.directions for step in steps[2 * first : 3 * first]]
    assert set(together) == {(2, 2)}


def test_a_second_heat_begins_anew_around_the_best_cameras(tiny: Model):
    steps = list(fit(tiny, FitJob((photo_of(tiny, tiny.codes[2], tiny.camera(0.9, 0.5)),), QUICK)))
    stages = plan.plan(QUICK, blind=True)
    heat = [stage.anew for stage in stages].index(True)
    first = sum(stage.steps for stage in stages[:heat])
    before, after = steps[first - 1], steps[first]
    assert after.hypotheses == min(QUICK.starts, plan.RENEWED) + 1
    assert {one.start for one in after.race} <= {one.start for one in before.race}
    assert after.loss <= before.loss  # the winner of the first heat waits until it is beaten
    assert before.race[0].cameras in [one.cameras for one in after.race]


def test_a_sparing_fit_is_as_good_as_a_lavish_one_in_fewer_steps(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(plan, "_RANKS", (1, 1, 2, 2, 2, 2))
    monkeypatch.setattr(fitting, "_LEADING", 1)
    steps = 0
    for index in range(4):
        camera = tiny.camera(0.9 + index, 0.5)  # given: a race of so small a model is decided by chance
        photo = replace(photo_of(tiny, tiny.codes[index], camera), camera=camera)
        spared, lavish = (last(tiny, photo, settings=replace(QUICK, sparing=one), seed=1) for one in (True, False))
        assert spared.psnr > lavish.psnr - 0.1
        steps += lavish.step - spared.step
    assert steps > 0


@pytest.mark.parametrize("index, azimuth, elevation", [(0, 1.2, 0.3), (1, 2.9, 0.6), (2, 4.5, 0.2), (3, 6.0, 1.35)])
def test_an_unknown_camera_and_the_codes_are_found(tiny: Model, index: int, azimuth: float, elevation: float):
    truth = tiny.camera(azimuth, elevation)
    photo = photo_of(tiny, tiny.codes[index], truth)
    found = last(tiny, photo)
    assert rotation_error(found.cameras[0], truth) < 10
    assert distance_error(found.cameras[0], truth) < 0.03
    assert psnr(render_exact(tiny, found.codes, found.cameras[0], 48).colour, photo.pixels) > 30


def test_another_lens_is_found_where_it_is_searched_for(tiny: Model):
    usual = tiny.camera(3.2, 0.4)
    truth = replace(usual, focal=0.7 * usual.focal, distance=0.7 * usual.distance)
    photo = photo_of(tiny, tiny.codes[2], truth)
    taken, found = (last(tiny, photo, settings=replace(QUICK, rays=256, lens=lens)) for lens in (False, True))
    assert taken.cameras[0].focal == usual.focal
    assert found.cameras[0].focal == pytest.approx(truth.focal, rel=0.15)
    assert distance_error(found.cameras[0], truth) < 0.15
    assert found.psnr > taken.psnr + 3
    race = found.race[0]
    again = last_of(tiny, FitJob((photo,), replace(QUICK, steps=4), begin=race))
    assert again.cameras[0].focal == pytest.approx(found.cameras[0].focal)  # kept, not searched for


def test_every_unknown_camera_has_a_lens_of_its_own(tiny: Model):
    cameras = [tiny.camera(1.2, 0.3), tiny.camera(2.6, 0.5), tiny.camera(4.0, 0.4)]
    known, *others = (photo_of(tiny, tiny.codes[1], camera) for camera in cameras)
    photos = replace(known, camera=cameras[0]), *others
    found = last(tiny, *photos, settings=replace(SHORT, lens=True))
    assert found.cameras[0].focal == cameras[0].focal
    assert found.cameras[1].focal != found.cameras[2].focal


def test_with_a_known_camera_the_codes_are_found(tiny: Model):
    truth, codes = tiny.camera(0.9, 0.5), tiny.codes[2]
    found = last(tiny, replace(photo_of(tiny, codes, truth), camera=truth))
    assert rotation_error(found.cameras[0], truth) < 1e-3
    other = tiny.camera(3.9, 0.6)
    expected = render_exact(tiny, codes, other, 48).colour
    assert psnr(render_exact(tiny, found.codes, other, 48).colour, expected) > 25


def test_where_cameras_are_known_shapes_race(tiny: Model):
    cameras = [tiny.camera(0.9, 0.5), tiny.camera(2.9, 0.3)]
    photos = [replace(photo_of(tiny, tiny.codes[2], camera), camera=camera) for camera in cameras]
    race = _Race.of(tiny, FitJob(tuple(photos), QUICK))
    pool = race.entered()
    ranked = replace(pool, cost=torch.arange(len(pool), dtype=torch.float32))
    cut = race.cut(ranked, race.plan[1]._replace(hypotheses=2))
    assert cut.start.tolist() == [0, 1]
    first, *_, end = fit(tiny, FitJob(tuple(photos), QUICK))
    assert (first.hypotheses, end.hypotheses) == (len(pool), 1)


def test_several_unknown_cameras_and_one_pair_of_codes_are_found(tiny: Model):
    truths = [tiny.camera(1.2, 0.3), tiny.camera(3.9, 0.5)]
    found = last(tiny, *(photo_of(tiny, tiny.codes[1], truth) for truth in truths))
    assert max(map(rotation_error, found.cameras, truths)) < 5
    assert found.codes.shape.shape == tiny.codes[1].shape.shape


def test_a_known_view_helps_an_unknown_one_and_stays_where_it_is(tiny: Model):
    truths = [tiny.camera(1.2, 0.3), tiny.camera(3.9, 0.5)]
    first, second = (photo_of(tiny, tiny.codes[1], truth) for truth in truths)
    found = last(tiny, replace(first, camera=truths[0]), second)
    assert rotation_error(found.cameras[0], truths[0]) < 1e-3
    assert rotation_error(found.cameras[1], truths[1]) < 5


def test_a_reframed_picture_has_its_middle_found_too(tiny: Model):
    truth = tiny.camera(1.2, 0.4)
    photo = photo_of(tiny, tiny.codes[0], truth)
    moved = Photo(photo.pixels.roll((2, -2), (0, 1)), photo.mask.roll((2, -2), (0, 1)), framed=True)
    assert rotation_error(last(tiny, moved).cameras[0], truth) < 5


def test_the_last_step_is_measured_and_better_than_the_first_ones(tiny: Model):
    steps = list(fit(tiny, FitJob((photo_of(tiny, tiny.codes[3], tiny.camera(0.4, 0.2)),), QUICK)))
    assert steps[-1].psnr > median(step.psnr for step in steps[: QUICK.steps // 2])
    assert steps[-1].loss < median(step.loss for step in steps[: QUICK.steps // 2])


# The race, and going on


def test_the_race_is_told_the_leader_first(tiny: Model):
    steps = list(fit(tiny, FitJob((photo_of(tiny, tiny.codes[0], tiny.camera(1.2, 0.3)),), QUICK)))
    for step in steps:
        assert [one.loss for one in step.race] == sorted(one.loss for one in step.race)
        assert (step.race[0].start, step.race[0].cameras) == (step.start, step.cameras)
        assert torch.equal(step.race[0].codes.shape, step.codes.shape)
    assert len(steps[0].race) == QUICK.starts
    assert steps[-1].alternative is not None
    assert steps[-1].race[1].cameras == steps[-1].alternative.cameras


def test_a_fit_goes_on_where_another_ended(tiny: Model):
    truth = tiny.camera(1.2, 0.3)
    photo = replace(photo_of(tiny, tiny.codes[0], truth), framed=True)
    begin = replace(last(tiny, photo, settings=SHORT).race[0], start=3)
    steps = list(fit(tiny, FitJob((photo,), replace(QUICK, steps=30), begin=begin)))
    assert {step.hypotheses for step in steps} == {1}
    assert rotation_error(steps[0].cameras[0], begin.cameras[0]) < 10
    assert steps[0].start == begin.start
    assert steps[-1].psnr > last(tiny, photo, settings=SHORT).psnr
    assert steps[-1].alternative is not None
    assert steps[-1].confidence is None


def test_a_fit_that_goes_on_keeps_known_cameras_and_several_unknown_ones(tiny: Model):
    truths = [tiny.camera(1.2, 0.3), tiny.camera(3.9, 0.5), tiny.camera(2.4, 0.4)]
    photos = [photo_of(tiny, tiny.codes[1], truth) for truth in truths]
    job = FitJob((replace(photos[0], camera=truths[0]), *photos[1:]), SHORT)
    *_, first = fit(tiny, job)
    *_, second = fit(tiny, replace(job, begin=first.race[0]))
    assert rotation_error(second.cameras[0], truths[0]) < 1e-3
    assert len(second.race[0].cameras) == 3
    with pytest.raises(ValueError, match="the pictures it had"):
        replace(job, photos=job.photos[:1], begin=first.race[0])


# What else it could be


def test_the_alternative_is_another_camera_that_is_measured_too(tiny: Model):
    truth = tiny.camera(1.2, 0.3)
    steps = list(fit(tiny, FitJob((photo_of(tiny, tiny.codes[0], truth),), QUICK)))
    found = steps[-1]
    assert found.alternative is not None
    assert found.margin is not None
    assert found.confidence is not None
    assert rotation_error(found.alternative.cameras[0], found.cameras[0]) > 20
    assert 0 <= found.margin <= math.log(found.alternative.loss / found.loss) + 1e-4
    assert found.margin > 0
    assert found.spread is not None
    assert 0 < found.spread < 30
    assert 0 <= found.confidence <= 1
    assert steps[0].alternative is steps[0].confidence is steps[0].spread is None


@pytest.mark.parametrize("starts, steps", [(1, 1), (1, 7), (2, 3), (8, 9)])
def test_there_is_an_alternative_however_short_the_race(tiny: Model, starts: int, steps: int):
    photo = photo_of(tiny, tiny.codes[1], tiny.camera(2.0, 0.6))
    found = last(tiny, photo, settings=FitSettings(starts, steps, rays=8, samples=4))
    assert found.alternative is not None


@pytest.mark.parametrize(("close", "going"), [(math.inf, 2), (-math.inf, 1)])
def test_a_rival_goes_on_to_the_end_where_it_is_close_behind(
    tiny: Model, monkeypatch: pytest.MonkeyPatch, close: float, going: int
):
    monkeypatch.setattr(fitting, "_CLOSE", close)
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3))
    *_, before, end = fit(tiny, FitJob((photo,), SHORT))
    assert (before.hypotheses, end.hypotheses) == (going, 1)
    assert end.alternative is not None
    assert end.margin is not None
    assert end.margin >= 0
    again = list(fit(tiny, FitJob((photo,), SHORT, begin=end.race[0])))
    assert {step.hypotheses for step in again} == {1}  # whoever goes on with one camera means that one


@pytest.mark.parametrize("steps", [1, 8, 30])
@pytest.mark.parametrize("sparing", [True, False])
def test_the_last_stage_tells_the_best_that_was_measured(tiny: Model, steps: int, sparing: bool):
    camera = tiny.camera(0.9, 0.3)
    settings = replace(SHORT, steps=steps, sparing=sparing)
    alone = plan.plan(settings, blind=False)[-1].steps
    found = list(fit(tiny, FitJob((replace(photo_of(tiny, tiny.codes[0], camera), camera=camera),), settings)))
    ending = [step.loss for step in found if step.step > found[0].steps - alone]
    assert ending == sorted(ending, reverse=True)
    assert sparing or found[-1].step == found[-1].steps


def test_a_known_camera_has_no_alternative(tiny: Model):
    truth = tiny.camera(0.9, 0.5)
    found = last(tiny, replace(photo_of(tiny, tiny.codes[2], truth), camera=truth), settings=SHORT)
    assert found.alternative is found.confidence is None


def test_a_rival_is_the_best_of_another_basin_or_the_twin(tiny: Model):
    pool, views = Pool.of(_numbers(tiny, 3)), torch.tensor([True])
    pool.numbers.angles[:, 0] = torch.tensor([[0.0, 0.2], [0.1, 0.2], [2.0, 0.2]])
    pool = replace(pool, cost=torch.tensor([1.0, 2.0, 3.0]))
    assert rival_of(pool, pool, views).start.tolist() == [2]
    near = pool[torch.tensor([0, 1])]
    assert float(rival_of(near, near, views).numbers.angles[0, 0, 0]) == pytest.approx(math.pi)
    lost = replace(pool, cost=torch.tensor([1.0, 2.0, math.inf]))
    assert rival_of(lost, joined(lost, lost), views).start.tolist() == [0]


# The paper's recipe

PAPER = replace(PRESETS["paper"], steps=120, rays=96, samples=20)


def test_the_paper_starts_once_anywhere_with_the_mean_codes(tiny: Model):
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.4, 0.2))
    starts = [next(fit(tiny, FitJob((photo,), PAPER, seed))) for seed in range(12)]
    assert {step.hypotheses for step in starts} == {1}
    assert all(step.cameras[0].elevation > -0.11 for step in starts)
    assert len({round(step.cameras[0].azimuth) for step in starts}) > 3
    # AdamW's first step is its rate, whatever the slope.
    moved = (starts[0].codes.shape - tiny.codes.mean.shape).abs()
    torch.testing.assert_close(moved, torch.full_like(moved, 0.01), rtol=0.05, atol=1e-4)


def test_the_paper_finds_the_camera_from_some_starts_and_halves_its_rates(tiny: Model):
    truth = tiny.camera(1.2, 0.3)
    photo = photo_of(tiny, tiny.codes[0], truth)
    streams = [list(fit(tiny, FitJob((photo,), PAPER, seed))) for seed in range(3)]
    assert min(rotation_error(steps[-1].cameras[0], truth) for steps in streams) < 15
    first, late = (
        abs(steps[i].cameras[0].azimuth - steps[i - 1].cameras[0].azimuth) for i in (2, 110) for steps in streams[:1]
    )
    assert late < first
    assert all(len(steps) == PAPER.steps for steps in streams)


def test_the_paper_with_known_and_with_several_cameras(tiny: Model):
    truths = [tiny.camera(1.2, 0.3), tiny.camera(3.9, 0.5)]
    first, second = (photo_of(tiny, tiny.codes[1], truth) for truth in truths)
    found = last(tiny, replace(first, camera=truths[0]), second, settings=replace(PAPER, steps=12))
    assert found.confidence is None
    assert rotation_error(found.cameras[0], truths[0]) < 1e-3
    known = last(tiny, replace(first, camera=truths[0]), settings=PAPER)
    assert known.psnr > 25


def test_the_paper_has_one_start():
    with pytest.raises(ValueError, match="one start"):
        FitSettings(paper=True)


# The stream


def test_steps_are_numbered_timed_finite_and_at_the_size_of_the_picture(tiny: Model):
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.4, 0.2).resized(24, 24))
    steps = list(fit(tiny, FitJob((photo,), SHORT)))
    assert [step.step for step in steps] == list(range(1, len(steps) + 1))
    assert {step.steps for step in steps} == {len(steps)}
    assert [step.seconds for step in steps] == sorted(step.seconds for step in steps)
    assert all(math.isfinite(step.loss) and math.isfinite(step.psnr) for step in steps)
    assert all((step.cameras[0].width, step.cameras[0].height) == (24, 24) for step in steps)
    assert not any(step.codes.shape.requires_grad for step in steps)


def test_the_same_seed_gives_the_same_stream_and_another_seed_another(tiny: Model):
    photo = photo_of(tiny, tiny.codes[1], tiny.camera(2.0, 0.6))

    def stream(seed: int) -> list[tuple]:
        steps = fit(tiny, FitJob((photo,), SHORT, seed))
        return [(step.loss, step.cameras, *step.codes.shape.tolist()) for step in steps]

    assert stream(3) == stream(3) != stream(4)


def test_fitting_leaves_the_model_as_it_is(tiny: Model):
    def digest() -> str:
        tensors = [*tiny.field.state_dict().values(), tiny.codes.shapes, tiny.codes.textures]
        return hashlib.sha256(b"".join(tensor.numpy().tobytes() for tensor in tensors)).hexdigest()

    before = digest()
    last(tiny, photo_of(tiny, tiny.codes[1], tiny.camera(2.0, 0.6)), settings=SHORT)
    assert digest() == before
    assert not any(parameter.requires_grad for parameter in tiny.field.parameters())


@pytest.mark.parametrize("starts, steps", [(1, 1), (1, 7), (2, 3), (3, 9), (40, 10)])
def test_any_number_of_starts_and_steps_ends(tiny: Model, starts: int, steps: int):
    photo = photo_of(tiny, tiny.codes[1], tiny.camera(2.0, 0.6))
    found = list(fit(tiny, FitJob((photo,), FitSettings(starts, steps, rays=8, samples=4))))
    assert found[-1].step == found[-1].steps == len(found)


@pytest.mark.parametrize("painted", [False, True])
def test_a_model_that_paints_its_ground_and_one_that_does_not(painted: bool):
    model = random_model(1, painted)
    generator = torch.Generator().manual_seed(0)
    mask = torch.zeros(32, 32, dtype=torch.bool)
    mask[10:22, 8:20] = True
    pixels = torch.where(mask[..., None], torch.rand(32, 32, 3, generator=generator), torch.ones(3))
    try:
        found = last(model, Photo(pixels, mask), settings=SHORT)
    except ValueError as error:
        assert "no objects" in str(error)
    else:
        assert math.isfinite(found.psnr)


# Pictures that show nothing the model knows


def test_odd_pictures_stay_finite(tiny: Model):
    generator = torch.Generator().manual_seed(0)
    everything = torch.ones(40, 40, dtype=torch.bool)
    dot = torch.zeros(40, 40, dtype=torch.bool)
    dot[0, 39] = True
    odd = [
        Photo(torch.zeros(40, 40, 3), everything),
        Photo(torch.rand(40, 40, 3, generator=generator), everything),
        Photo(torch.rand(40, 40, 3, generator=generator), torch.rand(40, 40, generator=generator) > 0.5),
        Photo(torch.ones(40, 40, 3), dot),
        Photo(torch.rand(9, 31, 3, generator=generator), torch.ones(9, 31, dtype=torch.bool)),
    ]
    for photo in odd:
        found = last(tiny, photo, settings=SHORT)
        assert math.isfinite(found.loss)
        assert math.isfinite(found.cameras[0].distance)


def test_no_start_and_no_picture_ends_worse_than_it_began(tiny: Model):
    for seed in range(10):
        ends_well(tiny, seed)


@pytest.mark.slow
def test_a_thousand_starts_and_pictures_end_no_worse_than_they_began(tiny: Model):
    for seed in range(1000):
        ends_well(tiny, seed)


def ends_well(model: Model, seed: int) -> None:
    """A picture of anything from starts anywhere: each step finite, the end no worse than the start it came from."""
    generator = torch.Generator().manual_seed(seed)

    def drawn(*size: int) -> torch.Tensor:
        return torch.rand(size, generator=generator)

    height, width = (int(side) for side in 8 + 40 * drawn(2))
    mask = drawn(height, width) > drawn(1)
    mask[height // 2, width // 2] = True
    pixels = torch.where(mask[..., None], drawn(height, width, 3), torch.ones(3))
    photo = Photo(pixels, mask, framed=seed % 2 == 0)
    race = _Race.of(model, FitJob((photo,), FitSettings(starts=4, steps=9, rays=48, samples=12), seed))
    pool = Pool.of(
        Numbers(
            (drawn(4, 1, 2) - 0.5) * torch.tensor([2 * math.pi, math.pi]),
            3 * drawn(4, 1) - 1.5,
            drawn(4, 1) - 0.5,
            0.4 * drawn(4, 1, 2) - 0.2,
            8 * drawn(4, 2) - 4,
            8 * drawn(4, 2) - 4,
        )
    )
    standings = list(race.run(pool))
    assert len(standings) == race.steps
    steps = [race.reported(standing, number, race.steps, 0.0) for number, standing in enumerate(standings)]
    assert all(math.isfinite(step.loss) and math.isfinite(step.psnr) for step in steps)
    assert all(bool(part.isfinite().all()) for standing in standings for part in standing.pool.numbers)
    began = race.measured(pool[torch.tensor([steps[-1].start])])
    assert steps[-1].loss <= float(began.cost) + 1e-6


def test_a_picture_without_an_object_is_refused(tiny: Model):
    with pytest.raises(ValueError, match="shows no object"):
        last(tiny, Photo(torch.ones(40, 40, 3), torch.zeros(40, 40, dtype=torch.bool)))


def test_a_job_without_pictures_is_refused():
    with pytest.raises(ValueError, match="no picture"):
        FitJob(())


@pytest.mark.parametrize("field, value", [("starts", 0), ("steps", 0), ("samples", 1), ("prior", -1.0)])
def test_impossible_settings_are_refused(field: str, value: float):
    with pytest.raises(ValueError, match="settings"):
        FitSettings(**{field: value})


def test_a_model_gone_wrong_ends_in_one_clear_error():
    model = random_model()
    photo = photo_of(model, model.codes[0], model.camera(0.3, 0.3))
    known = replace(photo, mask=torch.ones_like(photo.mask), camera=model.camera(0.3, 0.3))
    model.field.density_layer.bias.fill_(math.nan)
    with pytest.raises(ValueError, match="diverged from every start"):
        last(model, known, settings=replace(SHORT, starts=1))


def test_a_hypothesis_that_diverged_is_dropped_and_the_others_are_as_without_it(tiny: Model):
    pool = Pool.of(_numbers(tiny, 3))
    assert pool[torch.tensor([2, 0])].start.tolist() == [2, 0]
    costs = replace(pool, cost=torch.tensor([3.0, math.inf, 2.0]))
    assert costs.leader == 2
    with pytest.raises(ValueError, match="diverged"):
        _ = replace(pool, cost=torch.full((3,), math.inf)).leader


# Gradients


def _numbers(model: Model, count: int) -> Numbers:
    generator = torch.Generator().manual_seed(0)
    return Numbers(
        torch.rand(count, 1, 2, generator=generator),
        0.1 * torch.randn(count, 1, generator=generator),
        torch.zeros(count, 1),
        torch.zeros(count, 1, 2),
        torch.randn(count, 2, generator=generator),
        torch.randn(count, 2, generator=generator),
    )


def test_hypotheses_in_a_batch_are_judged_as_alone(tiny: Model):
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.5, 0.5))
    drawn = draw([Target.of(photo, tiny)], 64, torch.Generator().manual_seed(0))
    numbers = _numbers(tiny, 3)
    together = judged(tiny, numbers, drawn, 16, Objective(1e-4)).objective
    for index in range(3):
        one = Numbers(*(part[index : index + 1] for part in numbers))
        alone = judged(tiny, one, drawn, 16, Objective(1e-4)).objective
        torch.testing.assert_close(alone[0], together[index], atol=1e-3, rtol=1e-2)  # bfloat16, in another order


def test_the_true_hypothesis_is_the_best(tiny: Model):
    truth = tiny.camera(0.5, 0.5)
    drawn = draw([Target.of(photo_of(tiny, tiny.codes[0], truth), tiny)], 256, torch.Generator().manual_seed(0))
    numbers = _numbers(tiny, 4)
    numbers.angles[1, 0] = torch.tensor([truth.azimuth, truth.elevation])
    numbers.distance[1] = 0
    numbers.shape[1] = tiny.codes.shape_space.coordinates(tiny.codes[0].shape)
    numbers.texture[1] = tiny.codes.texture_space.coordinates(tiny.codes[0].texture)
    assert int(judged(tiny, numbers, drawn, 32, Objective(0.0)).objective.argmin()) == 1


@pytest.mark.parametrize("name", ["azimuth", "elevation", "distance", "shape", "texture"])
def test_gradients_of_rendered_rays_against_finite_differences(name: str, monkeypatch: pytest.MonkeyPatch):
    # Under autocast the field returns to float32 so; here it would throw away the digits that the differences need.
    monkeypatch.setattr(torch.Tensor, "float", torch.Tensor.double)
    model = random_model(2)
    field = model.field.double()
    generator = torch.Generator().manual_seed(1)
    pixels = 12 + 8 * torch.rand(6, 2, generator=generator, dtype=torch.float64)
    target = torch.rand(6, 3, generator=generator, dtype=torch.float64)
    extent = model.extent_tensor.double()
    place = {"azimuth": 0.7, "elevation": 0.4, "distance": 2.0}
    values = {key: torch.tensor(value, dtype=torch.float64) for key, value in place.items()}
    values |= {"shape": model.codes[0].shape.double(), "texture": model.codes[0].texture.double()}
    with torch.no_grad():
        fixed = cast(pixels, *(values[key] for key in place), 32.8, (32, 32), extent)

    def loss(changed: torch.Tensor) -> torch.Tensor:
        now = values | {name: changed}
        rays = cast(pixels, *(now[key] for key in place), 32.8, (32, 32), extent)
        # Where samples stand along a ray is no function of the camera.
        rays = replace(rays, near=fixed.near, far=fixed.far)
        seen = render_rays(model, rays, 12, field.shape_bias(now["shape"]), field.texture_bias(now["texture"]))
        return (seen.colour - target).square().sum()

    assert float(fixed.far.sub(fixed.near).min()) > 0.1
    start = values[name].clone().requires_grad_()
    (slope,) = torch.autograd.grad(loss(start), start)
    direction = torch.randn(slope.shape, generator=generator, dtype=torch.float64)
    step = 1e-5
    with torch.no_grad():
        measured = (loss(values[name] + step * direction) - loss(values[name] - step * direction)) / (2 * step)
    assert float((slope * direction).sum()) == pytest.approx(float(measured), rel=1e-5, abs=1e-9)
