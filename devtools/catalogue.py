"""docs/explanation/stability.md, written from the figures of the catalogue's tests and the table of
situations."""

from __future__ import annotations

import json
from pathlib import Path

from tests.blender.situations import SITUATIONS

from .places import ROOT, Failure

# Names the file, as JSON, that the tests write their figures to; not set, they are only held against their bounds.
FIGURES_VARIABLE = "RLE_SPLAT_CATALOGUE"
PAGE = ROOT / "docs" / "explanation" / "stability.md"
WIDTHS = ("float32", "float64")
HEAD = """# Hard cases, and what holds in each

This page lists the bounds that hold for extreme input, and what holds in unusual situations in Blender.
`python3 dev.py test --catalogue` writes the page from the tests in `tests/stability`; do not edit it by hand. Each
line is one bound that a test asserts. It has the case, what is bounded, the bound, and the largest figure measured
in 32-bit sums and in the 64-bit sums of pictures of more than 16,384 sheets. "-" marks cases without sums. If a
figure exceeds its bound, the test fails and no page is written. The ids are those of [the
algorithm](algorithm.md#3-numerical-stability).

`python3 dev.py test --mutations` shows that each guard is needed: it replaces stable forms by naive ones and checks
that these tests notice. `python3 dev.py test --fuzz SECONDS` searches for more cases with new seeds.

Every classification treats extreme numbers in the same way:

- NaN voxels are transparent, and the report counts them. Where values are interpolated before they are classified,
  a cell is transparent if any of its corners is NaN.
- Infinite voxels take the transfer function's value at its nearest end. So do finite voxels beyond the ends.
- Post-classified sheets hold float64, int32 and uint32 values as float32, so whole numbers beyond 2^24 lose their
  last digits. If the largest value is less than twice the smallest, the middle is subtracted first and less is
  lost.
- A step of a transfer function is taken from the right. A range of a single value is a step.
- An opacity of 1 is an optical depth of 24 ln 2 per opacity distance, the largest that float32 distinguishes from
  infinity.
- Colors, and lit colors, may be up to 1e9 times white. Brighter colors give an error.
- An opacity distance below 1e-26 world units is taken as 1e-26. What it applies to is opaque in any case.
- Matrices hold entries up to 1e100, and lengths of a camera lie from 1e-50 to 1e50. Others give an error.

| id | case | what is bounded | at most | float32 | float64 |
|---|---|---|---|---|---|
"""
SITUATIONS_HEAD = """
## Blender situations

Tests in `tests/blender` carry the id of each line. `python3 dev.py test` runs all of them in Blender 4.5 and
5.3, and in 5.0 and 5.2 those of undo, redo and every operator.

| id | situation | what holds |
|---|---|---|
"""


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) < 1e6 and value == int(value) else f"{value:.2g}"


def _cell(row, width: str) -> str:
    figures = row["figures"]
    if width in figures:
        return _number(figures[width])
    if "either" in figures:
        return f"{_number(figures['either'])} ({row['why']})"
    about_sums = row["id"][0] in "AP"  # what adds up, and what compares whole pictures
    return row["why"] or ("" if about_sums or width == "float32" else "-")


def _row(cells) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def situations() -> str:
    """The page's section on situations in Blender."""
    lines = [_row((name, *texts)) for name, texts in SITUATIONS.items()]
    return SITUATIONS_HEAD + "\n".join(lines) + "\n"


def table(figures: Path) -> str:
    """The page; a Failure that names the first case without a figure or with an empty cell."""
    found = json.loads(figures.read_text(encoding="utf-8"))
    missing = sorted(set(found["cases"]) - {row["id"] for row in found["rows"]}, key=list(found["cases"]).index)
    if missing:
        raise Failure(f"No test recorded a figure for {', '.join(missing)}; write one in tests/stability.")
    lines = []
    for row in found["rows"]:
        claim = row["claim"] + (f" (looser than planned: {row['looser']})" if row["looser"] else "")
        cells = [row["id"], row["case"], claim, _number(row["bound"]), *(_cell(row, width) for width in WIDTHS)]
        if not all(cell.strip() for cell in cells):
            raise Failure(
                f"{row['id']}, {row['claim']}: measured in {' and '.join(row['figures'])} only; record the other "
                "width too, or say why not."
            )
        lines.append(_row(cells))
    return HEAD + "\n".join(lines) + "\n" + situations()
