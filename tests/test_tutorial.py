"""The tutorial: its commands run, and what it says they print is what they print."""

from __future__ import annotations

import pages

PAGE = pages.text_of("tutorial.md")


def test_prints_what_the_page_says(tmp_path, bin_folder, terrain_est_here):
    # One test: two workers would run all of the commands twice.
    outputs, _ = pages.run(PAGE, tmp_path, bin_folder, terrain_est_here)
    for commands, text in pages.steps(PAGE):
        pages.assert_printed(text, outputs[commands.splitlines()[-1]])
    pages.assert_bold_figures_are_printed(PAGE, outputs)


def test_every_log_of_the_tutorial_is_used_and_small():
    for path in (pages.ROOT / "sample_data" / "tutorial").iterdir():
        assert path.stat().st_size <= 300_000
        assert path.suffix != ".csv" or any(path.name in line for line in pages.lines(PAGE))


def test_linked_files_exist():
    pages.assert_linked_files_exist(PAGE)
