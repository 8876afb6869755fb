"""A drive followed while it goes on: rows that arrive become samples, segments, and rows of the table."""
