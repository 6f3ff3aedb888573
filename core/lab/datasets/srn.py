"""Datasets on disk: ``DATASET/OBJECT/...`` in the layout of ShapeNet-SRN or of NeRF-synthetic.

An object in SRN's layout is ``{rgb/000000.png, pose/000000.txt, intrinsics.txt}``; in NeRF's, a ``transforms.json`` or
``transforms_train.json`` with the images that it names. Its folder, or the file, may also stand for a dataset. Two
optional additions: ``OBJECT/mask/000000.png`` (255 inside the object, SRN's layout only), and ``DATASET/manifest.json``
with the category and the objects that share a shape or a texture. A pack (:mod:`core.lab.datasets.packs`) is read like
the folder that it was made from.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, UInt8
from PIL import Image

from core.geometry.camera import Camera
from core.geometry.pose_files import PosedImage, read_pose, read_transforms, require_scale, scaled
from core.lab.datasets.packs import PackedObject, index_pack, is_pack, read_packed, write_pack
from core.photos.decode import IMAGE_SUFFIXES, image_files, is_junk
from core.runtime.files import atomic_folder, write_json
from core.runtime.numbers import number, whole
from core.runtime.reading import open_image, read_json, read_text, reading, typed

_TRANSFORMS = "transforms_train.json", "transforms.json", "transforms_test.json", "transforms_val.json"
"""Files of an object in NeRF's layout; the first that exists is read."""
_Item = TypeVar("_Item")
_WHITE_LEVEL = 253  # Background threshold of all channels, for images without a mask; saving again changes 1-2 levels


@dataclass(frozen=True)
class ObjectViews:
    """One object's images and their cameras. Raises ``ValueError`` for values that do not match."""

    name: str
    shape_id: str  # objects with the same shape_id have one geometry
    texture_id: str  # objects with the same texture_id have the same colours
    images: UInt8[np.ndarray, "views height width 3"]  # on white
    masks: Bool[np.ndarray, "views height width"]  # True on the object
    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        if self.images.ndim != 4 or self.images.shape[-1] != 3 or self.images.dtype != np.uint8:
            raise ValueError(f"{self.name}: images must be uint8 [views, height, width, 3], got {self.images.shape}")
        if self.masks.shape != self.images.shape[:3] or self.masks.dtype != np.bool_:
            raise ValueError(f"{self.name}: masks {self.masks.shape} do not fit images {self.images.shape}")
        if len(self.cameras) != len(self.images) or not self.cameras:
            raise ValueError(f"{self.name}: {len(self.cameras)} cameras for {len(self.images)} images")
        height, width = self.images.shape[1:3]
        if any((camera.width, camera.height) != (width, height) for camera in self.cameras):
            raise ValueError(f"{self.name}: the cameras' size is not the images' {width}x{height}")

    def reduced(self, size: int) -> "ObjectViews":
        """Return the views at ``size`` px, by means of areas; itself where they are no larger."""
        import cv2  # loaded only where views are reduced

        if max(self.images.shape[1:3]) <= size:
            return self
        images = np.stack([cv2.resize(image, (size, size), interpolation=cv2.INTER_AREA) for image in self.images])
        masks = [cv2.resize(mask.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA) for mask in self.masks]
        cameras = tuple(camera.resized(size, size) for camera in self.cameras)
        return replace(self, images=images, masks=np.stack(masks) > 0.5, cameras=cameras)


@dataclass(frozen=True)
class Dataset:
    """Objects of one category with the same square image size and focal length."""

    objects: tuple[ObjectViews, ...]
    category: str  # '' if the files do not say
    image_size: int  # px, width and height
    focal: float  # px, at image_size
    weights: tuple[float, ...] = ()  # relative frequency of each object's training rays; uniform if empty


class _Identity(NamedTuple):
    shape_id: str
    texture_id: str


class _Manifest(NamedTuple):
    category: str = ""
    objects: dict[str, _Identity] = {}  # noqa: RUF012  (never written to)


