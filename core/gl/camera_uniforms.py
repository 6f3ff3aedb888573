"""Uniforms of a camera, the same in every shader."""

from core.geometry.camera import Camera

_AXES = ("right", 1), ("up", -1), ("backward", -1)  # of the columns of a pose, which are right, down and forward


def camera_uniforms(camera: Camera) -> dict[str, tuple[float, ...]]:
    """Return the camera's position ``origin`` (scene units), and its unit axes ``right``, ``up`` and ``backward``."""
    pose = camera.pose().numpy()
    axes = {name: tuple(sign * pose[:3, column]) for column, (name, sign) in enumerate(_AXES)}
    return {"origin": tuple(pose[:3, 3])} | axes
