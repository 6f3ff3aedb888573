from itertools import count
from types import SimpleNamespace

import numpy as np
import pytest

from core.detail.progressive import Frame
from tests.viewer.driver import finish
from tests.viewer.stand_ins import photographed
from viewer.session import Session
from viewer.values.objects import EditableObject
from viewer.values.share_settings import ShareSettings


def test_films_move_and_a_swing_comes_back_to_the_photo(session: Session) -> None:
    scene = photographed(session.editor.scene)
    session.editor.add_and_show(EditableObject("photographed", scene.instance), scene.camera)
    films = session.exporting.films
    films.update(ShareSettings("swing"))
    assert films.frame("swing", 0.0) is None and not films.moving
    finish(session, lambda: films.moving)
    assert films.photo_shares("swing") == (0.0, 0.0)
    images = [films.frame("swing", seconds) for seconds in (0.0, 1.0, 2.0, 4.0)]
    assert images[0] is images[3] and images[0] is not images[1]
    np.testing.assert_array_equal(images[0].image, images[2].image)
    films.close()
    assert not films.moving and films.frame("swing", 0.0) is None


def test_an_object_without_photo_has_no_swing_and_one_that_is_b_no_morph(session: Session) -> None:
    films = session.exporting.films
    films.update(ShareSettings("turntable"))
    finish(session, lambda: films.moving)
    assert films.frame("swing", 0.0) is None and films.frame("morph", 0.0) is not None
    assert films.photo_shares("turntable") is None
    session.editor.set_b(session.editor.state.mix.a.shape)
    assert session.editor.film_partner is None
    films.update(ShareSettings("turntable"))
    finish(session, lambda: films.moving)
    assert films.frame("morph", 0.0) is None and films.frame("turntable", 0.0) is not None


@pytest.mark.parametrize(("sources", "shares"), [(None, (0.0, 0.0)), ([[0.3, 0.2], [0.0, 0.0]], (0.6, 0.4))])
def test_photo_shares_ignore_transparent_pixels(sources: list | None, shares: tuple[float, float]) -> None:
    opacity = np.array([[0.5, 0.0]], np.float32)
    fractions = None if sources is None else np.array([sources], np.float32)
    frame = Frame(np.zeros((1, 2, 3), np.uint8), opacity, opacity, 0, 1, 8, 0.0, sources=fractions)
    assert frame.photo_shares == pytest.approx(shares)


def test_the_estimated_time_of_saving_grows_with_the_size(session: Session, monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(perf_counter=count().__next__)  # each step takes a second, on any machine
    monkeypatch.setattr("viewer.activities.share_preview.time", clock)
    preview = session.exporting.preview
    seconds = []
    for size in (256, 512, 1080):
        preview.update(ShareSettings("turntable", size=size))
        finish(session, lambda: preview.seconds is not None)
        seconds.append(preview.seconds)
    assert seconds == sorted(seconds)
    preview.update(ShareSettings("mesh"))
    finish(session)
    assert preview.seconds is None
