import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.camera import Camera
from core.metrics import MAX_PSNR, haze, psnr, rotation_error, silhouette_overlap, ssim, translation_error

angles = st.floats(-3.1, 3.1)
heights = st.floats(-1.55, 1.55)


def camera(azimuth: float, elevation: float, distance: float = 2.0) -> Camera:
    return Camera(azimuth, elevation, distance, 131.25, 128, 128)


def test_psnr_and_ssim_are_their_formulas():
    truth = torch.zeros(9, 9, 3)
    assert psnr(truth + 0.1, truth) == pytest.approx(20.0, abs=1e-5)
    assert psnr(truth, truth) == MAX_PSNR
    generator = torch.Generator().manual_seed(0)
    truth = torch.rand(16, 16, 3, generator=generator)
    assert ssim(truth, truth) == pytest.approx(1.0)
    assert ssim(1 - truth, truth) < 0
    assert ssim(truth.numpy(), truth.numpy()) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="7x7"):
        ssim(torch.zeros(6, 6, 3), torch.zeros(6, 6, 3))


def test_overlap_and_haze_count_pixels_by_opacity():
    opacity = np.array([[0.9, 0.6, 0.4, 0.0]])
    mask = np.array([[True, False, True, False]])
    assert silhouette_overlap(opacity, mask) == pytest.approx(1 / 3)
    assert silhouette_overlap(np.zeros((1, 4)), np.zeros((1, 4), bool)) == 1
    assert haze(np.array([[0.0, 1.0]])) == haze(np.zeros((1, 2))) == 0
    assert haze(np.array([[1.0, 0.5]])) == pytest.approx(2 / 3)


@pytest.mark.parametrize("measure", [psnr, ssim])
def test_images_of_different_sizes_are_refused(measure):
    with pytest.raises(ValueError, match="different sizes"):
        measure(np.zeros((8, 8, 3)), np.zeros((8, 9, 3)))


@given(angles, heights, st.floats(-2, 2))
def test_the_error_of_a_turn_about_the_axis_is_its_angle(azimuth: float, elevation: float, turn: float):
    error = rotation_error(camera(azimuth, elevation), camera(azimuth + turn, elevation))
    assert error == pytest.approx(abs(math.degrees(turn)), abs=1e-4)


@given(angles, heights, angles, heights)
def test_rotation_error_is_the_angle_of_the_trace(a: float, b: float, c: float, d: float):
    first = camera(a, b)
    second = camera(c, d)
    trace = torch.trace(first.pose()[:3, :3] @ second.pose()[:3, :3].T)
    expected = math.degrees(math.acos(max(-1.0, min(1.0, (float(trace) - 1) / 2))))
    assert rotation_error(first, second) == pytest.approx(expected, abs=1e-3)


def test_camera_errors_are_exact_when_small_at_poles_and_far():
    assert rotation_error(camera(1.0, 0.5), camera(1.0, 0.5 + 1e-7)) == pytest.approx(math.degrees(1e-7), rel=1e-3)
    assert translation_error(camera(1.0, 0.5), camera(1.0, 0.5 + 1e-7)) == pytest.approx(1e-7, rel=1e-3)
    above, turned = (camera(azimuth, math.pi / 2) for azimuth in (0.0, math.pi / 2))
    assert rotation_error(above, turned) == pytest.approx(90.0)
    assert translation_error(above, turned) == pytest.approx(0.0, abs=1e-6)
    assert translation_error(camera(0.4, 0.2, 1.9), camera(0.4, 0.2, 2.0)) == pytest.approx(0.05)
    assert translation_error(camera(0.0, 0.0), camera(math.pi, 0.0)) == pytest.approx(2.0)
