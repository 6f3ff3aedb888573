"""CodeNeRF without a screen. An object is an instance: a model with codes; all else is a function of it.

Example:
    >>> import core
    >>> model = core.load_model("chairs")
    >>> mixed = model[3].with_texture(model[40])
    >>> core.render(mixed, core.camera_of(mixed, size=32)).shape
    (32, 32, 3)

The names are those of :mod:`core.api`, which is imported when one is first used: ``import core`` imports no torch.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from core.api import (
        Camera,
        Instance,
        Model,
        Photo,
        Scene,
        camera_of,
        export_mesh,
        fit,
        load_clip,
        load_model,
        load_photo,
        render,
        sized,
        write_page,
        write_video,
    )

__all__ = [
    "Camera",
    "Instance",
    "Model",
    "Photo",
    "Scene",
    "camera_of",
    "export_mesh",
    "fit",
    "load_clip",
    "load_model",
    "load_photo",
    "render",
    "sized",
    "write_page",
    "write_video",
]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module 'core' has no attribute {name!r}")
    from core import api

    return getattr(api, name)
