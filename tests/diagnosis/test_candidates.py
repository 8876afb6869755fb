"""What is listed of candidates."""

from types import SimpleNamespace

import numpy as np
import pytest

from terrain_cli.diagnosis import steps


@pytest.mark.parametrize(("loss", "share"), [(0.5, np.nan), (1.0, np.nan), (3.0, 0.5)])
def test_share_of_a_misfit_that_is_there(loss, share):
    base = SimpleNamespace(loss=np.full(10, loss), residuals=[np.ones(10)], heldout={})
    named = dict.fromkeys(("strong", "weak"), 0.0)
    found = SimpleNamespace(
        scores=named,
        p_values=named,
        surviving=named,
        explained={"weak": 1.0, "strong": 10.0},
        sizes={name: {} for name in named},
    )
    hypotheses = [SimpleNamespace(id=name, title=name) for name in ("weak", "strong")]
    log = SimpleNamespace(data=None, found=found, hypotheses=hypotheses)
    first, second = steps.candidates(log, base, [], ())
    assert (first.effect, second.effect) == ("strong", "weak")
    assert first.explained == pytest.approx(share, nan_ok=True)
