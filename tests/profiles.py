"""How many examples of a property are tried: the same ones each time, or many others to search.

`--hypothesis-profile=explore` searches. What it finds becomes an `@example` of its test.
"""

from __future__ import annotations

from hypothesis import settings

#: How long an example takes says how busy the machine is: none is timed.
settings.register_profile("default", max_examples=100, derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=2_000, deadline=None, print_blob=True)


def examples(count, **options):
    """Return the settings of a property of which the default profile tries so many examples."""
    return settings(max_examples=count * settings.default.max_examples // 100, **options)
