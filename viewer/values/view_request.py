"""Everything that the image in the view depends on, as one record."""

from dataclasses import dataclass
from typing import NamedTuple

from core.geometry.camera import Camera
from core.models.codes import Codes
from viewer.values import orbit


class Quality(NamedTuple):
    """Of the image that is rendered at once."""

    detail: int = 256  # px along its shorter side, if the view has as many
    samples: int = 192  # intervals along the longest side of the scene's box


USUAL = Quality()


@dataclass(frozen=True)
class ViewSettings:
    """How objects are seen, whichever model is open."""

    panel: tuple[int, int] = (512, 512)  # px, the size of the view
    pan: tuple[float, float] = (0.0, 0.0)  # right and down, in shares of the view's shorter side
    quality: Quality = USUAL
    mode: str = "colour"  # one of :data:`viewer.values.view_modes.MODES`
    opengl: bool = False  # OpenGL draws a baked copy while the object is turned; else every image is exact
    covered: int = 0  # px at the view's lower edge that something lies over: an object stands above it

    @property
    def offset(self) -> tuple[float, float]:
        """How far the object is right of and below the view's middle, in shares of the view's shorter side."""
        return self.pan[0], self.pan[1] - self.covered / (2 * min(self.panel))

    @property
    def baked(self) -> bool:
        """A baked copy may be drawn; it has colours alone."""
        return self.opengl and self.mode == "colour"


@dataclass(frozen=True)
class ViewRequest:
    """An object, the camera that sees it, and the settings of the view."""

    codes: Codes
    camera: Camera
    settings: ViewSettings = ViewSettings()

    @property
    def full(self) -> int:
        """px of the view's shorter side."""
        return min(self.settings.panel)

    @property
    def preview(self) -> int:
        """px along that side of the image that is rendered at once."""
        return min(self.settings.quality.detail, self.full)

    def crop(self, detail: int) -> orbit.PanelCrop:
        """The camera to render, so many px along the view's shorter side, and what of it is shown."""
        return orbit.fit_to_panel(self.camera, *self.settings.panel, detail, self.settings.offset)
