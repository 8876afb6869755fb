"""Lines through clouds of samples with noise in both coordinates, from their moments alone.

A window's moments are the sums of 1, x, y, x², xy, y² and of the noise's covariance, all weighted
by 1/variance, and the plain count: rows `W` to `N` of an array, one column for each window. Every
function takes the same time for a window of any length.
"""

import numpy as np

from terrain_cli.vocabulary.arrays import Array, Index

Slopes = tuple[Array, Array]

W, X, Y, XX, XY, YY, NOISE_XX, NOISE_XY, NOISE_YY, N = range(10)
ROWS = 10

# Two clouds always lie on one line. What a soil's line can be tells a step of the load, which
# moves the cloud along it, from a change of soil. The bounds are wide: the linear model, and a k
# that is 50 % off, make slopes up to 1.4 times too steep or too flat and turn out c < 0.
#: Slopes tan φ of 8° and 50°.
SMALLEST_SLOPE, LARGEST_SLOPE = float(np.tan(np.radians(8.0))), float(np.tan(np.radians(50.0)))
#: Shares of the strength y that friction, x tan φ, may carry.
SMALLEST_SHARE, LARGEST_SHARE = 0.4, 1.2
#: Slope at which samples are weighted; the weights relative to each other hardly depend on it.
MIDDLE_SLOPE = 0.55

_TINY = float(np.finfo(float).tiny)


def across(xx: Array, xy: Array, yy: Array, slope: Array | float) -> Array:
    """Return the variance of y − slope · x, from variances and covariance of x and y."""
    return np.asarray(yy + slope * (slope * xx - 2.0 * xy))


def noise_across(moments: Array, slope: Array | float) -> Array:
    """Return the mean variance of the noise across a line, in the units of the weights."""
    noise = across(moments[NOISE_XX], moments[NOISE_XY], moments[NOISE_YY], slope)
    return np.asarray(noise / moments[N])


def scatter(moments: Array) -> tuple[Array, Array, Array]:
    """Return the weighted sums of squares and products of x and y about their means."""
    weight = np.maximum(moments[W], _TINY)
    x, y = moments[X] / weight, moments[Y] / weight
    return (
        np.maximum(moments[XX] - moments[X] * x, 0.0),
        moments[XY] - moments[X] * y,
        np.maximum(moments[YY] - moments[Y] * y, 0.0),
    )


def possible_slopes(moments: Array) -> Slopes:
    """Return the least and the largest slope that the line of a soil with these x and y can have."""
    positive = moments[X] > 0.0
    ratio = np.where(positive, moments[Y], 1.0) / np.where(positive, moments[X], 1.0)
    low = np.minimum(np.maximum(SMALLEST_SHARE * ratio, SMALLEST_SLOPE), LARGEST_SLOPE)
    return low, np.minimum(np.maximum(LARGEST_SHARE * ratio, low), LARGEST_SLOPE)


# Without scatter there is no root, and comparisons with it are false; windows without samples, and those that
# are far too small, are nobody's choice.
@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def best_line(moments: Array, slopes: Slopes | None = None) -> tuple[Array, Array]:
    """Find the slope that makes the scatter across the line least, in units of the noise across it.

    The structural line of errors in variables: ordinary least squares would take the slope of the noise. The
    derivative of the ratio is zero where a t² + b t + c = 0, and one root is the minimum. Returned are the
    slope, within `possible_slopes` and `slopes`, and the sum of squares across in units of that noise.
    """
    xx, xy, yy = scatter(moments)
    noise_xx, noise_xy, noise_yy = moments[NOISE_XX], moments[NOISE_XY], moments[NOISE_YY]
    a = xx * noise_xy - xy * noise_xx
    b = yy * noise_xx - xx * noise_yy
    c = xy * noise_yy - yy * noise_xy
    root = np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))
    falling = b >= 0.0
    slope = np.where(falling, -(b + root), 2.0 * c) / np.where(falling, 2.0 * a, root - b)
    low, high = possible_slopes(moments)
    if slopes is not None:
        low, high = np.clip(slopes[0], low, high), np.clip(slopes[1], low, high)

    def misfit(t: Array, of: Index | slice = slice(None)) -> Array:
        return across(xx[of], xy[of], yy[of], t) / across(noise_xx[of], noise_xy[of], noise_yy[of], t)

    beyond = np.flatnonzero(~((slope > low) & (slope < high)))
    if len(beyond):
        ends = np.stack([low[beyond], high[beyond]])
        flat, steep = misfit(ends, beyond)
        slope[beyond] = np.where(flat <= steep, *ends)
    return slope, misfit(slope) * moments[N]


def slope_error(moments: Array, slope: Array) -> Array:
    """Return the standard error of a slope, huge where x varies no more than its noise."""
    xx, xy, yy = scatter(moments)
    signal = np.maximum(xx - moments[NOISE_XX], 0.0)
    variance = np.maximum(across(xx, xy, yy, slope) / moments[N], noise_across(moments, slope))
    return np.asarray(np.sqrt(variance * xx) / np.maximum(signal, 1e-9 * moments[XX]))


def split_gain(left: Array, right: Array, slopes: Slopes | None = None) -> tuple[Array, Array]:
    """Return how much better two lines fit than one, and what it is worth that a line is off.

    A score test of one line against two. With t the slope of the one line, g = y − t x is what is across it,
    and ℓ = x + κ g the coordinate along it whose noise is uncorrelated with that of g. Regressing g on ℓ in
    either part gains χ² with two degrees of freedom where one soil lies below both, however far its load has
    moved along the line and however little it varies in either part. The gain is in units of the noise's
    variance; the worth is the gain for each Pa² of the squared distance between two parallel lines.
    """
    both = left + right
    slope, _ = best_line(both, slopes)
    variance = noise_across(both, slope)
    turn = (slope * both[NOISE_XX] - both[NOISE_XY]) / both[N] / variance
    gain = across(*scatter(both), slope)
    for part in (left, right):
        xx, xy, yy = scatter(part)
        square = across(xx, xy, yy, slope)
        mixed = xy - slope * xx
        product = mixed + turn * square
        along = xx + turn * (2.0 * mixed + turn * square)
        # Never less than its noise: where x is quieter than that, ℓ is but a copy of g.
        least = part[NOISE_XX] - turn**2 * noise_across(part, slope) * part[N]
        gain -= square - product**2 / np.maximum(along, np.maximum(least, _TINY))
    return gain / variance, left[W] * right[W] / both[W] / variance
