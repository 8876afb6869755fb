"""Numbers that carry their derivatives: forward differentiation of whatever NumPy computes with them.

A law is written once, with NumPy's functions. Called with arrays it gives values; called with
`Dual` numbers it gives values and exact derivatives (Griewank & Walther, Evaluating Derivatives,
2nd ed., 2008, chapter 3).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    Array = NDArray[np.float64]

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


def _by_base(x: Any, p: Any, _y: Any) -> Any:
    return p * np.power(x, p - 1.0)


def _by_exponent(x: Any, _p: Any, y: Any) -> Any:
    # 0 ** p is 0 for every p > 0.
    return y * np.log(np.where(x > 0.0, x, 1.0))


_TWO: dict[np.ufunc, tuple[Callable[[Any, Any, Any], Any], Callable[[Any, Any, Any], Any]]] = {
    np.add: (lambda _a, _b, _y: 1.0, lambda _a, _b, _y: 1.0),
    np.subtract: (lambda _a, _b, _y: 1.0, lambda _a, _b, _y: -1.0),
    np.multiply: (lambda _a, b, _y: b, lambda a, _b, _y: a),
    np.true_divide: (lambda _a, b, _y: 1.0 / b, lambda _a, b, y: -y / b),
    np.power: (_by_base, _by_exponent),
    np.maximum: (
        lambda a, b, _y: np.where(a >= b, 1.0, 0.0),
        lambda a, b, _y: np.where(a >= b, 0.0, 1.0),
    ),
    np.minimum: (
        lambda a, b, _y: np.where(a <= b, 1.0, 0.0),
        lambda a, b, _y: np.where(a <= b, 0.0, 1.0),
    ),
}
#: Without a derivative: where they are asked, only values count.
_PLAIN = frozenset(
    {np.less, np.less_equal, np.greater, np.greater_equal, np.equal, np.not_equal, np.isfinite, np.isnan}
)


class Dual(NDArrayOperatorsMixin):
    """An array and its derivatives.

    Parameters
    ----------
    slopes : mapping of str to ndarray
        Derivative by each quantity it depends on, of a shape that goes with that of `value`; a
        quantity that is not named has no influence.
    """

    __slots__ = ("slopes", "value")
    # Before numpy's own, so that array * dual comes here.
    __array_priority__ = 100.0

    def __init__(self, value: Array | float, slopes: Mapping[str, Array | float]) -> None:
        self.value = np.asarray(value, dtype=float)
        self.slopes: dict[str, Any] = dict(slopes)

    def __repr__(self) -> str:
        return f"Dual({self.value!r}, {self.slopes!r})"

    def __len__(self) -> int:
        return len(self.value)

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the value."""
        return self.value.shape

    def __getitem__(self, key: Any) -> Dual:
        """Return some of the entries."""
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
    """Give a result its derivatives by the chain rule.

    Parameters
    ----------
    parts : list of (ndarray, Dual or ndarray)
        Derivative of the result by a number, and that number.
    """
    total: dict[str, Any] = {}
    for outer, number in parts:
        for name, inner in slopes(number).items():
            term = outer * inner
            total[name] = total[name] + term if name in total else term
    return Dual(result, total) if total else cast("Array", result)


def seed(x: Any, name: str) -> Dual:
    """Return a number by which to differentiate."""
    return Dual(np.asarray(x, dtype=float), {name: 1.0})
