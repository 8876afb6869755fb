"""Numbers that carry their derivatives: forward differentiation of whatever NumPy computes with them.

A law is written once, with NumPy's functions. Called with arrays it gives values; called with
`Dual` numbers it gives values and exact derivatives (Griewank & Walther, Evaluating Derivatives,
2nd ed., 2008, chapter 3). Roots of such functions have derivatives too: so has the sinkage at which
a soil carries a load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from terrain_cli.vocabulary.arrays import Array, Mask

_SAME = 1.0  # The derivative that changes nothing: no product is formed with it
#: Derivatives by each argument, from the arguments and the result.
_ONE: dict[np.ufunc, Callable[[Any, Any], Any]] = {
    np.negative: lambda _x, _y: -1.0,
    np.positive: lambda _x, _y: 1.0,
    np.absolute: lambda x, _y: np.sign(x),
    np.sign: lambda x, _y: np.zeros_like(x),
    np.square: lambda x, _y: 2.0 * x,
    np.sqrt: lambda _x, y: 0.5 / y,
    np.exp: lambda _x, y: y,
    np.expm1: lambda _x, y: y + 1.0,
    np.log: lambda x, _y: 1.0 / x,
    np.log1p: lambda x, _y: 1.0 / (1.0 + x),
    np.sin: lambda x, _y: np.cos(x),
    np.cos: lambda x, _y: -np.sin(x),
    np.tan: lambda _x, y: 1.0 + y * y,
    np.arcsin: lambda x, _y: 1.0 / np.sqrt(1.0 - x * x),
    np.arccos: lambda x, _y: -1.0 / np.sqrt(1.0 - x * x),
    np.arctan: lambda x, _y: 1.0 / (1.0 + x * x),
    np.tanh: lambda _x, y: 1.0 - y * y,
}


_TWO: dict[np.ufunc, tuple[Callable[[Any, Any, Any], Any], Callable[[Any, Any, Any], Any]]] = {
    np.add: (lambda _a, _b, _y: _SAME, lambda _a, _b, _y: _SAME),
    np.subtract: (lambda _a, _b, _y: _SAME, lambda _a, _b, _y: -1.0),
    np.multiply: (lambda _a, b, _y: b, lambda a, _b, _y: a),
    np.true_divide: (lambda _a, b, _y: 1.0 / b, lambda _a, b, y: -y / b),
    # 0 ** p is 0 for every p > 0.
    np.power: (
        lambda x, p, _y: p * np.power(x, p - 1.0),
        lambda x, _p, y: y * np.log(np.where(x > 0.0, x, 1.0)),
    ),
    np.maximum: (lambda a, b, _y: np.where(a >= b, 1.0, 0.0), lambda a, b, _y: np.where(a >= b, 0.0, 1.0)),
    np.minimum: (lambda a, b, _y: np.where(a <= b, 1.0, 0.0), lambda a, b, _y: np.where(a <= b, 0.0, 1.0)),
}
#: Without a derivative: where they are asked, only values count.
_PLAIN = frozenset(
    {np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal, np.isfinite, np.isnan}
)


class Dual(NDArrayOperatorsMixin):
    """An array and its derivatives.

    `slopes` are by each quantity it depends on, of a shape that goes with that of `value`; a quantity that is
    not named has no influence.
    """

    __slots__ = ("slopes", "value")
    # Before numpy's own, so that array * dual comes here.
    __array_priority__ = 100.0

    def __init__(self, value: Array | float, slopes: Mapping[str, Array | float]) -> None:
        self.value = np.asarray(value, dtype=float)
        self.slopes: dict[str, Any] = dict(slopes)

    def __getitem__(self, key: Any) -> Dual:
        return Dual(
            self.value[key],
            {name: np.broadcast_to(slope, self.value.shape)[key] for name, slope in self.slopes.items()},
        )

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **kwargs: Any) -> Any:
        """Apply a function of NumPy by the chain rule."""
        if method != "__call__" or kwargs:
            return NotImplemented
        values = [value(x) for x in inputs]
        result = ufunc(*values)
        if ufunc in _PLAIN:
            return result
        if ufunc in _ONE:
            return chain(result, [(_ONE[ufunc](values[0], result), inputs[0])])
        if ufunc in _TWO:
            rules: tuple[Any, Any] = _TWO[ufunc]
            # Only the derivatives that are used: that of 0 ** x by its base may not exist.
            parts = [
                (rule(*values, result), x)
                for rule, x in zip(rules, inputs, strict=True)
                if isinstance(x, Dual)
            ]
            return chain(result, parts)
        return NotImplemented

    def __array_function__(self, function: Any, types: Any, args: Any, kwargs: Any) -> Any:
        """Choose between numbers with `numpy.where`; nothing else of NumPy's functions is known."""
        if function is not np.where or len(args) != 3:
            return NotImplemented
        condition, a, b = args
        first, second = slopes(a), slopes(b)
        # No product with 0 or 1: what is not chosen may have no derivative.
        chosen = {
            name: np.where(condition, first.get(name, 0.0), second.get(name, 0.0))
            for name in {**first, **second}
        }
        return Dual(np.where(condition, value(a), value(b)), chosen)


