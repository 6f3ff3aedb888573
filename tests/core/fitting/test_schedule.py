import math

import pytest

from core.fitting.schedule import LOCAL_HYPOTHESES, build_schedule
from core.fitting.settings import ALL_COMPONENTS, PRESETS, Components, FitSettings


def test_hypotheses_are_pruned_to_one_for_refinement():
    settings = PRESETS["normal"]
    coarse, local, final, rivals, free, *_ = build_schedule(settings, ALL_COMPONENTS, unknown=1)
    for stages in (coarse, (*local, final), rivals):
        counts = [stage.hypotheses for stage in stages]
        assert counts == sorted(counts, reverse=True)
    assert (coarse[0].hypotheses, local[0].hypotheses, final.hypotheses) == (28, LOCAL_HYPOTHESES, 1)
    assert sum(stage.steps for stage in (*local, final)) == settings.steps
    assert free is not None
    assert (free.hypotheses, free.steps, free.rays) == (1, settings.free_steps, settings.rays)
    assert sum(stage.steps for stage in coarse) == pytest.approx(settings.steps / 2, abs=4)


def test_photos_share_the_rays_of_a_step_and_place_each_other_if_several_cameras_are_unknown():
    settings = PRESETS["normal"]
    several = build_schedule(settings, ALL_COMPONENTS, unknown=2, photos=4)
    assert not several.coarse and not several.rivals
    assert several.final.rays == settings.rays // 4
    assert several.placing and not any(stage.codes_move for stage in several.placing)
    assert not build_schedule(settings, ALL_COMPONENTS, unknown=1).placing


def test_known_cameras_and_resumed_fits_skip_the_coarse_search():
    assert not build_schedule(PRESETS["normal"], ALL_COMPONENTS, unknown=False).coarse
    settings = PRESETS["normal"]
    (final,) = build_schedule(settings, ALL_COMPONENTS, unknown=True, added=0).stages
    assert (final.hypotheses, final.steps, final.rays) == (1, settings.steps, settings.rays)


@pytest.mark.parametrize("hypotheses", [1, 2, 3, 7, 100])
@pytest.mark.parametrize("steps", [1, 4, 50])
def test_any_settings_make_a_schedule(hypotheses: int, steps: int):
    for unknown in (True, False):
        settings = FitSettings(hypotheses, steps, rays=8, samples=2)
        stages = build_schedule(settings, ALL_COMPONENTS, unknown).stages
        assert all(stage.steps >= 1 and stage.rays <= 8 and stage.samples >= 2 for stage in stages)
        assert stages[0].hypotheses == (hypotheses if unknown else min(hypotheses, 6))


def test_settings_change_the_schedule():
    counts = [
        build_schedule(FitSettings(28, estimate_focal=estimated), ALL_COMPONENTS, unknown=True).stages[0].hypotheses
        for estimated in (False, True)
    ]
    assert counts == [28, 42]
    stages = build_schedule(PRESETS["normal"], Components(robust_loss=False), True).stages
    assert all(math.isinf(stage.robust_scale) for stage in stages)