@dataclass(frozen=True)
class ObjectEntry:
    """An object of a dataset that is read on demand: a test set need not fit into memory."""

    name: str
    shape_id: str
    texture_id: str
    folder: Path  # or its transforms.json; in a pack, the pack's path and the object's name
    scale: float = 1.0  # scene units of a unit of its poses

    def read(self) -> ObjectViews:
        """Read the object's images. Raises ``ValueError`` naming a missing, broken or contradictory file."""
        if is_pack(self.folder.parent):
            return ObjectViews(*read_packed(self.folder.parent, self.name, self.scale))
        file = _transforms(self.folder)
        views = _nerf_views(file) if file else _srn_views(self.folder)
        images, masks = zip(*(_read_image(view.image, view.mask) for view in views), strict=True)
        height, width = images[0].shape[:2]
        for view, image in zip(views, images, strict=True):
            if image.shape != (height, width, 3):
                raise ValueError(f"{view.image}: its size is not the {width}x{height} of the object's other images")
        rescaled = (view._replace(pose=scaled(view.pose, self.scale)) for view in views)
        with reading(file or self.folder, "an object"):
            cameras = tuple(view.camera(width, height) for view in rescaled)
            if file:  # SRN's poses are in a model's units
                require_scale(masks, cameras, self.scale)
        return ObjectViews(self.name, self.shape_id, self.texture_id, np.stack(images), np.stack(masks), cameras)


