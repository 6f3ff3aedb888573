import moderngl
import pytest

from viewer.screen.opengl_speed import is_fast


@pytest.mark.parametrize(
    ("milliseconds", "fast", "pictures"),
    [((900, 10), True, 2), ((10, 200, 10), True, 3), ((10, 200, 300), False, 3), ((10, 200, 50, 40), False, 4)],
)
def test_other_programs_may_hold_opengl_up(
    gl: moderngl.Context, monkeypatch: pytest.MonkeyPatch, milliseconds: tuple[int, ...], fast: bool, pictures: int
) -> None:
    readings = [reading for duration in milliseconds for reading in (0.0, duration / 1000)]
    clock = iter(readings)
    monkeypatch.setattr("viewer.screen.opengl_speed.time.perf_counter", lambda: next(clock))
    assert is_fast(gl) == fast
    assert len(readings) - len(list(clock)) == 2 * pictures
