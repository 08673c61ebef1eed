"""numba's way from typed code to LLVM's, for what kernels are made of, in a third of the words.

For every element of an array numba lays the whole array out in memory and looks at each of its fields; for every loop
it prepares for steps that may be negative; for every sum it asks three times whether a number is written in the code.
LLVM finds all of it idle and takes it away again; a first picture waits for both.  Here whole numbers and floats,
elements and slices of arrays, and ranges are said plainly, to the same end; whatever else there is, numba says itself.
"""

from __future__ import annotations

import operator

from llvmlite import ir as llvm
from numba.core import cgutils, ir, types
from numba.core.imputils import impl_ret_borrowed
from numba.core.lowering import Lower
from numba.np.arrayobj import load_item, store_item

INTP = llvm.IntType(types.intp.bitwidth)
LAST = 2 ** (types.intp.bitwidth - 1) - 1  # where a slice ends that has no end
# Operators of two numbers of one kind, by what they are called on whole numbers and on floats.
SUMS = {operator.add: "add", operator.sub: "sub", operator.mul: "mul"}
BITS = {operator.and_: "and_", operator.or_: "or_", operator.xor: "xor"}
COMPARISONS = {
    operator.lt: "<", operator.le: "<=", operator.gt: ">", operator.ge: ">=", operator.eq: "==", operator.ne: "!=",
}  # fmt: skip
IN_PLACE = {
    operator.iadd: operator.add, operator.isub: operator.sub, operator.imul: operator.mul,
    operator.iand: operator.and_, operator.ior: operator.or_, operator.ixor: operator.xor,
}  # fmt: skip


def _is_constant(value, *numbers) -> bool:
    return isinstance(value, llvm.Constant) and value.constant in numbers


class _Builder(llvm.IRBuilder):
    """LLVM's code as it is written down, without taking apart what was put together a line before."""

    def extract_value(self, agg, idx, name=""):
        path = list(idx) if isinstance(idx, (tuple, list)) else [idx]
        while isinstance(agg, llvm.InsertValue):
            put = list(agg.indices)
            if put == path[: len(put)]:
                agg, path = agg.value, path[len(put) :]
                if not path:
                    return agg
            elif path == put[: len(path)]:
                break  # a part of what is asked for
            else:
                agg = agg.aggregate
        return super().extract_value(agg, path, name)


