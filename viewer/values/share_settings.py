"""Settings of the Share dialog, kept between launches."""

from dataclasses import dataclass, replace

from core.export import video
from core.export.dimensions import with_room
from core.export.films import View, morph, swing, turntable
from core.export.framing import filling_frame
from core.export.mesh import MeshSettings
from core.export.mesh_formats import FORMATS, TEXTURED, VARIED
from core.export.page import SUFFIX, first_camera
from core.export.surface import MAX_RESOLUTION
from core.export.video import WHITE, VideoSettings
from core.gl.background import Background, Gradient, Rgb
from core.models.model import Instance
from core.models.scene import IMAGE_FORMATS, OPAQUE_FORMATS, Scene

FILMS = {"swing": "Swing", "turntable": "Turn", "morph": "Morph"}  # labels of the films
KINDS = {"page": "Page", **dict.fromkeys(FILMS, "Film"), "picture": "Picture", "mesh": "Object"}  # labels
WIDE = 16 / 9  # width of a wide image over its height
RATE = 24  # frames per second of every video
DIMENSIONS = {"": "None", "cm": "Centimetres", "in": "Inches"}  # labels of the units of dimensions around the object
BACKGROUNDS = {"view": "As in the view", "white": "White", "colour": "Colour", "transparent": "Transparent"}
"""Labels of the backgrounds."""


@dataclass(frozen=True)
class ShareSettings:
    """Settings of a shared file. Raises ``ValueError`` for an unknown choice."""

    kind: str = "swing"  # one of :data:`KINDS`
    video: str = ".mp4"  # ending of a film's name
    picture: str = ".png"  # ending of an image's name
    mesh: str = ".glb"  # ending of a mesh's name
    size: int = 512  # px, height
    wide: bool = False  # 16:9, for cars; else square
    background: str = "view"  # one of :data:`BACKGROUNDS`
    colour: Rgb = WHITE  # of the background "colour"
    view_background: Gradient | None = None  # of the background "view"; None: white
    cells: int = 0  # cells of a mesh along the longest side; 0: as many as the detail needs
    texture: int = 1024  # px of a mesh's colour image; 0: colours per vertex
    triangles: int = 0  # limit of a mesh; 0: as many as the detail needs
    unit: str = ""  # of the dimensions on a page, a picture or a film's last frame, one of :data:`DIMENSIONS`
    all_versions: bool = False  # a page or a glb holds all colours of the object
    room: bool = False  # phones place the object of a page in a room

    def __post_init__(self) -> None:
        choices = (
            *((self.kind, KINDS), (self.background, BACKGROUNDS), (self.unit, DIMENSIONS)),
            *((self.video, video.FORMATS), (self.picture, IMAGE_FORMATS), (self.mesh, FORMATS)),
        )
        for value, among in choices:
            if value not in among:
                raise ValueError(f"choose one of {', '.join(among)}, not {value}")
        if not all(0 <= channel <= 255 for channel in self.colour):
            raise ValueError(f"a colour has parts of 0 to 255, got {self.colour}")
        if self.cells and not 8 <= self.cells <= MAX_RESOLUTION:
            raise ValueError(f"a mesh has 8 to {MAX_RESOLUTION} cells, got {self.cells}")
        if not 2 <= self.size <= 4096:
            raise ValueError(f"a file has 2 to 4096 px, got {self.size}")
        MeshSettings(None, None, self.texture, self.triangles)

    @property
    def suffix(self) -> str:
        """The ending of the file's name."""
        return {"page": SUFFIX, "picture": self.picture, "mesh": self.mesh}.get(self.kind, self.video)

    @property
    def holds_versions(self) -> bool:
        """True if the file can hold several colours of the object."""
        return self.kind == "page" or (self.kind == "mesh" and self.mesh in VARIED)

    @property
    def can_be_transparent(self) -> bool:
        """True if the format supports transparent pixels."""
        if self.kind == "picture":
            return self.picture not in OPAQUE_FORMATS
        return self.kind in FILMS and video.FORMATS[self.video].transparent

    @property
    def shows_shadow(self) -> bool:
        """True if the file gets the object's shadow on the ground."""
        if self.kind in FILMS:
            return video.FORMATS[self.video].shows_shadow(self.behind)
        return self.kind != "mesh"

    @property
    def behind(self) -> Background | None:
        """The background behind the object; None is transparent, white if the format cannot be transparent."""
        if self.kind == "page":
            return WHITE
        if self.background == "view":
            return self.view_background or WHITE
        if self.background == "colour":
            return self.colour
        return None if self.background == "transparent" and self.can_be_transparent else WHITE

    @property
    def video_settings(self) -> VideoSettings:
        """The settings for writing a video."""
        return VideoSettings(RATE, background=self.behind, shadow=self.shows_shadow, unit=self.unit)

    def mesh_settings(self, instance: Instance) -> MeshSettings:
        """Return the settings for writing an object as a mesh that stands on the ground, in metres.

        Unless it was sized, its longest side is that usual for its model.
        """
        metres = None if instance.is_sized else instance.model.metres
        texture = self.texture if self.mesh in TEXTURED else 0
        return MeshSettings(self.cells or None, metres, texture, self.triangles)

    def film_of(self, scene: Scene, partner: Instance | None) -> "ShareSettings":
        """Return the settings with a film that the object can have: the first one if it cannot have the chosen one."""
        films = films_of(scene, partner)
        return self if self.kind not in FILMS or self.kind in films else replace(self, kind=films[0])

    def views(self, scene: Scene, partner: Instance | None = None) -> list[View]:
        """Return the views to render, in order. Pages and films start at the photo's camera.

        A film's cameras share one zoom and start no nearer than the training distance. A page has its first view alone.

        Args:
            partner: the object that ``morph`` leads to and back from.
        """
        if self.kind == "page":
            first = first_camera(scene.instance, scene.photo_camera)
            return self._with_room([View(scene.instance, first.resized(self.size, self.size))])
        width = round(self.size * WIDE / 2) * 2 if self.wide else self.size
        shots = self._shots(scene, partner)
        resized = [shot._replace(camera=shot.camera.resized(width, self.size)) for shot in shots]
        return self._with_room(filling_frame(resized))

    def _with_room(self, views: list[View]) -> list[View]:
        """Return views that leave room for the dimensions, if they are to be shown."""
        return with_room(views) if self.unit and self.kind != "mesh" else views

    def _shots(self, scene: Scene, partner: Instance | None) -> list[View]:
        """Return the views of an image or of a film around the object, at the size of its camera."""
        if self.kind == "picture":
            return [View(scene.instance, scene.camera)]
        camera = scene.photo_camera
        camera = replace(camera, distance=max(scene.instance.model.distance, camera.distance))
        if self.kind == "morph" and partner is not None:
            return morph(scene.instance, partner, camera)
        return swing(scene.instance, camera) if self.kind == "swing" else turntable(scene.instance, camera)


def films_of(scene: Scene, partner: Instance | None) -> tuple[str, ...]:
    """Return the films that an object can have, the usual one first: a swing needs a photo, a morph a B."""
    missing = ("swing",) * (scene.instance.detail is None) + ("morph",) * (partner is None)
    return tuple(kind for kind in FILMS if kind not in missing)
