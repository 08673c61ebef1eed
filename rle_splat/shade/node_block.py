"""Light at neighboring points beside the voxels of a row, between the nodes of a grid, in vector registers.

numba computes with whole numbers of 64 bits and LLVM does not vectorize a loop that looks up nodes: one point after the
other takes 12 ns, a block of points 4 ns each, with the same bits.
"""

from __future__ import annotations

from ..runtime.llvm import cgutils, intrinsic, ir, types
from ..runtime.vectors import INTEGER, Vector, load, pick, place, spread, store

BLOCK = 16  # points at once
_LONG = ir.IntType(64)


@intrinsic
def read_block(typing, nodes, columns, moved, at, first, last, pitch, node, strides, scale, found):
    """Write the codes of the light at BLOCK points, from number ``at`` of a row on; no bounds checks.

    Positions are whole numbers of steps of ``surface_points.STEPS``, counted from the first node on.

    Parameters
    ----------
    nodes : (n,) ndarray of uint16
    columns : (m,) ndarray of int32
        Positions of the voxels along x, relative to that of the first column.
    moved : (3 m,) ndarray of int16
        From the voxels to their points along x, y, z.
    at : int
    first, last : tuple of int32
        Position of the first column of the row, and the last position that has nodes around it; x, y, z.
    pitch : int32
        Voxels from node to node.
    node : tuple of int32
        Of the steps from node to node: the power of two that they are, and the bits of positions between nodes.
    strides : tuple of int32
        Nodes from one row to the next, and from one layer to the next.
    scale : tuple of float32
        Added to codes, a half for rounding among it; code of a light of 1 in ``nodes``; 1 / steps from node to node.
    found : (m,) ndarray of int32
        Output.
    """

    def generate(context, builder, signature, arguments):
        nodes, columns, moved, at, first, last, pitch, node, strides, scale, found = arguments
        kinds = dict(zip(("nodes", "columns", "moved", "at"), signature.args))
        whole, wide = ir.VectorType(INTEGER, BLOCK), ir.VectorType(_LONG, BLOCK)

        def spread_all(values):
            return [spread(builder, value, BLOCK) for value in cgutils.unpack_tuple(builder, values)]

        def constant(number, kind=whole):
            return ir.Constant(kind, [number] * BLOCK)

        power, part = spread_all(node)
        added, per_code, per_step = (Vector(builder, value) for value in spread_all(scale))
        pitch = spread(builder, pitch, BLOCK)
        triples = place(context, builder, kinds["moved"], moved, builder.mul(at, _LONG(3)))
        triples = load(builder, triples, 3 * BLOCK, ir.IntType(16))
        along = load(builder, place(context, builder, kinds["columns"], columns, at), BLOCK, INTEGER)
        shares, cells = [], constant(0, wide)
        steps = [
            None,
            *(spread(builder, builder.zext(one, _LONG), BLOCK) for one in cgutils.unpack_tuple(builder, strides)),
        ]
        for axis, (begin, end, step) in enumerate(zip(spread_all(first), spread_all(last), steps)):
            way = builder.sext(pick(builder, triples, range(axis, 3 * BLOCK, 3)), whole)
            position = builder.add(begin, builder.mul(way, pitch))
            if axis == 0:
                position = builder.add(position, along)
            position = builder.select(builder.icmp_signed("<", position, constant(0)), constant(0), position)
            position = builder.select(builder.icmp_signed(">", position, end), end, position)
            shares.append(Vector(builder, builder.and_(position, part)).as_float() * per_step)
            # Of widened numbers the compiler knows that their product needs no more than one multiplication.
            cell = builder.zext(builder.lshr(position, power), wide)
            cells = builder.add(cells, cell if axis == 0 else builder.mul(cell, step))
        begin = builder.ptrtoint(context.make_array(kinds["nodes"])(context, builder, nodes).data, _LONG)
        cells = builder.add(spread(builder, begin, BLOCK), builder.shl(cells, constant(1, wide)))

        def between(*ways):
            """Nodes between pairs along x, ``ways`` from the first ones."""
            pair = cells
            for way in ways:
                pair = builder.add(pair, builder.shl(way, constant(1, wide)))
            pair = _gather(builder, pair)
            near = Vector(builder, builder.and_(pair, constant(0xFFFF))).as_float()
            return _mix(near, Vector(builder, builder.lshr(pair, constant(16))).as_float(), shares[0])

        _, down, deep = steps
        upper, lower = _mix(between(), between(down), shares[1]), _mix(between(deep), between(deep, down), shares[1])
        codes = added + per_code * _mix(upper, lower, shares[2])
        store(builder, codes.truncated().value, place(context, builder, signature.args[-1], found, at))
        return context.get_dummy_value()

    given = (nodes, columns, moved, types.intp, first, last, pitch, node, strides, scale, found)
    return types.void(*given), generate


def _mix(near: Vector, far: Vector, share: Vector) -> Vector:
    return near + share * (far - near)


def _gather(builder, addresses):
    """Two nodes at each address as one number, the first one in its lower half."""
    kind, pointers = ir.VectorType(INTEGER, BLOCK), ir.VectorType(INTEGER.as_pointer(), BLOCK)
    lanes = ir.VectorType(ir.IntType(1), BLOCK)
    function = cgutils.get_or_insert_function(
        builder.module, ir.FunctionType(kind, (pointers, INTEGER, lanes, kind)),
        f"llvm.masked.gather.v{BLOCK}i32.v{BLOCK}p0",
    )  # fmt: skip
    every, nothing = ir.Constant(lanes, [1] * BLOCK), ir.Constant(kind, ir.Undefined)
    return builder.call(function, (builder.inttoptr(addresses, pointers), INTEGER(2), every, nothing))
