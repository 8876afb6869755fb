"""Laws of users: read from a text, checked, and evaluated."""
