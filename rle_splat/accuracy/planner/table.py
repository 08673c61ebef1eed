"""The report of an accuracy sweep as text for people."""

from ..metrics import ERRORS

# What a plan's error is measured against.
TRUTH_TEXTS = {
    "T1": "the exact integral of voxels that are classified, then interpolated",
    "T2": "the exact integral of values that are interpolated, then classified",
}


def table_lines(report: dict) -> list[str]:
    """Lines of text with one table for each truth, from the report of ``measure_plans.sweep_steps``."""
    image, volume, probes = report["image"], report["volume"], report["probes"]
    has_flip = any(entry["error"]["crop"]["flip"] is not None for entry in report["plans"])
    lines = [
        f"{' x '.join(map(str, volume['shape_xyz']))} voxels, {volume['visible_fraction']:.1%} kept; "
        f"{image['width']} x {image['height']} pixels; {report['threads']} thread(s).",
    ]
    for name, text in report["truths"].items():
        lines += ["", f"Against {text}:", *_truth_lines(report, name, has_flip)]
    lines += [
        "",
        f"*: on the front, no other plan is both quicker and nearer to its reference ({ERRORS[report['front_by']]}).  "
        ">: the chosen plan.",
        f"ms: splat, warp and single rays, the median of {report['repeats']} frames. Errors: 8-bit steps, 1/255 "
        "of premultiplied linear "
        f"RGBA; RMSE, 99.9%, bias and PSNR at {probes['random']} random pixels, max over these, {probes['steep']} "
        "steep ones and the crop; SSIM"
        + (" and FLIP" if has_flip else "") + f" of the crop {_crop_text(report['crop'])}, as a display shows it."
        + (" post RMSE: against the reference of post." if "T1" in report["truths"] else ""),
    ]  # fmt: skip
    return lines


def _truth_lines(report: dict, name: str, has_flip: bool) -> list[str]:
    """The table of the plans that promise the truth ``name``, quickest first."""
    beside = name != "T2"
    plans = sorted((e for e in report["plans"] if e["truth"] == name), key=lambda entry: entry["frame_ms"])
    lines = [
        f"{'plan':<22}{'ms':>8}{'RMSE':>9}{'99.9%':>9}{'max':>9}{'bias':>9}{'PSNR':>8}{'SSIM':>9}"
        + (f"{'FLIP':>9}" if has_flip else "") + (f"{'post RMSE':>11}" if beside else ""),
    ]  # fmt: skip
    for entry in plans:
        error, crop = entry["error"], entry["error"]["crop"]
        marks = ("*" if entry["on_front"] else " ") + (">" if entry["chosen"] else " ")
        lines.append(
            f"{marks + entry['name']:<22}{entry['frame_ms']:8.1f}{error['rmse']:9.3f}{error['p999']:9.2f}"
            f"{error['largest']:9.2f}{error['bias']:9.4f}{error['psnr']:8.1f}{_cell(crop['ssim'], 9, 5)}"
            + (_cell(crop["flip"], 9, 4) if has_flip else "")
            + (f"{entry['as_ray_caster']['rmse']:11.3f}" if beside else "")
        )
    return lines


def _cell(value, width: int, digits: int) -> str:
    return f"{'-':>{width}}" if value is None else f"{value:{width}.{digits}f}"


def _crop_text(crop) -> str:
    left, top, right, bottom = crop
    return f"of {right - left} x {bottom - top} pixels at {left}, {top}"
