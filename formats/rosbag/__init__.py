"""ROS bags: topics to named columns, batch by batch."""
