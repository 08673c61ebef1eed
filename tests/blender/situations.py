"""Family B of the catalogue of hard cases: situations in Blender, each an id that a test of this folder names.

A test of B12 is called ``test_B12_...``; ``tests/project/test_situations.py`` sees that every id has one.
``dev.py test --catalogue`` writes the table into docs/explanation/stability.md.
"""

# id -> (the situation, what holds)
SITUATIONS = {
    # Who a picture belongs to: test_situations_identity.py, test_situations_copies.py
    "B1": ("an image of the user's has the name of our backdrop", "it is neither resized nor written, and survives a "
           "reload; our own backdrop follows"),
    "B2": ("an image of the user's has the name of our picture", "it is left alone, and pictures made again and again "
           "reuse one image"),
    "B3": ("the user shows a copy of our picture behind the camera", "a backdrop is a further entry, and Remove "
           "Backdrop leaves the user's"),
    "B4": ("two volumes agree in the first 40 letters of their names", "each has pictures of its own"),
    "B5": ("a volume is imported under the name that another had", "each has pictures of its own"),
    "B6": ("a local and a linked volume have one name", "each has pictures of its own"),
    "B7": ("a volume is renamed", "its backdrop follows on, and the next picture is written into the same image"),
    "B8": ("our image is renamed", "it stays the picture, and a backdrop follows on in it"),
    "B9": ("a channel of a volume is renamed", "the channel is still drawn"),
    "B10": ("a marker switches to another camera", "with a backdrop that follows, each camera shows its own picture"),
    "B11": ("two scenes follow one volume", "each has a picture of its own, in its own size"),
    "B12": ("a .blend saved by version 0.1.0", "its volumes, transfer functions, backdrop and compositing are found "
            "and go on"),
    "B13": ("a volume is copied by Shift-D", "the copy has pictures of its own, and the backdrop stays the first's"),
    "B14": ("a volume is copied by Alt-D", "the copy has pictures of its own, and the backdrop stays the first's"),
    "B15": ("a scene is copied in full", "each of the two has pictures of its own"),
    "B16": ("a scene is copied with linked objects", "each of the two has pictures of its own"),
    # What is deleted or hidden: test_situations_deletion.py
    "B17": ("the volume of a backdrop that follows is deleted", "the camera shows no backdrop, and the panel says that "
            "the volume was deleted"),
    "B18": ("the only volume is deleted", "no picture can be asked for any more"),
    "B19": ("the volume is deleted and unused data purged", "the volume, its transfer function and its box are gone"),
    "B20": ("a deletion is undone", "the volume is back, and its backdrop follows again"),
    "B21": ("one of two volumes is deleted", "only its own backdrop goes"),
    "B22": ("a volume composited into renders is deleted", "the message says so, and no picture of before is laid "
            "over the render"),
    "B23": ("a channel is deleted", "it is no longer drawn"),  # test_messages.py
    "B24": ("a cutting object is deleted", "it no longer cuts"),  # test_messages.py
    "B25": ("a volume is in the scene through an instanced collection alone", "it does not count as deleted: it is "
            "drawn, or the message says why not"),
    "B26": ("the volume is in a collection that is hidden in the window", "Render to Image and renders show it where "
            "it is now"),
    "B27": ("the volume's collection is hidden from renders, and shown again", "renders go with it"),
    "B28": ("a mesh is looked at in local view", "Render to Image and renders still show the volume"),
    # View layers: test_view_layers.py
    "B29": ("the volume is excluded from the first of two view layers", "each layer shows what it has"),
    "B30": ("meshes are excluded from one of two view layers", "they hide the volume in the other layer alone"),
    # Messages of renders: test_messages.py
    "B31": ("a file is missing at one frame of an animation", "the first error and the failed frames stay in the "
            "message"),
    "B32": ("a frame cannot be drawn", "a placeholder takes the place of the volume"),
    "B33": ("the user wants a render to stop at a failed frame", "it stops"),
    "B34": ("a volume is one voxel thick, under post-classification", "the picture is empty and the message says why"),
    "B35": ("the Alpha Over of the compositor is unlinked", "the message says that the render lacks the volume"),
    "B36": ("the picture is taken out of its compositor node", "the message says that the render lacks the volume"),
    "B37": ("compositing is switched off in the render settings", "the message says that the render lacks the volume"),
    # Linked data: test_linked.py
    "B38": ("window and opacity are set on a library override", "they survive a reload"),
    "B39": ("the file of an overridden volume has a relative path", "it is read from beside the file that says so"),
    "B40": ("an operator would edit a linked volume", "it gives a clear error"),
    "B41": ("a volume is appended from a .blend in another folder", "its file is found"),
    # Pictures and what they were made from: test_situations_stale.py
    "B42": ("a point of the opacity curve is moved from Python", "the next Render to Image shows it"),
    "B43": ("a stop of the color ramp is removed from Python", "the next Render to Image shows it"),
    "B44": ("the transfer function is edited from Python, with Persistent Data", "the next render shows it"),
    "B45": ("the transfer function is edited under a backdrop that follows", "the backdrop shows it"),
    "B46": ("the camera is moved under a backdrop that follows", "the backdrop shows it"),
    "B47": ("the volume is moved under a backdrop that follows", "the backdrop shows it"),
    "B48": ("a light is dimmed under a backdrop that follows", "the backdrop shows it"),
    "B49": ("a cutting object is moved under a backdrop that follows", "the backdrop shows it"),
    "B50": ("the mode or the quality is changed under a backdrop that follows", "the backdrop shows it"),
    "B51": ("the size of the render is changed under a backdrop that follows", "the backdrop has the new size"),
    "B52": ("a mesh is moved in front of a backdrop that follows", "the backdrop shows it"),
    # Switches: test_switches.py; B55 and B57: test_motion.py
    "B53": ("Meshes Hide Volume, and Render to Image", "a mesh in front hides the volume as in renders"),
    "B54": ("Meshes Hide Volume, and Shadow Image", "a mesh in front hides the volume as in renders"),
    "B55": ("motion blur", "Render to Image and renders show the same"),
    "B56": ("the Mist pass is switched on", "the picture stays the same"),
    "B57": ("motion blur beside handlers of other add-ons", "its poses do not run them"),
    # Import, and what an edit leaves behind: test_situations_edits.py, test_switches.py, test_transfer.py, test_vdb.py
    "B58": ("a name of a file speaks of big and little, but not of bytes", "the bytes decide"),
    "B59": ("a cutting object is added while its collection is excluded", "it gives a clear error, or the object is "
            "added; nothing is left behind by halves"),
    "B60": ("a node of the transfer function was deleted", "every operator gives a clear error"),
    "B61": ("a VDB holds two grids of one name", "each can be read"),
    # Undo, files: test_situations_files.py, test_situations_edits.py
    "B62": ("ten pictures in a row", "they are no undo steps, and F9 does not make them again"),
    "B63": ("a picture in a .blend that was not saved since", "it is not packed"),
    "B64": ("a .blend with pictures is saved", "they stand beside it as files, and the .blend stays small"),
    "B65": ("pictures are to be packed, by the preference", "they are in the .blend and no files are beside it"),
    "B66": ("a .blend is saved and opened again", "every picture is there, bit for bit, and a backdrop follows on"),
    "B67": ("a .blend is saved under another name", "both files have their pictures"),
    "B68": ("a .blend is reverted", "its pictures are those of when it was saved"),
    "B69": ("the folder of pictures beside the .blend is lost", "the next picture is made as ever"),
    "B70": ("a .blend is opened, and rendered, without the extension", "no old picture is laid over the render"),
    "B71": ("a .blend is saved without the extension, and opened with it", "everything is as it was"),
    "B72": ("the volume's file is replaced by one of another size between frames", "each frame shows what is there "
            "then, or the message names the file"),
    "B73": ("a handler of the user's changes the path with the frame", "each frame shows its own file"),
    "B74": ("a driver moves the volume and its opacity", "each frame shows it there"),
    "B75": ("any edit is undone and redone", "all is as before it, then as after it, and pictures can be made"),
    "B76": ("an edit before a picture is undone and redone", "the next picture is that of the settings, in one image"),
    "B77": ("a preset and the backdrop after it are undone", "the backdrop fits the settings, or the panel says that "
            "it is out of date"),
    "B78": ("the extension is disabled and enabled again", "volumes, backdrop and compositing go on"),
    "B79": ("scripts are reloaded", "volumes, backdrop and compositing go on, each handler once"),
    # What the window shows: test_situations_window.py
    "B80": ("anything that a picture was made from is changed", "the panel says that the picture is out of date"),
    "B81": ("Behind or In Front is chosen", "the camera's backdrop changes at once"),
    "B82": ("a maximum error is set while shadows are on", "the panel says that shadows are left out, and so does the "
            "report"),
    "B83": ("Remove from Camera View, in a window", "the picture is gone from the screen at once"),  # window.py
    "B84": ("Measure Accuracy ends, in a window", "the panel shows its rows at once"),  # window.py
    "B85": ("Preview in Camera View, where no view looks through the camera", "the report says so"),
    # Renders: test_situations_renders.py
    "B86": ("EEVEE", "the volume is laid over the render as in Cycles"),
    "B87": ("Workbench", "the volume is laid over the render as in Cycles"),
    "B88": ("Freestyle", "its lines are drawn, and the volume once"),
    "B89": ("scene strips in the sequencer", "each strip shows its own scene's volume"),
    "B90": ("two scenes with a volume each, rendered in turn", "each render has its own volume"),
    "B91": ("the compositor of the user's is long, with nodes after ours", "the volume goes through them and they stay "
            "as they are"),
    "B92": ("another scene's Render Layers in the compositor", "each scene's render has its own volume"),
    "B93": ("the compositor is shared with another scene (5.x) or was switched off (4.5)", "the volume is laid over "
            "this scene's render; the other and its nodes stay"),
    "B94": ("the scene of the render is not that of the window", "the volume of the rendered scene is drawn"),
    # Found since: test_situations_copies.py
    "B95": ("a camera with a backdrop is copied by Shift-D", "the copy's next backdrop takes the place of what it "
            "shows, and the first camera's stays"),
}  # fmt: skip
