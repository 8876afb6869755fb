"""The next drive: of the `manoeuvres`, `suggestion` chooses the one with the greatest `power`."""
