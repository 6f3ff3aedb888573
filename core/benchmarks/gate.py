"""A gate against regressions: results compared with a committed baseline, as ratios that hold on other machines too.

Absolute times depend on the machine; how many times faster the fast renderer is than the naive one, or a preset than
the paper's recipe, hardly does. Each function returns a line for everything
that became worse than its tolerance allows.
"""

from core.benchmarks.fits import FitResults
from core.benchmarks.rendering import RenderingResults

SPEED_TOLERANCE = 0.25
"""share of a speed-up that may be lost: what rounds of one machine differ by, and a margin"""
PSNR_TOLERANCE = 0.5
"""dB that may be lost against the exact renderer: what float32 and bfloat16 machines differ by is no regression"""


def compare_rendering(found: RenderingResults, baseline: RenderingResults) -> list[str]:
    """Speed-up over the naive renderer's largest number of samples and PSNR, by number of samples."""
    before = {one.samples: one for one in baseline.fast}
    lines = []
    for one in found.fast:
        if one.samples in before:
            name, old = f"{one.samples} samples", before[one.samples]
            lines += _slower(name, found.naive[-1].ms / one.ms, baseline.naive[-1].ms / old.ms)
            if one.psnr < old.psnr - PSNR_TOLERANCE:
                allowed = f"baseline {old.psnr:.1f} dB (tolerance {PSNR_TOLERANCE} dB)"
                lines.append(f"{name}: {one.psnr:.1f} dB, {allowed}")
    return lines


def compare_fits(found: FitResults, baseline: FitResults) -> list[str]:
    """Speed-up over the paper's recipe, and the share of cameras within 10 degrees, by preset.

    A share is worse where it lies below the baseline's 95 % interval.
    """
    before = {one.preset: one for one in baseline.summaries}
    after = {one.preset: one for one in found.summaries}
    lines = []
    for preset in before.keys() & after.keys() - {"paper"}:
        old, new = before[preset], after[preset]
        if "paper" in before and "paper" in after:
            speed, old_speed = after["paper"].seconds / new.seconds, before["paper"].seconds / old.seconds
            lines += _slower(preset, speed, old_speed)
        if new.within_10_degrees.mean < old.within_10_degrees.low:
            shares = (
                f"{100 * new.within_10_degrees.mean:.0f} %, baseline at least {100 * old.within_10_degrees.low:.0f} %"
            )
            lines.append(f"{preset}: cameras within 10° {shares}")
    return sorted(lines)


def _slower(name: str, speed: float, baseline: float) -> list[str]:
    if speed >= (1 - SPEED_TOLERANCE) * baseline:
        return []
    return [f"{name}: {speed:.1f} times faster, baseline {baseline:.1f} (tolerance {100 * SPEED_TOLERANCE:.0f} %)"]
