"""Which samples count: the condition that a user gives, and what sets one aside."""

import ast
import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import numpy as np

from formats import Column, Labels
from terrain_cli.errors import UsageError
from terrain_cli.telemetry.alignment import RESOLUTION, split_clock, stretch_gap
from terrain_cli.telemetry.derived_channels import stands
from terrain_cli.telemetry.wheel_samples import NEEDED
from terrain_cli.vocabulary.arrays import Array, Index, Mask

_COMPARE: dict[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
_LONGEST = 1000
_FORM = (
    "a condition compares columns with numbers or texts, joined by and, or, not: "
    "slip_angle_deg == 0 and terrain != 'rock'"
)
#: The densest soils bear 0.6 MPa with a safety of 3 (BS 8004, presumed bearing values); Pa.
MOST_PRESSURE = 2e6
#: Cohesion of a soil that bears it: a strip presses with (2 + π) c at the most (Prandtl 1921); Pa.
_MOST_COHESION = MOST_PRESSURE / (2.0 + np.pi)
#: T/(W r) of friction alone, four times what the equations give (`plausibility.MOST_TORQUE`): judged.
_MOST_FRICTION = 10.0
_LEAST_DEPTH = 0.01  # z/r: on firm ground a sensor's noise may make a sinkage as small as it likes. Judged.
#: No vehicle on soil is faster; m/s.
MOST_SPEED = 100.0
BACKWARDS = "time runs backwards"
STANDS = "wheel stands (ω = 0, slip undefined)"
SKIDS = "wheel skids (slip < 0)"


class Condition:
    """A condition on the rows of a table or the samples of a wheel.

    Comparisons (``== != < <= > >=``) of column names with numbers or quoted texts, joined by ``and``, ``or``,
    ``not`` and parentheses. A header that is not a plain name stands in backticks: ```load [kN]` > 0.1``.
    Anything else is a UsageError, and never executed.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        self._quoted: dict[str, str] = {}
        try:
            if len(text) > _LONGEST:
                raise SyntaxError("too long")
            self._tree = ast.parse(re.sub(r"`([^`]+)`", self._quote, text.strip()), mode="eval").body
            self._check(self._tree)
            if not self.names:
                raise SyntaxError("names no column")
        except (SyntaxError, RecursionError, ValueError, MemoryError):
            raise UsageError(f"--where: cannot read {text!r}", hint=_FORM) from None

    def _quote(self, match: re.Match[str]) -> str:
        name = f"quoted_{len(self._quoted)}_"
        self._quoted[name] = match[1].strip()
        return name

    def _check(self, node: ast.AST) -> None:
        match node:
            case ast.BoolOp(values=values):
                for value in values:
                    self._check(value)
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                self._check(operand)
            case ast.Compare(left=left, ops=ops, comparators=others):
                if not all(type(op) in _COMPARE for op in ops):
                    raise SyntaxError
                for term in (left, *others):
                    match term:
                        case ast.Name() | ast.Constant(value=int() | float() | str()):
                            pass
                        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int() | float())):
                            pass
                        case _:
                            raise SyntaxError
            case _:
                raise SyntaxError

    @property
    def names(self) -> set[str]:
        """The columns that the condition reads."""
        names = (node.id for node in ast.walk(self._tree) if isinstance(node, ast.Name))
        return {self._quoted.get(name, name) for name in names}

    def holds(self, columns: Mapping[str, Column]) -> Mask:
        """Tell in which rows the condition holds: not where it turns on a number or time that is missing."""
        return self._evaluate(self._tree, columns)[0]

    def _evaluate(self, node: ast.AST, columns: Mapping[str, Column]) -> tuple[Mask, Mask]:
        """Return where a condition holds and where it does not: neither where a value is missing."""
        match node:
            case ast.BoolOp(op=op, values=values):
                parts = [self._evaluate(value, columns) for value in values]
                return _joined(parts, every=isinstance(op, ast.And))
            case ast.UnaryOp(operand=operand):
                return self._evaluate(operand, columns)[::-1]
            case ast.Compare(left=left, ops=ops, comparators=others):
                n = len(next(iter(columns.values())))
                terms = [self._term(term, columns) for term in (left, *others)]
                pairs = zip(ops, terms[:-1], terms[1:], strict=True)
                return _joined([self._compare(op, a, b, n) for op, a, b in pairs], every=True)
        raise self._mixed()

    def _term(self, node: ast.AST, columns: Mapping[str, Column]) -> Any:
        if isinstance(node, ast.Name):
            column = columns[self._quoted.get(node.id, node.id)]
            if isinstance(column, Labels):
                return np.array([*column.names, ""], dtype=object)[column.codes]
            return column
        return np.asarray(ast.literal_eval(node))

    def _compare(self, op: ast.cmpop, a: Any, b: Any, n: int) -> tuple[Mask, Mask]:
        if _kind(a) != _kind(b):
            a, b = self._as(a, _kind(b)), self._as(b, _kind(a))
        if _kind(a) != _kind(b):
            raise self._mixed()
        if _kind(a) == "text" and not isinstance(op, ast.Eq | ast.NotEq):
            raise UsageError(f"--where: {self.text!r}: texts are equal or not, and nothing else", hint=_FORM)
        known = np.ones(n, dtype=bool)
        for term in (a, b):
            if term.dtype.kind in "fM":
                known &= ~(np.isnan(term) if term.dtype.kind == "f" else np.isnat(term))
        result = np.asarray(_COMPARE[type(op)](a, b), dtype=bool)
        return result & known, ~result & known

    def _as(self, term: Any, kind: str) -> Any:
        """Bring a constant to the kind of the column it is compared with; columns stay as they are."""
        if term.ndim:
            return term
        value = term.item()
        if kind == "text":
            # A label that reads as a number (run 3, trial 2).
            return np.asarray(f"{value:.15g}")
        if kind == "time" and isinstance(value, str):
            try:
                moment = datetime.fromisoformat(value)
            except ValueError:
                raise self._mixed() from None
            utc = moment if moment.tzinfo is None else moment.astimezone(UTC).replace(tzinfo=None)
            return np.asarray(np.datetime64(utc, "ns"))
        return term

    def _mixed(self) -> UsageError:
        return UsageError(f"--where: {self.text!r} compares what cannot be compared", hint=_FORM)


def _joined(parts: Sequence[tuple[Mask, Mask]], *, every: bool) -> tuple[Mask, Mask]:
    """Return where every one or any of some conditions holds, and where that fails."""
    holds, fails = zip(*parts, strict=True)
    both, either = np.logical_and.reduce, np.logical_or.reduce
    return (both(holds), either(fails)) if every else (either(holds), both(fails))


def _kind(term: Any) -> str:
    return {"O": "text", "U": "text", "M": "time"}.get(term.dtype.kind, "number")


def set_aside(
    channels: Mapping[str, Array], time: Array | None, radius: float, width: float, *, skids: bool = False
) -> tuple[Labels, Index]:
    """Give each sample the first reason for which it cannot be used (else −1), and find clock restarts."""
    # `skids` keeps the samples of a skidding wheel, which the whole model covers and the line does not.
    n = len(channels["load"])
    names: list[str] = []
    codes = np.full(n, -1, dtype=np.int32)

    def because(reason: str, where: Mask) -> None:
        first = where & (codes < 0)
        if first.any():
            codes[first] = len(names)
            names.append(reason)

    restarts = np.array([], dtype=np.intp)
    if time is not None:
        because("no time", ~np.isfinite(time))
        restarts, backwards, repeated = split_clock(time)
        because(BACKWARDS, backwards)
        because("time repeated", repeated)
    with np.errstate(invalid="ignore"):
        for reason, where in _unusable(channels, radius, width, skids=skids):
            because(reason, where)
    return Labels(codes, tuple(names)), restarts


def _unusable(
    channels: Mapping[str, Array], radius: float, width: float, *, skids: bool
) -> Iterator[tuple[str, Mask]]:
    """Yield what can be wrong with the values of a sample, and where it is, the plainest reason first."""
    omega = channels.get("angular_velocity")
    for name in NEEDED:
        if name not in channels:
            continue
        # A standing wheel has no slip, and is better told as that.
        if name == "slip" and omega is not None:
            yield STANDS, stands(omega)
        odd = ~np.isfinite(channels[name])
        if odd.any():
            yield f"no {name}", np.isnan(channels[name])
            yield f"{name} is infinite", odd
    for name in ("angular_velocity", "velocity"):
        if name in channels:
            yield f"{name} is infinite", np.isinf(channels[name])
    slip, load = channels["slip"], channels["load"]
    yield "wheel turns against its course (slip < -1)", slip < -1.0
    yield "wheel rolls against its drive (slip > 1)", slip > 1.0
    if "sinkage" in channels:
        yield "sinkage not positive", channels["sinkage"] <= 0.0
        yield "sinkage beyond the wheel radius", channels["sinkage"] >= radius
    yield "load not positive", load <= 0.0
    yield from _beyond(channels, radius, width)
    if not skids:
        # Last: what has no other fault is on the ground, which goes on under it.
        yield SKIDS, slip < 0.0


def _beyond(channels: Mapping[str, Array], radius: float, width: float) -> Iterator[tuple[str, Mask]]:
    """Yield what no single sample can be, and where it is."""
    depth = np.clip(channels.get("sinkage", np.array(radius)) / radius, _LEAST_DEPTH, 1.0)
    area = width * radius * np.sqrt((2.0 - depth) * depth)
    force = _MOST_COHESION * area + _MOST_FRICTION * np.abs(channels["load"])
    limits = {
        "load": (MOST_PRESSURE * area, "load beyond what soil bears"),
        "torque": (force * radius, "torque beyond what soil takes"),
        "drawbar_pull": (force, "drawbar_pull beyond what soil takes"),
        "velocity": (MOST_SPEED, "velocity beyond that of any vehicle"),
        "angular_velocity": (MOST_SPEED / radius, "angular_velocity beyond that of any vehicle"),
    }
    for name, (limit, reason) in limits.items():
        if name in channels:
            yield reason, np.abs(channels[name]) > limit


def also_aside(reasons: Labels, reason: str, where: Mask) -> Labels:
    """Set further samples aside; where there was a reason already, that stays."""
    new = where & (reasons.codes < 0)
    if not new.any():
        return reasons
    codes = np.where(new, np.int32(len(reasons.names)), reasons.codes)
    return Labels(codes, (*reasons.names, reason))


def stretches(
    time: Array | None,
    reasons: Labels,
    *,
    runs: Labels | None = None,
    restarts: Index | None = None,
    max_gap: float,
) -> Index:
    """Give each sample the number of its continuous stretch of the drive, from 0.

    A new one begins with another run, a restart of the clock, and at the first sample on the ground after
    nothing usable for longer than `max_gap`; a wheel that stands or skids does not interrupt the ground under
    it.
    """
    n = len(reasons)
    begins = np.zeros(n, dtype=bool)
    if runs is not None:
        begins[1:] |= runs.codes[1:] != runs.codes[:-1]
    if restarts is not None:
        begins[restarts] = True
    if time is not None and n:
        driven = driving_time(time, reasons, max_gap)
        ground = on_ground(reasons)
        begins[ground[1:][np.diff(driven[ground]) > max_gap + RESOLUTION]] = True
    return np.cumsum(begins)


def longest_gap(time: Array, reasons: Labels, max_gap: float | None) -> float:
    """Return the longest time (s) without a whole sample that does not interrupt a drive; `stretch_gap`."""
    missing = [code for code, name in enumerate(reasons.names) if name.startswith("no ")]
    there = time[~np.isin(reasons.codes, missing)] if missing else time
    return stretch_gap(there if len(there) > 1 else time, max_gap)


def unsorted(reasons: Labels) -> int:
    """Return in how many samples time runs backwards, if that are most: rows of a table in another order."""
    back = int(np.count_nonzero(is_aside(reasons, BACKWARDS)))
    return back if 2 * back > len(reasons) else 0


def on_ground(reasons: Labels) -> Index:
    """Return the samples that follow the ground: those usable, and those in which the wheel skids."""
    return np.flatnonzero((reasons.codes < 0) | is_aside(reasons, SKIDS))


def driving_time(time: Array, reasons: Labels, max_gap: float) -> Array:
    """Return a clock (s, never falling) that stops while the wheel stands: only lost driving is a gap."""
    standing, astray = (is_aside(reasons, reason) for reason in (STANDS, BACKWARDS))
    known, clock, n = np.isfinite(time) & ~astray, time, len(time)
    if not known.all():
        clock = np.interp(np.arange(n), np.flatnonzero(known), time[known]) if known.any() else np.zeros(n)
    step = np.diff(clock, prepend=clock[0])
    step[standing & (step <= max_gap + RESOLUTION)] = 0.0
    return np.asarray(np.cumsum(np.maximum(step, 0.0)))


def is_aside(reasons: Labels, reason: str) -> Mask:
    """Tell which samples are set aside for a reason."""
    code = reasons.names.index(reason) if reason in reasons.names else -2
    return np.asarray(reasons.codes == code)