def value(x: Any) -> Any:
    """Return a number without its derivatives."""
    return x.value if isinstance(x, Dual) else x


def slopes(x: Any) -> dict[str, Any]:
    """Return the derivatives of a number: none for a plain one."""
    return x.slopes if isinstance(x, Dual) else {}


def chain(result: Any, parts: list[tuple[Any, Any]]) -> Any:
    """Give a result its derivatives by the chain rule: `parts` are its derivative by a number, and that."""
    total: dict[str, Any] = {}
    for outer, number in parts:
        for name, inner in slopes(number).items():
            term = inner if outer is _SAME else outer if inner is _SAME else outer * inner
            total[name] = total[name] + term if name in total else term
    return Dual(result, total) if total else cast("Array", result)


def rows(totals: Array, parts: list[tuple[Array, Any]]) -> list[Any]:
    """Give several results, shape (m, n), their derivatives, as `chain` does for one."""
    together = chain(totals, parts)
    by = slopes(together)
    if not by:
        return list(together)
    return [Dual(row, {name: slope[j] for name, slope in by.items()}) for j, row in enumerate(totals)]


def seed(x: Any, name: str) -> Dual:
    """Return a number by which to differentiate."""
    return Dual(np.asarray(x, dtype=float), {name: _SAME})


UNKNOWN = "(unknown)"  # Stands for the unknown among the names of derivatives
#: Most steps: Newton takes a handful, bisection alone would take 50; and steps after which a soil is asked
#: whether it carries the load at all.
_STEPS, _PATIENCE = 100, 7
CLOSE = 1e-12  # Error that a root may have, as a share


def carrying(
    carried: Callable[[Array], Array],
    load: Array,
    start: Array,
    steep: Array,
    deepest: float,
    close: float = CLOSE,
) -> tuple[Array, Mask]:
    """Find the sinkage in m at which a soil carries a load in N, and tell where there is one.

    Steps along secants, on the logarithms, of which load and sinkage nearly are a line, kept within a bracket
    that bisection narrows where a step would leave it.

    `carried` gives the load of a sinkage; `start` is a guess, of which NaN will do, and `steep` one of the
    slope of the logarithms. `deepest` is the most that is sought, and `close` the error that may be left, as
    a share. There is none where the soil does not carry the load at the deepest, or the load is not positive.
    """
    high = np.full(load.shape, np.log(deepest))
    low = high + np.log(1e-9)
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.log(start)
        place = np.where((place > low) & (place < high), place, high - 1.0)
        hopeless = ~(load > 0.0)
        done = hopeless.copy()
        # Before the first secant a step may be off by as much as it is long.
        here, way = carried(np.exp(place)), np.ones(load.shape)
        for number in range(_STEPS):
            short = here < load
            low, high = np.where(short, place, low), np.where(short, high, place)
            step = np.log(load / here) / steep
            target = place + step
            safe = (target > low) & (target < high)
            # What a step leaves is less than its product with the one before.
            last = np.abs(step * way) <= close
            # As small a step may leave the bracket by rounding.
            target = np.where(safe | last, target, 0.5 * (low + high))
            target = np.where(done, place, target)
            done |= last
            if number == _PATIENCE:
                hopeless |= ~done & ~(carried(np.full(load.shape, deepest)) >= load)
                done |= hopeless
            if np.all(done):
                break
            before, here, way = here, carried(np.exp(target)), target - place
            steep = np.where(way == 0.0, steep, np.log(here / before) / way)
            place = target
    return np.exp(target), done & ~hopeless


def inverse(shown: Callable[[Dual], Any], measured: Array) -> Array:
    """Find the true values, shape (n,), that a sensor's law shows as those measured, by Newton's method."""
    true = measured
    for _ in range(_STEPS):
        here = shown(seed(true, UNKNOWN))
        step = (value(here) - measured) / slopes(here)[UNKNOWN]
        true = true - step
        if not np.any(np.abs(step) > CLOSE * np.abs(true)):
            break
    return true


def implicit(root: Array, residual: Any) -> Any:
    """Give a root its derivatives by all that its residual depends on.

    `residual` is zero at the root, and has derivatives by the root (`UNKNOWN`) and by all else.
    """
    steep = slopes(residual)[UNKNOWN]
    others = {name: -slope / steep for name, slope in slopes(residual).items() if name != UNKNOWN}
    return Dual(root, others) if others else root
