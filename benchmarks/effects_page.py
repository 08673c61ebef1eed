"""The tables of the page effects.md from effects.json, the last results of ``bench effects`` for each scene."""

from __future__ import annotations

import json
from pathlib import Path

from .accuracy import fill, markdown
from .frames import describe

DOCS = Path(__file__).parents[1] / "docs" / "explanation"
HEADER = ("effect", "over", "first", "frame", "its own work", "kernels more", "made again by a frame")


def write_page(measured: dict, folder: Path = DOCS) -> None:
    """Update effects.json and the tables of effects.md: the report replaces the record of the same scenes."""
    record_file, page = folder / "effects.json", folder / "effects.md"
    record = json.loads(record_file.read_text(encoding="utf-8")) if record_file.exists() else {}
    rest = {key: value for key, value in measured.items() if key not in ("rows", "light_pass")}
    for row in measured["rows"]:
        if record.get(row["scene"], {}).get("circumstances") is not measured["circumstances"]:
            record[row["scene"]] = {**rest, "rows": []}
        record[row["scene"]]["rows"].append(row)
    if measured["light_pass"] is not None:
        record["light pass"] = measured["light_pass"]
    record_file.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    blocks = {f"prices of {name}": table(of_scene) for name, of_scene in record.items() if name != "light pass"}
    if "light pass" in record:
        blocks["light pass"] = light_pass_line(record["light pass"])
    page.write_text(fill(page.read_text(encoding="utf-8"), blocks), encoding="utf-8")


def table(of_scene: dict) -> str:
    """The table of one scene, and a line on how it was measured."""
    rows = [
        (
            row["effect"], row["over"],
            f"{row['first_ms']:.0f} ({row['first_ratio']:.2f})", f"{row['frame_ms']:.0f} ({row['frame_ratio']:.2f})",
            _own(row), str(len(row["more_kernels"])), ", ".join(row["made_by_a_frame"]) or "nothing",
        )
        for row in of_scene["rows"]
    ]  # fmt: skip
    where = of_scene["circumstances"]
    busy = where["others_busy_cores"]
    size = of_scene["size"]
    clock = "Processor time of one thread. " * of_scene.get("processor_time", False)
    how = (
        f"{clock}{size} x {size}, {of_scene['quality']}, {of_scene['classification']}. {describe(where)} "
        f"Other programs kept {'an unknown number of' if busy is None else f'{busy:.2f}'} cores busy. "
        f"Off: {max(row['off_ms'] for row in of_scene['rows']):g} ms in every row."
    )
    return f"{markdown(HEADER, rows)}\n\n{how}"


def _own(row: dict) -> str:
    """Milliseconds of an effect's own stage in the first picture; "-" for several effects."""
    own = row["own_first_ms"].get(row["of"])
    return "-" if own is None else f"{own:.0f}"


def light_pass_line(passed: dict) -> str:
    again = "made again" if passed["made_again_by_a_turn_of_the_camera"] else "nothing of it is made again"
    return (
        f"A light pass takes {passed['a_light_ms']:.0f} ms a light on shells of {passed['side']}^3; {again} when the "
        "camera turns."
    )
