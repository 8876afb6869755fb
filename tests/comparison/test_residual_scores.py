"""The arrow of groups and common terms against dense least squares."""

import numpy as np
import pytest

from terrain_cli.comparison.residual_scores import ScoreCell, System

GROUPS, BLOCKS, SOIL, TERMS, LENGTH = 3, 4, 2, 6, 40
WEIGHT = (4.0, 0.25)


@pytest.fixture
def data():
    """Two channels, whose terms are the common first one and their own."""
    rng = np.random.default_rng(1)
    n = GROUPS * LENGTH
    group = np.repeat(np.arange(GROUPS), LENGTH)
    block = np.tile(np.repeat(np.arange(BLOCKS), LENGTH // BLOCKS), GROUPS)
    columns = (np.array([0, 1, 2, 3]), np.array([0, 4, 5]))
    channels = [
        (rng.normal(size=n), rng.normal(size=(n, SOIL)), rng.normal(size=(n, len(own)))) for own in columns
    ]
    cells = [
        ScoreCell(
            group=g,
            block=b,
            columns=columns[k],
            weight=WEIGHT[k],
            **{
                name: part[(group == g) & (block == b)]
                for name, part in zip(("residual", "soil", "terms"), channels[k], strict=True)
            },
        )
        for k in range(2)
        for g in range(GROUPS)
        for b in range(BLOCKS)
    ]
    root = np.repeat(np.sqrt(WEIGHT), n)
    soil = np.zeros((2 * n, GROUPS * SOIL))
    terms = np.zeros((2 * n, TERMS))
    for k, (_, own, free) in enumerate(channels):
        rows = np.arange(k * n, (k + 1) * n)
        for q in range(SOIL):
            soil[rows, group * SOIL + q] = own[:, q]
        terms[np.ix_(rows, columns[k])] = free
    error = np.concatenate([e for e, _, _ in channels])
    return cells, soil * root[:, None], terms * root[:, None], error * root, np.tile(block, 2)


def left_of(columns, design):
    return columns - design @ np.linalg.lstsq(design, columns, rcond=None)[0]


def test_scores_are_those_of_terms_without_what_the_groups_imitate(data):
    cells, soil, terms, error, block = data
    scores = System(np.zeros((GROUPS, SOIL)), BLOCKS, TERMS).add(cells).scores(cells)
    expected = left_of(terms, soil) * error[:, None]
    for b in range(BLOCKS):
        assert scores[b] == pytest.approx(expected[block == b].sum(axis=0))


def test_beyond_some_terms_is_beyond_all_that_is_fitted(data):
    cells, soil, terms, error, block = data
    system = System(np.zeros((GROUPS, SOIL)), BLOCKS, TERMS).add(cells)
    scores, cross = system.beyond([0, 4], system.scores(cells))
    left = left_of(terms, np.hstack([soil, terms[:, [0, 4]]]))
    assert cross == pytest.approx(left.T @ left, abs=1e-9)
    assert scores[1] == pytest.approx((left * error[:, None])[block == 1].sum(axis=0), abs=1e-9)
    assert system.surviving(cross) == pytest.approx((left**2).sum(axis=0) / (terms**2).sum(axis=0), abs=1e-12)


def test_a_fit_is_that_of_least_squares(data):
    cells, soil, terms, error, _ = data
    fitted = System(np.zeros((GROUPS, SOIL)), BLOCKS, TERMS).add(cells).fit([0, 2, 5], cells)
    expected = np.linalg.lstsq(np.hstack([soil, terms[:, [0, 2, 5]]]), error, rcond=None)[0]
    assert np.concatenate([fitted.soil.ravel(), fitted.coefficients]) == pytest.approx(expected)


def test_a_term_that_the_groups_imitate_does_not_survive():
    rng = np.random.default_rng(2)
    soil = rng.normal(size=(50, 1))
    cell = ScoreCell(
        group=0,
        block=0,
        columns=np.arange(2),
        weight=1.0,
        residual=rng.normal(size=50),
        soil=soil,
        terms=np.hstack([soil, soil**2]),
    )
    system = System(np.zeros((1, 1)), 1, 2).add([cell])
    scores, cross = system.beyond([], system.scores([cell]))
    assert system.surviving(cross)[0] == pytest.approx(0.0, abs=1e-12)
    assert scores[0, 0] == pytest.approx(0.0, abs=1e-9)
    assert system.surviving(cross)[1] > 0.1


def test_parameters_that_nothing_determines_are_left_alone():
    cell = ScoreCell(
        group=0,
        block=0,
        columns=np.arange(1),
        weight=1.0,
        residual=np.ones(20),
        soil=np.zeros((20, 3)),
        terms=np.ones((20, 1)),
    )
    fitted = System(np.zeros((1, 3)), 1, 1).add([cell]).fit([0], [cell])
    assert fitted.coefficients == pytest.approx([1.0])
    assert np.all(fitted.soil == 0.0)


def test_parameters_move_no_further_than_what_is_known_of_them_allows():
    rng = np.random.default_rng(3)
    soil = 1e-6 * rng.normal(size=(200, 1))
    cell = ScoreCell(
        group=0,
        block=0,
        columns=np.arange(1),
        weight=1.0,
        residual=rng.normal(size=200),
        soil=soil,
        terms=np.ones((200, 1)),
    )
    free, held = (
        System(np.full((1, 1), precision), 1, 1).add([cell]).fit([], [cell]).soil[0, 0]
        for precision in (0.0, 1.0)
    )
    # By least squares it would have to be a hundred thousand times what it is known by.
    assert abs(free) > 1e4
    assert abs(held) < 1e-3
