"""Normal equations of windows with unknowns of their own and unknowns that all share.

With r the residuals and J the design of a window, A, B, C the blocks of its JᵀJ and a, c the parts of
its Jᵀr, priors counted in, the window's own unknowns x and the shared ones y solve

    A x + B y = a    for every window,        Σ (Bᵀ x + C y) = Σ c,

an arrow. With x = A⁻¹ a + G y, G = −A⁻¹ B, one small system is left for the shared ones,

    S y = Σ (c + Gᵀ a),        S = Σ (C + Bᵀ G),

the Schur complement. S⁻¹ is their covariance; that of x is A⁻¹ + G S⁻¹ Gᵀ. No matrix spans two windows.

Of shapes, w counts windows, p own and q shared unknowns, n samples of k channels.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index

_ROUNDING = 1e-6  # How far rounding may take a variance above that of the prior, as a share
_RANK = 1e-9  # Directions below this share of the best determined one are not inverted


@dataclass(frozen=True)
class Eliminated:
    """Windows whose own unknowns are eliminated."""

    own: Array  # Shape (w, p, p): A⁻¹: covariance of the windows' own unknowns with the shared ones held
    cross: Array  # Shape (w, p, q): B
    gain: Array  # Shape (w, p, q): G: change of the windows' own unknowns with the shared ones

    def taken_each(self) -> Array:
        """Return what each window's own unknowns take off the information on the shared ones: −Bᵀ G."""
        return np.asarray(-np.swapaxes(self.cross, 1, 2) @ self.gain)

    def taken(self) -> Array:
        """Return what they take off it together."""
        return np.asarray(-np.einsum("wpq,wpr->qr", self.cross, self.gain))

    def pull_each(self, score: Array) -> Array:
        """Return what each window's own scores a add to that of the shared unknowns: Gᵀ a."""
        return np.asarray(np.einsum("wpq,wp->wq", self.gain, score))

    def pull(self, score: Array) -> Array:
        """Return what they add to it together."""
        return np.asarray(np.einsum("wpq,wp->q", self.gain, score))

    def behind(self, score: Array, shared: Array) -> Array:
        """Return the windows' own unknowns that go with their scores a and with shared ones: A⁻¹ a + G y.

        The shared ones are the same for all windows, shape (q,), or of each, shape (w, q).
        """
        return np.asarray(np.einsum("wab,wb->wa", self.own, score) + (self.gain @ shared[..., None])[..., 0])

    def solve(self, score: Array, information: Array, score_shared: Array) -> tuple[Array, Array]:
        """Return own and shared unknowns, from a of each window, Σ C and Σ c."""
        left, right = information - self.taken(), score_shared + self.pull(score)
        try:
            shared = np.asarray(np.linalg.solve(left, right), dtype=float)
        except np.linalg.LinAlgError:
            # What outweighs the rest by all digits there are leaves nothing to tell the others by.
            shared = inverse(left) @ right
        return self.behind(score, shared), shared


def eliminate(own: Array, cross: Array, invert: Callable[[Array], Array] | None = None) -> Eliminated:
    """Eliminate the windows' own unknowns, given A, B and what inverts A if not `inverse`."""
    held = (invert or inverse)(own)
    return Eliminated(held, cross, -held @ cross)


def arrow(
    information: Array, local: int, prior: Array, invert: Callable[[Array], Array] | None = None
) -> tuple[Eliminated, Array]:
    """Eliminate the first `local` unknowns of each window; return that, and Σ C.

    `information` is JᵀJ, shape (w, p + q, p + q); `prior` what is known beforehand of one window's own
    unknowns and of the shared ones.
    """
    own = information[:, :local, :local] + prior[:local, :local]
    shared = information[:, local:, local:].sum(axis=0) + prior[local:, local:]
    return eliminate(own, information[:, :local, local:], invert), shared


def covariance(own: Array, gain: Array, shared: Array) -> Array:
    """Return the covariance of each window's own and the shared unknowns, from A⁻¹, G and S⁻¹."""
    through = gain @ shared
    inside = own + through @ np.swapaxes(gain, 1, 2)
    corner = np.broadcast_to(shared, (len(own), *shared.shape))
    return np.asarray(np.block([[inside, through], [np.swapaxes(through, 1, 2), corner]]))


def leave_out(
    information: Array,
    score: Array,
    window: Index,
    fold: Index,
    prior: Array,
    local: int,
    reach: tuple[Array, Array] | None = None,
) -> Array:
    """Return how the unknowns of each cell, the samples of a window in one fold, move without that fold.

    A shared unknown that would go beyond its bounds stops there (`reach`: how far they may move, down and
    up), and the others make do with that. Information and score are of each cell.
    """
    windows = int(window.max()) + 1
    whole, pull = np.zeros((windows, *prior.shape)), np.zeros((windows, len(prior)))
    np.add.at(whole, window, information)
    np.add.at(pull, window, score)
    every, shared = arrow(whole, local, prior)
    own, common = every.solve(pull[:, :local], shared, pull[:, local:].sum(axis=0))
    left = shared - every.taken()
    right = pull[:, local:].sum(axis=0) + every.pull(pull[:, :local])
    low, high = reach if reach is not None else (np.full_like(common, end) for end in (-np.inf, np.inf))
    limits = (common + np.minimum(low, 0.0), common + np.maximum(high, 0.0))
    rest, _ = arrow(whole[window] - information, local, prior)
    kept = (pull[window] - score)[:, :local]
    folds = int(fold.max()) + 1
    lefts, rights = np.repeat(left[None], folds, axis=0), np.repeat(right[None], folds, axis=0)
    np.add.at(lefts, fold, every.taken_each()[window] - rest.taken_each() - information[:, local:, local:])
    gone = every.pull_each(pull[:, :local])[window] - rest.pull_each(kept) + score[:, local:]
    np.subtract.at(rights, fold, gone)
    there = _within(lefts, rights, limits)[fold]
    return np.hstack([rest.behind(kept, there) - own[window], there - common])


