"""LLVM's own vectors for kernels: arithmetic on many floats at once, written once for every processor.

numba leaves vectors to LLVM's loop vectorizer, which gives up where it cannot prove that streams do not overlap, and
its straight-line vectorizer is off.  A ``Vector`` is such a value inside an intrinsic, with the operators of Python, so
that a formula still reads like one.  Products and sums may contract, as everywhere in the kernels; nothing else.
"""

from __future__ import annotations

from .llvm import cgutils, ir

FLAGS = ("contract", "arcp", "nsz")

FLOAT, DOUBLE, INTEGER = ir.FloatType(), ir.DoubleType(), ir.IntType(32)


# The vectors themselves, for code whose arithmetic has other flags than a Vector's.
def place(context, builder, array_type, array, index):
    """Pointer to element ``index`` of a flat array; no bounds checks."""
    return builder.gep(context.make_array(array_type)(context, builder, array).data, [index])


def load(builder, pointer, count: int, kind=FLOAT):
    """``count`` lanes from memory of any alignment; ``pointer`` to a single number."""
    value = builder.load(builder.bitcast(pointer, ir.VectorType(kind, count).as_pointer()))
    value.align = 4
    return value


def store(builder, value, pointer):
    """The lanes of ``value`` to where ``load`` would find them."""
    builder.store(value, builder.bitcast(pointer, value.type.as_pointer())).align = 4


def pick(builder, value, lanes, other=None):
    """Lanes of a vector, and, counted on from its last, of another one, in the order given."""
    mask = ir.Constant(ir.VectorType(INTEGER, len(lanes)), list(lanes))
    return builder.shuffle_vector(value, value if other is None else other, mask)


def spread(builder, scalar, count: int):
    """The same number in all lanes."""
    nothing = ir.Constant(ir.VectorType(scalar.type, count), ir.Undefined)
    return pick(builder, builder.insert_element(nothing, scalar, ir.Constant(INTEGER, 0)), [0] * count)


