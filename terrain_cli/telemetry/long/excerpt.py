"""An excerpt of a log too long to be kept: continuous pieces, spread evenly over it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from formats import Labels
from formats.recovery import told
from terrain_cli.telemetry.raw_columns import join
from terrain_cli.telemetry.wheel_samples import Notice

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from numpy.typing import NDArray

    from terrain_cli.telemetry.wheel_samples import Samples

#: Rows that are read whole, of all inputs together, where only a share of them is compared.
MOST_ROWS = 2_000_000
#: Usable samples of a piece.
PIECE = 1000


class Excerpt:
    """Every so many pieces of the usable samples of each wheel, so many that no more than a limit are kept.

    The length of the log need not be known: where the limit is passed, every second piece goes.

    At least half of the limit are kept, if there are more. The parts of each wheel are consecutive.
    """

    def __init__(self, most: int, parts: Iterable[Samples]) -> None:
        self._most, self._step = most, 1
        self._kept: dict[str, list[tuple[Samples, NDArray[np.intp]]]] = {}
        self._seen: Counter[str] = Counter()
        self._rows: Counter[str] = Counter()
        for part in parts:
            self._add(part)

    def _add(self, part: Samples) -> None:
        usable, wheel = part.usable, part.wheel
        number = self._seen[wheel] + np.arange(len(usable))
        self._seen[wheel] += len(usable)
        self._rows[wheel] += len(part)
        kept = self._chosen(number)
        self._kept.setdefault(wheel, []).append((part.taken(usable[kept]), number[kept]))
        while sum(len(numbers) for pieces in self._kept.values() for _, numbers in pieces) > self._most:
            self._step *= 2
            for wheel, pieces in self._kept.items():
                thinned = [(samples.taken(c), n[c]) for samples, n in pieces for c in [self._chosen(n)]]
                self._kept[wheel] = [one for one in thinned if len(one[1])] or thinned[:1]

    def _chosen(self, number: NDArray[np.intp]) -> NDArray[np.bool_]:
        return np.asarray(number // PIECE % self._step == 0)

    def samples(self) -> list[Samples]:
        """Return the usable samples kept, by wheel; those of different pieces are of different stretches."""
        return [self._joined(wheel) for wheel in sorted(self._kept)]

    def _joined(self, wheel: str) -> Samples:
        pieces = self._kept.pop(wheel)
        number = np.concatenate([numbers for _, numbers in pieces])
        whole = joined([samples for samples, _ in pieces])
        broken = (np.diff(number, prepend=number[:1]) > 1) | (
            np.diff(whole.stretch, prepend=whole.stretch[:1]) != 0
        )
        total = self._seen[wheel] if self._rows[wheel] else None
        return replace(whole, stretch=np.cumsum(broken), drive=whole.stretch, total=total)


def joined(parts: Sequence[Samples]) -> Samples:
    """Join parts of one wheel, with the words of the first."""
    first = parts[0]

    def column(name: str, group: str) -> NDArray[np.float64]:
        pieces = [getattr(part, group).get(name) for part in parts]
        return np.concatenate(
            [
                np.full(len(part), np.nan) if piece is None else piece
                for part, piece in zip(parts, pieces, strict=True)
            ]
        )

    def labels(name: str) -> Labels:
        merged = join([part.labels[name] for part in parts])
        assert isinstance(merged, Labels)  # noqa: S101 - labels joined are labels
        return merged

    def optional(values: Sequence[NDArray[np.float64] | None]) -> NDArray[np.float64] | None:
        known = [value for value in values if value is not None]
        return np.concatenate(known) if known else None

    reasons = join([part.set_aside for part in parts])
    assert isinstance(reasons, Labels)  # noqa: S101 - labels joined are labels
    return replace(
        first,
        time=optional([part.time for part in parts]),
        channels={name: column(name, "channels") for name in first.channels},
        labels={name: labels(name) for name in first.labels},
        stretch=np.concatenate([part.stretch for part in parts]),
        distance=optional([part.distance for part in parts]),
        set_aside=reasons,
        drivers={
            name: column(name, "drivers")
            for name in dict.fromkeys(name for part in parts for name in part.drivers)
        },
    )


def excerpted(samples: Sequence[Samples]) -> list[str]:
    """Say of how many samples how many were kept, if not all were."""
    total = sum(len(one.usable) if one.total is None else one.total for one in samples)
    kept = sum(len(one.usable) for one in samples)
    if kept == total:
        return []
    return [f"{kept} of {total} samples are read, in unbroken pieces of {PIECE} spread over each input"]


def notes(samples: Sequence[Samples]) -> list[str]:
    """Say what was not read of some inputs, lost or left out, and what every command says of them."""
    saved = [
        f"{one.source}: {remark}"
        for one in samples
        for remark in [*told(one.remarks), *(r for r in one.remarks if isinstance(r, Notice))]
    ]
    return [*dict.fromkeys(saved), *excerpted(samples)]
