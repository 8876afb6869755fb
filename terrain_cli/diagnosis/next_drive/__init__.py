"""The drive that settles what a log leaves open."""
