"""A test of a real program that did not run is no success where CI is set."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest_plugins = "pytester"

TESTS = """
    import pytest

    @pytest.mark.real("no-such-program")
    def test_without_its_program(): pass

    @pytest.mark.real("sh")
    def test_with_its_program(): pass

    @pytest.mark.real
    @pytest.mark.skipif(True, reason="library too old")
    def test_skipped_by_itself(): pass

    @pytest.mark.real
    def test_skipped_on_its_way(): pytest.skip("no display")

    @pytest.mark.real
    @pytest.mark.xfail(reason="known fault")
    def test_known_to_fail(): assert False

    def test_that_is_not_real(): pytest.skip("slow")
"""


@pytest.fixture
def run(pytester, monkeypatch):
    pytester.makeconftest(Path(__file__).with_name("conftest.py").read_text("utf-8"))
    pytester.makeini("[pytest]\nmarkers = real(*programs): needs real programs")
    pytester.makepyfile(TESTS)
    monkeypatch.delenv("CI", raising=False)
    return lambda: pytester.runpytest_inprocess("-rs", "-p", "no:cacheprovider")


def test_it_is_skipped_on_a_desk(run):
    done = run()
    done.assert_outcomes(passed=1, skipped=4, xfailed=1)
    done.stdout.fnmatch_lines(["*no-such-program is not installed*"])


def test_it_fails_where_ci_is_set(run, monkeypatch):
    monkeypatch.setenv("CI", "true")
    done = run()
    assert done.parseoutcomes() == {"passed": 1, "failed": 1, "errors": 2, "xfailed": 1, "skipped": 1}
    done.stdout.fnmatch_lines(["*was skipped: *no-such-program is not installed*"])
