import lzma
import pickle
import struct
import zipfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

import pytest
from PIL import Image

from core.runtime.reading import open_image, open_zip, parse_json, read_json, read_numbers, read_text, reading, typed


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (RuntimeError("Failed to decode frame 0:\nplanes"), "unreadable (Failed to decode frame 0: planes)"),
        (EOFError(), "unreadable (EOFError)"),
        (lzma.LZMAError("Corrupt input data"), "unreadable (Corrupt input data)"),
        (RecursionError("maximum recursion depth"), "unreadable (nested too deeply)"),
        (Image.DecompressionBombError("900 px"), "unreadable (900 px)"),
        (NotImplementedError("Unknown pixel format"), "unreadable (Unknown pixel format)"),
        (struct.error("unpack requires 4 bytes"), "unreadable (unpack requires 4 bytes)"),
        (pickle.UnpicklingError("do those steps only if you trust"), "unreadable (it holds something"),
        (KeyError("camera"), "unreadable ('camera')"),
        (MemoryError(), "too large for this machine's memory"),
        (PermissionError(13, "Permission denied"), "cannot read"),
        (ValueError("the focal length is -1"), "the focal length is -1"),
    ],
)
def test_any_parser_error_becomes_one_line_that_names_the_file(error: Exception, message: str) -> None:
    with pytest.raises(ValueError) as raised, reading(Path("dir/a.bin"), "a thing"):
        raise error
    text = str(raised.value)
    assert message.replace("unreadable", "not a thing that can be read") in text
    assert "dir/a.bin" in text
    assert text.count("a.bin") == 1
    assert "\n" not in text
    assert raised.value.__cause__ is error


def test_errors_that_name_the_file_pass_and_web_addresses_are_explained() -> None:
    class OfItsOwnKind(ValueError):
        pass

    with pytest.raises(OfItsOwnKind), reading("a.bin"):
        raise OfItsOwnKind("a.bin: why")
    with pytest.raises(KeyboardInterrupt), reading("a.bin"):
        raise KeyboardInterrupt
    with (
        pytest.raises(ValueError, match="is an address: save an image from there"),
        reading(Path("https://example.org/chair.png"), "an image"),
    ):
        Path("https://example.org/chair.png").read_bytes()


def test_missing_files_are_named_and_text_may_have_a_byte_order_mark(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"no such scene: .*gone\.json"), reading(tmp_path / "gone.json", "a scene"):
        read_json(tmp_path / "gone.json")
    with pytest.raises(ValueError, match="is a folder, not a scene"), reading(tmp_path, "a scene"):
        read_json(tmp_path)
    (tmp_path / "a.txt").write_text("1 2e3\r\n-4", "utf-8-sig")
    assert read_numbers(tmp_path / "a.txt", 3) == (1.0, 2000.0, -4.0)
    assert read_text(tmp_path / "a.txt").startswith("1")
    with pytest.raises(ValueError, match="expected 4 numbers, got 3"):
        read_numbers(tmp_path / "a.txt", 4)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_json_of_any_program_is_read(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.json").write_text('{"name": "Stühle 椅子"}', encoding)
    assert read_json(tmp_path / "a.json") == {"name": "Stühle 椅子"}
    assert parse_json('\ufeff{"a": 1}') == {"a": 1}


def test_json_that_is_deep_or_large_is_refused() -> None:
    with pytest.raises(ValueError, match="nested too deeply"), reading("a.json"):
        parse_json("[" * 100_000)
    with pytest.raises(ValueError, match="at most 16 MB"):
        parse_json("0" * 17_000_000)


class Point(NamedTuple):
    x: float
    y: float = 2.0


@dataclass(frozen=True)
class Thing:
    name: str
    count: int
    points: tuple[Point, ...] = ()
    pair: tuple[int, bool] = (0, False)
    kind: Literal["a", "b"] = "a"
    path: Path | None = None
    sizes: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.count < 0:
            raise ValueError(f"count is {self.count}")


def test_json_becomes_values_of_their_types() -> None:
    entries = {
        "name": "n",
        "count": 128.0,
        "points": [{"x": 1}],
        "pair": [3.0, True],
        "kind": "b",
        "path": "p/q",
        "new": 1,
    }
    thing = typed(Thing, entries | {"sizes": {"a": 1}})
    assert thing == Thing("n", 128, (Point(1.0),), (3, True), "b", Path("p/q"), {"a": 1.0})
    assert type(thing.count) is int
    assert type(thing.points[0].x) is float
    assert typed(Thing, {"name": "n", "count": 1}) == Thing("n", 1)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"name": None}, "it.name must be a text, got None"),
        ({"count": 1.5}, "it.count must be a whole number, got 1.5"),
        ({"count": True}, "it.count must be a whole number, got True"),
        ({"count": float("nan")}, "it.count must be a whole number, got nan"),
        ({"count": -1}, "count is -1"),
        ({"points": [{}]}, "it.points[0].x is missing"),
        ({"points": [{"x": float("inf")}]}, "it.points[0].x must be a finite number, got inf"),
        ({"points": [{"x": 10**400}]}, "it.points[0].x must be a finite number"),
        ({"points": {}}, "it.points must be a list, got {}"),
        ({"pair": [1, 0]}, "it.pair[1] must be true or false, got 0"),
        ({"pair": [1]}, "it.pair has 2 parts, got 1"),
        ({"kind": "c"}, "it.kind must be one of a, b, got 'c'"),
        ({"path": 3}, "it.path must be a text, got 3"),
        ({"sizes": {"a": "b"}}, "it.sizes.a must be a finite number, got 'b'"),
    ],
)
def test_fields_of_the_wrong_type_are_named(wrong: dict, message: str) -> None:
    with pytest.raises(ValueError) as error:
        typed(Thing, {"name": "n", "count": 1} | wrong)
    assert message in str(error.value)


def test_zips_and_images_are_measured_before_they_are_decoded(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("zeros", bytes(2_000_000))
    with open_zip(tmp_path / "a.zip") as file:
        assert len(file.read("zeros")) == 2_000_000
    with pytest.raises(ValueError, match="more than"), open_zip(tmp_path / "a.zip", 1_000_000):
        pass
    path = tmp_path / "a.jpg"
    Image.new("RGB", (4000, 3000)).save(path, progressive=False)
    with pytest.raises(ValueError, match="too large"), open_image(path, limit=13_000_000):
        pass
    with open_image(path, side=1000, limit=13_000_000) as image:
        assert image.size == (2000, 1500)  # a JPEG is decoded at a part of its size
    Image.new("RGB", (4000, 3000)).save(path, progressive=True)
    with pytest.raises(ValueError, match="4000x3000 px"), open_image(path, side=1000, limit=30_000_000):
        pass  # but not a progressive one


@pytest.mark.parametrize("path", ["a.json", "d" * 300 + "/a.json"])
@pytest.mark.parametrize("named", [True, False])
def test_long_messages_are_shortened(path: str, named: bool) -> None:
    with pytest.raises(ValueError) as raised, reading(path):
        raise ValueError(f"{path if named else ''} begins {'x' * 5000} ends")
    assert len(str(raised.value)) <= max(200, len(path) + 100)
    assert "begins" in str(raised.value)
    assert str(raised.value).endswith("ends")
    assert path in str(raised.value)
