"""Results of fits, which join the objects; a result is shown at once if the view followed its fit."""

from core.geometry.camera import Camera
from core.metrics import rotation_error
from viewer.activities.viewport import Viewport
from viewer.editor import Editor
from viewer.values import orbit
from viewer.values.fit_history import Ready
from viewer.values.objects import EditableObject

_ANOTHER_VIEWPOINT = 10.0  # degrees between cameras that show different sides


class FitResults:
    """Adds results to the objects, and shows them unless a person is editing something else."""

    def __init__(self, editor: Editor, viewport: Viewport) -> None:
        self._editor = editor
        self._viewport = viewport
        self.checking: Ready | None = None  # preliminary result of the current fit, checked by a second search
        self.unseen: set[str] = set()  # names of results that were not shown yet
        editor.scene_changed.connect(self._forget_seen)
        editor.object_chosen.connect(self._forget_chosen)

    def add(self, fitted: EditableObject, camera: Camera) -> Ready:
        """Add a result to the objects; return its name and its photo's camera, at the size of the model's images."""
        if self._viewport.following:
            turned = self._viewport.turned
            name = self._editor.add_and_show(fitted, self._editor.scene.camera if turned else camera)
            if not turned:
                self._viewport.centre()
            return Ready(name, camera)
        name = self._editor.objects.add(fitted)
        self.unseen.add(name)
        return Ready(name, camera)

    def improve(self, handed: Ready, better: EditableObject, camera: Camera) -> bool:
        """Replace the preliminary result ``handed`` by the final one; return whether their viewpoints differ."""
        name = handed.name
        differs = better.instance != self._editor.objects[name].original
        view_camera = self._editor.scene.camera
        turned = not orbit.same_direction(view_camera, handed.camera)
        on_screen = self._editor.improve(name, better, view_camera if turned else camera)
        if on_screen and differs and not turned:
            self._viewport.centre()
        if differs and not on_screen and name not in self._editor.objects.removed:
            self.unseen.add(name)
        return rotation_error(handed.camera, camera) > _ANOTHER_VIEWPOINT

    def rename(self, name: str, to: str) -> None:
        """Follow the renaming of a result."""
        if name in self.unseen:
            self.unseen ^= {name, to}
        if self.checking and self.checking.name == name:
            self.checking = Ready(to, self.checking.camera)

    def _forget_chosen(self) -> None:
        self.unseen.discard(self._editor.objects.root(self._editor.state.mix.a.shape))

    def _forget_seen(self) -> None:
        instance = self._editor.scene.instance
        objects = self._editor.objects
        gone = {name for name in self.unseen if objects[name].original == instance or name in objects.removed}
        self.unseen -= gone
