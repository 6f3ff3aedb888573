"""The command line of ``bench``. Imports no torch, so that ``--help`` answers at once."""

import argparse
from pathlib import Path

from core.cli.argument_types import count, part
from core.cli.options import add_command, add_model, add_seed


def add_bench(commands: argparse._SubParsersAction) -> None:
    """Add ``bench`` and its kinds."""
    kinds = commands.add_parser("bench", help="measure on this machine and plot charts").add_subparsers(
        required=True, metavar="KIND"
    )
    rendering = add_command(
        kinds, "render", "measure.bench_render", "milliseconds per frame against PSNR, stage by stage"
    )
    rendering.add_argument("--views", type=count, default=2, metavar="N", help="objects, each from another viewpoint")
    films = add_command(kinds, "films", "measure.bench_films", "seconds of a video against PSNR, exact and baked")
    films.add_argument("--objects", type=count, default=2, metavar="N", help="objects, one turn each")
    fitting = add_command(
        kinds, "fit", "measure.bench_fit", "seconds against degrees of fits without a known camera, by preset"
    )
    guard = add_command(kinds, "gate", "measure.bench_gate", "fail if anything takes twice as long as in gate.csv")
    guard.add_argument("--write", action="store_true", help="write gate.csv, the baseline, instead")
    shared = add_command(kinds, "threads", "measure.bench_threads", "seconds of whole jobs against threads")
    shared.add_argument("--counts", type=count, nargs="+", default=[1, 2], metavar="N", help="numbers of threads")
    shared.add_argument("--busy", type=int, nargs="+", default=[0, 1, 2], metavar="N", help="busy programs beside")
    redraw = add_command(kinds, "redraw", "measure.bench_redraw", "write tables and charts again from the CSV files")
    ablations = add_command(
        kinds, "ablations", "measure.bench_ablations", "fits without single components of the method"
    )
    robustness = add_command(
        kinds, "robustness", "measure.bench_robustness", "where fits fail: success rate against stressors"
    )
    robustness.add_argument("--stressors", nargs="+", default=[], metavar="S", help="stressors to run (default: all)")
    robustness.add_argument("--presets", nargs="+", default=["normal", "paper"], metavar="P", help="presets to compare")
    robustness.add_argument(
        "--part", type=part, default=(1, 1), metavar="K/N", help="every Nth fit, from the Kth: for N processes at once"
    )
    detail = add_command(kinds, "detail", "measure.bench_detail", "effect of photo detail on other views")
    detail.add_argument("datasets", type=Path, nargs="+", metavar="DATASET", help="SRN folders of held-out objects")
    detail.add_argument("--renderer", default="own", metavar="NAME", help="renderer of the images")
    detail.add_argument("--objects", type=count, default=10, metavar="N", help="one view of each is fitted")
    detail.add_argument("--input-view", type=int, default=3, metavar="I", help="index of that view")
    detail.add_argument("--view-stride", type=count, default=2, metavar="N", help="only every Nth other view")
    for kind in (fitting, ablations, robustness):
        kind.add_argument(
            "--dataset", type=Path, nargs="+", metavar="D", help="SRN folders (default: the model's training objects)"
        )
        kind.add_argument("--objects", type=count, default=10, metavar="N", help="one view of each is fitted")
        add_seed(kind)
    measured = (rendering, films, fitting, shared, ablations, robustness, detail)
    for kind in measured:
        add_model(kind)
    pictures = add_command(
        kinds, "photos", "measure.bench_photos", "fits of photographs, compared with judgement by eye"
    )
    pictures.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="folders of the photographs")
    pictures.add_argument(
        "--by-eye", type=Path, default=Path("assets/charts/photos_by_eye.csv"), metavar="CSV", help="judgements by eye"
    )
    pictures.add_argument("--preset", default="normal", metavar="P", help="of the fits")
    for kind in (*measured, pictures, redraw, guard):
        kind.add_argument(
            "--out", type=Path, default=Path("assets/charts"), metavar="DIR", help="output folder of the charts"
        )
