"""The object's size in the view: three quarters of it after a fit or a choice, and no more after a stretch."""

from collections.abc import Iterator
from dataclasses import replace

from viewer.editor import Editor
from viewer.services.jobs import Jobs
from viewer.services.worker import Job
from viewer.values import orbit

_LARGER = 1.01  # distance over the present one from which a stretched object is too large
SHARE = 0.75  # largest extent of the object as a fraction of the view's width and height


class Framing:
    """Changes the camera's distance as part of the last edit, unless the scene was edited since."""

    def __init__(self, jobs: Jobs, editor: Editor) -> None:
        self._jobs = jobs
        self._editor = editor
        self._last = editor.scene
        self._zoomed = False  # a person has zoomed since the last framing
        self._is_resized = False  # a person has stretched the object since then
        self._panel = (0, 0)  # px, size of the view in the newest request
        editor.scene_changed.connect(self._look)
        editor.resized.connect(self._note_size)

    def keep_size(self, panel: tuple[int, int]) -> None:
        """Frame the object unless a person has zoomed."""
        if not self._zoomed:
            self.frame(panel)

    def tick(self, panel: tuple[int, int]) -> None:
        """Frame a stretched object that has become too large, unless a person has zoomed; call once a frame."""
        if self._is_resized and not self._editor.history.gesture:
            self._is_resized = False
            if not self._zoomed:
                self.frame(panel, only_away=True)

    def frame(self, panel: tuple[int, int], only_away: bool = False) -> None:
        """Begin to frame the scene's object in a view of ``panel`` px; ``only_away`` never brings it nearer."""
        editor = self._editor
        scene = self._editor.scene
        self._zoomed = False
        self._panel = panel
        panel_camera = orbit.fit_to_panel(scene.camera, *panel, scene.camera.height).camera

        def moved(distance: float) -> None:
            if only_away and distance < _LARGER * scene.camera.distance:
                return
            if editor.scene is scene and self._panel == panel and not editor.history.gesture:
                camera = orbit.at_distance(scene.camera, distance, scene.instance.model)
                self._last = replace(scene, camera=camera)
                editor.join(self._last)

        def stream() -> Iterator[float]:
            yield self._jobs.backend.distance(scene.instance, panel_camera, SHARE)

        self._jobs.submit(Job("framing", stream, moved, self._jobs.reporting("Cannot frame the object"), urgent=True))

    def _note_size(self) -> None:
        self._is_resized = True

    def _look(self) -> None:
        scene = self._editor.scene
        previous = self._last
        self._last = self._editor.scene
        if scene.instance is previous.instance and scene.camera.distance != previous.camera.distance:
            self._zoomed = True
