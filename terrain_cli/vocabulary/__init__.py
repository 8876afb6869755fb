"""What things are called, and in which unit: channels, units, quantities, choices."""
