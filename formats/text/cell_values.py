"""Text of cells to numbers, times and labels, in bulk."""

import contextlib
import re
from collections.abc import Callable, Iterable, Sequence
from datetime import UTC, datetime, timedelta
from itertools import islice
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from formats.table import Kind, Labels

#: What stands for "no value", in lower case.
MISSING = frozenset({"", "nan", "-nan", "na", "n/a", "null", "none", "<na>", "nat"})
#: The same as commonly written, for the parser's own fast comparison.
MISSING_SPELLINGS = ("", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "null", "NULL", "None", "<NA>", "NaT")
EXACT = 2.0**53  # Integers beyond this lose digits as float64
# Written so that no text of digits can be parted in two ways: that would take time with its square.
_NUMBER = r"^[+-]?(\d+({point}\d*)?|{point}\d+)([eE][+-]?\d+)?$|^[+-]?inf(inity)?$"
_TIME = re.compile(
    r"(\d{4}-\d\d-\d\d)(?:[T ](\d\d:\d\d(?::\d\d)?)(?:[.,](\d+))?\s*(?:Z|([+-])(\d\d):?(\d\d)?)?)?",
    re.IGNORECASE | re.ASCII,
)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_NS_LIMIT = 2**63


def number_pattern(decimal: str) -> str:
    """Return the regular expression of a number with this decimal sign, a point or a comma."""
    return _NUMBER.replace("{point}", re.escape(decimal))


def kind_of(cells: Sequence[str], decimal: str) -> Kind | None:
    """Tell what the cells of a column are, by majority; None where every cell is empty."""
    pattern = re.compile(number_pattern(decimal), re.IGNORECASE | re.ASCII)
    if cells and _mostly(cells, pattern.match):
        # Also of those that are not empty.
        return "number"
    filled = [cell for cell in map(str.strip, cells) if cell.lower() not in MISSING]
    if not filled:
        # A column of NaN is one of numbers; one of empty cells could still be anything.
        return "number" if any(cell.strip().lower() in ("nan", "-nan") for cell in cells) else None
    if _mostly(filled, pattern.match):
        return "number"
    return "time" if _mostly(filled, _TIME.fullmatch) else "text"


def _mostly(cells: Sequence[str], match: Callable[[str], object]) -> bool:
    half = (len(cells) + 1) // 2
    return len(list(islice(filter(match, cells), half))) == half


def numbers(cells: pa.Array, decimal: str) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Read cells of text as float64, or as `exact` int64, and tell where something is no number."""
    import pyarrow.compute as pc

    bad = np.zeros(len(cells), dtype=bool)
    # A point in a number with decimal comma may be one of thousands: never read as a decimal point.
    if decimal == "," and not pc.any(pc.match_substring(cells, ".")).as_py():
        cells, decimal = pc.replace_substring(cells, ",", "."), "."
    try:
        if decimal == ",":
            raise pa.ArrowInvalid
        values = pc.cast(cells, pa.float64())
    except pa.ArrowInvalid:
        cells = pc.utf8_trim_whitespace(cells)
        good = pc.match_substring_regex(cells, number_pattern(decimal), ignore_case=True)
        bad = _there(cells) & ~_mask(good)
        cells = pc.replace_substring(pc.if_else(good, cells, pa.NA), ",", ".")
        values = pc.cast(cells, pa.float64())
    return exact(values, cells), bad


def floats(values: pa.Array) -> NDArray[np.float64]:
    """Return numbers as they are, NaN where null, not to be written to."""
    return _filled(values, np.nan)


def nanoseconds(values: pa.Array) -> NDArray[np.int64]:
    """Return times or durations as their number of ns, that of NaT where null, not to be written to."""
    return _filled(values.cast(pa.int64()), np.iinfo(np.int64).min)


def _filled(values: pa.Array, missing: float) -> NDArray[Any]:
    """Return numbers, with another one where null; pyarrow's own ways of it import pandas."""
    if not values.null_count:
        return np.asarray(np.from_dlpack(values))
    found = np.full(len(values), missing)
    found[_mask(values.is_valid())] = np.from_dlpack(values.drop_null())
    return found


