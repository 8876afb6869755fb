"""Results as tables, sentences and files."""
