"""The tutorial: its commands run, and what it says they print is what they print."""

from __future__ import annotations

import pages
import pytest

PAGE = pages.text_of("tutorial.md")


@pytest.fixture(scope="module")
def outputs(tmp_path_factory, bin_folder):
    return pages.run(PAGE, tmp_path_factory.mktemp("clone"), bin_folder)[0]


@pytest.mark.parametrize(("commands", "text"), [step for step in pages.steps(PAGE) if step[1]])
def test_prints_what_the_page_says(commands, text, outputs):
    pages.assert_printed(text, outputs[commands.splitlines()[-1]])


def test_figures_in_the_prose_are_those_of_the_commands(outputs):
    pages.assert_bold_figures_are_printed(PAGE, outputs)


def test_every_log_of_the_tutorial_is_used_and_small():
    for path in (pages.ROOT / "sample_data" / "tutorial").iterdir():
        assert path.stat().st_size <= 300_000
        assert path.suffix != ".csv" or any(path.name in line for line in pages.lines(PAGE))


def test_linked_files_exist():
    pages.assert_linked_files_exist(PAGE)
