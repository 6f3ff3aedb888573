from pathlib import Path

from tests.viewer.driver import Drive, Driver
from viewer.services.backend import Backend


def test_the_performance_panel_describes_the_frame_on_screen(
    drive: Drive, real_backend: Backend, tmp_path: Path
) -> None:
    def act(window: Driver) -> None:
        session = window.session
        window.show("Performance")
        window.drag("View/orbit", 40)
        window.wait(lambda: session.viewport.frame.final and not session.jobs.busy("view"))
        sizes, seconds = zip(*session.viewport.times, strict=True)
        assert sizes[-1] == session.viewport.full_frame[0].resolution
        assert list(seconds) == sorted(seconds)
        assert session.messages.errors == []
        own = window.context.frame_times
        assert own.maxlen == 120
        window.wait(lambda: len(own) == own.maxlen)
        assert all(seconds >= 0 for seconds in own)

    drive(act, real_backend)
