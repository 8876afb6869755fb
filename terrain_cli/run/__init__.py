"""One log from its file to its table: what was asked for, and each step in turn."""
