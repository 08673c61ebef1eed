"""Follow the links of a compositor backward, through muted nodes and in and out of node groups."""

from __future__ import annotations


def feeding(sockets, holders=()):
    """Find every output whose value reaches one of some input sockets.

    Parameters
    ----------
    sockets : iterable of bpy.types.NodeSocket
        Input sockets.
    holders : tuple of bpy.types.Node
        The group nodes that contain the sockets, outermost first.

    Yields
    ------
    node, output, holders
        The node, its output socket, and the group nodes that contain it.  An output in a node group is yielded once
        for each use of the group.
    """
    todo, seen = [(socket, holders) for socket in sockets], set()
    while todo:
        socket, within = todo.pop()
        for output, place in _sources(socket, within):
            if (output, place) not in seen:
                seen.add((output, place))
                yield output.node, output, place
                todo.extend((entry, place) for entry in output.node.inputs)


def _sources(socket, holders):
    """The outputs that an input socket takes its value from."""
    for link in socket.links:
        if not link.is_muted:
            yield from _behind(link.from_socket, holders)


def _behind(output, holders):
    """The outputs behind an output socket: itself, or the sources of a muted node or of a node group."""
    node = output.node
    if node.mute:
        passed = [link.from_socket for link in node.internal_links if link.to_socket == output]
    elif node.bl_idname == "NodeGroupInput":
        passed = _same(holders[-1].inputs, output) if holders else []
        holders = holders[:-1]
    elif node.type == "GROUP" and node.node_tree is not None:
        ends = [one for one in node.node_tree.nodes if one.bl_idname == "NodeGroupOutput" and one.is_active_output]
        passed = [socket for end in ends for socket in _same(end.inputs, output)]
        holders = (*holders, node)
    else:
        yield output, holders
        return
    for entry in passed:
        yield from _sources(entry, holders)


def _same(sockets, other) -> list:
    """The sockets that correspond to ``other`` on the other side of a group's boundary."""
    return [socket for socket in sockets if socket.identifier == other.identifier]
