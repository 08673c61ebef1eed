"""Pictures that no longer show the scene, with the buttons that make them again."""

from ..bridge.pictures import outdated
from ..bridge.translations import filled
from .places import paragraph


def draw_outdated(context, layout) -> bool:
    """Name each outdated picture, with a button that makes it again; return whether there is any."""
    pinned = {row.image for row in context.scene.rle_splat.pictures if row.kind == "backdrop"}
    images = outdated.out_of_date(context.scene)
    for image in images:
        sentence = filled("Out of date: {image}. The scene has changed since", image=image.name)
        paragraph(context, layout, sentence, icon="ERROR")
        if image in pinned:
            layout.operator("rle_splat.preview_in_camera_view", icon="FILE_REFRESH")
        else:
            layout.operator("rle_splat.render_image", icon="FILE_REFRESH")
    return bool(images)
