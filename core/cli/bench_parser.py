"""The words of ``bench``. Imports no torch, so that ``--help`` answers at once."""

import argparse
from pathlib import Path

from core.cli.argument_types import count, part
from core.cli.options import add_command, add_model, add_seed


def add_bench(commands: argparse._SubParsersAction) -> None:
    """``bench`` and its kinds."""
    kinds = commands.add_parser("bench", help="measure on this machine and plot charts").add_subparsers(
        required=True, metavar="KIND"
    )
    rendering = add_command(
        kinds, "render", "measure.bench_render", "milliseconds per frame against PSNR, stage by stage"
    )
    rendering.add_argument("--views", type=count, default=2, metavar="N", help="objects, each from another viewpoint")
    films = add_command(kinds, "films", "measure.bench_films", "seconds of a film against PSNR, exact and baked")
    films.add_argument("--objects", type=count, default=2, metavar="N", help="each turns once round")
    fitting = add_command(
        kinds, "fit", "measure.bench_fit", "seconds against degrees of fits without a known camera, by preset"
    )
    guard = add_command(
        kinds, "gate", "measure.bench_gate", "fail where something takes twice as long as gate.csv has it"
    )
    guard.add_argument("--write", action="store_true", help="write gate.csv instead, the baseline")
    redraw = add_command(kinds, "redraw", "measure.bench_redraw", "write tables and charts again from the CSV files")
    ablations = add_command(kinds, "ablations", "measure.bench_ablations", "fits without each part of the method")
    robustness = add_command(
        kinds, "robustness", "measure.bench_robustness", "where fits fail: success rate against stressors"
    )
    robustness.add_argument("--stressors", nargs="+", default=[], metavar="S", help="only these")
    robustness.add_argument("--presets", nargs="+", default=["normal", "paper"], metavar="P", help="what is compared")
    robustness.add_argument(
        "--part", type=part, default=(1, 1), metavar="K/N", help="every Nth fit, from the Kth: for N processes at once"
    )
    detail = add_command(kinds, "detail", "measure.bench_detail", "what a photo's detail adds to other views")
    detail.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="SRN folders of held-out objects")
    detail.add_argument("--renderer", default="own", metavar="NAME", help="which has drawn the images")
    detail.add_argument("--objects", type=count, default=10, metavar="N", help="one view of each is fitted")
    detail.add_argument("--input-view", type=int, default=3, metavar="I", help="which")
    detail.add_argument("--view-stride", type=count, default=2, metavar="N", help="only every Nth other view")
    for kind in (fitting, ablations, robustness):
        kind.add_argument(
            "--dataset", type=Path, nargs="+", metavar="D", help="SRN folders; else the model's training objects"
        )
        kind.add_argument("--objects", type=count, default=10, metavar="N", help="one view of each is fitted")
        add_seed(kind)
    measured = (rendering, films, fitting, ablations, robustness, detail)
    for kind in measured:
        add_model(kind)
    pictures = add_command(kinds, "photos", "measure.bench_photos", "what becomes of photographs, as an eye judges")
    pictures.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="where the photographs are")
    pictures.add_argument(
        "--by-eye", type=Path, default=Path("assets/charts/photos_by_eye.csv"), metavar="CSV", help="what they show"
    )
    pictures.add_argument("--preset", default="normal", metavar="P", help="of the fits")
    for kind in (
        rendering,
        films,
        fitting,
        ablations,
        robustness,
        detail,
        pictures,
        redraw,
        guard,
    ):
        kind.add_argument(
            "--out", type=Path, default=Path("assets/charts"), metavar="DIR", help="where to write the charts"
        )
