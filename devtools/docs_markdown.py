"""Tables and sentences of the generated reference."""

from __future__ import annotations


def table(header, rows) -> str:
    """A Markdown table; "" without rows."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(map(_cell, line)) + " |" for line in lines) if rows else ""


def _cell(text: str) -> str:
    return " ".join(str(text).split()).replace("|", "\\|")


def sentence(text: str) -> str:
    """A help text or a tooltip as a sentence; a list of values begins as it is typed."""
    text = " ".join(text.split())
    if "|" not in text.partition(" ")[0]:
        text = text[:1].upper() + text[1:]
    return text if not text or text.endswith((".", "!", "?")) else text + "."