def evenly_spaced(items: Sequence[_Item], count: int | None) -> tuple[_Item, ...]:
    """Return ``count`` evenly spaced items, or all if ``count`` is None or larger.

    Example:
        >>> evenly_spaced("abcdef", 3)
        ('a', 'c', 'e')
    """
    count = len(items) if count is None else min(count, len(items))
    return tuple(items[index * len(items) // count] for index in range(count))


def index_objects(folders: Sequence[Path | str], scale: float = 1.0) -> tuple[str, tuple[ObjectEntry, ...]]:
    """Return the category ('' if unknown) and the objects of dataset folders, by folder, then by name.

    ``scale``: scene units of a unit of the poses. Raises ``ValueError`` naming the folder if it is empty, or if
    categories or names clash.
    """
    categories = set[str]()
    entries = list[ObjectEntry]()
    for folder in map(Path, folders):
        category, folder_entries = _index_folder(folder)
        categories |= {category} - {""}
        entries += [replace(entry, scale=scale) for entry in folder_entries]
    if len(categories) > 1:
        raise ValueError(f"the folders hold different categories: {', '.join(sorted(categories))}")
    counts = Counter(entry.name for entry in entries)
    twice = next((name for name, count in counts.items() if count > 1), None)
    if twice:
        raise ValueError(f"{twice}: two dataset folders contain an object of this name")
    return "".join(categories), tuple(entries)


def read_dataset(
    folders: Path | str | Sequence[Path | str], shares: Sequence[float] = (), scale: float = 1.0
) -> Dataset:
    """Read one dataset folder, or several as one dataset, as :func:`index_objects` lists their objects.

    ``shares``: fraction of training rays for each folder; by default in proportion to its objects. Raises
    ``ValueError`` naming any missing, broken or contradictory file.
    """
    folders = [folders] if isinstance(folders, str | Path) else folders
    category, entries = index_objects(folders, scale)
    if not entries:
        raise ValueError("no dataset folder was given")
    # Decoding a PNG releases the interpreter lock, so threads suffice.
    with ThreadPoolExecutor() as pool:
        objects = tuple(pool.map(ObjectEntry.read, entries))
    _check_sizes(objects)
    camera = objects[0].cameras[0]
    if shares and (len(shares) != len(folders) or min(shares) <= 0):
        raise ValueError(f"{len(folders)} datasets need as many positive shares, got {list(shares)}")
    weights = tuple[float, ...]()
    if shares:
        counts = [len(_index_folder(Path(folder))[1]) for folder in folders]
        weights = tuple(share / count for share, count in zip(shares, counts, strict=True) for _ in range(count))
    return Dataset(objects, category, camera.height, camera.focal, weights)


def pack_datasets(folders: Sequence[Path | str], path: Path, size: int | None, quality: int) -> Iterator[str]:
    """Write dataset folders into one pack (:func:`core.lab.datasets.packs.write_pack`), yielding each object's name.

    Images larger than ``size`` px are reduced to it. Raises ``ValueError`` as :func:`read_dataset`.
    """
    category, entries = index_objects(folders)

    def objects() -> Iterator[PackedObject]:
        first: ObjectViews | None = None
        for entry in entries:
            views = entry.read()
            views = views.reduced(size) if size else views
            first = first or views
            _check_sizes((first, views))
            yield PackedObject(*(getattr(views, name) for name in PackedObject._fields))

    yield from write_pack(path, category, objects(), quality)


def write_object(folder: Path | str, views: ObjectViews) -> None:
    """Write ``folder/NAME/...``, replacing existing files.

    A folder appears only when complete, so a stopped job can resume.
    """
    target = Path(folder) / views.name
    target.parent.mkdir(parents=True, exist_ok=True)
    with atomic_folder(target, replace=True) as partial:
        for kind in ("rgb", "pose", "mask"):
            (partial / kind).mkdir()
        for i, (image, mask, camera) in enumerate(zip(views.images, views.masks, views.cameras, strict=True)):
            Image.fromarray(image).save(partial / f"rgb/{i:06d}.png", compress_level=4)
            Image.fromarray(mask.astype(np.uint8) * 255).save(partial / f"mask/{i:06d}.png", compress_level=4)
            numbers = " ".join(f"{value:.12g}" for value in camera.pose().flatten().tolist())
            (partial / f"pose/{i:06d}.txt").write_text(numbers + "\n")
        camera = views.cameras[0]
        intrinsics = f"{camera.focal:.9g} {camera.width / 2:.9g} {camera.height / 2:.9g} 0."
        (partial / "intrinsics.txt").write_text(f"{intrinsics}\n0. 0. 0.\n1.\n{camera.height} {camera.width}\n")


def write_manifest(folder: Path | str, category: str, identities: Mapping[str, tuple[str, str]]) -> None:
    """Write ``manifest.json``: the category and each object's (shape_id, texture_id).

    May name objects that do not exist yet, so it can be written before the images.
    """
    objects = {name: {"shape_id": shape, "texture_id": texture} for name, (shape, texture) in identities.items()}
    Path(folder).mkdir(parents=True, exist_ok=True)
    write_json(Path(folder) / "manifest.json", {"category": category, "objects": objects})


def _index_folder(folder: Path) -> tuple[str, list[ObjectEntry]]:
    """Return the category and the objects of one dataset folder.

    Without a manifest, objects share neither shape nor texture (the paper's setting).
    """
    if is_pack(folder):
        category, packed = index_pack(folder)
        return category, [ObjectEntry(*entry[:3], folder / entry.name) for entry in packed]
    category, identities = _read_manifest(folder / "manifest.json")
    if _transforms(folder):
        name = (folder if folder.is_dir() else folder.parent).resolve().name
        return category, [ObjectEntry(name, name, name, folder)]
    if not folder.is_dir():
        raise ValueError(f"{folder}: no such dataset folder")
    paths = sorted(path for path in folder.iterdir() if path.is_dir() and not is_junk(path))
    if not paths:
        raise ValueError(f"{folder}: no object folders in it")
    return category, [
        ObjectEntry(path.resolve().name, *identities.get(path.name, (path.name, path.name)), path) for path in paths
    ]


def _transforms(folder: Path) -> Path | None:
    """Return the file of an object's cameras in NeRF's layout, or None; ``folder`` may be that file."""
    files = [folder / name for name in _TRANSFORMS] if folder.is_dir() else [folder]
    return next((file for file in files if file.is_file() and file.suffix.lower() == ".json"), None)


def _read_manifest(path: Path) -> _Manifest:
    """Return a dataset's manifest; an empty one if there is no file."""
    if not path.exists():
        return _Manifest()
    with reading(path, "a manifest"):
        return typed(_Manifest, read_json(path), name="manifest")


def _srn_views(folder: Path) -> list[PosedImage]:
    """Return the images of an object in SRN's layout, with their cameras."""
    paths = image_files(folder / "rgb")
    masks = {path.stem: path for path in image_files(folder / "mask")}
    if not paths:
        raise ValueError(f"{folder / 'rgb'}: no images ({', '.join(IMAGE_SUFFIXES)})")
    poses = {pose.stem: pose for pose in (folder / "pose").glob("*.txt") if not is_junk(pose)}
    if set(poses) != {path.stem for path in paths}:
        raise ValueError(f"{folder / 'pose'}: {len(poses)} poses do not match the {len(paths)} images by name")
    focal = _read_intrinsics(folder / "intrinsics.txt")
    return [PosedImage(path, read_pose(poses[path.stem]), focal, masks.get(path.stem)) for path in paths]


def _nerf_views(file: Path) -> list[PosedImage]:
    """Return the images that a transforms.json names, mostly without their ending, with their cameras."""
    views = []
    for view in read_transforms(file):
        names = (view.image, *(view.image.with_name(f"{view.image.name}{suffix}") for suffix in IMAGE_SUFFIXES))
        path = next(filter(Path.is_file, names), None)
        if path is None:
            raise ValueError(f"{file}: there is no image {view.image}")
        views.append(view._replace(image=path))
    return views


def _read_intrinsics(path: Path) -> float:
    """Return the focal length in image widths."""
    with reading(path, "a file of SRN intrinsics"):
        lines = [line.split() for line in read_text(path).splitlines() if line.strip()]
        focal = number(float(lines[0][0]))
        width = whole(float(lines[-1][-1]))  # the last line: height, width
        if focal <= 0 or width < 1:
            raise ValueError(f"focal length and width must be positive, got {focal} and {width}")
        return focal / width


def _read_image(
    path: Path, mask_path: Path | None
) -> tuple[UInt8[np.ndarray, "height width 3"], Bool[np.ndarray, "height width"]]:
    """Composite an image over white and find its mask: the mask file, else alpha, else pixels that are not white."""
    with reading(path, "an image"):
        with open_image(path) as opened:
            rgba = np.asarray(opened.convert("RGBA"))
        alpha = rgba[..., 3:]
        image = rgba[..., :3]
        clear = bool((alpha < 255).any())
        if clear:
            opacity = alpha.astype(np.float32) / 255
            image = (image * opacity + 255 * (1 - opacity) + 0.5).astype(np.uint8)
        if mask_path:
            with reading(mask_path, "an image"), open_image(mask_path) as opened:
                mask = np.asarray(opened.convert("L")) > 127
        else:
            mask = alpha[..., 0] > 127 if clear else image.min(-1) < _WHITE_LEVEL
    if mask.shape != image.shape[:2]:
        raise ValueError(f"{mask_path}: its size {mask.shape} is not the image's {image.shape[:2]}")
    return np.ascontiguousarray(image), mask


def _check_sizes(objects: Sequence[ObjectViews]) -> None:
    """Raise ``ValueError`` unless all images are square and share size and focal length."""
    first = objects[0].cameras[0]
    if first.width != first.height:
        raise ValueError(f"{objects[0].name}: images must be square, got {first.width}x{first.height}")
    for views in objects:
        camera = views.cameras[0]
        if (camera.width, camera.height) != (first.width, first.height):
            size = f"{camera.width}x{camera.height}"
            raise ValueError(f"{views.name}: images of {size} among others of {first.width}x{first.height}")
        if abs(camera.focal - first.focal) > 1e-3 * first.focal:
            raise ValueError(f"{views.name}: focal length {camera.focal} among others of {first.focal}")
