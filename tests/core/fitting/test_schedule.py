import pytest

from core.fitting.schedule import PRESETS, RENEWED, FitSettings, plan


def test_the_race_is_halved_twice_and_ends_with_the_winner():
    settings = PRESETS["normal"]
    stages = plan(settings, blind=True)
    (second,) = [index for index, stage in enumerate(stages) if stage.anew]
    for heat in (stages[:second], stages[second:]):
        counts = [stage.hypotheses for stage in heat]
        assert counts == sorted(counts, reverse=True)
    assert (stages[0].hypotheses, stages[second].hypotheses, stages[-1].hypotheses) == (28, RENEWED, 1)
    assert sum(stage.steps for stage in stages[second:]) == settings.steps
    assert sum(stage.steps for stage in stages[:second]) == pytest.approx(settings.steps / 3, abs=2)


def test_with_known_cameras_there_is_one_heat():
    assert not any(stage.anew for stage in plan(PRESETS["normal"], blind=False))


@pytest.mark.parametrize("starts", [1, 2, 3, 7, 100])
@pytest.mark.parametrize("steps", [1, 4, 50])
def test_any_settings_make_a_plan(starts: int, steps: int):
    for blind in (True, False):
        stages = plan(FitSettings(starts, steps, rays=8, samples=2), blind)
        assert all(stage.steps >= 1 and stage.rays <= 8 and stage.samples >= 2 for stage in stages)
        assert stages[0].hypotheses == (starts if blind else min(starts, 6))


def test_a_search_for_the_lens_begins_with_more_cameras():
    usual, lens = (plan(FitSettings(starts=28, lens=one), blind=True) for one in (False, True))
    assert (usual[0].hypotheses, lens[0].hypotheses) == (28, 42)
    with pytest.raises(ValueError, match="focal length"):
        FitSettings(starts=1, paper=True, lens=True)


def test_the_paper_does_not_race():
    (stage,) = plan(PRESETS["paper"], blind=True)
    assert (stage.hypotheses, stage.steps, stage.samples) == (1, 299, 64)
