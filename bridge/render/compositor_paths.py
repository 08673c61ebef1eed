"""Follow the links of a compositor backward, through muted nodes and in and out of node groups."""


def feeding(sockets, holders=(), end=None, links=None):
    """Find every output whose value reaches one of some input sockets.

    Parameters
    ----------
    holders : tuple of bpy.types.Node
        The group nodes that contain the sockets, outermost first.
    end : callable, optional
        ``end(node)`` returns whether nothing behind a node counts.
    links : set, optional
        Gets the links that are followed.

    Yields
    ------
    node, output, holders
        The node, its output socket, and the group nodes that contain it.  An output in a node group is yielded once
        for each use of the group.
    """
    todo, seen, links = [(socket, holders) for socket in sockets], set(), set() if links is None else links
    while todo:
        socket, within = todo.pop()
        for output, place in _sources(socket, within, links):
            if (output, place) not in seen:
                seen.add((output, place))
                yield output.node, output, place
                if end is None or not end(output.node):
                    todo.extend((entry, place) for entry in output.node.inputs)


def _sources(socket, holders, links):
    """The outputs that an input socket takes its value from."""
    for link in socket.links:
        if not link.is_muted:
            links.add(link)
            yield from _behind(link.from_socket, holders, links)


def _behind(output, holders, links):
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
        yield from _sources(entry, holders, links)


def _same(sockets, other) -> list:
    """The sockets that correspond to ``other`` on the other side of a group's boundary."""
    return [socket for socket in sockets if socket.identifier == other.identifier]
