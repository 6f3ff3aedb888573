import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch

from core.geometry.camera import Camera
from core.geometry.pose_files import find_pose, read_pose, read_transforms, require_scale

CAMERA = Camera(0.7, 0.4, 1.5, 131.25, 128, 128)
OPENCV = CAMERA.pose().numpy()
OPENGL = OPENCV @ np.diag([1.0, -1.0, -1.0, 1.0])


def write(path: Path, matrix: np.ndarray) -> Path:
    path.write_text("\n".join(" ".join(map(str, row)) for row in matrix), "utf-8-sig")
    return path


def test_poses_of_srn_and_of_blender_are_read(tmp_path: Path) -> None:
    for axes, matrix in (("opencv", OPENCV), ("opengl", OPENGL)):
        pose = read_pose(write(tmp_path / "pose.txt", matrix), axes)
        torch.testing.assert_close(pose, torch.from_numpy(OPENCV), atol=1e-9, rtol=0)


@pytest.mark.parametrize(
    ("matrix", "axes", "message"),
    [
        (OPENGL, "opencv", "it is a pose in OpenGL axes"),
        (OPENCV, "opengl", "it is a pose in OpenCV axes"),
        (np.linalg.inv(OPENCV), "opencv", "it goes from world to camera;"),
        (np.linalg.inv(OPENGL), "opencv", "it goes from world to camera, in OpenGL axes"),
        (np.zeros((4, 4)), "opencv", "must not be at the origin"),
        (np.diag([1.0, 1, 1, 0]) + 1, "opencv", "does not look at the origin"),
    ],
)
def test_another_convention_is_recognised(tmp_path: Path, matrix: np.ndarray, axes: str, message: str) -> None:
    with pytest.raises(ValueError, match=rf"pose\.txt: .*{message}"):
        read_pose(write(tmp_path / "pose.txt", matrix), axes)


def write_transforms(folder: Path, matrices: dict[str, np.ndarray], **more: object) -> Path:
    frames = [{"file_path": name, "transform_matrix": matrix.tolist()} for name, matrix in matrices.items()]
    path = folder / "transforms_train.json"
    path.write_text(json.dumps({"camera_angle_x": 0.9, "frames": frames} | more))
    return path


def test_frames_of_nerf_synthetic_are_cameras(tmp_path: Path) -> None:
    wide = OPENGL.copy()
    wide[:3, 3] *= 3
    path = write_transforms(tmp_path, {"./train/r_0": wide, "train\\r_1.png": wide[:3]}, unknown=3)
    first, second = read_transforms(path, scale=1 / 3)
    assert (first.image, second.image) == (tmp_path / "train/r_0", tmp_path / "train/r_1.png")
    torch.testing.assert_close(first.pose, CAMERA.pose(), atol=1e-9, rtol=0)
    torch.testing.assert_close(second.pose, first.pose)
    camera = first.camera(200, 100)
    assert camera.distance == pytest.approx(1.5)
    assert 2 * math.atan(100 / camera.focal) == pytest.approx(0.9)
    (measured,) = read_transforms(write_transforms(tmp_path, {"a": wide}, camera_angle_x=None, fl_x=300, w=200))
    assert measured.focal == 1.5


