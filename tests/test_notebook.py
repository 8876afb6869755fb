"""The notebook of docs/: its cells run in their order, and find what they say."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest
from matplotlib.figure import Figure

DOCS = Path(__file__).resolve().parent.parent / "docs"
CELLS = json.loads((DOCS / "notebook.ipynb").read_text("utf-8"))["cells"]


@pytest.fixture(scope="module")
def run():
    """Run every cell as Jupyter does; return the names that are there, and what the cells show."""
    names, shown = {"__name__": "__main__"}, []
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(DOCS)
        patch.setenv("MPLBACKEND", "Agg")
        for cell in CELLS:
            if cell["cell_type"] == "code":
                tree = ast.parse("".join(cell["source"]))
                last = tree.body.pop()
                assert isinstance(last, ast.Expr), "a cell ends with what it shows"
                exec(compile(tree, "cell", "exec"), names)  # noqa: S102 - our own
                shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))  # noqa: S307
    return names, shown


def test_jupyter_opens_it():
    notebook = json.loads((DOCS / "notebook.ipynb").read_text("utf-8"))
    assert (notebook["nbformat"], notebook["nbformat_minor"]) == (4, 5)
    assert notebook["metadata"]["kernelspec"]["language"] == "python"
    assert len({cell["id"] for cell in CELLS}) == len(CELLS)
    for cell in CELLS:
        assert cell.keys() - {"execution_count", "outputs"} == {"cell_type", "id", "metadata", "source"}
        if cell["cell_type"] == "code":
            assert (cell["outputs"], cell["execution_count"]) == ([], None)


def test_links_lead_somewhere():
    links = re.findall(r"\]\(([^)#]+)", "".join(line for cell in CELLS for line in cell["source"]))
    assert links
    assert all((DOCS / link).exists() for link in links)


def test_every_cell_shows_what_is_said_of_it(run):
    names, shown = run
    assert names["found"].effect == "slip-sinkage"
    assert "Most likely cause: slip-sinkage" in names["found"]._repr_html_()
    assert names["found"].candidates["effect"][0] == "slip-sinkage"
    assert names["trial"].kept
    assert list(names["soil"]["status"]) == ["model-misses"]
    assert list(names["better"]["status"]) == ["ok"]
    pictures = [one for one in shown if isinstance(one, Figure)]
    assert len(pictures) == 2
    assert all(picture._repr_png_().startswith(b"\x89PNG") for picture in pictures)
    for result in ("before", "found", "trial"):
        assert "<table" in names[result]._repr_html_()


def test_the_better_model_is_better(run):
    names, _ = run
    errors = names["after"].channels
    assert (errors["heldout_rmse"] < 1.1 * errors["noise"]).all()
    assert (errors["heldout_rmse"] < 0.2 * names["before"].channels["heldout_rmse"]).all()
    (text,) = (one for one in map("".join, (cell["source"] for cell in CELLS)) if "c = 1.04" in one)
    cohesion, angle = map(float, re.search(r"c = ([\d.]+) kPa and φ = ([\d.]+)°", text).groups())
    row = names["better"].iloc[0]
    assert abs(row["c_kPa"] - cohesion) < 2.0 * row["c_se_kPa"]
    assert abs(row["phi_deg"] - angle) < 2.0 * row["phi_se_deg"]
