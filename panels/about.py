"""The About panel: intended use and licenses."""

import json
from pathlib import Path

import bpy

from .places import Sidebar, paragraph

NOT_FOR_DIAGNOSIS = (
    "RLE Splat makes pictures for illustration and research. It is not a medical device and not for diagnosis"
)
LICENSE = "GPL-3.0-or-later. The texts of licenses are in the folders licenses and rle_splat/figure of the extension"
BUNDLED = Path(__file__).parents[1] / "bridge" / "data" / "bundled.json"
PACKAGES = json.loads(BUNDLED.read_text(encoding="utf-8"))  # read once, for drawing opens no file


class RLE_SPLAT_PT_about(Sidebar, bpy.types.Panel):
    bl_label = "About"
    bl_parent_id = "RLE_SPLAT_PT_advanced"
    bl_options = {"DEFAULT_CLOSED"}
    bl_order = 10

    def draw(self, context):
        layout = self.layout
        paragraph(context, layout, NOT_FOR_DIAGNOSIS, icon="ERROR")
        paragraph(context, layout, LICENSE, icon="INFO")
        layout.label(text="By Others, in the Extension")
        column = layout.box().column(align=True)
        for package in PACKAGES:
            paragraph(context, column, f"{package['name']}: {package['license']}")