def test_frames_are_looked_up_by_file_name_and_folder(tmp_path: Path) -> None:
    """A frame is found by its file's name, and by its folder if several have that name."""
    moved = Camera(0.2, 0.1, 1.5, 131.25, 128, 128).pose().numpy() @ np.diag([1.0, -1.0, -1.0, 1.0])
    path = write_transforms(tmp_path, {"./left/r_0": OPENGL, "./right/r_0": moved, "./right/r_1.png": moved})
    assert find_pose(path, tmp_path / "left/r_0.png").camera(9, 9).azimuth == pytest.approx(0.7)
    assert find_pose(path, tmp_path / "right/r_0.jpg").camera(9, 9).azimuth == pytest.approx(0.2)
    assert find_pose(path, Path("elsewhere/r_1.png")).camera(9, 9).azimuth == pytest.approx(0.2)
    for name, count in (("elsewhere/r_0.png", 2), ("r_2.png", 0), ("right/r_1.jpg", 0)):
        with pytest.raises(ValueError, match=rf"{count} frames are named {Path(name).name}; it has r_0, r_0, r_1.png"):
            find_pose(path, tmp_path / name)
    text = find_pose(write(tmp_path / "pose.txt", OPENGL), Path("a.png"), "opengl", 2.0)
    assert text.camera(128, 128, 131.25).distance == pytest.approx(3.0)
    assert text.camera(128, 128, 131.25).focal == 131.25


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"frames": []}, "no frames"),
        ({"camera_angle_x": 4.0}, "camera_angle_x 4 is not between 0 and 3.14"),
        ({"camera_angle_x": None}, "needs camera_angle_x"),
        ({"camera_angle_x": None, "camera_angle_y": 0.9}, "needs camera_angle_x"),
        (
            {"frames": [{"file_path": "a", "transform_matrix": np.vstack((OPENGL[:3], [0, 0, 0, 2])).tolist()}]},
            "a: the",
        ),
        ({"frames": [{"file_path": "a", "transform_matrix": [[1, 0, 0, 0]] * 2}]}, "3 or 4 rows, got 2"),
        ({"frames": [{"file_path": "a", "transform_matrix": [[1, 0, 0]] * 4}]}, "has 4 parts, got 3"),
        ({"frames": [{"file_path": "a", "transform_matrix": np.eye(4).tolist()}]}, "a: the camera of a pose must not"),
        ({"frames": [{"file_path": "a"}]}, "transform_matrix is missing"),
    ],
)
def test_broken_transforms_are_named(content: dict, message: str, tmp_path: Path) -> None:
    path = write_transforms(tmp_path, {"a": OPENGL}, **content)
    with pytest.raises(ValueError, match=rf"transforms_train\.json: .*{message}"):
        read_transforms(path)


def write_frames(folder: Path, common: dict, *intrinsics: dict) -> Path:
    """Frames whose only focal lengths are those given, each with the same pose."""
    frames = [{"file_path": f"r_{i}", "transform_matrix": OPENGL.tolist()} | lens for i, lens in enumerate(intrinsics)]
    path = folder / "transforms.json"
    path.write_text(json.dumps(common | {"frames": frames}))
    return path


@pytest.mark.parametrize(
    ("common", "lens", "focal"),
    [
        ({}, {"fl_x": 180, "fl_y": 180, "w": 200, "h": 200}, 0.9),
        ({"fl_x": 180, "w": 200}, {"fl_x": 270}, 1.35),
        ({"fl_x": 180, "fl_y": 180, "w": 200}, {"fl_x": 270, "w": 300}, 0.9),
        ({"camera_angle_x": 0.5}, {"fl_x": 270, "w": 200}, 1.35),
        ({"camera_angle_x": 0.5}, {"camera_angle_x": 2 * math.atan(0.5 / 1.35)}, 1.35),
        ({"fl_x": 180, "w": 200}, {"fl_x": None}, 0.9),
        ({"fl_x": 180, "fl_y": 180.5, "w": 200, "h": 100, "cx": 100.4, "cy": 49.9, "k1": 0, "p2": 0.0}, {}, 0.9),
        ({"fl_x": 180, "w": 200, "camera_model": "OPENCV", "is_fisheye": False}, {}, 0.9),
        ({"fl_x": 180, "w": 200, "camera_angle_x": 1.0141}, {}, 0.9),
        ({"fl_x": None, "w": 200, "h": 100}, {"camera_angle_y": 2 * math.atan(0.25 / 0.9)}, 0.9),
        ({"fl_x": 180, "w": 200, "distortion_params": [0.0] * 6}, {"camera_angle_y": 0.9}, 0.9),
    ],
)
def test_a_frame_has_the_focal_length_that_it_states(common: dict, lens: dict, focal: float, tmp_path: Path) -> None:
    first, second = read_transforms(write_frames(tmp_path, {"fl_x": 100, "w": 200} | common, lens, {"fl_x": 300}))
    assert first.focal == pytest.approx(focal, rel=1e-3)
    assert second.focal == 1.5


