"""Which field of a file feeds which channel of which wheel."""
