"""A series of samples of which a few are replaced, without a copy of the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from terrain_cli.windows.segmentation.block_sums import is_run

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Index = NDArray[np.intp]


class ReplacedSamples:
    """Samples (x, y), in Pa, in the order of time; one at least."""

    def __init__(self, x: Array, y: Array) -> None:
        self._values = x, y
        self._place = np.empty(0, dtype=np.intp)
        self._instead = np.empty((2, 0))

    def __len__(self) -> int:
        return len(self._values[0])

    def check_finite(self) -> None:
        """Raise a ValueError where a sample is not finite."""
        if not all(np.isfinite(values).all() for values in self._values):
            raise ValueError("x and y must be finite")

    def replace(self, place: Index, values: Array) -> None:
        """Take other values, shape (2, k), for some samples."""
        place = np.concatenate([place, self._place])
        # What came last is the first of equals.
        order = np.argsort(place, kind="stable")
        order = order[np.diff(place[order], prepend=-1) > 0]
        self._place = place[order]
        self._instead = np.concatenate([values, self._instead], axis=1)[:, order]

    def at(self, place: Index) -> Array:
        """Return samples, shape (2, ...); behind the end the last one is repeated."""
        place = np.minimum(place, len(self) - 1)
        found = np.stack([values[place] for values in self._values])
        if len(self._place):
            nearest = np.minimum(np.searchsorted(self._place, place), len(self._place) - 1)
            replaced = self._place[nearest] == place
            found[:, replaced] = self._instead[:, nearest[replaced]]
        return found

    def between(self, first: int, last: int) -> Array | tuple[Array, Array]:
        """Return x and y of the samples from the first up to the last."""
        begin, end = np.searchsorted(self._place, [first, last])
        x, y = (values[first:last] for values in self._values)
        if begin == end:
            return x, y
        found = np.stack([x, y])
        found[:, self._place[begin:end] - first] = self._instead[:, begin:end]
        return found

    def of_blocks(self, block: Index, step: int) -> Array | tuple[Array, Array]:
        """Return x and y of the samples of rising blocks; the last block of all may be shorter."""
        if is_run(block):
            return self.between(int(block[0]) * step, min(int(block[-1] + 1) * step, len(self)))
        behind = max(int(block[-1] + 1) * step - len(self), 0)
        return self.blocks(block, step).reshape(2, -1)[:, : len(block) * step - behind]

    def blocks(self, block: Index, step: int) -> Array:
        """Return the samples of blocks of equal length, shape (2, k, step), as from `at`."""
        found = np.empty((2, len(block), step))
        whole = len(self) // step
        # Rows are copied faster than single samples.
        odd = np.searchsorted(self._place, block * step) < np.searchsorted(self._place, (block + 1) * step)
        odd |= block >= whole
        if whole:
            for values, rows in zip(self._values, found, strict=True):
                values[: whole * step].reshape(-1, step).take(block, axis=0, out=rows, mode="clip")
        row = np.flatnonzero(odd)
        if len(row):
            found[:, row] = self.at(block[row, None] * step + np.arange(step))
        return found