@pytest.mark.parametrize(
    ("intrinsics", "message"),
    [
        ({"cx": 110}, r"cx 110 is not the image's middle \(w is 200"),
        ({"h": 100, "cy": 30}, r"cy 30 is not the image's middle \(h is 100"),
        ({"cy": 100}, "h is missing"),
        ({"k1": -0.3}, "k1 = -0.3 distorts"),
        ({"p2": 0.02}, "p2 = 0.02 distorts"),
        ({"k4": 0.1}, "k4 = 0.1 distorts"),
        ({"camera_model": "OPENCV_FISHEYE"}, "camera_model OPENCV_FISHEYE is not read"),
        ({"camera_model": "EQUIRECTANGULAR"}, "camera_model EQUIRECTANGULAR is not read"),
        ({"is_fisheye": True}, "camera_model fisheye is not read"),
        ({"k5": 0.1}, "k5 = 0.1 distorts"),
        ({"distortion_params": [0, -0.3]}, "distortion_params = -0.3 distorts"),
        ({"fl_y": 270}, "fl_y says a focal length of 1.350 image widths, but fl_x 0.900"),
        ({"camera_angle_x": 0.5}, "fl_x says a focal length of 0.900 image widths, but camera_angle_x 1.958"),
        ({"camera_angle_y": 0.5, "h": 100}, "camera_angle_y says a focal length of 0.979"),
        ({"camera_angle_x": 50}, "camera_angle_x 50 is not between 0 and 3.14"),
        ({"camera_angle_x": 0.9, "w": None}, "fl_x needs w"),
        ({"camera_angle_x": 0.9, "fl_x": -180}, "fl_x -180 is not between 0 and inf"),
        ({"camera_angle_x": 0.9, "w": -200}, "w -200 is not between"),
        ({"fl_x": "wide"}, "fl_x must be a finite number"),
    ],
)
@pytest.mark.parametrize("in_frame", [False, True])
def test_other_lenses_are_refused_by_name(intrinsics: dict, message: str, in_frame: bool, tmp_path: Path) -> None:
    stated = {"fl_x": 180, "w": 200} | intrinsics
    path = write_frames(tmp_path, {} if in_frame else stated, stated if in_frame else {})
    with pytest.raises(ValueError, match=rf"transforms\.json: .*{message}"):
        read_transforms(path)


@pytest.mark.parametrize("stated", [{"w": 400, "h": 200}, {"camera_angle_x": 1.0141, "camera_angle_y": 0.5417}])
def test_an_image_of_other_proportions_than_its_pose_is_refused(stated: dict, tmp_path: Path) -> None:
    view, _ = read_transforms(write_frames(tmp_path, {"camera_angle_x": 1.0141} | stated, {}, {}))
    assert view.camera(100, 50).focal == view.camera(100, 51).focal == pytest.approx(90, rel=1e-3)
    for width, height in ((50, 100), (100, 60)):
        with pytest.raises(ValueError, match=r"height is \S+ of its width, but 0.500 by w and h of its pose"):
            view.camera(width, height)


@pytest.mark.parametrize("scale", [0.05, 0.3, 4.0])
def test_the_scale_that_fits_is_named(scale: float) -> None:
    """A disc as wide as a ball of radius 0.5 in the middle of the image."""
    y, x = np.mgrid[:128, :128] + 0.5 - 64
    camera = Camera(0.7, 0.4, 1.5 / scale, 131.25, 128, 128)
    disc = np.hypot(x, y) < 131.25 * math.tan(math.asin(0.5 / 1.5))
    require_scale([disc, np.zeros_like(disc)], [Camera(0.7, 0.4, 1.5, 131.25, 128, 128)] * 2)
    with pytest.raises(ValueError, match="scene units across instead of 1") as raised:
        require_scale([disc], [camera], 0.5)
    (named,) = re.findall(r"--pose-scale (\S+)", str(raised.value))
    assert float(named) == pytest.approx(0.5 * scale, rel=0.05)


def test_transforms_that_once_failed_are_read(shared: Path) -> None:
    first, *_ = read_transforms(shared / "failing/5/transforms_train.json")
    assert first.camera(100, 100).distance == pytest.approx(2.0)
    assert first.camera(100, 100).elevation == pytest.approx(0.0)
    image = shared / "failing/6/N25/img/r1.png"
    assert [find_pose(shared / f"failing/6/N25/t{i}.json", image).focal for i in range(3)] == [0.9, 0.9, 1.35]
    for i, name in ((3, "cx"), (4, "camera_model"), (5, "fl_y")):
        with pytest.raises(ValueError, match=f"img/r0.png: {name} "):
            find_pose(shared / f"failing/6/N25/t{i}.json", image)
