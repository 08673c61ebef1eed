"""From File > Import to a picture in a real window: how many clicks and seconds it takes, and a photograph of each.

    python3 dev.py blender --photograph tests/blender/record_clicks.py --size 1600x1400

writes clicks.md, the rows of the table in docs/explanation/measurements.md without their last column, and NAME.png into
build/window-shots/record_clicks.  The scans of ``CASES`` are in tests/blender/data,
linked or copied there.  Buttons are found by hovering over the sidebar, and pressed with the mouse.  In the file
browser, whose folders are set by this script, choosing a file and pressing its button count as two clicks.
"""

import os
import time
from pathlib import Path

import bpy

from tests.blender.scenes import module
from tests.blender.user_steps import choose_import, confirm_browser, press_button, settled
from tests.blender.window_driver import (
    SHOTS,
    TAB,
    area_of,
    drive,
    new_file,
    open_panels,
    passed,
    photograph,
    region_of,
    until,
)

DATA = Path(__file__).parent / "data"
FILE, FOLDER = 0, 1  # entries of File > Import
WHITE = {"*White Background*": "bpy.ops.rle_splat.plain_background("}
# Name, entry of File > Import, scan, buttons that are pressed afterwards. Segmentations lie beside the scans.
CASES = (
    ("chest angiography, DICOM", FOLDER, "dicom_ct_chest_cta_512x512x95", {}),
    ("aortic dissection with its labels, NIfTI", FILE, "cta_aorta_labels/cta_heart_aorta_120x126x164_int16.nii.gz", {}),
    ("skull phantom, DICOM", FOLDER, "dicom_ct_skull_phantom_512x512x140", {}),
    ("PET with its SEG", FOLDER, "pet_seg/dicom_pet_128x128x266", WHITE),
    ("CT with an RTSTRUCT of rt-utils", FOLDER, "rtstruct/dicom_ct_chest_512x512x46", {}),
    ("nuclei with 20 labels, TIFF", FILE, "fluorescence/nuclei_256x256x60_uint16.tif", {}),
)


class Count:
    """Clicks, and seconds from each of them to a finished picture: of a clock, and of the processor."""

    def __init__(self):
        self.clicks, self.seconds, self.work = 0, 0.0, 0.0


def is_idle() -> bool:
    return not module("bridge.loop.jobs").StepwiseOperator.is_running()


def volumes() -> list:
    return [one for one in bpy.data.objects if one.rle_splat.is_volume]


def waited(count: Count, condition):
    """Until the condition holds and the picture is finished, counting the seconds."""
    began, worked = time.perf_counter(), time.process_time()
    yield from until(condition)
    yield from settled()
    count.seconds += time.perf_counter() - began
    count.work += time.process_time() - worked


def imported(count: Count, entry: int, scan: Path):
    yield from choose_import(entry)
    count.clicks += 2  # File and the entry; Import opens under the mouse
    yield from confirm_browser(*((scan,) if entry == FOLDER else (scan.parent, scan.name)))
    count.clicks += 2
    yield from waited(count, lambda: volumes() and is_idle())
    return volumes()[0]


def measured(name: str, entry: int, scan: str, buttons):
    yield from new_file()
    count = Count()
    owner = yield from imported(count, entry, DATA / scan)
    region_of(area_of("VIEW_3D"), "UI").active_panel_category = TAB
    for place in buttons.values():
        yield from press_button(place)
        count.clicks += 1
        yield from waited(count, is_idle)
    yield from photograph(name.split(",")[0].replace(" ", "_"))
    row = f"| {name} | {', '.join(buttons)} | {count.clicks} | {count.seconds:.0f} | {count.work:.0f} |"
    with open(Path(os.environ[SHOTS]) / "clicks.md", "a", encoding="utf-8") as table:
        table.write(row + "\n")
    print(row, owner.rle_splat.transfer_name, owner.rle_splat.remarks, flush=True)
    passed(name)


def scenario():
    open_panels("RLE_SPLAT_PT_volume", "RLE_SPLAT_PT_display", "RLE_SPLAT_PT_labels")
    for case in CASES:
        if (DATA / case[2]).exists():
            yield from measured(*case)


drive(scenario)
