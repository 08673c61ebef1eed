"""What feeds what in a compositor: back along its links, through muted nodes and into node groups and out again."""

from __future__ import annotations


def feeding(sockets, holders=()):
    """Yield (node, its output socket, holders) for every output whose result reaches one of the input ``sockets``.

    Each output is yielded once for each way into its node group.  ``holders``: the group nodes, outermost first, whose
    groups the sockets are in.
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
    """The outputs that an output socket stands for: itself, or what a muted node or a node group passes on."""
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
    """The socket of a group's other side."""
    return [socket for socket in sockets if socket.identifier == other.identifier]
