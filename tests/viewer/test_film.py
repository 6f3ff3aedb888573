from pathlib import Path

import pytest

from tests.viewer.window_driver import finish
from viewer.activities.exporting import VideoChoice
from viewer.activities.player import Film
from viewer.session import Session
from viewer.values import orbit


class Clock:
    """Stands until it is moved."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def film(session: Session, clock: Clock) -> Film:
    """Two keys in four seconds."""
    session.film = Film(session, clock)
    session.film.add_key()
    session.film.seek(2.0)
    session.show("object 3")
    session.look(orbit.turned(session.scene.camera, 1.0, 0.0))
    session.film.add_key()
    session.settle()
    return session.film


def test_the_film_stops_where_undo_takes_its_keys(session: Session, clock: Clock) -> None:
    film = session.film = Film(session, clock)
    film.add_key()
    film.play()
    session.undo()
    film.tick()
    assert not film.playing
    assert not film.timeline.keys


def test_playing_goes_with_the_clock_and_round(session: Session, film: Film, clock: Clock) -> None:
    film.seek(0.0)
    session.settle()
    film.play()
    for passed, stands in ((1.0, 1.0), (3.5, 3.5), (5.0, 1.0)):
        clock.now = 100.0 + passed
        film.tick()
        assert film.seconds == pytest.approx(stands)
        assert session.scene.codes == film.timeline.at(stands).codes
    assert film.playing


def test_a_key_at_the_end_of_a_loop_is_the_one_it_stands_on(film: Film) -> None:
    film.seek(film.timeline.length)
    film.add_key()
    assert film.key == 2
    film.add_key()
    assert len(film.timeline.keys) == 3


def test_what_is_no_loop_ends_and_begins_anew(session: Session, film: Film, clock: Clock) -> None:
    film.set_loop(False)
    film.play()
    clock.now += 9.0
    film.tick()
    assert not film.playing
    assert film.seconds == film.timeline.length
    film.play()
    assert film.seconds == 0.0


def test_pictures_are_drawn_ahead_and_shown(session: Session, film: Film, clock: Clock) -> None:
    film.play()
    finish(session)
    clock.now += 1.0
    film.tick()
    assert session.viewport.frame is not None
    assert not session.viewport.frame.final
    film.pause()
    finish(session)
    assert session.viewport.frame.final


def test_it_fits_a_view_that_changes_its_size(session: Session, film: Film, clock: Clock) -> None:
    film.play()
    finish(session)
    session.viewport.resize(300, 100)
    film.tick()
    finish(session)
    film.tick()
    assert session.viewport.frame is not None
    width, height = session.viewport.frame.resolution
    assert width == 3 * height
    assert film.playing


def test_any_edit_stops_it(session: Session, film: Film, clock: Clock) -> None:
    film.play()
    session.show("object 1")
    shown = session.scene
    clock.now += 0.5
    film.tick()
    assert not film.playing
    assert session.scene == shown


def test_a_model_opened_meanwhile_has_an_empty_film(session: Session, film: Film) -> None:
    film.play()
    session.open_model("other")
    finish(session)
    assert not film.playing
    assert film.timeline.keys == ()
    assert session.errors == []


def test_a_film_without_keys_does_nothing(session: Session, tmp_path: Path) -> None:
    session.film.play()
    session.film.seek(1.0)
    session.exporting.film(tmp_path / "a.gif")
    assert not session.film.playing
    assert not session.exporting.running


def test_what_cannot_be_written_is_told(session: Session, film: Film, tmp_path: Path) -> None:
    session.exporting.film(tmp_path / "a.mp4", VideoChoice(transparent=True))
    finish(session)
    assert "transparent" in session.errors[0]
    assert not list(tmp_path.iterdir())
