import ctypes
import resource
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from PIL import Image

from core.photos import saliency
from core.photos.saliency import predict_saliency
from core.runtime.networks import NETWORKS


def test_a_missing_or_damaged_network_gives_a_warning_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog):
    monkeypatch.setattr(saliency, "NETWORKS", tmp_path)
    assert predict_saliency(Image.new("RGB", (31, 17), "red")) is None
    (warning,) = caplog.messages
    assert warning.startswith("objects are cut out without the saliency network: u2netp.onnx is missing")
    (tmp_path / "u2netp.onnx").write_bytes(b"damaged")
    caplog.clear()
    assert predict_saliency(Image.new("RGB", (31, 17), "red")) is None
    (warning,) = caplog.messages
    assert "u2netp.onnx cannot be used" in warning


def test_the_map_is_the_stretched_output_for_standardised_colours():
    image = Image.effect_mandelbrot((320, 320), (-2, -1.5, 1, 1.5), 60).convert("RGB")
    values = np.asarray(image) / np.asarray(image).max()
    colours = ((values - (0.485, 0.456, 0.406)) / (0.229, 0.224, 0.225)).transpose(2, 0, 1)[None]
    session = onnxruntime.InferenceSession(str(NETWORKS / "u2netp.onnx"), providers=["CPUExecutionProvider"])
    (output, *_) = session.run(None, {session.get_inputs()[0].name: colours.astype(np.float32)})
    expected = (output[0, 0] - output.min()) / np.ptp(output[0, 0])
    np.testing.assert_allclose(predict_saliency(image), expected, atol=1 / 255 + 1e-3)


@pytest.mark.parametrize("size", [(1, 1), (40, 7)])
def test_opacity_has_the_size_of_the_image_and_lies_between_0_and_1(size):
    opacity = predict_saliency(Image.effect_noise(size, 60).convert("RGB"))
    assert opacity.shape == size[::-1]
    assert 0 <= opacity.min() <= opacity.max() <= 1


@pytest.mark.skipif(sys.platform != "linux", reason="asks Linux for the memory of this process")
def test_the_network_keeps_little_memory_from_one_image_to_the_next():
    def resident() -> float:
        """MB, once what is free is given back."""
        ctypes.CDLL("libc.so.6").malloc_trim(0)
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 1e6

    baseline = resident()
    for width in (40, 41, 42):
        assert predict_saliency(Image.effect_noise((width, 30), 60).convert("RGB")) is not None
    assert resident() - baseline < 200  # 500 with an arena for the next run
