from dataclasses import replace

import pytest
import torch

from core.export.films import SWING, TURN
from core.models.model import Model
from core.models.scene import Scene
from tests.viewer.stand_ins import photographed
from viewer.values.share_settings import ShareSettings, films_of


@pytest.fixture
def scene(model: Model) -> Scene:
    return Scene(model[0], model.camera(0.3, 0.2))


@pytest.mark.parametrize(
    "wrong",
    [
        {"kind": "poster"},
        {"video": ".avi"},
        {"picture": ".bmp"},
        {"mesh": ".dae"},
        {"size": 1},
        {"background": "black"},
        {"colour": (256, 0, 0)},
        {"cells": 4},
    ],
)
def test_an_unknown_choice_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        ShareSettings(**wrong)  # type: ignore[arg-type]


def test_background_and_shadow_follow_the_format() -> None:
    clear = ShareSettings("turntable", background="transparent")
    assert clear.behind == (255, 255, 255)
    assert replace(clear, video=".webp").behind is None
    assert replace(clear, kind="picture").behind is None
    assert replace(clear, kind="picture", picture=".jpg").behind == (255, 255, 255)
    gradient = (4, 5, 6), (1, 2, 3)
    assert ShareSettings("turntable", view_background=gradient).behind == gradient
    assert ShareSettings("turntable", background="white", view_background=gradient).behind == (255, 255, 255)
    gif = ShareSettings("turntable", video=".gif", background="transparent")
    assert not gif.shows_shadow
    assert replace(gif, background="white").shows_shadow
    assert replace(gif, video=".webp").shows_shadow
    assert replace(gif, kind="picture").shows_shadow
    assert not replace(gif, kind="mesh", background="white").shows_shadow


def test_a_page_is_square_and_shows_all_of_the_object_from_every_side(model: Model, scene: Scene) -> None:
    near = replace(scene, camera=replace(scene.camera.resized(60, 30), focal=300.0))
    settings = ShareSettings("page", size=40, wide=True, background="transparent", view_background=((1, 2, 3),) * 2)
    (view,) = settings.views(near)
    assert (view.camera.width, view.camera.height) == (40, 40)
    corners = torch.cartesian_prod(*(torch.tensor([-side, side]) for side in model.extent))
    for turn in range(12):
        projected = replace(view.camera, azimuth=turn).project(corners)
        assert projected.min() > -4 and projected.max() < 44
    assert settings.behind == (255, 255, 255)
    assert settings.shows_shadow and settings.suffix == ".html"


def test_a_turntable_turns_once_at_the_chosen_size_and_fills_its_frame(model: Model, scene: Scene) -> None:
    near = replace(scene, camera=replace(scene.camera, distance=0.4 * model.distance))
    views = ShareSettings("turntable", size=40).views(near)
    assert len(views) == TURN
    frames = {(view.camera.width, view.camera.height, view.camera.distance) for view in views}
    assert frames == {(40, 40, model.distance)}  # its perspective stays
    wide = ShareSettings("turntable", size=40, wide=True).views(near)
    assert {(view.camera.width, view.camera.height) for view in wide} == {(72, 40)}


@pytest.fixture
def fitted_scene(scene: Scene) -> Scene:
    """A fitted object that somebody last looked at from behind."""
    return replace(photographed(scene), camera=replace(scene.camera, azimuth=-2.0))


@pytest.mark.parametrize(("kind", "frames"), [("swing", SWING), ("turntable", TURN), ("morph", TURN), ("page", 1)])
def test_films_start_at_the_photos_camera(model: Model, fitted_scene: Scene, kind: str, frames: int) -> None:
    views = ShareSettings(kind, size=40).views(fitted_scene, model[1])
    assert len(views) == frames
    assert (views[0].camera.azimuth, views[0].camera.elevation) == pytest.approx((1.0, 0.4))
    assert views[0].instance == fitted_scene.instance
    (picture,) = ShareSettings("picture", size=40).views(fitted_scene)
    assert picture.camera.azimuth == -2.0


def test_a_film_that_is_impossible_gives_way_to_the_usual_one(model: Model, scene: Scene, fitted_scene: Scene) -> None:
    partner = model[1]
    assert films_of(fitted_scene, partner) == ("swing", "turntable", "morph")
    assert films_of(scene, None) == ("turntable",)
    for kind, plain in (("swing", "turntable"), ("morph", "turntable"), ("page", "page")):
        assert ShareSettings(kind).film_of(scene, None).kind == plain
        assert ShareSettings(kind).film_of(fitted_scene, partner).kind == kind
    assert ShareSettings("morph").film_of(fitted_scene, None).kind == "swing"