def exact(values: pa.Array, origin: pa.Array) -> NDArray[Any]:
    """Return float64, NaN where null; int64 where that would lose digits of integers, and none is −0."""
    import pyarrow.compute as pc

    rounded = floats(values)
    large = not values.null_count and (np.abs(rounded) >= EXACT).any()
    if large and not (np.signbit(rounded) & (rounded == 0.0)).any():
        with contextlib.suppress(pa.ArrowInvalid):
            return np.asarray(pc.cast(origin, pa.int64()))
    return rounded


def times(cells: pa.Array) -> tuple[NDArray[np.datetime64], NDArray[np.bool_]]:
    """Read cells of text as ISO 8601 times, in UTC if they have no zone, and tell where one is wrong."""
    import pyarrow.compute as pc

    for zone in ("UTC", None):
        try:
            values = pc.cast(cells, pa.timestamp("ns", zone))
        except pa.ArrowInvalid:
            continue
        return nanoseconds(values).view("datetime64[ns]"), np.zeros(len(cells), dtype=bool)
    ns = np.array([_nanoseconds(cell) for cell in cells.to_pylist()], dtype="datetime64[ns]")
    return ns, _there(pc.utf8_trim_whitespace(cells)) & np.isnat(ns)


class Names:
    """The texts of one column so far, as what they stand for: a text has the same code in every batch."""

    def __init__(self, meant: Callable[[str], str] = str) -> None:
        self._meant = meant
        self._codes: dict[str, int] = {}
        self._names: tuple[str, ...] = ()

    def labels(self, cells: pa.Array) -> Labels:
        """Turn cells, of text or of a dictionary, into labels, without the spaces around them."""
        if not pa.types.is_dictionary(cells.type):
            cells = cells.dictionary_encode()
        codes = [self._code(text) for text in cells.dictionary.to_pylist()]
        lookup = np.array([*codes, -1], dtype=np.int32)
        indices = np.full(len(cells), len(codes))
        indices[_mask(cells.is_valid())] = np.from_dlpack(cells.indices.drop_null())
        if len(self._codes) > len(self._names):
            self._names = tuple(self._codes)
        return Labels(lookup[indices], self._names)

    def _code(self, text: str | None) -> int:
        text = (text or "").strip()
        if text.lower() in MISSING:
            return -1
        return self._codes.setdefault(self._meant(text), len(self._codes))


def _mask(array: pa.Array) -> NDArray[np.bool_]:
    """Return truths, false where null, without the pandas that pyarrow's own conversion imports."""
    if array.null_count:
        import pyarrow.compute as pc

        array = pc.if_else(array.is_valid(), array, array.is_valid())
    return np.asarray(np.from_dlpack(array.cast(pa.int8())), dtype=bool)


def _there(trimmed: pa.Array) -> NDArray[np.bool_]:
    import pyarrow.compute as pc

    missing = "|".join(map(re.escape, MISSING))
    return _mask(pc.invert(pc.match_substring_regex(trimmed, f"^({missing})$", ignore_case=True)))


def _nanoseconds(cell: str | None) -> Any:
    match = _TIME.fullmatch((cell or "").strip())
    if match is None:
        return np.datetime64("NaT", "ns")
    day, clock, fraction, sign, hours, minutes = match.groups()
    try:
        whole = datetime.fromisoformat(f"{day}T{clock or '00:00'}").replace(tzinfo=UTC) - _EPOCH
    except ValueError:
        return np.datetime64("NaT", "ns")
    if sign:
        offset = timedelta(hours=int(hours), minutes=int(minutes or 0))
        whole -= offset if sign == "+" else -offset
    ns = (whole.days * 86_400 + whole.seconds) * 1_000_000_000 + int((fraction or "0").ljust(9, "0")[:9])
    return np.datetime64(ns, "ns") if -_NS_LIMIT < ns < _NS_LIMIT else np.datetime64("NaT", "ns")


def of_texts(cells: Iterable[str]) -> pa.Array:
    """Return texts as pyarrow holds them, null where a value is missing."""
    return pa.array([None if cell.strip().lower() in MISSING else cell for cell in cells], pa.string())
