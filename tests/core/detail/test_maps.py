"""Photo detail of a tiny model: its photo is a render with a stripe that no code can express."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from core.detail.lookup import ColourMatch, DetailMaps, PhotoMaps, packed
from core.detail.maps import ComparedPhoto, detail_maps, paint_weight
from core.detail.mixture import PhotoPaints
from core.detail.progressive import Frame, RenderJob, RenderSettings, render_frame, render_progressively
from core.detail.surface import SurfaceTexels, surface_normals
from core.edits.bend import Bend
from core.edits.edit import Edit
from core.edits.paint import PartPaint
from core.edits.stretch import Stretch
from core.geometry.camera import Camera
from core.geometry.pixels import to_bytes
from core.geometry.rays import Rays, camera_rays
from core.gl.baking import bake
from core.metrics import psnr
from core.models.model import Instance, Model
from core.models.motion import FOLLOWED, moved_along
from core.models.part_head import PartHead
from core.models.photo_detail import Erasure, OtherSide, PhotoDetail, PhotoView
from core.rendering.fast import clear_cache
from core.rendering.outline import FADED, effective_strength
from core.rendering.reference import Rendered, render_exact
from core.streams import run_to_end
from tests.conftest import offscreen
from tests.core.baked_reference import render_baked

SIZE = 192
BEND = Bend(-0.35, -0.02, 0.1, 0.35)
SIDES: tuple[OtherSide, ...] = "mirrored", "model"


def striped(model: Model, camera: Camera) -> Instance:
    """An object whose photo has a dark stripe across it."""
    instance = model[0]
    rendered = render_exact(instance, camera, 96)
    colour = rendered.colour.clamp(0, 1).clone()
    rows = slice(int(0.50 * SIZE), int(0.54 * SIZE))
    colour[rows] = torch.lerp(colour[rows], torch.tensor([0.1, 0.1, 0.6]), rendered.opacity[rows, :, None])
    rgba = to_bytes(torch.cat((colour, rendered.opacity[..., None]), -1))
    view = PhotoView.of(rgba, camera)
    return instance.changed(detail=PhotoDetail((view,), instance.codes.shape, instance.codes.texture))


@pytest.fixture(scope="module")
def camera(tiny: Model) -> Camera:
    return tiny.camera(1.1, 0.3).resized(SIZE, SIZE)


@pytest.fixture(scope="module")
def instance(tiny: Model, camera: Camera) -> Instance:
    return striped(tiny, camera)


def image(instance: Instance, camera: Camera) -> np.ndarray:
    """A finished frame's pixels, 0..1."""
    return render_frame(instance, camera).image / 255


def test_the_photos_own_view_shows_the_photo(instance: Instance, camera: Camera) -> None:
    photo = instance.detail.views[0].pixels()[..., :3] / 255
    assert psnr(image(instance, camera), photo) > psnr(image(instance.with_detail(None), camera), photo) + 4


def test_each_of_two_photos_is_shown_from_its_own_camera(tiny: Model, instance: Instance, camera: Camera) -> None:
    second_camera = tiny.camera(2.6, 0.3).resized(SIZE, SIZE)
    views = (*instance.detail.views, *striped(tiny, second_camera).detail.views)
    detailed = instance.changed(detail=replace(instance.detail, views=views))
    for view, own_camera in zip(views, (camera, second_camera), strict=True):
        photo = view.pixels()[..., :3] / 255
        plain = image(instance.with_detail(None), own_camera)
        assert psnr(image(detailed, own_camera), photo) > psnr(plain, photo) + 4


def test_erased_places_have_the_models_colours(instance: Instance, camera: Camera) -> None:
    erasing = instance.detail.erasing(0, (Erasure(((0.0, 0.52), (1.0, 0.52)), 0.06),))
    plain, detailed, erased = (
        image(instance.with_detail(detail), camera)[int(0.47 * SIZE) : int(0.57 * SIZE)]
        for detail in (None, instance.detail, erasing)
    )
    assert np.abs(detailed - plain).max() > 40 / 255
    assert np.abs(erased - plain).max() < 2.5 / 255


def test_photo_detail_changes_neither_opacity_nor_depth(tiny: Model, instance: Instance) -> None:
    camera = tiny.camera(1.5, 0.5).resized(72, 96)
    plain = render_frame(instance.with_detail(None), camera)
    detailed = render_frame(instance, camera)
    assert (plain.image != detailed.image).any()
    assert np.array_equal(plain.opacity, detailed.opacity) and np.array_equal(plain.depth, detailed.depth)


def test_the_other_side_is_mirrored_or_the_models(tiny: Model, instance: Instance) -> None:
    behind = tiny.camera(np.pi - 1.1, 0.3).resized(SIZE, SIZE)
    frames = [render_frame(instance.with_detail(replace(instance.detail, other_side=side)), behind) for side in SIDES]
    mirrored_light, unmirrored_light = (frame.sources[..., 1].sum() for frame in frames if frame.sources is not None)
    assert mirrored_light > unmirrored_light == 0
    assert (frames[0].image != frames[1].image).any()


