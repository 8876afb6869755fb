"""ROS bags: topics to named columns, batch by batch."""

from __future__ import annotations

from formats.rosbag.bag_source import BagSource

__all__ = ["BagSource"]
