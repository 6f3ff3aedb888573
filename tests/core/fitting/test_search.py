"""What a race does between the start line and the winner."""

import math
from collections.abc import Iterator
from dataclasses import replace

import pytest
import torch

from core.fitting import schedule as plan
from core.fitting import search as racing
from core.fitting.fit import FitJob, FitSettings, FitStep, fit
from core.fitting.hypotheses import DivergedError, Numbers, Pool
from core.fitting.search import Race, Standing
from core.models.model import Model
from core.photos.photo import Photo
from tests.core.tiny import photo_of

QUICK = FitSettings(starts=8, steps=60, rays=128, samples=24, races=1)
SHORT = FitSettings(starts=4, steps=8, rays=48, samples=12, races=1)


def last(model: Model, photo: Photo, settings: FitSettings, seed: int = 0) -> FitStep:
    *_, step = fit(model, FitJob((photo,), settings, seed))
    return step


@pytest.mark.parametrize(("pays", "sparing", "directions"), [(0.002, True, 2), (2.0, True, 1), (2.0, False, 2)])
def test_code_directions_are_opened_while_they_pay(
    tiny: Model, monkeypatch: pytest.MonkeyPatch, pays: float, sparing: bool, directions: int
):
    monkeypatch.setattr(plan, "_RANKS", (1, 2, 2, 2, 2, 2))
    monkeypatch.setattr(racing, "_LEADING", 1)
    monkeypatch.setattr(racing, "_PAYS", pays)
    photo = replace(photo_of(tiny, tiny.codes[2], tiny.camera(0.9, 0.5)), camera=tiny.camera(0.9, 0.5))
    found = last(tiny, photo, replace(QUICK, sparing=sparing))
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
    monkeypatch.setattr(racing, "_LEADING", 1)
    steps = 0
    for index in range(4):
        camera = tiny.camera(0.9 + index, 0.5)  # given, and one start: a race of so small a model is decided by chance
        clean = photo_of(tiny, tiny.codes[index], camera)
        noise = 0.03 * torch.randn(clean.pixels.shape, generator=torch.Generator().manual_seed(index))
        photo = replace(clean, pixels=clean.pixels + noise, camera=camera)  # no picture is what a model can draw
        spared, lavish = (last(tiny, photo, replace(QUICK, starts=1, sparing=one), seed=1) for one in (True, False))
        assert spared.psnr > lavish.psnr - 0.1
        steps += lavish.step - spared.step
    assert steps > 0


def test_the_distance_is_free_where_an_edge_cuts_the_object_off(tiny: Model):
    photo = replace(photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)), framed=True)
    cut_off = replace(photo, unseen=~photo.mask)
    spreads = Race.of(tiny, (photo, cut_off, replace(cut_off, camera=tiny.camera(0.9, 0.3))), QUICK, 0).by.spreads[:, 1]
    assert spreads[0] < spreads[1] < spreads[2] == math.inf


def test_where_cameras_are_known_shapes_race(tiny: Model):
    cameras = [tiny.camera(0.9, 0.5), tiny.camera(2.9, 0.3)]
    photos = [replace(photo_of(tiny, tiny.codes[2], camera), camera=camera) for camera in cameras]
    race = Race.of(tiny, tuple(photos), QUICK, 0)
    pool = race.entered()
    ranked = replace(pool, cost=torch.arange(len(pool), dtype=torch.float32))
    cut = race.cut(ranked, race.plan[1]._replace(hypotheses=2))
    assert cut.start.tolist() == [0, 1]
    first, *_, end = fit(tiny, FitJob(tuple(photos), QUICK))
    assert (first.hypotheses, end.hypotheses) == (len(pool), 1)


def test_the_leader_goes_on_where_all_others_have_diverged(tiny: Model):
    race = Race.of(tiny, (photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)),), QUICK, 0)
    pool = race.entered()
    pool = replace(pool, cost=torch.full((len(pool),), math.inf).index_fill(0, torch.tensor(5), 1.0))
    kept = race.cut(pool, race.plan[2]._replace(hypotheses=4))
    assert kept.start.tolist() == [5, 5]  # and its twin


@pytest.mark.parametrize(("close", "going"), [(math.inf, 2), (-math.inf, 1)])
def test_a_rival_goes_on_to_the_end_where_it_is_close_behind(
    tiny: Model, monkeypatch: pytest.MonkeyPatch, close: float, going: int
):
    monkeypatch.setattr(racing, "_CLOSE", close)
    photo = photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3))
    *_, before, end = fit(tiny, FitJob((photo,), SHORT))
    assert (before.hypotheses, end.hypotheses) == (going, 1)
    assert end.alternative is not None
    assert end.margin is not None
    assert end.margin >= 0
    again = list(fit(tiny, FitJob((photo,), SHORT, begin=end.race[0])))
    assert {step.hypotheses for step in again} == {1}  # whoever goes on with one camera means that one


def test_a_camera_in_doubt_is_searched_for_once_more(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    job = FitJob((photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)),), SHORT)
    once = list(fit(tiny, job))
    twice = replace(job, settings=replace(SHORT, races=2))
    monkeypatch.setattr(racing, "_DOUBT", 0.0)
    assert [step.loss for step in fit(tiny, twice)] == [step.loss for step in once]
    monkeypatch.setattr(racing, "_DOUBT", 1.1)
    steps = list(fit(tiny, twice))
    first, second = steps[: len(once)], steps[len(once) :]
    assert [step.loss for step in first] == [step.loss for step in once]
    assert first[-1].steps > first[-1].step
    for step in [first[-1], *(step for step in second[:-1] if step.loss == first[-1].loss)]:
        found = (step.alternative and step.alternative.loss, step.margin, step.spread)  # who stops early knows as much
        assert found == (once[-1].alternative.loss, once[-1].margin, once[-1].spread)
    assert {step.loss for step in second} != {step.loss for step in first}
    assert max(step.loss for step in second) <= first[-1].loss  # who stops early loses nothing
    assert second[0].hypotheses == once[0].hypotheses + 1
    assert [step.again for step in steps] == [False] * len(first) + [True] * len(second)
    assert [step.step for step in steps] == list(range(1, len(steps) + 1))
    assert steps[-1].step <= steps[-1].steps
    assert second[-1].hypotheses == 1
    assert second[-1].alternative is not None
    assert len(list(fit(tiny, replace(twice, begin=steps[-1].race[0])))) <= SHORT.steps