class PlainLower(Lower):
    """numba's own, but for what is said plainly; without a debugger's measures or errors told by their lines."""

    def setup_function(self, fndesc):
        super().setup_function(fndesc)
        self.builder = _Builder(self.entry_block)
        self.call_helper = self.call_conv.init_call_helper(self.builder)

    # --- variables

    def _is_counted(self, kind) -> bool:
        """Whether a variable of this type holds references."""
        return self.context.enable_nrt and self.context.data_model_manager[kind].contains_nrt_meminfo()

    def alloca_lltype(self, name, lltype, datamodel=None):
        return cgutils.alloca_once(self.builder, lltype, name=name, zfill=False)

    def storevar(self, value, name, argidx=None):
        if name in self._singly_assigned_vars:
            self._blk_local_varmap[name] = value
        elif self._is_counted(self.typeof(name)):
            super().storevar(value, name)
        else:
            self.builder.store(value, self.getvar(name))

    def delvar(self, name):
        if self._is_counted(self.typeof(name)):
            super().delvar(name)
        elif name not in self._blk_local_varmap:
            self._singly_assigned_vars.discard(name)
            self.getvar(name)

    def lower_block(self, block):
        self.pre_block(block)
        for line in block.body:
            self.loc = line.loc
            self.lower_inst(line)
        self.post_block(block)

    def lower_inst(self, inst):
        if type(inst) is ir.Assign:
            name = inst.target.name
            self.storevar(self.lower_assign(self.typeof(name), inst), name)
        elif type(inst) is ir.Del:
            self.delvar(inst.value)
        else:
            super().lower_inst(inst)

    # --- numbers

    def lower_expr(self, resty, expr):
        plainly = getattr(self, f"_plain_{expr.op}", None)
        value = None if plainly is None else plainly(resty, expr)
        return super().lower_expr(resty, expr) if value is None else value

    def _plain_inplace_binop(self, resty, expr):
        return self._sum(resty, expr, IN_PLACE.get(expr.fn))

    def _plain_binop(self, resty, expr):
        return self._sum(resty, expr, expr.fn)

    def _sum(self, resty, expr, function):
        signature = self.fndesc.calltypes[expr]
        kind, whole = signature.args[0], isinstance(signature.args[0], types.Integer)
        plain = function in SUMS or function in COMPARISONS or (function in BITS and whole)
        gives = types.boolean if function in COMPARISONS else kind
        if not plain or not isinstance(kind, (types.Integer, types.Float)) or isinstance(kind, types.Literal):
            return None
        if signature.args[1] != kind or signature.return_type != gives:
            return None
        a, b = (self._as(variable, kind) for variable in (expr.lhs, expr.rhs))
        build = self.builder
        if function in COMPARISONS:
            symbol = COMPARISONS[function]
            if whole:
                value = (build.icmp_signed if kind.signed else build.icmp_unsigned)(symbol, a, b)
            else:
                value = (build.fcmp_unordered if symbol == "!=" else build.fcmp_ordered)(symbol, a, b)
        else:
            name = BITS.get(function) or SUMS[function]
            # As numba says it, no number wraps round: so loops are seen to go one way, and become wide.
            flags = ("nsw",) if whole and kind.signed and function in SUMS else ()
            value = getattr(build, name if whole else f"f{name}")(a, b, flags=flags)
        return self.context.cast(build, value, gives, resty)

    def _as(self, variable, kind):
        return self.context.cast(self.builder, self.loadvar(variable.name), self.typeof(variable.name), kind)

    # --- ranges and slices

    def _plain_call(self, resty, expr):
        called = getattr(self.typeof(expr.func.name), "typing_key", None)
        if called not in (range, slice) or expr.kws or expr.vararg or (called is slice and resty.has_step):
            return None
        kind, parts = (types.intp, [0, LAST, 1]) if called is slice else (resty.dtype, [0, None, 1])
        for place, variable in zip((1,) if len(expr.args) == 1 else (0, 1, 2), expr.args, strict=False):
            if self.typeof(variable.name) is not types.none:
                parts[place] = self._as(variable, kind)
        number = self.context.get_value_type(kind)
        return self._put_together(resty, [number(part) if isinstance(part, int) else part for part in parts])

    def _put_together(self, kind, parts):
        whole = self.context.get_value_type(kind)(llvm.Undefined)
        for place, part in enumerate(parts):
            whole = self.builder.insert_value(whole, part, place)
        return whole

    def _plain_getiter(self, resty, expr):
        kind = self.typeof(expr.value.name)
        if not isinstance(kind, types.RangeType):
            return None
        build, held = self.builder, self.loadvar(expr.value.name)
        start, stop, step = (build.extract_value(held, place) for place in range(3))
        if not _is_constant(step, 1):
            return None
        length = build.sub(stop, start)
        zero = length.type(0)
        count = build.select(build.icmp_signed(">", length, zero), length, zero)
        at, left = (cgutils.alloca_once(build, number.type) for number in (start, count))
        build.store(start, at)
        build.store(count, left)
        return self._put_together(resty, (at, stop, step, left))

    def _plain_iternext(self, resty, expr):
        if not isinstance(self.typeof(expr.value.name), types.RangeIteratorType):
            return None
        build, held = self.builder, self.loadvar(expr.value.name)
        at, _, step, left = (build.extract_value(held, place) for place in range(4))
        number, count = build.load(at), build.load(left)
        more = build.icmp_signed(">", count, count.type(0))
        with build.if_then(more):
            build.store(build.add(number, step), at)
            build.store(build.sub(count, count.type(1), flags=["nsw"]), left)
        return self._put_together(resty, (number, more))

    def _plain_pair_first(self, resty, expr):
        return self._part_of_pair(expr, resty, 0)

    def _plain_pair_second(self, resty, expr):
        return self._part_of_pair(expr, resty, 1)

    def _part_of_pair(self, expr, kind, place):
        return None if self._is_counted(kind) else self.builder.extract_value(self.loadvar(expr.value.name), place)

    # --- arrays

    def _plain_getitem(self, resty, expr):
        return self._item(resty, expr.value, expr.index, self.fndesc.calltypes[expr])

    def _plain_static_getitem(self, resty, expr):
        kind = self.typeof(expr.value.name)
        if isinstance(kind, types.BaseTuple) and type(expr.index) is int and not self._is_counted(resty):
            part = self.builder.extract_value(self.loadvar(expr.value.name), range(len(kind))[expr.index])
            return self.context.cast(self.builder, part, kind.types[expr.index], resty)
        if expr.index_var is None or self.fndesc.calltypes.get(expr) is None:
            return None
        return self._item(resty, expr.value, expr.index_var, self.fndesc.calltypes[expr])

    def lower_setitem(self, target_var, index_var, value_var, signature):
        kind, indices = self.typeof(target_var.name), self._indices(target_var, index_var)
        if indices is None or len(indices) < kind.ndim or any(isinstance(i, tuple) for i in indices):
            return super().lower_setitem(target_var, index_var, value_var, signature)
        value = self.context.cast(self.builder, self.loadvar(value_var.name), self.typeof(value_var.name), kind.dtype)
        store_item(self.context, self.builder, kind, value, self._pointer(_Array(self, target_var), indices))

    def _indices(self, variable, index_variable):
        """Numbers, and bounds of slices, by which an array of numbers is indexed; None for any other index."""
        kind, index = self.typeof(variable.name), self.typeof(index_variable.name)
        if type(kind) is not types.Array or not isinstance(kind.dtype, (types.Number, types.Boolean)):
            return None
        many = isinstance(index, types.BaseTuple)
        kinds = index.types if many else (index,)
        slices = [isinstance(k, types.SliceType) and not k.has_step for k in kinds]
        plain = all(a_slice or isinstance(k, types.Integer) for a_slice, k in zip(slices, kinds, strict=True))
        if not plain or len(kinds) > kind.ndim or self.context.enable_boundscheck:
            return None
        build, array = self.builder, _Array(self, variable)
        value = self.loadvar(index_variable.name)
        values = [build.extract_value(value, place) for place in range(len(kinds))] if many else [value]
        return [self._index(array, axis, *of) for axis, of in enumerate(zip(values, kinds, strict=True))]

    def _index(self, array, axis, value, kind):
        build = self.builder
        if isinstance(kind, types.SliceType):
            return tuple(self._bound(array, axis, build.extract_value(value, end)) for end in range(2))
        if not kind.signed:
            return self.context.cast(build, value, kind, types.uintp)
        return self._from_front(array, axis, self.context.cast(build, value, kind, types.intp))

    def _from_front(self, array, axis, number):
        """A place along an axis; those below zero count from the end."""
        build = self.builder
        if isinstance(number, llvm.Constant) and number.constant is not None and number.constant >= 0:
            return number
        wrapped = build.add(array.part("shape", axis), number)
        return build.select(build.icmp_signed("<", number, INTP(0)), wrapped, number)

    def _bound(self, array, axis, number):
        """An end of a slice, brought into the array."""
        build = self.builder
        if _is_constant(number, 0):
            return number
        size = array.part("shape", axis)
        if _is_constant(number, LAST):
            return size
        number = self._from_front(array, axis, number)
        number = build.select(build.icmp_signed("<", number, INTP(0)), INTP(0), number)
        return build.select(build.icmp_signed(">", number, size), size, number)

    def _pointer(self, array, indices):
        """To the first of the elements that are indexed."""
        build = self.builder
        places = [index[0] if isinstance(index, tuple) else index for index in indices]
        data = array.part("data")
        if array.kind.layout == "C":
            return build.gep(data, [self._place_in_row(array, places)])
        offset = None
        for axis, place in enumerate(places):
            step = build.mul(array.part("strides", axis), place)
            offset = step if offset is None else build.add(offset, step)
        return cgutils.pointer_add(build, data, offset)

    def _place_in_row(self, array, places):
        """The number of an element among all of an array without gaps; what does not change in a loop is not in it."""
        build, place, step = self.builder, None, None
        for axis in reversed(range(array.kind.ndim)):
            if axis < len(places) and not _is_constant(places[axis], 0):
                further = places[axis] if step is None else build.mul(places[axis], step)
                place = further if place is None else build.add(further, place)
            if axis > 0:
                size = array.part("shape", axis)
                step = size if step is None else build.mul(size, step)
        return INTP(0) if place is None else place

    def _item(self, resty, variable, index_variable, signature):
        """An element or a view of an array; None when the index is not plain."""
        indices = self._indices(variable, index_variable)
        if indices is None or not isinstance(signature.return_type, (types.Number, types.Boolean, types.Array)):
            return None
        build, array, kind = self.builder, _Array(self, variable), signature.return_type
        pointer = self._pointer(array, indices)
        if not isinstance(kind, types.Array):
            if isinstance(kind, types.Boolean):
                byte = build.load(pointer)
                return build.icmp_unsigned("!=", byte, byte.type(0))
            return self.context.cast(build, load_item(self.context, build, array.kind, pointer), kind, resty)
        sizes, strides = [], []
        for axis in range(array.kind.ndim):
            index = indices[axis] if axis < len(indices) else None
            if index is None:
                sizes.append(array.part("shape", axis))
            elif isinstance(index, tuple):
                length = index[1] if _is_constant(index[0], 0) else build.sub(index[1], index[0])
                if length is not index[1]:
                    length = build.select(build.icmp_signed(">", length, INTP(0)), length, INTP(0))
                sizes.append(length)
            else:
                continue
            strides.append(array.part("strides", axis))
        count = sizes[0]
        for size in sizes[1:]:
            count = build.mul(count, size, flags=["nsw"])
        parts = [array.part(name) for name in ("meminfo", "parent")]
        parts += [count, array.part("itemsize"), pointer]
        parts += [cgutils.pack_array(build, numbers, INTP) for numbers in (sizes, strides)]
        view = self._put_together(kind, parts)
        if self._is_counted(kind):
            view = impl_ret_borrowed(self.context, build, kind, view)
        return self.context.cast(build, view, kind, resty)


class _Array:
    """An array variable, of which only those fields are looked at that are asked for."""

    def __init__(self, lower, variable):
        self.lower, self.name = lower, variable.name
        self.kind = lower.typeof(variable.name)
        self._fields = lower.context.data_model_manager[self.kind]

    def part(self, field, axis=None):
        build, path = self.lower.builder, [self._fields.get_field_position(field)]
        if axis is not None:
            path.append(axis)
        value = self.lower._blk_local_varmap.get(self.name)
        if value is not None:
            return build.extract_value(value, path)
        return build.load(cgutils.gep_inbounds(build, self.lower.getvar(self.name), 0, *path))