def lettered(maps: DetailMaps) -> DetailMaps:
    """The maps with inverted colours in the mirrored photo, as if it had paint in place of lettering."""
    photos = []
    for photo in maps.photos:
        mirrored = tuple(torch.cat((1 - level[:3], level[3:])) for level in photo.fine)
        photos.append(replace(photo, mirrored=mirrored))
    return replace(maps, photos=tuple(photos))


def test_paint_in_place_of_lettering_is_on_the_mirrored_side_only(
    tiny: Model, instance: Instance, camera: Camera
) -> None:
    maps = run_to_end(detail_maps(instance))
    assert maps is not None and maps.photos[0].mirrored is maps.photos[0].fine
    behind = tiny.camera(np.pi - 1.1, 0.3).resized(64, 64)
    for view, minimum, maximum in ((camera, 0, 0.0005), (behind, 0.003, 1)):
        rendered = render_exact(instance, view)
        plain, covered = (detail.added(rendered, view)[0].colour for detail in (maps, lettered(maps)))
        assert minimum <= (plain - covered).abs().mean() <= maximum


def test_frames_hold_the_sources_of_colours(tiny: Model, instance: Instance, camera: Camera) -> None:
    front = render_frame(instance, camera)
    behind = render_frame(instance, tiny.camera(np.pi - 1.1, 0.3).resized(64, 64))
    for frame in (front, behind):
        assert frame.sources is not None and frame.sources.shape == (*frame.opacity.shape, 2)
        assert frame.sources.min() >= 0 and (frame.sources.sum(-1) <= frame.opacity + 1e-5).all()
    assert front.sources[..., 0].mean() > behind.sources[..., 0].mean()
    assert behind.sources[..., 1].mean() > front.sources[..., 1].mean()
    assert render_frame(instance.with_detail(None), camera).sources is None


def test_the_stripe_turns_with_the_surface(tiny: Model, instance: Instance) -> None:
    """From 30 degrees beside the photo, the stripe darkens the same surface points."""
    camera = tiny.camera(1.1 + 0.5, 0.3).resized(SIZE, SIZE)
    plain = render_frame(instance.with_detail(None), camera)
    detailed = render_frame(instance, camera)
    darker = torch.from_numpy(plain.image[..., 0].astype(int) - detailed.image[..., 0] > 25)
    assert darker.sum() > 60
    rays = camera_rays(camera, tiny.extent_tensor)
    points = (rays.origins + rays.directions * torch.from_numpy(detailed.depth)[..., None])[darker]
    rows = instance.detail.views[0].camera.project(points)[:, 1] / instance.detail.views[0].camera.height
    assert float(((rows - 0.52 + 0.02).abs() < 0.05).float().mean()) > 0.8


def test_photo_detail_fades_with_edits_of_the_shape(tiny: Model, instance: Instance) -> None:
    """Photo detail moves with the surface along directions, so only a code farther away counts."""
    step = tiny.codes.shape_space.basis[0]
    strengths = [
        effective_strength(instance.moved("shape", (FOLLOWED + 2**0.5 * distance) * step))
        for distance in (0.0, FADED / 2, FADED, 2 * FADED)
    ]
    assert strengths == pytest.approx([1.0, 0.5, 0.0, 0.0], abs=1e-4)


def test_every_stage_shows_photo_detail(instance: Instance, camera: Camera) -> None:
    def stages(rendered: Instance) -> list[Frame]:
        clear_cache()
        job = RenderJob(rendered, camera, RenderSettings(divisors=(2, 1, 1)))
        return list(filter(None, render_progressively(job)))

    detailed = stages(instance)
    plain = stages(instance.with_detail(None))
    assert len(detailed) == 3
    assert all((first.image != second.image).any() for first, second in zip(detailed, plain, strict=True))


@pytest.mark.parametrize(
    ("azimuth", "covers", "edited", "size"),
    [
        (1.4, False, False, ()),
        (1.4, False, True, ()),
        (1.2, False, False, (Stretch((1.5, 1.0, 0.8)),)),
        (1.2, False, True, (BEND, Stretch((1.0, 1.0, 1.2)))),
        (np.pi - 1.1, False, False, (BEND,)),
        (np.pi - 1.1, False, False, ()),
        (np.pi - 1.1, True, False, ()),
    ],
)
def test_opengl_and_the_processor_draw_the_same_photo_detail(
    tiny: Model, instance: Instance, azimuth: float, covers: bool, edited: bool, size: tuple[Edit, ...]
) -> None:
    instance = moved_along(instance, 0, 9.0) if edited else instance
    instance = instance.changed(edits=(*instance.codes.edits, *size))
    *_, shadowed = filter(None, bake(instance))
    assert shadowed.detail is not None and len(shadowed.detail.edits) == edited + (BEND in size)
    baked = replace(shadowed, shadow=None)
    if covers:
        baked = replace(baked, detail=lettered(baked.detail))
    view = tiny.camera(azimuth, 0.4).resized(96, 96)
    with offscreen((96, 96)) as pictures:
        drawn, bare = (pictures.draw(field, view) / 255 for field in (baked, replace(baked, detail=None)))
    looked_up = render_baked(baked, view).colour.numpy()
    change = np.abs(drawn - bare).mean()
    assert change > 0.001
    assert np.abs(drawn - looked_up).mean() < change / 4


