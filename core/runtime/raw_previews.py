"""The photo that a camera raw (DNG, NEF, ARW, CR2: a TIFF) holds as a JPEG beside the sensor's values.

Readers of TIFF see the first directory only, which is mostly a thumbnail of 160 px. The others are its sub-directories.
"""

from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO

from PIL import ExifTags, Image, TiffImagePlugin
from PIL.TiffImagePlugin import ImageFileDirectory_v2 as Directory
from PIL.TiffImagePlugin import TiffImageFile

RAW_SIZE = "raw size"  # in ``Image.info``: width and height in px of a camera raw of which only a preview is read
_MOST = 64  # directories of a file that are examined
_MOST_BYTES = 100_000_000  # of a preview
_STRIPS = TiffImagePlugin.STRIPOFFSETS, TiffImagePlugin.STRIPBYTECOUNTS
_JPEG = int(ExifTags.Base.JpegIFOffset), int(ExifTags.Base.JpegIFByteCount)
_MUCH_SMALLER = 0.5  # of the raw's width: a preview below is mentioned


def raw_preview(image: Image.Image) -> Image.Image:
    """Return the largest JPEG inside a camera raw, upright as the raw is; any other image itself.

    ``info[RAW_SIZE]`` of the result is the size of a raw that is much larger.
    """
    if not isinstance(image, TiffImageFile):
        return image
    directories = list(_directories(image))
    largest = max(map(_size, directories))
    if largest <= image.size and not _is_canon(image):
        return image
    previews = (_preview(image, directory) for directory in directories)
    best = max([*filter(None, previews), image], key=lambda preview: preview.width)
    if best is not image:
        orientation = image.getexif().get(ExifTags.Base.Orientation, 1)
        exif = best.getexif()
        exif[ExifTags.Base.Orientation] = exif.get(ExifTags.Base.Orientation, orientation)
        best.info["exif"] = exif.tobytes()
    if best.width < _MUCH_SMALLER * largest[0]:
        best.info[RAW_SIZE] = largest
    return best


def _is_canon(image: TiffImageFile) -> bool:
    """True for a CR2, whose previews and values follow each other like pages."""
    return _read(image, 8, 2) == b"CR"


def _read(image: TiffImageFile, offset: int, length: int) -> bytes:
    """Return bytes of the file."""
    assert image.fp is not None
    image.fp.seek(offset)
    return image.fp.read(min(length, _MOST_BYTES))


def _directories(image: TiffImageFile) -> Iterator[Directory]:
    """Yield the first directory of a TIFF and all below it, and those that follow in a CR2."""
    waiting = [image.tag_v2]
    canon = _is_canon(image)
    for _ in range(_MOST):
        if not waiting:
            return
        directory = waiting.pop(0)
        yield directory
        below = directory.get(TiffImagePlugin.SUBIFD, ())
        offsets = below if isinstance(below, tuple) else (below,)
        for offset in (*offsets, directory.next) if canon and directory.next else offsets:
            with suppress(Exception):  # a damaged one is as good as none
                subdirectory = Directory(_read(image, 0, 8))
                assert image.fp is not None
                image.fp.seek(offset)
                subdirectory.load(image.fp)
                waiting.append(subdirectory)


def _size(directory: Directory) -> tuple[int, int]:
    """Return width and height in px, as far as a directory tells."""
    sizes = (directory.get(tag, 0) for tag in (TiffImagePlugin.IMAGEWIDTH, TiffImagePlugin.IMAGELENGTH))
    width, height = (size if isinstance(size, int) else 0 for size in sizes)
    return width, height


def _preview(image: TiffImageFile, directory: Directory) -> Image.Image | None:
    """Return a directory's JPEG; None for the lossless ones that hold a sensor's values, and for other content."""
    for tags in (_JPEG, _STRIPS):
        with suppress(Exception):
            values = (directory[tag] for tag in tags)
            offset, count = (value[0] if isinstance(value, tuple) else value for value in values)
            return Image.open(BytesIO(_read(image, offset, count)), formats=("JPEG",))
    return None