def _within(left: Array, right: Array, limits: tuple[Array, Array]) -> Array:
    """Solve for the shared unknowns without each fold, held at the limits that they would cross."""
    found = np.linalg.solve(left, right[..., None])[..., 0]
    held = (found < limits[0]) | (found > limits[1])
    found = np.clip(found, *limits)
    for one in np.flatnonzero(held.any(axis=1)):
        bound, free = held[one], ~held[one]
        rest = right[one, free] - left[one][np.ix_(free, bound)] @ found[one, bound]
        found[one, free] = np.linalg.solve(left[one][np.ix_(free, free)], rest)
    return np.asarray(found)


def products(one: Array, other: Array, cell: Index, cells: int) -> Array:
    """Sum oneᵀ other over the samples of each cell (a window, a block, or both), shape (cells, a, b).

    They are of shape (n, k, a) and (n, k, b): the design twice makes JᵀJ, the design and the residuals Jᵀr.
    """
    total = np.zeros((cells, one.shape[2], other.shape[2]))
    if np.any(cell[1:] < cell[:-1]):
        order = np.argsort(cell, kind="stable")
        one, other, cell = one[order], other[order], cell[order]
    ends = np.flatnonzero(np.diff(cell, append=-1)) + 1
    for first, last in pairwise([0, *ends.tolist()]):
        # As one product of two matrices: for few samples `tensordot` takes longer to get there.
        left, right = (
            some[first:last].reshape((last - first) * some.shape[1], some.shape[2]) for some in (one, other)
        )
        total[cell[first]] = np.dot(left.T, right)
    return total


def widened(design: Array, local: int, window: Index, windows: int) -> Array:
    """Return the dense design of the whole arrow, shape (n, k, w p + q): every window has its own columns."""
    n, k, _ = design.shape
    wide = np.zeros((n, k, windows, local))
    wide[np.arange(n), :, window] = design[:, :, :local]
    return np.concatenate([wide.reshape(n, k, windows * local), design[:, :, local:]], axis=2)


def explained(information: Array, score: Array) -> Array:
    """Return what a solution takes off the sum of squares: uᵀ H⁻¹ u of the information H and the score u."""
    return np.asarray(np.sum(score * np.linalg.solve(information, score[..., None])[..., 0], axis=-1))


def inverse(matrix: Array) -> Array:
    try:
        return np.asarray(np.linalg.inv(matrix), dtype=float)
    except np.linalg.LinAlgError:
        # Samples that differ in weight by all digits there are.
        return np.asarray(np.linalg.pinv(matrix), dtype=float)


def no_wider(covariances: Array, means: Array) -> tuple[Array, Array]:
    """Return normal distributions that are along no axis wider than the prior, whose variance is 1.

    Where the data are worth so little for their misfit, the mean goes back to that of the prior.
    """
    size, axes = np.linalg.eigh(0.5 * (covariances + np.swapaxes(covariances, 1, 2)))
    # Nearly exact data leave rounding of either sign.
    size = np.abs(size)
    if not (size > 1.0).any():
        return covariances, means
    along = np.einsum("wab,wa->wb", axes, means) / np.maximum(size, 1.0)
    return (
        (axes * np.minimum(size, 1.0)[:, None, :]) @ np.swapaxes(axes, 1, 2),
        np.einsum("wab,wb->wa", axes, along),
    )


def pseudo_inverse(matrix: Array) -> Array:
    """Invert after scaling to a unit diagonal, without the directions that nothing determines."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 0.0))
    scale = np.where(scale > 0.0, scale, np.inf)
    scales = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.pinv(matrix / scales, rcond=_RANK, hermitian=True) / scales)


def posterior_covariance(information: Array, least: float = 1.0) -> Array:
    """Invert information matrices that hold what the priors know: no eigenvalue is below theirs."""
    found = inverse(information)
    variances = np.diagonal(found, axis1=-2, axis2=-1)
    possible = (variances > 0.0) & (least * variances <= 1.0 + _ROUNDING)
    wrong = np.isfinite(information).all(axis=(-2, -1)) & ~possible.all(axis=-1)
    if wrong.any():
        # Data without noise outweigh the priors by all digits there are: rounding has taken the latter away.
        size, axes = np.linalg.eigh(information[wrong])
        found[wrong] = (axes / np.maximum(size, least)[..., None, :]) @ np.swapaxes(axes, -1, -2)
    return found
