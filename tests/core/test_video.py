import av
import pytest
from PIL import Image

from core.model import Model
from core.video import turntable


@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".webp"])
def test_a_turntable_is_a_video_of_that_many_frames(suffix: str, model: Model, tmp_path):
    path = tmp_path / f"turn{suffix}"
    counts = list(turntable(model, model.codes[0], model.camera(0.0, 0.3), path, 5, 31))
    assert counts == sorted(counts)
    assert set(counts) == {0, 1, 2, 3, 4, 5}
    if suffix == ".mp4":
        with av.open(str(path)) as video:
            assert video.streams.video[0].codec_context.name == "h264"
            shown = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
        assert (len(shown), shown[0].shape) == (5, (30, 30, 3))
        # The first frame and the third look at different sides.
        assert abs(shown[0].astype(int) - shown[2]).max() > 5
    else:
        with Image.open(path) as video:
            assert (video.n_frames, video.size) == (5, (31, 31))
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".webp"])
def test_a_cancelled_turntable_leaves_nothing_and_keeps_what_was_there(suffix: str, model: Model, tmp_path):
    path = tmp_path / f"turn{suffix}"
    path.write_text("before")
    stream = turntable(model, model.codes[0], model.camera(0.0, 0.3), path, 5, 32)
    next(stream)
    stream.close()
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]
    assert path.read_text() == "before"


def test_what_no_video_is_called_is_refused(model: Model, tmp_path):
    for path, says in ((tmp_path / "turn.avi", "mp4"), (tmp_path / "gone" / "turn.mp4", "cannot write")):
        with pytest.raises(ValueError, match=says):
            next(turntable(model, model.codes[0], model.camera(0.0, 0.3), path))
    with pytest.raises(ValueError, match="at least 1 frame"):
        next(turntable(model, model.codes[0], model.camera(0.0, 0.3), tmp_path / "t.gif", 0))
