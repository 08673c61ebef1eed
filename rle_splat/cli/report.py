"""Writing reports as strict JSON."""

from __future__ import annotations

import json
from pathlib import Path

from ..scene.plain import plain


def write_report(path, report: dict) -> None:
    """Write a report to a file as indented UTF-8 JSON."""
    Path(path).write_text(json.dumps(plain(report), indent=2, allow_nan=False) + "\n", encoding="utf-8")


def number_text(value: float) -> str:
    """A number with at most six significant digits."""
    return f"{value:.6g}"
