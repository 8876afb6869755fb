"""The paper's rig: the commands of its page run, print what it says, and draw its pictures."""

from __future__ import annotations

import re
import tomllib

import pages

PAGE = pages.text_of("paper.md")
PICTURES = re.findall(r"!\[.+\]\((.+)\)", PAGE)


def test_prints_and_draws_what_the_page_says(tmp_path, bin_folder, terrain_est_here):
    # One test: two workers would run all of the commands twice.
    outputs, folder = pages.run(PAGE, tmp_path, bin_folder, terrain_est_here, remarks=True)
    for commands, text in pages.steps(PAGE):
        pages.assert_printed(text, outputs[commands.splitlines()[-1]])
    pages.assert_bold_figures_are_printed(PAGE, outputs)
    assert_statuses_are_those_of_the_prose(outputs)
    for name in re.findall(r"`([\w-]+/[\w-]+\.png)`", PAGE):
        assert (folder / name).stat().st_size > 10_000


def assert_statuses_are_those_of_the_prose(outputs):
    rig, soils = (text for line, text in outputs.items() if "spread.py" in line)
    ok = [[int(n) for n in re.findall(r"(\d+) of 10", line)] for line in after(rig, "status ok")]
    assert [sum(column) for column in zip(*ok, strict=True)] == [0, 10, 25]
    assert [line.split()[-3:] for line in after(soils, "status ok")] == [["10", "of", "10"]] * 4


def after(text, heading):
    """Return the lines of a table that follow its heading."""
    return text.partition(f"\n{heading}")[2].splitlines()[1:]


def test_pictures_of_the_page_are_small():
    assert len(PICTURES) == 3
    for name in PICTURES:
        assert (pages.ROOT / "docs" / name).stat().st_size <= 250_000


def test_soils_of_the_rig_are_those_of_table_iv():
    drive = tomllib.loads((pages.ROOT / "sample_data" / "paper" / "rig.toml").read_text("utf-8"))
    told = {name: (soil["cohesion"], soil["phi_deg"]) for name, soil in drive["soils"].items()}
    assert told == {
        "washed-sand": (770.0, 29.6),
        "dried-bentonite": (700.0, 32.1),
        "compacted-topsoil": (1040.0, 43.7),
    }


def test_linked_files_exist():
    pages.assert_linked_files_exist(PAGE)
