"""The files that bags are kept in: ROS 1, MCAP and SQLite, whole, damaged, or still growing."""
