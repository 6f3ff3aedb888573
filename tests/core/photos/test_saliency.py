import importlib.util
import sys
from types import SimpleNamespace

import pytest
from PIL import Image

from core.photos.saliency import predict_saliency


def test_a_network_that_cannot_be_fetched_is_said_with_what_to_do(tmp_path, monkeypatch, caplog):
    def fetch(name: str) -> None:
        raise OSError("no route to host")

    monkeypatch.setenv("U2NET_HOME", str(tmp_path / "networks"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: SimpleNamespace(origin=str(tmp_path / "rembg/a.py")))
    monkeypatch.setitem(sys.modules, "rembg", SimpleNamespace(new_session=fetch))
    assert predict_saliency(Image.new("RGB", (31, 17), "red")) is None
    (said,) = caplog.messages
    assert said == (
        "objects are cut out without the saliency network: u2netp.onnx cannot be fetched; put it into "
        f"{tmp_path / 'networks'}"
    )


@pytest.mark.parametrize("size", [(1, 1), (40, 7)])
def test_opacity_has_the_size_of_the_image_and_lies_between_0_and_1(size):
    found = predict_saliency(Image.effect_noise(size, 60).convert("RGB"))
    assert found is not None
    assert found.shape == size[::-1]
    assert 0 <= found.min() <= found.max() <= 1
