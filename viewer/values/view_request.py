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
    """Settings of the view, independent of the open model."""

    panel: tuple[int, int] = (512, 512)  # px, the size of the view
    pan: tuple[float, float] = (0.0, 0.0)  # right and down, in shares of the view's shorter side
    quality: Quality = USUAL
    mode: str = "colour"  # one of :data:`viewer.values.view_modes.MODES`
    opengl: bool = False  # draw a baked object while it turns; else every image is exact
    covered: int = 0  # px covered at the view's lower edge, above which the object is placed

    @property
    def offset(self) -> tuple[float, float]:
        """Offset of the object to the right of and below the view's middle, relative to its shorter side."""
        return self.pan[0], self.pan[1] - self.covered / (2 * min(self.panel))

    @property
    def baked(self) -> bool:
        """True if a baked object may be drawn, which shows colours only."""
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
        """px of the preview along that side."""
        return min(self.settings.quality.detail, self.full)

    def crop(self, detail: int) -> orbit.PanelCrop:
        """Return the camera to render with ``detail`` px along the view's shorter side, and the part shown."""
        return orbit.fit_to_panel(self.camera, *self.settings.panel, detail, self.settings.offset)