def test_the_paint_of_a_part_changes_evenly_and_everything_else_keeps_the_photos_colour(
    tiny: Model, camera: Camera
) -> None:
    """The left half of a photo is the seat, whose grey paint is in its upper half."""
    weight = torch.zeros(2, tiny.field.config.width)
    weight[0, 0] = 1000.0
    chair = replace(tiny, part_head=PartHead(("seat", "legs"), weight, torch.tensor([-500.0, 0.0])))[0]
    photo = torch.linspace(0.3, 0.6, 64).expand(3, 64, 64)
    features = torch.zeros(64, 64, tiny.field.config.width)
    features[:, :32, 0] = 1.0
    full = torch.ones(64, 64)
    texels = SurfaceTexels(full > 0, features.flatten(0, 1), torch.tensor([1.0, 0.0, 0.0]).expand(64 * 64, 3))
    shares = torch.zeros(2, 64, 64)
    shares[0, :32, :32] = 1.0
    paints = PhotoPaints(("seat", "legs"), torch.full((2, 3), 0.5), shares)
    compared = ComparedPhoto(
        *(camera, chair, photo, photo, full, full, paints),
        *(torch.zeros(64, 64), torch.zeros(4, 64, 64), texels, ColourMatch()),
    )
    assert torch.equal(compared.painted(chair), photo)
    red = PartPaint("seat", (0.8, 0.1, 0.1), (0.5, 0.5, 0.5))
    painted = compared.painted(chair.with_edits(PartPaint, red))
    hue = painted / painted.sum(0)
    assert (hue[:, :32, :32] - torch.tensor([0.8, 0.1, 0.1])[:, None, None]).abs().max() < 1e-5
    moved = compared.painted(chair.with_texture(tiny[1]))
    assert (moved - photo)[:, :32, :32].abs().mean() > 0.005
    for changed in (painted, moved):
        assert torch.equal(changed[:, 32:], photo[:, 32:]) and torch.equal(changed[:, :, 32:], photo[:, :, 32:])


def test_a_ball_has_the_normals_of_a_ball() -> None:
    camera = Camera(0.4, 0.3, 2.0, 500.0, 256, 256)
    rays, rendered = ball(camera)
    points = rays.origins + rays.directions * rendered.depth[..., None]
    normals = surface_normals(rays, rendered)
    inside = points.norm(dim=-1) < 0.401
    cosine = (normals * points / 0.4).sum(-1)
    middle = inside & (-(normals * rays.directions).sum(-1) > 0.6)
    assert float(cosine[middle].min()) > 0.98


def ball(camera: Camera, radius: float = 0.4) -> tuple[Rays, Rendered]:
    rays = camera_rays(camera, torch.full((3,), 0.5))
    nearest = -(rays.origins * rays.directions).sum(-1)
    under = radius**2 - (rays.origins.square().sum(-1) - nearest**2)
    hit = under > 0
    depth = torch.where(hit, nearest - under.clamp_min(0).sqrt(), 0.0)
    return rays, Rendered(torch.where(hit[..., None], 0.5, 1.0).expand(*hit.shape, 3), depth, hit.float())


def test_photo_detail_fades_out_without_a_visible_step() -> None:
    """On a grey ball whose photo is lighter by 40 of 255, neighbouring pixels differ by 4 of 255 at most."""
    source = Camera(0.4, 0.3, 2.0, 300.0, 256, 256)
    rays, rendered = ball(source)
    normals = surface_normals(rays, rendered)
    weight = paint_weight(rendered.opacity, rendered)
    fine = torch.cat((torch.full((3, *weight.shape), 0.66), packed(weight, torch.ones_like(weight))[None]))
    surface = torch.cat((normals, rendered.depth[..., None]), -1).movedim(-1, 0)
    maps = DetailMaps((PhotoMaps(source, (fine,), (fine,), surface),))
    for turn in (0.0, 0.5, 1.2, 2.0):
        view = Camera(0.4 + turn, 0.5, 2.0, 600.0, 512, 512)
        rays, plain = ball(view)
        added = maps.added(plain, view)[0].colour[..., 0] - plain.colour[..., 0]
        # Beside the outline neighbouring pixels are far apart on the ball.
        points = rays.origins + rays.directions * plain.depth[..., None]
        flat = -(points / 0.4 * rays.directions).sum(-1) > 0.4
        inside = (plain.opacity > 0) & flat
        steps = [
            (added[:, 1:] - added[:, :-1]).abs()[inside[:, 1:] & inside[:, :-1]].max(),
            (added[1:] - added[:-1]).abs()[inside[1:] & inside[:-1]].max(),
        ]
        assert float(added[inside].max()) > (0.1 if turn < 1 else 0.01)
        assert float(max(steps)) < 4 / 255