def test_three_races_are_run_while_a_camera_stays_in_doubt(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(racing, "_DOUBT", 1.1)
    photo, lengths = photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)), list[int]()
    for races in (1, 2, 3):
        steps = list(fit(tiny, FitJob((photo,), replace(SHORT, races=races))))
        lengths.append(len(steps))
        assert [step.step for step in steps] == list(range(1, len(steps) + 1))
        assert [step.again for step in steps] == [number > lengths[0] for number in range(1, len(steps) + 1)]
        assert len({step.steps for step in steps}) == races
    assert lengths[0] < lengths[1] < lengths[2]


@pytest.mark.parametrize("kind", ["known", "several", "paper"])
def test_one_race_is_enough_where_not_one_camera_is_in_doubt(tiny: Model, monkeypatch: pytest.MonkeyPatch, kind: str):
    photo, camera = photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)), tiny.camera(0.9, 0.3)
    photos = {"known": (replace(photo, camera=camera),), "several": (photo, photo), "paper": (photo,)}[kind]
    settings = replace(SHORT, starts=1, paper=True) if kind == "paper" else SHORT
    monkeypatch.setattr(racing, "_DOUBT", 1.1)
    once, twice = (list(fit(tiny, FitJob(photos, replace(settings, races=races)))) for races in (1, 2))
    assert [step.loss for step in once] == [step.loss for step in twice]
    assert not any(step.again for step in twice)


def test_a_second_race_that_diverges_leaves_the_first_as_it_was(tiny: Model, monkeypatch: pytest.MonkeyPatch):
    job = FitJob((photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)),), SHORT)
    *_, once = fit(tiny, job)
    run = Race._run

    def diverging(race: Race, pool: Pool) -> Iterator[Standing]:
        runs.append(race)
        if len(runs) > 1:
            raise DivergedError
        yield from run(race, pool)

    runs: list[Race] = []
    monkeypatch.setattr(racing, "_DOUBT", 1.1)
    monkeypatch.setattr(Race, "_run", diverging)
    *_, last_one = fit(tiny, replace(job, settings=replace(SHORT, races=2)))
    assert len(runs) == 2
    assert last_one.again
    assert (last_one.loss, last_one.margin) == (once.loss, once.margin)


def test_the_better_of_two_races_is_judged_by_the_smaller_margin(tiny: Model):
    race = Race.of(tiny, (photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)),), SHORT, 0)

    def ended(azimuth: float, cost: float, margin: float) -> Standing:
        pool = race.entered()[torch.tensor([0])]
        angles = torch.tensor([[[azimuth, 0.3]]])
        pool = replace(pool, numbers=pool.numbers._replace(angles=angles), cost=torch.tensor([cost]))
        return Standing(pool, pool, margin, spread=cost)

    clear, doubtful, behind = ended(0.9, 1.0, 2.0), ended(0.9, 2.0, 0.1), ended(-2.0, 1.5, 2.0)
    better = race._better(doubtful, clear)  # they agree
    assert (better.pool, better.rival, better.margin) == (clear.pool, doubtful.rival, doubtful.margin)
    better = race._better(behind, clear)
    assert (better.pool, better.spread) == (clear.pool, clear.spread)
    assert better.rival is not None
    assert torch.equal(better.rival.numbers.angles, behind.pool.numbers.angles)
    assert better.margin == pytest.approx(math.log(1.5))


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
    photo = Photo(pixels, mask, cropped=seed % 2 == 0)
    race = Race.of(model, (photo,), FitSettings(starts=4, steps=9, rays=48, samples=12), seed)
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
    for standing in standings:
        leader, left = standing.pool.leader, standing.pool
        assert math.isfinite(float(left.cost[leader])) and math.isfinite(float(left.squared[leader]))
        assert all(bool(part.isfinite().all()) for part in left.numbers)
    end = standings[-1].pool
    began = race.measured(pool[end.start[end.leader][None]])
    assert float(end.cost[end.leader]) <= float(began.cost) + 1e-6


def test_what_an_earlier_race_found_out_holds_while_its_winner_leads(tiny: Model):
    race = Race.of(tiny, (photo_of(tiny, tiny.codes[0], tiny.camera(0.9, 0.3)),), QUICK, 0)
    pool = race.entered()[torch.tensor([0, 1, 2])]
    won = replace(pool[torch.tensor([0])], cost=torch.tensor([0.5]))
    before = Standing(won, pool[torch.tensor([1])], 0.3, 1.5)
    behind, ahead = (Standing(replace(pool, cost=torch.tensor([0.9, least, 0.8]))) for least in (0.7, 0.2))
    assert behind.beside(None) is behind
    assert behind.beside(before)[1:] == before[1:]
    assert behind.beside(before).pool.cost.min() == 0.5
    assert ahead.beside(before)[1:] == ahead[1:]
    assert len(ahead.beside(before).pool) == 4
    assert before.beside(before) is before  # the end of a race has been compared already
