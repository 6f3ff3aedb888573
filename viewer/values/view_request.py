"""The inputs of the image in the view: object, camera and settings."""

from dataclasses import dataclass

from core.geometry.camera import Camera
from core.models.model import Instance
from viewer.values import orbit


@dataclass(frozen=True)
class ViewSettings:
    """Settings of the view, independent of the open model."""

    panel: tuple[int, int] = (512, 512)  # px, width and height of the view
    pan: tuple[float, float] = (0.0, 0.0)  # right and down, as fractions of the view's shorter side
    detail: int = 256  # px along the shorter side of a preview, at most the view's
    samples: int = 192  # intervals along the longest side of the scene's box
    mode: str = "colour"  # one of :data:`viewer.values.view_modes.MODES`
    opengl: bool = False  # draw a baked object while it turns; else every image is exact
    covered: int = 0  # px covered at the view's lower edge; the object is centred above

    @property
    def offset(self) -> tuple[float, float]:
        """The object's offset, right and down from the view's middle, as fractions of its shorter side."""
        return self.pan[0], self.pan[1] - self.covered / (2 * min(self.panel))

    @property
    def baked(self) -> bool:
        """True if OpenGL may draw a baked object, which shows colours only."""
        return self.opengl and self.mode == "colour"


@dataclass(frozen=True)
class ViewRequest:
    """An object, the camera that sees it, and the settings of the view."""

    instance: Instance
    camera: Camera
    settings: ViewSettings = ViewSettings()

    @property
    def full(self) -> int:
        """px along the view's shorter side."""
        return min(self.settings.panel)

    @property
    def preview(self) -> int:
        """px of the preview along the view's shorter side."""
        return min(self.settings.detail, self.full)

    def crop(self, detail: int) -> orbit.PanelCrop:
        """Return the image to render, with ``detail`` px along the view's shorter side, and its shown part."""
        return orbit.fit_to_panel(self.camera, *self.settings.panel, detail, self.settings.offset)
