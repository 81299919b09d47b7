"""Arithmetic of compiled loops over lanes: no call into a library, so that they become vectors."""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from pipeline.kernels import compiled

FARTHEST = 0.75
"""Greatest argument of the polynomial; exp(-32 * 0.75) = 3.8e-11 is the least result."""
_C1, _C2, _C3 = -0.9999999997846465, 0.49999999118359084, -0.16666654169228362
_C4, _C5, _C6 = 0.04166580070145177, -0.008329979729521968, 0.001381231089254686
_C7, _C8 = -0.00018808908195194982, 1.7037782499404607e-05
# of exp(-t), t up to FARTHEST, with exp(0) = 1: the least greatest relative error, 1.7e-12


@intrinsic
def fused(context, a, b, c):  # type: ignore[no-untyped-def]
    """Return a b + c, rounded once, in one instruction: no compiler may make it of two."""
    signature = types.float64(types.float64, types.float64, types.float64)
    return signature, lambda target, builder, _, arguments: builder.fma(*arguments)


@intrinsic
def greater(context, a, b):  # type: ignore[no-untyped-def]
    """The greater of two numbers in one instruction; neither may be NaN.

    A comparison would be stored in single lanes, which the next load of them has to wait for.
    """

    def build(target, builder, signature, arguments):  # type: ignore[no-untyped-def]
        number = arguments[0].type
        maximum = builder.module.declare_intrinsic(
            "llvm.maxnum", [number], ir.FunctionType(number, [number, number])
        )
        return builder.call(maximum, arguments, fastmath=("nnan", "nsz"))

    return types.float64(types.float64, types.float64), build


@intrinsic
def put_into_caller(context):  # type: ignore[no-untyped-def]
    """Make the function that calls this part of its callers, however long it is."""

    def mark(target, builder, signature, arguments):  # type: ignore[no-untyped-def]
        builder.function.attributes.add("alwaysinline")
        return target.get_dummy_value()

    return types.none(), mark


@intrinsic
def in_widest_vectors(context):  # type: ignore[no-untyped-def]
    """Let the compiler use 512 bits in the function that calls this, where the processor has them.

    Left alone it takes 256, for fear of the clock of older processors.
    """

    def mark(target, builder, signature, arguments):  # type: ignore[no-untyped-def]
        # the library knows the attributes without a value only, and refuses others in its own add
        set.add(builder.function.attributes, '"prefer-vector-width"="512"')
        return target.get_dummy_value()

    return types.none(), mark


@compiled
def decay(y):  # type: ignore[no-untyped-def]
    """exp(-32 y) of y >= 0: relative error 6e-11 up to y = 0.75, absolute 4e-11; 1 at 0."""
    t = min(y, FARTHEST)
    t2 = t * t
    t4 = t2 * t2
    low = fused(t2, fused(t, _C3, _C2), fused(t, _C1, 1.0))
    high = fused(t2, fused(t, _C7, _C6), fused(t, _C5, _C4))
    d = fused(t4, fused(t4, _C8, high), low)
    d *= d
    d *= d
    d *= d
    d *= d
    return d * d
