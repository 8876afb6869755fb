"""Tables of text, CSV and its kin, plain or compressed; and texts in them that a spreadsheet would run."""

import re

#: As OWASP lists them ("CSV injection"), with their wide forms. A sign alone is nothing to run.
_FORMULA = re.compile(r"'*(?:[=+\-@\uff1d\uff0b\uff0d\uff20].|[\t\r\n])", re.DOTALL)


def guarded(text: str | None) -> str | None:
    """Put an apostrophe before a text that a spreadsheet would run; `unguarded` takes it off."""
    return f"'{text}" if text and _FORMULA.match(text) else text


def unguarded(text: str) -> str:
    """Take off the apostrophe that `guarded` puts before a text."""
    return text[1:] if text.startswith("'") and _FORMULA.match(text[1:]) else text