class Vector:
    """``count`` lanes of float32, float64 or int32."""

    def __init__(self, builder, value):
        self.builder, self.value = builder, value

    @property
    def count(self) -> int:
        return self.value.type.count

    @classmethod
    def load(cls, builder, pointer, count: int, kind=FLOAT):
        """See ``vectors.load``."""
        return cls(builder, load(builder, pointer, count, kind))

    @classmethod
    def spread(cls, builder, scalar, count: int):
        """The same number in all lanes."""
        return cls(builder, spread(builder, scalar, count))

    def store(self, pointer):
        store(self.builder, self.value, pointer)

    def like(self, number):
        """``number`` as a vector of this one's kind."""
        if isinstance(number, Vector):
            return number.value
        return ir.Constant(self.value.type, [number] * self.count)

    def shuffle(self, other, lanes):
        """Lanes of this vector (below ``count``) and of another value, in the order given."""
        return Vector(self.builder, pick(self.builder, self.value, lanes, other))

    def _with(self, operation, other, flags=FLAGS):
        return Vector(self.builder, operation(self.value, self.like(other), flags=flags))

    def __add__(self, other):
        return self._with(self.builder.fadd, other)

    def __sub__(self, other):
        return self._with(self.builder.fsub, other)

    def __mul__(self, other):
        return self._with(self.builder.fmul, other)

    def _called(self, name: str, *others):
        """One of LLVM's own functions of vectors of this one's kind."""
        kind = self.value.type
        name = f"llvm.{name}.v{self.count}f{64 if kind.element == DOUBLE else 32}"
        given = (self.value, *map(self.like, others))
        function = cgutils.get_or_insert_function(
            self.builder.module, ir.FunctionType(kind, (kind,) * len(given)), name
        )
        return Vector(self.builder, self.builder.call(function, given))

    def fused(self, share, added):
        """``self * share + added``, the product unrounded wherever the processor can.

        Which products a sum takes up unrounded is else LLVM's choice, at every place anew.
        """
        return self._called("fmuladd", share, added)

    def mixed(self, share, other, other_share):
        """``self * share + other * other_share``, of which the latter product is rounded first; see ``fused``."""
        return self.fused(share, other * other_share)

    def root(self):
        """The square root, lane by lane."""
        return self._called("sqrt")

    def size(self):
        """The value without its sign, lane by lane."""
        return self._called("fabs")

    def __truediv__(self, other):
        return self._with(self.builder.fdiv, other, ())

    def at_least(self, other):
        """A mask: lanes not below ``other``."""
        return self.builder.fcmp_ordered(">=", self.value, self.like(other))

    def where(self, mask, other):
        """These lanes where the mask holds, else ``other``'s."""
        return Vector(self.builder, self.builder.select(mask, self.value, self.like(other)))

    def least(self, other):
        """The smaller of two, lane by lane."""
        below = self.builder.fcmp_ordered("<", self.value, self.like(other))
        return self.where(below, other)

    def most(self, other):
        """The larger of two, lane by lane."""
        above = self.builder.fcmp_ordered(">", self.value, self.like(other))
        return self.where(above, other)

    def truncated(self):
        """The whole part as int32 lanes."""
        return Vector(self.builder, self.builder.fptosi(self.value, ir.VectorType(INTEGER, self.count)))

    def as_float(self, kind=FLOAT):
        """int32 lanes to floating point lanes of the same value."""
        return Vector(self.builder, self.builder.sitofp(self.value, ir.VectorType(kind, self.count)))

    def as_single(self):
        """float64 lanes rounded to float32."""
        return Vector(self.builder, self.builder.fptrunc(self.value, ir.VectorType(FLOAT, self.count)))

    def widened(self, kind):
        """float32 or float64 lanes as lanes of ``kind``, which is no narrower; the values are the same."""
        if kind == self.value.type.element:
            return self
        return Vector(self.builder, self.builder.fpext(self.value, ir.VectorType(kind, self.count)))

    def power_of_two(self, kind=FLOAT):
        """2**n of int32 lanes -126 <= n <= 127, exactly: the exponent field of a float32, or of a float64."""
        exponent, bias, start = self, 127, 23
        if kind == DOUBLE:
            wide = ir.VectorType(ir.IntType(64), self.count)
            exponent, bias, start = Vector(self.builder, self.builder.sext(self.value, wide)), 1023, 52
        biased = self.builder.add(exponent.value, exponent.like(bias))
        bits = self.builder.shl(biased, exponent.like(start))
        return Vector(self.builder, self.builder.bitcast(bits, ir.VectorType(kind, self.count)))


def count_lanes(builder, mask, count: int):
    """How many lanes of a mask hold, as an integer of 64 bits."""
    bits = builder.bitcast(mask, ir.IntType(count))
    return builder.zext(builder.ctpop(bits), ir.IntType(64))


def transpose4(rows):
    """Four vectors of four lanes, rows and columns exchanged; or of several groups of four, each for itself."""
    a, b, c, d = rows
    count = a.count

    def in_groups(first, second, lanes):
        """Lanes 0 to 3 of each group of the first vector, 4 to 7 of the same group of the second."""
        shifted = [lane if lane < 4 else count + lane - 4 for lane in lanes]
        return first.shuffle(second.value, [group + lane for group in range(0, count, 4) for lane in shifted])

    low, high = in_groups(a, b, (0, 4, 1, 5)), in_groups(a, b, (2, 6, 3, 7))
    low2, high2 = in_groups(c, d, (0, 4, 1, 5)), in_groups(c, d, (2, 6, 3, 7))
    return (
        in_groups(low, low2, (0, 1, 4, 5)), in_groups(low, low2, (2, 3, 6, 7)),
        in_groups(high, high2, (0, 1, 4, 5)), in_groups(high, high2, (2, 3, 6, 7)),
    )  # fmt: skip
