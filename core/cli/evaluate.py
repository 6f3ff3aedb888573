"""``evaluate``: the paper's protocol on a dataset."""

import argparse
from collections.abc import Iterator
from statistics import fmean

from tqdm import tqdm

from core.cli.output import say
from core.cli.progress import wait_for_view_bank
from core.lab.datasets.srn import ObjectEntry, ObjectViews, evenly_spaced, index_objects
from core.lab.evaluation.protocol import EvaluationProtocol, ObjectScore, format_table, write_report
from core.lab.evaluation.protocol import evaluate as scored
from core.models.library import load_model
from core.runtime.files import is_stream, require_writable


def evaluate(args: argparse.Namespace) -> None:
    """Run ``evaluate``: the paper's table on a test set."""
    protocol = EvaluationProtocol(args.input_views, args.pose == "estimate", args.preset, args.seed, args.view_stride)
    model = load_model(args.model, args.device)
    category, entries = index_objects(args.datasets, args.pose_scale)
    if category and model.category not in ("", category):
        raise ValueError(f"the dataset shows {category}, but the model {model.category}")
    if args.report:
        require_writable(args.report)
    wait_for_view_bank(model)
    conditions = {"model": model.fingerprint, "datasets": " ".join(map(str, args.datasets))}
    entries = evenly_spaced(entries, args.objects)
    scores = list[ObjectScore]()
    views = _with_objects(map(ObjectEntry.read, entries), protocol)
    with tqdm(total=len(entries), unit="object", disable=None) as bar:
        for score in scored(model, views, protocol):
            scores.append(score)
            if args.report and not is_stream(args.report):  # after each, so that a later failure loses nothing
                write_report(args.report, scores, protocol, conditions)
            bar.set_postfix_str(f"{fmean(score.psnr for score in scores):.2f} dB")
            bar.update()
    if not scores:
        raise ValueError("all objects of the dataset are blank")
    if args.report and is_stream(args.report):
        write_report(args.report, scores, protocol, conditions)
    print(format_table(scores, protocol), flush=True)


def _with_objects(objects: Iterator[ObjectViews], protocol: EvaluationProtocol) -> Iterator[ObjectViews]:
    """Yield objects with visible input views; report the others. ShapeNet has a few all-white ones."""
    for views in objects:
        blank = [index for index in protocol.inputs if index < len(views.masks) and not views.masks[index].any()]
        if blank:
            say(f"{views.name} is skipped: view {blank[0]} shows no object")
        else:
            yield views
